"""A waved bar whose length changes from a frame on: a mark that came loose."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import rankdata

from spherecal.adjust.bundle import usable_features
from spherecal.adjust.network import Network
from spherecal.base.arrays import FloatArray
from spherecal.data.findings import Finding
from spherecal_boards.bar_adjustment import BarAdjusted
from spherecal_boards.bar_marks import BarRecording

# Ranks of lengths before and after differ by so many standard deviations, and their medians by so many times what the
# lengths scatter. Marks loose by 0.1, 0.5 and 3 mm: 10 to 13, and 6 to 13 times; clean recordings, moved cameras,
# drops on lenses, skewed pixels and drift: at most 5.0, and 0.7 times.
LEAST_RANKS, LEAST_STEP = 6.0, 3.0
# A loose mark of 0.5 mm on 300 left lengths 4.5 U off. Below this share the scale's uncertainty holds the change.
MOST_STEP = 1e-3
# A step has so many lengths, and this share of all, on either side.
LEAST_LENGTHS, LEAST_SHARE = 8, 0.05


@dataclass(frozen=True)
class BarStep:
    """From a pose on the bar is longer by `change_mm`; `relative` to its length, `times` what the lengths scatter."""

    pose: str
    change_mm: float
    relative: float
    times: float

    @property
    def is_large(self) -> bool:
        """Whether no uncertainty of the scale holds it."""
        return self.relative > MOST_STEP

    def finding(self, bar: str) -> Finding:
        """What a calibration says of it."""
        values = {"place": self.pose, "worst_mm": self.change_mm, "times": self.times}
        severity = "error" if self.is_large else "warning"
        return Finding("bar-poses-disagree", severity, values, (bar, self.pose), kind="from-a-frame")


def bar_step(network: Network, recording: BarRecording, adjusted: BarAdjusted) -> BarStep | None:
    """The clearest change of a bar's length during the recording; None without one."""
    lengths = adjusted.model.lengths
    # as the cameras see them: marks triangulated without the certificates that tie them
    points, good = usable_features(network, adjusted.state, adjusted.used)
    seen = replace(adjusted.state, points=np.where(good[:, None], points, np.nan))
    off = np.linalg.norm(adjusted.model.differences(seen), axis=1) - lengths.length
    found = []
    for number in np.unique(lengths.certificate):
        own = np.flatnonzero((lengths.certificate == number) & np.isfinite(off))
        step = _clearest(off[own])
        if step is not None:
            first, change, times = step
            row = own[first]
            pose = recording.observations.placements[int(recording.pose[lengths.frame[row]])]
            found.append(BarStep(pose, change, abs(change) / float(lengths.length[row]), times))
    return max(found, key=lambda step: step.times, default=None)


def _clearest(off: FloatArray) -> tuple[int, float, float] | None:
    """Where lengths (n,) in order of time change most: the first after it, by how much, and how clearly.

    By ranks, since frames far from the cameras scatter much more than others.
    """
    n, least = len(off), max(LEAST_LENGTHS, round(LEAST_SHARE * len(off)))
    if n < 2 * least:
        return None
    first = np.arange(least, n - least + 1)
    before = np.cumsum(rankdata(off))[first - 1]
    ranks = np.abs(before - first * (n + 1) / 2) / np.sqrt(first * (n - first) * (n + 1) / 12)
    best = int(np.argmax(ranks))
    at = int(first[best])
    one, other = (float(np.median(part)) for part in (off[:at], off[at:]))
    scatter = 1.4826 * float(np.median(np.abs(np.concatenate([off[:at] - one, off[at:] - other]))))
    if ranks[best] < LEAST_RANKS or abs(other - one) < LEAST_STEP * scatter:
        return None
    return at, other - one, abs(other - one) / max(scatter, 1e-9)
