"""Simulated sessions: a rig, its ball and bars observed, in memory or as a session folder with its truth."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.observations import Observations
from spherecal.data.session import Bar, BarLength, BarPose, CameraSpec, Mark, Placement, Scale, Session
from spherecal.targets.family import make_target_set
from spherecal_files.atomic import SESSION, write_folder_whole
from spherecal_files.filesystem import create
from spherecal_files.session_json import session_json
from spherecal_files.table_file import write_observations
from spherecal_files.target_set_file import write_target_set
from spherecal_sim import rigs
from spherecal_sim.observe import ObservingCameras, Seen, lens_misfit, look, observe, shape_changes, spoil
from spherecal_sim.rigs import random_rotations
from spherecal_sim.simulated_ball import make_ball
from spherecal_sim.truth import SimulationOptions, TrueBar, TrueBarPose, Truth, write_truth

MARKS_MM = {"A": (0.0, 100.0, 300.0, 500.0), "B": (0.0, 120.0, 280.0, 500.0)}
# the distances that [Tao21] reports, and A's full length
_LENGTHS = {"A": ((1, 2), (3, 4), (1, 4)), "B": ((1, 2), (1, 3), (1, 4))}
_PLACED_SD_MM = 0.05  # marks are glued on by hand; the certificate says where they are
_CERTIFICATE_MM = 0.004  # expanded, k = 2
_STEEL_PER_KELVIN = 1.15e-5
_MIN_VIEWS = 3
_THERMOMETER_SD_C = 0.05


def make_bars(first_target: int, rng: np.random.Generator) -> tuple[TrueBar, ...]:
    """The two bars, with coded marks from target id `first_target` on."""
    bars = []
    for bar_id, nominal in MARKS_MM.items():
        targets = tuple(range(first_target, first_target + len(nominal)))
        first_target += len(nominal)
        names = tuple(f"{bar_id}{i + 1}" for i in range(len(nominal)))
        x = np.array(nominal) + rng.normal(0.0, _PLACED_SD_MM, len(nominal))
        bars.append(TrueBar(bar_id, names, targets, x, _STEEL_PER_KELVIN, 20.0))
    return tuple(bars)


def certify(bars: tuple[TrueBar, ...], scale_bar: str | None, rng: np.random.Generator) -> tuple[Bar, ...]:
    """The bars as a session describes them, with errors of their stated uncertainty; one the scale, or all check."""
    certified = []
    for bar in bars:
        lengths = []
        for first, last in _LENGTHS[bar.id]:
            true = bar.x_mm[last - 1] - bar.x_mm[first - 1]
            value = round(float(true + rng.normal(0.0, _CERTIFICATE_MM / 2)), 6)
            lengths.append(BarLength(f"{bar.id}{first}", f"{bar.id}{last}", value, _CERTIFICATE_MM, 2.0))
        marks = {name: Mark(target, "centre") for name, target in zip(bar.marks, bar.targets, strict=True)}
        role = "scale" if bar.id == scale_bar else "check"
        certified.append(
            Bar(bar.id, role, marks, tuple(lengths), bar.expansion_per_kelvin, bar.reference_temperature_c)
        )
    return tuple(certified)


def mark_places(bar: TrueBar, pose: TrueBarPose, flat_mm: FloatArray) -> FloatArray:
    """World places of points of a bar's marks, (marks, points, 3) mm, from those on their stickers, (.., 2) mm."""
    stretch = 1 + bar.expansion_per_kelvin * (pose.temperature_c - bar.reference_temperature_c)
    x = np.zeros((*flat_mm.shape[:2], 3))
    x[..., :2] = flat_mm
    x[..., 0] += stretch * bar.x_mm[:, None]
    return x @ pose.rotation.T + pose.place_mm


def pose_bars(
    bars: tuple[TrueBar, ...],
    count: int,
    view: ObservingCameras,
    volume_mm: FloatArray,
    view_limit_deg: float | None,
    rng: np.random.Generator,
) -> tuple[TrueBarPose, ...]:
    """At most `count` poses of each bar over the volume (2, 3) mm, every mark inside it and in at least 3 views."""
    poses = []
    for bar in bars:
        rotations, places = _fitting_poses(bar.x_mm, count, view, volume_mm, view_limit_deg, rng)
        temperatures = rng.uniform(20.5, 23.0, len(places))
        for i, (r, p, c) in enumerate(zip(rotations, places, temperatures, strict=True)):
            poses.append(TrueBarPose(f"{bar.id}-{i + 1:02d}", bar.id, r, p, float(c)))
    return tuple(poses)


