"""Moving targets: what image points did since the last set, and what differing moments of exposure make of that.

A target that moves at v mm/s is seen v * dt away by a camera that exposes dt s apart from the others. Where the
cameras' exposure times are exact the image points are moved to one moment; else the time error is a parameter of each
camera, the same for all its image points of the set, and counts in the uncertainty like the calibration's.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.camera import project_with_point_derivatives
from spherecal.verify.outlying_views import CheckedPoints, Views
from spherecal.verify.uncertainty import PointErrors

# Beyond it a constant velocity says nothing of where a target carried by hand was in between.
_LONGEST_S = 1.0


@dataclass(frozen=True)
class _Past:
    key: IntArray
    value: FloatArray
    at_s: FloatArray


class Velocities:
    """Velocities of named vectors between a set and the one before: of image points, or of points in space."""

    def __init__(self) -> None:
        self._past: _Past | None = None

    def of(self, key: IntArray, value: FloatArray, at_s: FloatArray) -> FloatArray:
        """Velocities (n, w) per second of values (n, w) at times (n,), keys (n,) all different; NaN where unknown."""
        velocity = np.full(value.shape, np.nan)
        past = self._past
        if past is not None and len(past.key):
            row = np.searchsorted(past.key, key).clip(max=len(past.key) - 1)
            passed = at_s - past.at_s[row]
            known = (past.key[row] == key) & (passed > 0) & (passed <= _LONGEST_S)
            velocity[known] = (value[known] - past.value[row[known]]) / passed[known, None]
        order = np.argsort(key, kind="stable")
        self._past = _Past(key[order], value[order], at_s[order])
        return velocity


def enlarged(views: Views, velocity: FloatArray, sd_s: float) -> Views:
    """The views with the standard deviations that moving image points (n, 2) px/s have by a time error of `sd_s`."""
    by_time = np.abs(np.nan_to_num(velocity)) * sd_s
    return replace(views, sigma=np.hypot(views.sigma, by_time))


def with_time_errors(
    errors: PointErrors, views: Views, checked: CheckedPoints, still: FloatArray, velocity: FloatArray, sd_s: float
) -> PointErrors:
    """The errors of points from `enlarged` views: noise of the image points `still` (n, 2) px, a time error a camera.

    Each camera gets one more parameter, the error of its moment of exposure with standard uncertainty `sd_s`.
    """
    rotation = views.rotation[views.camera]
    x = np.einsum("nij,nj->ni", rotation, checked.points.points[views.feature]) + views.translation[views.camera]
    _, by_x = project_with_point_derivatives(x, views.intrinsics[views.camera])
    weighted = (by_x @ rotation) * (checked.kept[:, None] / views.sigma**2)[:, :, None]
    cofactor = checked.points.covariance
    by_uv = cofactor[views.feature] @ np.swapaxes(weighted, 1, 2)  # shift of the point by that of the image point
    spread = by_uv * (checked.noise * still)[:, None, :]
    noise = np.zeros_like(errors.covariance)
    seen = checked.kept & np.isfinite(spread).all(axis=(1, 2))
    np.add.at(noise, views.feature[seen], spread[seen] @ np.swapaxes(spread[seen], 1, 2))
    noise[~np.isfinite(errors.covariance).all(axis=(1, 2))] = np.nan
    by_time = by_uv @ np.nan_to_num(velocity)[:, :, None]
    c, w = len(views.rotation), errors.by_camera.shape[2]
    # parameters camera by camera: w of the calibration, then the time
    cameras = np.zeros((c, w + 1, c, w + 1))
    cameras[:, :w, :, :w] = errors.cameras.reshape(c, w, c, w)
    cameras[np.arange(c), w, np.arange(c), w] = sd_s**2
    cameras = cameras.reshape(c * (w + 1), c * (w + 1))
    return PointErrors(noise, np.concatenate([errors.by_camera, by_time], axis=2), cameras, errors.with_scale)


def moving(velocity: FloatArray, by_s: float, sigma: FloatArray) -> BoolArray:
    """Image points (n,) that a time error of `by_s` shifts by more than half their own standard deviation."""
    return np.linalg.norm(np.nan_to_num(velocity), axis=1) * by_s > 0.5 * sigma.max(axis=1)
