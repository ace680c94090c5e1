"""Realistic recordings of random rigs, nothing done wrong: lenses no model follows, focus, drift, vibration, tails."""

from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.simulators.heavy_tails import heavy_noise
from benchmarks.simulators.lens_errors import TrueLens, random_field
from benchmarks.simulators.random_rigs import RandomRig, random_rig
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.observations import Observations
from spherecal.data.session import Bar, BarLength, BarPose, CameraSpec, Mark, Placement, Scale, Session
from spherecal.geometry.rotation import exp_rotation
from spherecal.targets.family import make_target_set
from spherecal_sim.observe import shape_changes, spoil
from spherecal_sim.rigs import TrueCamera, ball_turns, nominal_intrinsics, random_rotations
from spherecal_sim.simulated_ball import Ball, make_ball

Lenses = Literal["usual", "wide", "strong", "long"]
Body = Literal["ball", "half", "plane"]


@dataclass(frozen=True)
class RealisticOptions:
    """What a recording suffers from; `draw_options` draws them. Sizes are those of one recording."""

    lenses: Lenses = "usual"
    body: Body = "ball"  # a ball, one with stickers on a half, or a plane
    placements: int = 4
    turned: bool = True
    targets: int = 200
    noise_px: float = 0.05  # of a dot of 12 px; smaller dots have more
    tail_degrees: float = 5.0  # of freedom, Student's t
    misfit_px: float = 0.05  # median over the cameras of the field that no model follows
    radial_share: float = 0.3
    coma_px: float = 0.02  # at the image's corner
    astigmatism_px: float = 0.02  # there too
    defocus: float = 2.0  # growth of noise away from the focused distance
    drift_mm: float = 0.005  # from the first to the last placement
    drift_rad: float = 5e-6
    drift_focal: float = 1e-5
    vibration_mm: float = 0.001  # from placement to placement
    vibration_rad: float = 2e-6
    flex_mm: float = 0.0  # change of the ball's shape
    print_sd_mm: float = 0.02
    wrong_share: float = 0.005
    few_cameras: int = 0  # see 8 to 20 dots in all
    prior_focal_error: float = 0.02
    bar_scale: bool = True


