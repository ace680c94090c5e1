"""One state for header, headline, rail, tiles and footer: what a step says, joined with what is wrong elsewhere."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from spherecal_gui.workflow import Status, StepKind

Level = Literal["none", "good", "caution", "bad"]
Default = Literal["action", "next", ""]
# What the large button does: as long as this stays, its meaning stays.
Deed = Literal[
    "", "accept", "calibrate", "cancel", "capture", "check", "confirm", "describe", "finish", "measure", "next",
    "record", "report", "results", "retake", "save", "stop recording", "use",
]  # fmt: skip

# Nothing known is better than nothing: a part that has nothing to say does not spoil what another one knows.
_RANK: tuple[Level, ...] = ("none", "good", "caution", "bad")
_LEVELS: dict[Status, Level] = {
    Status.DONE: "good", Status.CARE: "caution", Status.STALE: "caution", Status.FAILED: "bad",
}  # fmt: skip
# The steps at which the cameras must deliver; a calibration is computed and saved without them.
NEEDS_CAMERAS: tuple[StepKind, ...] = ("connect", "look", "placement", "scale", "verify", "check")


@dataclass(frozen=True)
class Part:
    """One thing that bears on a page: how good it is, and the sentence that says so."""

    level: Level
    text: str = ""


@dataclass(frozen=True)
class Button:
    """The one large button."""

    text: str
    does: Deed = ""
    enabled: bool = True
    why: str = ""  # it cannot be pressed
    done: bool = False  # the step's work is: the space bar goes on to the next step instead
    accepts: bool = False  # what is shown, which the space bar does not do where that is red


@dataclass(frozen=True)
class Said:
    """What a step says of itself. `also`: keys of what else can be done; `stay`: why one does not go on from here."""

    level: Level
    text: str
    button: Button | None = None
    count: str = ""
    also: frozenset[str] = frozenset()
    stay: str = ""
    left: str = ""


@dataclass(frozen=True)
class Standing:
    """What a page shows: the worst level, the sentence of the part that has it, what the space bar presses."""

    level: Level
    text: str
    default: Default = ""
    said: Said = field(default=Said("none", ""))


def level_of(status: Status) -> Level:
    """The level of a step's status."""
    return _LEVELS.get(status, "none")


def worst(levels: Iterable[Level]) -> Level:
    """The worst of some levels; `none` where there are none."""
    found: list[Level] = [*levels, "none"]
    return max(found, key=_RANK.index)


def worse(one: Level, other: Level) -> bool:
    """Whether a level is worse than another."""
    return _RANK.index(one) > _RANK.index(other)


def stand(
    said: Said, step: Part, troubles: Sequence[Part] = (), may_go_on: bool = False, alarmed: bool = False
) -> Standing:
    """The standing of a page; of parts that are equally bad the page's own comes first, then the step's."""
    parts = (Part(said.level, said.text), step, *troubles)
    level = worst(part.level for part in parts)
    text = next((part.text for part in parts if part.level == level and part.text), said.text)
    default = _default("bad" if alarmed else level, said.button, may_go_on and not said.stay)
    return Standing("none" if alarmed and level == "good" else level, text, default, said)


def _default(level: Level, button: Button | None, may_go_on: bool) -> Default:
    """Red never goes on by itself: neither to the next step nor by accepting what is shown."""
    if button is not None and button.enabled and not button.done:
        return "" if button.accepts and level == "bad" else "action"
    return "next" if (button is None or button.done) and may_go_on and level != "bad" else ""


def status_shown(status: Status, level: Level) -> Status:
    """How the rail draws the current step: its status, unless the state of the page is worse."""
    if status in (Status.BLOCKED, Status.RUNNING) or not worse(level, level_of(status)):
        return status
    if level == "bad":
        return Status.FAILED
    return Status.CARE if level == "caution" and status is Status.DONE else status


def camera_level(lost: bool, connected: bool, kind: StepKind | None, live: bool, page: Level = "none") -> Level:
    """The colour of the cameras' chip: red only where the page needs them, never greener than what the `page` says."""
    if (lost or not connected) and (kind is None or kind in NEEDS_CAMERAS):
        return "bad"
    return worst((page, "caution" if lost or not connected or not live else "good"))
