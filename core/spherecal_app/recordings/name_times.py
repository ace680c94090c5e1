"""Images named by the time at which they were taken: those of one moment have no common name."""

import re
from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal_app.recordings.video_frames import common_moments

# Digits of a time since 1970 by its unit: seconds until 2286, and so on.
_PER_SECOND = {10: 1.0, 13: 1e3, 16: 1e6, 19: 1e9}
_DATE = re.compile(r"(?:19|20)\d{12}(\d*)")


def grouped_by_time(names: Mapping[str, list[str]]) -> tuple[IntArray, str] | None:
    """Which names of each camera are of one moment, (moments, cameras), and how that was decided in words.

    By nearest time, where the cameras' clocks agree; else by order, where all have as many. None where the names are
    not times, or neither can be done.

    `names`: of each camera, ascending.
    """
    times = {camera: [_seconds(name) for name in own] for camera, own in names.items()}
    if any(time is None for own in times.values() for time in own):
        return None
    origin = min(time for own in times.values() for time in own if time is not None)
    seconds = [np.array(own, dtype=float) - float(origin) for own in times.values()]
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
    return f"{1e3 * gap:.3g} ms" if gap < 1 else f"{gap:.3g} s"


def _seconds(name: str) -> float | None:
    """The time of a name in seconds: a count since 1970, or a date with its time of day."""
    digits = re.sub(r"[-_.:T ]", "", name)
    if not digits.isdecimal():
        return None
    if (date := _DATE.fullmatch(digits)) is not None:
        try:
            moment = datetime.strptime(digits[:14], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
        except ValueError:
            return None
        return moment.timestamp() + (float(f"0.{date[1]}") if date[1] else 0.0)
    return int(digits) / _PER_SECOND[len(digits)] if len(digits) in _PER_SECOND else None
