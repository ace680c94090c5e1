"""The step back from the reduced system to the eliminated points, compiled."""

import numpy as np
from numba import njit

from spherecal.adjust.kernel import INNER, KERNEL
from spherecal.adjust.layout import POSE


@njit(**INNER)
def change_of_row(k, camera, placement, n_cameras, by_camera, by_placement, offset, step, d0, d1):
    """Residuals d0, d1 of row k after a step of the reduced system."""
    first = offset[camera[k]]
    for i in range(by_camera.shape[2]):
        d0 += by_camera[k, 0, i] * step[first + i]
        d1 += by_camera[k, 1, i] * step[first + i]
    if len(placement) > 0:
        first = offset[n_cameras + placement[k]]
        for i in range(POSE):
            d0 += by_placement[k, 0, i] * step[first + i]
            d1 += by_placement[k, 1, i] * step[first + i]
    return d0, d1


@njit(**INNER)
def add_squares_after(begin, end, by_point, step, change, squares):
    """Returns `squares` and those of residuals (in `change`) after their point's step."""
    for k in range(begin, end):
        for e in range(2):
            value = change[k - begin, e]
            for j in range(3):
                value += by_point[k, e, j] * step[j]
            squares += value * value
    return squares


@njit(**INNER)
def step_point(step, v, g0, g1, g2):
    """The step of an eliminated point from the inverse of its V and its gradient."""
    step[0] = -(v[0, 0] * g0 + v[0, 1] * g1 + v[0, 2] * g2)
    step[1] = -(v[1, 0] * g0 + v[1, 1] * g1 + v[1, 2] * g2)
    step[2] = -(v[2, 0] * g0 + v[2, 1] * g1 + v[2, 2] * g2)


@njit(**INNER)
def most_rows(begins, ends):
    """The largest number of rows of a point."""
    longest = 0
    for n in range(len(begins)):
        longest = max(longest, ends[n] - begins[n])
    return longest


@njit(**KERNEL)
def substitute_points(
    points, begins, ends, camera, placement, n_cameras, is_kept,
    residual, by_camera, by_point, by_placement, offset, inverse, point_gradient, step, point_step, squares,
):  # fmt: skip
    """Fills the points' step for a step of the reduced system; returns `squares` and those that both leave."""
    change = np.empty((most_rows(begins, ends), 2))
    for n in range(len(points)):
        p, begin, end = points[n], begins[n], ends[n]
        g0, g1, g2 = point_gradient[p]
        for k in range(begin, end):
            d0, d1 = change_of_row(
                k, camera, placement, n_cameras, by_camera, by_placement, offset, step, residual[k, 0], residual[k, 1]
            )
            change[k - begin, 0], change[k - begin, 1] = d0, d1
            d0, d1 = d0 - residual[k, 0], d1 - residual[k, 1]
            g0 += by_point[k, 0, 0] * d0 + by_point[k, 1, 0] * d1
            g1 += by_point[k, 0, 1] * d0 + by_point[k, 1, 1] * d1
            g2 += by_point[k, 0, 2] * d0 + by_point[k, 1, 2] * d1
        if not is_kept[p]:
            step_point(point_step[p], inverse[p], g0, g1, g2)
        squares = add_squares_after(begin, end, by_point, point_step[p], change, squares)
    return squares
