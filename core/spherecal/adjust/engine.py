"""The adjustment's inner stages compiled by numba: residuals, linearisation, elimination of points.

linear_model -> reduce -> back_substitute. The kernels of the elimination are in `schur_kernel`. The same
functions in plain numpy, to which these are equal to 1e-9, are in `tests/reference_engine.py`.
"""

from typing import NamedTuple

import numpy as np

from spherecal.adjust import dense_elimination, linear
from spherecal.adjust.ball_model import Deformable
from spherecal.adjust.deformable_kernel import eliminate_places
from spherecal.adjust.kernel import BARE, INNER
from spherecal.adjust.linear import Blocks, Linear, Linearisation, PointEquations, Reduced, point_blocks
from spherecal.adjust.parameter_layout import POSE, Layout
from spherecal.adjust.problem import Problem
from spherecal.adjust.schur_kernel import add_squares, eliminate_points
from spherecal.adjust.state import State
from spherecal.adjust.substitution_kernel import substitute_points
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.kernels import njit
from spherecal.geometry.camera import FISHEYE_MARK
from spherecal.geometry.fisheye import AXIS_R2


def residuals(problem: Problem, state: State) -> FloatArray:
    """Weighted residuals, predicted minus observed over sigma, (n,2)."""
    out = np.empty_like(problem.uv)
    _residuals(_observed(problem, problem.weight), _unknowns(state), out)
    return out


def linearise(problem: Problem, state: State, robust_weight: FloatArray | None) -> Linearisation:
    """Residuals and derivatives at a state.

    `robust_weight`: multiplies the rows of each observation, (n,); None for 1.
    """
    n, width = len(problem.uv), POSE + len(problem.intrinsic_columns)
    weight = problem.weight if robust_weight is None else problem.weight * robust_weight[:, None]
    out = Linearisation(
        np.empty((n, 2)),
        np.empty((n, 2, width)),
        np.empty((n, 2, 3)),
        np.empty((n if problem.n_placements else 0, 2, POSE)),
    )
    by_axes, by_lens = np.empty((2, 3)), np.zeros((2, 16))
    _linearise(_observed(problem, weight), _unknowns(state), problem.intrinsic_columns, by_axes, by_lens, out)
    return out


def linear_model(problem: Problem, state: State, robust_weight: FloatArray | None) -> Linear:
    """What `reduce` and `back_substitute` work with: the linearisation, of large problems computed block by block."""
    return linear.linear_model(problem, state, robust_weight, linearise)


def reduce(problem: Problem, linear: Linear, damping: float, known: PointEquations | None = None) -> Reduced:
    """Normal equations with the points eliminated.

    The columns of intrinsics that cameras share are those of the first of these cameras.

    `known` None without any.
    """
    layout = problem.layout
    kept_block = np.full(problem.n_points, -1)
    kept_block[problem.kept_points] = problem.n_cameras + problem.n_placements + np.arange(len(problem.kept_points))
    is_dense = dense_elimination.is_dense(problem)
    reduced = Reduced(
        np.zeros((layout.expanded, layout.expanded)),
        np.zeros(layout.expanded),
        np.zeros(layout.expanded),
        np.zeros((problem.n_points, 3, 3)) if known is None else known.normal.copy(),
        np.zeros((problem.n_points, 3)) if known is None else known.gradient.copy(),
        is_gathered=not is_dense,
    )
    order, begins = problem.elimination_runs
    own_lenses = Blocks(layout.block_offset, layout.block_width, np.full(problem.n_cameras, -1))
    blocks = own_lenses if is_dense else _shared_lenses(layout, problem.n_cameras)
    square = np.zeros((len(blocks.offset), linear.width, linear.width))
    if is_dense:
        is_kept = kept_block[order] >= 0
        dense_elimination.eliminate(problem, linear, damping, order[~is_kept], blocks, reduced, square)
        order, begins = order[is_kept], np.ones(int(is_kept.sum()), dtype=bool)
    begins_run = np.zeros(problem.n_points, dtype=bool)
    begins_run[order[begins]] = True
    for part in point_blocks(problem, linear, order, begins):
        if not isinstance(problem.ball, Deformable):
            eliminate_points(part, begins_run, kept_block, blocks, damping, reduced, square)
        else:
            eliminate_places(part, kept_block, problem.ball.shape_sd, blocks, damping, reduced, square)
    add_squares(reduced, square, blocks)
    return reduced


