"""Images of a scene as a simulated camera takes them, with the truth about every dot in them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.geometry.camera import image_reach, is_fisheye, project
from spherecal_sim.dot_truth import DotTruth, Outlines, Station, TrueDots, outline_dots, see_dots
from spherecal_sim.optics import Image, expose, gather, pixel_kernel, separable, vignetting
from spherecal_sim.radiance import CELLS, DENSE, EDGE, TILE, trace_band
from spherecal_sim.simulated_scene import RenderSettings, blob_places
from spherecal_sim.tracing import TracedScene


@dataclass(frozen=True)
class Rendered:
    """An image (height, width) and the truth about its dots; `exposure` is the noise-free image, 1 = full scale."""

    image: Image
    exposure: NDArray[np.float32]
    dots: DotTruth


_BAND = 256  # rows at a time: 36 MB of cells for a 3.2 MP image


def render_image(
    scene: TracedScene,
    dots: TrueDots,
    station: Station,
    settings: RenderSettings,
    rng: np.random.Generator,
    context: Context | None = None,
) -> Rendered:
    """The image that a simulated camera takes of a scene, and the truth about the scene's dots."""
    context = context or Context()
    scene, station = _packed(scene), replace(station, rotation=np.ascontiguousarray(station.rotation))
    outlines = outline_dots(dots, station)
    truth = see_dots(dots, outlines, scene, station)
    kernel = pixel_kernel(settings.psf_at(station.id))
    margin = TILE * int(np.ceil(len(kernel) / 2 / CELLS / TILE))  # whole tiles around the image that the kernel reaches
    marks = _pixel_marks(scene, station, outlines, dots.sheets, margin)
    exposure = _expose_scene(scene, station, marks, kernel, margin, context)
    if settings.vignetting:
        exposure *= vignetting(station.intrinsics, station.size)
    if settings.bounds is not None:
        bound = settings.bounds(truth.uv_cen, truth.moments_px2, exposure, kernel, settings.sensor)
        truth = replace(truth, bound_px=bound)
    return Rendered(expose(exposure, settings.sensor, rng), exposure, truth)


def _packed(scene: TracedScene) -> TracedScene:
    """The scene with contiguous arrays: the kernels are compiled for one kind of scene only."""
    arrays = {name: value for name, value in scene._asdict().items() if isinstance(value, np.ndarray)}
    return scene._replace(**{name: np.ascontiguousarray(value) for name, value in arrays.items()})


def _expose_scene(
    scene: TracedScene, station: Station, marks: NDArray[np.uint8], kernel: FloatArray, margin: int, context: Context
) -> NDArray[np.float32]:
    """The noise-free image, band by band: cells traced, then gathered through the point-spread function."""
    width, height = station.size
    terms = separable(kernel)
    exposure = np.zeros((height, width), np.float32)
    centre = station.centre_mm
    for first in range(0, height, _BAND):
        context.check()
        rows = min(_BAND, height - first)
        band = marks[first : first + _tiles(rows) * TILE + 2 * margin]
        cells = np.empty((band.shape[0] * CELLS, band.shape[1] * CELLS), np.float32)
        trace_band(scene, station.rotation, centre, station.intrinsics, band, -margin, first - margin, cells)
        for column, row in terms:
            gather(cells, column, row, margin, exposure[first : first + rows])
    return exposure


def _tiles(pixels: int) -> int:
    return -(-pixels // TILE)


def _pixel_marks(
    scene: TracedScene, station: Station, outlines: Outlines, sheets: FloatArray, margin: int
) -> NDArray[np.uint8]:
    """Where finer sampling is needed, with `margin` px around: EDGE on blobs, DENSE on dots and dirty stickers."""
    width, height = station.size
    marks = np.zeros((_tiles(height) * TILE + 2 * margin, _tiles(width) * TILE + 2 * margin), np.uint8)
    places, radii = blob_places(scene)
    low, high = _boxes(station, places[:, None])
    reach = station.intrinsics[0] * radii[:, None] / np.linalg.norm(places - station.centre_mm, axis=1, keepdims=True)
    _mark_boxes(marks, low - 1.5 * reach, high + 1.5 * reach, margin, EDGE)
    if scene.dirt.shape[1]:  # the edges of a bent sticker bulge beyond its corners by 0.4 mm
        low, high = _boxes(station, sheets[_turned_to(station.centre_mm, sheets)])
        _mark_boxes(marks, low - _BULGE_PX, high + _BULGE_PX, margin, DENSE)
    _mark_boxes(marks, outlines.uv.min(axis=1), outlines.uv.max(axis=1), margin, DENSE)
    return marks


_BULGE_PX = 3.0


def _turned_to(centre: FloatArray, sheets: FloatArray) -> NDArray[np.bool_]:
    """Which stickers (s, 4, 3) may show a part: their middles are seen below 100 degrees."""
    normals = np.cross(sheets[:, 3] - sheets[:, 1], sheets[:, 2] - sheets[:, 0])  # corners go clockwise as printed
    rays = centre - sheets.mean(axis=1)
    size = np.linalg.norm(normals, axis=1) * np.linalg.norm(rays, axis=1)
    return (normals * rays).sum(axis=1) > np.cos(np.deg2rad(100.0)) * size


def _boxes(station: Station, figures: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest image points (n, 2) of figures (n, m, 3) in the world; empty boxes for those out of view."""
    n, m = figures.shape[:2]
    x = figures.reshape(-1, 3) @ station.rotation.T + station.translation_mm
    widest = image_reach(station.intrinsics[None], np.array([station.size])) if is_fisheye(station.intrinsics) else 1.0
    out = (x[:, 2] <= 0) | (np.hypot(x[:, 0], x[:, 1]) > widest * x[:, 2])
    x[out] = np.nan
    uv = project(x, station.intrinsics).reshape(n, m, 2)
    seen = ~np.isnan(uv).any(axis=(1, 2))
    low, high = np.full((n, 2), -1e6), np.full((n, 2), -1e6)
    low[seen], high[seen] = uv[seen].min(axis=1), uv[seen].max(axis=1)
    return low, high


def _mark_boxes(marks: NDArray[np.uint8], low: FloatArray, high: FloatArray, margin: int, mark: int) -> None:
    """Mark the pixels of boxes low .. high (n, 2) px, one pixel more all around."""
    top = np.array(marks.shape[::-1])
    first = np.clip(np.floor(low).astype(int) + margin - 1, 0, top)
    last = np.clip(np.ceil(high).astype(int) + margin + 2, 0, top)
    for (u0, v0), (u1, v1) in zip(first, last, strict=True):
        marks[v0:v1, u0:u1] = mark
