"""Simulated rigs as the studies use them: the session with its true network, and bars to measure with the result."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from benchmarks.studies.judged import Lengths, Reference
from benchmarks.studies.realistic import dot_places
from spherecal.adjust.bundle import MIN_ANGLE_RAD, Adjustment, refine, usable_features
from spherecal.adjust.covariance import covariance
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.datum import Places
from spherecal.adjust.network import Network
from spherecal.adjust.state import State
from spherecal.adjust.weights import rough_noise, weighted
from spherecal.ball.fit import BallFit, Run
from spherecal.ball.rigid import RigidNetwork, align, share_shape
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.context import Context
from spherecal.data.observations import Features, Observations
from spherecal.data.rig import Calibration
from spherecal.data.rig_camera import posed
from spherecal.data.session import Bar, BarLength, Recording, Session
from spherecal.geometry.length_uncertainty import Cameras, predict_lengths
from spherecal.geometry.transform import PosedCameras
from spherecal.geometry.triangulation import triangulate
from spherecal.scale.metric import Solution, in_millimetres
from spherecal.steps.ball_stages import describe_network
from spherecal.steps.settings import CalibrationSettings
from spherecal_sim.simulate_session import StudyBars, simulate_session, study_bars
from spherecal_sim.truth import SimulationOptions, Truth, camera_pose
from spherecal_verify.participation import lens_corrected

RIGS = ("rigA", "rigB")
SEED_BARS = 5
Form = Literal["free", "rigid"]
FORMS: tuple[Form, ...] = ("free", "rigid")

# The bar that goes into the adjustment: two marks 500 mm apart, certified to 5 um (standard), and a thermometer.
CERTIFICATE_SD_MM, THERMOMETER_SD_K = 0.005, 0.05


@dataclass(frozen=True)
class Simulated:
    """A session, its truth, its network (uv as recorded) and the true state in the rig's frame, in mm.

    `places_mm` (f,3): where the features are; `true.points` has NaN for those that cannot be triangulated at their
    placement. `usable` (n,): observations of points that two or more cameras see at good angles.
    """

    session: Session
    truth: Truth
    features: Features
    network: Network
    places_mm: FloatArray
    true: State
    usable: BoolArray

    @property
    def observations(self) -> Observations:
        """What a calibration uses of what was recorded."""
        return Recording.of(self.session).observations

    @property
    def placed(self) -> BoolArray:
        """All cameras (c,)."""
        return np.ones(len(self.network.group), dtype=bool)

    def with_session(self, session: Session) -> "Simulated":
        """The same rig and placements recorded another time."""
        again = replace(self, session=session)
        return replace(again, network=replace(self.network, uv=again.observations.uv))

    def recorded_again(self, session: Session, rng: np.random.Generator) -> "Simulated":
        """The same with another recording, its bar certified and its temperatures read another time."""
        scale = session.scale
        return self.with_session(session if scale is None or scale.kind != "bar" else certify(session, self.truth, rng))

    @cached_property
    def rigid(self) -> tuple[RigidNetwork, State]:
        """The rigid network, its placements aligned by the true points, and the true start (dots unknown)."""
        alignment = align(
            self.features, self.true.points, len(self.observations.placements), len(self.session.placements)
        )
        return share_shape(self.network, self.features, self.true, alignment)

    @cached_property
    def true_rigid(self) -> State:
        """The rigid form's true state: every observed dot in the world of its first placement, in mm."""
        rigid, start = self.rigid
        turn = start.placement_rotation[rigid.places.placement]
        there = self.places_mm - start.placement_translation[rigid.places.placement]
        points = np.full_like(start.points, np.nan)
        points[rigid.places.point] = np.einsum("fji,fj->fi", turn, there)
        return replace(start, points=points)

    def state_in(self, form: Form) -> State:
        """The truth in a form."""
        return self.true if form == "free" else self.true_rigid

    def network_in(self, form: Form) -> Network:
        """The network in a form, as recorded."""
        if form == "free":
            return self.network
        return replace(self.rigid[0].network, uv=self.network.uv)

    def places_in(self, form: Form) -> Places | None:
        """What the features are in the form."""
        return None if form == "free" else self.rigid[0].places

    def usable_in(self, form: Form) -> BoolArray:
        """Observations (n,) that the form can use: in the rigid one a dot may be seen once at two placements."""
        if form == "free":
            return self.usable
        network, everything = self.rigid[0].network, np.ones(len(self.usable), dtype=bool)
        seen_twice = (network.views(everything) >= 2)[network.feature]
        wide = network.triangulated(self.true_rigid, seen_twice).max_angle_rad >= MIN_ANGLE_RAD
        return seen_twice & wide[network.feature]


