"""The adjustment's inner stages compiled by numba: same three functions and results as `engine_numpy`.

All kernels release Python's global lock (a window stays alive) and are cached on disk after the first call.
"""

import numpy as np
from numba import njit

from spherecal.adjust import engine_dense
from spherecal.adjust.engine_numpy import Linearisation, Reduced
from spherecal.adjust.kernel_options import KERNEL, KERNEL_PART
from spherecal.adjust.problem import POSE, Layout, Problem, State
from spherecal.arrays import FloatArray, IntArray
from spherecal.geometry.camera import FISHEYE_MARK
from spherecal.geometry.fisheye import AXIS_R2


def residuals(problem: Problem, state: State) -> FloatArray:
    """Weighted residuals, predicted minus observed over sigma, (n,2)."""
    out = np.empty_like(problem.uv)
    _residuals(
        problem.camera, problem.point, _placement(problem), problem.uv, problem.weight,
        state.rotation, state.translation, state.intrinsics, *_placement_poses(state), state.points, out,
    )  # fmt: skip
    return out


def linearise(problem: Problem, state: State, robust_weight: FloatArray | None) -> Linearisation:
    """Residuals and derivatives at a state; `robust_weight` (n,) multiplies the rows of each observation."""
    n, width = len(problem.uv), POSE + len(problem.intrinsic_columns)
    weight = problem.weight if robust_weight is None else problem.weight * robust_weight[:, None]
    out = Linearisation(
        np.empty((n, 2)),
        np.empty((n, 2, width)),
        np.empty((n, 2, 3)),
        None if problem.placement is None else np.empty((n, 2, POSE)),
    )
    _linearise(
        problem.camera, problem.point, _placement(problem), problem.uv, weight,
        state.rotation, state.translation, state.intrinsics, *_placement_poses(state), state.points,
        problem.intrinsic_columns, out.residual, out.by_camera, out.by_point, _by_placement(out),
    )  # fmt: skip
    return out


def reduce(problem: Problem, linear: Linearisation, damping: float) -> Reduced:
    """Normal equations with the points eliminated; `damping` multiplies the points' diagonals (Marquardt).

    What cameras of one lens share stands in the columns of the first of them.
    """
    layout = problem.layout
    matrix = np.zeros((layout.expanded, layout.expanded))
    gradient = np.zeros(layout.expanded)
    diagonal = np.zeros(layout.expanded)
    inverse = np.zeros((problem.n_points, 3, 3))
    point_gradient = np.zeros((problem.n_points, 3))
    kept_block = np.full(problem.n_points, -1)
    kept_block[problem.kept_points] = problem.n_cameras + problem.n_placements + np.arange(len(problem.kept_points))
    is_dense = engine_dense.is_dense(problem)
    reduced = Reduced(matrix, gradient, diagonal, inverse, point_gradient, is_gathered=not is_dense)
    order = problem.elimination_order
    lenses = _own_lenses(layout, problem.n_cameras) if is_dense else _lenses(layout, problem.n_cameras)
    if is_dense:
        is_kept = kept_block[order] >= 0
        engine_dense.eliminate(problem, linear, damping, order[~is_kept], reduced)
        order = order[is_kept]
    _reduce(
        order, problem.camera, _placement(problem), problem.n_cameras, problem.point_start,
        kept_block, linear.residual, linear.by_camera, linear.by_point, _by_placement(linear),
        *lenses, damping, matrix, gradient, diagonal, inverse, point_gradient,
    )  # fmt: skip
    return reduced


def _own_lenses(layout: Layout, n_cameras: int) -> tuple[IntArray, IntArray, IntArray]:
    """Columns and widths of the blocks, and each camera's block of a lens that it shares: -1, as it has its own."""
    return layout.block_offset, layout.block_width, np.full(n_cameras, -1)


def _lenses(layout: Layout, n_cameras: int) -> tuple[IntArray, IntArray, IntArray]:
    """The same with a block more, after all others, for each lens that several cameras share.

    A point then meets the lens once instead of once with each camera: of 60 views by one lens a third of the products.
    """
    owner = layout.lens_owner
    is_shared = np.bincount(owner, minlength=n_cameras)[owner] > 1
    first = np.unique(owner[is_shared])
    block = np.full(n_cameras, -1)
    block[is_shared] = len(layout.block_offset) + np.searchsorted(first, owner[is_shared])
    width = layout.block_width.copy()
    width[:n_cameras][is_shared] = POSE
    offset = np.concatenate([layout.block_offset, layout.block_offset[first] + POSE])
    return offset, np.concatenate([width, layout.block_width[first] - POSE]), block


