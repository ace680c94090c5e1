"""What a camera's tile says: focus, light, temperature, and what to do about them."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from spherecal_gui import languages
from spherecal_gui.coverage import Level
from spherecal_gui.languages import camera_details, camera_trouble, reason_text, translate
from spherecal_gui.workflow import Reason

if TYPE_CHECKING:  # imports scipy, OpenCV and the kernels
    from spherecal_cameras.protocol import CameraStatus, Frame
    from spherecal_gui.tasks.live_detection import Sight

# Measured on the simulated demo rig, ten times the same image (median edge of the dots; share of targets still found;
# noise of a dot): 0.7 px all, 0.007 px; 1.4 px 90 %, 0.009 px; 2.4 px 60 %, 0.012 px; 3.1 px 40 %, 0.014 px.
SOFT_PX, BLURRED_PX = 1.3, 2.3
# Measured there too: with 5 times the light 16 % of the pixels clip, with 3 times 0.6 % and nothing is worse for it.
CLIPPED = 0.02
# A tenth of the light gives a mean of 0.02 of full scale and four times the noise.
DARK = 0.02
# Of the middle camera's brightness. On the demo rig the cameras differ by 0.87 to 1.15; 0.3 of the light gives 0.41
# and five times the noise of a dot (0.0014 px instead of 0.0003), 0.15 gives 0.25.
DIM = 0.45
_FEW = 2  # cameras of which it cannot be said which one is dim


@dataclass(frozen=True)
class TileState:
    """A tile's words."""

    name: str
    level: Level = "none"
    word: str = ""  # the one thing to know or do
    dots: int | None = None  # the counter
    figures: str = ""  # its own figures
    summed: str = ""  # its trouble in a headline, with its name
    details: str = ""  # the engine's own words
    since: str = ""  # when it has sent no images
    lost: bool = False  # what the tile shows is its last image


def figures_text(serial: str, status: "CameraStatus | None", exposure_us: float) -> str:
    """A camera's serial number, images a second, exposure, temperature, as far as they are known."""
    parts = [serial]
    if status is not None and status.state.usable and status.counters.rate_hz:
        parts.append(translate("Look", "{rate:.0f} fps").format(rate=status.counters.rate_hz))
    parts.append(translate("Look", "{ms:g} ms").format(ms=round(exposure_us / 1e3, 2)))
    if status is not None and status.temperature_c is not None:
        parts.append(translate("Look", "{temperature:.0f} °C").format(temperature=status.temperature_c))
    return " · ".join(parts)


def tile_state(
    name: str,
    status: "CameraStatus | None",
    sight: "Sight | None",
    newest: "Frame | None" = None,
    bumped_px: float | None = None,
    usual: float | None = None,
    wants_dots: bool = False,
    by_some: bool = False,
) -> TileState:
    """What to say of a camera, the worst first; `usual` brightness of all; each `wants_dots`, or only `by_some`."""
    if status is not None and not status.state.usable:
        word, details, since = camera_trouble(status), camera_details(status), since_text(newest)
        return TileState(name, "bad", word, details=details, since=since, lost=True)
    if sight is None:
        looking, waiting = translate("Look", "looking for targets"), translate("Look", "waiting for the first image")
        return TileState(name, "none", looking if newest is not None else waiting)
    if bumped_px is not None:
        word = translate("Look", "moved by {px:.0f} px, alone. Is it fixed?").format(px=bumped_px)
        return TileState(name, "bad", word, len(sight.dots))
    level, word, summed = _light(sight, usual)
    if level == "good":
        level, word, summed = _focus(sight)
    if level == "good" and not len(sight.dots) and by_some:
        level, word = "none", translate("Look", "not needed here")
    if level == "good" and not len(sight.dots):
        level, word = "bad" if wants_dots else "caution", translate("Look", "no targets in sight")
    if not word and sight.blur_px is not None:
        word = translate("Look", "sharp")
    return TileState(name, level, word, len(sight.dots), summed=summed.format(camera=name))


