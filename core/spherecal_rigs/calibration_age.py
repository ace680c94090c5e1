"""The validity chip: fresh, ageing, stale or none, and why."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
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