def back_substitute(
    problem: Problem, linear: Linearisation, reduced: Reduced, step: FloatArray
) -> tuple[FloatArray, float]:
    """The step of the eliminated points (p,3) for an expanded step (e,), and the linear model's cost after it."""
    layout = problem.layout
    point_step = np.zeros((problem.n_points, 3))
    kept = problem.kept_points
    if len(kept):
        start = layout.block_offset[problem.n_cameras + problem.n_placements]
        point_step[kept] = step[start:].reshape(-1, 3)
    is_kept = np.zeros(problem.n_points, dtype=bool)
    is_kept[kept] = True
    cost = _back_substitute(
        problem.camera, _placement(problem), problem.n_cameras, problem.point_start, is_kept,
        linear.residual, linear.by_camera, linear.by_point, _by_placement(linear), layout.block_offset,
        reduced.point_inverse, reduced.point_gradient, step, point_step,
    )  # fmt: skip
    point_step[kept] = 0.0
    return point_step, cost


_NO_PLACEMENT = np.zeros(0, dtype=np.int64)
_NO_ROTATION, _NO_TRANSLATION, _NO_ROWS = np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 2, POSE))


def _placement(problem: Problem) -> IntArray:
    return _NO_PLACEMENT if problem.placement is None else problem.placement


def _placement_poses(state: State) -> tuple[FloatArray, FloatArray]:
    if state.placement_rotation is None or state.placement_translation is None:
        return _NO_ROTATION, _NO_TRANSLATION
    return state.placement_rotation, state.placement_translation


def _by_placement(linear: Linearisation) -> FloatArray:
    return _NO_ROWS if linear.by_placement is None else linear.by_placement


@njit(**KERNEL_PART)
def _to_camera(k, camera, point, placement, rotation, translation, placement_rotation, placement_translation, points):
    """Observation k's point in its camera's frame, in the world, and turned about the ball's origin."""
    p, c = points[point[k]], camera[k]
    tx, ty, tz = p[0], p[1], p[2]
    wx, wy, wz = tx, ty, tz
    if len(placement) > 0:
        t = placement[k]
        q, s = placement_rotation[t], placement_translation[t]
        tx = q[0, 0] * p[0] + q[0, 1] * p[1] + q[0, 2] * p[2]
        ty = q[1, 0] * p[0] + q[1, 1] * p[1] + q[1, 2] * p[2]
        tz = q[2, 0] * p[0] + q[2, 1] * p[1] + q[2, 2] * p[2]
        wx, wy, wz = tx + s[0], ty + s[1], tz + s[2]
    r, d = rotation[c], translation[c]
    x = r[0, 0] * wx + r[0, 1] * wy + r[0, 2] * wz + d[0]
    y = r[1, 0] * wx + r[1, 1] * wy + r[1, 2] * wz + d[1]
    z = r[2, 0] * wx + r[2, 1] * wy + r[2, 2] * wz + d[2]
    return x, y, z, tx, ty, tz


@njit(**KERNEL)
def _residuals(
    camera, point, placement, uv, weight,
    rotation, translation, intrinsics, placement_rotation, placement_translation, points, out,
):  # fmt: skip
    for k in range(len(camera)):
        xc, yc, zc, _, _, _ = _to_camera(
            k, camera, point, placement, rotation, translation, placement_rotation, placement_translation, points
        )
        i = intrinsics[camera[k]]
        x, y = xc / zc, yc / zc
        r2 = x * x + y * y
        if i[15] == FISHEYE_MARK:
            radial, _, _, _ = _fisheye_radial(r2, i)
            xd, yd = x * radial, y * radial
        else:
            radial = (1 + r2 * (i[4] + r2 * (i[5] + r2 * i[8]))) / (1 + r2 * (i[9] + r2 * (i[10] + r2 * i[11])))
            xd = x * radial + 2 * i[6] * x * y + i[7] * (r2 + 2 * x * x) + r2 * (i[12] + r2 * i[13])
            yd = y * radial + i[6] * (r2 + 2 * y * y) + 2 * i[7] * x * y + r2 * (i[14] + r2 * i[15])
        out[k, 0] = (i[0] * xd + i[2] - uv[k, 0]) * weight[k, 0]
        out[k, 1] = (i[1] * yd + i[3] - uv[k, 1]) * weight[k, 1]


