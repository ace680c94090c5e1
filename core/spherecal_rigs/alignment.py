"""Two calibrations of one rig brought together: the similarity under which most cameras see the volume alike."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig, RigCamera
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.rotation import exp_rotation, nearest_rotation
from spherecal.geometry.transform import Similarity

_ROUNDS = 30
_SETTLED = 1e-8  # radians, or parts of the volume's size: 1e-5 mm of a metre
_SAME_RAY = 1e-6  # normalised: undistort ends within 1e-9, the other side of a fold is tenths away
# A camera that fits to a thousandth of a millimetre is not to outweigh all others.
_SMALLEST_MM = 1e-3


@dataclass(frozen=True)
class MatchedCamera:
    """A camera in both calibrations."""

    id: str
    a: RigCamera
    b: RigCamera


def common_cameras(a: Rig, b: Rig) -> tuple[MatchedCamera, ...]:
    """The cameras that both have, by id."""
    pairs = tuple(
        MatchedCamera(camera.id, camera, other) for camera in a.cameras if (other := b.camera(camera.id)) is not None
    )
    if len(pairs) < 2:
        raise InputError(Phrase("error-few-common"))
    for pair in pairs:
        if pair.a.image_size != pair.b.image_size:
            raise InputError(Phrase("error-other-sizes", {"camera": pair.id}))
    return pairs


def sights(pair: MatchedCamera, points: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Which points (n, 3) the camera sees in the first calibration, (n,) bool, and their images (n, 2).

    A distortion that folds over far outside the image maps points there into it: those are not seen.
    """
    x = points @ pair.a.rotation.T + pair.a.translation_mm
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        xy = x[:, :2] / x[:, 2:]
        uv = project(x, pair.a.intrinsics)
    inside = (x[:, 2] > 0) & (uv > -0.5).all(axis=1) & (uv < np.array(pair.a.image_size) - 0.5).all(axis=1)
    back, good = undistort(uv[inside], pair.a.intrinsics)
    inside[inside] = good & (np.abs(back - xy[inside]).max(axis=1, initial=0.0) < _SAME_RAY)
    return inside, uv


def shift_mm(pair: MatchedCamera, points: FloatArray, uv: FloatArray, b_from_a: Similarity) -> FloatArray:
    """How far each point's image moves from one calibration to the other, in mm across the ray at the point, (n, 2).

    `points`: points (n, 3) in the first world, mm.
    """
    x = b_from_a.apply(points) @ pair.b.rotation.T + pair.b.translation_mm
    depth = (points @ pair.a.rotation.T + pair.a.translation_mm)[:, 2:3]
    return (project(x, pair.b.intrinsics) - uv) * depth / pair.a.intrinsics[:2]


def align(pairs: tuple[MatchedCamera, ...], points: FloatArray, metric: bool) -> Similarity:
    """The similarity (rigid motion where `metric`) from the first world to the second.

    It minimises the sum over the cameras of the rms shift of the volume's points in the images. A few cameras that have
    moved do not pull it, as the sum of squares would let them.

    `points`: points (n, 3) all over the volume in the first world, mm.
    """
    seen = [(pair, inside, uv) for pair in pairs for inside, uv in [sights(pair, points)] if inside.sum() >= 4]
    if len(seen) < 2:
        raise InputError(Phrase("error-few-see-volume"))
    rows = _rows(seen, points)
    x = np.zeros(6 if metric else 7)
    first = _from_poses([pair for pair, _, _ in seen], metric)
    spread = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0

    def similarity(x: FloatArray) -> Similarity:
        scale = first.scale if metric else first.scale * float(np.exp(x[6]))
        return Similarity(scale, exp_rotation(x[:3]) @ first.rotation, first.translation + spread * x[3:6])

    weight = np.ones(len(seen))
    for _ in range(_ROUNDS):
        root = np.sqrt(weight / rows.count)[rows.owner][:, None]

        def residuals(x: FloatArray, root: FloatArray = root) -> FloatArray:
            return (root * rows.shift_mm(similarity(x))).ravel()

        new = least_squares(residuals, x, method="lm", xtol=1e-12, ftol=1e-12).x
        squares = (rows.shift_mm(similarity(new)) ** 2).sum(axis=1)
        weight = 1 / np.maximum(np.sqrt(np.bincount(rows.owner, squares) / rows.count), _SMALLEST_MM)
        settled = np.abs(new - x).max() < _SETTLED
        x = new
        if settled:
            break
    return similarity(x)


@dataclass(frozen=True)
class _Rows:
    """All sights of all cameras as rows: owner (n,), point (n, 3), its image in the first calibration (n, 2).

    Then mm at the point for a pixel (n, 2) and the second calibration's camera; `count` is the rows a camera has.
    """

    owner: IntArray
    points: FloatArray
    uv: FloatArray
    mm_per_px: FloatArray
    rotation: FloatArray
    translation_mm: FloatArray
    intrinsics: FloatArray
    count: FloatArray

    def shift_mm(self, b_from_a: Similarity) -> FloatArray:
        """As the function of this name, for all cameras at once, (n, 2)."""
        x = np.einsum("nij,nj->ni", self.rotation, b_from_a.apply(self.points)) + self.translation_mm
        return (project(x, self.intrinsics) - self.uv) * self.mm_per_px


def _rows(seen: list[tuple[MatchedCamera, BoolArray, FloatArray]], points: FloatArray) -> _Rows:
    owner = np.repeat(np.arange(len(seen)), [int(inside.sum()) for _, inside, _ in seen])
    own_points = np.concatenate([points[inside] for _, inside, _ in seen])
    a, b = ([getattr(pair, which) for pair, _, _ in seen] for which in ("a", "b"))
    axis = np.array([camera.rotation[2] for camera in a])[owner]
    depth = (axis * own_points).sum(axis=1) + np.array([camera.translation_mm[2] for camera in a])[owner]
    return _Rows(
        owner=owner,
        points=own_points,
        uv=np.concatenate([uv[inside] for _, inside, uv in seen]),
        mm_per_px=depth[:, None] / np.array([camera.intrinsics[:2] for camera in a])[owner],
        rotation=np.array([camera.rotation for camera in b])[owner],
        translation_mm=np.array([camera.translation_mm for camera in b])[owner],
        intrinsics=np.array([camera.intrinsics for camera in b])[owner],
        count=np.bincount(owner).astype(float),
    )


def _from_poses(pairs: list[MatchedCamera], metric: bool) -> Similarity:
    """A start: the mean turn of the cameras, then scale and shift from the medians of their centres."""
    rotation = nearest_rotation(np.sum([pair.b.rotation.T @ pair.a.rotation for pair in pairs], axis=0))
    a = np.array([pair.a.centre_mm for pair in pairs]) @ rotation.T
    b = np.array([pair.b.centre_mm for pair in pairs])
    apart = np.linalg.norm(a[:, None] - a[None], axis=2), np.linalg.norm(b[:, None] - b[None], axis=2)
    far = apart[0] > 1e-9
    scale = float(np.median(apart[1][far] / apart[0][far])) if far.any() and not metric else 1.0
    return Similarity(scale or 1.0, rotation, np.median(b - (scale or 1.0) * a, axis=0))
