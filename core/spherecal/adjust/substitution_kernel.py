"""The step back from the reduced system to the eliminated points, compiled."""

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
    widest = by_camera.shape[2]
    longest = 0
    for n in range(len(part.points)):
        longest = max(longest, part.end[n] - part.begin[n])
    change = np.empty((longest, 2))
    for n in range(len(part.points)):
        p, begin, end = part.points[n], part.begin[n], part.end[n]
        g0, g1, g2 = reduced.point_gradient[p]
        for k in range(begin, end):
            first = offset[part.camera[k]]
            d0, d1 = residual[k, 0], residual[k, 1]
            for i in range(widest):
                d0 += by_camera[k, 0, i] * step[first + i]
                d1 += by_camera[k, 1, i] * step[first + i]
            if len(part.placement) > 0:
                first = offset[n_cameras + part.placement[k]]
                for i in range(POSE):
                    d0 += by_placement[k, 0, i] * step[first + i]
                    d1 += by_placement[k, 1, i] * step[first + i]
            change[k - begin, 0], change[k - begin, 1] = d0, d1
            d0, d1 = d0 - residual[k, 0], d1 - residual[k, 1]
            g0 += by_point[k, 0, 0] * d0 + by_point[k, 1, 0] * d1
            g1 += by_point[k, 0, 1] * d0 + by_point[k, 1, 1] * d1
            g2 += by_point[k, 0, 2] * d0 + by_point[k, 1, 2] * d1
        s = point_step[p]
        if not is_kept[p]:
            v = reduced.point_inverse[p]
            s[0] = -(v[0, 0] * g0 + v[0, 1] * g1 + v[0, 2] * g2)
            s[1] = -(v[1, 0] * g0 + v[1, 1] * g1 + v[1, 2] * g2)
            s[2] = -(v[2, 0] * g0 + v[2, 1] * g1 + v[2, 2] * g2)
        for k in range(begin, end):
            for e in range(2):
                value = change[k - begin, e]
                for j in range(3):
                    value += by_point[k, e, j] * s[j]
                squares += value * value
    return squares
