"""The rig as a scene: cameras, dots coloured by their residuals, balls, uncertainties, bars and what has moved.

One model for all views of a rig: rendered (renderer.py) for window and report; in the window also painted
(widgets/painted_scene.py) and written as glTF (presenters/gltf.py). The report
draws the same `DrawnRig` (report.rig_view).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray

# From small to large values, distinct to colour-blind readers and in grey; on light and on dark ground.
_LIGHT = ((0x5B, 0x8D, 0xB8), (0xC9, 0x8A, 0x2B), (0xA6, 0x1E, 0x12))
_DARK = ((0x4F, 0x9F, 0xD8), (0xFF, 0xC0, 0x55), (0xFF, 0x6A, 0x5E))

AXIS_TINTS = ("#d0443a", "#2f9e5f", "#2b7fd0")  # x red, y green, z blue, as everywhere
# An ellipsoid, or a shift, is drawn so large that the largest of them is this part of the scene's radius.
_ELLIPSOID_PART, _SHIFT_PART = 0.05, 0.12
_BODY = 0.5  # of a frustum's depth
_FLOOR_STEPS = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0)
_FLOOR_LINES = 14  # at most, along the longer side
_MOST_POINTS = 6000


@dataclass(frozen=True)
class CameraFigures:
    """What is known of a camera: serial number, sensor px, rms px, sd of its place mm; None where not known."""

    serial: str = ""
    sensor_px: tuple[int, int] | None = None
    rms_px: float | None = None
    sd_mm: float | None = None


@dataclass(frozen=True, eq=False)
class SceneBar:
    """A bar: ends (3,), error and U of its length, mm; `level`: good, bad, or none where U is not known."""

    name: str
    start: FloatArray
    end: FloatArray
    error_mm: float | None
    expanded_mm: float | None
    level: str = "none"


@dataclass(frozen=True, eq=False)
class MovedCamera:
    """A camera that has moved: where its centre and the corners (4, 3) of its frustum were, and by how much."""

    id: str
    centre: FloatArray
    corners: FloatArray
    shift_mm: float
    turn_deg: float


@dataclass(frozen=True, eq=False)
class DrawnBall:
    """A ball that is wanted: its centre (3,) and radius, mm, and the centre (3,) from which it comes."""

    centre: FloatArray
    radius: float
    start: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class SceneData:
    """`scene` (report.rig_view), `points` (n, 3) in its frame, `sizes` (n,) of their residuals, 1 = `most_px`.

    `normals` (n, 3): outward from the ball, NaN where there is none; `names` (n,): placement, target and point.
    `map_places` (m, 3) and `map_mm` (m,): expanded uncertainty of a length `map_length_mm` there in its worst
    direction. `links`: steps of the paths by which the cameras were joined. `ellipsoids` (e, 3, 3): half axes by row,
    mm, of one standard deviation, at `ellipsoid_places` (e, 3). `images` (height, width) uint8: the last image of each
    camera, by id. `origin_mm` (3,): the scene's origin in the world. `wanted`: where the ball should go next. `room`
    (n, 3): more that must be in the picture.
    """

    scene: Any
    points: FloatArray
    sizes: FloatArray
    map_places: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    map_mm: FloatArray = field(default_factory=lambda: np.empty((0,)))
    map_length_mm: float = 0.0
    links: tuple[tuple[str, str], ...] = ()
    normals: FloatArray | None = None
    names: tuple[tuple[str, int, str], ...] = ()
    most_px: float = 0.0
    ellipsoid_places: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    ellipsoids: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)))
    figures: Mapping[str, CameraFigures] = field(default_factory=dict)
    bars: tuple[SceneBar, ...] = ()
    moved: tuple[MovedCamera, ...] = ()
    images: Mapping[str, Any] = field(default_factory=dict)
    origin_mm: FloatArray = field(default_factory=lambda: np.zeros(3))
    wanted: DrawnBall | None = None
    room: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    def __getstate__(self) -> dict[str, Any]:
        """A copy at once: it is sent to the process that renders while the window's thread works out `floor`."""
        return dict(self.__dict__)

    @property
    def link_ends(self) -> list[tuple[FloatArray, FloatArray]]:
        """The centres (3,) of the two cameras of each link."""
        centres = {camera.id: camera.centre for camera in self.scene.cameras}
        return [(centres[a], centres[b]) for a, b in self.links if a in centres and b in centres]

    @property
    def reference_axes(self) -> list[tuple[tuple[FloatArray, FloatArray], str]]:
        """The axes x, y, z of the reference camera, which are those of the world: both ends (3,), and the colour."""
        camera = next((one for one in self.scene.cameras if one.id == getattr(self.scene, "reference", None)), None)
        if camera is None:
            return []
        tips = zip(self.scene.axis_tips(camera), AXIS_TINTS, strict=True)
        return [((camera.centre, np.asarray(tip)), tint) for tip, tint in tips]

    @property
    def map_range(self) -> tuple[float, float]:
        """The least and the largest uncertainty of the map, mm; 0 and 1 without a map."""
        return (float(self.map_mm.min()), float(self.map_mm.max())) if len(self.map_mm) else (0.0, 1.0)

    def map_tints(self, dark: bool) -> list[tuple[int, int, int]]:
        """The colours (red, green, blue; 0 to 255) of the map's places, for a dark or a light background."""
        low, high = self.map_range
        return ramp((self.map_mm - low) / ((high - low) or 1.0), dark)

    def tints(self, dark: bool) -> list[tuple[int, int, int]]:
        """The colours (red, green, blue; 0 to 255) of the points, for a dark or a light background."""
        return ramp(self.sizes, dark)

    def box(self) -> tuple[float, float, float, float, float, float]:
        """The box with 98 % of the points along each axis: x0 x1 y0 y1 z0 z1, mm."""
        inside = self.points if len(self.points) else self.map_places if len(self.map_places) else np.zeros((1, 3))
        low, high = np.percentile(inside, (1, 99), axis=0)
        return (low[0], high[0], low[1], high[1], low[2], high[2])

    def every_place(self) -> FloatArray:
        """Places (n, 3) that must be in the picture: cameras, frusta, balls, dots, bars, axes."""
        parts = [np.vstack([camera.centre, camera.corners]) for camera in self.scene.cameras]
        for camera in self.scene.cameras:  # bodies and lenses lie behind the centre
            parts.append((camera.centre + _BODY * (camera.centre - camera.corners.mean(axis=0)))[None])
        parts += [self.points, self.map_places, self.room, *(np.vstack([bar.start, bar.end]) for bar in self.bars)]
        parts += [np.vstack(ends) for ends, _ in self.reference_axes]
        for placement in self.scene.placements:
            if placement.ball_centre is not None:
                reach = placement.ball_radius * np.vstack([np.eye(3), -np.eye(3)])
                parts.append(placement.ball_centre + reach)
        if self.wanted is not None:
            parts.append(self.wanted.centre + self.wanted.radius * np.vstack([np.eye(3), -np.eye(3)]))
        return np.vstack([part for part in parts if len(part)])

    @cached_property
    def floor(self) -> "Floor":
        """The ground under everything, with its grid."""
        every = self.every_place()
        low, high = every.min(axis=0), every.max(axis=0)
        longest = float((high - low)[:2].max())
        step = next((one for one in _FLOOR_STEPS if longest / one <= _FLOOR_LINES), longest / _FLOOR_LINES or 1.0)
        x0, y0 = (np.floor(low[:2] / step) * step).tolist()
        x1, y1 = (np.ceil(high[:2] / step) * step).tolist()
        return Floor(x0, x1, y0, y1, float(low[2]) - 0.02 * longest, step)

    @cached_property
    def radius(self) -> float:
        """Half the diagonal of all that is shown, mm."""
        every = self.every_place()
        return float(np.linalg.norm(every.max(axis=0) - every.min(axis=0)) / 2) or 1.0

    @cached_property
    def ellipsoid_factor(self) -> float:
        """By how much the ellipsoids are drawn larger than they are: 1, 2 or 5 times a power of ten."""
        longest = float(np.linalg.norm(self.ellipsoids, axis=2).max()) if len(self.ellipsoids) else 0.0
        return round_factor(_ELLIPSOID_PART * self.radius, longest)

    @cached_property
    def shift_factor(self) -> float:
        """By how much the shift of moved cameras is drawn longer than it is: 1, 2 or 5 times a power of ten."""
        now = {camera.id: camera for camera in self.scene.cameras}
        ways = [np.abs(now[one.id].corners - one.corners).max() for one in self.moved if one.id in now]
        return round_factor(_SHIFT_PART * self.radius, float(max(ways, default=0.0)))

    @cached_property
    def dot_radius(self) -> float:
        """Radius in mm with which a dot is drawn: a little less than half the usual distance to the next dot."""
        if len(self.points) < 2:
            return 0.01 * self.radius
        from scipy.spatial import KDTree

        ways = KDTree(self.points).query(self.points, k=2)[0][:, 1]
        return float(np.clip(0.45 * np.median(ways), 2e-3 * self.radius, 0.02 * self.radius))

    def flat(self, side: str, places: FloatArray) -> FloatArray:
        """Places in the plane of one of the report's views, (n, 2) mm; `places`: places in the scene, (n, 3) mm."""
        from spherecal_documents.report.rig_view import FRONT, OBLIQUE, SIDE, TOP

        view = {"oblique": OBLIQUE, "top": TOP, "front": FRONT, "side": SIDE}[side]
        return view.flat(np.asarray(places))