@njit(**KERNEL_PART)
def _fisheye_radial(r2, i):
    """geometry/fisheye.py `radial_with_slope` of one point, and theta^2."""
    if r2 < AXIS_R2:
        return 1.0, i[4] - 1 / 3, r2, r2
    r = np.sqrt(r2)
    theta = np.arctan(r)
    t2 = theta * theta
    radial = theta / r * (1 + t2 * (i[4] + t2 * (i[5] + t2 * (i[6] + t2 * i[7]))))
    rise = 1 + t2 * (3 * i[4] + t2 * (5 * i[5] + t2 * (7 * i[6] + t2 * 9 * i[7])))
    return radial, (rise / (1 + r2) - radial) / (2 * r2), t2 * theta / r, t2


@njit(**KERNEL_PART)
def _fisheye_terms(x, y, r2, iz, wu, wv, i, a, d):
    """Distorted point; fills derivatives by the point's x, y in `a` and by the distortion in `d`, weighted."""
    radial, slope, factor, t2 = _fisheye_radial(r2, i)
    fu, fv = wu * i[0], wv * i[1]
    a[0, 0] = fu * iz * (radial + 2 * x * x * slope)
    a[0, 1] = fu * iz * 2 * x * y * slope
    a[1, 0] = fv * iz * 2 * x * y * slope
    a[1, 1] = fv * iz * (radial + 2 * y * y * slope)
    d[:, 8:] = 0.0
    for j in range(4, 8):
        d[0, j], d[1, j] = fu * x * factor, fv * y * factor
        factor *= t2
    return x * radial, y * radial


@njit(**KERNEL)
def _linearise(
    camera, point, placement, uv, weight,
    rotation, translation, intrinsics, placement_rotation, placement_translation, points,
    columns, residual, by_camera, by_point, by_placement,
):  # fmt: skip
    a = np.empty((2, 3))  # by the point in the camera's frame, weighted
    d = np.zeros((2, 16))  # by the intrinsics, weighted
    for k in range(len(camera)):
        c = camera[k]
        xc, yc, zc, tx, ty, tz = _to_camera(
            k, camera, point, placement, rotation, translation, placement_rotation, placement_translation, points
        )
        i = intrinsics[c]
        iz = 1.0 / zc
        x, y = xc * iz, yc * iz
        r2 = x * x + y * y
        wu, wv = weight[k, 0], weight[k, 1]
        if i[15] == FISHEYE_MARK:
            xd, yd = _fisheye_terms(x, y, r2, iz, wu, wv, i, a, d)
        else:
            r4 = r2 * r2
            r6 = r4 * r2
            iden = 1 / (1 + i[9] * r2 + i[10] * r4 + i[11] * r6)
            radial = (1 + i[4] * r2 + i[5] * r4 + i[8] * r6) * iden
            slope = (i[4] + 2 * i[5] * r2 + 3 * i[8] * r4 - radial * (i[9] + 2 * i[10] * r2 + 3 * i[11] * r4)) * iden
            xd = x * radial + 2 * i[6] * x * y + i[7] * (r2 + 2 * x * x) + i[12] * r2 + i[13] * r4
            yd = y * radial + i[6] * (r2 + 2 * y * y) + 2 * i[7] * x * y + i[14] * r2 + i[15] * r4
            prism_x, prism_y = 2 * (i[12] + 2 * i[13] * r2), 2 * (i[14] + 2 * i[15] * r2)
            cross = 2 * x * y * slope + 2 * i[6] * x + 2 * i[7] * y
            fu, fv = wu * i[0], wv * i[1]
            a[0, 0] = fu * iz * (radial + 2 * x * x * slope + 2 * i[6] * y + 6 * i[7] * x + x * prism_x)
            a[0, 1] = fu * iz * (cross + y * prism_x)
            a[1, 0] = fv * iz * (cross + x * prism_y)
            a[1, 1] = fv * iz * (radial + 2 * y * y * slope + 6 * i[6] * y + 2 * i[7] * x + y * prism_y)

            ux, vy = fu * x * iden, fv * y * iden
            d[0, 4], d[1, 4] = ux * r2, vy * r2
            d[0, 5], d[1, 5] = ux * r4, vy * r4
            d[0, 8], d[1, 8] = ux * r6, vy * r6
            d[0, 9], d[1, 9] = -ux * radial * r2, -vy * radial * r2
            d[0, 10], d[1, 10] = -ux * radial * r4, -vy * radial * r4
            d[0, 11], d[1, 11] = -ux * radial * r6, -vy * radial * r6
            d[0, 6], d[1, 6] = fu * 2 * x * y, fv * (r2 + 2 * y * y)
            d[0, 7], d[1, 7] = fu * (r2 + 2 * x * x), fv * 2 * x * y
            d[0, 12], d[0, 13] = fu * r2, fu * r4
            d[1, 14], d[1, 15] = fv * r2, fv * r4
        a[0, 2] = -(a[0, 0] * x + a[0, 1] * y)
        a[1, 2] = -(a[1, 0] * x + a[1, 1] * y)
        residual[k, 0] = (i[0] * xd + i[2] - uv[k, 0]) * wu
        residual[k, 1] = (i[1] * yd + i[3] - uv[k, 1]) * wv
        d[0, 0], d[1, 1], d[0, 2], d[1, 3] = wu * xd, wv * yd, wu, wv

        r = rotation[c]
        for e in range(2):
            by_camera[k, e, 0] = a[e, 2] * yc - a[e, 1] * zc
            by_camera[k, e, 1] = a[e, 0] * zc - a[e, 2] * xc
            by_camera[k, e, 2] = a[e, 1] * xc - a[e, 0] * yc
            for j in range(3):
                by_camera[k, e, 3 + j] = a[e, j]
            for j in range(len(columns)):
                by_camera[k, e, 6 + j] = d[e, columns[j]]
            wx = a[e, 0] * r[0, 0] + a[e, 1] * r[1, 0] + a[e, 2] * r[2, 0]
            wy = a[e, 0] * r[0, 1] + a[e, 1] * r[1, 1] + a[e, 2] * r[2, 1]
            wz = a[e, 0] * r[0, 2] + a[e, 1] * r[1, 2] + a[e, 2] * r[2, 2]
            if len(placement) == 0:
                by_point[k, e, 0], by_point[k, e, 1], by_point[k, e, 2] = wx, wy, wz
            else:
                q = placement_rotation[placement[k]]
                for j in range(3):
                    by_point[k, e, j] = wx * q[0, j] + wy * q[1, j] + wz * q[2, j]
                by_placement[k, e, 0] = wz * ty - wy * tz
                by_placement[k, e, 1] = wx * tz - wz * tx
                by_placement[k, e, 2] = wy * tx - wx * ty
                by_placement[k, e, 3], by_placement[k, e, 4], by_placement[k, e, 5] = wx, wy, wz