def recorded_poses(poses: tuple[TrueBarPose, ...], rng: np.random.Generator) -> tuple[BarPose, ...]:
    """The poses as a session states them: with the temperature that was read."""
    return tuple(
        BarPose(p.id, p.bar, round(p.temperature_c + float(rng.normal(0.0, _THERMOMETER_SD_C)), 2)) for p in poses
    )


_BATCH = 400
_BATCHES = 50


def _fitting_poses(
    x_mm: FloatArray,
    count: int,
    view: ObservingCameras,
    volume_mm: FloatArray,
    view_limit_deg: float | None,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Random rotations (count, 3, 3) and places (count, 3) of a bar that pass; drawn in batches, first come."""
    low, high = volume_mm
    found_r, found_p = [np.empty((0, 3, 3))], [np.empty((0, 3))]
    for _ in range(_BATCHES):
        if sum(map(len, found_p)) >= count:
            break
        rotations = random_rotations(_BATCH, rng)
        middle = rng.uniform(low, high, (_BATCH, 3))
        places = middle - rotations[:, :, 0] * (x_mm[0] + x_mm[-1]) / 2
        marks = places[:, None] + x_mm[:, None] * rotations[:, None, :, 0]
        good = ((marks >= low) & (marks <= high)).all(axis=(1, 2))
        rotations, places, marks = rotations[good], places[good], marks[good]
        if not len(places):
            continue
        normals = None if view_limit_deg is None else np.repeat(-rotations[:, :, 2], len(x_mm), axis=0)
        seen = observe(view, marks.reshape(-1, 3), normals, view_limit_deg or 90.0)
        views = np.bincount(seen.point, minlength=len(places) * len(x_mm)).reshape(len(places), -1)
        good = (views >= _MIN_VIEWS).all(axis=1)
        found_r.append(rotations[good])
        found_p.append(places[good])
    return np.concatenate(found_r)[:count], np.concatenate(found_p)[:count]


@dataclass(frozen=True)
class StudyBars:
    """Bars for studies: true ends (n, 2, 3) mm, lengths (n,) mm; observed as placement i, targets 1 and 2, centre."""

    ends_mm: FloatArray
    lengths_mm: FloatArray
    observations: Observations


STUDY_LENGTHS_MM = (100.0, 200.0, 300.0, 400.0, 500.0)
_STUDY_POSES = 8  # of each


def study_bars(truth: Truth, rng: np.random.Generator) -> StudyBars:
    """Random bars of 100 to 500 mm in the volume, both ends in at least 3 views, with the noise of the session."""
    view = look(truth.cameras)
    ends = []
    for length in STUDY_LENGTHS_MM:
        x = np.array([0.0, length])
        rotations, places = _fitting_poses(x, _STUDY_POSES, view, truth.volume_mm, None, rng)
        ends.append(places[:, None] + x[:, None] * rotations[:, None, :, 0])
    ends_mm = np.concatenate(ends)
    seen = observe(view, ends_mm.reshape(-1, 3), None)
    order = np.lexsort((seen.point % 2, seen.camera, seen.point // 2))
    camera, end, uv = seen.camera[order], seen.point[order], seen.uv[order]
    uv = uv + lens_misfit(uv, view.sizes[camera], truth.misfit_phases[camera], truth.options.misfit_px)
    observations = Observations(
        placements=tuple(f"S{i + 1:02d}" for i in range(len(ends_mm))), cameras=tuple(c.id for c in truth.cameras),
        points=("centre",), placement=end // 2, camera=camera, target=1 + end % 2,
        point=np.zeros(len(end), dtype=np.int64), uv=uv + rng.normal(size=uv.shape) * truth.sigma_px[camera, None],
    )  # fmt: skip
    return StudyBars(ends_mm, np.linalg.norm(ends_mm[:, 1] - ends_mm[:, 0], axis=1), observations)


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
    uv = true.uv + of_noise.normal(size=true.uv.shape) * truth.sigma_px[true.camera, None]
    noisy, outlier = replace(true, uv=uv), np.zeros(len(true), dtype=bool)
    if not truth.options.outlier_fraction:
        return noisy, outlier
    on_ball = np.flatnonzero(noisy.placement < len(truth.placements))
    sizes = np.array([c.kind.image_size for c in truth.cameras], dtype=float)
    spoilt, wrong = spoil(noisy.select(on_ball), sizes, truth.options.outlier_fraction, of_faults)
    uv[on_ball], outlier[on_ball] = spoilt.uv, wrong
    return replace(true, uv=uv), outlier


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
