"""Sessions of rendered images: the folder a user would record, with the truth of every dot beside it."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError, OutputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import BarPose, Placement, Session
from spherecal.geometry.camera import image_reach, is_fisheye, project
from spherecal.targets.target_set import TargetSet
from spherecal_files.atomic import SESSION, write_folder_whole
from spherecal_files.cache_folder import cache_folder
from spherecal_files.filesystem import create, move_below, remove_own_folder, scratch_beside
from spherecal_files.png_file import png_bytes
from spherecal_sim.dot_truth import DotTruth, Outlines, Station, TrueDots, ball_dots, bar_dots, outline_dots, see_dots
from spherecal_sim.optics import Image, expose, gather, pixel_kernel, separable, vignetting
from spherecal_sim.radiance import CELLS, DENSE, EDGE, TILE, trace_band
from spherecal_sim.rigs import TrueCamera
from spherecal_sim.simulate_session import fill_session_folder, simulate_session
from spherecal_sim.simulated_scene import RenderSettings, ball_scene, bar_scene, blob_places, lit_for
from spherecal_sim.tracing import TracedScene
from spherecal_sim.truth import SimulationOptions, Truth, camera_pose


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


DOT_TRUTH_FILE = "truth_dots.csv"

# Four placements with the ball turned, eight poses of two bars; stickers printed to 0.02 mm, scale from bar B.
RENDERED = SimulationOptions(bar_poses=4, mark_points="dots", scale="bar", print_sd_mm=0.02)
CLUTTERED = RenderSettings(blobs=300)
DEMO = replace(RENDERED, bar_poses=2)


def render_session(
    preset: str,
    seed: int,
    folder: Path,
    context: Context | None = None,
    options: SimulationOptions | None = None,
    settings: RenderSettings | None = None,
) -> Truth:
    """Render a session folder with images, truth.json and truth_dots.csv, whole, same on any threads; its truth."""
    context = context or Context()
    options, settings = options or RENDERED, settings or CLUTTERED
    if options.shape_change_mm or options.mark_points != "dots" or options.misfit_px:
        raise InputError("Images can show neither a ball that changes its shape nor lens misfit nor bars without dots.")
    session, truth = simulate_session(preset, seed, options)
    session = replace(session, observations=None)

    def build(partial_folder: Path) -> None:
        context.report("Rendering images", 0.0, Phrase("preparing"))  # compiling takes 15 s the first time
        shots = list(_shots(session, truth, settings, partial_folder, context))
        seen: dict[int, DotTruth] = {}
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            waiting = {pool.submit(_take, shot): i for i, shot in enumerate(shots)}
            try:
                for done in as_completed(waiting):
                    seen[waiting[done]] = done.result()
                    where = Phrase("some-of-all", {"number": len(seen), "all": len(shots)})
                    context.report("Rendering images", len(seen) / len(shots), where)
            finally:
                pool.shutdown(cancel_futures=True)
        _write_dot_truth(partial_folder / DOT_TRUTH_FILE, shots, seen, truth.ball.points)
        images: dict[str, dict[str, Path]] = {}
        for shot in shots:
            images.setdefault(shot.group, {})[shot.camera.id] = shot.path
        recorded = replace(
            session,
            placements=tuple(Placement(p.id, images[p.id]) for p in session.placements),
            bar_poses=tuple(BarPose(p.id, p.bar, p.temperature_c, images[p.id]) for p in session.bar_poses),
        )
        fill_session_folder(recorded, truth, partial_folder)

    write_folder_whole(folder, build, SESSION)
    return truth


def render_placement(
    session: Session, truth: Truth, placement: int, camera: int, settings: RenderSettings | None = None
) -> Rendered:
    """One image of the ball, with the truth about its dots; `settings` None is `CLUTTERED`."""
    settings = settings or CLUTTERED
    targets = _target_set(session)
    scene = lit_for(ball_scene(truth, targets, placement, settings), truth, camera, settings)
    dots = ball_dots(truth.ball, targets.dot_diameter_mm / 2, targets.size_mm / 2)
    dots = dots.moved(truth.ball_rotations[placement], truth.ball_places_mm[placement])
    station = station_at(truth.cameras[camera], truth, placement)
    return render_image(scene, dots, station, settings, np.random.default_rng(0))


def station_at(camera: TrueCamera, truth: Truth, placement: int) -> Station:
    """A simulated camera as it is at a placement."""
    rotation, translation = camera_pose(camera, truth.options.moved, placement)
    return Station(camera.id, rotation, translation, camera.intrinsics, camera.kind.image_size)


@dataclass(frozen=True)
class _Shot:
    """One image to take: where it goes, of what, by which camera."""

    group: str
    camera: TrueCamera
    path: Path
    render: Callable[[], Rendered]


def _shots(session: Session, truth: Truth, settings: RenderSettings, folder: Path, context: Context) -> Iterator[_Shot]:
    """All images of a session, placements first; each has random numbers of its own."""
    for index, (group, where, scene, dots) in enumerate(_groups(session, truth, settings)):
        (folder / where / group).mkdir(parents=True)
        stage = min(index, len(truth.placements))
        for number, camera in enumerate(truth.cameras):
            station = station_at(camera, truth, stage)
            yield _Shot(
                group,
                camera,
                folder / where / group / f"{camera.id}.png",
                partial(
                    render_image,
                    lit_for(scene, truth, number, settings),
                    dots,
                    station,
                    settings,
                    np.random.default_rng([truth.seed, 5, index, number]),
                    context,
                ),
            )


def _groups(
    session: Session, truth: Truth, settings: RenderSettings
) -> Iterator[tuple[str, str, TracedScene, TrueDots]]:
    """Placements and bar poses: id, folder, scene, dots in the world."""
    targets = _target_set(session)
    dots = ball_dots(truth.ball, targets.dot_diameter_mm / 2, targets.size_mm / 2)
    for t, name in enumerate(truth.placements):
        placed = dots.moved(truth.ball_rotations[t], truth.ball_places_mm[t])
        yield name, "placements", ball_scene(truth, targets, t, settings), placed
    for pose in truth.bar_poses:
        scene = bar_scene(truth, targets, pose, settings)
        yield pose.id, "bars", scene, bar_dots(scene, truth.bar(pose.bar).targets)


def _target_set(session: Session) -> TargetSet:
    assert session.target_set is not None
    return session.target_set


def _take(shot: _Shot) -> DotTruth:
    """Render one image and write it."""
    rendered = shot.render()
    write_png(shot.path, rendered.image)
    return rendered.dots


def write_png(path: Path, image: Image) -> None:
    """Write a grey image (height, width) of 8 or 16 bits as PNG."""
    create(path, png_bytes(image))


_DOT_COLUMNS = (
    "placement,camera,target,point,u,v,u_rim,v_rim,u_cen,v_cen,view_deg,fully_visible,gap_px,long_px,short_px,bound_px"
)


def _write_dot_truth(path: Path, shots: list[_Shot], seen: dict[int, DotTruth], points: tuple[str, ...]) -> None:
    """Write truth_dots.csv: every dot in every image (see DotTruth), bounds empty where not computed."""
    lines = [_DOT_COLUMNS]
    for i, shot in enumerate(shots):
        d = seen[i]
        numbers = np.column_stack([d.uv, d.uv_rim, d.uv_cen, d.view_deg])
        extents = np.column_stack([d.gap_px, d.axes_px])
        for k in range(len(d)):
            bound = "" if np.isnan(d.bound_px[k]) else f"{d.bound_px[k]:.5f}"
            lines.append(
                f"{shot.group},{shot.camera.id},{d.target[k]},{points[d.point[k]]},"
                + ",".join([f"{x:.5f}" for x in numbers[k]])
                + f",{int(d.fully_visible[k])},"
                + ",".join([f"{x:.3f}" for x in extents[k]])
                + f",{bound}"
            )
    create(path, ("\n".join(lines) + "\n").encode())


# Raise it whenever the same seed would give other images.
_CACHE_VERSION = 1


def demo_session(context: Context | None = None) -> Path:
    """The folder of the demo's session, rendered on first use and then kept in the user's cache folder."""
    folder = cache_folder(f"demo-{_CACHE_VERSION}")
    if (folder / SESSION.file).exists():
        return folder
    scratch = scratch_beside(folder)  # two programs may render at once
    try:
        render_session("demo", 1, scratch, context, DEMO)
        with suppress(OutputError):  # the other one was first
            move_below(folder.parent, scratch.name, folder.name)
    finally:
        remove_own_folder(scratch)
    if not (folder / SESSION.file).exists():
        raise OutputError(f"{folder}: cannot be written.", "Free it, or render a session elsewhere.")
    return folder
