"""Changes that the model of the network does not contain, tested without solving it again.

A change with derivatives B (rows, m) of the observations improves the fit by g'A^-1 g, where g = B'r and A = B'Q B.
Q = I - J (J'J)^- J' is the projection past everything that is estimated already. This is Rao's score test (C. R. Rao,
1948). For linear models it is the same as Baarda's test of outliers in several dimensions (W. Baarda, A testing
procedure for use in geodetic networks, 1968). Divided by the variance of unit weight it is chi-square distributed with
m degrees of freedom where there is no such change; the change itself is -A^-1 g.
"""

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.polynomial.legendre import legvander2d
from scipy import sparse
from scipy.special import chdtrc, chdtri

from spherecal.adjust import engine
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.linear import Linear, Linearisation
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.point_factors import PointFactors
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray, blocks
from spherecal.base.context import Context

# A change of which less than this share is left once the estimated unknowns have taken theirs is one of them. Fields of
# lenses have shares below 2e-4 or above 2e-3; what a minimiser leaves of the gradient would show in the former.
LEAST_SHARE = 5e-4
# Beyond this number of derivatives by the reduced unknowns (220 MB of those that points follow) these are left out, and
# only the points are eliminated again. The statistics then are too small, never too large, and the less so the more
# placements there are.
MOST_NONZERO = 30_000_000
# A matrix with more of its numbers than this is multiplied as a full array. In the rigid form dots are seen from nearly
# everywhere.
FULL = 0.25


Sparse: TypeAlias = Any  # scipy.sparse.csr_array, whose indexing its types do not describe


@dataclass(frozen=True)
class Change:
    """A tested change: chi-square `statistic` on `dof` degrees of freedom, and the best `value` (m,)."""

    statistic: float
    dof: int
    value: FloatArray

    @property
    def log10_p(self) -> float:
        """The decimal logarithm of the probability of such a statistic without any change."""
        if not self.dof:
            return 0.0
        with np.errstate(divide="ignore"):  # beyond a statistic of some 1,500 the probability is no float: -inf
            return float(np.log(chdtrc(self.dof, self.statistic)) / np.log(10))


