"""Whether cameras agree on how the dots of a ball moved between placements, or only their lenses do not fit.

Where the rigid form fits worse than free points, either the ball changed its shape or the cameras err: a lens beyond
its model, a pose that drifts. Let r_i be the residual of view i of a dot at one placement in the rigid form, B_i its
derivatives by the dot and H_ij = B_i (B'B)^-1 B_j'. A separate place for the dot there reduces the sum of squares by
sum_ij r_i' H_ij r_j. A dot that moved contributes to the terms i = j and to those between cameras; errors of single
cameras contribute only to the former. The terms between cameras are therefore compared with their expectation for
noise. See docs/decisions/0011-ball-or-lenses.md.
"""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.bundle import Adjustment
from spherecal.base.arrays import FloatArray, IntArray, blocks_of_groups, sum_by

# The part on which cameras agree, over the noise's share of the squares. Of balls bent by 0.05 to 0.2 mm on rigs A, B
# and random ones 0.52 to 49 (by 0.01 to 0.03 mm 0.05 to 0.4: lengths are then as good in either form). Of 112 realistic
# recordings with lenses beyond their model 299 are below: the adjustment spreads their errors over poses and shape.
LEAST_AGREED = 0.4
SURE = 3.0
# Least over greatest eigenvalue of a dot's B'B: rays that cross at less than about half a degree do not locate it.
_LEAST_SHARE = 1e-4


@dataclass(frozen=True)
class Agreement:
    """The part of the excess that cameras agree on, in units of the noise's share, and its standard uncertainty."""

    value: float
    sd: float

    @property
    def is_certain(self) -> bool:
        """Whether the dots moved."""
        return self.value > max(LEAST_AGREED, SURE * self.sd)


def agreement(rigid: Adjustment, feature: IntArray, free_variance: float) -> Agreement:
    """How far cameras agree on motions of dots; (0, inf) where no dot is seen at two placements."""
    problem = rigid.problem
    feature = feature[rigid.rows]
    sums = np.zeros(4)
    for first, last in blocks_of_groups(problem.point_start):
        rows = slice(int(problem.point_start[first]), int(problem.point_start[last]))
        linear = engine.linearise(problem.select(rows), rigid.state, None)
        sums += _terms(linear.by_point, linear.residual, problem.point[rows] - first, feature[rows])
    agreed, between, own, scatter = sums
    if not own > 0:
        return Agreement(0.0, np.inf)
    noise = free_variance * own
    return Agreement(float((agreed - free_variance * between) / noise), float(np.sqrt(2 * scatter) / own))


def _terms(by_point: FloatArray, residual: FloatArray, point: IntArray, feature: IntArray) -> FloatArray:
    """Sums over the places of dots: terms between cameras, and of unit noise their sum, own share, half scatter."""
    group, at = np.unique(feature, return_inverse=True)
    at = at.reshape(-1)
    n_points = int(point.max(initial=-1)) + 1
    square = np.einsum("nki,nkj->nij", by_point, by_point)
    force = np.einsum("nki,nk->ni", by_point, residual)
    here, everywhere = sum_by(at, square, len(group)), sum_by(point, square, n_points)
    dot = np.zeros(len(group), dtype=np.int64)
    dot[at] = point
    size = np.linalg.eigvalsh(here)
    good = (np.bincount(dot, minlength=n_points)[dot] > 1) & (size[:, 0] > _LEAST_SHARE * size[:, 2])
    inverse, of_dot = np.zeros_like(here), np.zeros_like(everywhere)
    inverse[good] = np.linalg.inv(here[good])
    of_dot[dot[good]] = np.linalg.inv(everywhere[dot[good]])

    gained = _quadratic(sum_by(at, force, len(group)), inverse)
    alone = np.bincount(at, _quadratic(force, inverse[at]), len(group))
    # a place takes up 3 of the noise, less what the dot itself does; of that a part lies between cameras
    taken = np.einsum("uij,uji->u", of_dot[dot], here)
    taken_alone = np.einsum("nij,njk,nkl,nli->n", inverse[at], square, of_dot[point], square)
    between = np.bincount(at, taken_alone, len(group)) - taken
    turned = np.einsum("nij,njk->nik", inverse[at], square)
    scatter = 3 - np.bincount(at, np.einsum("nij,nji->n", turned, turned), len(group))
    terms = gained - alone, between, 3 - taken, np.maximum(scatter, 0.0)
    return np.array([term[good].sum() for term in terms])


def _quadratic(vector: FloatArray, matrix: FloatArray) -> FloatArray:
    """v' M v, (n,)."""
    return np.einsum("ni,nij,nj->n", vector, matrix, vector)
