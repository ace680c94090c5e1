"""A waved bar whose length changes from a frame on: a mark that came loose."""

from dataclasses import replace

import numpy as np
from scipy.stats import rankdata

from spherecal.adjust.bundle import usable_features
from spherecal.base.arrays import FloatArray
from spherecal.data.findings import Finding
from spherecal_boards.bar_adjustment import BarAdjusted, BarNetwork, located
from spherecal_boards.bar_marks import known_lengths

# Ranks of lengths before and after differ by so many standard deviations, and their medians by so many times what the
# lengths scatter. Of 70 recordings on two rigs A and two B, marks loose by 0.06 to 1 mm had 9 to 13, and 4.6 to 26
# times (one of 1 mm was left out as wrong instead, and the rig not valid), those loose by 0.03 mm 2.5 to 4.9 times;
# clean ones, moves, drift, drops on lenses, skew and focus at most 8.6, and 1.4 times. A bar that a hand warms changes
# slowly: by 500 ppm, lengths were 3.5 U off where the scale did not hold that.
LEAST_RANKS, LEAST_STEP = 6.0, 3.0
# A loose mark of 0.5 mm on 300 left lengths 4.5 U off. Below this share the scale's uncertainty holds the change.
MOST_STEP = 1e-3
# A step has so many lengths, and this share of all, on either side.
LEAST_LENGTHS, LEAST_SHARE = 8, 0.05


def bar_step(work: BarNetwork, adjusted: BarAdjusted) -> tuple[Finding, float] | None:
    """The finding on the clearest change of a length during the recording, and the change over the length."""
    network, recording = work.network, work.recording
    lengths = known_lengths(work.session, recording, np.ones(recording.n_points, dtype=bool))
    points, good = usable_features(network, adjusted.state, adjusted.used)  # not held by the certificates
    seen = replace(adjusted.state, points=np.where(good[:, None], points, np.nan))
    # marks that were left out, since with them the bar is too long, where cameras agree: of rig B's, that two or three
    # see, hardly any was left after one was loose by 1 mm
    seen = located(network, seen, work.placed, adjusted.used)
    off = np.linalg.norm(replace(adjusted.model, lengths=lengths).differences(seen), axis=1) - lengths.length
    steps = []
    for number in np.unique(lengths.certificate):
        own = np.flatnonzero((lengths.certificate == number) & np.isfinite(off))
        if (step := _clearest(off[own])) is not None:
            steps.append((step[2], step[1], int(own[step[0]])))
    if not steps:
        return None
    times, change, row = max(steps, key=lambda step: step[0])
    relative = abs(change) / float(lengths.length[row])
    if times < LEAST_STEP:
        values = {"worst_mm": 2 * change, "times": times}  # from end to end, where halves differ by half of it
        return Finding("bar-poses-disagree", "info", values, (recording.bar.id,), kind="slowly"), 2 * relative
    pose = recording.observations.placements[int(recording.pose[lengths.frame[row]])]
    severity, values = "error" if relative > MOST_STEP else "warning", {"worst_mm": change, "times": times}
    where = (recording.bar.id, pose)
    return Finding("bar-poses-disagree", severity, {"place": pose, **values}, where, kind="from-a-frame"), relative


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
    at = int(first[np.argmax(ranks)])
    one, change = float(np.median(off[:at])), float(np.median(off[at:]) - np.median(off[:at]))
    scatter = 1.4826 * float(np.median(np.abs(off - one - np.where(np.arange(n) < at, 0.0, change))))
    if ranks.max() < LEAST_RANKS:
        return None
    return at, change, abs(change) / max(scatter, 1e-9)