@njit(**KERNEL_PART)
def _inverse_damped(v, damping, out):
    """Inverse of a symmetric 3x3 matrix whose diagonal is multiplied by 1 + damping."""
    f = 1.0 + damping
    a, b, c, d, e, g = v[0, 0] * f, v[0, 1], v[0, 2], v[1, 1] * f, v[1, 2], v[2, 2] * f
    m00, m01, m02 = d * g - e * e, c * e - b * g, b * e - c * d
    det = a * m00 + b * m01 + c * m02
    inv = 1.0 / det
    out[0, 0], out[0, 1], out[0, 2] = m00 * inv, m01 * inv, m02 * inv
    out[1, 0], out[1, 1], out[1, 2] = m01 * inv, (a * g - c * c) * inv, (b * c - a * e) * inv
    out[2, 0], out[2, 1], out[2, 2] = m02 * inv, (b * c - a * e) * inv, (a * d - b * b) * inv


@njit(**KERNEL_PART)
def _add_square(square, rows):
    """square += rows' rows of an observation's two; all of it, as loops of even length vectorise, triangles do not."""
    for i in range(rows.shape[1]):
        a0, a1 = rows[0, i], rows[1, i]
        for j in range(rows.shape[1]):
            square[i, j] += a0 * rows[0, j] + a1 * rows[1, j]


@njit(**KERNEL_PART)
def _weigh(weighted, coupling, at, inverse, size):
    """weighted = V^-1 W' (3, size), both from place `at` on."""
    one, two = at + size, at + 2 * size
    for j in range(3):
        v0, v1, v2 = inverse[j, 0], inverse[j, 1], inverse[j, 2]
        own = at + j * size
        for i in range(size):
            weighted[own + i] = v0 * coupling[at + i] + v1 * coupling[one + i] + v2 * coupling[two + i]


