"""A calibrated simulated rig that looks at a body with targets, at rest, moving, or with one of its cameras knocked."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.calibrate import calibrate
from spherecal.data.observations import Observations
from spherecal.data.rig import Calibration, Rig
from spherecal.data.session import Session
from spherecal.geometry.rotation import exp_rotation
from spherecal.geometry.transform import Similarity, fit_similarity
from spherecal.targets.centre import target_centre
from spherecal_measuring.measured_sets import ObservedSet
from spherecal_measuring.measuring_task import PointName
from spherecal_sim.observe import ObservingCameras, look, observe
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_ball import Ball
from spherecal_sim.truth import SimulationOptions, Truth

RATE_HZ = 10.0
Path = Callable[[float], tuple[FloatArray, FloatArray]]  # rotation and place of the body at a time in s


@dataclass(frozen=True)
class World:
    """The rig as calibrated, the truth behind it, and how the rig's world lies in the true one (no scale)."""

    session: Session
    truth: Truth
    rig: Rig
    to_truth: Similarity
    targets: IntArray  # those of the body
    dots_mm: FloatArray  # of all targets, in the ball's order
    normals: FloatArray

    @property
    def rows(self) -> IntArray:
        """The ball's dots that the body carries."""
        return np.flatnonzero(np.isin(self.truth.ball.dot_target, self.targets))

    def middle(self) -> FloatArray:
        """Of the measuring volume."""
        return self.truth.volume_mm.mean(axis=0)

    def centres(self, rotation: FloatArray, place: FloatArray) -> dict[PointName, FloatArray]:
        """The true centres of the body's targets."""
        ball, targets = self.truth.ball, self.session.target_set
        assert targets is not None
        found = {}
        for target in self.targets.tolist():
            mine = np.flatnonzero(ball.dot_target == target)
            names = [ball.points[p] for p in ball.dot_point[mine]]
            centre = target_centre(targets.places(target, names), self.dots_mm[mine] @ rotation.T + place)
            assert centre is not None
            found[PointName(target)] = centre
        return found

    def seen(
        self,
        path: Path,
        number: int,
        rng: np.random.Generator,
        late_s: FloatArray,
        view: ObservingCameras | None = None,
        noise_px: float = 0.04,
    ) -> ObservedSet:
        """Set `number` at RATE_HZ, each camera `late_s` (c,) after the set's moment; the times are exact."""
        view = view or look(self.truth.cameras)
        at = (number - 1) / RATE_HZ
        ball, rows = self.truth.ball, self.rows
        camera, row, uv = [], [], []
        moments: dict[float, list[int]] = {}
        for i, late in enumerate(late_s.tolist()):
            moments.setdefault(late, []).append(i)
        for late, cameras in moments.items():
            rotation, place = path(at + late)
            part = ObservingCameras(*(getattr(view, name)[cameras] for name in ObservingCameras.__dataclass_fields__))
            found = observe(part, self.dots_mm[rows] @ rotation.T + place, self.normals[rows] @ rotation.T)
            camera.append(np.array(cameras)[found.camera])
            row.append(found.point)
            uv.append(found.uv)
        c, r, xy = np.concatenate(camera), rows[np.concatenate(row)], np.concatenate(uv)
        noisy = xy + noise_px * rng.normal(size=xy.shape)
        observations = Observations(
            ("",),
            tuple(one.id for one in self.truth.cameras),
            ball.points,
            np.zeros(len(c), dtype=np.int64),
            c,
            ball.dot_target[r],
            ball.dot_point[r],
            noisy,
            np.full(xy.shape, noise_px),
        )
        exposure = {one.id: at + float(late_s[i]) for i, one in enumerate(self.truth.cameras)}
        return ObservedSet(number, "", observations, at, exposure)


def calibrated_world(
    preset: str, seed: int, body_targets: int | None = None, bent: bool = False, **options: object
) -> World:
    """A rig calibrated from four placements of a ball of 100 targets; the body has all, or some side by side.

    The body is the ball with flat facets under its stickers, or, `bent`, the ball itself.
    """
    chosen = SimulationOptions(targets=100, bar_poses=0, **options)  # type: ignore[arg-type]
    session, truth = simulate_session(preset, seed, chosen)
    calibration = calibrate(session)
    ball = truth.ball
    dots, normals = (ball.dots_mm, ball.normals) if bent else flat_facets(ball)
    return World(
        session,
        truth,
        calibration.rig,
        _to_truth(calibration, truth),
        _side_by_side(truth, body_targets),
        dots,
        normals,
    )


def flat_facets(ball: Ball) -> tuple[FloatArray, FloatArray]:
    """Dots and normals of the ball's stickers on planes that touch it, in the order of its own dots."""
    out = -ball.frames[:, 2]
    places = (out * ball.radius_at(out)[:, None])[:, None] + ball.layouts_mm @ ball.frames[:, :2]
    normals = np.repeat(out[:, None], places.shape[1], axis=1)
    return places.reshape(-1, 3), normals.reshape(-1, 3)


def _side_by_side(truth: Truth, count: int | None) -> IntArray:
    """The targets nearest to the ball's top in the rig's first camera's direction."""
    ball = truth.ball
    if count is None:
        return ball.targets
    middle = np.array([ball.normals[ball.dot_target == t].mean(axis=0) for t in ball.targets])
    towards = middle[0] / np.linalg.norm(middle[0])
    return np.sort(ball.targets[np.argsort(-(middle @ towards))[:count]])


def _to_truth(calibration: Calibration, truth: Truth) -> Similarity:
    """The rigid motion from the rig's world to the true one by the points of the calibration, its datum."""
    names, ball = calibration.observations.points, truth.ball
    row = {(int(t), ball.points[p]): i for i, (t, p) in enumerate(zip(ball.dot_target, ball.dot_point, strict=True))}
    features = calibration.features
    found = np.flatnonzero(np.isfinite(calibration.points_mm[:, 0]) & (features.placement < len(truth.placements)))
    places = [truth.points_mm(t) for t in range(len(truth.placements))]
    true = np.array(
        [places[features.placement[i]][row[int(features.target[i]), names[features.point[i]]]] for i in found]
    )
    return fit_similarity(calibration.points_mm[found], true, with_scale=False)


def facing(world: World, seed: int) -> FloatArray:
    """A rotation of the body by which many cameras see its targets: of 200 random ones the best."""
    rng, view = np.random.default_rng(seed), look(world.truth.cameras)
    rows = world.rows
    best, most = np.eye(3), -1
    for _ in range(200):
        rotation = exp_rotation(rng.uniform(-np.pi, np.pi, 3))
        place = world.middle() - rotation @ world.dots_mm[rows].mean(axis=0)
        seen = observe(view, world.dots_mm[rows] @ rotation.T + place, world.normals[rows] @ rotation.T)
        if len(seen.camera) > most:
            best, most = rotation, len(seen.camera)
    return best


def knocked(world: World, camera: int, shift_mm: FloatArray, turn_rad: FloatArray) -> ObservingCameras:
    """The cameras with one moved in its own frame."""
    view = look(world.truth.cameras)
    turn = exp_rotation(turn_rad)
    rotations, translations = view.rotations.copy(), view.translations.copy()
    rotations[camera] = turn @ rotations[camera]
    translations[camera] = turn @ translations[camera] + shift_mm
    return replace(view, rotations=rotations, translations=translations)
