"""Points measured with a calibrated rig, and projected into its cameras (docs/api.md)."""

from __future__ import annotations  # help() then shows ArrayLike by its name

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.notebook import html_table
from spherecal.data.from_arrays import above_zero, ids_and_points, of_kind
from spherecal.data.rig import Rig
from spherecal.data.rig_camera import last_axis, posed
from spherecal_rigs.framed_rig import in_frame
from spherecal_rigs.user_frame import UserFrame
from spherecal_verify.outlying_views import Views, triangulate_checked, weighted_noise
from spherecal_verify.participation import lens_corrected
from spherecal_verify.uncertainty import PointErrors, point_errors

# What the detector reaches on clean prints is better, a laser dot or a feature matcher worse; the points' covariance
# is proportional to its square, so that a caller who knows better can say so.
DEFAULT_SIGMA_PX = 0.1
_AT_ONCE = 500  # points: 100 cameras with 15 parameters each take 18 MB
_ONE_FRAME = "Give {camera: (ids, uv)} of one frame, or arrays (..., 2) by camera."


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredPoints(ByValue):
    """Points measured with a rig: `points_mm` (..., 3) in the world of rig.json or the user's frame, NaN for none.

    `covariance_mm2` (..., 3, 3): cameras (if the rig's covariance is there) and image noise, scale included; NaN
    without a point. `views` (...) counts the cameras that a point rests on, 0 without a point. `used` says of each
    camera which of its image points took part, (...). `contradicting` (...) marks points given up because their views
    do not meet, `seen_by_one` (...) those that one camera alone sees. `residuals_px` of each camera (..., 2) is
    predicted - observed. `noise_ratio`: the scatter of the residuals over the stated `sigma_px`, None with fewer than
    30 redundant observations; the covariances are as stated. `ids` (n,) of the points, if the image points had them.
    """

    points_mm: FloatArray
    covariance_mm2: FloatArray
    views: IntArray
    contradicting: BoolArray
    used: Mapping[str, BoolArray]
    residuals_px: Mapping[str, FloatArray]
    seen_by_one: BoolArray
    noise_ratio: float | None = None
    ids: IntArray | None = None
    _errors: PointErrors | None = field(default=None, repr=False)

    def joint_covariance_mm2(self, *points: int | tuple[int, ...]) -> FloatArray:
        """The covariance (3k, 3k) of k points together, in the order given: what cameras err by they have in common.

        Parameters
        ----------
        points
            Indices of the points, as of `views`: numbers, or tuples for more than one dimension.

        Raises
        ------
        InputError
            For a point that was not found.
        """
        try:
            flat = [int(np.ravel_multi_index(np.atleast_1d(i), self.views.shape)) for i in points]
        except (TypeError, ValueError):  # no index, or one too large
            flat = []
        if self._errors is None or not flat or not all(self.views.ravel()[flat]):
            raise InputError(Phrase("error-point-not-found", {"points": [str(i) for i in points]}))
        g = _by_cameras(self._errors, np.array(flat)).reshape(3 * len(flat), -1)
        joint = g @ self._errors.cameras @ g.T
        for k, i in enumerate(flat):
            joint[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += self._errors.covariance[i]
        return joint

    def length_mm(self, first: int | tuple[int, ...], second: int | tuple[int, ...]) -> tuple[float, float]:
        """The distance of two points and its standard uncertainty, in mm.

        Parameters
        ----------
        first, second
            Indices of the points, as of `views`.

        Raises
        ------
        InputError
            For a point that was not found.
        """
        joint = self.joint_covariance_mm2(first, second)
        between = self.points_mm[second] - self.points_mm[first]
        length = float(np.linalg.norm(between))
        gradient = np.concatenate([-between, between]) / max(length, 1e-300)
        return length, float(np.sqrt(max(gradient @ joint @ gradient, 0.0)))

    def __repr__(self) -> str:
        n, found = self.views.size, int((self.views > 0).sum())
        given_up, alone = int(self.contradicting.sum()), int(self.seen_by_one.sum())
        more = f", {given_up} contradicting" if given_up else ""
        more += f", {alone} seen by one camera alone" if alone else ""
        return f"<MeasuredPoints: {found} of {n} found{more}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: a row for each point."""
        points, sd = self.points_mm.reshape(-1, 3), self.covariance_mm2.reshape(-1, 3, 3)
        sigma = np.sqrt(np.diagonal(sd, axis1=1, axis2=2))
        k = self.views.size // max(len(self.ids), 1) if self.ids is not None else 0
        columns: dict[str, list[object]] = {"id": [*np.repeat(self.ids, k).tolist()]} if self.ids is not None else {}
        columns |= {f"{a} mm": points[:, i].tolist() for i, a in enumerate("xyz")}
        columns |= {f"sd {a} mm": sigma[:, i].tolist() for i, a in enumerate("xyz")}
        return html_table(repr(self).strip("<>"), columns | {"views": self.views.ravel().tolist()})


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
    of_kind("rig", rig, Rig, "a Rig (load_rig reads one)")
    of_kind("frame", frame, (UserFrame, type(None)), "a UserFrame (load_frame reads one) or None")
    rig = rig if frame is None else in_frame(rig, frame)
    points = last_axis(points_mm, 3, "points_mm")
    return {camera.id: camera.project(points) for camera in rig.cameras}


def triangulate_points(
    rig: Rig,
    image_points: Mapping[str, ArrayLike | tuple[ArrayLike, ArrayLike] | Mapping[int, ArrayLike]] | ArrayLike,
    sigma_px: float = DEFAULT_SIGMA_PX,
    frame: UserFrame | None = None,
) -> MeasuredPoints:
    """Points from their images, in mm, with their covariances.

    With three or more views a grossly wrong one is left out. A warning says how many points one camera alone sees.

    Parameters
    ----------
    rig
        The calibrated rig.
    image_points
        For each camera (..., 2) px by its id, or an array (cameras, ..., 2) in the order of the rig. The same place in
        all arrays is the same point, NaN where it is not seen. (2,) of each camera gives one point (3,), (n, 2) gives
        (n, 3), (n, 2, 2) the two ends of n bars (n, 2, 3). Or (ids, uv) of each camera, as of one frame of
        `calibrate_points`: points (n, 3) of the n `ids` of the result, (n, 4, 3) where uv are the corners of markers.
    sigma_px
        Standard uncertainty of an image coordinate, px. Covariances are proportional to its square; what the residuals
        say of it is `noise_ratio` of the result.
    frame
        The user's frame to give points and covariances in, without the frame's own uncertainty; None for the rig's
        world.

    Raises
    ------
    InputError
        For a camera that the rig does not have, and a frame of another rig. For arrays of another shape, and a
        `sigma_px` that is not above 0.
    """
    of_kind("rig", rig, Rig, "a Rig (load_rig reads one)")
    of_kind("frame", frame, (UserFrame, type(None)), "a UserFrame (load_frame reads one) or None")
    rig = rig if frame is None else in_frame(rig, frame)
    sigma_px = above_zero("sigma_px", sigma_px)
    if isinstance(image_points, Mapping):
        image_points = {name: seen for name, seen in image_points.items() if seen is not None}
    with_ids = _points_by_ids(image_points) if isinstance(image_points, Mapping) else None
    arrays, shape = _image_points(rig, image_points if with_ids is None else with_ids[1])
    n = int(np.prod(shape))
    seen = [(c, uv, np.flatnonzero(np.isfinite(uv).all(axis=1))) for c, uv in arrays.items()]
    feature = np.concatenate([rows for _, _, rows in seen]) if seen else np.zeros(0, dtype=int)
    camera = np.concatenate([np.full(len(rows), c) for c, _, rows in seen]) if seen else feature
    uv = np.concatenate([uv[rows] for _, uv, rows in seen]) if seen else np.zeros((0, 2))
    views = Views(
        feature, camera, *lens_corrected(rig.cameras, camera, uv, np.full(uv.shape, sigma_px)), n, posed(rig.cameras)
    )
    by_one = np.bincount(feature, minlength=n) == 1
    if alone := int(by_one.sum()):
        said = f"{alone} of {n} points are seen by one camera alone and have no place: a point needs two cameras."
        warnings.warn(said, stacklevel=2)
    checked = triangulate_checked(views, 1.0)
    ratio = weighted_noise(views, checked.points, checked.kept, np.nan)
    errors = point_errors(replace(checked, noise=1.0), rig)
    covariance = _point_covariance(errors)
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
        by_one.reshape(shape),
        None if np.isnan(ratio) else ratio,
        None if with_ids is None else with_ids[0],
        errors,
    )