@dataclass(frozen=True)
class Floor:
    """A rectangle at the height z with lines every `step` mm; all lengths in mm."""

    x0: float
    x1: float
    y0: float
    y1: float
    z: float
    step: float

    def lines(self) -> FloatArray:
        """Both ends of all lines, (n, 2, 3) mm."""
        xs = np.arange(self.x0, self.x1 + self.step / 2, self.step)
        ys = np.arange(self.y0, self.y1 + self.step / 2, self.step)
        along = [[(x, self.y0, self.z), (x, self.y1, self.z)] for x in xs]
        across = [[(self.x0, y, self.z), (self.x1, y, self.z)] for y in ys]
        return np.array([*along, *across], dtype=float)


def round_factor(wanted: float, size: float) -> float:
    """The largest of 1, 2, 5, 10, 20, ... by which `size` stays within `wanted`; 1 where it is larger already."""
    if size <= 0 or wanted <= size:
        return 1.0
    ratio = wanted / size
    power = 10.0 ** np.floor(np.log10(ratio))
    return float(power * next(step for step in (5.0, 2.0, 1.0) if step * power <= ratio * (1 + 1e-12)))


def ramp(sizes: FloatArray, dark: bool) -> list[tuple[int, int, int]]:
    """Colours (red, green, blue; 0 to 255) for sizes from 0 to 1."""
    table = np.array(_DARK if dark else _LIGHT, dtype=float)
    where = np.clip(sizes, 0, 1) * 2
    low = np.minimum(where.astype(int), 1)
    mixed = table[low] + (where - low)[:, None] * (table[low + 1] - table[low])
    return [(int(r), int(g), int(b)) for r, g, b in mixed]