@dataclass(frozen=True)
class ScoreTest:
    """A solved network, prepared for tests.

    Its derivatives are taken by the expanded columns, the points following. They are those of the rows themselves plus
    those by their points times `shift` (q*p, e), None where the reduced unknowns are left out. All but `shift` is
    computed for the rows that are asked for.

    `residual` (2n,) is weighted, `inverse` (e,e) holds the cofactors of the expanded columns, `cofactors_of_points`
    (p,q,q) those of each point alone. `squares` is v'Pv. A point is what its rows alone depend on: three coordinates,
    or a frame of another method (`by_own`).
    """

    problem: Problem
    linear: Linear
    residual: FloatArray
    inverse: FloatArray
    shift: Sparse | None
    cofactors_of_points: FloatArray
    squares: float
    redundancy: int

    @property
    def variance(self) -> float:
        """Variance of unit weight."""
        return self.squares / max(self.redundancy, 1)

    def by_pose(self, rows: IntArray | None = None) -> FloatArray:
        """Derivatives (k,2,6) of some rows, or of all, by their cameras' poses."""
        every = np.arange(len(self.problem.uv)) if rows is None else rows
        out = np.empty((len(every), 2, POSE))
        for some in blocks(len(every)):
            out[some] = self.linear.at(every[some]).by_camera[:, :, :POSE]
        return out

    def past_unknowns(self, columns: FloatArray) -> FloatArray:
        """Columns (2n,m), or one column (2n,), of all rows, projected past the estimated unknowns."""
        (p, q, _), more = self.cofactors_of_points.shape, columns.shape[1:]
        n = len(self.problem.uv)
        pulled, force = np.zeros((q * p, *more)), np.zeros((self.problem.layout.expanded, *more))
        for some in blocks(n):
            both = slice(2 * some.start, 2 * some.stop)
            linear = self.linear.at(some)
            pulled += self._by_point(linear, some).T @ columns[both]
            if self.shift is not None:
                force += self._direct(linear, some).T @ columns[both]
        following = spread(self.cofactors_of_points, q * np.arange(p), (q * p, q * p)) @ pulled
        step = None if self.shift is None else self.inverse @ (force + self.shift.T @ pulled)
        moved = None if self.shift is None else self.shift @ step
        left = np.empty_like(columns)
        for some in blocks(n):
            both = slice(2 * some.start, 2 * some.stop)
            linear = self.linear.at(some)
            by_point = self._by_point(linear, some)
            left[both] = columns[both] - by_point @ following
            if step is not None:
                left[both] -= self._direct(linear, some) @ step + by_point @ moved
        return left

    def by_own(self, linear: Linearisation, rows: slice | IntArray) -> tuple[FloatArray, IntArray]:
        """Derivatives (k,2,q) of some rows by the unknowns of their points, and these points (k,)."""
        return linear.by_point, self.problem.point[rows]

    def _by_point(self, linear: Linearisation, rows: slice | IntArray) -> Sparse:
        """Derivatives (2k, q*p) of some rows by the points."""
        p, q, _ = self.cofactors_of_points.shape
        values, point = self.by_own(linear, rows)
        return spread(values, q * point, (2 * len(values), q * p))

    def _direct(self, linear: Linearisation, rows: slice | IntArray) -> Sparse:
        """Derivatives (2k, e) of some rows by the expanded columns."""
        problem, count, width = self.problem, len(linear.residual), linear.width
        shape = (2 * count, problem.layout.expanded)
        if not problem.n_placements:
            return spread(linear.by_camera, width * problem.camera[rows], shape)
        first = width * problem.n_cameras + POSE * problem.placement[rows]
        of_camera = (width * problem.camera[rows])[:, None] + np.arange(width)
        columns = np.concatenate([of_camera, first[:, None] + np.arange(POSE)], axis=1)
        return _of_rows(np.concatenate([linear.by_camera, linear.by_placement], axis=2), columns, shape)

    def forces(self, rows: IntArray, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Scores of k sets of residuals (2m,k) of rows (m,): by columns (k,e), by points (k,3p). Needs `shift`."""
        assert self.shift is not None
        linear, q = self.linear.at(rows), self.cofactors_of_points.shape[1]
        by_points = self._by_point(linear, rows).T @ residuals
        following = (q * np.unique(self.by_own(linear, rows)[1])[:, None] + np.arange(q)).ravel()
        force = self._direct(linear, rows).T @ residuals + self.shift[following].T @ by_points[following]
        return force.T, by_points.T

    def after(self, rows: IntArray, values: FloatArray, change: Change) -> "ScoreTest":
        """The network with a change (values) of some rows included in its model."""
        step = np.zeros_like(self.residual)
        step[(2 * rows[:, None] + np.arange(2)).ravel()] = values.reshape(-1, values.shape[2]) @ change.value
        squares, residual = self.squares - change.statistic * self.variance, self.residual + self.past_unknowns(step)
        return replace(self, residual=residual, squares=squares, redundancy=self.redundancy - change.dof)

    def block(self, rows: IntArray, values: FloatArray | Sparse) -> tuple[FloatArray, FloatArray, FloatArray]:
        """g (m,), A (m,m), B'B (m,m) of a change with weighted derivatives B of rows (k,): (k,2,m) or sparse (2k,m)."""
        flat = values if sparse.issparse(values) else values.reshape(-1, values.shape[2])
        both = (2 * rows[:, None] + np.arange(2)).ravel()
        own = _full(flat.T @ flat)
        parts = [self._pulled(rows[some], flat[2 * some.start : 2 * some.stop]) for some in blocks(max(len(rows), 1))]
        point, by_point, force = self._sum(parts) if len(parts) > 1 else parts[0]
        weighted = self.cofactors_of_points[point] @ by_point.reshape(len(point), -1, by_point.shape[1])
        a = own - by_point.T @ weighted.reshape(by_point.shape)
        if self.shift is not None:
            a -= force.T @ self.inverse @ force
        return flat.T @ self.residual[both], a, own

    def _pulled(self, rows: IntArray, flat: FloatArray | Sparse) -> tuple[IntArray, FloatArray, FloatArray]:
        """Of columns (2k,m) of some rows (k,): points (c,), what pulls these (q*c,m), and the other unknowns (e,m)."""
        linear, q = self.linear.at(rows), self.cofactors_of_points.shape[1]
        by_own, of_row = self.by_own(linear, rows)
        point, local = np.unique(of_row, return_inverse=True)
        by_point = _full(spread(by_own, q * local, (2 * len(rows), q * len(point))).T @ flat)
        if self.shift is None:
            return point, by_point, np.zeros((0, 0))
        following = (q * point[:, None] + np.arange(q)).ravel()
        force = _full(self._direct(linear, rows).T @ flat) + _fast(self.shift[following]).T @ by_point
        return point, by_point, force

    def _sum(self, parts: list[tuple[IntArray, FloatArray, FloatArray]]) -> tuple[IntArray, FloatArray, FloatArray]:
        """All parts together: of a million rows at once they took 400 MB."""
        p, q, _ = self.cofactors_of_points.shape
        total = np.zeros((p, q, parts[0][1].shape[1]))
        for point, by_point, _ in parts:
            total[point] += by_point.reshape(len(point), q, -1)
        return np.arange(p), total.reshape(p * q, -1), np.sum([part[2] for part in parts], axis=0)


def make_score_test(problem: Problem, state: State, cofactors: Covariance, cost: float, redundancy: int) -> ScoreTest:
    """A network at its minimum, prepared for tests."""
    linear = engine.linear_model(problem, state, None)
    assert isinstance(cofactors, PointFactors)
    shift = cofactors.every_shift if 5 * linear.width * len(problem.uv) <= MOST_NONZERO else None
    residual, by_points = linear.residual.ravel(), cofactors.point_inverse
    return ScoreTest(problem, linear, residual, cofactors.inverse, shift, by_points, 2 * cost, redundancy)


def _full(matrix: Sparse) -> FloatArray:
    """A sparse matrix, or an array, as an array."""
    return matrix.toarray() if sparse.issparse(matrix) else matrix


def _fast(matrix: Sparse) -> Sparse | FloatArray:
    """The matrix, as a full array where it is nearly that."""
    return matrix.toarray() if matrix.nnz > FULL * np.prod(matrix.shape) else matrix


def spread(blocks: FloatArray, column: IntArray, shape: tuple[int, int]) -> Sparse:
    """A sparse matrix with one block (n,a,b) after the other in its rows, each from a column (n,) on."""
    return _of_rows(blocks, column[:, None] + np.arange(blocks.shape[2]), shape)


def _of_rows(blocks: FloatArray, columns: IntArray, shape: tuple[int, int]) -> Sparse:
    """The same of blocks (n,a,b) whose columns (n,b) need not follow each other, but rise.

    It is written in the form of the product: sorting it from single numbers took as long as what it is for.
    """
    n, a, b = blocks.shape
    column = np.broadcast_to(columns.astype(np.int32)[:, None], (n, a, b))  # half the memory of the indices
    begin = np.arange(0, n * a * b + 1, b, dtype=np.int32) if b else np.zeros(n * a + 1, dtype=np.int32)
    return sparse.csr_array((blocks.ravel(), column.ravel(), begin), shape=shape)


def conditional(
    g: FloatArray, a: FloatArray, own: FloatArray, given: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """g (r,), A (r,r) and own products (r,r) of the other r columns once the `given` ones are corrected for."""
    rest = np.setdiff1d(np.arange(len(g)), given)
    scale = np.sqrt(np.maximum(own.diagonal(), 1e-300))
    inner = a[np.ix_(given, given)] / scale[given, None] / scale[given]
    inverse = np.linalg.pinv(inner, rcond=LEAST_SHARE, hermitian=True) / scale[given, None] / scale[given]
    taken = a[np.ix_(rest, given)] @ inverse
    return g[rest] - taken @ g[given], a[np.ix_(rest, rest)] - taken @ a[np.ix_(given, rest)], own[np.ix_(rest, rest)]


def change_of(g: FloatArray, a: FloatArray, own: FloatArray, variance: float) -> Change:
    """The test of one change by its score (m,), matrix A (m,m) and own products B'B (m,m)."""
    statistic, dof, value = changes_of(g[None], a[None], own[None], variance)
    return Change(float(statistic[0]), int(dof[0]), value[0])


def changes_of(
    g: FloatArray, a: FloatArray, own: FloatArray, variance: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Statistics (k,), degrees of freedom (k,) and changes (k,m) of many tests at once.

    Directions of which the estimated unknowns leave less than `LEAST_SHARE` do not count.
    """
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


# --- lenses that deviate from the model ------------------------------------------------------------------------------

# Smooth fields of u and v that are tried: polynomials over the image up to this degree together. A field of one period
# over the image is met to a tenth of its size.
DEGREE = 5
TERMS = (DEGREE + 1) * (DEGREE + 2) // 2
# A camera with fewer points says nothing about its lens beyond the model (42 numbers on top of its 15).
LEAST_POINTS = 100
# In 2 of 1000 faultless rigs noise makes one camera's statistic exceed the limit.
FALSE_ALARM = 0.002


@dataclass(frozen=True)
class Misfit:
    """Structure in one camera's residuals: chi-square `statistic` on `dof`; `rms_px` of the part that is visible."""

    camera: int
    statistic: float
    dof: int
    rms_px: float


def field_values(probe: ScoreTest, rows: IntArray, size: FloatArray) -> FloatArray:
    """Derivatives (k,2,2*TERMS) of one camera's rows (k,) by its fields: Legendre polynomials over its image (2,)."""
    terms = field_terms(probe.problem.uv[rows], size)
    weight = probe.problem.weight[rows]
    values = np.zeros((len(rows), 2, 2 * TERMS))
    values[:, 0, :TERMS] = terms * weight[:, :1]
    values[:, 1, TERMS:] = terms * weight[:, 1:]
    return values


def field_terms(uv: FloatArray, size: FloatArray) -> FloatArray:
    """Legendre polynomials (k,TERMS) at pixels (k,2) of an image (2,)."""
    at = (2 * uv + 1) / size - 1
    powers = np.add.outer(np.arange(DEGREE + 1), np.arange(DEGREE + 1)).ravel()
    return np.asarray(legvander2d(at[:, 0], at[:, 1], [DEGREE, DEGREE])[:, powers <= DEGREE], dtype=np.float64)


def misfits(
    probe: ScoreTest,
    sizes: FloatArray,
    noise_px: FloatArray,
    moved: dict[int, FloatArray],
    context: Context | None = None,
) -> list[Misfit]:
    """Cameras whose residuals have structure over images (c,2) px: Rao's test of smooth fields beside known moves."""
    problem = probe.problem
    tested = np.flatnonzero(np.bincount(problem.camera, minlength=problem.n_cameras) >= LEAST_POINTS)
    found = []
    for camera in tested:
        if context is not None:
            context.check()
        rows = np.flatnonzero(problem.camera == camera)
        values = field_values(probe, rows, sizes[camera])
        before = moved.get(int(camera), np.zeros((len(rows), 2, 0)))
        g, a, own = probe.block(rows, np.concatenate([before, values], axis=2))
        change = change_of(*conditional(g, a, own, np.arange(before.shape[2])), probe.variance)
        if change.dof and change.statistic > chdtri(change.dof, FALSE_ALARM / len(tested)):
            visible = np.sqrt((change.statistic - change.dof) / (2 * len(rows)))
            found.append(Misfit(int(camera), change.statistic, change.dof, float(visible * noise_px[camera])))
    return found
