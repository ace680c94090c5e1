"""Rendered recordings for the studies, kept in the user's cache; the same seed gives the same images everywhere."""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import OutputError
from spherecal.data.session import BarPose, Placement, Session
from spherecal.geometry.transform import fit_similarity
from spherecal_files.atomic import SESSION
from spherecal_files.filesystem import create, move_below, remove_own_folder, scratch_beside
from spherecal_files.json_file import json_bytes
from spherecal_files.read_session import read_session
from spherecal_files.session_json import session_json
from spherecal_files.target_set_file import write_target_set
from spherecal_sim.dot_truth import Station, TrueDots, bar_dots
from spherecal_sim.render_session import CLUTTERED, render_image, render_session, station_at, write_png
from spherecal_sim.rigs import Layout
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_boards import SimulatedRecording, simulate_board
from spherecal_sim.simulated_scene import WHITE, bar_scene, lit_for
from spherecal_sim.tracing import TracedScene
from spherecal_sim.truth import SimulationOptions, TrueBarPose, Truth
from spherecal_study.executor import Trial

# Raise it whenever the same seed would give other images.
_VERSION = 1
BAR_POSES = 6  # of each check bar: 72 images of the demo's rig, half a minute on two cores

ROWS, COLUMNS, PITCH_MM = 8, 11, 33.0
RINGS = ((2, 2), (2, 7), (5, 2))
_DOT_MM, _HOLE_MM = 8.0, 3.0  # radii
_MARGIN_MM = 25.0


def renderings(trials: Sequence[Trial]) -> list[Trial]:
    """What has to be rendered for trials on images: trials of their own, to be run first, each thing once."""
    out: dict[str, Trial] = {}
    for trial in trials:
        s = trial.settings
        if s.get("sigma_px", 0.0) is not None:
            continue
        seeded = {"preset": s["preset"], "seed": s["seed"]}
        wanted = [{"what": "bars", **seeded}] if trial.kind in ("ball", "board", "bar") else []
        if trial.kind == "board":
            printed = {"placements": s["placements"], "print_sd_mm": s.get("print_sd_mm", 0.0)}
            wanted.append({"what": "board", **seeded, **printed})
        elif trial.kind == "bar":
            wanted.append({"what": "bar", **seeded, "frames": s["frames"]})
        if trial.kind in ("ball", "paths", "displaced"):
            default = None if trial.kind == "paths" else 4
            layout = {"placements": s.get("placements", default), "layout": s.get("layout", "spread")}
            wanted.append({"what": "ball", **seeded, **layout})
        for settings in wanted:
            one = Trial("render", settings)
            out[one.key] = one
    return list(out.values())


def render(what: str, **settings: Any) -> dict[str, Any]:
    """Render one of the recordings below and keep it; how many images it has."""
    if what == "ball":
        session = rendered_ball(**settings)[0]
    else:
        session = {"bars": rendered_bars, "board": rendered_board, "bar": rendered_waved_bar}[what](**settings)
    return {"images": sum(len(place.images) for place in (*session.placements, *session.bar_poses))}


def rendered_ball(preset: str, seed: int, placements: int | None, layout: Layout) -> tuple[Session, Truth]:
    """A session with rendered images of the ball, its dots' spacing the scale, and its truth."""
    options = SimulationOptions(placements=placements, layout=layout, bar_poses=0, mark_points="dots")
    return _by_the_product(preset, seed, options)


def rendered_bars(preset: str, seed: int) -> Session:
    """A session with images of the two check bars before the same simulated cameras."""
    options = SimulationOptions(placements=1, bar_poses=BAR_POSES, mark_points="dots")
    session, _ = _by_the_product(preset, seed, options)
    return replace(session, placements=())


def _by_the_product(preset: str, seed: int, options: SimulationOptions) -> tuple[Session, Truth]:
    def build(folder: Path) -> None:
        render_session(preset, seed, folder, None, options)

    folder = kept("ball", {"preset": preset, "seed": seed, **asdict(options)}, build)
    _, truth = simulate_session(preset, seed, options)
    return read_session(folder), truth


def rendered_waved_bar(preset: str, seed: int, frames: int) -> Session:
    """A session with sharp images of a bar of four marks and certified lengths, for the 1-D method."""
    options = SimulationOptions(placements=1, bar_poses=frames, mark_points="dots", scale="bar")

    def build(folder: Path) -> None:
        session, truth = simulate_session(preset, seed, options)
        targets = session.target_set
        assert targets is not None and session.scale is not None
        bar = session.scale.bar
        poses = [pose for pose in truth.bar_poses if pose.bar == bar]
        scenes = ((pose.id, bar_scene(truth, targets, pose, CLUTTERED)) for pose in poses)
        marks = truth.bar(poses[0].bar).targets
        images = _take(folder, truth, ((name, scene, bar_dots(scene, marks)) for name, scene in scenes))
        recorded = replace(
            session,
            placements=(),
            observations=None,
            bars=tuple(b for b in session.bars if b.id == bar),
            bar_poses=tuple(
                BarPose(p.id, p.bar, p.temperature_c, images[p.id]) for p in session.bar_poses if p.bar == bar
            ),
        )
        write_target_set(folder / "targets.json", targets)
        create(folder / SESSION.file, json_bytes(session_json(recorded, folder)))

    return read_session(kept("bar", {"preset": preset, "seed": seed, "frames": frames}, build))