def draw_options(rng: np.random.Generator) -> RealisticOptions:
    """What a random workshop does: mostly usual, sometimes at the limit of what is found in practice."""

    def log_uniform(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    return RealisticOptions(
        lenses=rng.choice(["usual", "wide", "strong", "long"], p=[0.7, 0.1, 0.1, 0.1]),
        body=rng.choice(["ball", "half", "plane"], p=[0.86, 0.10, 0.04]),
        placements=int(rng.integers(3, 7)),
        turned=bool(rng.random() < 0.7),
        targets=int(rng.integers(60, 251)),
        noise_px=log_uniform(0.02, 0.15),
        tail_degrees=float(rng.uniform(3.5, 10)),
        misfit_px=log_uniform(0.02, 0.3),
        radial_share=float(rng.uniform(0, 0.6)),
        coma_px=log_uniform(0.003, 0.1),
        astigmatism_px=log_uniform(0.003, 0.1),
        defocus=float(rng.uniform(0, 5)),
        drift_mm=log_uniform(0.0005, 0.02),
        drift_rad=log_uniform(5e-7, 2e-5),
        drift_focal=log_uniform(1e-6, 5e-5),
        vibration_mm=log_uniform(0.0002, 0.005),
        vibration_rad=log_uniform(2e-7, 5e-6),
        flex_mm=float(rng.choice([0.0, 0.005, 0.01])),
        print_sd_mm=log_uniform(0.005, 0.06),
        wrong_share=float(rng.choice([0.0, 0.002, 0.005, 0.02])),
        few_cameras=int(rng.choice([0, 1, 2], p=[0.7, 0.2, 0.1])),
        prior_focal_error=float(rng.choice([0.0, 0.01, 0.03, 0.1, 0.3], p=[0.2, 0.3, 0.3, 0.1, 0.1])),
        bar_scale=bool(rng.random() < 0.5),
    )


@dataclass(frozen=True)
class RealisticTruth:
    """All that a realistic recording was made from; cameras as in the middle of the recording."""

    seed: int
    options: RealisticOptions
    rig: RandomRig
    lenses: tuple[TrueLens, ...]
    sigma_px: FloatArray  # (c,) noise of a sharp dot of 12 px
    ball: Ball
    placements: tuple[str, ...]
    ball_rotations: FloatArray
    ball_places_mm: FloatArray
    shape_changes_mm: FloatArray | None
    few: BoolArray  # (c,) cameras that see little
    uv_true_px: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    outlier: BoolArray = field(default_factory=lambda: np.empty(0, dtype=bool))

    def points_mm(self, placement: int) -> FloatArray:
        """The body's dots in the world at a placement index, (dots, 3) mm."""
        shape = self.ball.dots_mm
        if self.shape_changes_mm is not None:
            shape = shape + self.shape_changes_mm[placement]
        return shape @ self.ball_rotations[placement].T + self.ball_places_mm[placement]

    def see(self, points: FloatArray, normals: FloatArray | None) -> tuple[IntArray, IntArray, FloatArray]:
        """Camera (n,), point (n,) and exact image (n, 2) px of what is seen in the middle of the recording.

        `points`: points in the world, (m, 3) mm; `normals`: outward normals of the surface there, (m, 3); None: points
        are seen from all around.
        """
        return _see(self.rig, self.lenses, points, normals)


_TRIES = 40


def simulate_realistic(seed: int, options: RealisticOptions | None = None) -> tuple[Session, RealisticTruth]:
    """A recording of a random rig and its truth; the same seed gives the same.

    A rig that the observations do not link is drawn another time; the fortieth is taken as it is.

    `options` None draws it (`draw_options`).
    """
    of_options, of_rig, of_ball, of_places, of_lens, of_noise, of_faults = (
        np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(7)
    )
    options = options or draw_options(of_options)
    truth = _set_up(seed, options, of_rig, of_ball, of_places, of_lens)
    for _ in range(_TRIES - 1):
        if _hangs_together(truth):
            break
        truth = _set_up(seed, options, of_rig, of_ball, of_places, of_lens)
    observations, truth = _record(truth, of_noise, of_faults)
    return _session(truth, observations, of_noise, of_faults)


def _set_up(
    seed: int,
    o: RealisticOptions,
    of_rig: np.random.Generator,
    of_ball: np.random.Generator,
    of_places: np.random.Generator,
    of_lens: np.random.Generator,
) -> RealisticTruth:
    rig = random_rig(of_rig, o.lenses)
    target_set = make_target_set(o.targets)
    ball = make_ball(target_set, tuple(range(1, o.targets + 1)), of_ball, rig.ball_radius_mm, 1.0, o.print_sd_mm)
    ball = _other_body(ball, o.body, of_ball)
    n = len(rig.cameras)
    low, high = rig.ball_box_mm
    places = of_places.uniform(low, high, (o.placements, 3))
    corners = np.array([[-1, -1], [1, 1], [-1, 1], [1, -1]])
    first = min(4, o.placements)
    places[:first, :2] = 0.9 * corners[:first] * high[:2]
    turns = ball_turns(o.placements, "turned" if o.turned else "moved", of_places)
    if o.body == "plane":  # faces up, tilted
        turns = exp_rotation(of_places.normal(0, 0.35, (o.placements, 3)) * [1, 1, 2])
        turns = turns if o.turned else np.tile(turns[:1], (o.placements, 1, 1))
    lenses = tuple(_lens(camera, bool(f), o, of_lens) for camera, f in zip(rig.cameras, rig.fisheye, strict=True))
    few = np.zeros(n, dtype=bool)
    few[of_rig.permutation(n)[: o.few_cameras if n > 5 else 0]] = True
    truth = RealisticTruth(
        seed,
        o,
        rig,
        lenses,
        o.noise_px * of_lens.lognormal(0, 0.35, n),
        ball,
        tuple(f"P{t + 1}" for t in range(o.placements)),
        turns,
        places,
        shape_changes(ball, o.placements, o.flex_mm, "smooth", of_ball) if o.flex_mm else None,
        few,
    )
    return replace(truth, lenses=_with_fields(truth, of_lens)) if o.misfit_px else truth


def _with_fields(truth: RealisticTruth, rng: np.random.Generator) -> tuple[TrueLens, ...]:
    """The lenses with their fields, over that part of each image in which the body is seen."""
    o, out = truth.options, []
    seen = [truth.see(truth.points_mm(t), truth.ball.normals @ r.T) for t, r in enumerate(truth.ball_rotations)]
    camera, uv = np.concatenate([s[0] for s in seen]), np.concatenate([s[2] for s in seen])
    for c, lens in enumerate(truth.lenses):
        place, region = lens.normalised(uv[camera == c]), np.array([[-1.0, -1.0], [1.0, 1.0]])
        if len(place) > 20:
            region = np.array([place.min(axis=0), place.max(axis=0)])
        rms = float(np.clip(o.misfit_px * rng.lognormal(0, 0.5), 0.02, 0.3))
        field_ = random_field(lens.size, lens.intrinsics, region, rms, o.radial_share, rng)
        out.append(replace(lens, field=field_, region=region))
    return tuple(out)


def _other_body(ball: Ball, body: Body, rng: np.random.Generator) -> Ball:
    """The ball; with stickers on its upper half alone; or its dots laid flat onto a plane that faces up."""
    if body == "ball":
        return ball
    up = ball.normals[:, 2]
    if body == "half":
        upper = np.isin(ball.dot_target, np.unique(ball.dot_target[up > 0]))
        return _only(ball, upper)
    middles = rng.uniform(-1, 1, (len(ball.targets), 2)) * ball.radius_mm
    turn = rng.uniform(0, 2 * np.pi, len(ball.targets))
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]).transpose(2, 0, 1)
    flat = middles[:, None] + np.einsum("tij,tkj->tki", axes, ball.layouts_mm * [1.0, -1.0])  # y of stickers is down
    dots = np.zeros((flat.shape[0] * flat.shape[1], 3))
    dots[:, :2] = flat.reshape(-1, 2)
    normals = np.tile([0.0, 0.0, 1.0], (len(dots), 1))
    order = np.argsort(ball.targets, kind="stable")
    assert (order == np.arange(len(order))).all()
    return replace(ball, dots_mm=dots, normals=normals)


