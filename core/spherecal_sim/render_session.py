"""Sessions of rendered images: the folder a user would record, with the truth of every dot beside it."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError, OutputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import BarPose, Placement, Session
from spherecal.targets.target_set import TargetSet
from spherecal_files.atomic import SESSION, write_folder_whole
from spherecal_files.cache_folder import cache_folder
from spherecal_files.filesystem import create, move_below, remove_own_folder, scratch_beside
from spherecal_files.png_file import png_bytes
from spherecal_sim.dot_truth import DotTruth, Station, TrueDots, ball_dots, bar_dots
from spherecal_sim.optics import Image
from spherecal_sim.render import Rendered, render_image
from spherecal_sim.rigs import TrueCamera
from spherecal_sim.simulate_session import fill_session_folder, simulate_session
from spherecal_sim.simulated_scene import RenderSettings, ball_scene, bar_scene, lit_for
from spherecal_sim.tracing import TracedScene
from spherecal_sim.truth import SimulationOptions, Truth, camera_pose

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