@njit(**KERNEL_PART)
def _flush(matrix, weighted, coupling, n_rows, size, blocks, n_blocks, offset, width):
    """Subtract W V^-1 W' of all points of a run, which meet the same blocks, from the reduced matrix."""
    if n_rows == 0:
        return
    if n_rows == 3:
        _subtract_point(matrix, weighted, coupling, size, blocks, n_blocks, offset, width)
        return
    product = np.dot(weighted[: n_rows * size].reshape(n_rows, size).T, coupling[: n_rows * size].reshape(n_rows, size))
    left = 0
    for s in range(n_blocks):
        a = blocks[s]
        right = left
        for t in range(s, n_blocks):
            b = blocks[t]
            for i in range(width[a]):
                if offset[a] <= offset[b]:  # only the upper block triangle is filled
                    for j in range(width[b]):
                        matrix[offset[a] + i, offset[b] + j] -= product[left + i, right + j]
                else:
                    for j in range(width[b]):
                        matrix[offset[b] + j, offset[a] + i] -= product[left + i, right + j]
            right += width[b]
        left += width[a]


@njit(**KERNEL_PART)
def _subtract_point(matrix, weighted, coupling, size, blocks, n_blocks, offset, width):
    """The same of a single point, for which a matrix product costs more than it saves."""
    left = 0
    for s in range(n_blocks):
        a = blocks[s]
        right = left
        for t in range(s, n_blocks):
            b = blocks[t]
            # V^-1 is symmetric, so either side may be the weighted one
            row, column, i0, j0 = (a, b, left, right) if offset[a] <= offset[b] else (b, a, right, left)
            for i in range(width[row]):
                w0, w1, w2 = weighted[i0 + i], weighted[size + i0 + i], weighted[2 * size + i0 + i]
                target = matrix[offset[row] + i]
                for j in range(width[column]):
                    k = j0 + j
                    target[offset[column] + j] -= (
                        w0 * coupling[k] + w1 * coupling[size + k] + w2 * coupling[2 * size + k]
                    )
            right += width[b]
        left += width[a]


# Points that are eliminated by one matrix product; more than 64 gain nothing.
_RUN = 64


@njit(**KERNEL_PART)
def _meet(begin, end, camera, placement, n_cameras, lens, width, place, blocks):
    """Lists the blocks that meet a point and gives each its first column; returns how many, and all their columns."""
    size, n_blocks = 0, 0
    for k in range(begin, end):
        for kind in range(3):
            if kind == 0:
                b = camera[k]
            elif kind == 1:
                b = lens[camera[k]]
            else:
                b = n_cameras + placement[k] if len(placement) > 0 else -1
            if b >= 0 and place[b] < 0:
                place[b] = size
                blocks[n_blocks] = b
                n_blocks += 1
                size += width[b]
    return n_blocks, size


@njit(**KERNEL_PART)
def _equal(blocks, n_blocks, run, n_run):
    if n_blocks != n_run:
        return False
    for s in range(n_blocks):  # noqa: SIM110 - generators cannot be compiled
        if blocks[s] != run[s]:
            return False
    return True


@njit(**KERNEL_PART)
def _add_block(rows, begin, end, r0, r1, by_point, coupling, first, size, gradient, column):
    """Columns begin to end of an observation's rows: their share in the gradient and in the point's coupling W'."""
    p00, p01, p02 = by_point[0, 0], by_point[0, 1], by_point[0, 2]
    p10, p11, p12 = by_point[1, 0], by_point[1, 1], by_point[1, 2]
    for i in range(end - begin):
        x0, x1 = rows[0, begin + i], rows[1, begin + i]
        gradient[column + i] += x0 * r0 + x1 * r1
        coupling[first + i] += p00 * x0 + p10 * x1
        coupling[first + size + i] += p01 * x0 + p11 * x1
        coupling[first + 2 * size + i] += p02 * x0 + p12 * x1


@njit(**KERNEL_PART)
def _add_rows(matrix, rows, begin, end, pose, first, column):
    """matrix[first.., column..] += columns begin to end of an observation's rows, times its rows by the placement."""
    for i in range(end - begin):
        for j in range(POSE):
            matrix[first + i, column + j] += rows[0, begin + i] * pose[0, j] + rows[1, begin + i] * pose[1, j]


