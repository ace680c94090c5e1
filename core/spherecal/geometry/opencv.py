"""Cameras as OpenCV has them: its distortion lists and pose vectors, and images undistorted as `cv2.undistort` does.

OpenCV's pixel (0, 0) is the centre of the first pixel, as here (docs/conventions.md), and its order of coefficients is
ours.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherecal.base.arrays import FloatArray, float_array
from spherecal.base.errors import InputError, Words, advice
from spherecal.base.messages.values import Phrase
from spherecal.geometry.camera import distort, fisheye_vector, intrinsics_vector
from spherecal.geometry.field_table import FieldTable
from spherecal.geometry.rotation import exp_rotation, nearest_rotation

DISTORTION_LENGTHS = (4, 5, 8, 12)
FISHEYE_LENGTH = 4
TILTED_LENGTH = 14
# A rotation that was printed with six digits is off by 1e-6; one that is off by more is something else.
_ROTATION_TOLERANCE = 1e-5
_AT_ONCE = 1 << 20  # pixels that are undistorted together: 100 MB


def distortion_problem(count: int, fisheye: bool) -> Phrase | None:
    """What is wrong with a list of so many distortion coefficients; None where nothing is."""
    if count == TILTED_LENGTH:
        return Phrase("problem-tilted")
    if fisheye and count != FISHEYE_LENGTH:
        return Phrase("problem-fisheye-count", {"count": count})
    if count not in DISTORTION_LENGTHS:
        return Phrase("problem-distortion-count", {"count": count})
    return None


def lens_vector(K: ArrayLike, dist: ArrayLike | None, fisheye: bool, what: Words) -> FloatArray:
    """The 16 intrinsics (16,) of OpenCV's camera matrix K (3, 3) px and distortion, None for no distortion."""
    it = Phrase("camera-matrix-of", {"what": what})
    matrix = _finite(K, it)
    if matrix.shape != (3, 3):
        raise _wrong(it, Phrase("problem-shape", {"expected": "(3, 3)", "found": str(matrix.shape)}))
    form = np.array([[0, 1, 0], [1, 0, 0], [1, 1, 0]], dtype=bool)
    if matrix[form].any() or matrix[2, 2] != 1 or min(matrix[0, 0], matrix[1, 1]) <= 0:
        raise _wrong(it, Phrase("problem-camera-matrix"))
    it = Phrase("distortion-of", {"what": what})
    numbers = np.zeros(0) if dist is None else _finite(dist, it).reshape(-1)
    if len(numbers) and (problem := distortion_problem(len(numbers), fisheye)):
        raise _wrong(it, problem)
    return fisheye_vector(matrix, numbers) if fisheye else intrinsics_vector(matrix, numbers)


def pose_rotation(rvec: ArrayLike, what: Words) -> FloatArray:
    """The rotation (3, 3) of a rotation vector (rad, in any shape) or of a rotation matrix (3, 3)."""
    it = Phrase("rotation-of", {"what": what})
    given = _finite(rvec, it)
    if given.shape != (3, 3):
        return exp_rotation(_three(given, Phrase("rotation-vector-of", {"what": what})))
    nearest = nearest_rotation(given)
    if np.linalg.det(given) < 0 or np.abs(given - nearest).max() > _ROTATION_TOLERANCE:
        raise _wrong(it, Phrase("problem-rotation"))
    return nearest


def pose_translation(tvec: ArrayLike, what: Words) -> FloatArray:
    """The translation (3,) of 3 numbers in any shape."""
    it = Phrase("translation-of", {"what": what})
    return _three(_finite(tvec, it), it)


def _wrong(what: Words, problem: Phrase) -> InputError:
    return InputError(Phrase("error-of", {"what": what, "problem": problem}), advice(problem))


def _three(values: FloatArray, what: Words) -> FloatArray:
    if values.size != 3:
        raise _wrong(what, Phrase("problem-three-numbers", {"found": str(values.shape)}))
    return values.reshape(3)


def _finite(values: ArrayLike, what: Words) -> FloatArray:
    array = float_array(values, what)
    if not np.isfinite(array).all():
        raise _wrong(what, Phrase("problem-holds-not-finite"))
    return array


def undistort_image(
    image: NDArray[Any], intrinsics: FloatArray, matrix: FloatArray, field: FieldTable | None = None
) -> NDArray[Any]:
    """The image as a camera without distortion and with the given matrix (3,3) px sees it, of the same shape and type.

    Bilinear, 0 where the recorded image has nothing; `field`: what the lens does beyond its model.
    """
    from scipy.ndimage import map_coordinates  # not with every rig that is read

    height, width = image.shape[:2]
    channels = image.reshape(height, width, -1)
    out = np.empty_like(channels)
    step = max(_AT_ONCE // width, 1)
    x = (np.arange(width) - matrix[0, 2]) / matrix[0, 0]
    for first in range(0, height, step):
        rows = np.arange(first, min(first + step, height))
        y = (rows - matrix[1, 2]) / matrix[1, 1]
        grid = np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1).reshape(-1, 2)
        uv = distort(grid, intrinsics) * intrinsics[:2] + intrinsics[2:4]
        uv = uv if field is None else field.measured(uv)
        for channel in range(channels.shape[2]):
            values = map_coordinates(channels[:, :, channel].astype(float), uv.T[::-1], order=1, cval=0.0)
            if np.issubdtype(image.dtype, np.integer):
                values = np.rint(values)
            out[rows, :, channel] = values.reshape(len(rows), width)
    return out.reshape(image.shape)
