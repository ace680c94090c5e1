"""The quadratic form of random effects of cameras at an adjusted network, all other unknowns eliminated.

As in `dense_elimination`, the whitened couplings of some points with the columns that their images have are put side by
side, and one product is subtracted for all of them. Polynomials of the ball's shape enter by the points that they move:
their derivatives are products of a point's values and of its derivatives. Processor seconds, and by numpy: 1.0 and 2.2
(free, 112,000 observations of 100 cameras), 1.2 and 2.4 (rigid, with the shape), 0.15 and 0.35 (free, 16 cameras).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse

from spherecal.adjust.bundle import Adjustment
from spherecal.adjust.camera_effects import TURN, Design
from spherecal.adjust.covariance_factors import Inverted
from spherecal.adjust.dense_elimination import alike, views_apart
from spherecal.adjust.kernel import BARE, INNER
from spherecal.adjust.network import Network
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.schur_kernel import add_point
from spherecal.adjust.variance_components import Effects
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.kernels import njit

_BLOCK = 1024  # columns of a product that are computed at a time
_ROWS = 20_000  # observations whose derivatives are in memory at a time, 10 MB


@dataclass(frozen=True)
class EffectSystem:
    """The effects, all else eliminated; the other columns' equations by them (e,m), points' shifts by them (3p,m)."""

    quadratic: Effects
    by_columns: FloatArray
    _shifts: list[tuple[FloatArray, IntArray, IntArray]]
    _shape: tuple[int, int]

    @property
    def shifts(self) -> sparse.csr_array:
        """The shifts of the points, where `effects_of` was asked for them."""
        at = np.full(self._shape[0], -1)
        rows = np.concatenate([rows for _, rows, _ in self._shifts])
        at[rows] = np.arange(len(rows))  # -1, the last one, has no entries
        data = np.concatenate([values.ravel() for values, _, _ in self._shifts])
        columns = np.concatenate([np.tile(columns.astype(np.int32), len(rows)) for _, rows, columns in self._shifts])
        count = np.concatenate([[0], *(np.full(len(rows), len(columns)) for _, rows, columns in self._shifts), [0]])
        return sparse.csr_array((data, columns, np.cumsum(count)), shape=(len(rows) + 1, self._shape[1]))[at]


class _Sums(NamedTuple):
    """Equations of the effects (m,m), upper triangle, of the columns by them (e,m), gradients of both."""

    own: FloatArray
    by_columns: FloatArray
    gradient: FloatArray
    of_columns: FloatArray


class _Columns(NamedTuple):
    """First column (n,) of what each row meets: its lens' field of a `width`, turn, bending of the ball, -1 for none.

    Among the other unknowns those of its camera and its placement.
    """

    field: IntArray
    width: IntArray
    turn: IntArray
    bending: IntArray
    camera: IntArray
    placement: IntArray


def effects_of(
    network: Network,
    adjusted: Adjustment,
    design: Design,
    system: Inverted,
    start: FloatArray | None,
    with_shifts: bool = False,
) -> EffectSystem:
    """The quadratic form of the effects at an adjusted network, all other unknowns eliminated.

    `start` (m,): the coefficients that the network is corrected by; None for none. `with_shifts`: the points' shifts
    too, 700 MB of a million observations.
    """
    problem = adjusted.problem
    m, e = design.count, problem.layout.expanded
    sums = _Sums(np.zeros((m, m)), np.zeros((e, m)), np.zeros(m), np.zeros(e))
    shifts = list(_eliminated(network, adjusted, design, system, sums, with_shifts))
    follow = system.inverse @ sums.by_columns
    matrix, gradient = sums.own, sums.gradient
    matrix += np.triu(matrix, 1).T
    matrix -= _symmetric_product(sums.by_columns, follow)  # in place: 80 MB each of a million observations
    gradient -= follow.T @ sums.of_columns
    before = np.zeros(m) if start is None else start
    squares = 2 * adjusted.minimum.cost + float(before @ (matrix @ before - 2 * gradient))
    taken = 0 if network.corrections is None else round(float(network.corrections.freedom.sum()))
    redundancy = adjusted.redundancy + taken
    quadratic = Effects(matrix, gradient - matrix @ before, squares, redundancy, design.part, design.kind)
    return EffectSystem(quadratic, sums.by_columns, shifts, (3 * problem.n_points, m))


def _symmetric_product(left: FloatArray, right: FloatArray) -> FloatArray:
    """left' right (m,m) where that is symmetric: one triangle of blocks is computed."""
    m = left.shape[1]
    out = np.empty((m, m))
    for first in range(0, m, _BLOCK):
        block, upto = slice(first, first + _BLOCK), min(first + _BLOCK, m)
        out[:upto, block] = left[:, :upto].T @ right[:, block]
        out[block, :first] = out[:first, block].T
    return out