def simulate(rig: str, seed: int, options: SimulationOptions) -> Simulated:
    """A rig without bar poses, unless a bar is to give the scale (studies measure with `Bars`)."""
    with_bar = options.scale == "bar"
    session, truth = simulate_session(rig, seed, options if with_bar else replace(options, bar_poses=0))
    if with_bar:
        session = certify(session, truth, np.random.default_rng(seed))
    return known_network(session, truth)


def known_network(session: Session, truth: Truth) -> Simulated:
    """A session's network with the truth behind it."""
    assert session.observations is not None
    recording = Recording.of(session)
    observations, features = recording.observations, recording.features
    network = describe_network(recording, CalibrationSettings())
    places = _true_places(truth, session, observations, features)
    true = State(
        rotation=np.array([c.rotation for c in truth.cameras]),
        translation=np.array([c.translation_mm for c in truth.cameras]),
        intrinsics=np.array([c.intrinsics for c in truth.cameras]),
        points=places,
    )
    silent = replace(session, observations=replace(session.observations, uv=truth.uv_true_px))
    exact = replace(network, uv=Recording.of(silent).observations.uv)
    seen_twice = (network.views(np.ones(len(network.uv), dtype=bool)) >= 2)[network.feature]
    _, good = usable_features(exact, true, seen_twice)
    true = replace(true, points=np.where(good[:, None], places, np.nan))
    return Simulated(session, truth, features, network, places, true, seen_twice & good[network.feature])


def certify(session: Session, truth: Truth, rng: np.random.Generator) -> Session:
    """The session with the scale bar's two end marks alone, certified again, and its temperatures read again."""
    assert session.scale is not None
    bar_id = session.scale.bar

    def certified(bar: Bar) -> Bar:
        if bar.id != bar_id:
            return bar
        true = truth.bar(bar.id)
        first, last = true.marks[0], true.marks[-1]
        value = float(true.x_mm[-1] - true.x_mm[0] + rng.normal(0.0, CERTIFICATE_SD_MM))
        length = BarLength(first, last, value, 2 * CERTIFICATE_SD_MM, 2.0)
        return replace(bar, marks={name: bar.marks[name] for name in (first, last)}, lengths=(length,))

    read = {p.id: p.temperature_c + float(rng.normal(0.0, THERMOMETER_SD_K)) for p in truth.bar_poses}
    return replace(
        session,
        bars=tuple(certified(bar) for bar in session.bars),
        bar_poses=tuple(replace(pose, temperature_c=read[pose.id]) for pose in session.bar_poses),
    )


