"""The adjustment's inner stages in plain numpy: the reference that the compiled engine is tested against.

linear_model -> reduce (eliminate the points) -> back_substitute: the functions of `spherecal.adjust.engine`.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.linear import Linearisation, PointEquations, Reduced
from spherecal.adjust.parameter_layout import POSE, Layout
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.camera import project, project_with_derivatives
from spherecal.geometry.rotation import cross_matrix


@contextmanager
def reference_instead() -> Iterator[None]:
    """Within, every adjustment runs on the functions of this module."""
    names = ("residuals", "linearise", "linear_model", "reduce", "back_substitute")
    with patch.multiple(engine, **{name: globals()[name] for name in names}):
        yield


def world_points(problem: Problem, state: State) -> FloatArray:
    """The observed point of every observation in the world frame, (n,3)."""
    points = state.points[problem.point]
    if not problem.n_placements:
        return points
    turned = np.einsum("nij,nj->ni", state.placement_rotation[problem.placement], points)
    return turned + state.placement_translation[problem.placement]


def camera_points(problem: Problem, state: State) -> FloatArray:
    """The observed point of every observation in its camera's frame, (n,3)."""
    world = world_points(problem, state)
    return np.einsum("nij,nj->ni", state.rotation[problem.camera], world) + state.translation[problem.camera]


def residuals(problem: Problem, state: State) -> FloatArray:
    """Weighted residuals, predicted minus observed over sigma, (n,2)."""
    uv = project(camera_points(problem, state), state.intrinsics[problem.camera])
    return (uv - problem.uv) * problem.weight


def linearise(problem: Problem, state: State, robust_weight: FloatArray | None) -> Linearisation:
    """Residuals and derivatives at a state; `robust_weight` (n,) multiplies the rows of each observation."""
    rotation = state.rotation[problem.camera]
    x = camera_points(problem, state)
    uv, by_x, by_intrinsics = project_with_derivatives(x, state.intrinsics[problem.camera])
    weight = problem.weight if robust_weight is None else problem.weight * robust_weight[:, None]
    by_x = by_x * weight[:, :, None]
    by_camera = np.empty((len(x), 2, POSE + len(problem.intrinsic_columns)))
    by_camera[:, :, :3] = -by_x @ cross_matrix(x)
    by_camera[:, :, 3:6] = by_x
    by_camera[:, :, 6:] = by_intrinsics[:, :, problem.intrinsic_columns] * weight[:, :, None]
    by_world = by_x @ rotation
    residual = (uv - problem.uv) * weight
    if not problem.n_placements:
        return Linearisation(residual, by_camera, by_world, np.zeros((0, 2, POSE)))
    turn = state.placement_rotation[problem.placement]
    turned = np.einsum("nij,nj->ni", turn, state.points[problem.point])
    by_placement = np.concatenate([-by_world @ cross_matrix(turned), by_world], axis=2)
    return Linearisation(residual, by_camera, by_world @ turn, by_placement)


def linear_model(problem: Problem, state: State, robust_weight: FloatArray | None) -> Linearisation:
    """What `reduce` and `back_substitute` work with; here the linearisation itself."""
    return linearise(problem, state, robust_weight)


