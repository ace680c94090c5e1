"""Two calibrations of one rig brought together: the similarity under which most cameras see the volume alike."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from spherecal.arrays import BoolArray, FloatArray
from spherecal.errors import InputError
from spherecal.geometry.camera import project
from spherecal.geometry.rotation import exp_rotation, nearest_rotation
from spherecal.geometry.transform import Similarity
from spherecal.rig import Rig, RigCamera

_ROUNDS = 30
_SETTLED = 1e-6
# A camera that fits to a thousandth of a millimetre is not to outweigh all others.
_SMALLEST_MM = 1e-3


@dataclass(frozen=True)
class Pair:
    """A camera in both calibrations."""

    id: str
    a: RigCamera
    b: RigCamera


def common_cameras(a: Rig, b: Rig) -> tuple[Pair, ...]:
    """The cameras that both have, by id; InputError for fewer than two, or another image size."""
    pairs = tuple(Pair(camera.id, camera, other) for camera in a.cameras if (other := b.camera(camera.id)) is not None)
    if len(pairs) < 2:
        raise InputError("The two calibrations have fewer than two cameras in common, so they cannot be compared.")
    for pair in pairs:
        if pair.a.image_size != pair.b.image_size:
            raise InputError(f'Camera "{pair.id}" has images of another size in each of the two calibrations.')
    return pairs


def sights(pair: Pair, points: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Which points (n, 3) the camera sees in the first calibration, (n,) bool, and their images (n, 2)."""
    x = points @ pair.a.rotation.T + pair.a.translation_mm
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        uv = project(x, pair.a.intrinsics)
    inside = (uv > -0.5).all(axis=1) & (uv < np.array(pair.a.image_size) - 0.5).all(axis=1)
    return (x[:, 2] > 0) & inside, uv


def shift_mm(pair: Pair, points: FloatArray, uv: FloatArray, b_from_a: Similarity) -> FloatArray:
    """How far each point's image moves from one calibration to the other, in mm across the ray at the point, (n, 2)."""
    x = b_from_a.apply(points) @ pair.b.rotation.T + pair.b.translation_mm
    depth = (points @ pair.a.rotation.T + pair.a.translation_mm)[:, 2:3]
    return (project(x, pair.b.intrinsics) - uv) * depth / pair.a.intrinsics[:2]


def align(pairs: tuple[Pair, ...], points: FloatArray, metric: bool) -> Similarity:
    """The similarity (rigid motion where `metric`) from the first world to the second.

    It minimises the sum over the cameras of the rms shift of the volume's points (n, 3) in the images: a few cameras
    that have moved do not pull it, as the sum of squares would let them. InputError where no camera sees the volume.
    """
    seen = [(pair, points[inside], uv[inside]) for pair in pairs for inside, uv in [sights(pair, points)]]
    seen = [one for one in seen if len(one[1]) >= 4]
    if len(seen) < 2:
        raise InputError("Fewer than two cameras see the volume in which the calibrations are to be compared.")
    x = np.zeros(6 if metric else 7)
    first = _from_poses([pair for pair, _, _ in seen], metric)
    weight = np.ones(len(seen))
    spread = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0

    def similarity(x: FloatArray) -> Similarity:
        scale = first.scale if metric else first.scale * float(np.exp(x[6]))
        return Similarity(scale, exp_rotation(x[:3]) @ first.rotation, first.translation + spread * x[3:6])

    def rms(s: Similarity) -> FloatArray:
        shifts = (shift_mm(pair, own, uv, s) for pair, own, uv in seen)
        return np.array([np.sqrt((d * d).sum(axis=1).mean()) for d in shifts])

    for _ in range(_ROUNDS):

        def residuals(x: FloatArray, weight: FloatArray = weight) -> FloatArray:
            s = similarity(x)
            parts = [
                (np.sqrt(w / len(own)) * shift_mm(pair, own, uv, s)).ravel()
                for w, (pair, own, uv) in zip(weight, seen, strict=True)
            ]
            return np.concatenate(parts)

        new = least_squares(residuals, x, method="lm", xtol=1e-12, ftol=1e-12).x
        weight = 1 / np.maximum(rms(similarity(new)), _SMALLEST_MM)
        done = np.abs(new - x).max() < _SETTLED / 100
        x = new
        if done:
            break
    return similarity(x)


def _from_poses(pairs: list[Pair], metric: bool) -> Similarity:
    """A start: the mean turn of the cameras, then scale and shift from the medians of their centres."""
    rotation = nearest_rotation(np.sum([pair.b.rotation.T @ pair.a.rotation for pair in pairs], axis=0))
    a = np.array([pair.a.centre_mm for pair in pairs]) @ rotation.T
    b = np.array([pair.b.centre_mm for pair in pairs])
    apart = np.linalg.norm(a[:, None] - a[None], axis=2), np.linalg.norm(b[:, None] - b[None], axis=2)
    far = apart[0] > 1e-9
    scale = float(np.median(apart[1][far] / apart[0][far])) if far.any() and not metric else 1.0
    return Similarity(scale or 1.0, rotation, np.median(b - (scale or 1.0) * a, axis=0))
