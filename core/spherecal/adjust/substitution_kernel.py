"""The step back from the reduced system to the points that were eliminated, compiled."""

import numpy as np

from spherecal.adjust.kernel import INNER, KERNEL
from spherecal.adjust.parameter_layout import POSE
from spherecal.base.kernels import njit


@njit(**INNER)
def change_of_row(k, part, offset, n_cameras, step):
    """Residuals of row k after a step of the reduced system."""
    linear = part.linear
    d0, d1 = linear.residual[k, 0], linear.residual[k, 1]
    first = offset[part.camera[k]]
    for i in range(linear.by_camera.shape[2]):
        d0 += linear.by_camera[k, 0, i] * step[first + i]
        d1 += linear.by_camera[k, 1, i] * step[first + i]
    if len(part.placement) > 0:
        first = offset[n_cameras + part.placement[k]]
        for i in range(POSE):
            d0 += linear.by_placement[k, 0, i] * step[first + i]
            d1 += linear.by_placement[k, 1, i] * step[first + i]
    return d0, d1


@njit(**INNER)
def add_change(by_point, k, d0, d1, out):
    """out += the derivatives of row k by its point times a change (2,) of its residuals."""
    for j in range(3):
        out[j] += by_point[k, 0, j] * d0 + by_point[k, 1, j] * d1


@njit(**INNER)
def step_point(step, v, g0, g1, g2):
    """The step of an eliminated point from the inverse of its V and its gradient."""
    step[0] = -(v[0, 0] * g0 + v[0, 1] * g1 + v[0, 2] * g2)
    step[1] = -(v[1, 0] * g0 + v[1, 1] * g1 + v[1, 2] * g2)
    step[2] = -(v[2, 0] * g0 + v[2, 1] * g1 + v[2, 2] * g2)


@njit(**KERNEL)
def substitute_points(part, is_kept, offset, n_cameras, reduced, step, point_step, squares):
    """Fill the points' step for a step of the reduced system; returns `squares` and those that both leave.

    `part`: a `PointBlock`; `is_kept`: which points are in the reduced system, (p,); `offset`: first column of each
    block, (b,); `reduced`: what the elimination left; `step`, `point_step`: of the reduced system (e,), of the points
    (p,3).
    """
    residual, by_point = part.linear.residual, part.linear.by_point
    change, g = np.empty_like(residual), np.empty(3)
    for n in range(len(part.points)):
        p, begin, end = part.points[n], part.begin[n], part.end[n]
        g[:] = reduced.point_gradient[p]
        for k in range(begin, end):
            d0, d1 = change_of_row(k, part, offset, n_cameras, step)
            change[k, 0], change[k, 1] = d0, d1
            add_change(by_point, k, d0 - residual[k, 0], d1 - residual[k, 1], g)
        if not is_kept[p]:
            step_point(point_step[p], reduced.point_inverse[p], g[0], g[1], g[2])
        s = point_step[p]
        for k in range(begin, end):
            for e in range(2):
                value = change[k, e]
                for j in range(3):
                    value += by_point[k, e, j] * s[j]
                squares += value * value
    return squares
