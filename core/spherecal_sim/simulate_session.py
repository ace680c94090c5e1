"""Simulated sessions: a rig, its ball and bars observed, in memory or as a session folder with its truth."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.observations import Observations
from spherecal.data.session import CameraSpec, Placement, Scale, Session
from spherecal.targets.family import make_target_set
from spherecal_files.atomic import SESSION, write_folder_whole
from spherecal_files.filesystem import create
from spherecal_files.session_json import session_json
from spherecal_files.table_file import write_observations
from spherecal_files.target_set_file import write_target_set
from spherecal_sim import rigs
from spherecal_sim.observe import ObservingCameras, Seen, lens_misfit, look, observe, shape_changes, spoil
from spherecal_sim.simulated_ball import make_ball
from spherecal_sim.simulated_bars import certify, make_bars, mark_places, pose_bars, recorded_poses
from spherecal_sim.truth import SimulationOptions, TrueBarPose, Truth, write_truth

_N_MARKS = 8  # two bars of four


def simulate_session(preset: str, seed: int, options: SimulationOptions | None = None) -> tuple[Session, Truth]:
    """A session of observations and its truth, in the rig's frame; rig, noise, ... draw from streams of their own."""
    options = options or SimulationOptions()
    design = rigs.rig_design(preset)
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(7)]
    of_rig, of_ball, of_places, of_bars, of_noise, of_faults, of_priors = streams
    cameras = rigs.build_cameras(design, of_rig)
    targets = make_target_set(options.targets + _N_MARKS)
    ball_targets = tuple(range(1, options.targets + 1))
    ball = make_ball(targets, ball_targets, of_ball, options.ball_radius_mm, options.bump_mm, options.print_sd_mm)
    count = options.placements or design.placements
    bars = make_bars(options.targets + 1, of_bars)
    flat_marks = options.mark_points == "dots"
    truth = Truth(
        preset=preset,
        seed=seed,
        options=options,
        cameras=cameras,
        sigma_px=np.array([options.blurred.get(c.id, options.sigma_px) for c in cameras]),
        volume_mm=design.volume_mm,
        misfit_phases=of_faults.uniform(0.0, 2 * np.pi, (len(cameras), 4)),
        ball=ball,
        placements=tuple(f"P{i + 1:0{len(str(count))}d}" for i in range(count)),
        ball_rotations=rigs.ball_turns(count, options.turns, of_places),
        ball_places_mm=rigs.ball_places(design, count, options.layout),
        shape_changes_mm=shape_changes(ball, count, options.shape_change_mm, options.shape_change, of_faults)
        if options.shape_change_mm
        else None,
        bars=bars,
        bar_poses=pose_bars(
            bars,
            options.bar_poses,
            look(cameras),
            design.volume_mm,
            options.view_limit_deg if flat_marks else None,
            of_bars,
        ),
        uv_true_px=np.empty((0, 2)),
        outlier=np.empty(0, dtype=bool),
    )
    observations = _true_observations(truth, targets.layouts)
    truth = replace(truth, uv_true_px=observations.uv)
    observations, outlier = _recorded(observations, truth, of_noise, of_faults)
    truth = replace(truth, outlier=outlier)
    session = Session(
        folder=Path(), cameras=_camera_specs(cameras, options, of_priors),
        placements=tuple(Placement(name) for name in truth.placements),
        bars=certify(bars, "B" if options.scale == "bar" else None, of_bars),
        bar_poses=recorded_poses(truth.bar_poses, of_bars), scale=_scale(options, targets.layouts[1]), board=None,
        sphere_diameter_mm=2 * options.ball_radius_mm, target_set=targets, observations=observations, input_sha256="",
    )  # fmt: skip
    return session, truth


def observe_again(session: Session, truth: Truth, rng: np.random.Generator) -> tuple[Session, Truth]:
    """The same session and truth recorded another time: new noise and, where the options ask for them, new outliers."""
    assert session.observations is not None
    observations, outlier = _recorded(replace(session.observations, uv=truth.uv_true_px), truth, rng, rng)
    return replace(session, observations=observations), replace(truth, outlier=outlier)


def _camera_specs(
    cameras: tuple[rigs.TrueCamera, ...], options: SimulationOptions, rng: np.random.Generator
) -> tuple[CameraSpec, ...]:
    """The cameras as a user knows them, priors with the errors that the options ask for."""
    specs = []
    for camera in cameras:
        prior = rigs.nominal_intrinsics(camera.kind)
        prior[:2] *= 1 + options.prior_focal_error * rng.uniform(-1, 1)
        prior[2:4] += options.prior_centre_error_px * rng.uniform(-1, 1, 2)
        specs.append(camera.known(prior, prior_given=True))
    return tuple(specs)


