"""Limits of age and temperature, and of everything that the responsible person has set."""

from dataclasses import dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files import codec
from spherecal.files.atomic import make_parent, write_file_whole
from spherecal.files.codec import text
from spherecal.files.json_file import JsonValue
from spherecal.files.registry import settings_path
from spherecal_rigs.entry import Entry
from spherecal_rigs.kept_checks import KeptCheck

State = Literal["fresh", "ageing", "stale", "none"]
_WORST = ("fresh", "ageing", "stale")
# Two clocks on one network agree to seconds; more than this and one of them is wrong.
_CLOCK_ERROR_HOURS = 0.1


@dataclass(frozen=True)
class ValidityLimits:
    """When a calibration counts as ageing and as stale, by its age and by the temperature change since.

    Hours: those after which QTM warns and refuses (docs.qualisys.com, calibration quality warning). Temperature: a rig
    1.3 m wide on aluminium (23e-6/K) grows by 0.03 mm per kelvin, and 0.05 mm is what a reference bar may deviate.
    """

    ageing_hours: float = 5.0
    stale_hours: float = 12.0
    ageing_kelvin: float = 1.0
    stale_kelvin: float = 2.0

    def __post_init__(self) -> None:
        pairs = ((self.ageing_hours, self.stale_hours, "hours"), (self.ageing_kelvin, self.stale_kelvin, "kelvin"))
        for ageing, stale, unit in pairs:
            if not 0 <= ageing <= stale < float("inf"):
                raise InputError(Phrase("error-validity-limits", {"ageing": ageing, "stale": stale, "unit": unit}))


@dataclass(frozen=True)
class Validity:
    """The chip's state and the reasons for it, most serious first; age in hours, change in kelvin where known."""

    state: State
    reasons: tuple[str, ...]
    age_hours: float | None = None
    change_kelvin: float | None = None


def validity(
    entry: Entry | None,
    limits: ValidityLimits,
    now: datetime | None = None,
    temperature_c: float | None = None,
    checked: KeptCheck | None = None,
) -> Validity:
    """How far a calibration may be trusted at this time and temperature, and after its last quick check."""
    if entry is None:
        return Validity("none", ("no calibration is in use",))
    age = ((now or datetime.now(UTC)) - entry.calibrated_at).total_seconds() / 3600
    judged: list[tuple[str, str]] = [_by_age(age, limits)]
    change = None
    if temperature_c is not None and entry.temperature_c is not None:
        change = temperature_c - entry.temperature_c
        state = _state(abs(change), limits.ageing_kelvin, limits.stale_kelvin)
        judged.append((state, f"the temperature has changed by {change:+.1f} K"))
    if not entry.valid:
        judged.append(("stale", "the calibration is marked as not valid"))
    elif entry.care:
        judged.append(("ageing", f"it is to be used with care: {entry.care}"))
    if entry.contradicted and (override := entry.override) is not None:
        judged.append(("ageing", f"its verification failed; used all the same by {override.by}: {override.reason}"))
    elif entry.contradicted:
        judged.append(("stale", "the reference bars contradicted it"))
    if checked is not None and checked.verdict != "ok":
        state = "stale" if checked.verdict == "recalibrate" else "ageing"
        judged.append((state, f"the quick check of {checked.at:%Y-%m-%d %H:%M} UTC says {checked.verdict}"))
    judged.sort(key=lambda one: -_WORST.index(one[0]))
    worst: State = "stale" if judged[0][0] == "stale" else "ageing" if judged[0][0] == "ageing" else "fresh"
    return Validity(worst, tuple(reason for one, reason in judged if one == worst), age, change)


def _by_age(hours: float, limits: ValidityLimits) -> tuple[str, str]:
    if hours < -_CLOCK_ERROR_HOURS:
        return "stale", f"the calibration is {-hours:.1f} h in the future: a clock is wrong"
    state = _state(max(hours, 0.0), limits.ageing_hours, limits.stale_hours)
    return state, f"calibrated {max(hours, 0.0):.1f} h ago"


def _state(value: float, ageing: float, stale: float) -> str:
    return "fresh" if value < ageing else "ageing" if value < stale else "stale"


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
    def validity(self) -> ValidityLimits:
        """Those of a calibration's age and temperature, as a profile has them."""
        return ValidityLimits(self.ageing_hours, self.stale_hours, self.ageing_kelvin, self.stale_kelvin)


NAMES = tuple(field.name for field in fields(Limits))


def _check_formula(text: str, value: JsonValue) -> None:
    from spherecal.verify.limit import parse_limit

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
