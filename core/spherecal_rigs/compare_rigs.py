"""Two calibrations of one rig compared, by points, lengths and cameras, after a robust alignment."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig, RigCamera
from spherecal.data.rig_camera import posed
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.rotation import exp_rotation, log_rotation, nearest_rotation
from spherecal.geometry.transform import Similarity
from spherecal.geometry.triangulation import triangulate

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
    """Which points (n, 3) a camera sees in the first calibration, (n,) bool, and their images (n, 2)."""
    x = points @ pair.a.rotation.T + pair.a.translation_mm
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        xy = x[:, :2] / x[:, 2:]
        uv = project(x, pair.a.intrinsics)
    inside = (x[:, 2] > 0) & (uv > -0.5).all(axis=1) & (uv < np.array(pair.a.image_size) - 0.5).all(axis=1)
    back, good = undistort(uv[inside], pair.a.intrinsics)
    inside[inside] = good & (np.abs(back - xy[inside]).max(axis=1, initial=0.0) < _SAME_RAY)
    return inside, uv


def shift_mm(pair: MatchedCamera, points: FloatArray, uv: FloatArray, b_from_a: Similarity) -> FloatArray:
    """How far the image of each point (n, 3) mm moves, in mm across the ray at the point, (n, 2)."""
    x = b_from_a.apply(points) @ pair.b.rotation.T + pair.b.translation_mm
    depth = (points @ pair.a.rotation.T + pair.a.translation_mm)[:, 2:3]
    return (project(x, pair.b.intrinsics) - uv) * depth / pair.a.intrinsics[:2]


def align(pairs: tuple[MatchedCamera, ...], points: FloatArray, metric: bool) -> Similarity:
    """The similarity (rigid where `metric`) of least rms shifts in the images, of points (n, 3) all over the volume."""
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
    """Sights as rows: owner (n,), point (n, 3), image (n, 2), mm per px (n, 2), camera there; rows a camera has."""

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


_GRID = 5


@dataclass(frozen=True)
class ComparisonVolume:
    """Where calibrations are compared: a box in the first calibration's world, mm."""

    low_mm: FloatArray
    high_mm: FloatArray

    def grid(self) -> FloatArray:
        """Points all over the box, (125, 3)."""
        axes = [np.linspace(low, high, _GRID) for low, high in zip(self.low_mm, self.high_mm, strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def surface(self) -> FloatArray:
        """The grid's points on the box's faces, (98, 3)."""
        points = self.grid()
        return points[((points == self.low_mm) | (points == self.high_mm)).any(axis=1)]


@dataclass(frozen=True)
class CameraChange:
    """What has changed of one camera, after alignment; None where too few cameras see the volume's points."""

    id: str
    replaced: bool  # it has another serial number
    moved: bool
    centre_mm: FloatArray  # (3,) in the first world
    rotation_deg: FloatArray  # (3,) about the camera's axes
    focal_px: float
    ray_rms_mm: float  # how far the rays of the volume's points have moved, pose and lens together
    ray_max_mm: float
    ray_max_px: float
    point_mm: float | None  # largest error of a point on the volume's surface, had nothing else changed
    length_mm: float | None  # and of a length between two such points


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(ByValue):
    """Two calibrations brought together by `b_from_a` (a rigid motion where `metric`), worst camera first.

    `scale_ppm`: how much longer the second measures, taken out unless `metric`. `point_mm`: how far a point on the
    volume's surface is measured from where it was, at most.

    `length_mm`: the largest change of a length between two such points, `of_length_mm` long. They are at least half the
    longest side apart.
    """

    metric: bool
    b_from_a: Similarity
    scale_ppm: float
    volume: ComparisonVolume
    cameras: tuple[CameraChange, ...]
    point_mm: float | None
    length_mm: float | None
    of_length_mm: float | None
    only_in_a: tuple[str, ...]
    only_in_b: tuple[str, ...]


def compare(a: Rig, b: Rig, volume: ComparisonVolume) -> tuple[Comparison, Comparison]:
    """The comparison after the best similarity, and the metric one; lengths by `b` in images as `a` predicts them."""
    pairs = common_cameras(a, b)
    points = volume.grid()
    similarity = align(pairs, points, metric=False)
    rigid = align(pairs, points, metric=True)
    ppm = (similarity.scale - 1) * 1e6
    free, metric = (_comparison(a, b, pairs, volume, s, m) for s, m in ((similarity, False), (rigid, True)))
    return replace(free, scale_ppm=ppm), replace(metric, scale_ppm=ppm)


def _comparison(
    a: Rig, b: Rig, pairs: tuple[MatchedCamera, ...], volume: ComparisonVolume, b_from_a: Similarity, metric: bool
) -> Comparison:
    points, lengths = volume.grid(), _Lengths(volume)
    before = [pair.a for pair in pairs]
    after = [_brought_back(pair.b, b_from_a) for pair in pairs]
    effects = [_effect(before, [*before[:i], after[i], *before[i + 1 :]], lengths) for i in range(len(pairs))]
    changes = [_change(p, own, points, b_from_a, e) for p, own, e in zip(pairs, after, effects, strict=True)]
    whole = _effect(before, after, lengths)
    return Comparison(
        metric=metric,
        b_from_a=b_from_a,
        scale_ppm=0.0,
        volume=volume,
        cameras=tuple(sorted(_judged(changes), key=lambda c: (-c.ray_rms_mm, c.id))),
        point_mm=whole.point_mm,
        length_mm=whole.length_mm,
        of_length_mm=whole.of_length_mm,
        only_in_a=tuple(c.id for c in a.cameras if b.camera(c.id) is None),
        only_in_b=tuple(c.id for c in b.cameras if a.camera(c.id) is None),
    )


def _brought_back(camera: RigCamera, b_from_a: Similarity) -> RigCamera:
    """The second calibration's camera in the first world: it projects what the similarity maps to what it saw."""
    shift = (camera.rotation @ b_from_a.translation + camera.translation_mm) / b_from_a.scale
    return replace(camera, rotation=camera.rotation @ b_from_a.rotation, translation_mm=shift)


class _Lengths:
    """The points on a volume's surface and those pairs of them whose distances are judged."""

    def __init__(self, volume: ComparisonVolume) -> None:
        self.points = volume.surface()
        first, second = np.triu_indices(len(self.points), 1)
        length = np.linalg.norm(self.points[first] - self.points[second], axis=1)
        far = length >= 0.5 * float((volume.high_mm - volume.low_mm).max())
        self.first, self.second, self.length = first[far], second[far], length[far]


@dataclass(frozen=True)
class _Effect:
    """What other cameras do to measured points and lengths; None where nothing can be measured."""

    point_mm: float | None = None
    length_mm: float | None = None
    of_length_mm: float | None = None


def _effect(true: list[RigCamera], used: list[RigCamera], lengths: _Lengths) -> _Effect:
    """The largest error of a point and of a length when images that `true` makes are measured with `used`."""
    features, owners, images = [], [], []
    for i, camera in enumerate(true):
        inside, uv = sights(MatchedCamera(camera.id, camera, camera), lengths.points)
        rows = np.flatnonzero(inside)
        features.append(rows)
        owners.append(np.full(len(rows), i))
        images.append(uv[rows])
    feature, camera, uv = np.concatenate(features), np.concatenate(owners), np.concatenate(images)
    measured = triangulate(feature, camera, uv, np.ones(len(uv)), len(lengths.points), posed(used)).points
    off = np.linalg.norm(measured - lengths.points, axis=1)
    if not np.isfinite(off).any():
        return _Effect()
    change = np.linalg.norm(measured[lengths.first] - measured[lengths.second], axis=1) - lengths.length
    if not np.isfinite(change).any():
        return _Effect(float(np.nanmax(off)))
    worst = int(np.nanargmax(np.abs(change)))
    return _Effect(float(np.nanmax(off)), float(change[worst]), float(lengths.length[worst]))


def _change(
    pair: MatchedCamera, after: RigCamera, points: FloatArray, b_from_a: Similarity, effect: _Effect
) -> CameraChange:
    inside, uv = sights(pair, points)
    shift = shift_mm(pair, points[inside], uv[inside], b_from_a)
    ray = np.linalg.norm(shift, axis=1)
    depth = (points[inside] @ pair.a.rotation.T + pair.a.translation_mm)[:, 2]
    in_px = np.linalg.norm(shift * pair.a.intrinsics[:2] / depth[:, None], axis=1)
    centre = after.centre_mm - pair.a.centre_mm
    turn = np.rad2deg(log_rotation(after.rotation @ pair.a.rotation.T))
    return CameraChange(
        id=pair.id,
        replaced=None not in (pair.a.serial, pair.b.serial) and pair.a.serial != pair.b.serial,
        moved=False,
        centre_mm=centre,
        rotation_deg=turn,
        focal_px=float((pair.b.intrinsics[:2] - pair.a.intrinsics[:2]).mean()),
        ray_rms_mm=float(np.sqrt((ray**2).mean())) if len(ray) else np.nan,
        ray_max_mm=float(ray.max()) if len(ray) else np.nan,
        ray_max_px=float(in_px.max()) if len(ray) else np.nan,
        point_mm=effect.point_mm,
        length_mm=None if effect.length_mm is None else abs(effect.length_mm),
    )


# Two calibrations of one unchanged rig A or B (0.04 px noise): no camera's rays differ by more than 2.3 times the
# median of its rig; one camera turned by 0.01 deg gives 9 times or more, shifted by 0.1 mm 4.9 (studies/profiles.md).
# Shift and turn over their standard uncertainties say far less: 3.2 without any change, 0.8 for 0.01 deg, since what
# the pose loses the lens takes up.
_TIMES_THE_MEDIAN = 4.0
_LEAST_MOVE_MM = 0.005  # a tenth of what a reference bar may deviate: nobody is sent to a camera for less


def _judged(changes: list[CameraChange]) -> list[CameraChange]:
    """Which cameras have moved: their rays differ far more than most of the rig's."""
    ray = np.array([change.ray_rms_mm for change in changes])
    usual = float(np.nanmedian(ray)) if np.isfinite(ray).any() else np.nan
    limit = max(_TIMES_THE_MEDIAN * usual, _LEAST_MOVE_MM)
    return [replace(change, moved=bool(mm > limit)) for change, mm in zip(changes, ray, strict=True)]


def seen_volume(rig: Rig) -> ComparisonVolume:
    """Where most cameras look, for rigs without points: a cube about the optical axes, half as wide as it is far."""
    if len(rig.cameras) < 2:
        raise InputError(Phrase("error-no-volume"))
    axes = np.array([camera.rotation[2] for camera in rig.cameras])
    centres = np.array([camera.centre_mm for camera in rig.cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # a little pull towards a metre before the cameras keeps parallel axes from meeting at infinity
    ahead = centres + axes * max(float(np.ptp(centres, axis=0).max()), 1.0)
    pull = 1e-3 * np.eye(3)
    middle = np.linalg.solve(
        (across + pull).sum(axis=0), (across @ centres[:, :, None] + pull @ ahead[:, :, None]).sum(axis=0)
    )[:, 0]
    half = 0.25 * float(np.median(np.linalg.norm(centres - middle, axis=1)))
    return ComparisonVolume(middle - half, middle + half)
