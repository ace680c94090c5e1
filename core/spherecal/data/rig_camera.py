"""A camera of a calibrated rig: its lens and pose, in our terms and in OpenCV's."""

from __future__ import annotations  # help() then shows ArrayLike by its name

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherecal.base.arrays import ByValue, FloatArray, float_array
from spherecal.base.errors import InputError, Words
from spherecal.base.file_reading import id_problem
from spherecal.base.messages.values import Phrase
from spherecal.geometry import camera as lenses
from spherecal.geometry import opencv
from spherecal.geometry.camera import LensModel
from spherecal.geometry.field_table import FieldTable
from spherecal.geometry.rotation import log_rotation
from spherecal.geometry.transform import PosedCameras

OpenCVCamera = tuple[ArrayLike, ArrayLike | None, ArrayLike, ArrayLike]  # K, dist, rvec or R, tvec
ImageSize = tuple[int, int] | Mapping[str, tuple[int, int]]


@dataclass(frozen=True, eq=False, repr=False)
class CameraSigma(ByValue):
    """Standard uncertainties of one camera: about and along which axes, see docs/conventions.md.

    rotation_deg (3,) about the camera's axes, centre_mm (3,) in the world's axes, intrinsics (16,), 0 where fixed.
    """

    rotation_deg: FloatArray
    centre_mm: FloatArray
    intrinsics: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class RigCamera(ByValue):
    """One placed camera: intrinsics (16,), pose `x_camera = rotation @ x_world + translation_mm`.

    `image_size` is (width, height) px. `rms_px` is that of its residuals, None where it is not known, and
    `observations` is how many of its image points were used. `field` is what the lens does beyond the lens model, None
    for nothing: `K` and `dist` alone then predict `uv - field.at(uv)` of a measured pixel.
    """

    id: str
    serial: str | None
    image_size: tuple[int, int]
    intrinsics: FloatArray
    rotation: FloatArray
    translation_mm: FloatArray
    rms_px: float | None
    observations: int
    sigma: CameraSigma | None
    field: FieldTable | None = None

    @property
    def centre_mm(self) -> FloatArray:
        """The projection centre in the world frame, (3,)."""
        return -self.rotation.T @ self.translation_mm

    @property
    def lens_model(self) -> LensModel:
        """The smallest model that describes the lens: `brown`, `rational` or `fisheye` (then use cv2.fisheye)."""
        return lenses.lens_model(self.intrinsics)

    @property
    def K(self) -> FloatArray:
        """OpenCV's camera matrix, (3, 3) px."""
        return lenses.camera_matrix(self.intrinsics)

    @property
    def dist(self) -> FloatArray:
        """OpenCV's distortion: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4, (12,); k1..k4 of cv2.fisheye, (4,)."""
        return self.intrinsics[4:8].copy() if lenses.is_fisheye(self.intrinsics) else self.intrinsics[4:].copy()

    @property
    def rvec(self) -> FloatArray:
        """OpenCV's rotation vector from world to camera, (3,) rad."""
        return log_rotation(self.rotation)

    @property
    def tvec(self) -> FloatArray:
        """OpenCV's translation vector from world to camera, (3,) mm."""
        return self.translation_mm.copy()

    @property
    def P(self) -> FloatArray:
        """The projection matrix K [R t], (3, 4): of world points in mm to undistorted image points in px."""
        return self.K @ np.column_stack([self.rotation, self.translation_mm])

    def project(self, points_mm: ArrayLike) -> FloatArray:
        """Image points (..., 2) px of world points (..., 3) mm, NaN for points behind the camera.

        Raises
        ------
        InputError
            For an array of another shape.
        """
        points = last_axis(points_mm, 3, "points_mm")
        x = points.reshape(-1, 3) @ self.rotation.T + self.translation_mm
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            uv = lenses.project(x, self.intrinsics)
        uv = uv if self.field is None else self.field.measured(uv)
        return np.where(x[:, 2:] > 0, uv, np.nan).reshape(*points.shape[:-1], 2)

    def undistort(self, image_or_points: ArrayLike, K: ArrayLike | None = None) -> NDArray[Any]:
        """An image of this camera, or image points (..., 2) px, as a camera without distortion has them.

        Points are NaN where the lens model has no inverse.

        Parameters
        ----------
        image_or_points
            An image (h, w) or (h, w, channels) of `image_size`, or image points (..., 2) px.
        K
            Matrix (3, 3) of the camera without distortion, px; None for this camera's.

        Raises
        ------
        InputError
            For an array of another shape, and for a `K` that is no camera matrix.
        """
        matrix = self.K if K is None else lenses.camera_matrix(opencv.lens_vector(K, None, False, self.id))
        given = np.asarray(image_or_points)
        if given.ndim in (2, 3) and given.shape[:2] == self.image_size[::-1]:
            return opencv.undistort_image(given, self.intrinsics, matrix, self.field)
        if given.ndim < 1 or given.shape[-1] != 2:
            (width, height), shape = self.image_size, str(given.shape)
            values = {"shape": shape, "camera": self.id, "height": height, "width": width}
            raise InputError(Phrase("error-undistort", values))
        uv = last_axis(given, 2, "image points")
        flat = uv.reshape(-1, 2)
        with np.errstate(invalid="ignore"):
            ideal, _ = lenses.undistort(flat if self.field is None else flat - self.field.at(flat), self.intrinsics)
        return (ideal * matrix[[0, 1], [0, 1]] + matrix[:2, 2]).reshape(uv.shape)