def _shared_lenses(layout: Layout, n_cameras: int) -> Blocks:
    """The blocks of columns with another one, after all others, for each lens that several cameras share.

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
    return Blocks(offset, np.concatenate([width, layout.block_width[first] - POSE]), block)


def back_substitute(problem: Problem, linear: Linear, reduced: Reduced, step: FloatArray) -> tuple[FloatArray, float]:
    """The step of the eliminated points (p,3) for an expanded step (e,), and the linear model's cost after it.

    That of a deformable ball is `ShapeNoise.back_substitute`.
    """
    point_step, kept = np.zeros((problem.n_points, 3)), problem.kept_points
    point_step[kept] = step[len(step) - 3 * len(kept) :].reshape(-1, 3)
    is_kept = np.zeros(problem.n_points, dtype=bool)
    is_kept[kept] = True
    squares = 0.0
    for part in point_blocks(problem, linear, np.arange(problem.n_points)):
        squares = substitute_points(
            part, is_kept, problem.layout.block_offset, problem.n_cameras, reduced, step, point_step, squares
        )
    point_step[kept] = 0.0
    return point_step, 0.5 * squares


class _Observed(NamedTuple):
    """What the kernels read of a problem: camera, point and placement of each row (n,), pixels and weights (n,2)."""

    camera: IntArray
    point: IntArray
    placement: IntArray
    uv: FloatArray
    weight: FloatArray


class _Unknowns(NamedTuple):
    """What the kernels read of a state."""

    rotation: FloatArray
    translation: FloatArray
    intrinsics: FloatArray
    placement_rotation: FloatArray
    placement_translation: FloatArray
    points: FloatArray


def _observed(problem: Problem, weight: FloatArray) -> _Observed:
    return _Observed(problem.camera, problem.point, problem.placement, problem.uv, weight)


def _unknowns(s: State) -> _Unknowns:
    return _Unknowns(s.rotation, s.translation, s.intrinsics, s.placement_rotation, s.placement_translation, s.points)


@njit(**INNER)
def _to_camera(k, observed, unknowns):
    """Observation k's point in its camera's frame, in the world, and turned about the ball's origin."""
    p, c = unknowns.points[observed.point[k]], observed.camera[k]
    tx, ty, tz = p[0], p[1], p[2]
    wx, wy, wz = tx, ty, tz
    if len(observed.placement) > 0:
        t = observed.placement[k]
        q, s = unknowns.placement_rotation[t], unknowns.placement_translation[t]
        tx = q[0, 0] * p[0] + q[0, 1] * p[1] + q[0, 2] * p[2]
        ty = q[1, 0] * p[0] + q[1, 1] * p[1] + q[1, 2] * p[2]
        tz = q[2, 0] * p[0] + q[2, 1] * p[1] + q[2, 2] * p[2]
        wx, wy, wz = tx + s[0], ty + s[1], tz + s[2]
    r, d = unknowns.rotation[c], unknowns.translation[c]
    x = r[0, 0] * wx + r[0, 1] * wy + r[0, 2] * wz + d[0]
    y = r[1, 0] * wx + r[1, 1] * wy + r[1, 2] * wz + d[1]
    z = r[2, 0] * wx + r[2, 1] * wy + r[2, 2] * wz + d[2]
    return x, y, z, tx, ty, tz


@njit(**BARE)
def _residuals(observed, unknowns, out):
    uv, weight = observed.uv, observed.weight
    for k in range(len(uv)):
        xc, yc, zc, _, _, _ = _to_camera(k, observed, unknowns)
        i = unknowns.intrinsics[observed.camera[k]]
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


@njit(**INNER)
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


@njit(**INNER)
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


@njit(**BARE)
def _linearise(observed, unknowns, columns, a, d, out):
    """Fills `out`; `a` (2,3), `d` (2,16): working space, weighted derivatives by the camera's axes and intrinsics."""
    residual, by_camera, by_point, by_placement = out
    for k in range(len(observed.camera)):
        c = observed.camera[k]
        xc, yc, zc, tx, ty, tz = _to_camera(k, observed, unknowns)
        i = unknowns.intrinsics[c]
        iz = 1.0 / zc
        x, y = xc * iz, yc * iz
        r2 = x * x + y * y
        wu, wv = observed.weight[k, 0], observed.weight[k, 1]
        if i[15] == FISHEYE_MARK:
            xd, yd = _fisheye_terms(x, y, r2, iz, wu, wv, i, a, d)
        else:
            r4, r6 = r2 * r2, r2 * r2 * r2
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
        residual[k, 0] = (i[0] * xd + i[2] - observed.uv[k, 0]) * wu
        residual[k, 1] = (i[1] * yd + i[3] - observed.uv[k, 1]) * wv
        d[0, 0], d[1, 1], d[0, 2], d[1, 3] = wu * xd, wv * yd, wu, wv

        r = unknowns.rotation[c]
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
            if len(observed.placement) == 0:
                by_point[k, e, 0], by_point[k, e, 1], by_point[k, e, 2] = wx, wy, wz
            else:
                q = unknowns.placement_rotation[observed.placement[k]]
                for j in range(3):
                    by_point[k, e, j] = wx * q[0, j] + wy * q[1, j] + wz * q[2, j]
                by_placement[k, e, 0] = wz * ty - wy * tz
                by_placement[k, e, 1] = wx * tz - wz * tx
                by_placement[k, e, 2] = wy * tx - wx * ty
                by_placement[k, e, 3], by_placement[k, e, 4], by_placement[k, e, 5] = wx, wy, wz
