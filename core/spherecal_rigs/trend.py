"""What has changed over a profile's history, with control limits: its calibrations against the first, its checks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Literal

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_rigs.compare_rigs import Comparison, compare, seen_volume
from spherecal_rigs.kept_checks import read_checks
from spherecal_rigs.rig_source import entry_volume
from spherecal_rigs.store import Profile

# A chart of single values with median moving ranges: the median +- 3 sd, sd = median range / 0.954 (the median of the
# range of two normal values in sd; D. J. Wheeler, Understanding Statistical Process Control). With means in place of
# medians one camera that moved widens its own limits until it lies within.
_LIMIT_PER_RANGE = 3 / 0.954
# Fewer values give limits that say nothing.
_LEAST_VALUES = 4


@dataclass(frozen=True)
class ControlLimits:
    """Centre line and control limits of a series."""

    centre: float
    low: float
    high: float


@dataclass(frozen=True)
class TrendSeries:
    """One quantity over the calibrations (n,), NaN where it is not known, and its limits where there are enough."""

    name: str
    unit: str
    values: FloatArray
    limits: ControlLimits | None

    @property
    def outside(self) -> list[int]:
        """The places of the values beyond the limits."""
        if self.limits is None:
            return []
        beyond = (self.values < self.limits.low) | (self.values > self.limits.high)
        return np.flatnonzero(beyond).tolist()


@dataclass(frozen=True)
class Trend:
    """A profile's history: ids and times, series of the rig, and one for each camera, NaN where it is missing."""

    profile: str
    ids: tuple[str, ...]
    times: tuple[datetime, ...]
    series: tuple[TrendSeries, ...]
    cameras: tuple[TrendSeries, ...]  # mm: rms shift of rays in the volume against the first one, of checks of a point
    kind: Literal["calibration", "check"] = "calibration"
    verdicts: tuple[str, ...] = ()  # of checks


def make_trend(profile: Profile) -> Trend:
    """The trend of all calibrations that are valid and can be read."""
    ids = tuple(key for key, entry in profile.entries.items() if entry.valid)
    if len(ids) < 2:
        raise InputError(Phrase("error-trend-calibrations", {"folder": profile.folder, "found": len(ids)}))
    entries = [profile.entries[key] for key in ids]
    first = profile.rig(ids[0])
    volume = entry_volume(entries[0]) or seen_volume(first)
    found = [compare(first, profile.rig(key), volume) for key in ids[1:]]
    free, metric = ([None, *(pair[i] for pair in found)] for i in (0, 1))
    bar = [np.nan if e.bar_mean_error_mm is None else e.bar_mean_error_mm for e in entries]
    series = (
        _series("largest change of a length", "mm", [abs(_number(c and c.length_mm)) for c in metric], 0.0),
        _series("largest shift of a point", "mm", [_number(c and c.point_mm) for c in free], 0.0),
        _series("scale", "ppm", [np.nan if c is None else c.scale_ppm for c in free]),
        _series("residuals", "px rms", [_number(e.rms_px) for e in entries], 0.0),
        _series("reference bars' mean error", "mm", bar),
        _series("temperature", "°C", [_number(e.temperature_c) for e in entries]),
    )
    known = tuple(one for one in series if np.isfinite(one.values).any())
    return Trend(profile.name, ids, tuple(e.calibrated_at for e in entries), known, _cameras(free))


def make_check_trend(profile: Profile) -> Trend:
    """The trend of the quick checks kept in the profile."""
    checks, _ = read_checks(profile.folder)
    if len(checks) < 2:
        raise InputError(Phrase("error-trend-checks", {"folder": profile.folder, "found": len(checks)}))
    largest = [max(one.point_mm.values(), default=np.nan) for one in checks]
    series = (
        _series("largest shift of a point by one camera", "mm", largest, 0.0),
        _series("residuals", "px rms", [_number(one.rms_px) for one in checks], 0.0),
        _series("ball's size", "ppm", [_number(one.scale_ppm) for one in checks]),
        _series("reference bars' mean error", "mm", [_number(one.bar_error_mm) for one in checks]),
        _series("temperature", "°C", [_number(one.temperature_c) for one in checks]),
    )
    names = sorted({name for one in checks for name in one.point_mm})
    cameras = tuple(_series(name, "mm", [one.point_mm.get(name, np.nan) for one in checks], 0.0) for name in names)
    return Trend(
        profile.name, tuple(str(i + 1) for i in range(len(checks))), tuple(one.at for one in checks),
        tuple(one for one in series if np.isfinite(one.values).any()), cameras, "check",
        tuple(one.verdict for one in checks),
    )  # fmt: skip


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def _series(name: str, unit: str, values: Sequence[float], least: float = -np.inf) -> TrendSeries:
    """A series whose values cannot be below `least`, nor its lower limit."""
    array = np.array(values, dtype=float)
    limits = control_limits(array)
    if limits is not None:
        limits = replace(limits, low=max(limits.low, least))
    return TrendSeries(name, unit, array, limits)


def control_limits(values: FloatArray) -> ControlLimits | None:
    """Median +- 3 sd, sd = median moving range / 0.954 (Wheeler), of values (n,); None for fewer than four."""
    finite = values[np.isfinite(values)]
    if len(finite) < _LEAST_VALUES:
        return None
    centre = float(np.median(finite))
    reach = _LIMIT_PER_RANGE * float(np.median(np.abs(np.diff(finite))))
    return ControlLimits(centre, centre - reach, centre + reach) if reach > 0 else None


def _cameras(comparisons: Sequence[Comparison | None]) -> tuple[TrendSeries, ...]:
    changes = [{} if c is None else {one.id: one.ray_rms_mm for one in c.cameras} for c in comparisons]
    names = sorted({name for found in changes for name in found})
    return tuple(_series(name, "mm", [found.get(name, np.nan) for found in changes], 0.0) for name in names)