@njit(**KERNEL_PART)
def _add_point(v, g, by_point, r0, r1):
    """One observation's share in its point's own normal equations."""
    for i in range(3):
        g[i] += by_point[0, i] * r0 + by_point[1, i] * r1
        for j in range(3):
            v[i, j] += by_point[0, i] * by_point[0, j] + by_point[1, i] * by_point[1, j]


@njit(**KERNEL)
def _reduce(
    order, camera, placement, n_cameras, point_start, kept_block,
    residual, by_camera, by_point, by_placement, offset, width, lens, damping,
    matrix, gradient, diagonal, inverse, point_gradient,
):  # fmt: skip
    """Points in the given order; runs of neighbours that meet the same blocks are eliminated together."""
    n_all = len(offset)
    square = np.zeros((n_all, by_camera.shape[2], by_camera.shape[2]))  # a camera's with its lens, shared or not
    place = np.full(n_all, -1)  # a block's first column among those that meet the present point
    blocks, run = np.empty(n_all, dtype=np.int64), np.empty(n_all, dtype=np.int64)
    n_run, run_size, run_rows = 0, 0, 0
    most = _most_columns(camera, placement, n_cameras, point_start, lens, width, place)
    coupling, weighted = np.empty(3 * _RUN * most), np.empty(3 * _RUN * most)
    v = np.empty((3, 3))
    for p in order:
        begin, end = point_start[p], point_start[p + 1]
        n_blocks, size = _meet(begin, end, camera, placement, n_cameras, lens, width, place, blocks)
        if run_rows == 3 * _RUN or not _equal(blocks, n_blocks, run, n_run):
            _flush(matrix, weighted, coupling, run_rows, run_size, run, n_run, offset, width)
            for s in range(n_blocks):
                run[s] = blocks[s]
            n_run, run_size, run_rows = n_blocks, size, 0
        at = run_rows * size  # where the point's W' begins
        for i in range(at, at + 3 * size):
            coupling[i] = 0.0
        v[:] = 0.0
        g = point_gradient[p]
        for k in range(begin, end):
            c, jp, r0, r1 = camera[k], by_point[k], residual[k, 0], residual[k, 1]
            rows = by_camera[k]
            _add_square(square[c], rows)
            split, shared = width[c], lens[c]  # behind the split a lens that other cameras share
            _add_block(rows, 0, split, r0, r1, jp, coupling, at + place[c], size, gradient, offset[c])
            if shared >= 0:
                _add_block(
                    rows, split, rows.shape[1], r0, r1, jp, coupling, at + place[shared], size, gradient, offset[shared]
                )  # fmt: skip
            if len(placement) > 0:
                t, pose = n_cameras + placement[k], by_placement[k]
                _add_square(square[t], pose)
                _add_block(pose, 0, POSE, r0, r1, jp, coupling, at + place[t], size, gradient, offset[t])
                _add_rows(matrix, rows, 0, split, pose, offset[c], offset[t])
                if shared >= 0:
                    _add_rows(matrix, rows, split, rows.shape[1], pose, offset[shared], offset[t])
            _add_point(v, g, jp, r0, r1)
        if kept_block[p] >= 0:
            _keep_point(
                matrix, gradient, diagonal, offset, width, kept_block[p], v, g, blocks, n_blocks, coupling[at:], size
            )  # fmt: skip
        else:
            _inverse_damped(v, damping, inverse[p])
            _weigh(weighted, coupling, at, inverse[p], size)
            _subtract_gradient(gradient, weighted, at, size, g, blocks, n_blocks, offset, width)
            run_rows += 3
        for s in range(n_blocks):
            place[blocks[s]] = -1
    _flush(matrix, weighted, coupling, run_rows, run_size, run, n_run, offset, width)
    _add_squares(matrix, diagonal, square, offset, width, lens)


@njit(**KERNEL_PART)
def _subtract_gradient(gradient, weighted, at, size, g, blocks, n_blocks, offset, width):
    """gradient -= W V^-1 g of one point."""
    first, g0, g1, g2 = at, g[0], g[1], g[2]
    for s in range(n_blocks):
        b = blocks[s]
        for i in range(width[b]):
            j = first + i
            gradient[offset[b] + i] -= weighted[j] * g0 + weighted[size + j] * g1 + weighted[2 * size + j] * g2
        first += width[b]


