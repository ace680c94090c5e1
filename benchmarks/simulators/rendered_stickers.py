"""Stickers and boards rendered flat."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from spherecal.base.arrays import FloatArray
from spherecal.geometry.camera import camera_matrix, intrinsics_vector, undistort
from spherecal.targets.target_set import TargetSet
from spherecal_boards.board_pattern import Figure
from spherecal_files.target_set_file import marker_bits, sticker_mm, write_target_set

_NODES = 16  # px between the places where the lens is undone exactly
_RAYS = 3  # a pixel and direction
_PX_PER_MM = 16  # of the painted stickers: 8 rays wide where a sticker of 28 mm has 56 px
_SOFT = 5  # painted pixels: the distance of rays where a sticker of 28 mm has 30 px
_GROUND, _NOTHING = 0.55, 0.12
_LENS = (-0.1, 0.05, 0.0005, -0.0003, 0.0)


@dataclass(frozen=True)
class StickerBall:
    """A ball with the stickers of a set, at unit vectors `places` (n, 3), their x in the direction `right` (n, 3)."""

    targets: TargetSet
    radius_mm: float
    places: FloatArray
    right: FloatArray


@dataclass(frozen=True)
class StickerCamera:
    """A camera: intrinsics (16,), size (width, height) px, pose x_camera = rotation @ x_world + translation, mm."""

    id: str
    intrinsics: FloatArray
    size: tuple[int, int]
    rotation: FloatArray
    translation: FloatArray


def sticker_ball(targets: TargetSet, radius_mm: float, random: np.random.Generator) -> StickerBall:
    """The stickers of a set spread evenly over a ball, each turned at random."""
    n = len(targets.layouts)
    z = 1 - (2 * np.arange(n) + 1) / n
    angle = np.arange(n) * np.pi * (3 - 5**0.5)
    flat = np.sqrt(1 - z**2)
    places = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])
    other = random.normal(size=(n, 3))
    right = other - (other * places).sum(axis=1, keepdims=True) * places
    return StickerBall(targets, radius_mm, places, right / np.linalg.norm(right, axis=1, keepdims=True))


def painted_stickers(targets: TargetSet) -> NDArray[np.float32]:
    """The stickers (n, side, side) as printed, 0 black to 1 white."""
    side = sticker_mm(targets)
    at = (np.arange(round(side * _PX_PER_MM)) + 0.5) / _PX_PER_MM - side / 2
    out = []
    for target, layout in targets.layouts.items():
        if targets.dictionary is not None:
            bits = np.pad(marker_bits(targets.dictionary, target), 1, constant_values=1.0)
            cell = np.clip(np.floor((at / side + 0.5) * len(bits)).astype(int), 0, len(bits) - 1)
            printed = 1 - bits if targets.polarity == "light-on-dark" else bits
            out.append(printed[np.ix_(cell, cell)])
            continue
        dots = np.zeros((len(at), len(at)))
        for u, v in layout.values():
            columns, rows = (_near(at, c, targets.dot_diameter_mm / 2 + 1 / _PX_PER_MM) for c in (u, v))
            away = np.hypot(at[None, columns] - u, at[rows, None] - v)
            inside = np.clip((targets.dot_diameter_mm / 2 - away) * _PX_PER_MM + 0.5, 0, 1)
            dots[rows, columns] = np.maximum(dots[rows, columns], inside)
        out.append(dots if targets.polarity == "light-on-dark" else 1 - dots)
    # as wide as the rays are apart: without it, edges are stairs
    return np.array([cv2.blur(one.astype(np.float32), (_SOFT, _SOFT)) for one in out], np.float32)


def _near(at: FloatArray, centre: float, reach: float) -> slice:
    """The part of rising values that is at most `reach` from a centre."""
    first, last = np.searchsorted(at, (centre - reach, centre + reach))
    return slice(int(first), int(last))


def render_stickers(
    ball: StickerBall,
    painted: NDArray[np.float32],
    camera: StickerCamera,
    turn: FloatArray,
    place: FloatArray,
    random: np.random.Generator,
    blur_px: float = 0.6,
    noise_grey: float = 1.5,
) -> NDArray[np.uint8]:
    """The grey image (h, w) of the ball, turned by (3, 3) ball to world, its centre at (3,) mm."""
    width, height = camera.size
    steps = [np.arange(side * _RAYS) / _RAYS - 0.5 + 0.5 / _RAYS for side in camera.size]
    fine = np.full((height * _RAYS, width * _RAYS), _NOTHING, np.float32)
    # of the ball only the part of the image that it can reach
    centre = camera.rotation @ place + camera.translation
    focal, middle = camera.intrinsics[:2].mean(), camera.intrinsics[2:4]
    reach = 1.3 * focal * ball.radius_mm / centre[2] + 20
    seen = middle + focal * centre[:2] / centre[2]
    columns, rows = (_near(step, c, reach + 1) for step, c in zip(steps, seen, strict=True))
    steps = [steps[0][columns], steps[1][rows]]
    uv = np.stack(np.meshgrid(*steps), axis=-1)
    near = np.linalg.norm(uv - middle - focal * centre[:2] / centre[2], axis=-1) < reach
    rays = np.column_stack([_undistorted(camera, steps)[near], np.ones(near.sum())])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    along = rays @ centre
    inside = along**2 - centre @ centre + ball.radius_mm**2
    met = inside > 0
    surface = (rays[met] * (along[met] - np.sqrt(inside[met]))[:, None] - centre) / ball.radius_mm
    value = np.full(len(rays), _NOTHING, np.float32)
    value[met] = _grey(ball, painted, surface @ camera.rotation @ turn)
    fine[rows, columns][near] = value
    image = fine.reshape(height, _RAYS, width, _RAYS).mean(axis=(1, 3))
    image = 20 + 200 * cv2.GaussianBlur(image, (0, 0), blur_px)
    return np.clip(np.rint(image + random.normal(0, noise_grey, image.shape)), 0, 255).astype(np.uint8)


def _undistorted(camera: StickerCamera, steps: list[FloatArray]) -> FloatArray:
    """Where the rays of a grid of image places meet the plane z = 1, (rows, columns, 2)."""
    nodes = [np.append(np.arange(-0.5, side, _NODES), side + _NODES) for side in camera.size]
    xy, _ = undistort(np.stack(np.meshgrid(*nodes), axis=-1).reshape(-1, 2), camera.intrinsics)
    grids = xy.reshape(len(nodes[1]), len(nodes[0]), 2)
    splines = [RectBivariateSpline(nodes[1], nodes[0], grids[..., axis]) for axis in (0, 1)]
    return np.stack([spline(steps[1], steps[0]) for spline in splines], axis=-1)


def _grey(ball: StickerBall, painted: NDArray[np.float32], at: FloatArray) -> NDArray[np.float32]:
    """The grey of places (m, 3) on the unit ball: of the sticker bent onto it there, or of the ball."""
    own = np.asarray(KDTree(ball.places).query(at)[1])
    up, right, down = ball.places[own], ball.right[own], np.cross(ball.right, ball.places)[own]
    cosine = (at * up).sum(axis=1)
    angle = np.arccos(np.clip(cosine, -1, 1))
    scale = ball.radius_mm * angle / np.maximum(np.sin(angle), 1e-9)
    x, y = scale * (at * right).sum(axis=1), scale * (at * down).sum(axis=1)
    side = painted.shape[1] / _PX_PER_MM
    out = np.full(len(at), _GROUND, np.float32)
    on = (np.abs(x) < side / 2) & (np.abs(y) < side / 2)
    column, row = (((c[on] + side / 2) * _PX_PER_MM).astype(int).clip(0, painted.shape[1] - 1) for c in (x, y))
    out[on] = painted[own[on], row, column]
    return out


def camera_ring(
    count: int,
    size: tuple[int, int],
    focal_px: float,
    distance_mm: float,
    random: np.random.Generator,
    arc_deg: float = 140.0,
) -> list[StickerCamera]:
    """Cameras (width, height px) on an arc about the volume, at two heights, each a little different."""
    cameras = []
    for i in range(count):
        angle = np.radians(arc_deg * (i / max(count - 1, 1) - 0.5))
        centre = distance_mm * np.array([np.sin(angle), 0.45 * (-1) ** i, -np.cos(angle)])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross([0.0, 1.0, 0.0], forward)
        right /= np.linalg.norm(right)
        rotation = np.array([right, np.cross(forward, right), forward])
        focal = focal_px * random.uniform(0.98, 1.02)
        u, v = (np.array(size) - 1) / 2 + random.uniform(-8, 8, 2)
        intrinsics = intrinsics_vector(np.array([[focal, 0, u], [0, focal, v], [0, 0, 1]]), list(_LENS))
        cameras.append(StickerCamera(f"C{i + 1:02d}", intrinsics, size, rotation, -rotation @ centre))
    return cameras


def write_sticker_session(
    folder: Path, ball: StickerBall, cameras: list[StickerCamera], placements: int, random: np.random.Generator
) -> None:
    """Write a session folder with rendered images; scale by points A and E of each target, or 0 and 2."""
    painted = painted_stickers(ball.targets)
    entries = []
    for p in range(placements):
        turn = Rotation.random(rng=random).as_matrix()
        place = random.uniform(-1, 1, 3) * 0.5 * ball.radius_mm
        name = f"P{p + 1}"
        (folder / "placements" / name).mkdir(parents=True)
        images = {}
        for camera in cameras:
            images[camera.id] = f"placements/{name}/{camera.id}.png"
            image = render_stickers(ball, painted, camera, turn, place, random)
            cv2.imwrite(str(folder / images[camera.id]), image)
        entries.append({"id": name, "images": images})
    layout = next(iter(ball.targets.layouts.values()))
    # a line through the sticker's centre, which stays the shortest way when the sticker is bent
    first, second = ((name, layout[name]) for name in (("A", "E") if "A" in layout else ("0", "2")))
    start = [
        {
            "id": camera.id,
            "image_size": list(camera.size),
            "prior": {"matrix": _guess(camera).tolist(), "distortion": [0.0] * 5},
        }
        for camera in cameras
    ]
    document = {
        "format": "spherecal/session",
        "version": 1,
        "cameras": start,
        "target_set": "targets.json",
        "sphere": {"nominal_diameter_mm": 2 * ball.radius_mm},
        "placements": entries,
        "scale": {
            "kind": "target_spacing",
            "from": first[0],
            "to": second[0],
            "surface": "sphere",
            "distance_mm": float(np.linalg.norm(first[1] - second[1])),
            "expanded_uncertainty_mm": 0.0,  # as rendered
        },
    }
    (folder / "session.json").write_text(json.dumps(document), encoding="utf-8")
    write_target_set(folder / "targets.json", ball.targets)


def _guess(camera: StickerCamera) -> FloatArray:
    """What a data sheet says: a focal length 1 % off, the principal point in the middle."""
    matrix = camera_matrix(camera.intrinsics)
    matrix[[0, 1], [0, 1]] *= 1.01
    matrix[:2, 2] = (np.array(camera.size) - 1) / 2
    return matrix


_NODES_RENDERED_BOARD = 8  # px between the places where rays are traced; the map between them is smooth
_BACKGROUND = 0.35


@dataclass(frozen=True)
class BoardCamera:
    """A simulated camera: intrinsics (16,), size (width, height) px, the lens's blur in px (standard deviation)."""

    intrinsics: FloatArray
    size: tuple[int, int]
    blur_px: float = 0.7


