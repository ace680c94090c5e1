"""The shapes of a scene as triangles, lines and pictures: what is rendered and what a glTF file has."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray, IntArray
from spherecal_documents.scene.model import SceneData

LAYERS = ("map", "links", "ellipsoids", "images", "dots")
SHOWN_AT_FIRST = frozenset(("images", "dots"))
_BALL = (40, 20)  # meridians and parallels of a ball
_DOT = 10  # corners of a dot
_RING = 48  # sides of a circle
_TUBE = 20  # corners of a lens
_LIFT = 0.12  # dots lie this part of their radius above the ball, else its surface shows through
_ATLAS_PX = 320  # the longer side of one camera's image on its frustum
CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
_CUBE_FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
     (1, 5, 7), (1, 7, 3)]
)  # fmt: skip
CUBE_EDGES = ((0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7))

Tint = tuple[int, int, int]
ByteArray = NDArray[np.uint8]


@dataclass(frozen=True)
class SceneStyle:
    """The colours of a scene by what they mean; `layers` are those of LAYERS that are shown, `marked` a camera."""

    dark: bool
    ground: Tint
    line: Tint
    text: Tint
    accent: Tint
    good: Tint
    caution: Tint
    bad: Tint
    layers: frozenset[str] = SHOWN_AT_FIRST
    marked: str | None = None


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles: vertices (n, 3), faces (m, 3), colours (n, 3) uint8; normals smooth or by face; `plain`: not lit."""

    vertices: FloatArray
    faces: IntArray
    colours: ByteArray
    smooth: bool = True
    plain: bool = False
    name: str = ""


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines: both ends (n, 2, 3) mm, colours (n, 3) uint8, their width in px."""

    ends: FloatArray
    colours: ByteArray
    width: float = 1.5
    name: str = ""


@dataclass(frozen=True, eq=False)
class Picture:
    """Quadrilaterals with parts of one picture: corners (n, 4, 3), their places in it (n, 4, 2) from 0 to 1."""

    corners: FloatArray
    uv: FloatArray
    image: ByteArray


@dataclass(frozen=True, eq=False)
class Shapes:
    """All of a scene."""

    meshes: tuple[Mesh, ...] = ()
    lines: tuple[Lines, ...] = ()
    picture: Picture | None = None
    background: Tint = field(default=(0, 0, 0))


def scene_shapes(data: SceneData, style: SceneStyle) -> Shapes:
    """Everything that the style shows of a scene."""
    shown = style.layers
    meshes = [*_cameras(data, style), *_balls(data, style), *_bars(data, style)]
    if "map" in shown and len(data.map_mm):
        meshes.append(_map(data, style))
    elif "dots" in shown:
        meshes.append(_dots(data, style))
    if "ellipsoids" in shown and len(data.ellipsoids):
        tints = _same(blended(style.caution, style.text, 0.15), len(data.ellipsoids))
        made = _blobs(data.ellipsoid_places, data.ellipsoid_factor * data.ellipsoids, tints, 12, 6)
        meshes.append(replace(made, name="uncertainty ellipsoids"))
    picture = _picture(data) if "images" in shown and data.images else None
    return Shapes(
        tuple(mesh for mesh in meshes if len(mesh.faces)), tuple(scene_lines(data, style)), picture, style.ground
    )


def scene_lines(data: SceneData, style: SceneStyle) -> list[Lines]:
    """Floor, frusta, volume, axes, what has moved, and the paths where they are shown."""
    lines = [_floor(data, style), _frusta(data, style), _box(data, style), *_axes(data), *_moved(data, style)]
    lines += [*_rings(data, style), *_wanted(data, style)]
    if "links" in style.layers and data.links:
        ends = np.array(data.link_ends)
        lines.append(Lines(ends, _same(style.accent, len(ends)), 3.0, "paths"))
    return [one for one in lines if len(one.ends)]


def _same(tint: Sequence[int], count: int) -> ByteArray:
    return np.tile(np.array(tint, dtype=np.uint8), (count, 1))


def blended(first: Sequence[int], second: Sequence[int], share: float) -> Tint:
    """The colour between two."""
    r, g, b = ((1 - share) * np.array(first) + share * np.array(second)).round().astype(int).tolist()
    return r, g, b


def joined(meshes: Sequence[Mesh], smooth: bool, name: str = "") -> Mesh:
    """Several meshes as one."""
    if not meshes:
        return Mesh(
            np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), np.empty((0, 3), dtype=np.uint8), smooth, name=name
        )
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.vstack([mesh.vertices for mesh in meshes]),
        np.vstack([mesh.faces + start for mesh, start in zip(meshes, first, strict=False)]),
        np.vstack([mesh.colours for mesh in meshes]),
        smooth,
        name=name,
    )


# --- cameras ---------------------------------------------------------------------------------------------------------


def _cameras(data: SceneData, style: SceneStyle) -> list[Mesh]:
    """Bodies with sensor and lens, the lens ending at the projection centre."""
    bodies, lenses = [], []
    body, metal = ((0x86, 0x93, 0xA0), (0x4C, 0x58, 0x64)) if style.dark else ((0x9A, 0xA6, 0xB1), (0x3A, 0x44, 0x4E))
    moved = {one.id for one in data.moved}
    for camera in data.scene.cameras:
        box, axes, size, barrel = body_of(camera)
        tint = style.bad if camera.id in moved else style.accent if camera.id == style.marked else body
        bodies.append(Mesh(box, _CUBE_FACES, _same(tint, 8), smooth=False))
        rear = box[::2].mean(axis=0)
        plug = np.array([0.3, 0.3, 0.1]) * size
        bodies.append(Mesh(rear - 0.1 * size * axes[2] + (CUBE * plug) @ axes, _CUBE_FACES, _same(metal, 8), False))
        lenses.append(_tube(camera.centre - barrel * axes[2], camera.centre, 0.34 * size, 0.4 * size, axes, metal))
        lenses.append(
            _discs(camera.centre[None], axes[2:], 0.3 * size, _same(blended(style.accent, (0, 0, 0), 0.45), 1))
        )
    return [joined(bodies, smooth=False, name="cameras"), joined(lenses, smooth=False, name="lenses")]


def body_of(camera: Any) -> tuple[FloatArray, FloatArray, float, float]:
    """A camera's body: its corners (8, 3), axes (3, 3) by row, size and the length of its lens, mm of the scene."""
    axes = camera_axes(camera)
    across, high = (float(np.linalg.norm(camera.corners[i] - camera.corners[0])) for i in (1, 3))
    depth = float(np.linalg.norm(camera.corners.mean(axis=0) - camera.centre))
    size = 0.28 * depth
    half = size * np.array([0.45, 0.45 * float(np.clip(high / max(across, 1e-9), 0.7, 1.4)), 0.55])
    # a long lens looks long: depth over half the sensor's side is the focal length in half sides
    barrel = size * float(np.clip(0.2 * depth / max(across / 2, 1e-9), 0.35, 1.1))
    return camera.centre - (barrel + half[2]) * axes[2] + (CUBE * half) @ axes, axes, size, barrel


