"""OpenCV's fisheye model (Kannala-Brandt, four coefficients): image radius as a polynomial in the angle off the axis.

The distorted point is (x, y) t_d / r, with r = tan t and

    t_d = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8).

Source: OpenCV, module calib3d, `cv::fisheye`; J. Kannala, S. Brandt, IEEE Trans. PAMI 28 (2006) 1335.
"""

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray

# Below this r^2 the quotients are replaced by their limits: the next terms of the series are below 1e-12.
AXIS_R2 = 1e-12
# Image points farther off the axis have no usable point at z = 1 (tan 89 deg = 57).
WIDEST = np.deg2rad(89.0)
_BRACKETS = 24  # of 3.7 degrees: within one of them the polynomial of a real lens turns at most once
_STEPS = 40  # Newton's need 4 to 6; halving alone would take 40 from 3.7 degrees to 1e-13
_TOLERANCE = 1e-14


def radial_with_slope(r2: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """theta_d / r, its derivative by r^2, and theta^3 / r, all shaped as r2."""
    k1, k2, k3, k4 = k
    near = r2 < AXIS_R2
    safe = np.where(near, 1.0, r2)
    r = np.sqrt(safe)
    theta = np.arctan(r)
    t2 = theta * theta
    radial = theta / r * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    rise = 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
    slope = (rise / (1 + safe) - radial) / (2 * safe)
    return np.where(near, 1.0, radial), np.where(near, k1 - 1 / 3, slope), np.where(near, r2, t2 * theta / r)


def distort(xy: FloatArray, k: FloatArray) -> FloatArray:
    """Normalised ideal image points (..., 2) to distorted ones."""
    r2 = (xy * xy).sum(axis=-1)
    return xy * radial_with_slope(r2, k)[0][..., None]


def distort_with_jacobian(xy: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distorted points (n, 2) and their derivatives (n, 2, 2) by ideal ones (n, 2); `k`: k1 to k4, (4, n) or (4, 1)."""
    radial, slope, _ = radial_with_slope((xy * xy).sum(axis=-1), k)
    jacobian = 2 * slope[:, None, None] * xy[:, :, None] * xy[:, None, :]
    jacobian[:, 0, 0] += radial
    jacobian[:, 1, 1] += radial
    return xy * radial[:, None], jacobian


def coefficient_derivatives(xy: FloatArray) -> FloatArray:
    """Derivatives (n, 2, 4) of the distorted points by k1..k4, the same for all lenses; xy (n, 2) ideal."""
    r2 = (xy * xy).sum(axis=-1)
    factor = radial_with_slope(r2, np.zeros((4, 1)))[2]
    t2 = np.arctan(np.sqrt(r2)) ** 2
    powers = factor[:, None] * t2[:, None] ** np.arange(4)
    return xy[:, :, None] * powers[:, None, :]


def undistort(distorted: FloatArray, k: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Normalised ideal points (n,2) of distorted ones, NaN with the flag False where there is none; k1 to k4 (n,4).

    The first root within 89 degrees off the axis, as long as theta_d rises up to it. It is bracketed by steps from the
    axis; Newton's steps are then kept within the bracket.
    """
    goal = np.sqrt((distorted * distorted).sum(axis=1))
    low, high, good = _bracket(goal, k)
    theta = np.clip(goal, low, high)
    for _ in range(_STEPS):
        value, rise = _angle(theta, k)
        error = value - goal
        low, high = np.where(error < 0, theta, low), np.where(error < 0, high, theta)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = theta - error / rise
        step = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        done = np.abs(step - theta) <= _TOLERANCE
        theta = step
        if (done | ~good).all():
            break
    good &= _angle(theta, k)[1] > 0
    factor = np.where(goal > 1e-9, np.tan(theta) / np.maximum(goal, 1e-9), 1.0)
    return np.where(good[:, None], distorted * factor[:, None], np.nan), good


def rises(r2: FloatArray, k: FloatArray) -> BoolArray:
    """Whether theta_d rises all the way from the axis to each point at r^2, (n,); `k`: k1 to k4, (n, 4)."""
    theta = np.arctan(np.sqrt(r2)) * (np.arange(1, _BRACKETS + 1)[:, None] / _BRACKETS)
    return np.asarray((_angle(theta, k)[1] > 0).all(axis=0))


def _bracket(goal: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Angles (n,) between which theta_d first reaches the goal (n,), and where it does so while it rises."""
    low, high = np.zeros_like(goal), np.full_like(goal, WIDEST)
    searching = np.isfinite(goal)
    good, before = np.zeros(len(goal), dtype=bool), np.zeros_like(goal)
    for i in range(1, _BRACKETS + 1):
        angle = WIDEST * i / _BRACKETS
        value, _ = _angle(np.full_like(goal, angle), k)
        reached = searching & (value >= goal)
        low[reached], high[reached], good[reached] = angle - WIDEST / _BRACKETS, angle, True
        searching &= ~reached & (value > before)
        before = value
        if not searching.any():
            break
    return low, high, good


def _angle(theta: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """theta_d (..., n) and its derivative by theta (..., n), of lenses k (n, 4)."""
    k1, k2, k3, k4 = k.T
    t2 = theta * theta
    value = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    return value, 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
