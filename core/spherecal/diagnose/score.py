"""Changes that the model of the network does not have, tested without solving it again.

A change with derivatives B (rows, m) of the observations improves the fit by g'A^-1 g, where g = B'r and A = B'Q B with
Q = I - J (J'J)^- J' the projection past everything that is estimated already: Rao's score test (C. R. Rao, 1948), for
linear models the same as Baarda's test of outliers in several dimensions (W. Baarda, A testing procedure for use in
geodetic networks, 1968). Divided by the variance of unit weight it is chi-square distributed with m degrees of freedom
where there is no such change; the change itself is -A^-1 g.
"""

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from scipy import sparse
from scipy.stats import chi2

from spherecal.adjust.covariance import Covariance
from spherecal.adjust.engine_numpy import Linearisation
from spherecal.adjust.levenberg import load_engine
from spherecal.adjust.problem import POSE, Problem, State
from spherecal.arrays import FloatArray, IntArray

# A change of which less than this share is left once the estimated unknowns have taken theirs is one of them. Fields of
# lenses have shares below 2e-4 or above 2e-3; what a minimiser leaves of the gradient would tell in the former.
LEAST_SHARE = 5e-4
# Beyond this size (400 MB) the reduced unknowns are left out and only the points are eliminated again. The statistics
# then are too small, never too large, and the less so the more placements there are.
MOST_NONZERO = 30_000_000


Sparse: TypeAlias = Any  # scipy.sparse.csr_array, whose indexing its types do not tell


@dataclass(frozen=True)
class Change:
    """A tested change: chi-square `statistic` on `dof` degrees of freedom, best `value` (m,), explained squares."""

    statistic: float
    dof: int
    value: FloatArray

    @property
    def log10_p(self) -> float:
        """The decimal logarithm of the probability of such a statistic without any change."""
        return float(chi2.logsf(self.statistic, self.dof) / np.log(10)) if self.dof else 0.0