def camera_axes(camera: Any) -> FloatArray:
    """The camera's axes (3, 3) by row: right, down, forward."""
    axes = getattr(camera, "axes", None)
    if axes is not None:
        return np.asarray(axes)
    corners, centre = np.asarray(camera.corners), np.asarray(camera.centre)
    right, ahead = corners[1] - corners[0], corners.mean(axis=0) - centre
    right, ahead = right / np.linalg.norm(right), ahead / np.linalg.norm(ahead)
    return np.vstack([right, np.cross(ahead, right), ahead])


def _tube(start: FloatArray, end: FloatArray, near: float, far: float, axes: FloatArray, tint: Tint) -> Mesh:
    """A lens barrel, a little wider in front, open there."""
    turn = np.linspace(0, 2 * np.pi, _TUBE, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn)]) @ axes[:2]
    vertices = np.vstack([start + near * ring, end + far * ring])
    i, j = np.arange(_TUBE), (np.arange(_TUBE) + 1) % _TUBE
    faces = np.vstack([np.column_stack([i, j, i + _TUBE]), np.column_stack([j, j + _TUBE, i + _TUBE])])
    return Mesh(vertices, faces, _same(tint, len(vertices)), smooth=False)


def _frusta(data: SceneData, style: SceneStyle) -> Lines:
    ends, tints = [], []
    for camera in data.scene.cameras:
        tint = style.accent if camera.id == style.marked else blended(style.text, style.ground, 0.35)
        for i in range(4):
            ends += [(camera.centre, camera.corners[i]), (camera.corners[i], camera.corners[(i + 1) % 4])]
            tints += [tint, tint]
    return Lines(np.array(ends).reshape(-1, 2, 3), np.array(tints, dtype=np.uint8).reshape(-1, 3), 1.5, "frusta")


