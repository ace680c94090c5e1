"""A simulated rig that can be recorded in any wrong way: other poses, lenses and balls for single images."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.simulators.lens_errors import TrueLens
from benchmarks.simulators.realistic import RealisticOptions, simulate_realistic
from benchmarks.studies.judged import Lengths, Reference
from benchmarks.studies.realistic import dot_places
from spherecal.base.arrays import FloatArray
from spherecal.data.observations import Observations
from spherecal.data.session import Bar, BarLength, BarPose, CameraSpec, Mark, Placement, Scale, Session
from spherecal.steps.settings import CalibrationSettings
from spherecal.targets.family import make_target_set
from spherecal_sim.rigs import TrueCamera, nominal_intrinsics, random_rotations
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_ball import Ball
from spherecal_sim.truth import SimulationOptions

RIGS = ("rigA", "rigB", "hall12", "random")
NOISE_PX = 0.04
_TARGETS = 200

Pose = tuple[FloatArray, FloatArray]  # rotation (3, 3) and translation (3,)


@dataclass(frozen=True)
class World:
    """A rig, its ball and placements; `poses`, `balls`, `lenses`, `shapes` say what holds for camera c at placement t.

    The defaults hold for all. Poses map world to camera, a ball's pose ball to world; `glass_of` points in the camera's
    frame to where they seem to be through glass.
    """

    cameras: tuple[TrueCamera, ...]
    lenses: tuple[TrueLens, ...]
    ball: Ball
    turns: FloatArray
    places_mm: FloatArray
    volume_mm: FloatArray
    seed: int
    pose_of: Callable[[int, int], Pose] | None = None
    ball_of: Callable[[int, int], Pose] | None = None
    lens_of: Callable[[int, int], TrueLens] | None = None
    shape_of: Callable[[int], Ball] | None = None
    glass_of: Callable[[int, int, FloatArray], FloatArray] | None = None
    prior_error: float = 0.01
    settings: CalibrationSettings = field(default_factory=CalibrationSettings)

    @property
    def ids(self) -> tuple[str, ...]:
        """The cameras' names."""
        return tuple(c.id for c in self.cameras)

    @property
    def placements(self) -> tuple[str, ...]:
        """The placements' names."""
        return tuple(f"P{t + 1}" for t in range(len(self.turns)))

    def points_mm(self, placement: int) -> FloatArray:
        """The ball's dots in the world, (dots, 3), in the shape that it has then."""
        ball = self.ball if self.shape_of is None else self.shape_of(placement)
        return ball.dots_mm @ self.turns[placement].T + self.places_mm[placement]

    def pose(self, c: int, t: int) -> Pose:
        """World to camera."""
        return (
            (self.cameras[c].rotation, self.cameras[c].translation_mm) if self.pose_of is None else self.pose_of(c, t)
        )

    def lens(self, c: int, t: int) -> TrueLens:
        """The lens of a camera at a placement."""
        return self.lenses[c] if self.lens_of is None else self.lens_of(c, t)

    def image(self, c: int, t: int, points: FloatArray, normals: FloatArray | None) -> tuple[np.ndarray, FloatArray]:
        """Which of the points (m, 3) camera c sees at placement t, and where, (k,), (k, 2)."""
        through = None if self.glass_of is None else partial(self.glass_of, c, t)
        return self.lens(c, t).sees(self.pose(c, t), points, normals, through)

    def normals(self, ball: Ball, turn: FloatArray) -> FloatArray | None:
        """Which way the dots face; None for marks that are seen from all around."""
        return ball.normals @ turn.T if len(ball.normals) else None

    def specs(self, rng: np.random.Generator) -> tuple[CameraSpec, ...]:
        """The cameras as the session knows them: priors from data sheets, a little wrong."""
        specs = []
        for camera in self.cameras:
            prior = nominal_intrinsics(camera.kind)
            prior[:2] *= 1 + self.prior_error * rng.uniform(-1, 1)
            size, pitch, focal = camera.kind.image_size, camera.kind.pixel_pitch_um, camera.kind.focal_length_mm
            specs.append(
                CameraSpec(camera.id, size, prior, True, camera.id, pixel_pitch_um=pitch, focal_length_mm=focal)
            )
        return tuple(specs)

    def record(self, rng: np.random.Generator) -> Observations:
        """All placements with noise."""
        parts, images = [], []
        for t in range(len(self.turns)):
            ball = self.ball if self.shape_of is None else self.shape_of(t)
            for c in range(len(self.cameras)):
                turn, place = (self.turns[t], self.places_mm[t]) if self.ball_of is None else self.ball_of(c, t)
                rows, uv = self.image(c, t, ball.dots_mm @ turn.T + place, self.normals(ball, turn))
                n = len(rows)
                parts.append(np.stack([np.full(n, t), np.full(n, c), ball.dot_target[rows], ball.dot_point[rows]]))
                images.append(uv)
        placement, camera, target, point = np.concatenate(parts, axis=1)
        uv = np.concatenate(images)
        uv = uv + rng.normal(0, NOISE_PX, uv.shape)
        return Observations(self.placements, self.ids, self.ball.points, placement, camera, target, point, uv)

    def session(self, observations: Observations, rng: np.random.Generator) -> Session:
        """The session of a recording, scale by target spacing; priors from data sheets, a little wrong."""
        targets = make_target_set(_TARGETS + 2)
        layout = targets.layouts[1]
        distance = round(float(np.linalg.norm(layout["E"] - layout["A"])), 9)
        return Session(
            Path(),
            self.specs(rng),
            tuple(Placement(p) for p in observations.placements),
            (),
            (),
            Scale("target_spacing", "A", "E", distance, "sphere", expanded_uncertainty_mm=0.0),
            None,
            2 * round(self.ball.radius_mm),
            targets,
            observations,
            "",
        )

    def reference(self) -> Reference:
        """The truth after the recording: poses and lenses of the last placement."""
        last = len(self.turns) - 1
        poses = [self.pose(c, last) for c in range(len(self.cameras))]
        ends = self.lengths(40, np.random.default_rng([self.seed, 5]))
        camera, end, uv = self.see_last(ends)
        return Reference(
            self.ids,
            np.array([r for r, _ in poses]),
            np.array([t for _, t in poses]),
            lambda f, o: dot_places(self, len(self.turns), f, o),
            Lengths(ends, end, camera, uv),
        )

    def see_last(self, ends: FloatArray) -> tuple[np.ndarray, np.ndarray, FloatArray]:
        """Camera, end and image of the ends (m, 2, 3), by the cameras as they are after the recording."""
        last, flat = len(self.turns) - 1, ends.reshape(-1, 3)
        seen = [self.image(c, last, flat, None) for c in range(len(self.cameras))]
        camera = np.concatenate([np.full(len(rows), c) for c, (rows, _) in enumerate(seen)])
        return camera, np.concatenate([r for r, _ in seen]), np.concatenate([uv for _, uv in seen])

    def lengths(self, count: int, rng: np.random.Generator, length_mm: float | None = None) -> FloatArray:
        """Ends (count or fewer, 2, 3) of random lengths in the volume, each in three or more views."""
        low, high = self.volume_mm
        most = min(500.0, 0.8 * float(np.linalg.norm(high - low)))
        found = [np.empty((0, 2, 3))]
        for _ in range(20):
            if sum(map(len, found)) >= count:
                break
            along = random_rotations(150, rng)[:, 0]
            length = np.full((150, 1), length_mm) if length_mm else rng.uniform(0.2 * most, most, (150, 1))
            middle = rng.uniform(low, high, (150, 3))
            ends = np.stack([middle - along * length / 2, middle + along * length / 2], axis=1)
            ends = ends[((ends >= low) & (ends <= high)).all(axis=(1, 2))]
            _, end, _ = self.see_last(ends)
            views = np.bincount(end, minlength=2 * len(ends)).reshape(-1, 2)
            found.append(ends[(views >= 3).all(axis=1)])
        return np.concatenate(found)[:count]

    def with_bar(self, session: Session, certified_share: float, rng: np.random.Generator) -> Session:
        """The session with six poses of a scale bar whose certificate says so many times its true length."""
        seen, bar, poses = self.bar_of("scale", 6, certified_share, session.observations, rng)
        return replace(session, observations=seen, bars=(bar,), bar_poses=poses, scale=Scale("bar", bar="B"))

    def verification(self, session: Session, poses: int, rng: np.random.Generator) -> Session:
        """A session of a check bar in so many poses, recorded by the cameras as they are after the recording."""
        o = session.observations
        assert o is not None
        none = replace(o.select(np.zeros(len(o), dtype=bool)), placements=())
        seen, bar, poses_ = self.bar_of("check", poses, 1.0, none, rng)
        return replace(session, placements=(), observations=seen, bars=(bar,), bar_poses=poses_, scale=None)

    def one_more_placement(self, rng: np.random.Generator) -> tuple[Session, Observations]:
        """A session of the ball at the middle of its places, by the cameras as they are after the recording."""
        last = len(self.turns) - 1
        middle = self.places_mm.mean(axis=0)
        after = replace(
            self,
            turns=self.turns[-1:],
            places_mm=middle[None],
            ball_of=None,
            shape_of=None,
            pose_of=lambda c, t: self.pose(c, last),
            lens_of=lambda c, t: self.lens(c, last),
        )
        observations = after.record(rng)
        return after.session(observations, rng), observations

    def bar_of(
        self,
        role: Literal["scale", "check"],
        count: int,
        certified_share: float,
        o: Observations | None,
        rng: np.random.Generator,
        shifted: tuple[float, tuple[int, ...]] = (0.0, ()),
    ) -> tuple[Observations, Bar, tuple[BarPose, ...]]:
        """Observations with poses of a bar of two marks behind them, the bar and its poses.

        `shifted`: by how many mm its second mark lies farther out, and in which poses.
        """
        assert o is not None
        low, high = self.volume_mm
        length = min(400.0, 0.4 * float(np.linalg.norm(high - low)))
        ends = self.lengths(count, rng, length)
        for pose in shifted[1]:
            ends[pose, 1] += shifted[0] / length * (ends[pose, 1] - ends[pose, 0])
        camera, end, uv = self.see_last(ends)
        order = np.lexsort((camera, end))
        camera, end, uv = camera[order], end[order], uv[order] + rng.normal(0, NOISE_PX, uv.shape)
        names = tuple(f"B-{i + 1}" for i in range(len(ends)))
        first = len(o.placements)
        seen = Observations(
            o.placements + names,
            o.cameras,
            (*o.points, "centre"),
            np.concatenate([o.placement, first + end // 2]),
            np.concatenate([o.camera, camera]),
            np.concatenate([o.target, _TARGETS + 1 + end % 2]),
            np.concatenate([o.point, np.full(len(end), len(o.points))]),
            np.concatenate([o.uv, uv]),
        )
        value = length * certified_share + float(rng.normal(0, 0.002))
        marks = {"B1": Mark(_TARGETS + 1, "centre"), "B2": Mark(_TARGETS + 2, "centre")}
        bar = Bar("B", role, marks, (BarLength("B1", "B2", value, 0.004, 2.0),), 0.0, 20.0)
        return seen, bar, tuple(BarPose(name, "B", 20.0) for name in names)


_CLEAN = RealisticOptions(
    noise_px=NOISE_PX,
    tail_degrees=1e6,
    misfit_px=0.0,
    coma_px=0.0,
    astigmatism_px=0.0,
    defocus=0.0,
    drift_mm=0.0,
    drift_rad=0.0,
    drift_focal=0.0,
    vibration_mm=0.0,
    vibration_rad=0.0,
    print_sd_mm=0.0,
    wrong_share=0.0,
    bar_scale=False,
    targets=_TARGETS,
)


def make_world(rig: str, seed: int, targets: int = _TARGETS) -> World:
    """A rig as built, with its ball at the method's placements.

    Parameters
    ----------
    rig, seed
        One of `RIGS`, and the random numbers of what differs from one to the next.
    targets
        Targets on the ball, as many as the session's set at most.
    """
    if rig == "random":
        _, truth = simulate_realistic(seed, replace(_CLEAN, targets=targets))
        return World(
            truth.rig.cameras,
            truth.lenses,
            truth.ball,
            truth.ball_rotations,
            truth.ball_places_mm,
            truth.rig.volume_mm,
            seed,
        )
    placements = 8 if rig.startswith("hall") else 4
    options = SimulationOptions(bar_poses=0, placements=placements, targets=targets)
    _, truth = simulate_session(rig, seed, options)
    border = np.array([[-1.0, -1.0], [1.0, 1.0]])
    lenses = tuple(TrueLens(c.kind.image_size, c.intrinsics, np.zeros((1, 2)), border) for c in truth.cameras)
    return World(truth.cameras, lenses, truth.ball, truth.ball_rotations, truth.ball_places_mm, truth.volume_mm, seed)
