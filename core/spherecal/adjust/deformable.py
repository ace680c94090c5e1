"""The deformable ball: it keeps its shape but for shape noise, X = R_t S + T_t + e with e ~ N(0, tau^2) per coordinate.

It is between the free form (tau infinite) and the rigid one (tau 0). It is solved as the rigid form whose observations
of one dot at one placement have the dot's shape noise in common as an error (generalised least squares; A. C. Aitken,
1936): `deformable_kernel`. So no step depends on where the points are off the shape. Ties do not shrink the network,
whose size nothing else fixes.
"""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable
from spherecal.adjust.linear import Linear
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray, sum_by

# Below, the seven motions that no observation sees would wander; 1e-7 of a diagonal slows nothing else down.
LEAST_DAMPING = 1e-7


@dataclass(frozen=True)
class ShapeNoise:
    """The part of the observations that the shape noise absorbs at a linearisation, in the ball's frame.

    Group g are the observations of one dot at one placement: rows from `start[g]` (g + 1,) on. `of` (n,) is the group
    of each row, `place` (g,) its number among the places, `dot` and `placement` (g,) what it is. `normal` (g,3,3) is V,
    `q` = tau^2 (I + tau^2 V)^-1, `p` = I - Q V.
    """

    problem: Problem
    linear: Linear
    start: IntArray
    of: IntArray
    place: IntArray
    dot: IntArray
    placement: IntArray
    normal: FloatArray
    q: FloatArray
    p: FloatArray

    def pulled(self, residual: FloatArray) -> FloatArray:
        """J'r (g,3) of every group, from residuals (n,2)."""
        return _summed(np.einsum("nki,nk->ni", self.linear.at(slice(None)).by_point, residual), self.start)

    def taken(self, residual: FloatArray) -> float:
        """The reduction of the squares of residuals (n,2) by the shape noise: r'J Q J'r."""
        if not len(self.start):
            return 0.0
        b = self.pulled(residual)
        return float(np.einsum("gi,gij,gj->", b, self.q, b))

    def shape_residual(self, state: State) -> FloatArray:
        """Deviations (f,3) of the places from the shape, in the world; 0 where nothing is observed."""
        out = np.zeros((len(self.problem.ball.shape_sd), 3))
        off = np.einsum("gij,gj->gi", self.q, self.pulled(self.linear.residual))
        out[self.place] = -np.einsum("gij,gj->gi", state.placement_rotation[self.placement], off)
        return out


def shape_noise_of(problem: Problem, linear: Linear) -> ShapeNoise:
    """The shape noise of a deformable ball's places at a linearisation; no groups for any other ball."""
    if not isinstance(problem.ball, Deformable):
        none, matrices = np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3))
        return ShapeNoise(problem, linear, none, none, none, none, none, matrices, matrices, matrices)
    of_row = problem.ball.place
    is_first = (np.diff(of_row, prepend=-1) != 0) | (np.diff(problem.point, prepend=-1) != 0)
    first = np.flatnonzero(is_first)
    start = np.append(first, len(problem.uv))
    by_point = linear.at(slice(None)).by_point
    normal = _summed(np.einsum("nki,nkj->nij", by_point, by_point), start)
    group, place = np.cumsum(is_first) - 1, of_row[first]
    dot, placement = problem.point[first], problem.placement[first]
    q, p = shape_noise_matrices(normal, problem.ball.shape_sd[place])
    return ShapeNoise(problem, linear, start, group, place, dot, placement, normal, q, p)


def _summed(values: FloatArray, start: IntArray) -> FloatArray:
    """Sums (g, ...) of values (n, ...) over groups of rows."""
    return np.add.reduceat(values, start[:-1], axis=0) if len(values) else values[:0]


def shape_noise_matrices(normal: FloatArray, shape_sd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Q = tau^2 (I + tau^2 V)^-1 and I - Q V = (I + tau^2 V)^-1, (g,3,3) each; `shape_sd` is tau (g,)."""
    variance = (shape_sd**2)[:, None, None]
    p = np.linalg.inv(np.eye(3) + variance * normal)
    p = 0.5 * (p + p.transpose(0, 2, 1))
    return variance * p, p


def left_over(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """Residuals (n,2) that the shape noise leaves; how much of each observation's rows its own point absorbs (n,)."""
    linear = engine.linearise(problem, state, None)
    shape = shape_noise_of(problem, linear)
    off = np.einsum("gij,gj->gi", shape.q, shape.pulled(linear.residual))
    normal = sum_by(shape.dot, shape.p @ shape.normal, problem.n_points)
    noise = shape.q + shape.p @ np.linalg.pinv(normal, hermitian=True)[shape.dot] @ shape.p.transpose(0, 2, 1)
    taken = np.einsum("nki,nij,nkj->n", linear.by_point, noise[shape.of], linear.by_point)
    return linear.residual - np.einsum("nki,ni->nk", linear.by_point, off[shape.of]), taken
