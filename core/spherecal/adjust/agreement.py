"""Whether cameras agree on how the dots of a ball moved between placements, or only their lenses do not fit.

Where the rigid form fits worse than free points, either the ball changed its shape or the cameras err: a lens beyond
its model, a pose that drifts. Let r_i be the residual of view i of a dot at one placement in the rigid form, B_i its
derivatives by the dot and H_ij = B_i (B'B)^-1 B_j'. A place of its own for the dot there takes sum_ij r_i' H_ij r_j
off the squares. A dot that moved contributes to the terms i = j and to those between cameras; errors of single cameras
only to the former. The terms between cameras are therefore compared with their expectation for noise.
"""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust.bundle import Adjusted
from spherecal.adjust.levenberg import load_engine
from spherecal.arrays import FloatArray, IntArray

# The part on which cameras agree, over the noise's share of the squares. Of 13 realistic recordings with lenses beyond
# their model (ratio of the variances 1.08 to 1.59) at most 0.034; of balls bent by 0.01 to 0.2 mm on rigs A, B and two
# random ones 0.13 to 49 where the ratio was beyond its limit.
LEAST_AGREED = 0.08
SURE = 3.0
# Rays within this ratio of squared lengths (an angle of half a degree) do not locate a dot.
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


def agreement(rigid: Adjusted, feature: IntArray, free_variance: float) -> Agreement:
    """How far cameras agree on motions of dots; feature (n,) of all observations (placement, target, point).

    `free_variance`: variance of unit weight with free points. (0, inf) where no dot is seen at two placements.
    """
    problem = rigid.problem
    linear = load_engine("numba").linearise(problem, rigid.state, None)
    by_point, residual = linear.by_point, linear.residual
    group, own = np.unique(feature[rigid.rows], return_inverse=True)
    own = own.reshape(-1)
    square = np.einsum("nki,nkj->nij", by_point, by_point)
    force = np.einsum("nki,nk->ni", by_point, residual)
    total, whole = _summed(square, own, len(group)), _summed(square, problem.point, problem.n_points)
    point = np.zeros(len(group), dtype=np.int64)
    point[own] = problem.point
    places = np.bincount(point, minlength=problem.n_points)[point]
    size = np.linalg.eigvalsh(total)
    good = (places > 1) & (size[:, 0] > _LEAST_SHARE * size[:, 2])
    if not good.any():
        return Agreement(0.0, np.inf)
    inverse = np.zeros_like(total)
    inverse[good] = np.linalg.inv(total[good])
    of_dot = np.zeros_like(whole)
    of_dot[point[good]] = np.linalg.inv(whole[point[good]])

    gained = _quadratic(_summed(force, own, len(group)), inverse)
    alone = np.bincount(own, _quadratic(force, inverse[own]), len(group))
    # of noise: 3 per place of a dot, less what the dot itself takes up, and between cameras
    taken = np.einsum("uij,uji->u", of_dot[point], total)
    taken_alone = np.einsum("nij,njk,nkl,nli->n", inverse[own], square, of_dot[problem.point], square)
    between = np.bincount(own, taken_alone, len(group)) - taken
    noise = free_variance * (3 - taken)[good].sum()
    turned = np.einsum("nij,njk->nik", inverse[own], square)
    twice = np.bincount(own, np.einsum("nij,nji->n", turned, turned), len(group))
    scatter = free_variance * np.sqrt(2 * np.maximum(3 - twice, 0.0)[good].sum())
    if not noise > 0:
        return Agreement(0.0, np.inf)
    return Agreement(float(((gained - alone) - free_variance * between)[good].sum() / noise), float(scatter / noise))


def _summed(values: FloatArray, index: IntArray, count: int) -> FloatArray:
    """Sums (count, ...) of values (n, ...) by index (n,)."""
    out = np.zeros((count, *values.shape[1:]))
    np.add.at(out, index, values)
    return out


def _quadratic(vector: FloatArray, matrix: FloatArray) -> FloatArray:
    """v' M v, (n,)."""
    return np.einsum("ni,nij,nj->n", vector, matrix, vector)
