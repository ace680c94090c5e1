"""What a result says, for the window: verdict, cameras worst first, findings and what they advise."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.data.findings import Finding
from spherecal_gui import languages
from spherecal_gui.coverage import Level
from spherecal_gui.languages import translate

if TYPE_CHECKING:  # imports scipy
    from spherecal.data.rig import Affected
    from spherecal_files.verification_file import BarReport
    from spherecal_gui.tasks.outcome import CameraEffect, Compared
    from spherecal_rigs.result_folder import Result

ActionKind = Literal["add placement", "retake", "show camera", "calibrate", "bench", "--leave-out", "--split", "--swap"]


@dataclass(frozen=True)
class VerdictText:
    """A verdict: the word and its colour first, then one sentence."""

    word: str
    level: Level
    sentence: str


@dataclass(frozen=True)
class CameraRow:
    """One camera in the table; None where it could not be placed."""

    camera: str
    rms_px: float | None
    observations: int
    left_out: int
    sd_centre_mm: float | None
    sd_turn_deg: float | None
    focal_px: float | None
    placed: bool
    change_mm: float | None = None
    moved: bool = False


@dataclass(frozen=True, eq=False)
class CameraResiduals:
    """The residuals of one camera."""

    camera: str
    image_size: tuple[int, int]
    uv: FloatArray  # observed places (n, 2) px
    du_dv: FloatArray  # residuals (n, 2) px
    used: BoolArray  # (n,)
    placements: tuple[str, ...] = ()  # at which it saw something
    placement: str | None = None  # that is shown; None: all
    taken_at: tuple[str, ...] = ()  # the placement of each dot (n,)


@dataclass(frozen=True)
class Action:
    """A button: what it does, to what, and what it says."""

    kind: ActionKind
    target: str
    text: str


@dataclass(frozen=True)
class FindingAdvice:
    """A finding in words, and the buttons that do what it advises; `where` are the names that its title lacks."""

    level: Level
    title: str
    message: str
    hint: str
    actions: tuple[Action, ...] = ()
    where: str = ""


def verdict(result: "Result") -> VerdictText:
    """The verdict on a result."""
    quality, cameras = result.rig.quality, result.rig.cameras
    everything = len(result.camera_ids)
    if not cameras:
        return VerdictText(translate("Results", "FAILED"), "bad", translate("Results", "No camera could be placed."))
    sentence = translate("Results", "{placed} of {all} cameras placed; the images agree to {rms:.3f} px.").format(
        placed=len(cameras), all=everything, rms=quality.rms_px or float("nan")
    )
    lengths = result.rig.length_map
    if quality.valid and lengths is not None and lengths.typical_mm is not None:
        text = translate("Results", "A length of {length:.0f} mm is measured to {mm:.3f} mm (95 %).")
        text = text.format(length=lengths.length_mm, mm=lengths.typical_mm)
        sentence = f"{sentence} {text}"
    if not quality.valid:
        return VerdictText(translate("Results", "NOT VALID"), "bad", sentence)
    if quality.affected:
        care = translate("Results", "With care: {what}.").format(what=care_text(quality.affected))
        return VerdictText(translate("Results", "USE WITH CARE"), "caution", f"{care} {sentence}")
    return VerdictText(translate("Results", "VALID"), "good", sentence)


_MOST_NAMED = 6


def care_text(affected: "Sequence[Affected]") -> str:
    """What a calibration is to be used with care for."""
    cameras = [one.camera for one in affected if one.camera is not None]
    parts = [languages.some(cameras, _MOST_NAMED)] if cameras else []
    parts += [translate("Results", "the scale")] if any(one.scale for one in affected) else []
    parts += [translate("Results", "a part of the volume")] if any(one.region_mm for one in affected) else []
    return languages.listed(parts)


def bar_verdict(bars: "BarReport") -> VerdictText:
    """The verdict of a verification: against a limit PASS, FAIL or CANNOT TELL, without one CONSISTENT or not."""
    errors = np.array([bar.error_mm for bar in bars.measured])
    sentence = ""
    if len(errors):
        sentence = translate("Verify", "{count} lengths, mean error {mean:+.3f} mm, largest {most:.3f} mm.").format(
            count=len(errors), mean=round(float(errors.mean()), 3) + 0.0, most=float(np.abs(errors).max())
        )
    acceptance = bars.procedure.acceptance if bars.procedure is not None else None
    unseen = [c.id for c in bars.cameras if c.state == "not seen"]
    if unseen and bars.measured:
        text = translate("Verify", "Not verified, since they saw no mark: {cameras}.")
        sentence = f"{sentence} {text.format(cameras=languages.listed(unseen))}"
    if bars.contradicting:
        text = translate("Verify", "Not where the calibration has them: {cameras}.")
        sentence = f"{text.format(cameras=languages.listed(bars.contradicting))} {sentence}"
    if bars.override is not None:
        text = translate("Verify", "Used all the same by {by}: {reason}")
        sentence = f"{sentence} {text.format(by=bars.override.by, reason=bars.override.reason)}"
    elif bars.failed:
        sentence = f"{_why_failed(bars)} {sentence}".strip()  # what to do comes first
    if acceptance is not None and acceptance.verdict == "fail":
        return VerdictText(translate("Verify", "FAIL"), "bad", sentence)
    if bars.failed:
        return VerdictText(translate("Verify", "INCONSISTENT"), "bad", sentence)
    if acceptance is not None and acceptance.verdict == "cannot tell":
        why = translate("Verify", "The uncertainty is too large for the limit: “Budget” says what helps most.")
        return VerdictText(translate("Verify", "UNDECIDED"), "caution", f"{why} {sentence}")
    if acceptance is not None and acceptance.verdict == "pass":
        return VerdictText(translate("Verify", "PASS"), "good", sentence)
    if bars.verdict == "consistent":
        return VerdictText(translate("Verify", "CONSISTENT"), "caution" if unseen else "good", sentence)
    missing = translate("Verify", "No captured pose shows two marks of the bar to two cameras: capture them again.")
    return VerdictText(translate("Verify", "NO DATA"), "caution", sentence or missing)


def _why_failed(bars: "BarReport") -> str:
    """What to do about lengths that are wrong; of a wrong scale, that it is wrong."""
    for finding in bars.findings:
        if finding.code in ("lengths-contradict", "limit-exceeded"):
            message = finding.words("message", languages.now()) if finding.kind == "scale" else ""
            return f"{message} {finding.words('hint', languages.now(), with_options=False)}".strip()
    return ""


def camera_rows(result: "Result", compared: "Compared | None" = None) -> list[CameraRow]:
    """All cameras, those that could not be placed and the largest rms first; with the change since another result."""
    rows = []
    contradicting = ~result.residuals.used & ~_seen_by_one(result)
    changes = {one.id: one for one in compared.comparison.cameras} if compared is not None else {}
    for name in result.camera_ids:
        camera, own = result.rig.camera(name), result.residuals.rows_of.get(name, np.empty(0, np.int64))
        out = int(contradicting[own].sum())
        if camera is None:
            rows.append(CameraRow(name, None, len(own), out, None, None, None, placed=False))
            continue
        sigma, change = camera.sigma, changes.get(name)
        focal = float(camera.intrinsics[0])
        row = CameraRow(name, camera.rms_px, camera.observations, out, None, None, focal, placed=True)
        if sigma is not None:
            place, turn = (float(np.linalg.norm(one)) for one in (sigma.centre_mm, sigma.rotation_deg))
            row = replace(row, sd_centre_mm=place, sd_turn_deg=turn)
        if change is not None:
            row = replace(row, change_mm=float(change.ray_rms_mm), moved=change.moved)
        rows.append(row)
    return sorted(rows, key=lambda row: (row.placed, -(row.rms_px or 0.0)))


def culprit(result: "Result") -> tuple[str, str | None] | None:
    """The camera (and placement) that the worst finding names; a camera that was moved takes others with it."""
    cameras, placements = set(result.camera_ids), set(result.residuals.placement)
    for severity in ("error", "warning"):
        for finding in result.rig.quality.findings:
            if finding.severity != severity:
                continue
            accused = [*(one.target for one in finding.repairs), *finding.where]
            for target in accused:
                names, _, place = target.removeprefix("camera:").partition("@")
                name = names.partition(",")[0]
                if name in cameras:
                    there = [one for one in (place, *finding.where) if one in placements]
                    return name, there[0] if there else None
    return None


def _seen_by_one(result: "Result") -> BoolArray:
    """Which observations (n,) are a dot's only one: nothing can contradict them, and they are not used either."""
    r = result.residuals
    dots = list(zip(r.placement, r.target.tolist(), r.point, strict=True))
    placed = [result.rig.camera(camera) is not None for camera in r.camera]
    views = Counter(dot for dot, there in zip(dots, placed, strict=True) if there)
    return np.array([views[dot] < 2 for dot in dots], dtype=bool)


