"""Images of a printed board as a simulated camera takes them, for studies and tests."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from spherecal.base.arrays import FloatArray
from spherecal.geometry.camera import undistort
from spherecal.targets.board_pattern import Figure

_NODES = 8  # px between the places where rays are traced; the map between them is smooth
_RAYS = 3  # a pixel and direction
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
    uv = [np.append(np.arange(-0.5, side, _NODES), side + _NODES) for side in camera.size]
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
    return float(np.clip(_NODES / max(float(np.median(steps)), 1e-3), 0.5, 20))