def _true_places(truth: Truth, session: Session, observations: Observations, features: Features) -> FloatArray:
    """Where all features are, (f,3) mm in the rig's frame: dots of the ball, and a bar's marks."""
    ball, n_placements = truth.ball, len(truth.placements)
    names = [observations.points.index(name) for name in ball.points]
    highest = max(int(features.target.max()), int(ball.dot_target.max()))
    dot = np.full((highest + 1, len(observations.points)), -1)
    dot[ball.dot_target, np.array(names)[ball.dot_point]] = np.arange(len(ball.dot_target))
    out = np.empty((len(features), 3))
    of_ball = features.placement < n_placements
    every = np.stack([truth.points_mm(t) for t in range(n_placements)])
    out[of_ball] = every[features.placement[of_ball], dot[features.target[of_ball], features.point[of_ball]]]
    poses = {pose.id: pose for pose in truth.bar_poses}
    for f in np.flatnonzero(~of_ball):
        pose = poses[session.bar_poses[features.placement[f] - n_placements].id]
        bar = truth.bar(pose.bar)
        stretch = 1 + bar.expansion_per_kelvin * (pose.temperature_c - bar.reference_temperature_c)
        along = stretch * bar.x_mm[bar.targets.index(int(features.target[f]))]
        out[f] = along * pose.rotation[:, 0] + pose.place_mm
    return out


@dataclass(frozen=True)
class Estimate:
    """A solved network with its scale; states stand in the first camera's frame."""

    form: Form
    solved: BallFit
    solution: Solution

    @property
    def adjusted(self) -> Adjustment:
        """The last adjustment."""
        return self.solved.adjusted

    @property
    def cofactors(self) -> Covariance:
        """Of the last adjustment."""
        assert self.solved.cofactors is not None
        return self.solved.cofactors

    @property
    def state(self) -> State:
        """The network, in its own unit, with a point for every feature."""
        return self.solved.by_features.state


def estimate_from_truth(simulated: Simulated, form: Form = "free", first: Estimate | None = None) -> Estimate:
    """The product's adjustment, weights, covariance and scale, started at the true network instead of at triples.

    The rigid form needs the free one, `first`, for its first weights, as the product has it.
    """
    context, placed = Context(), simulated.placed
    if form == "rigid" and first is None:
        raise ValueError("the rigid form takes its first weights from the free one")
    network, start = simulated.network_in(form), simulated.true if form == "free" else simulated.rigid[1]
    noise = rough_noise(network, start, simulated.usable) if first is None else first.solved.network.noise
    network = replace(network, noise=noise)
    adjusted = refine(network, start, simulated.usable, placed, context)
    network, adjusted = weighted(network, adjusted, placed, context)
    adjusted = replace(adjusted, state=adjusted.state.seen_from(0))
    cofactors = covariance(adjusted.problem, adjusted.state, simulated.places_in(form))
    held = np.zeros(len(placed), dtype=bool)
    rigid = None if form == "free" else replace(simulated.rigid[0], network=network)
    solved = BallFit(network, adjusted, cofactors, held, placed, rigid)
    known = np.array([camera.prior for camera in simulated.session.cameras])
    recording = Recording(simulated.session, simulated.observations, simulated.features)
    solved, solution = in_millimetres(recording, solved, Run(known, reference=0, context=context))
    return Estimate(form, solved, solution)


def estimates_from_truth(simulated: Simulated, forms: tuple[Form, ...] = FORMS) -> dict[Form, Estimate]:
    """The forms of one recording."""
    free = estimate_from_truth(simulated)
    return {form: free if form == "free" else estimate_from_truth(simulated, form, free) for form in forms}