def _eliminated(
    network: Network,
    adjusted: Adjustment,
    design: Design,
    system: Inverted,
    sums: _Sums,
    with_shifts: bool,
) -> Iterator[tuple[FloatArray, IntArray, IntArray]]:
    """Add all points, which are eliminated; their shifts (3k,s), rows (3k,) and columns (s,), if asked for."""
    problem, start = adjusted.problem, adjusted.problem.point_start
    root = _roots(system.point_inverse)
    own_columns = np.full(problem.n_points, -1)
    kept = problem.kept_points
    own_columns[kept] = problem.layout.expanded - 3 * np.arange(len(kept), 0, -1)
    polynomials = design.bending.values if design.bending is not None else np.zeros((problem.n_points, 0))
    for groups in _some_rows(network, adjusted):
        points = np.concatenate(groups)
        count = start[points + 1] - start[points]
        end = np.cumsum(count)
        rows = np.arange(end[-1]) + np.repeat(start[points] - end + count, count)
        linear, values = system.linear.at(rows), _fields_at(network, adjusted, design, rows)
        columns = _columns_of(network, adjusted, design, rows, system.linear.width)
        begin, first = np.concatenate([[0], end]), 0
        most = values.shape[2] + TURN, linear.by_camera.shape[2] + POSE
        spaces = [*((np.empty(w, dtype=np.int64), np.empty((2, w))) for w in most), (np.zeros((3, 3)), np.zeros(3))]
        for group in groups:
            own = slice(first, first + len(group))
            ends, first = begin[first : first + len(group) + 1], first + len(group)
            is_met = np.zeros(len(sums.gradient), dtype=bool), np.zeros(len(sums.of_columns), dtype=bool)
            _mark(columns, ends, linear.by_camera.shape[2], 3 * polynomials.shape[1], *is_met)
            effects, others = (np.flatnonzero(met) for met in is_met)
            at_effect, at_other = (np.cumsum(met) - 1 for met in is_met)
            s = len(effects)
            white = np.zeros((3 * len(group), s + len(others) + 1))
            _couple(
                linear, values, columns, ends, polynomials[points[own]], own_columns[group], root[group],
                (at_effect, s + at_other), sums, white, *spaces,
            )  # fmt: skip
            theirs = white[:, :s]
            _subtract(sums, effects, others, theirs.T @ theirs, white[:, s:].T @ theirs, white[:, s:].T @ white[:, -1])
            if with_shifts:
                shifts = -(root[group] @ theirs.reshape(-1, 3, s)).reshape(-1, s)
                yield shifts, (3 * group[:, None] + np.arange(3)).ravel(), effects


def _roots(inverse: FloatArray) -> FloatArray:
    """Cholesky's factors of the points' V^-1 (p,3,3); 0 where a point is kept, or nothing observes it."""
    known = inverse[:, 0, 0] > 0
    return np.linalg.cholesky(np.where(known[:, None, None], inverse, np.eye(3))) * known[:, None, None]