def last_axis(values: ArrayLike, width: int, what: Words) -> FloatArray:
    """The values as an array (..., width) of numbers."""
    array = float_array(values, what)
    if array.ndim < 1 or array.shape[-1] != width:
        problem = Phrase("problem-shape", {"expected": f"(..., {width})", "found": str(array.shape)})
        raise InputError(Phrase("error-of", {"what": what, "problem": problem}))
    return array


def table_row(camera: RigCamera) -> dict[str, Any]:
    """The camera as a row of a table: numbers of Python, None where absent, NaN for coefficients it does not have."""
    lens = dict(zip(lenses.lens_names(camera.intrinsics), map(float, camera.intrinsics), strict=False))
    sigma = camera.sigma
    row: dict[str, Any] = {"camera": camera.id, "serial": camera.serial, "lens_model": camera.lens_model}
    row |= {"width_px": camera.image_size[0], "height_px": camera.image_size[1]}
    row |= {name: lens.get(name, float("nan")) for name in lenses.INTRINSIC_NAMES}
    for name, vector in (("centre_{}_mm", camera.centre_mm), ("rvec_{}_rad", camera.rvec), ("tvec_{}_mm", camera.tvec)):
        row |= {name.format(axis): float(value) for axis, value in zip("xyz", vector, strict=True)}
    for name, vector in (
        ("sigma_centre_{}_mm", sigma and sigma.centre_mm),
        ("sigma_{}_deg", sigma and sigma.rotation_deg),
    ):
        row |= {name.format(axis): None if vector is None else float(vector[i]) for i, axis in enumerate("xyz")}
    return row | {"rms_px": camera.rms_px, "observations": camera.observations}


def camera_of_opencv(
    name: str, given: OpenCVCamera, image_size: ImageSize, fisheye: bool | Collection[str], mm: float
) -> RigCamera:
    """A camera that OpenCV calibrated, without residuals and uncertainties; `image_size` (width, height) px."""
    what = Phrase("camera-named", {"camera": name})
    if problem := id_problem(name):
        raise InputError(Phrase("error-camera-id", {"name": repr(name), "problem": problem}))
    if not isinstance(given, Sequence) or len(given) != 4:
        raise InputError(Phrase("error-opencv-entry", {"what": what}))
    K, dist, rvec, tvec = given
    size, lens = size_of(name, image_size), opencv.lens_vector(K, dist, is_wide(name, fisheye), what)
    pose = opencv.pose_rotation(rvec, what), mm * opencv.pose_translation(tvec, what)
    return RigCamera(name, None, size, lens, *pose, rms_px=None, observations=0, sigma=None)


def is_wide(name: str, fisheye: bool | Collection[str]) -> bool:
    """Whether a camera is of cv2.fisheye."""
    return fisheye if isinstance(fisheye, bool) else name in fisheye


def size_of(name: str, image_size: ImageSize) -> tuple[int, int]:
    """The (width, height) of a camera's images in px."""
    size: Any = image_size.get(name) if isinstance(image_size, Mapping) else image_size
    try:
        width, height = size
        if int(width) == width > 0 and int(height) == height > 0:
            return int(width), int(height)
    except (TypeError, ValueError):
        pass
    raise InputError(Phrase("error-image-size-given", {"camera": name, "size": repr(size)}))


def posed(cameras: Sequence[RigCamera]) -> PosedCameras:
    """Lenses and poses of calibrated cameras as arrays, in their order."""
    return PosedCameras(
        np.array([c.intrinsics for c in cameras]).reshape(-1, 16),
        np.array([c.rotation for c in cameras]).reshape(-1, 3, 3),
        np.array([c.translation_mm for c in cameras]).reshape(-1, 3),
    )