@dataclass(frozen=True)
class Probe:
    """A solved network made ready for tests.

    Its derivatives by the expanded columns, the points following, are `direct` (2n, e) + `by_point` (2n, 3p) @ `shift`
    (3p, e); the product itself would take several times the memory. None where they are left out.
    """

    problem: Problem
    linear: Linearisation
    residual: FloatArray
    inverse: FloatArray
    direct: Sparse | None
    shift: Sparse | None
    by_point: Sparse
    point_inverse: Sparse
    cofactors_of_points: FloatArray
    squares: float
    redundancy: int

    @property
    def variance(self) -> float:
        """Variance of unit weight."""
        return self.squares / max(self.redundancy, 1)

    def past_unknowns(self, columns: FloatArray) -> FloatArray:
        """What the estimated unknowns leave of columns (2n,m) by all rows."""
        left = columns - self.by_point @ (self.point_inverse @ (self.by_point.T @ columns))
        if self.direct is not None and self.shift is not None:
            force = self.direct.T @ columns + self.shift.T @ (self.by_point.T @ columns)
            step = self.inverse @ force
            left -= self.direct @ step + self.by_point @ (self.shift @ step)
        return left

    def after(self, rows: IntArray, values: FloatArray, change: Change) -> "Probe":
        """The network with a change of some rows, derivatives (k,2,m), taken into its model."""
        step = np.zeros_like(self.residual)
        step[(2 * rows[:, None] + np.arange(2)).ravel()] = values.reshape(-1, values.shape[2]) @ change.value
        squares, residual = self.squares - change.statistic * self.variance, self.residual + self.past_unknowns(step)
        return replace(self, residual=residual, squares=squares, redundancy=self.redundancy - change.dof)

    def block(self, rows: IntArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """g (m,), A (m,m) and own products (m,m) for derivatives (k,2,m) of some rows: many columns, few observations.

        The points of the rows must be eliminated ones, as all but those of known lengths are.
        """
        flat = values.reshape(-1, values.shape[2])
        both = (2 * rows[:, None] + np.arange(2)).ravel()
        own = flat.T @ flat
        a = own.copy()
        order = np.argsort(self.problem.point[rows], kind="stable")
        point = self.problem.point[rows][order]
        start = np.flatnonzero(np.diff(point, prepend=-1))
        each = np.einsum("kam,kab->kmb", values[order], self.linear.by_point[rows[order]])
        by_point = np.add.reduceat(each, start, axis=0)
        weighted = by_point @ self.cofactors_of_points[point[start]]
        columns = flat.shape[1]
        if self.direct is not None and self.shift is not None:
            following = (3 * point[start][:, None] + np.arange(3)).ravel()
            force = self.direct[both].T @ flat
            force += self.shift[following].T @ by_point.transpose(0, 2, 1).reshape(-1, columns)
            a -= force.T @ self.inverse @ force
        a -= weighted.transpose(1, 0, 2).reshape(columns, -1) @ by_point.transpose(1, 0, 2).reshape(columns, -1).T
        return flat.T @ self.residual[both], a, own


def make_probe(problem: Problem, state: State, cofactors: Covariance, cost: float, redundancy: int) -> Probe:
    """A network at its minimum (of this `cost`, v'Pv / 2) made ready for tests."""
    linear = load_engine("numba").linearise(problem, state, None)
    inverse = cofactors._parts.inverse
    points = cofactors._parts.point_inverse
    n, p = len(problem.uv), problem.n_points
    by_point = _spread(linear.by_point, np.arange(n), 3 * problem.point, (2 * n, 3 * p))
    point_inverse = _spread(points, np.arange(p), 3 * np.arange(p), (3 * p, 3 * p))
    direct, shift = None, None
    if 5 * linear.by_camera.shape[2] * n <= MOST_NONZERO:
        direct, shift = _by_column(problem, linear, cofactors)
    return Probe(
        problem, linear, linear.residual.ravel(), inverse, direct, shift, by_point, point_inverse, points, 2 * cost,
        redundancy,
    )  # fmt: skip


def _by_column(problem: Problem, linear: Linearisation, cofactors: Covariance) -> tuple[Sparse, Sparse]:
    """Derivatives by the expanded columns of all rows (2n, e), and of the points that follow them (3p, e)."""
    parts, n, p = cofactors._parts, len(problem.uv), problem.n_points
    width = linear.by_camera.shape[2]
    direct = _spread(linear.by_camera, np.arange(n), width * problem.camera, (2 * n, problem.layout.expanded))
    shift = _spread(parts.by_camera, problem.point, width * problem.camera, (3 * p, problem.layout.expanded))
    if problem.placement is not None and linear.by_placement is not None and parts.by_placement is not None:
        first = width * problem.n_cameras + POSE * problem.placement
        direct += _spread(linear.by_placement, np.arange(n), first, direct.shape)
        shift += _spread(parts.by_placement, problem.point, first, shift.shape)
    kept = problem.kept_points
    if len(kept):  # points of known lengths are among the columns
        first = problem.layout.expanded - 3 * len(kept) + 3 * np.arange(len(kept))
        shift += _spread(np.tile(np.eye(3), (len(kept), 1, 1)), kept, first, shift.shape)
    return sparse.csr_array(direct), sparse.csr_array(shift)


def _spread(blocks: FloatArray, row: IntArray, column: IntArray, shape: tuple[int, int]) -> Sparse:
    """A sparse matrix of blocks (n,a,b) at block row `row` (n,) (counted in blocks) and column `column` (n,)."""
    _, a, b = blocks.shape
    rows, columns = row.astype(np.int32), column.astype(np.int32)  # half the memory of the indices
    i = np.broadcast_to(a * rows[:, None, None] + np.arange(a, dtype=np.int32)[:, None], blocks.shape)
    j = np.broadcast_to(columns[:, None, None] + np.arange(b, dtype=np.int32), blocks.shape)
    return sparse.csr_array((blocks.ravel(), (i.ravel(), j.ravel())), shape=shape)


def conditional(
    g: FloatArray, a: FloatArray, own: FloatArray, given: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """g, A and own products of the other columns once the `given` ones (k,) are corrected for."""
    rest = np.setdiff1d(np.arange(len(g)), given)
    scale = np.sqrt(np.maximum(own.diagonal(), 1e-300))
    inner = a[np.ix_(given, given)] / scale[given, None] / scale[given]
    inverse = np.linalg.pinv(inner, rcond=LEAST_SHARE, hermitian=True) / scale[given, None] / scale[given]
    taken = a[np.ix_(rest, given)] @ inverse
    return g[rest] - taken @ g[given], a[np.ix_(rest, rest)] - taken @ a[np.ix_(given, rest)], own[np.ix_(rest, rest)]


def settle(g: FloatArray, a: FloatArray, own: FloatArray, variance: float) -> Change:
    """The test of one change from g (m,), A (m,m) and the columns' own products (m,m)."""
    statistic, dof, value = settle_all(g[None], a[None], own[None], variance)
    return Change(float(statistic[0]), int(dof[0]), value[0])


def settle_all(
    g: FloatArray, a: FloatArray, own: FloatArray, variance: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Statistics (k,), degrees of freedom (k,) and changes (k,m) of many tests at once: g (k,m), A and own (k,m,m)."""
    scale = np.sqrt(np.maximum(np.einsum("kii->ki", own), 1e-300))
    own = own / scale[:, :, None] / scale[:, None, :] + 1e-12 * np.eye(own.shape[1])
    a = a / scale[:, :, None] / scale[:, None, :]
    lower = np.linalg.inv(np.linalg.cholesky(own))
    share, axes = np.linalg.eigh(lower @ a @ lower.transpose(0, 2, 1))
    good = share > LEAST_SHARE
    along = np.einsum("kij,ki->kj", lower.transpose(0, 2, 1) @ axes, g / scale)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.where(good, along / share, 0.0)
    value = -np.einsum("kij,kj->ki", lower.transpose(0, 2, 1) @ axes, found) / scale
    return (found * np.where(good, along, 0.0)).sum(axis=1) / variance, good.sum(axis=1), value