@dataclass(frozen=True)
class Bars:
    """Forty random bars, eight each of 100 to 500 mm, as the cameras see them without noise.

    Row i is end `end[i]` = 2 * bar + (0 or 1) in camera `camera[i]` at `uv[i]` px.
    """

    study: StudyBars
    end: np.ndarray
    camera: np.ndarray
    uv: FloatArray
    sigma_px: FloatArray

    @property
    def lengths_mm(self) -> FloatArray:
        """True lengths (n,)."""
        return self.study.lengths_mm

    def noisy_uv(self, noise: FloatArray | None) -> FloatArray:
        """Image points (rows, 2) px; noise (rows, 2) standard normal."""
        return self.uv if noise is None else self.uv + noise * self.sigma_px[self.camera, None]

    def measure(self, cameras: PosedCameras, uv: FloatArray) -> FloatArray:
        """Lengths (n,) by triangulation of image points (rows, 2) px, in the cameras' units."""
        count = 2 * len(self.lengths_mm)
        ends = triangulate(self.end, self.camera, uv, np.ones(len(uv)), count, cameras).points
        return np.linalg.norm(ends[1::2] - ends[::2], axis=1)

    def errors_of(self, state: State, noise: FloatArray | None) -> FloatArray:
        """Measured minus true lengths (n,) for a network in mm."""
        return self.measure(state.cameras, self.noisy_uv(noise)) - self.lengths_mm

    def errors_of_rig(self, calibration: Calibration, noise: FloatArray | None) -> FloatArray:
        """Measured minus true lengths (n,) with a calibrated rig that has all cameras."""
        cameras, uv = calibration.rig.cameras, self.noisy_uv(noise)
        uv, _ = lens_corrected(cameras, self.camera, uv, self.sigma_px[self.camera, None])
        return self.measure(posed(cameras), uv) - self.lengths_mm

    def stated_of_rig(self, calibration: Calibration, truth: Truth) -> FloatArray:
        """The standard uncertainties (n,) mm of these lengths by a rig with all cameras, own noise included."""
        rig = calibration.rig
        assert rig.covariance is not None
        first = next(camera for camera in truth.cameras if camera.id == rig.reference_camera)
        ends = self.study.ends_mm @ first.rotation.T + first.translation_mm
        cameras, sizes = posed(rig.cameras), np.array([c.image_size for c in rig.cameras], dtype=float)
        fields = tuple(c.field for c in rig.cameras)
        covariance = rig.covariance
        looking = Cameras(
            cameras.intrinsics,
            cameras.rotation,
            cameras.translation,
            sizes,
            covariance.matrix,
            covariance.intrinsics,
            fields,
        )
        return predict_lengths(looking, ends, float(np.median(self.sigma_px))).standard_mm()


def make_bars(truth: Truth, seed: int) -> Bars:
    """Bars in the measuring volume, both ends in at least three views."""
    silent = replace(truth, sigma_px=np.zeros(len(truth.cameras)))
    study = study_bars(silent, np.random.default_rng(seed))
    o = study.observations
    return Bars(study, 2 * o.placement + o.target - 1, o.camera, o.uv, truth.sigma_px)


@dataclass(frozen=True)
class BarErrors:
    """Squares (n,) mm^2 of the bars' errors: as measured, and after the scale that suits the bars best."""

    measured: FloatArray
    rescaled: FloatArray


def bar_errors(calibration: Calibration, truth: Truth, bars: Bars, noise: FloatArray | None) -> BarErrors:
    """What a calibrated rig makes of the bars; infinite where cameras are missing."""
    n = len(bars.lengths_mm)
    if len(calibration.rig.cameras) < len(truth.cameras):
        return BarErrors(np.full(n, np.inf), np.full(n, np.inf))
    errors = bars.errors_of_rig(calibration, noise)
    measured = errors + bars.lengths_mm
    stretch = (bars.lengths_mm @ measured) / (measured @ measured)
    return BarErrors(errors**2, (stretch * measured - bars.lengths_mm) ** 2)


def reference(truth: Truth) -> Reference:
    """The rig as it is after the last placement, where the ball's dots were, and the lengths of `make_bars`' bars."""
    poses = [camera_pose(c, truth.options.moved, len(truth.placements)) for c in truth.cameras]
    cameras = tuple(replace(c, rotation=r, translation_mm=t) for c, (r, t) in zip(truth.cameras, poses, strict=True))
    bars = make_bars(replace(truth, cameras=cameras), SEED_BARS)
    return Reference(
        tuple(c.id for c in cameras),
        np.array([c.rotation for c in cameras]),
        np.array([c.translation_mm for c in cameras]),
        lambda features, o: dot_places(truth, len(truth.placements), features, o),
        Lengths(bars.study.ends_mm, bars.end, bars.camera, bars.uv),
    )
