"""Moving targets: what image points did since the last set, and what differing moments of exposure make of that.

A target that moves at v mm/s is seen v * dt away by a camera that exposes dt s apart from the others. Where the
cameras' exposure times are exact the image points are moved to one moment; else the time error is a parameter of each
camera, the same for all its image points of the set, and counts in the uncertainty like the calibration's.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.camera import project_with_point_derivatives
from spherecal.verify.outlying_views import Views
from spherecal.verify.uncertainty import PointErrors

# Beyond it a constant velocity says nothing of where a target carried by hand was in between.
_LONGEST_S = 1.0


@dataclass(frozen=True)
class Motion:
    """Mean velocities (n, w) per second since the last set, and their change against those before; NaN: unknown."""

    mean: FloatArray
    change: FloatArray

    @property
    def now(self) -> FloatArray:
        """The velocities at the set's own moment, half an interval on."""
        return self.mean + np.nan_to_num(self.change) / 2

    @property
    def sd(self) -> FloatArray:
        """How far those may be off: by as much as they were extrapolated, or all where that is not known."""
        return np.where(np.isfinite(self.change), np.abs(self.change) / 2, np.abs(self.mean))


@dataclass(frozen=True)
class _Past:
    key: IntArray
    value: FloatArray
    velocity: FloatArray
    at_s: FloatArray


class Velocities:
    """Velocities of named vectors from set to set: of image points, or of points in space."""

    def __init__(self) -> None:
        self._past: _Past | None = None

    def of(self, key: IntArray, value: FloatArray, at_s: FloatArray) -> Motion:
        """The motion of values (n, w) at times (n,), keys (n,) all different."""
        mean, change = np.full(value.shape, np.nan), np.full(value.shape, np.nan)
        past = self._past
        if past is not None and len(past.key):
            row = np.searchsorted(past.key, key).clip(max=len(past.key) - 1)
            passed = at_s - past.at_s[row]
            known = (past.key[row] == key) & (passed > 0) & (passed <= _LONGEST_S)
            mean[known] = (value[known] - past.value[row[known]]) / passed[known, None]
            change[known] = mean[known] - past.velocity[row[known]]
        order = np.argsort(key, kind="stable")
        self._past = _Past(key[order], value[order], mean[order], at_s[order])
        return Motion(mean, change)


def late_shift(motion: Motion, late_s: FloatArray, exact: bool) -> FloatArray:
    """What is left of image points' shifts (n, 2) px by exposures `late_s` (n,), one standard deviation.

    `exact`: they were moved back by their velocities, and what those are off by is left; else `late_s` are standard
    deviations and all is left. Where nothing is known of an image point's motion, that of the fastest is assumed.
    """
    now = motion.now
    fastest = float(np.nanmax(np.abs(now), initial=0.0)) if len(now) else 0.0
    left = np.copysign(motion.sd if exact else np.hypot(now, motion.sd), now)
    return np.where(np.isfinite(now), left, fastest) * late_s[:, None]


def enlarged(views: Views, shift: FloatArray) -> Views:
    """The views with the standard deviations that shifts (n, 2) px add; of use for weights and for the gate."""
    return replace(views, sigma=np.hypot(views.sigma, shift))


def with_shifts(errors: PointErrors, still: FloatArray, shift: FloatArray) -> PointErrors:
    """The errors of points from `enlarged` views: noise of the image points `still` (n, 2) px, shifts by the camera.

    All image points of a camera shift together: each camera gets one more parameter, with standard uncertainty 1, of
    which the shifts (n, 2) px are the derivatives.
    """
    checked, views = errors.checked, errors.checked.views
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
    by_shift = by_uv @ shift[:, :, None]
    c, w = len(views.rotation), errors.by_camera.shape[2]
    # parameters camera by camera: w of the calibration, then the shift
    cameras = np.zeros((c, w + 1, c, w + 1))
    cameras[:, :w, :, :w] = errors.cameras.reshape(c, w, c, w)
    cameras[np.arange(c), w, np.arange(c), w] = 1.0
    cameras = cameras.reshape(c * (w + 1), c * (w + 1))
    by_camera = np.concatenate([errors.by_camera, by_shift], axis=2)
    return replace(errors, covariance=noise, by_camera=by_camera, cameras=cameras)


def matters(shift: FloatArray, sigma: FloatArray) -> bool:
    """Whether any image point is shifted by more than half its own standard deviation."""
    return bool((np.abs(shift) > 0.5 * sigma).any())