def _only(ball: Ball, rows: BoolArray) -> Ball:
    return replace(
        ball,
        dot_target=ball.dot_target[rows],
        dot_point=ball.dot_point[rows],
        dots_mm=ball.dots_mm[rows],
        normals=ball.normals[rows],
    )


def _lens(camera: TrueCamera, fisheye: bool, o: RealisticOptions, rng: np.random.Generator) -> TrueLens:
    """A lens with its point spread and focus, without a field."""
    kind = camera.kind
    spread = rng.lognormal(0, 0.5, 2)
    distance = float(np.linalg.norm(camera.centre_mm))
    return TrueLens(
        kind.image_size,
        camera.intrinsics,
        np.zeros((1, 2)),
        np.array([[-1.0, -1.0], [1.0, 1.0]]),
        rng.normal(0, [0.01, 0.005, 0.0, 0.0]) if fisheye else None,
        o.coma_px * float(spread[0]),
        o.astigmatism_px * float(spread[1]),
        distance * float(rng.uniform(0.95, 1.05)),
        o.defocus,
    )


def _see(
    rig: RandomRig,
    lenses: tuple[TrueLens, ...],
    points: FloatArray,
    normals: FloatArray | None,
    poses: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Camera, point and exact image of the points that each camera sees, sorted by camera."""
    camera, point, images = [], [], []
    for c, (true, lens) in enumerate(zip(rig.cameras, lenses, strict=True)):
        pose = (true.rotation, true.translation_mm) if poses is None else (poses[0][c], poses[1][c])
        rows, uv = lens.sees(pose, points, normals)
        camera.append(np.full(len(rows), c))
        point.append(rows)
        images.append(uv)
    return np.concatenate(camera), np.concatenate(point), np.concatenate(images)


_ENOUGH = 40  # points that three cameras must share: twice what the method needs at the least


def _hangs_together(truth: RealisticTruth) -> bool:
    """Whether triples with enough points in common link all cameras, those that see little aside."""
    n, dots = len(truth.rig.cameras), len(truth.ball.dots_mm)
    seen = np.zeros((n, len(truth.placements) * dots), dtype=bool)
    for t in range(len(truth.placements)):
        normals = truth.ball.normals @ truth.ball_rotations[t].T
        camera, point, _ = truth.see(truth.points_mm(t), normals)
        seen[camera, t * dots + point] = True
    group = np.arange(n)
    for a, b, c in combinations(np.flatnonzero(~truth.few), 3):
        if (seen[a] & seen[b] & seen[c]).sum() >= _ENOUGH:
            group[np.isin(group, group[[a, b, c]])] = group[a]
    return len(np.unique(group[~truth.few])) == 1 and bool((seen[truth.few].sum(axis=1) >= 20).all())


def _record(
    truth: RealisticTruth, of_noise: np.random.Generator, of_faults: np.random.Generator
) -> tuple[Observations, RealisticTruth]:
    """All placements, with drift and vibration, noise and wrong ids."""
    o, cameras = truth.options, truth.rig.cameras
    count, n = len(truth.placements), len(cameras)
    time = np.linspace(-0.5, 0.5, count)
    directions = of_noise.normal(size=(2, n, 3)) / np.sqrt(3.0)
    by_focal = o.drift_focal * of_noise.normal(size=n)
    parts, images, sigmas = [], [], []
    for t in range(count):
        shift = o.drift_mm * time[t] * directions[0] + o.vibration_mm * of_noise.normal(size=(n, 3))
        turn = o.drift_rad * time[t] * directions[1] + o.vibration_rad * of_noise.normal(size=(n, 3))
        rotation = exp_rotation(turn) @ np.array([c.rotation for c in cameras])
        translation = np.einsum("nij,nj->ni", exp_rotation(turn), np.array([c.translation_mm for c in cameras])) + shift
        lenses = tuple(_longer(lens, 1 + f * time[t]) for lens, f in zip(truth.lenses, by_focal, strict=True))
        points = truth.points_mm(t)
        normals = truth.ball.normals @ truth.ball_rotations[t].T
        camera, point, uv = _see(truth.rig, lenses, points, normals, (rotation, translation))
        depth = np.einsum("nj,nj->n", rotation[camera, 2], points[point]) + translation[camera, 2]
        parts.append(
            np.stack([np.full(len(camera), t), camera, truth.ball.dot_target[point], truth.ball.dot_point[point]])
        )
        images.append(uv)
        sigmas.append(_noise_px(truth, camera, depth))
    placement, camera, target, point = np.concatenate(parts, axis=1)
    uv, sigma = np.concatenate(images), np.concatenate(sigmas)
    names = tuple(c.id for c in cameras)
    exact = Observations(truth.placements, names, truth.ball.points, placement, camera, target, point, uv)
    keep = _few_kept(truth, exact, of_faults)
    exact, sigma = exact.select(keep), sigma[keep]
    noisy = replace(exact, uv=exact.uv + heavy_noise(sigma, of_noise, o.tail_degrees))
    sizes = np.array([c.kind.image_size for c in cameras], dtype=float)
    wrong = np.zeros(len(noisy), dtype=bool)
    if o.wrong_share:
        noisy, wrong = spoil(noisy, sizes, o.wrong_share, of_faults)
    return noisy, replace(truth, uv_true_px=exact.uv, outlier=wrong)


def _longer(lens: TrueLens, factor: float) -> TrueLens:
    intrinsics = lens.intrinsics.copy()
    intrinsics[:2] *= factor
    return replace(lens, intrinsics=intrinsics)


_DOT_MM, _SHARP_DOT_PX = 3.0, 12.0


def _noise_px(truth: RealisticTruth, camera: IntArray, depth: FloatArray) -> FloatArray:
    """Standard deviations (n,) px: of the camera, out of focus more, of small dots more."""
    focal = np.array([lens.intrinsics[0] for lens in truth.lenses])
    blur = np.empty(len(camera))
    for c, lens in enumerate(truth.lenses):
        blur[camera == c] = lens.blur(depth[camera == c])
    dot_px = focal[camera] * _DOT_MM / depth
    return truth.sigma_px[camera] * blur * np.clip(np.sqrt(_SHARP_DOT_PX / dot_px), 0.7, 3.0)


def _few_kept(truth: RealisticTruth, o: Observations, rng: np.random.Generator) -> BoolArray:
    """Which observations stay (n,): of the cameras that see little 8 to 20 in all."""
    keep = np.ones(len(o), dtype=bool)
    for c in np.flatnonzero(truth.few):
        rows = np.flatnonzero(o.camera == c)
        keep[rng.permutation(rows)[int(rng.integers(8, 21)) :]] = False
    return keep


_CERTIFICATE_SD_MM = 0.002
_BAR_POSES = 6


def _session(
    truth: RealisticTruth, observations: Observations, of_noise: np.random.Generator, of_faults: np.random.Generator
) -> tuple[Session, RealisticTruth]:
    o, rig = truth.options, truth.rig
    targets = make_target_set(o.targets + 2)
    specs = []
    common = 1 + o.prior_focal_error * of_faults.uniform(-1, 1)  # most cameras of a rig have the same wrong entry
    for camera in rig.cameras:
        prior = nominal_intrinsics(camera.kind)
        if o.prior_focal_error:
            prior[:2] *= common * (1 + 0.2 * o.prior_focal_error * of_faults.uniform(-1, 1))
        specs.append(
            CameraSpec(
                camera.id,
                camera.kind.image_size,
                prior,
                True,
                camera.id,
                model=camera.kind.model,
                pixel_pitch_um=camera.kind.pixel_pitch_um,
                focal_length_mm=camera.kind.focal_length_mm,
            )
        )
    layout = targets.layouts[1]
    distance = round(float(np.linalg.norm(layout["E"] - layout["A"])), 9)
    surface = "flat" if o.body == "plane" else "sphere"
    scale = Scale("target_spacing", "A", "E", distance, surface, expanded_uncertainty_mm=0.0)  # no common error
    bars: tuple[Bar, ...] = ()
    poses: tuple[BarPose, ...] = ()
    if o.bar_scale:
        seen, length = _bar_observations(truth, observations, of_noise, of_faults)
        if seen is not None:
            observations, scale = seen, Scale("bar", bar="B")
            marks = {"B1": Mark(o.targets + 1, "centre"), "B2": Mark(o.targets + 2, "centre")}
            lengths = (BarLength("B1", "B2", length, 2 * _CERTIFICATE_SD_MM, 2.0),)
            bars = (Bar("B", "scale", marks, lengths, 0.0, 20.0),)
            poses = tuple(BarPose(name, "B", 20.0) for name in observations.placements[len(truth.placements) :])
    truth = _padded(truth, observations)
    diameter = None if o.body == "plane" else 2 * rig.ball_radius_mm
    session = Session(
        Path(),
        tuple(specs),
        tuple(Placement(p) for p in truth.placements),
        bars,
        poses,
        scale,
        None,
        diameter,
        targets,
        observations,
        "",
    )
    return session, truth


def _padded(truth: RealisticTruth, observations: Observations) -> RealisticTruth:
    """The truth with rows for the bar's observations, which are never spoilt."""
    extra = len(observations) - len(truth.outlier)
    return replace(
        truth,
        outlier=np.concatenate([truth.outlier, np.zeros(extra, dtype=bool)]),
        uv_true_px=np.concatenate([truth.uv_true_px, np.full((extra, 2), np.nan)]),
    )


def random_lengths(
    truth: RealisticTruth, count: int, rng: np.random.Generator, share: tuple[float, float] = (0.2, 0.8)
) -> FloatArray:
    """Ends (count or fewer, 2, 3) mm of random lengths in the volume, each end in three or more views."""
    low, high = truth.rig.volume_mm
    diagonal = float(np.linalg.norm(high - low))
    found = [np.empty((0, 2, 3))]
    for _ in range(30):
        if sum(map(len, found)) >= count:
            break
        along = random_rotations(200, rng)[:, 0]
        length = diagonal * rng.uniform(*share, (200, 1))
        middle = rng.uniform(low, high, (200, 3))
        ends = np.stack([middle - along * length / 2, middle + along * length / 2], axis=1)
        ends = ends[((ends >= low) & (ends <= high)).all(axis=(1, 2))]
        _, point, _ = truth.see(ends.reshape(-1, 3), None)
        views = np.bincount(point, minlength=2 * len(ends)).reshape(-1, 2)
        found.append(ends[(views >= 3).all(axis=1)])
    return np.concatenate(found)[:count]


def _bar_observations(
    truth: RealisticTruth, o: Observations, of_noise: np.random.Generator, of_faults: np.random.Generator
) -> tuple[Observations | None, float]:
    """The observations with six poses of a scale bar, and its certified length; None where it fits nowhere."""
    one = random_lengths(truth, 1, of_faults, (0.3, 0.5))
    if not len(one):
        return None, 0.0
    length = float(np.linalg.norm(one[0, 1] - one[0, 0]))
    diagonal = float(np.linalg.norm(truth.rig.volume_mm[1] - truth.rig.volume_mm[0]))
    ends = random_lengths(truth, _BAR_POSES, of_faults, (length / diagonal, length / diagonal))
    if len(ends) < 2:
        return None, 0.0
    camera, point, uv = truth.see(ends.reshape(-1, 3), None)
    keep = ~truth.few[camera]
    camera, point, uv = camera[keep], point[keep], uv[keep]
    uv = uv + heavy_noise(truth.sigma_px[camera], of_noise, truth.options.tail_degrees)
    names = tuple(f"B-{i + 1}" for i in range(len(ends)))
    first, centre = len(truth.placements), len(o.points)
    extended = Observations(
        o.placements + names,
        o.cameras,
        (*o.points, "centre"),
        np.concatenate([o.placement, first + point // 2]),
        np.concatenate([o.camera, camera]),
        np.concatenate([o.target, truth.options.targets + 1 + point % 2]),
        np.concatenate([o.point, np.full(len(point), centre)]),
        np.concatenate([o.uv, uv]),
    )
    return extended, length + float(of_faults.normal(0, _CERTIFICATE_SD_MM))