def _some_rows(network: Network, adjusted: Adjustment) -> Iterator[list[IntArray]]:
    """Groups of points that are eliminated together, so many at a time that they have some `_ROWS` observations."""
    problem, some, count = adjusted.problem, [], 0
    start, apart = problem.point_start, views_apart(problem)
    seen = np.flatnonzero(np.diff(start) > 0)
    of_turns = network.placement[adjusted.rows[start[seen]]]  # of a free point: those of its placement
    first = np.zeros_like(of_turns) if problem.n_placements else of_turns
    for at in np.unique(first):
        for points in alike(seen[first == at], apart):
            some.append(points)
            count += int((start[points + 1] - start[points]).sum())
            if count > _ROWS:
                yield some
                some, count = [], 0
    if some:
        yield some


def _fields_at(network: Network, adjusted: Adjustment, design: Design, rows: IntArray) -> FloatArray:
    """Weighted derivatives (n,2,w) of rows (n,) by their lenses' fields; 0 beyond the columns of a field."""
    problem = adjusted.problem
    camera, uv, weight = problem.camera[rows], network.measured[adjusted.rows[rows]], problem.weight[rows]
    values = np.zeros((len(rows), 2, max((field.basis.count for field in design.fields), default=0)))
    for field in design.fields:
        own = np.flatnonzero(np.isin(camera, field.cameras))
        values[own, :, : field.basis.count] = field.basis.at(uv[own]) * weight[own][:, :, None]
    return values


def _columns_of(network: Network, adjusted: Adjustment, design: Design, rows: IntArray, width: int) -> _Columns:
    problem, none = adjusted.problem, np.full(len(rows), -1)
    camera, placement = problem.camera[rows], network.placement[adjusted.rows[rows]]
    field, count = np.full(problem.n_cameras, -1), np.zeros(problem.n_cameras, dtype=np.int64)
    for own in design.fields:
        field[own.cameras], count[own.cameras] = own.first, own.basis.count
    turn = design.n_fields + TURN * design.images(camera, placement) if len(design.camera_of_image) else none
    on_ball = problem.placement[rows] if problem.n_placements else none
    bending = none if design.bending is None else design.n_of_cameras + on_ball * design.bending.count
    posed = problem.n_cameras * width + POSE * on_ball if problem.n_placements else none
    return _Columns(field[camera], count[camera], turn, bending, camera * width, posed)


@njit(**BARE)
def _mark(columns, begin, width, bending, effects, others):
    """Mark the effects (m,) and other columns (e,) that rows meet."""
    for k in range(begin[0], begin[-1]):
        effects[columns.field[k] : columns.field[k] + columns.width[k]] = True
        others[columns.camera[k] : columns.camera[k] + width] = True
        if columns.turn[k] >= 0:
            effects[columns.turn[k] : columns.turn[k] + TURN] = True
        if columns.bending[k] >= 0:
            effects[columns.bending[k] : columns.bending[k] + bending] = True
        if columns.placement[k] >= 0:
            others[columns.placement[k] : columns.placement[k] + POSE] = True


@njit(**BARE)
def _couple(linear, values, columns, begin, polynomials, own_columns, root, at, sums, white, effects, unknowns, point):
    """Add rows to the sums, and whiten the couplings of their points in `white` (3p,s+t+1), the last with residuals.

    `begin` (p+1,): first row of each point; `own_columns` (p,): of a point that is kept, -1 for none; `at`: where the
    effects (m,) and the other columns (e,) are among the couplings; `effects`, `unknowns`: working space, columns (w,)
    that a row meets and its derivatives (2,w) by them; `point`: a point's normal matrix (3,3) and gradient (3,), 0.
    """
    width, (normal, force) = linear.by_camera.shape[2], point
    for i in range(len(begin) - 1):
        w = white[3 * i : 3 * i + 3]
        for k in range(begin[i], begin[i + 1]):
            s = _append(columns.field[k], columns.width[k], values, k, 0, effects)
            s = _append(columns.turn[k], TURN, linear.by_camera, k, s, effects)
            t = _append(columns.camera[k], width, linear.by_camera, k, 0, unknowns)
            t = _append(columns.placement[k], POSE, linear.by_placement, k, t, unknowns)
            jp, r, bending = linear.by_point[k], linear.residual[k], columns.bending[k]
            of_point = jp, r, polynomials[i], bending, w
            _add_row(True, effects, s, effects, s, of_point, sums.own, sums.gradient, at[0])
            _add_row(False, unknowns, t, effects, s, of_point, sums.by_columns, sums.of_columns, at[1])
            add_point(normal, force, jp, r[0], r[1])
            if k + 1 == begin[i + 1] or columns.bending[k + 1] != bending:
                if bending >= 0:
                    _bend(polynomials[i], normal, force, bending, sums, w, at[0][bending])
                for a in range(3):
                    w[a, -1] += force[a]
                normal[:], force[:] = 0.0, 0.0
        if own_columns[i] >= 0:
            _keep(sums.by_columns[own_columns[i] : own_columns[i] + 3], w, at[0])
        _whiten(root[i], w)