# --- from a result ---------------------------------------------------------------------------------------------------


def scene_data(result: Any, links: tuple[tuple[str, str], ...] = ()) -> SceneData | None:
    """The scene of a result; None without cameras."""
    from spherecal_documents.report.rig_view import make_scene

    if not result.rig.cameras:
        return None
    scene = make_scene(result)
    points = result.points
    xyz = points.xyz_mm
    middle = xyz.mean(axis=0) if len(xyz) else np.array([c.centre_mm for c in result.rig.cameras]).mean(axis=0)
    sizes = point_residuals(result)
    keep = np.arange(0, len(xyz), max(1, -(-len(xyz) // _MOST_POINTS)))
    usual = float(np.percentile(sizes, 98)) if len(sizes) else 1.0
    places = (xyz[keep] - middle) @ scene.axes.T
    names = tuple((points.placement[i], int(points.target[i]), points.point[i]) for i in keep.tolist())
    shown = SceneData(
        scene, places, sizes[keep] / (usual or 1.0), links=links, normals=_normals(scene, places, names), names=names,
        most_px=usual, figures=_figures(result.rig), origin_mm=middle,
    )  # fmt: skip
    shown = replace(shown, **_ellipsoids(result, scene.axes, middle))
    lengths = result.rig.length_map
    if lengths is None:
        return shown
    worst = np.where(np.isfinite(lengths.expanded_mm), lengths.expanded_mm, -1.0).max(axis=1)
    seen = worst >= 0
    return replace(
        shown,
        map_places=(lengths.places_mm[seen] - middle) @ scene.axes.T,
        map_mm=worst[seen],
        map_length_mm=lengths.length_mm,
    )


def _normals(scene: Any, places: FloatArray, names: Sequence[tuple[str, int, str]]) -> FloatArray:
    """Outward from each point's ball; NaN where its placement has none."""
    centres = {one.name: one.ball_centre for one in scene.placements if one.ball_centre is not None}
    nowhere = np.full(3, np.nan)
    own = np.array([centres.get(name, nowhere) for name, _, _ in names]).reshape(-1, 3)
    out = places - own
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)


def _figures(rig: Any) -> dict[str, CameraFigures]:
    return {
        one.id: CameraFigures(
            one.serial or "",
            tuple(one.image_size),
            one.rms_px,
            None if one.sigma is None else float(np.linalg.norm(one.sigma.centre_mm)),
        )
        for one in rig.cameras
    }


def _ellipsoids(result: Any, axes: FloatArray, middle: FloatArray) -> dict[str, FloatArray]:
    """One standard deviation of each camera's place and of each target's (the mean of its points), as half axes."""
    places, halves = [], []
    for camera in result.rig.cameras:
        if camera.sigma is not None and np.isfinite(camera.sigma.centre_mm).all():
            places.append((camera.centre_mm - middle)[None] @ axes.T)
            halves.append((np.diag(camera.sigma.centre_mm) @ axes.T)[None])
    points = result.points
    known = np.isfinite(points.sigma_mm).all(axis=1)
    keys = [f"{name}/{target}" for name, target in zip(points.placement, points.target.tolist(), strict=True)]
    if known.any():
        _, which = np.unique(np.array(keys)[known], return_inverse=True)
        count = np.bincount(which)[:, None]
        mean, sigma = (
            np.column_stack([np.bincount(which, column) for column in table[known].T]) / count
            for table in (points.xyz_mm, points.sigma_mm)
        )
        places.append((mean - middle) @ axes.T)
        halves.append(np.einsum("ij,jk->ijk", sigma, axes.T))
    if not places:
        return {}
    return {"ellipsoid_places": np.vstack(places), "ellipsoids": np.vstack(halves)}


def point_residuals(result: Any) -> FloatArray:
    """The rms residual (n,) px of every point over the images that were used, 0 where there are none."""
    points, table = result.points, result.residuals
    row = {key: i for i, key in enumerate(zip(points.placement, points.target.tolist(), points.point, strict=True))}
    keys = zip(table.placement, table.target.tolist(), table.point, strict=True)
    at: IntArray = np.array([row.get(key, -1) for key in keys], dtype=np.int64)
    take = (at >= 0) & table.used
    square = np.bincount(at[take], (table.du_dv[take] ** 2).sum(axis=1), len(row))
    count = np.bincount(at[take], minlength=len(row))
    return np.sqrt(square / np.maximum(count, 1))


# --- what else can be shown ------------------------------------------------------------------------------------------


def with_bars(data: SceneData, report: Any, places: Mapping[str, Any]) -> SceneData:
    """The scene with the measured bars whose marks are known; `bad` where the error is larger than U (k = 2)."""
    bars = []
    for row in report.measured if report is not None else ():
        ends = [places.get(f"{row.pose}/{mark}") for mark in (row.from_mark, row.to_mark)]
        if None in ends:
            continue
        start, end = (
            (np.asarray(one.place_mm) - data.origin_mm) @ data.scene.axes.T for one in ends if one is not None
        )
        expanded = None if row.u_mm is None else 2.0 * row.u_mm
        level = "none" if expanded is None else "good" if abs(row.error_mm) <= expanded else "bad"
        bars.append(SceneBar(f"{row.pose} {row.from_mark}-{row.to_mark}", start, end, row.error_mm, expanded, level))
    return replace(data, bars=tuple(bars))


def with_moved(data: SceneData, changes: Sequence[tuple[str, FloatArray, FloatArray]]) -> SceneData:
    """The scene with cameras that have moved; `changes` (3,) mm."""
    from spherecal.geometry.rotation import exp_rotation

    now = {camera.id: camera for camera in data.scene.cameras}
    moved = []
    for name, shift_mm, turn_deg in changes:
        if name not in now:
            continue
        camera = now[name]
        back = exp_rotation(-np.deg2rad(np.asarray(turn_deg, dtype=float)))
        own = (camera.corners - camera.centre) @ camera.axes.T
        centre = camera.centre - data.scene.axes @ np.asarray(shift_mm, dtype=float)
        corners = centre + own @ (back @ camera.axes)
        size = float(np.linalg.norm(shift_mm)), float(np.linalg.norm(turn_deg))
        moved.append(MovedCamera(name, centre, corners, *size))
    return replace(data, moved=tuple(moved))


def with_images(data: SceneData, images: Mapping[str, Any]) -> SceneData:
    """The scene with the last image of each camera; `images`: images (height, width) by camera id, 0 to 255."""
    return replace(data, images={name: np.asarray(image, dtype=np.uint8) for name, image in images.items()})