def since_text(newest: "Frame | None") -> str:
    """Since when a camera has sent no images; empty where it never sent any."""
    if newest is None:
        return ""
    at = time.localtime(time.time() - (time.perf_counter() - newest.arrived_s))
    return translate("Look", "no images since {time}").format(time=time.strftime("%H:%M:%S", at))


def usual_light(sights: "Iterable[Sight]") -> float | None:
    """The middle brightness of the cameras; None with fewer than three, of which none is the odd one."""
    found = sorted(sight.brightness for sight in sights)
    return found[len(found) // 2] if len(found) > _FEW else None


def _light(sight: "Sight", usual: float | None = None) -> tuple[Level, str, str]:
    if sight.saturated > CLIPPED:
        word = translate("Look", "too bright: {share} % clipped. Shorten the exposure.")
        word = word.format(share=round(100 * sight.saturated))
        return "caution", word, translate("Look", "{camera} is too bright.")
    dark = translate("Look", "{camera} is too dark.")
    if sight.brightness < DARK:
        return "caution" if len(sight.dots) else "bad", translate("Look", "dark. Lens cap, light, or exposure?"), dark
    if usual is not None and sight.brightness < DIM * usual:
        word = translate("Look", "brightness {own} %, the others {usual} %. Open the aperture or expose longer.")
        return "caution", word.format(own=round(100 * sight.brightness), usual=round(100 * usual)), dark
    return "good", "", ""


def _focus(sight: "Sight") -> tuple[Level, str, str]:
    if sight.blur_px is None or sight.blur_px <= SOFT_PX:
        return "good", "", ""
    word = translate("Look", "Out of focus ({blur:.1f} px). Turn the focus ring until this falls.")
    summed = translate("Look", "{camera} is out of focus.")
    return "bad" if sight.blur_px > BLURRED_PX else "caution", word.format(blur=sight.blur_px), summed


def bump_text(cameras: dict[str, float]) -> tuple[str, str]:
    """What is said when cameras were moved, by name in px: what happened, and what to do."""
    names = languages.listed(f"{name} ({px:.0f} px)" for name, px in cameras.items())
    message = translate("Look", "Only these moved: {names}.").format(names=names)
    if len(cameras) == 1:
        ((name, px),) = cameras.items()
        message = translate("Look", "Only {name} moved ({px:.0f} px).").format(name=name, px=px)
    return (
        message,
        translate(
            "Look",
            "Tighten its mount, then press “Fixed again” at Camera check. Retake what was captured before: it no "
            "longer fits.",
        ),
    )


def warm_up_text(cameras: dict[str, float]) -> str:
    """What is said of cameras that still get warmer (or colder), by name in K/min; empty where none does."""
    if not cameras:
        return ""
    rates = languages.listed(f"{name} {rate:+.1f}" for name, rate in cameras.items())
    return translate(
        "Look", "Still warming up, in °C per minute: {rates}. Wait until it is less than 0.1: lenses move with it."
    ).format(rates=rates)


def summary(states: list[TileState], have_images: bool = False) -> tuple[str, Level]:
    """The whole wall in one sentence."""
    bad = [state.name for state in states if state.level == "bad"]
    unsure = [state.name for state in states if state.level == "caution"]
    waiting = [state.name for state in states if state.level == "none"]
    alone = {state.name: state.summed for state in states if [state.name] in (bad, unsure)}
    lost = tuple(state.name for state in states if state.lost)
    if bad and len(lost) == len(bad):
        return reason_text(Reason("cameras lost", lost)), "bad"
    if bad:
        message = translate("Look", "Check {names}.").format(names=languages.listed(bad))
        return alone.get(bad[0]) or message, "bad"
    if waiting and have_images:
        return translate("Look", "Looking for targets"), "none"
    if waiting:
        return translate("Look", "Waiting for images of {names}.").format(names=languages.listed(waiting)), "none"
    if unsure:
        message = translate("Look", "Could be better: {names}.").format(names=languages.listed(unsure))
        return alone.get(unsure[0]) or message, "caution"
    return translate("Look", "All {count} cameras: sharp, dots found.").format(count=len(states)), "good"
