"""Simulated rigs as the studies use them: the session with its true network, and bars to measure with the result."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.bundle import Adjusted, adjust, usable_features
from spherecal.adjust.covariance import Covariance, covariance
from spherecal.adjust.network import Network
from spherecal.adjust.problem import State
from spherecal.arrays import BoolArray, FloatArray
from spherecal.calibrate import CalibrationSettings, describe_network
from spherecal.context import Context
from spherecal.geometry.triangulation import triangulate
from spherecal.network.observations import Features, Observations, find_features
from spherecal.rig import Calibration
from spherecal.session.model import Session
from spherecal.simulate.bars import StudyBars, study_bars
from spherecal.simulate.session import simulate_session
from spherecal.simulate.truth import SimulationOptions, Truth
from spherecal.solution import Solution, metric_solution

RIGS = ("rigA", "rigB")


@dataclass(frozen=True)
class Simulated:
    """A session, its truth, its network (uv as recorded) and the true state in the rig's frame, in mm.

    `usable` (n,): observations of points that two or more cameras see at good angles.
    """

    session: Session
    truth: Truth
    features: Features
    network: Network
    true: State
    usable: BoolArray

    @property
    def observations(self) -> Observations:
        """What was recorded."""
        assert self.session.observations is not None
        return self.session.observations

    def with_session(self, session: Session) -> "Simulated":
        """The same rig and placements recorded another time."""
        assert session.observations is not None
        network = replace(self.network, uv=session.observations.uv)
        return replace(self, session=session, network=network)


def simulate(rig: str, seed: int, options: SimulationOptions) -> Simulated:
    """A rig without bar poses of its own (studies use `Bars`)."""
    session, truth = simulate_session(rig, seed, replace(options, bar_poses=0))
    assert session.observations is not None
    features = find_features(session.observations)
    network = describe_network(session, session.observations, features, CalibrationSettings())
    true = _true_state(truth, features)
    seen_twice = (network.views(np.ones(len(network.uv), dtype=bool)) >= 2)[network.feature]
    _, good = usable_features(replace(network, uv=truth.uv_true_px), true, seen_twice)
    true = replace(true, points=np.where(good[:, None], true.points, np.nan))
    return Simulated(session, truth, features, network, true, seen_twice & good[network.feature])


def _true_state(truth: Truth, features: Features) -> State:
    ball = truth.ball
    place = np.stack([truth.points_mm(t) for t in range(len(truth.placements))])
    dot = np.full((ball.dot_target.max() + 1, len(ball.points)), -1)
    dot[ball.dot_target, ball.dot_point] = np.arange(len(ball.dot_target))
    return State(
        rotation=np.array([c.rotation for c in truth.cameras]),
        translation=np.array([c.translation_mm for c in truth.cameras]),
        intrinsics=np.array([c.intrinsics for c in truth.cameras]),
        points=place[features.placement, dot[features.target, features.point]],
    )


@dataclass(frozen=True)
class Estimate:
    """An adjusted network with its covariance and scale; `adjusted.state` stands in the first camera's frame."""

    adjusted: Adjusted
    cofactors: Covariance
    solution: Solution


def estimate_from_truth(simulated: Simulated) -> Estimate:
    """The product's adjustment, covariance and scale, started at the true network instead of at triples."""
    network, true = simulated.network, simulated.true
    placed = np.ones(len(network.group), dtype=bool)
    adjusted = adjust(network, true, true.points, simulated.usable, placed, "numba", Context())
    adjusted = replace(adjusted, state=adjusted.state.seen_from(0))
    cofactors = covariance(adjusted.problem, adjusted.state, "numba")
    assert cofactors is not None
    solution = metric_solution(
        simulated.session, simulated.observations, simulated.features, adjusted, cofactors
    )  # fmt: skip
    return Estimate(adjusted, cofactors, solution)


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

    def measure(
        self, intrinsics: FloatArray, rotation: FloatArray, translation: FloatArray, noise: FloatArray | None
    ) -> FloatArray:
        """Lengths (n,) by triangulation, in the cameras' units; noise (rows, 2) standard normal."""
        uv = self.uv if noise is None else self.uv + noise * self.sigma_px[self.camera, None]
        weight = np.ones(len(uv))
        count = 2 * len(self.lengths_mm)
        ends = triangulate(self.end, self.camera, uv, weight, count, intrinsics, rotation, translation).points
        return np.linalg.norm(ends[1::2] - ends[::2], axis=1)

    def errors_of(self, state: State, noise: FloatArray | None) -> FloatArray:
        """Measured minus true lengths (n,) for a network in mm."""
        return self.measure(state.intrinsics, state.rotation, state.translation, noise) - self.lengths_mm

    def errors_of_rig(self, calibration: Calibration, noise: FloatArray | None) -> FloatArray:
        """Measured minus true lengths (n,) with a calibrated rig that has all cameras."""
        cameras = calibration.rig.cameras
        stacks = ([getattr(c, name) for c in cameras] for name in ("intrinsics", "rotation", "translation_mm"))
        return self.measure(*map(np.array, stacks), noise) - self.lengths_mm


def make_bars(truth: Truth, seed: int) -> Bars:
    """Bars in the measuring volume, both ends in at least three views."""
    silent = replace(truth, sigma_px=np.zeros(len(truth.cameras)))
    study = study_bars(silent, np.random.default_rng(seed))
    o = study.observations
    return Bars(study, 2 * o.placement + o.target - 1, o.camera, o.uv, truth.sigma_px)
