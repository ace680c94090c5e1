"""Points measured with a calibrated rig, and projected into its cameras (docs/api.md)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig
from spherecal.data.rig_camera import last_axis, lens_corrected, posed
from spherecal.geometry.user_frame import UserFrame
from spherecal.verify.outlying_views import Views, triangulate_checked
from spherecal.verify.uncertainty import PointErrors, point_errors
from spherecal_rigs.framed_rig import in_frame

# What the detector reaches on clean prints is better, a laser dot or a feature matcher worse; the points' covariance
# is proportional to its square, so that a caller who knows better can say so.
DEFAULT_SIGMA_PX = 0.1
_AT_ONCE = 500  # points: 100 cameras with 15 parameters each take 18 MB


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredPoints(ByValue):
    """Points measured with a rig: `points_mm` (..., 3) in the world of rig.json or the user's frame, NaN for none.

    `covariance_mm2` (..., 3, 3): cameras (if the rig's covariance is there) and image noise, scale included; NaN
    without a point. `views` (...) counts the cameras that a point rests on, 0 without a point. `used` says of each
    camera which of its image points took part, (...). `contradicting` (...) marks points given up because their views
    do not meet. `residuals_px` of each camera (..., 2) is predicted - observed.
    """

    points_mm: FloatArray
    covariance_mm2: FloatArray
    views: IntArray
    contradicting: BoolArray
    used: Mapping[str, BoolArray]
    residuals_px: Mapping[str, FloatArray]

    def __repr__(self) -> str:
        n, found = self.views.size, int((self.views > 0).sum())
        given_up = int(self.contradicting.sum())
        return f"<MeasuredPoints: {found} of {n} found{f', {given_up} contradicting' if given_up else ''}>"


def project_points(rig: Rig, points_mm: ArrayLike, frame: UserFrame | None = None) -> dict[str, FloatArray]:
    """Where each camera sees points: (..., 2) px by camera id, NaN for those behind it.

    One point (3,) gives (2,), the two ends of n bars (n, 2, 3) give (n, 2, 2).

    Parameters
    ----------
    rig
        The calibrated rig.
    points_mm
        Points (..., 3) in mm.
    frame
        The user's frame that they are given in; None for the rig's world.

    Raises
    ------
    InputError
        For an array of another shape, and for a frame of another rig.
    """
    rig = rig if frame is None else in_frame(rig, frame)
    points = last_axis(points_mm, 3, "points_mm")
    return {camera.id: camera.project(points) for camera in rig.cameras}


def triangulate_points(
    rig: Rig,
    image_points: Mapping[str, ArrayLike] | ArrayLike,
    sigma_px: float = DEFAULT_SIGMA_PX,
    frame: UserFrame | None = None,
) -> MeasuredPoints:
    """Points from their images, in mm, with their covariances.

    With three or more views a grossly wrong one is left out.

    Parameters
    ----------
    rig
        The calibrated rig.
    image_points
        For each camera (..., 2) px by its id, or an array (cameras, ..., 2) in the order of the rig. The same place in
        all arrays is the same point, NaN where it is not seen. (2,) of each camera gives one point (3,), (n, 2) gives
        (n, 3), (n, 2, 2) the two ends of n bars (n, 2, 3).
    sigma_px
        Standard uncertainty of an image coordinate, px; from 30 redundant observations on, the residuals correct it.
    frame
        The user's frame to give points and covariances in, without the frame's own uncertainty; None for the rig's
        world.

    Raises
    ------
    InputError
        For a camera that the rig does not have, and a frame of another rig. For arrays of another shape, and a
        `sigma_px` that is not above 0.
    """
    rig = rig if frame is None else in_frame(rig, frame)
    if not sigma_px > 0:
        raise InputError(Phrase("error-above-zero", {"name": "sigma_px", "value": sigma_px}))
    arrays, shape = _image_points(rig, image_points)
    n = int(np.prod(shape))
    seen = [(c, uv, np.flatnonzero(np.isfinite(uv).all(axis=1))) for c, uv in arrays.items()]
    feature = np.concatenate([rows for _, _, rows in seen]) if seen else np.zeros(0, dtype=int)
    camera = np.concatenate([np.full(len(rows), c) for c, _, rows in seen]) if seen else feature
    uv = np.concatenate([uv[rows] for _, uv, rows in seen]) if seen else np.zeros((0, 2))
    views = Views(
        feature,
        camera,
        *lens_corrected(rig.cameras, camera, uv, np.full(uv.shape, sigma_px)),
        n,
        posed(rig.cameras),
    )
    checked = triangulate_checked(views, 1.0)
    covariance = _point_covariance(rig, point_errors(checked, rig))
    found = np.isfinite(checked.points.points[:, 0]) & ~checked.contradicting
    points = np.where(found[:, None], checked.points.points, np.nan)
    used: dict[str, BoolArray] = {}
    residuals: dict[str, FloatArray] = {}
    for c, _, rows in seen:
        mine = camera == c
        took_part, residual = np.zeros(n, dtype=bool), np.full((n, 2), np.nan)
        took_part[rows] = checked.kept[mine] & found[rows]
        residual[rows] = checked.points.residual[mine]
        name = rig.cameras[c].id
        used[name], residuals[name] = took_part.reshape(shape), residual.reshape(*shape, 2)
    return MeasuredPoints(
        points.reshape(*shape, 3),
        np.where(found[:, None, None], covariance, np.nan).reshape(*shape, 3, 3),
        np.where(found, checked.points.views, 0).reshape(shape),
        checked.contradicting.reshape(shape),
        used,
        residuals,
    )


def _point_covariance(rig: Rig, errors: PointErrors) -> FloatArray:
    """Covariance (n, 3, 3): image noise, and the cameras' share G C G' with all their correlations."""
    views = errors.checked.views
    width, covariance = errors.by_camera.shape[2], errors.covariance.copy()
    for first in range(0, views.n_features, _AT_ONCE):
        n = min(_AT_ONCE, views.n_features - first)
        rows = np.flatnonzero((views.feature >= first) & (views.feature < first + n))
        by_parameter = np.zeros((n, 3, len(rig.cameras), width))
        by_parameter[views.feature[rows] - first, :, views.camera[rows]] = errors.by_camera[rows]
        g = by_parameter.reshape(n, 3, len(rig.cameras) * width)
        covariance[first : first + n] += np.einsum("nip,njp->nij", g @ errors.cameras, g)
    return covariance


def _image_points(
    rig: Rig, image_points: Mapping[str, ArrayLike] | ArrayLike
) -> tuple[dict[int, FloatArray], tuple[int, ...]]:
    """Arrays (n, 2) by the camera's index, and the shape (...) of the points that they had."""
    index = {camera.id: c for c, camera in enumerate(rig.cameras)}
    if not isinstance(image_points, Mapping):
        stack = last_axis(image_points, 2, "image_points")
        if stack.ndim < 2 or len(stack) != len(index):
            raise InputError(Phrase("error-image-points-shape", {"count": len(index), "found": str(stack.shape)}))
        image_points = dict(zip(index, stack, strict=True))
    arrays: dict[int, FloatArray] = {}
    for name, values in image_points.items():
        if name not in index:
            raise InputError(Phrase("error-rig-no-camera", {"camera": name, "names": list(index)}))
        arrays[index[name]] = last_axis(values, 2, Phrase("image-points-of", {"what": name}))
    shapes = sorted({values.shape[:-1] for values in arrays.values()})
    if len(shapes) > 1:
        numbers = all(len(shape) == 1 for shape in shapes)
        said = [str(shape[0] if numbers else (*shape, 2)) for shape in shapes]
        raise InputError(Phrase("error-point-numbers" if numbers else "error-point-shapes", {"shapes": said}))
    flat = {c: values.reshape(-1, 2) for c, values in sorted(arrays.items())}
    return flat, shapes[0] if shapes else (0,)
