"""AprilTags 36h11 printed on the ball's stickers instead of dots: same places, sizes, light, lens and sensor."""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.camera import project
from spherecal_sim.optics import Image, expose, gather, pixel_kernel, separable, vignetting
from spherecal_sim.radiance import CELLS, TILE, ideal_place, look_along
from spherecal_sim.shading import albedo
from spherecal_sim.simulated_ball import wrap
from spherecal_sim.simulated_scene import WHITE, RenderSettings
from spherecal_sim.tracing import MARK, STICKER

from .detection_scenes import View

_CELLS_ACROSS = 10  # 8 of the tag with its black border, one of white margin on each side: 2.8 mm on 28 mm
_BLACK = 0.04  # as the dots' paper


@dataclass(frozen=True)
class TagTruth:
    """Ids of the stickers' tags (n,), the tag's corners (n, 4, 2) px clockwise from the top left, view angle (n,)."""

    ids: IntArray
    corners: FloatArray
    view_deg: FloatArray


def render_tags(view: View, settings: RenderSettings, seed: int) -> tuple[Image, TagTruth]:
    """The scene of `view.render` with a tag on every sticker; its id is the target's."""
    return expose(tags_exposure(view, settings), settings.sensor, np.random.default_rng(seed)), tags_truth(view)


def tags_exposure(view: View, settings: RenderSettings) -> NDArray[np.float32]:
    """The noise-free image of the tags: 16 rays a pixel on the stickers, same point-spread function and vignetting."""
    scene, station = view.scene(settings), view.station
    scene = scene._replace(**{k: np.ascontiguousarray(v) for k, v in scene._asdict().items() if np.ndim(v)})
    kernel = pixel_kernel(settings.psf_at(station.id))
    margin = TILE * int(np.ceil(len(kernel) / 2 / CELLS / TILE))
    prints = tag_prints(view.truth.ball.targets)
    width, height = station.size
    exposure = np.zeros((height, width), np.float32)
    rotation = np.ascontiguousarray(station.rotation)
    band = 256
    for first in range(0, height, band):
        rows = min(band, height - first)
        cells = np.empty(((rows + 2 * margin) * CELLS, (width + 2 * margin) * CELLS), np.float32)
        _trace(scene, rotation, station.centre_mm, station.intrinsics, prints, -margin, first - margin, cells)
        for column, row in separable(kernel):
            gather(cells, column, row, margin, exposure[first : first + rows])
    if settings.vignetting:
        exposure *= vignetting(station.intrinsics, station.size)
    return exposure


def tag_prints(ids: IntArray) -> NDArray[np.float64]:
    """Albedo of every sticker's cells, (n, 10, 10), row by row from the top left."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    prints = np.full((len(ids), _CELLS_ACROSS, _CELLS_ACROSS), WHITE)
    for i, tag in enumerate(ids):
        bits = cv2.aruco.generateImageMarker(dictionary, int(tag), _CELLS_ACROSS - 2)
        prints[i, 1:-1, 1:-1] = np.where(np.asarray(bits) > 0, WHITE, _BLACK)
    return prints


def tags_truth(view: View) -> TagTruth:
    """The tags on the near side whose corners lie in the image and none of them beyond 85 degrees."""
    ball, station = view.truth.ball, view.station
    half = view.targets.size_mm / 2 * (1 - 2 / _CELLS_ACROSS)
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    n = len(ball.targets)
    normals, places = wrap(ball.radius_mm, ball.bumps, np.repeat(ball.frames, 4, axis=0), np.tile(corners, (n, 1)))
    turn, shift = view.truth.ball_rotations[view.placement], view.truth.ball_places_mm[view.placement]
    places, normals = places @ turn.T + shift, normals @ turn.T
    rays = station.centre_mm - places
    cosine = (rays * normals).sum(axis=1) / np.linalg.norm(rays, axis=1)
    view_deg = np.rad2deg(np.arccos(np.clip(cosine, -1, 1))).reshape(n, 4).max(axis=1)
    uv = project(places @ station.rotation.T + station.translation_mm, station.intrinsics).reshape(n, 4, 2)
    keep = (view_deg < 85.0) & ((uv > 0) & (uv < np.array(station.size) - 1.0)).all(axis=(1, 2))
    return TagTruth(ball.targets[keep], uv[keep], view_deg[keep])


@njit(nogil=True, cache=True)
def _trace(scene, rotation, centre, intrinsics, prints, u_first, v_first, cells):
    """Radiance of all cells: between a pixel's corners where these show one plain surface, else a ray for each cell."""
    rows, columns = cells.shape[0] // CELLS, cells.shape[1] // CELLS
    code = np.empty((2, columns + 1), np.int64)
    value = np.empty((2, columns + 1))
    cx, cy = np.empty((2, columns + 1)), np.empty((2, columns + 1))
    for i in range(rows + 1):
        new, old = i % 2, 1 - i % 2
        x, y = (cx[old, 0], cy[old, 0]) if i else (0.0, 0.0)
        for j in range(columns + 1):
            x, y = ideal_place(intrinsics, u_first + j - 0.5, v_first + i - 0.5, x, y)
            cx[new, j], cy[new, j] = x, y
            code[new, j], value[new, j] = _look(scene, rotation, centre, prints, x, y)
        for j in range(columns if i else 0):
            pixel = cells[(i - 1) * CELLS : i * CELLS, j * CELLS : (j + 1) * CELLS]
            c = code[old, j]
            same = c == code[old, j + 1] and c == code[new, j] and c == code[new, j + 1] and c < MARK
            for k in range(CELLS):
                t = (k + 0.5) / CELLS
                for m in range(CELLS):
                    s = (m + 0.5) / CELLS
                    if same:
                        pixel[k, m] = _between(value, old, new, j, s, t)
                    else:
                        x, y = _between(cx, old, new, j, s, t), _between(cy, old, new, j, s, t)
                        pixel[k, m] = _look(scene, rotation, centre, prints, x, y)[1]


@njit(nogil=True, cache=True)
def _between(grid, old, new, j, s, t):
    upper = grid[old, j] * (1 - s) + grid[old, j + 1] * s
    return upper * (1 - t) + (grid[new, j] * (1 - s) + grid[new, j + 1] * s) * t


@njit(nogil=True, cache=True)
def _look(scene, rotation, centre, prints, x, y):
    """Code and radiance of what is seen along normalised coordinates."""
    code, sx, sy, diffuse, shine = look_along(scene, rotation, centre, x, y)
    if code < STICKER:
        return code, albedo(scene, code, sx, sy) * diffuse + shine
    n = prints.shape[1]
    across = 2 * scene.half_sticker / n
    column = min(max(int((sx + scene.half_sticker) / across), 0), n - 1)
    row = min(max(int((sy + scene.half_sticker) / across), 0), n - 1)
    return code, prints[code - STICKER, row, column] * diffuse + shine
