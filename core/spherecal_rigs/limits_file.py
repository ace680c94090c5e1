"""Limits that the responsible person of a rig sets: one JSON file per user."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_files import codec
from spherecal_files.atomic import make_parent, write_file_whole
from spherecal_files.codec import text
from spherecal_files.json_file import JsonValue
from spherecal_files.registry import settings_path

if TYPE_CHECKING:
    from spherecal_rigs.calibration_age import ValidityLimits

# Least: below this many common dots two cameras are no neighbours (spherecal.initialise.view_graph). Most: three times
# what the demo's and rig A's cameras see at best (420); no image would ever be enough.
DOTS = (20, 1260)
# Least: what two clocks may differ (profile.validity). Most: a year.
HOURS = (0.1, 8760.0)
# Least: what a shop's thermometer can resolve. Most: more than any shop changes.
KELVIN = (0.1, 50.0)
PAIRS = (("ageing_hours", "stale_hours"), ("ageing_kelvin", "stale_kelvin"))
Value = int | float | str | bool


@dataclass(frozen=True)
class Limits:
    """What somebody responsible allows; as made here, they are those that the program is delivered with."""

    needed_dots: int = 100  # of 270 to 420 seen by the demo's and rig A's cameras; a quarter gives twice the sd of all
    ageing_hours: float = 5.0  # of a calibration, as in `ValidityLimits`
    stale_hours: float = 12.0
    ageing_kelvin: float = 1.0
    stale_kelvin: float = 2.0
    verification_limit: str = ""  # A + L/K of a new project's length errors, empty for none
    verification_limit_open: bool = True  # a project may have another
    unverified_use: bool = True  # a calibration that was not verified may be put to use, with a reason

    @property
    def validity(self) -> "ValidityLimits":
        """Those of a calibration's age and temperature, as a profile has them."""
        from spherecal_rigs.calibration_age import ValidityLimits  # imports scipy

        return ValidityLimits(self.ageing_hours, self.stale_hours, self.ageing_kelvin, self.stale_kelvin)


NAMES = tuple(field.name for field in fields(Limits))


def _check_formula(text: str, value: JsonValue) -> None:
    from spherecal_verify.limit import parse_limit

    try:
        if text:
            parse_limit(text)
    except InputError:
        raise value.error(Phrase("problem-limit")) from None


def _check_pairs(limits: Limits, value: JsonValue) -> None:
    for ageing, stale in PAIRS:
        if getattr(limits, ageing) > getattr(limits, stale):
            raise value.error(Phrase("problem-ageing", {"ageing": ageing, "stale": stale}))


_LIMITS = codec.record(
    "The limits; what is absent is as delivered.",
    Limits,
    codec.optional("needed_dots", codec.integer("Dots that each camera needs at a placement.", *DOTS)),
    codec.optional(
        "ageing_hours",
        codec.number("Age from which a calibration is ageing, not above `stale_hours`.", *HOURS, "hours"),
    ),
    codec.optional("stale_hours", codec.number("Age from which it is stale.", *HOURS, "hours")),
    codec.optional(
        "ageing_kelvin",
        codec.number(
            "Change of the rig's temperature from which it is ageing, not above `stale_kelvin`.", *KELVIN, "kelvin"
        ),
    ),
    codec.optional("stale_kelvin", codec.number("Change from which it is stale.", *KELVIN, "kelvin")),
    codec.optional(
        "verification_limit",
        text("A + L/K of the length errors in new projects of the wizard; empty for none.").checked(_check_formula),
    ),
    codec.optional("verification_limit_open", codec.boolean("Whether a project may have another limit.")),
    codec.optional(
        "unverified_use",
        codec.boolean("Whether a calibration that no bar has verified may be put to use, with a reason."),
    ),
).checked(_check_pairs)
LIMITS = codec.FileFormat(
    "spherecal/limits",
    "limits.json",
    "What the responsible person has set, in the user's settings; `SPHERECAL_LIMITS` names another file.",
    codec.only("limits", _LIMITS),
    ("`verification_limit` is a limit such as `0.03+L/20000`.",),
    more="#limitsjson",
)


def limits_path() -> Path:
    """The file: `SPHERECAL_LIMITS`, else limits.json in the user's settings, beside the bars."""
    return settings_path("SPHERECAL_LIMITS", LIMITS.file)


def read_limits(path: Path | None = None) -> Limits:
    """The limits kept on this machine; those delivered where there is no file."""
    path = path or limits_path()
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return Limits()
    except OSError:  # the reader says what is wrong: the window has to start all the same
        pass
    return LIMITS.read(path)


def limits_in_use() -> tuple[Limits, str]:
    """The limits that hold, and what is wrong with their file: then those delivered hold. Empty where nothing is."""
    try:
        return read_limits(), ""
    except InputError as error:
        return Limits(), f"{error} Until then the delivered limits are used."


def write_limits(limits: Limits, path: Path | None = None) -> None:
    """Write the file whole; OutputError where it cannot be written."""
    path = path or limits_path()
    make_parent(path, Phrase("error-set-limits"))
    write_file_whole(path, LIMITS.bytes(limits))
