"""Images named by the time at which they were taken: those of one moment have no common name."""

import re
from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal_app.recordings.video_frames import common_moments

# Digits of a time since 1970 by its unit: seconds until 2286, and so on.
_NANOSECONDS = {10: 10**9, 13: 10**6, 16: 10**3, 19: 1}
_DATE = re.compile(r"(?:19|20)\d{12}(\d*)")


def grouped_by_time(names: Mapping[str, list[str]]) -> tuple[IntArray, str] | None:
    """Which of each camera's ascending names are of one moment, (moments, cameras), and how: by time, else by order."""
    times = [[_nanoseconds(name) for name in own] for own in names.values()]
    known = [[time for time in own if time is not None] for own in times]
    if known != times:
        return None
    origin = min(time for own in known for time in own)
    seconds = [1e-9 * np.array([time - origin for time in own]) for own in known]
    counts = {len(own) for own in seconds}
    moments = common_moments(seconds) if min(counts) > 1 else np.zeros((0, len(seconds)), dtype=np.int64)
    how = "by nearest time"
    if not len(moments) and len(counts) == 1:
        moments, how = np.tile(np.arange(counts.pop())[:, None], len(seconds)), "by order, since their clocks differ"
    if not len(moments):
        return None
    return moments, f"images put together {how}: those of a moment are up to {_gap(seconds, moments)} apart"


def _gap(seconds: list[FloatArray], moments: IntArray) -> str:
    taken = np.array([own[rows] for own, rows in zip(seconds, moments.T, strict=True)])
    gap = float(np.ptp(taken, axis=0).max())
    unit, size = next(((u, s) for u, s in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)) if gap >= s), ("ns", 1e-9))
    return f"{gap / size:.3g} {unit}"


def _nanoseconds(name: str) -> int | None:
    """The time of a name: a count since 1970, or a date with its time of day."""
    digits = re.sub(r"[-_.:T ]", "", name)
    if not digits.isdecimal():
        return None
    if (date := _DATE.fullmatch(digits)) is not None:
        try:
            moment = datetime.strptime(digits[:14], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
        except ValueError:
            return None
        return int(moment.timestamp()) * 10**9 + int(f"{date[1]:0<9}"[:9])
    return int(digits) * _NANOSECONDS[len(digits)] if len(digits) in _NANOSECONDS else None