@dataclass(frozen=True)
class Painted:
    """A figure as an image (height, width), 0 black to 1 white; pixel (0, 0) has its corner at (0, 0) mm."""

    grey: NDArray[np.float32]
    px_per_mm: float


def paint(figure: Figure, px_per_mm: float) -> Painted:
    """The figure as an image, its edges anti-aliased."""
    width, height = (int(np.ceil(side * px_per_mm)) for side in figure.size_mm)
    out = np.ones((height, width), np.float32)
    for x, y, a, b, grey in figure.rectangles:
        columns, across = _covered(x * px_per_mm, (x + a) * px_per_mm, width)
        rows, down = _covered(y * px_per_mm, (y + b) * px_per_mm, height)
        part = out[rows, columns]
        part += (grey - part) * np.outer(down, across).astype(np.float32)
    for u, v, diameter, grey in figure.discs:
        reach = diameter * px_per_mm / 2
        columns, rows = (slice(max(int(c * px_per_mm - reach) - 1, 0), int(c * px_per_mm + reach) + 3) for c in (u, v))
        part = out[rows, columns]
        yy, xx = np.mgrid[: part.shape[0], : part.shape[1]]
        distance = np.hypot(xx + columns.start + 0.5 - u * px_per_mm, yy + rows.start + 0.5 - v * px_per_mm)
        part += (grey - part) * np.clip(reach - distance + 0.5, 0, 1).astype(np.float32)
    return Painted(out, px_per_mm)