def rendered_board(preset: str, seed: int, placements: int, print_sd_mm: float) -> Session:
    """A session with images of a board of 8 x 11 dots 33 mm apart, three of them rings: the 2-D method's recording."""

    def build(folder: Path) -> None:
        recording = simulate_board(
            preset, seed, placements, rows=ROWS, columns=COLUMNS, pitch_mm=PITCH_MM, print_sd_mm=print_sd_mm
        )
        # the same cameras, in the room that the ball is rendered in
        _, truth = simulate_session(preset, seed, SimulationOptions(placements=1, bar_poses=0, mark_points="dots"))
        names = [placement.id for placement in recording.session.placements]
        images = _take(folder, truth, zip(names, *_boards(recording, truth), strict=True))
        session = replace(
            recording.session,
            observations=None,
            board=None,
            placements=tuple(Placement(name, images[name]) for name in names),
        )
        board = {
            "kind": "circles",
            "rows": ROWS,
            "columns": COLUMNS,
            "pitch_mm": PITCH_MM,
            "rings": [list(r) for r in RINGS],
        }
        create(folder / SESSION.file, json_bytes({**session_json(session, folder), "board": board}))

    what = {"preset": preset, "seed": seed, "placements": placements, "print_sd_mm": print_sd_mm}
    return read_session(kept("board", what, build))


def _boards(recording: SimulatedRecording, truth: Truth) -> tuple[list[TracedScene], list[TrueDots]]:
    """Scene and dots of every placement: a board is one large sticker on a wide bar, its rings holed by specks."""
    board = recording.session.board
    assert board is not None
    nominal = np.array([point.xyz_mm for point in board])
    nominal = nominal - nominal.mean(axis=0)
    first = fit_similarity(nominal, recording.points_mm[0], with_scale=False)
    printed = (recording.points_mm[0] - first.translation) @ first.rotation  # nominal but for what the print is off by
    scenes, dots = [], []
    for points in recording.points_mm:
        pose = fit_similarity(printed, points, with_scale=False)
        scene = _board_scene(truth, printed, TrueBarPose("", truth.bars[0].id, pose.rotation, pose.translation, 20.0))
        scenes.append(scene)
        dots.append(bar_dots(scene, (1,)))
    return scenes, dots


def _board_scene(truth: Truth, printed: FloatArray, pose: TrueBarPose) -> TracedScene:
    targets = simulate_session(truth.preset, truth.seed, SimulationOptions(placements=1, bar_poses=0))[0].target_set
    assert targets is not None
    scene = bar_scene(truth, targets, pose, CLUTTERED)
    half = np.abs(printed[:, :2]).max(axis=0) + _MARGIN_MM
    holes = [row * COLUMNS + column for row, column in RINGS]
    dirt = np.zeros((1, len(holes), 6))
    dirt[0, :, :2] = dirt[0, :, 2:4] = printed[holes, :2]
    dirt[0, :, 4], dirt[0, :, 5] = _HOLE_MM, WHITE
    albedos = scene.albedos.copy()
    albedos[:2] = albedos[1], albedos[0]  # white paper, black dots
    return scene._replace(
        bar_faces=np.array([[-half[0], half[0], half[1]]]), mark_bar=np.zeros(1, dtype=np.int64), mark_x=np.zeros(1),
        mark_dots=printed[None, :, :2].copy(), half_sticker=float(half.max()), dot_radius=_DOT_MM, dirt=dirt,
        albedos=albedos,
    )  # fmt: skip


def _take(
    folder: Path, truth: Truth, groups: Iterable[tuple[str, TracedScene, TrueDots]]
) -> dict[str, dict[str, Path]]:
    """Render every group by every camera; image files by group and camera."""
    images: dict[str, dict[str, Path]] = {}
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        running = []
        for index, (name, scene, dots) in enumerate(groups):
            (folder / "images" / name).mkdir(parents=True)
            images[name] = {}
            for number, camera in enumerate(truth.cameras):
                path = images[name][camera.id] = folder / "images" / name / f"{camera.id}.png"
                lit = lit_for(scene, truth, number, CLUTTERED)
                rng = np.random.default_rng([truth.seed, 6, index, number])
                station = station_at(camera, truth, 0)
                running.append(pool.submit(_one, path, lit, dots, station, rng))
        for job in running:
            job.result()
    return images


def _one(path: Path, scene: TracedScene, dots: TrueDots, station: Station, rng: np.random.Generator) -> None:
    write_png(path, render_image(scene, dots, station, CLUTTERED, rng).image)


def kept(kind: str, what: dict[str, Any], build: Callable[[Path], None]) -> Path:
    """The folder of a recording in the user's cache, built on first use."""
    from platformdirs import user_cache_path

    text = json.dumps([_VERSION, kind, what], sort_keys=True)
    cache = user_cache_path("spherecal", appauthor=False) / "studies"
    folder = cache / f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    if (folder / SESSION.file).exists():
        return folder
    try:
        scratch = scratch_beside(folder)  # two workers may render the same
    except OSError as error:
        raise OutputError(f"{folder}: images cannot be kept there ({error}).", "Free some space.") from error
    try:
        build(scratch)
        with suppress(OutputError):  # the other one was first
            move_below(cache, scratch.name, folder.name)
    except OSError as error:
        raise OutputError(f"{folder}: images cannot be kept there ({error}).", "Free some space.") from error
    finally:
        remove_own_folder(scratch)
    return folder