def compared_text(compared: "Compared | None") -> tuple[str, Level]:
    """What has changed since the calibration in use; empty where there is nothing to compare with."""
    if compared is None:
        return "", "none"
    found = compared.comparison
    moved = [one.id for one in found.cameras if one.moved]
    since = translate("Results", "Since calibration {number} of {made}:")
    since = since.format(number=compared.number, made=compared.made)
    parts = []
    if found.length_mm is not None:
        text = translate("Results", "lengths change by up to {mm:.3f} mm")
        parts.append(text.format(mm=abs(found.length_mm)))
    some, none = translate("Results", "{cameras} moved"), translate("Results", "no camera stands out")
    parts.append(some.format(cameras=languages.listed(moved)) if moved else none)
    return f"{since} {languages.listed(parts)}.", "caution" if moved else "none"


def residuals_of(result: "Result", camera: str, placement: str | None = None) -> CameraResiduals | None:
    """The residuals of a placed camera, of all placements where this one has none; None where it has none at all."""
    placed = result.rig.camera(camera)
    rows = result.residuals.rows_of.get(camera)
    if placed is None or rows is None:
        return None
    table = result.residuals
    rows = rows[np.isfinite(table.predicted[rows]).all(axis=1) & np.isfinite(table.du_dv[rows]).all(axis=1)]
    where = [table.placement[row] for row in rows.tolist()]
    placements = tuple(dict.fromkeys(where))
    if placement in placements:
        rows = rows[np.array([one == placement for one in where], dtype=bool)]
    else:
        placement = None
    du_dv = table.du_dv[rows]
    uv = table.predicted[rows] - du_dv
    taken_at = tuple(table.placement[row] for row in rows.tolist())
    return CameraResiduals(camera, placed.image_size, uv, du_dv, table.used[rows], placements, placement, taken_at)