def _covered(low: float, high: float, count: int) -> tuple[slice, FloatArray]:
    """Which pixels of a row an interval reaches, and how much of each."""
    first, last = max(int(np.floor(low)), 0), min(int(np.ceil(high)), count)
    at = np.arange(first, last)
    return slice(first, last), np.clip(np.minimum(at + 1, high) - np.maximum(at, low), 0, 1)


def render_board(
    figure: Figure,
    camera: BoardCamera,
    rotation: FloatArray,
    translation: FloatArray,
    random: np.random.Generator,
    noise_grey: float = 1.5,
    painted: Painted | None = None,
) -> NDArray[np.uint8]:
    """The grey image (h, w) of a board.

    Rays that meet the board from behind see the background.

    `rotation`, `translation` (x, y, 0) mm; `painted` None: it is painted as fine as the image needs.
    """
    width, height = camera.size
    uv = [np.append(np.arange(-0.5, side, _NODES_RENDERED_BOARD), side + _NODES_RENDERED_BOARD) for side in camera.size]
    nodes = np.stack(np.meshgrid(*uv), axis=-1).reshape(-1, 2)
    xy, _ = undistort(nodes, camera.intrinsics)
    rays = np.column_stack([xy, np.ones(len(xy))]) @ rotation
    origin = -rotation.T @ translation
    with np.errstate(divide="ignore", invalid="ignore"):
        met = np.where(origin[2] * rays[:, 2] < 0, -origin[2] / rays[:, 2], np.nan)
    places = np.nan_to_num(origin[:2] + met[:, None] * rays[:, :2], nan=-1e6)
    if painted is None:
        painted = paint(figure, _scale(places, nodes, uv) * _RAYS)
    steps = [np.arange(side * _RAYS) / _RAYS - 0.5 + 0.5 / _RAYS for side in camera.size]
    maps = []
    for axis in (0, 1):
        grid = places[:, axis].reshape(len(uv[1]), len(uv[0]))
        spline = RectBivariateSpline(uv[1], uv[0], grid, kx=3, ky=3)
        maps.append((spline(steps[1], steps[0]) * painted.px_per_mm - 0.5).astype(np.float32))
    fine = cv2.remap(
        painted.grey, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=_BACKGROUND
    )
    image = np.asarray(fine).reshape(height, _RAYS, width, _RAYS).mean(axis=(1, 3))
    image = 30 + 180 * cv2.GaussianBlur(image, (0, 0), camera.blur_px)
    return np.clip(np.rint(image + random.normal(0, noise_grey, image.shape)), 0, 255).astype(np.uint8)


def _scale(places: FloatArray, nodes: FloatArray, uv: list[FloatArray]) -> float:
    """Pixels a mm where the board fills the image most, roughly."""
    grid = places.reshape(len(uv[1]), len(uv[0]), 2)
    steps = np.linalg.norm(np.diff(grid[:, :-1], axis=1), axis=2)
    return float(np.clip(_NODES_RENDERED_BOARD / max(float(np.median(steps)), 1e-3), 0.5, 20))