@njit(**KERNEL_PART)
def _add_squares(matrix, diagonal, square, offset, width, lens):
    """The blocks' own normal equations go onto the matrix's diagonal; their diagonal is what damping multiplies."""
    for b in range(len(offset)):
        for i in range(width[b]):
            diagonal[offset[b] + i] += square[b, i, i]
            for j in range(width[b]):
                matrix[offset[b] + i, offset[b] + j] += square[b, i, j]
    for c in range(len(lens)):
        if lens[c] < 0:
            continue
        first, split = offset[lens[c]], width[c]
        for i in range(width[lens[c]]):
            diagonal[first + i] += square[c, split + i, split + i]
            for j in range(width[lens[c]]):
                matrix[first + i, first + j] += square[c, split + i, split + j]
            for j in range(split):
                if offset[c] <= first:
                    matrix[offset[c] + j, first + i] += square[c, j, split + i]
                else:
                    matrix[first + i, offset[c] + j] += square[c, split + i, j]


@njit(**KERNEL_PART)
def _most_columns(camera, placement, n_cameras, point_start, lens, width, place):
    """The largest number of columns that meet in one point."""
    most = 0
    for p in range(len(point_start) - 1):
        columns = 0
        for k in range(point_start[p], point_start[p + 1]):
            for kind in range(3):
                if kind == 0:
                    b = camera[k]
                elif kind == 1:
                    b = lens[camera[k]]
                else:
                    b = n_cameras + placement[k] if len(placement) > 0 else -1
                if b >= 0 and place[b] != p:
                    place[b] = p
                    columns += width[b]
        most = max(most, columns)
    place[:] = -1
    return most


@njit(**KERNEL_PART)
def _keep_point(matrix, gradient, diagonal, offset, width, kept, v, g, blocks, n_blocks, coupling, size):
    """A point of a length row stays: its own block and its coupling go into the reduced system."""
    column = offset[kept]
    for j in range(3):
        gradient[column + j] += g[j]
        diagonal[column + j] += v[j, j]
        for i in range(3):
            matrix[column + i, column + j] += v[i, j]
    first = 0
    for s in range(n_blocks):
        b = blocks[s]
        for i in range(width[b]):
            for j in range(3):
                matrix[offset[b] + i, column + j] += coupling[j * size + first + i]
        first += width[b]


@njit(**KERNEL)
def _back_substitute(
    camera, placement, n_cameras, point_start, is_kept,
    residual, by_camera, by_point, by_placement, offset, inverse, point_gradient, step, point_step,
):  # fmt: skip
    widest = by_camera.shape[2]
    longest = 0
    for p in range(len(point_start) - 1):
        longest = max(longest, point_start[p + 1] - point_start[p])
    change = np.empty((longest, 2))
    cost = 0.0
    for p in range(len(point_start) - 1):
        begin, end = point_start[p], point_start[p + 1]
        g0, g1, g2 = point_gradient[p]
        for k in range(begin, end):
            first = offset[camera[k]]
            d0, d1 = residual[k, 0], residual[k, 1]
            for i in range(widest):
                d0 += by_camera[k, 0, i] * step[first + i]
                d1 += by_camera[k, 1, i] * step[first + i]
            if len(placement) > 0:
                first = offset[n_cameras + placement[k]]
                for i in range(6):
                    d0 += by_placement[k, 0, i] * step[first + i]
                    d1 += by_placement[k, 1, i] * step[first + i]
            change[k - begin, 0], change[k - begin, 1] = d0, d1
            d0, d1 = d0 - residual[k, 0], d1 - residual[k, 1]
            g0 += by_point[k, 0, 0] * d0 + by_point[k, 1, 0] * d1
            g1 += by_point[k, 0, 1] * d0 + by_point[k, 1, 1] * d1
            g2 += by_point[k, 0, 2] * d0 + by_point[k, 1, 2] * d1
        s = point_step[p]
        if not is_kept[p]:
            v = inverse[p]
            s[0] = -(v[0, 0] * g0 + v[0, 1] * g1 + v[0, 2] * g2)
            s[1] = -(v[1, 0] * g0 + v[1, 1] * g1 + v[1, 2] * g2)
            s[2] = -(v[2, 0] * g0 + v[2, 1] * g1 + v[2, 2] * g2)
        for k in range(begin, end):
            for e in range(2):
                value = change[k - begin, e]
                for j in range(3):
                    value += by_point[k, e, j] * s[j]
                cost += value * value
    return 0.5 * cost