def _point_covariance(errors: PointErrors) -> FloatArray:
    """Covariance (n, 3, 3): image noise, and the cameras' share G C G' with all their correlations."""
    count, covariance = errors.checked.views.n_features, errors.covariance.copy()
    for first in range(0, count, _AT_ONCE):
        some = np.arange(first, min(first + _AT_ONCE, count))
        g = _by_cameras(errors, some)
        covariance[some] += np.einsum("nip,njp->nij", g @ errors.cameras, g)
    return covariance


def _by_cameras(errors: PointErrors, points: IntArray) -> FloatArray:
    """How some points (k,) follow all cameras' parameters, (k, 3, c*w)."""
    views, width = errors.checked.views, errors.by_camera.shape[2]
    n_cameras = len(errors.cameras) // width
    place = {int(i): k for k, i in enumerate(points)}
    rows = np.flatnonzero(np.isin(views.feature, points))
    at = np.array([place[int(i)] for i in views.feature[rows]], dtype=np.int64)
    by_parameter = np.zeros((len(points), 3, n_cameras, width))
    by_parameter[at, :, views.camera[rows]] = errors.by_camera[rows]
    return by_parameter.reshape(len(points), 3, n_cameras * width)


def _image_points(
    rig: Rig, image_points: Mapping[str, Any] | ArrayLike
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


def _points_by_ids(given: Mapping[str, Any]) -> tuple[IntArray, dict[str, FloatArray]] | None:
    """All ids (n,), and image points (n, 2) or (n, k, 2) by camera, of (ids, uv) or {id: (u, v)}; None for arrays."""
    pairs = {name: ids_and_points(one) for name, one in given.items()}
    found = {name: pair for name, pair in pairs.items() if pair is not None}
    wrong = [name for name in pairs if name not in found and (found or hasattr(given[name], "keys"))]
    if wrong:
        said = f"The image points of {wrong[0]} are not (ids, uv) or {{id: (u, v)}} of one frame."
        raise InputError(said, _ONE_FRAME)
    if not found:
        return None
    ids = np.unique(np.concatenate([numbers for numbers, _ in found.values()]))
    width = max(points.shape[1] for _, points in found.values())
    arrays: dict[str, FloatArray] = {}
    for name, (numbers, points) in found.items():
        if len(numbers) != len(points):
            raise InputError(f"{name} has {len(numbers)} ids, but {len(points)} image points.", _ONE_FRAME)
        if len(np.unique(numbers)) < len(numbers):
            raise InputError(f"{name} has an id twice.", _ONE_FRAME)
        if len(points) and points.shape[1] != width:
            raise InputError(f"{name} has {points.shape[1]} points for an id, other cameras {width}.", _ONE_FRAME)
        filled = np.full((len(ids), width, 2), np.nan)
        if len(points):
            filled[np.searchsorted(ids, numbers)] = points
        arrays[name] = filled[:, 0] if width == 1 else filled
    return ids, arrays