def reduce(problem: Problem, linear: Linearisation, damping: float, known: PointEquations | None = None) -> Reduced:
    """Normal equations with the points eliminated; `damping` multiplies the points' diagonals (Marquardt).

    `known`: equations of the points themselves, beside their observations.
    """
    layout = problem.layout
    matrix = np.zeros((layout.expanded, layout.expanded))
    gradient = np.zeros(layout.expanded)
    entries = _block_rows(problem, linear)
    through, q = _through_play(problem, linear)
    point_matrix = _sum_by(problem.point, through.transpose(0, 2, 1) @ linear.by_point, problem.n_points)
    point_gradient = _sum_by(problem.point, _at(through, linear.residual), problem.n_points)
    if known is not None:
        point_matrix, point_gradient = point_matrix + known.normal, point_gradient + known.gradient
    for block, rows in entries:
        _add_products(matrix, layout.block_offset, block, rows, block, rows)
        _add_vector(gradient, layout, block, _at(rows, linear.residual))
    if len(entries) == 2:
        _add_products(matrix, layout.block_offset, *entries[0], *entries[1])

    kept = np.full(problem.n_points, -1)
    kept[problem.kept_points] = problem.n_cameras + problem.n_placements + np.arange(len(problem.kept_points))
    for p in problem.kept_points:
        own = slice(layout.block_offset[kept[p]], layout.block_offset[kept[p]] + 3)
        matrix[own, own] += point_matrix[p]
        gradient[own] += point_gradient[p]
    diagonal = matrix.diagonal().copy()

    observed = (np.diff(problem.point_start) > 0) & (kept < 0)
    inverse = np.zeros_like(point_matrix)
    damped = point_matrix[observed]
    i3 = np.arange(3)
    damped[:, i3, i3] *= 1.0 + damping
    inverse[observed] = _inverse(damped)

    for place in np.flatnonzero(q.any(axis=(1, 2))):
        rows = np.flatnonzero(problem.ball.place == place)
        met = np.zeros((3, layout.expanded))
        for block, derivatives in entries:
            for k in rows:
                columns = layout.block_offset[block[k]] + np.arange(derivatives.shape[2])
                met[:, columns] += linear.by_point[k].T @ derivatives[k]
        matrix -= np.triu(met.T @ q[place] @ met)
        gradient -= met.T @ q[place] @ _at(linear.by_point, linear.residual)[rows].sum(axis=0)
    blocks, points, coupling = _coupling(problem, through, entries)
    is_kept = kept[points] >= 0
    for b, p, e in zip(blocks[is_kept], points[is_kept], coupling[is_kept], strict=True):
        row, column, width = layout.block_offset[b], layout.block_offset[kept[p]], layout.block_width[b]
        matrix[row : row + width, column : column + 3] += e[:, :width].T
    if is_kept.any():
        blocks, points, coupling = blocks[~is_kept], points[~is_kept], coupling[~is_kept]
    weighted = inverse[points] @ coupling
    _add_vector(gradient, layout, blocks, -(point_gradient[points][:, None] @ weighted)[:, 0])
    _subtract_runs(matrix, problem, blocks, points, weighted, coupling)
    return Reduced(matrix, gradient, diagonal, inverse, point_gradient)


def back_substitute(
    problem: Problem, linear: Linearisation, reduced: Reduced, step: FloatArray
) -> tuple[FloatArray, float]:
    """The step of the eliminated points (p,3) for an expanded step (e,), and the linear model's cost after it."""
    change = np.zeros_like(linear.residual)
    for block, rows in _block_rows(problem, linear):
        columns = problem.layout.block_offset[block][:, None] + np.arange(rows.shape[2])
        change += np.einsum("nij,nj->ni", rows, step[columns])
    kept_step = np.zeros((problem.n_points, 3))
    if len(problem.kept_points):
        start = problem.layout.block_offset[problem.n_cameras + problem.n_placements]
        kept_step[problem.kept_points] = step[start:].reshape(-1, 3)
    through, q = _through_play(problem, linear)
    pulled = _sum_by(problem.point, _at(through, change), problem.n_points)
    point_step = -np.einsum("pij,pj->pi", reduced.point_inverse, reduced.point_gradient + pulled)
    change += np.einsum("nij,nj->ni", linear.by_point, (point_step + kept_step)[problem.point])
    after = linear.residual + change
    squares = (after**2).sum()
    if len(problem.ball.place):
        met = _sum_by(problem.ball.place, _at(linear.by_point, after), len(q))
        squares -= np.einsum("fi,fij,fj->", met, q, met)
    return point_step, 0.5 * float(squares)


def _through_play(problem: Problem, linear: Linearisation) -> tuple[FloatArray, FloatArray]:
    """Derivatives by the points (n,2,3) times P = I - Q V of their places, and Q (places,3,3)."""
    if not len(problem.ball.place):
        return linear.by_point, np.zeros((0, 3, 3))
    normal = _sum_by(
        problem.ball.place, linear.by_point.transpose(0, 2, 1) @ linear.by_point, len(problem.ball.shape_sd)
    )
    variance = (problem.ball.shape_sd**2)[:, None, None]
    p = np.linalg.inv(np.eye(3) + variance * normal)
    return linear.by_point @ p[problem.ball.place], variance * p


def _block_rows(problem: Problem, linear: Linearisation) -> list[tuple[IntArray, FloatArray]]:
    """Block and derivatives of every observation, for cameras and, in the rigid form, placements."""
    entries = [(problem.camera, linear.by_camera)]
    if problem.n_placements:
        entries.append((problem.n_cameras + problem.placement, linear.by_placement))
    return entries