def residual_text(result: "Result", shown: CameraResiduals) -> str:
    """How large a camera's residuals are: mean and largest, in px and, where there is a scale, in mm at the ball."""
    lengths = np.linalg.norm(shown.du_dv[shown.used], axis=1)
    if not len(lengths):
        return ""
    mean, most = float(lengths.mean()), float(lengths.max())
    camera = result.rig.camera(shown.camera)
    balls = [one.centre_mm for one in result.spheres if shown.placement in (None, one.placement)]
    if result.rig.scale.source == "none" or not balls:
        return translate("Results", "Mean {mean:.3f} px, largest {most:.3f} px.").format(mean=mean, most=most)
    assert camera is not None
    far = float(np.linalg.norm(np.array(balls) - camera.centre_mm, axis=1).mean())
    each = far / float(camera.intrinsics[0])
    text = translate(
        "Results", "Mean {mean:.3f} px, largest {most:.3f} px; at the ball {mean_mm:.3f} and {most_mm:.3f} mm."
    )
    return text.format(mean=mean, most=most, mean_mm=mean * each, most_mm=most * each)


_MORE = (
    "few-placements", "little-coverage", "weak-self-calibration", "two-view-points", "cameras-unlinked",
    "placements-stacked", "placements-clustered", "intrinsics-held", "linked-by-a-thread",
)  # fmt: skip
_BENCH = ("no-scale", "target-distance", "ball-diameter")


