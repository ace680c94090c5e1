"""The step back from the reduced system to the points that were eliminated, compiled."""

import numpy as np

from spherecal.adjust.kernel import KERNEL
from spherecal.adjust.parameter_layout import POSE
from spherecal.base.kernels import njit


@njit(**KERNEL)
def substitute_points(part, is_kept, offset, n_cameras, reduced, step, point_step, squares):
    """Fill the points' step for a step of the reduced system; returns `squares` and those that both leave.

    `part`: a `PointBlock`; `is_kept`: which points are in the reduced system, (p,); `offset`: first column of each
    block, (b,); `reduced`: what the elimination left; `step`, `point_step`: of the reduced system (e,), of the points
    (p,3).
    """
    residual, by_camera, by_point, by_placement = part.linear
    change, g = np.empty_like(residual), np.empty(3)
    for n in range(len(part.points)):
        p, begin, end = part.points[n], part.begin[n], part.end[n]
        g[:] = reduced.point_gradient[p]
        for k in range(begin, end):
            d0, d1 = residual[k, 0], residual[k, 1]
            first = offset[part.camera[k]]
            for i in range(by_camera.shape[2]):
                d0 += by_camera[k, 0, i] * step[first + i]
                d1 += by_camera[k, 1, i] * step[first + i]
            if len(part.placement) > 0:
                first = offset[n_cameras + part.placement[k]]
                for i in range(POSE):
                    d0 += by_placement[k, 0, i] * step[first + i]
                    d1 += by_placement[k, 1, i] * step[first + i]
            change[k, 0], change[k, 1] = d0, d1
            for j in range(3):
                g[j] += by_point[k, 0, j] * (d0 - residual[k, 0]) + by_point[k, 1, j] * (d1 - residual[k, 1])
        s = point_step[p]
        if not is_kept[p]:
            v = reduced.point_inverse[p]
            for i in range(3):
                s[i] = -(v[i, 0] * g[0] + v[i, 1] * g[1] + v[i, 2] * g[2])
        for k in range(begin, end):
            for e in range(2):
                value = change[k, e]
                for j in range(3):
                    value += by_point[k, e, j] * s[j]
                squares += value * value
    return squares
