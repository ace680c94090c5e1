"""The reference for moves: how much the poses of a camera's images differ without any move.

Noise alone makes chi-square of them. A lens beyond the model, a point spread that is not Gaussian, or a ball that is
not quite still shifts every image of a camera a little. The smaller the part of the image that it shares with the
others, the larger that shift.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.special import chdtri

from spherecal.base.arrays import FloatArray

# Inflation counts as far as it is sure at this level, so that it is 1 with noise alone.
SURE = 0.05
# The median of n values is as sure as the mean of this share of them.
MEDIAN = 0.64
# A rig of which more cameras than this seem to have moved has another fault (lenses, the ball's shape).
MOST_MOVED_SHARE, MOST_MOVED = 0.15, 2
# What lenses do is not normal: a few images have most of it, so that the limit grows with the square. With smooth
# fields of 0.01 to 0.3 px and high radial orders (demo, rigs A and B) the largest statistic of a recording was up to 8
# times the mean of the inflated chi-square at an inflation of 2.3, and 24 times at 7.3 (dome15, one lens for all).
# Moves of 1 mm beside the fields reach 8 to 20 times: the larger ones alone are then found.
Scatter = tuple[float, int]  # chi-square of how much some images' poses differ, and its degrees of freedom


def inflation(own: Scatter, others: Sequence[Scatter]) -> float:
    """The scatter of images' poses over that of noise, at least 1; as large as that of the worst unmoved camera."""
    known = [one for one in others if one[1] > 0]
    if not known:
        return max(1.0, _at_least(own))
    moved = most_moved(len(known) + 1) - 1
    worst = sorted(_at_least(one) for one in known)[: max(len(known) - moved, 1)][-1]
    return max(1.0, _at_least(own), usual_inflation(known), worst)


def taken_up(force: FloatArray, matrix: FloatArray, size: FloatArray, least: float) -> Scatter:
    """What steps against forces (u,) take off a sum of squares, along axes of the matrix (u,u) with enough curvature.

    `size` (u,): units of the steps; `least`: curvature that counts in them.
    """
    values, axes = np.linalg.eigh(matrix * size[:, None] * size)
    good = values > least
    along = axes[:, good].T @ (force * size)
    return float((along**2 / values[good]).sum()), int(good.sum())


def most_moved(n_cameras: int) -> int:
    """The largest number of cameras that can be concluded to have moved."""
    return max(MOST_MOVED, int(MOST_MOVED_SHARE * n_cameras))


def usual_inflation(scatters: Sequence[Scatter]) -> float:
    """The scatter of the images' poses of most cameras over that of noise, as far as it is certain; 0 without any."""
    known = [one for one in scatters if one[1] > 0]
    if not known:
        return 0.0
    freedom = max(int(MEDIAN * sum(dof for _, dof in known)), 1)
    usual = float(np.median([statistic / dof for statistic, dof in known]))
    return _at_least((usual * freedom, freedom))


def _at_least(scatter: Scatter) -> float:
    statistic, dof = scatter
    return statistic / _sure_chi_square(dof) if dof > 0 else 0.0


@cache  # every camera asks for that of every other
def _sure_chi_square(dof: int) -> float:
    return float(chdtri(dof, SURE))


def raised(limit: float, scatter: float) -> float:
    """The statistic that a move must exceed where poses scatter more than noise explains."""
    return limit * scatter**2