@njit(**INNER)
def _add_row(is_own, of, s, by, t, point, sums, gradient, at):
    """Add products of derivatives (2,s) with those by effects (2,t), with the bending and with the point."""
    (index, x), (columns, y) = of, by
    jp, r, p, bending, w = point
    for a in range(s):
        x0, x1 = x[0, a], x[1, a]
        row, j = sums[index[a]], at[index[a]]
        gradient[index[a]] += x0 * r[0] + x1 * r[1]
        for b in range(a if is_own else 0, t):
            row[columns[b]] += x0 * y[0, b] + x1 * y[1, b]
        for i in range(3):
            q = jp[0, i] * x0 + jp[1, i] * x1
            w[i, j] += q
            if bending >= 0:
                bent = row[bending + i * len(p) : bending + (i + 1) * len(p)]
                for b in range(len(p)):
                    bent[b] += q * p[b]


@njit(**INNER)
def _append(first, count, derivatives, k, known, found):
    """Append `count` columns from `first` (-1: none) on that row k has, and its derivatives; how many there are now."""
    index, out = found
    if first < 0:
        return known
    for a in range(count):
        index[known + a] = first + a
        out[0, known + a], out[1, known + a] = derivatives[k, 0, a], derivatives[k, 1, a]
    return known + count


@njit(**INNER)
def _bend(p, normal, force, first, sums, w, at):
    """Add the polynomials (n,) that move a point by its normal matrix and gradient at one placement."""
    n = len(p)
    for i in range(3):
        for a in range(n):
            row = sums.own[first + i * n + a]
            sums.gradient[first + i * n + a] += p[a] * force[i]
            for j in range(i, 3):
                w[j, at + i * n + a] += normal[j, i] * p[a]
                if j > i:
                    w[i, at + j * n + a] += normal[i, j] * p[a]
                for b in range(a if j == i else 0, n):
                    row[first + j * n + b] += p[a] * normal[i, j] * p[b]


@njit(**INNER)
def _keep(by_columns, w, at):
    """Add the couplings (3,s) of a point that is kept, whose own columns (3,m) are among the others."""
    for b in range(len(at)):
        if at[b] >= 0 and (b == 0 or at[b] > at[b - 1]):
            for j in range(3):
                by_columns[j, b] += w[j, at[b]]


@njit(**INNER)
def _whiten(root, w):
    for b in range(w.shape[1]):
        w[0, b] = root[0, 0] * w[0, b] + root[1, 0] * w[1, b] + root[2, 0] * w[2, b]
        w[1, b] = root[1, 1] * w[1, b] + root[2, 1] * w[2, b]
        w[2, b] *= root[2, 2]


@njit(**BARE)
def _subtract(sums, effects, others, own, by_columns, pull):
    """Subtract products by effects (s,) and other columns (t,): (s,s), upper triangle, (t+1,s) and (t+1,)."""
    for a in range(len(effects)):
        row = sums.own[effects[a]]
        for b in range(a, len(effects)):
            row[effects[b]] -= own[a, b]
        sums.gradient[effects[a]] -= by_columns[len(others), a]
    for a in range(len(others)):
        row = sums.by_columns[others[a]]
        for b in range(len(effects)):
            row[effects[b]] -= by_columns[a, b]
        sums.of_columns[others[a]] -= pull[a]