def _coupling(
    problem: Problem, through: FloatArray, entries: list[tuple[IntArray, FloatArray]]
) -> tuple[IntArray, IntArray, FloatArray]:
    """Block-point coupling (m,3,w), one for each pair that meets, with block (m,) and point (m,), sorted by point."""
    if len(entries) == 1:  # a camera sees a point once: every observation is a pair of its own
        return problem.camera, problem.point, through.transpose(0, 2, 1) @ entries[0][1]
    width = max(rows.shape[2] for _, rows in entries)
    n_blocks = problem.n_cameras + problem.n_placements
    keys, parts = [], []
    for block, rows in entries:
        part = np.zeros((len(rows), 3, width))
        part[:, :, : rows.shape[2]] = through.transpose(0, 2, 1) @ rows
        keys.append(problem.point * n_blocks + block)
        parts.append(part)
    key, position = np.unique(np.concatenate(keys), return_inverse=True)
    return key % n_blocks, key // n_blocks, _sum_by(position.reshape(-1), np.concatenate(parts), len(key))


def _subtract_runs(
    matrix: FloatArray, problem: Problem, blocks: IntArray, points: IntArray, weighted: FloatArray, coupling: FloatArray
) -> None:
    """Subtract W V^-1 W' of all points, one product for all points that meet the same blocks.

    Entries (m,) are sorted by point, then block, so that the upper block triangle is filled.
    """
    layout, width = problem.layout, coupling.shape[2]
    start = np.flatnonzero(np.diff(points, prepend=-1))
    if not len(start):
        return
    count = np.diff(np.append(start, len(points)))
    tag = np.random.default_rng(0).integers(1, 2**62, len(layout.block_offset), dtype=np.uint64)
    pattern = np.add.reduceat(tag[blocks], start)  # equal for equal sets of blocks
    order = np.argsort(pattern, kind="stable")
    for run in np.split(order, np.flatnonzero(np.diff(pattern[order])) + 1):
        rows = start[run][:, None] + np.arange(int(count[run[0]]))
        own = blocks[rows[0]]
        used = np.arange(width) < layout.block_width[own][:, None]
        columns = (layout.block_offset[own][:, None] + np.arange(width))[used]
        left, right = (e[rows].transpose(0, 2, 1, 3).reshape(3 * len(run), -1) for e in (weighted, coupling))
        product = left.T @ right
        matrix[np.ix_(columns, columns)] -= product if used.all() else product[np.ix_(used.ravel(), used.ravel())]


def _inverse(v: FloatArray) -> FloatArray:
    """Inverses of symmetric 3x3 matrices (m,3,3); not finite, without an exception, where singular."""
    columns = np.stack([np.cross(v[:, 1], v[:, 2]), np.cross(v[:, 2], v[:, 0]), np.cross(v[:, 0], v[:, 1])], axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return columns / np.einsum("mi,mi->m", v[:, 0], columns[:, :, 0])[:, None, None]


def _sum_by(index: IntArray, values: FloatArray, n: int) -> FloatArray:
    """Sums of `values` (m, ...) over equal indices, (n, ...)."""
    out = np.zeros((n, *values.shape[1:]))
    if len(index) and (np.diff(index) < 0).any():
        order = np.argsort(index, kind="stable")
        index, values = index[order], values[order]
    starts = np.flatnonzero(np.diff(index, prepend=-1))
    if len(starts):
        out[index[starts]] = np.add.reduceat(values, starts, axis=0)
    return out


def _at(rows: FloatArray, residual: FloatArray) -> FloatArray:
    """rows' residual for each entry: (n,i,j), (n,i) -> (n,j)."""
    return np.einsum("nij,ni->nj", rows, residual)


def _add_products(
    matrix: FloatArray, offset: IntArray, left: IntArray, left_rows: FloatArray, right: IntArray, right_rows: FloatArray
) -> None:
    """Add left_rows' right_rows of all observations at their (left, right) block positions."""
    n_right = int(right.max()) + 1
    key = left * n_right + right
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    for begin, end in zip(starts, np.append(starts[1:], len(key)), strict=True):
        some = order[begin:end]
        a = left_rows[some].reshape(-1, left_rows.shape[2])
        b = right_rows[some].reshape(-1, right_rows.shape[2])
        row, column = offset[left[some[0]]], offset[right[some[0]]]
        matrix[row : row + a.shape[1], column : column + b.shape[1]] += a.T @ b


def _add_vector(vector: FloatArray, layout: Layout, block: IntArray, values: FloatArray) -> None:
    """Add values (n,w) at their blocks' offsets, each block in its own width."""
    total = _sum_by(block, values, len(layout.block_offset))
    for b in np.unique(block):
        width = min(layout.block_width[b], values.shape[1])
        vector[layout.block_offset[b] : layout.block_offset[b] + width] += total[b, :width]
