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
# Beyond these sizes the reduced unknowns are left out and only the points are eliminated again (tested columns by
# unknowns: 40 MB; observations by unknowns: 200 MB). The statistics then are too small, never too large, and the less
# so the more placements there are.
MOST_ENTRIES, MOST_NONZERO = 5_000_000, 15_000_000


Sparse: TypeAlias = Any  # scipy.sparse.csr_array, whose indexing its types do not tell


def _dense(matrix: Sparse) -> FloatArray:
    return np.asarray(matrix.toarray(), dtype=np.float64)


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
class Given:
    """Changes that are corrected for: sums of tested columns, `columns` (k,) and their coefficients `fold` (k,f)."""

    columns: IntArray
    fold: FloatArray

    @staticmethod
    def nothing() -> "Given":
        """No change at all."""
        return Given(np.zeros(0, dtype=np.int64), np.zeros((0, 0)))


@dataclass(frozen=True)
class Scores:
    """Tested columns: g (m,), their products before (`own` (m,m) sparse) and what the unknowns take from them.

    A = own - by_point V^-1 by_point' - by_column C by_column'.
    """

    g: FloatArray
    own: Sparse
    by_point: Sparse
    whitened_point: Sparse
    by_column: FloatArray | None
    carried: FloatArray | None

    def products(self, columns: IntArray) -> FloatArray:
        """The own products (k,k) of some columns."""
        return _dense(self.own[columns][:, columns])

    def matrix(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """A block of A, (k, l), by lists of columns."""
        out = _dense(self.own[rows][:, columns]) - _dense(self.by_point[rows] @ self.whitened_point[columns].T)
        if self.by_column is not None and self.carried is not None:
            out -= self.by_column[rows] @ self.carried[columns].T
        return out


@dataclass(frozen=True)
class Probe:
    """A solved network made ready for tests."""

    problem: Problem
    linear: Linearisation
    residual: FloatArray
    inverse: FloatArray
    by_column: Sparse | None
    by_point: Sparse
    point_inverse: Sparse
    cofactors_of_points: FloatArray
    squares: float
    redundancy: int

    @property
    def variance(self) -> float:
        """Variance of unit weight."""
        return self.squares / max(self.redundancy, 1)

    def scores(self, columns: Sparse) -> Scores:
        """The tests' pieces for derivatives of all rows by the tested changes, (2n, m)."""
        b: Sparse = sparse.csr_array(columns.T)
        by_point = sparse.csr_array(b @ self.by_point)
        by_column = carried = None
        if self.by_column is not None and b.shape[0] * self.inverse.shape[0] <= MOST_ENTRIES:
            by_column = (b @ self.by_column).toarray()
            carried = by_column @ self.inverse
        whitened = sparse.csr_array(by_point @ self.point_inverse)
        return Scores(
            b @ self.residual, sparse.csr_array(b @ columns), by_point, whitened, by_column, carried
        )  # fmt: skip

    def after(self, rows: IntArray, values: FloatArray, change: Change) -> "Probe":
        """The network with a change of some rows, derivatives (k,2,m), taken into its model."""
        step = np.zeros_like(self.residual)
        step[(2 * rows[:, None] + np.arange(2)).ravel()] = values.reshape(-1, values.shape[2]) @ change.value
        taken = self.by_point @ (self.point_inverse @ (self.by_point.T @ step))
        if self.by_column is not None:
            taken += self.by_column @ (self.inverse @ (self.by_column.T @ step))
        squares = self.squares - change.statistic * self.variance
        return replace(
            self, residual=self.residual + step - taken, squares=squares, redundancy=self.redundancy - change.dof
        )

    def block(self, rows: IntArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """g (m,), A (m,m) and own products (m,m) for derivatives (k,2,m) of some rows: many columns, few observations.

        The points of the rows must be eliminated ones, as all but those of known lengths are.
        """
        flat = values.reshape(-1, values.shape[2])
        both = (2 * rows[:, None] + np.arange(2)).ravel()
        own = flat.T @ flat
        a = own.copy()
        if self.by_column is not None:
            by_column = (self.by_column[both].T @ flat).T
            a -= by_column @ self.inverse @ by_column.T
        order = np.argsort(self.problem.point[rows], kind="stable")
        point = self.problem.point[rows][order]
        start = np.flatnonzero(np.diff(point, prepend=-1))
        each = np.einsum("kam,kab->kmb", values[order], self.linear.by_point[rows[order]])
        by_point = np.add.reduceat(each, start, axis=0)
        weighted = by_point @ self.cofactors_of_points[point[start]]
        columns = flat.shape[1]
        a -= weighted.transpose(1, 0, 2).reshape(columns, -1) @ by_point.transpose(1, 0, 2).reshape(columns, -1).T
        return flat.T @ self.residual[both], a, own

    def rows(self, values: FloatArray, column: IntArray, count: int) -> Sparse:
        """Derivatives (2n, count) from those of each observation, values (n,2,w), whose w columns begin at column (n,).

        Observations with column -1 have none.
        """
        use = np.flatnonzero(column >= 0)
        width = values.shape[2]
        row = np.broadcast_to(2 * use[:, None, None] + np.arange(2)[:, None], (len(use), 2, width))
        col = np.broadcast_to(column[use, None, None] + np.arange(width), (len(use), 2, width))
        shape = (2 * len(values), count)
        return sparse.csr_array((values[use].ravel(), (row.ravel(), col.ravel())), shape=shape)


def make_probe(problem: Problem, state: State, cofactors: Covariance, cost: float, redundancy: int) -> Probe:
    """A network at its minimum (of this `cost`, v'Pv / 2) made ready for tests."""
    linear = load_engine("numba").linearise(problem, state, None)
    inverse = cofactors._parts.inverse
    points = cofactors._parts.point_inverse
    n, p = len(problem.uv), problem.n_points
    by_point = _spread(linear.by_point, np.arange(n), 3 * problem.point, (2 * n, 3 * p))
    point_inverse = _spread(points, np.arange(p), 3 * np.arange(p), (3 * p, 3 * p))
    views = np.diff(problem.point_start)
    by_column = None
    if 2 * linear.by_camera.shape[2] * int((views**2).sum()) <= MOST_NONZERO:
        by_column = _by_column(problem, linear, cofactors, by_point)
    return Probe(
        problem, linear, linear.residual.ravel(), inverse, by_column, by_point, point_inverse, points,
        2 * cost, redundancy,
    )  # fmt: skip


def _by_column(problem: Problem, linear: Linearisation, cofactors: Covariance, by_point: Sparse) -> Sparse:
    """Derivatives of all rows by the expanded columns, the points following them, (2n, e)."""
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
    return sparse.csr_array(direct + by_point @ shift)


def _spread(blocks: FloatArray, row: IntArray, column: IntArray, shape: tuple[int, int]) -> Sparse:
    """A sparse matrix of blocks (n,a,b) at block row `row` (n,) (counted in blocks) and column `column` (n,)."""
    _, a, b = blocks.shape
    i = np.broadcast_to(a * row[:, None, None] + np.arange(a)[:, None], blocks.shape)
    j = np.broadcast_to(column[:, None, None] + np.arange(b), blocks.shape)
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