def _scale(options: SimulationOptions, layout: dict[str, FloatArray]) -> Scale:
    if options.scale == "bar":
        return Scale("bar", bar="B")
    distance = round(float(np.linalg.norm(layout["E"] - layout["A"])), 9)
    return Scale("target_spacing", "A", "E", distance, "sphere", expanded_uncertainty_mm=0.0)  # no common error


def _recorded(
    true: Observations, truth: Truth, of_noise: np.random.Generator, of_faults: np.random.Generator
) -> tuple[Observations, BoolArray]:
    """Noise on all, wrong matches among the ball's observations."""
    noise = of_noise.normal(size=true.uv.shape) * truth.sigma_px[true.camera, None]
    noisy = replace(true, uv=true.uv + noise)
    outlier = np.zeros(len(noisy), dtype=bool)
    if not truth.options.outlier_fraction:
        return noisy, outlier
    on_ball = np.flatnonzero(noisy.placement < len(truth.placements))
    sizes = np.array([c.kind.image_size for c in truth.cameras], dtype=float)
    spoilt, wrong = spoil(noisy.select(on_ball), sizes, truth.options.outlier_fraction, of_faults)
    uv = noisy.uv.copy()
    uv[on_ball] = spoilt.uv
    outlier[on_ball] = wrong
    return replace(noisy, uv=uv), outlier


def _true_observations(truth: Truth, layouts: dict[int, dict[str, FloatArray]]) -> Observations:
    """Noise-free observations of all placements and bar poses, lens misfit included."""
    still = look(truth.cameras)
    centre = truth.options.mark_points == "centre"
    points = (*truth.ball.points, "centre") if centre else truth.ball.points
    parts = [_see_ball(truth, still, t) for t in range(len(truth.placements))]
    if truth.bar_poses:
        last = look(truth.cameras, truth.options.moved, len(truth.placements))
        parts += [
            _see_bar(truth, pose, last, points, layouts, len(truth.placements) + i)
            for i, pose in enumerate(truth.bar_poses)
        ]
    index = np.concatenate([part[0] for part in parts], axis=1)
    uv = np.concatenate([part[1] for part in parts])
    placement, camera, target, point = index
    if truth.options.misfit_px:
        uv = uv + lens_misfit(uv, still.sizes[camera], truth.misfit_phases[camera], truth.options.misfit_px)
    names = truth.placements + tuple(pose.id for pose in truth.bar_poses)
    return Observations(names, tuple(c.id for c in truth.cameras), points, placement, camera, target, point, uv)


_Part = tuple[IntArray, FloatArray]  # rows placement, camera, target, point (4, n), and uv (n, 2) px


def _see_ball(truth: Truth, still: ObservingCameras, placement: int) -> _Part:
    """What the cameras see of the ball in one placement."""
    move = truth.options.moved
    view = look(truth.cameras, move, placement) if move else still
    ball = truth.ball
    normals = ball.normals @ truth.ball_rotations[placement].T
    seen = observe(view, truth.points_mm(placement), normals, truth.options.view_limit_deg)
    return _part(seen, placement, ball.dot_target, ball.dot_point)


def _see_bar(
    truth: Truth,
    pose: TrueBarPose,
    view: ObservingCameras,
    points: tuple[str, ...],
    layouts: dict[int, dict[str, FloatArray]],
    index: int,
) -> _Part:
    """One bar pose: marks seen as points from all around, or dot by dot on the bar's face."""
    bar, centre = truth.bar(pose.bar), truth.options.mark_points == "centre"
    names = ("centre",) if centre else truth.ball.points
    origin = {"centre": np.zeros(2)}
    flat = np.array([[({**layouts[t], **origin})[name] for name in names] for t in bar.targets])
    places = mark_places(bar, pose, flat).reshape(-1, 3)
    normals = None if centre else np.tile(-pose.rotation[:, 2], (len(places), 1))
    seen = observe(view, places, normals, truth.options.view_limit_deg)
    of_name = np.array([points.index(name) for name in names])
    return _part(seen, index, np.repeat(np.array(bar.targets), len(names)), np.tile(of_name, len(bar.targets)))


def _part(seen: Seen, placement: int, target: IntArray, point: IntArray) -> _Part:
    return np.stack([np.full(len(seen.camera), placement), seen.camera, target[seen.point], point[seen.point]]), seen.uv


def write_session(session: Session, truth: Truth, folder: Path) -> None:
    """Write a session folder, whole or not at all; an older session there is replaced."""
    write_folder_whole(folder, lambda partial: fill_session_folder(session, truth, partial), SESSION)


def fill_session_folder(session: Session, truth: Truth, folder: Path) -> None:
    """Write the files of a session into an existing folder."""
    document = json.dumps(session_json(session, folder), indent=1) + "\n"
    create(folder / "session.json", document.encode())
    if session.target_set is not None:
        write_target_set(folder / "targets.json", session.target_set)
    if session.observations is not None:
        write_observations(folder / "observations.csv", session.observations)
    write_truth(truth, folder / "truth.json")