def _picture(data: SceneData) -> Picture | None:
    """The cameras' last images on the ends of their frusta, all in one picture."""
    there = [camera for camera in data.scene.cameras if camera.id in data.images]
    if not there:
        return None
    small = [shrunk(data.images[camera.id], _ATLAS_PX) for camera in there]
    high, wide = (max(image.shape[axis] for image in small) for axis in (0, 1))
    columns = int(np.ceil(np.sqrt(len(small))))
    rows = -(-len(small) // columns)
    atlas = np.zeros((rows * high, columns * wide), dtype=np.uint8)
    uv = []
    for k, image in enumerate(small):
        top, left = k // columns * high, k % columns * wide
        h, w = image.shape
        low, high_grey = np.percentile(image, (1, 99.5))  # images of a dark hall are still to be seen
        brighter = np.clip((image - low) * (235 / max(high_grey - low, 30.0)) + 10, 0, 255)
        atlas[top : top + h, left : left + w] = brighter.astype(np.uint8)
        edge = np.array([(left, top), (left + w, top), (left + w, top + h), (left, top + h)], dtype=float)
        uv.append(edge / (columns * wide, rows * high))
    return Picture(np.array([camera.corners for camera in there]), np.array(uv), atlas)


def shrunk(image: Any, longest: int) -> ByteArray:
    """An image (h, w) uint8 with every k by k pixels averaged, so that its longer side is at most `longest` px."""
    k = max(1, -(-max(image.shape) // longest))
    h, w = (side // k * k for side in image.shape)
    return image[:h, :w].reshape(h // k, k, w // k, k).mean(axis=(1, 3)).round().astype(np.uint8)


# --- balls, dots, ellipsoids, the map --------------------------------------------------------------------------------


def _balls(data: SceneData, style: SceneStyle) -> list[Mesh]:
    tint = (0x3A, 0x45, 0x50) if style.dark else (0xE6, 0xEA, 0xEE)
    unit, faces = _sphere(*_BALL)
    if not solid_balls(data, style.layers):
        return []
    made = [
        Mesh(one.ball_centre + one.ball_radius * unit, faces, _same(tint, len(unit)))
        for one in data.scene.placements
        if one.ball_centre is not None
    ]
    return [joined(made, smooth=True, name="balls")]


def solid_balls(data: SceneData, layers: frozenset[str]) -> bool:
    """Whether the balls are drawn as bodies: they would hide bars and the map, which are inside them."""
    return not data.bars and not ("map" in layers and len(data.map_mm))


def _circles() -> FloatArray:
    """Three circles of a unit ball, (3, n, 3)."""
    turn = np.linspace(0, 2 * np.pi, _RING + 1)
    c, s, o = np.cos(turn), np.sin(turn), np.zeros(_RING + 1)
    return np.stack([np.column_stack(one) for one in ((c, s, o), (c, o, s), (o, c, s))])


def _wanted(data: SceneData, style: SceneStyle) -> list[Lines]:
    """The ball where it should go, and the way there with a head."""
    wanted = data.wanted
    if wanted is None:
        return []
    rings = wanted.centre + wanted.radius * _circles()
    ends = [np.stack([places[:-1], places[1:]], axis=1) for places in rings]
    if wanted.start is not None and (length := float(np.linalg.norm(wanted.centre - wanted.start))) > 1e-6:
        ahead = (wanted.centre - wanted.start) / length
        side = np.cross(ahead, [0.0, 0, 1] if abs(ahead[2]) < 0.9 else [1.0, 0, 0])
        side /= np.linalg.norm(side)
        head = 0.25 * wanted.radius
        tips = [wanted.centre - head * ahead + sign * 0.5 * head * side for sign in (-1, 1)]
        ends.append(np.array([(wanted.start, wanted.centre), *((wanted.centre, tip) for tip in tips)]))
    every = np.vstack(ends)
    return [Lines(every, _same(style.accent, len(every)), 2.5, "next")]


def _rings(data: SceneData, style: SceneStyle) -> list[Lines]:
    """Three circles for each ball, where it is not drawn as a body."""
    rings = _circles()
    balls = [one for one in data.scene.placements if one.ball_centre is not None]
    if not balls or solid_balls(data, style.layers):
        return []
    ends = [
        np.stack([places[:-1], places[1:]], axis=1)
        for one in balls
        for places in one.ball_centre + one.ball_radius * rings
    ]
    every = np.vstack(ends)
    return [Lines(every, _same(blended(style.line, style.text, 0.12), len(every)), 1.0, "balls")]


def _sphere(around: int, up: int) -> tuple[FloatArray, IntArray]:
    """A unit sphere: vertices (n, 3) and faces (m, 3)."""
    lat, lon = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, up + 1), np.arange(around) * 2 * np.pi / around)
    vertices = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1).reshape(-1, 3)
    i, j = (one.ravel() for one in np.meshgrid(np.arange(around), np.arange(up), indexing="ij"))
    a, b = i * (up + 1) + j, (i + 1) % around * (up + 1) + j
    return vertices, np.vstack([np.column_stack([a, b, b + 1]), np.column_stack([a, b + 1, a + 1])])


def _dots(data: SceneData, style: SceneStyle) -> Mesh:
    tints = np.array(data.tints(style.dark), dtype=np.uint8).reshape(-1, 3)
    radius = data.dot_radius
    normals = data.normals if data.normals is not None else np.full_like(data.points, np.nan)
    on_ball = np.isfinite(normals).all(axis=1)
    flat = _discs(data.points[on_ball] + _LIFT * radius * normals[on_ball], normals[on_ball], radius, tints[on_ball])
    round_ones = _blobs(data.points[~on_ball], 0.7 * radius * np.eye(3)[None], tints[~on_ball], 6, 4)
    return replace(joined([flat, round_ones], smooth=False, name="dots"), plain=True)


def _discs(places: FloatArray, normals: FloatArray, radius: float, tints: ByteArray) -> Mesh:
    """A flat dot at each place."""
    turn = np.linspace(0, 2 * np.pi, _DOT, endpoint=False)
    other = np.where(np.abs(normals[:, 2:3]) < 0.9, np.array([[0.0, 0, 1]]), np.array([[1.0, 0, 0]]))
    right = np.cross(normals, other)
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-12)
    up = np.cross(normals, right)
    ring = np.cos(turn)[None, :, None] * right[:, None] + np.sin(turn)[None, :, None] * up[:, None]
    vertices = (places[:, None] + radius * ring).reshape(-1, 3)
    fan = np.array([(0, i, i + 1) for i in range(1, _DOT - 1)])
    faces = (np.arange(len(places))[:, None, None] * _DOT + fan[None]).reshape(-1, 3)
    return Mesh(vertices, faces, np.repeat(tints, _DOT, axis=0), smooth=False)


def _blobs(places: FloatArray, halves: FloatArray, tints: ByteArray, around: int, up: int) -> Mesh:
    """Ellipsoids with the half axes (n or 1, 3, 3) by row."""
    unit, faces = _sphere(around, up)
    each = np.einsum("vk,nkj->nvj", unit, np.broadcast_to(halves, (len(places), 3, 3)))
    vertices = (places[:, None] + each).reshape(-1, 3)
    every = (np.arange(len(places))[:, None, None] * len(unit) + faces[None]).reshape(-1, 3)
    return Mesh(vertices, every, np.repeat(tints, len(unit), axis=0), smooth=True)


def _map(data: SceneData, style: SceneStyle) -> Mesh:
    """The volume in cells with gaps, through which those inside are seen."""
    tints = np.array(data.map_tints(style.dark), dtype=np.uint8)
    half = 0.34 * map_step(data.map_places)
    vertices = (data.map_places[:, None] + (half * CUBE)[None]).reshape(-1, 3)
    faces = (np.arange(len(tints))[:, None, None] * 8 + _CUBE_FACES[None]).reshape(-1, 3)
    return Mesh(vertices, faces, np.repeat(tints, 8, axis=0), smooth=False, name="length uncertainty")


def map_step(places: FloatArray) -> float:
    """The distance from a place of the map to the next one, mm; 100 mm for a single place."""
    if len(places) < 2:
        return 100.0
    from scipy.spatial import KDTree

    return float(np.median(KDTree(places).query(places, k=2)[0][:, 1]))


# --- bars, floor, axes, what has moved -------------------------------------------------------------------------------


def _bars(data: SceneData, style: SceneStyle) -> list[Mesh]:
    made = []
    for bar in data.bars:
        tint = {"good": style.good, "bad": style.bad, "caution": style.caution}.get(bar.level, style.accent)
        way = bar.end - bar.start
        length = float(np.linalg.norm(way)) or 1.0
        ahead = way / length
        other = np.array([0.0, 0, 1]) if abs(ahead[2]) < 0.9 else np.array([1.0, 0, 0])
        right = np.cross(ahead, other)
        right /= np.linalg.norm(right)
        axes = np.vstack([right, np.cross(ahead, right), ahead])
        thick = 0.008 * data.radius
        made.append(_tube(bar.start, bar.end, thick, thick, axes, tint))
        for end in (bar.start, bar.end):
            made.append(_blobs(end[None], 2.2 * thick * np.eye(3)[None], _same(tint, 1), 12, 8))
    return [joined(made, smooth=True, name="bars")]


def _floor(data: SceneData, style: SceneStyle) -> Lines:
    lines = data.floor.lines()
    return Lines(lines, _same(blended(style.line, style.text, 0.08), len(lines)), 1.0, "floor")


def _box(data: SceneData, style: SceneStyle) -> Lines:
    """The volume that was calibrated."""
    x0, x1, y0, y1, z0, z1 = data.box()
    if x1 <= x0 or y1 <= y0 or z1 <= z0:  # no dots yet
        return Lines(np.empty((0, 2, 3)), np.empty((0, 3), dtype=np.uint8))
    corners = np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)])
    ends = np.array([(corners[i], corners[j]) for i, j in CUBE_EDGES])
    return Lines(ends, _same(blended(style.good, style.ground, 0.3), len(ends)), 1.5, "volume")


def _axes(data: SceneData) -> list[Lines]:
    ends = [pair for pair, _ in data.reference_axes]
    tints = [rgb(tint) for _, tint in data.reference_axes]
    return [Lines(np.array(ends), np.array(tints, dtype=np.uint8), 4.0, "axes")] if ends else []


def rgb(name: str) -> Tint:
    """The three parts of a colour such as #2f9e5f."""
    return int(name[1:3], 16), int(name[3:5], 16), int(name[5:7], 16)


def _moved(data: SceneData, style: SceneStyle) -> list[Lines]:
    """Before, so many times as far off, in the colour of caution; lines from there to where the camera is now."""
    ends = []
    now = {camera.id: np.vstack([camera.centre, camera.corners]) for camera in data.scene.cameras}
    for one in data.moved:
        if one.id not in now:
            continue
        before = now[one.id] + data.shift_factor * (np.vstack([one.centre, one.corners]) - now[one.id])
        ends += [(before[0], before[i]) for i in range(1, 5)]
        ends += [(before[i], before[i % 4 + 1]) for i in range(1, 5)]
        ends += list(zip(before, now[one.id], strict=True))
    return [Lines(np.array(ends), _same(style.caution, len(ends)), 2.0, "before")] if ends else []