def advice(result: "Result", placements: tuple[str, ...]) -> list[FindingAdvice]:
    """The findings, errors first, each with what can be done at once."""
    levels: dict[str, Level] = {"error": "bad", "warning": "caution", "info": "none"}
    cameras = set(result.camera_ids)
    found = []
    for finding in result.rig.quality.findings:
        actions: list[Action] = []
        if finding.severity != "info":
            for one in finding.repairs:
                option = cast("ActionKind", f"--{one.kind}")
                actions.append(Action(option, one.target, repair_text(option, one.target)))
            actions += _steps_for(finding, placements)
        if not actions:
            names = [name for name in finding.where if name in cameras][:1]
            text = translate("Results", "Show {name}")
            actions += [Action("show camera", name, text.format(name=name)) for name in names]
        found.append(_advice_of(finding, levels[finding.severity], tuple(actions)))
    return found


def _advice_of(finding: Finding, level: Level, actions: tuple[Action, ...]) -> FindingAdvice:
    """A finding in the reader's language; options of the command line are not named where there are buttons."""
    has_buttons = any(action.kind.startswith("--") for action in actions)
    title = finding.words("title", languages.now())
    message = finding.words("message", languages.now())
    hint = finding.words("hint", languages.now(), with_options=not has_buttons)
    named = () if any(name in title for name in finding.where) else finding.where
    return FindingAdvice(level, title, message, hint, actions, languages.some(named, _MOST_NAMED))


def _steps_for(finding: Finding, placements: tuple[str, ...]) -> list[Action]:
    """Steps to go back to: a placement to retake, one more, the bench."""
    placed = next((name for name in finding.where if name in placements), None)
    if placed is not None:
        return [Action("retake", placed, translate("Results", "Retake {name}").format(name=placed))]
    if finding.code in _MORE:
        return [Action("add placement", "", translate("Results", "Add a placement"))]
    if finding.code == "stopped-early":
        return [Action("calibrate", "", translate("Results", "Calibrate again"))]
    if finding.code in _BENCH:
        return [Action("bench", "", translate("Results", "Go to the bench"))]
    return []


def repair_text(option: str, value: str) -> str:
    """What a repair does, on its button."""
    first, at, second = value.rpartition("@")
    if option == "--swap":
        text = translate("Results", "Exchange {cameras} at {place}") if at else translate("Results", "Exchange {place}")
        return text.format(cameras=first.replace(",", " / "), place=second.replace(",", " / "))
    if option == "--split":
        return translate("Results", "Split {camera} from {place} on").format(camera=first, place=second)
    if at:
        return translate("Results", "Leave out {camera} at {place}").format(camera=first, place=second)
    return translate("Results", "Leave out {name}").format(name=value.partition(":")[2])


def field_text(effects: "tuple[CameraEffect, ...]") -> str:
    """What the maps show."""
    worst = max(effects, key=lambda one: one.field_rms_px)
    if worst.field_px is None:
        return translate("Effects", "Every lens does what its model says.")
    text = translate("Effects", "The lens of {camera} is farthest from its model: {px:.3f} px. It is corrected.")
    return text.format(camera=worst.camera, px=worst.field_rms_px)


def drift_text(effects: "tuple[CameraEffect, ...]") -> str:
    """What the lines show."""
    moving = [one for one in effects if len(one.drift_px) and one.drift_px.any()]
    if not moving:
        return translate("Effects", "No camera turned over the placements.")
    worst = max(moving, key=lambda one: float(one.drift_px.max()))
    text = translate("Effects", "{camera} turned most over the placements: {px:.2f} px. Look at its mount and cable.")
    return text.format(camera=worst.camera, px=float(worst.drift_px.max()))
