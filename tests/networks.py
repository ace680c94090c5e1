"""Small networks whose truth is known, and calibrations of simulated sessions that several tests look at."""

import hashlib
import os
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from spherecal.adjust import corrections
from spherecal.adjust.ball_model import Free, Rigid
from spherecal.adjust.problem import NO_LENGTHS, NO_PRIORS, LengthRows, Priors, Problem, sorted_problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.calibrate import calibrate
from spherecal.data.observations import Observations
from spherecal.data.rig import Calibration
from spherecal.data.session import Placement, Session
from spherecal.geometry.camera import FISHEYE_MARK, N_INTRINSICS, estimated_mask, project
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal.geometry.transform import fit_similarity
from spherecal.steps.settings import CalibrationSettings
from spherecal_files.lock import locked
from spherecal_sim.observe import look, observe
from spherecal_sim.rigs import look_at
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions, Truth
from tests import reference_engine


def lengths_between(first: IntArray, second: IntArray, length: FloatArray, sigma: FloatArray) -> LengthRows:
    """Independent distances between pairs of points, (m,) indices, with standard uncertainties (m,)."""
    ends = np.column_stack([first, second])
    return LengthRows(ends, np.broadcast_to([-1.0, 1.0], ends.shape), length, np.diag(np.square(sigma)))


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    """Small dense matrices: more threads of BLAS only wait for each other, four times as long on a busy machine."""
    with threadpool_limits(1, user_api="blas"):
        yield


Intrinsics = Literal["own", "shared", "partly", "all", "fixed"]


@dataclass(frozen=True)
class Small:
    """A problem, the true values of its unknowns and its perfect observations (n, 2)."""

    problem: Problem
    truth: State
    perfect_uv: FloatArray


def small_network(
    *,
    rigid: bool = False,
    intrinsics: Intrinsics = "own",
    n_cameras: int = 5,
    n_points: int = 24,
    locked: tuple[int, ...] = (),
    lengths: int = 0,
    priors: bool = False,
    sigma: bool = False,
    noise_px: float = 0.05,
    seed: int = 0,
    fisheye: tuple[int, ...] = (),
) -> Small:
    """Cameras on a dome that look at points in its middle, a third of the views missing; observations with noise."""
    rng = np.random.default_rng(seed)
    truth = _true_state(rng, n_cameras, n_points, rigid)
    for c in fisheye:
        truth.intrinsics[c, 4:] = np.r_[0.03, -0.01, 0.004, -0.001, np.zeros(7), FISHEYE_MARK]
    camera, point, placement = _views(rng, n_cameras, n_points, 3 if rigid else 1)
    order = np.lexsort((placement, camera, point))
    camera, point, placement = camera[order], point[order], placement[order]
    x = truth.points[point]
    if rigid:
        x = np.einsum("nij,nj->ni", truth.placement_rotation[placement], x) + truth.placement_translation[placement]
    in_camera = np.einsum("nij,nj->ni", truth.rotation[camera], x) + truth.translation[camera]
    assert (in_camera[:, 2] > 0).all()
    perfect = project(in_camera, truth.intrinsics[camera])
    free_pose = np.ones(n_cameras, dtype=bool)
    free_pose[list(locked)] = False
    free, group = _what_is_estimated(intrinsics, n_cameras)
    free[list(fisheye)] &= estimated_mask("fisheye")
    if intrinsics == "shared":
        truth.intrinsics[:] = truth.intrinsics[0]
        perfect = project(in_camera, truth.intrinsics[camera])
    elif intrinsics == "partly":
        truth.intrinsics[group == group[-1]] = truth.intrinsics[-1]
        perfect = project(in_camera, truth.intrinsics[camera])
    rows = NO_LENGTHS
    if lengths:
        first, second = np.arange(lengths), np.arange(lengths) + n_points // 2
        true = np.linalg.norm(truth.points[second] - truth.points[first], axis=1)
        rows = lengths_between(first, second, true, rng.uniform(0.01, 0.05, lengths))
    known = NO_PRIORS
    if priors:
        wide = np.where(rng.random((n_cameras, N_INTRINSICS)) < 0.5, 5.0, np.inf)
        known = Priors(truth.intrinsics + rng.normal(0, 0.01, truth.intrinsics.shape), wide)
    problem, again = sorted_problem(
        camera,
        point,
        perfect + noise_px * rng.normal(size=perfect.shape),
        rng.uniform(0.02, 0.2, perfect.shape) if sigma else None,
        n_points,
        free_pose=free_pose,
        free_intrinsics=free,
        group=group,
        ball=Rigid(placement, np.ones(3, dtype=bool)) if rigid else Free(),
        lengths=rows,
        priors=known,
    )
    return Small(problem, truth, perfect[again])


def _true_state(rng: np.random.Generator, n_cameras: int, n_points: int, rigid: bool) -> State:
    rotation, translation = np.empty((n_cameras, 3, 3)), np.empty((n_cameras, 3))
    for c in range(n_cameras):
        azimuth, height = 2 * np.pi * c / n_cameras + 0.3 * rng.random(), rng.uniform(0.3, 0.9)
        rim = np.sqrt(1 - height**2)
        place = rng.uniform(900, 1200) * np.array([rim * np.cos(azimuth), rim * np.sin(azimuth), height])
        # aims and rolls that differ: cameras alike around one point hardly determine their focal lengths
        rotation[c] = look_at(place, rng.normal(0, 120, 3), rng.normal(size=3))
        translation[c] = -rotation[c] @ place
    intrinsics = np.zeros((n_cameras, N_INTRINSICS))
    intrinsics[:, :2] = rng.uniform(1400, 1600, (n_cameras, 2))
    intrinsics[:, 2:4] = rng.normal([640, 512], 10, (n_cameras, 2))
    intrinsics[:, 4:] = rng.normal(0, 0.02, (n_cameras, 12))
    intrinsics[:, [6, 7, 12, 13, 14, 15]] *= 0.02
    direction = rng.normal(size=(n_points, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = 420.0 * np.cbrt(rng.random((n_points, 1))) * direction  # fills the images: weaker ones do not determine k3
    if not rigid:
        return State(rotation, translation, intrinsics, points)
    turns = exp_rotation(rng.normal(0, 1, (3, 3)))
    return State(rotation, translation, intrinsics, points * 0.6, turns, rng.uniform(-120, 120, (3, 3)))


def _views(
    rng: np.random.Generator, n_cameras: int, n_points: int, n_placements: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Camera, point and placement of every view: two thirds of all, each point twice at least in each placement."""
    seen = rng.random((n_placements, n_points, n_cameras)) < 2 / 3
    for t in range(n_placements):
        for p in range(n_points):
            seen[t, p, rng.permutation(n_cameras)[:2]] = True
    placement, point, camera = np.nonzero(seen)
    return camera, point, placement


def _what_is_estimated(intrinsics: Intrinsics, n_cameras: int) -> tuple[np.ndarray, IntArray]:
    """Masks (c, 16) and groups (c,)."""
    group = np.arange(n_cameras)
    free = np.tile(estimated_mask("brown"), (n_cameras, 1))
    if intrinsics == "shared":
        group = np.zeros(n_cameras, dtype=np.int64)
    elif intrinsics == "all":
        free[:] = True
    elif intrinsics == "fixed":
        free[:] = False
    elif intrinsics == "partly":  # nothing, the focal lengths, two cameras that share, the rest on their own
        free[0] = False
        free[1, 2:] = False
        group[-2:] = group[-1]
        free[-2:, 6:] = False
        free[-1, :] = free[-2, :]
    return free, group


def perturbed(problem: Problem, truth: State, size: float = 1.0, seed: int = 1) -> State:
    """A start near the truth: locked poses and fixed intrinsics keep their values, shared ones stay equal."""
    rng = np.random.default_rng(seed)
    c = problem.n_cameras
    free = problem.free_pose[:, None]
    turn = exp_rotation(0.01 * size * rng.normal(size=(c, 3)) * free)
    shift = 10.0 * size * rng.normal(size=(c, 3)) * free
    by_group = rng.normal(size=(int(problem.group.max()) + 1, N_INTRINSICS))[problem.group]
    step = np.array([15.0, 15.0, 10.0, 10.0, 0.01, 0.01, 1e-4, 1e-4, 0.01] + 7 * [0.0])
    moved = replace(
        truth,
        rotation=turn @ truth.rotation,
        translation=np.einsum("cij,cj->ci", turn, truth.translation) + shift,
        intrinsics=truth.intrinsics + size * step * by_group * problem.free_intrinsics,
        points=truth.points + 5.0 * size * rng.normal(size=truth.points.shape),
    )
    if not len(truth.placement_rotation):
        return moved
    return replace(
        moved,
        placement_rotation=exp_rotation(0.01 * size * rng.normal(size=(3, 3))) @ truth.placement_rotation,
        placement_translation=truth.placement_translation + 5.0 * size * rng.normal(size=(3, 3)),
    )


@dataclass(frozen=True)
class Dense:
    """All equations of a problem as one matrix: every unknown has a column, the eliminated points the last ones.

    `jacobian` (rows, d + 3 p), `residual` (rows,), `point_column` (p,) first column of each point, `reduced` d.
    """

    jacobian: FloatArray
    residual: FloatArray
    point_column: IntArray
    reduced: int


def dense_equations(problem: Problem, state: State, robust_weight: FloatArray | None = None) -> Dense:
    """The weighted equations written out row by row, for comparison with what the engines do block by block."""
    linear = reference_engine.linearise(problem, state, robust_weight)
    pose, intrinsic, after = _camera_columns(problem)
    placement = after + 6 * np.arange(problem.n_placements)
    after += 6 * problem.n_placements
    kept = problem.kept_points
    point_column = np.full(problem.n_points, -1)
    point_column[kept] = after + 3 * np.arange(len(kept))
    reduced = after + 3 * len(kept)
    rest = np.setdiff1d(np.arange(problem.n_points), kept)
    point_column[rest] = reduced + 3 * np.arange(len(rest))
    rows, right = [], []
    for k in range(len(problem.uv)):
        c, p = problem.camera[k], problem.point[k]
        for e in range(2):
            row = np.zeros(reduced + 3 * len(rest))
            if problem.free_pose[c]:
                row[pose[c] : pose[c] + 6] = linear.by_camera[k, e, :6]
            for i, name in enumerate(problem.intrinsic_columns):
                if problem.free_intrinsics[c, name]:
                    row[intrinsic[int(problem.group[c]), int(name)]] = linear.by_camera[k, e, 6 + i]
            if problem.n_placements:
                first = placement[problem.placement[k]]
                row[first : first + 6] = linear.by_placement[k, e]
            row[point_column[p] : point_column[p] + 3] = linear.by_point[k, e]
            rows.append(row)
            right.append(linear.residual[k, e])
    for one, value in (*_prior_rows(problem, state, intrinsic), *_length_rows(problem, state, point_column)):
        row = np.zeros(reduced + 3 * len(rest))
        for column, derivative in one:
            row[column] += derivative
        rows.append(row)
        right.append(value)
    return Dense(np.array(rows), np.array(right), point_column, reduced)


_Row = tuple[list[tuple[int, float]], float]  # columns with their derivatives, and the residual


def _prior_rows(problem: Problem, state: State, intrinsic: dict[tuple[int, int], int]) -> Iterator[_Row]:
    """One row for each number that is estimated and known of: that of its first camera, where several share it."""
    if not len(problem.priors.sigma):
        return
    for (group, name), column in intrinsic.items():
        c = int(np.flatnonzero((problem.group == group) & problem.free_intrinsics[:, name])[0])
        sd = problem.priors.sigma[c, name]
        if np.isfinite(sd):
            yield [(column, 1 / sd)], (state.intrinsics[c, name] - problem.priors.value[c, name]) / sd


def _length_rows(problem: Problem, state: State, point_column: IntArray) -> Iterator[_Row]:
    if not problem.has_lengths:
        return
    of = problem.lengths
    spread = np.sqrt(of.covariance.diagonal())
    for points, coefficient, length, sd in zip(of.points, of.coefficient, of.length, spread, strict=True):
        difference = coefficient @ state.points[points]
        size = float(np.linalg.norm(difference))
        along: FloatArray = difference / size / sd
        ends = list(zip(points, coefficient, strict=True))
        yield [(int(point_column[p]) + i, k * along[i]) for p, k in ends for i in range(3)], (size - length) / sd


def _camera_columns(problem: Problem) -> tuple[dict[int, int], dict[tuple[int, int], int], int]:
    """First column of each free pose, column of each (group, intrinsic), and the next column."""
    pose: dict[int, int] = {}
    intrinsic: dict[tuple[int, int], int] = {}
    column = 0
    for c in range(problem.n_cameras):
        if problem.free_pose[c]:
            pose[c] = column
            column += 6
        for name in np.flatnonzero(problem.free_intrinsics[c]):
            if (int(problem.group[c]), int(name)) not in intrinsic:
                intrinsic[int(problem.group[c]), int(name)] = column
                column += 1
    return pose, intrinsic, column


T = TypeVar("T")

# Environment variable with the folder that all workers of a run share (set by tests/conftest.py).
SHARED_FOLDER = "SPHERECAL_TESTS_SHARED"

_simulated: dict[str, tuple[Session, Truth]] = {}
_calibrated: dict[str, Calibration] = {}


def computed_once(key: str, compute: Callable[[], T]) -> T:
    """What `compute()` returns, computed by one worker of a run and unpickled by the others; nobody may change it.

    Parameters
    ----------
    key
        Everything that the result depends on, as text.
    compute
        Computes the result, which can be pickled.
    """
    folder = os.environ.get(SHARED_FOLDER)
    if folder is None:
        return compute()
    file = Path(folder) / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.pickle"
    with locked(file.with_suffix(""), 1800.0):  # while one computes, the others wait for the result
        if not file.is_file():
            result = compute()
            file.with_suffix(".part").write_bytes(pickle.dumps(result, pickle.HIGHEST_PROTOCOL))
            file.with_suffix(".part").replace(file)
            return result
    return pickle.loads(file.read_bytes())


def simulated(preset: str, seed: int = 1, **options: object) -> tuple[Session, Truth]:
    """A simulated session without bar poses unless asked for; made once in a run of the tests."""
    chosen = SimulationOptions(**{"targets": 100, "bar_poses": 0, **options})  # type: ignore[arg-type]
    key = repr((preset, seed, chosen))
    if key not in _simulated:
        _simulated[key] = simulate_session(preset, seed, chosen)
    return _simulated[key]


def calibrated(
    preset: str, seed: int = 1, settings: CalibrationSettings | None = None, **options: object
) -> tuple[Calibration, Session, Truth]:
    """The calibration of such a session, computed once in a run of the tests by all workers together.

    Nobody may change it.

    Parameters
    ----------
    preset, seed, options
        As of `simulated`.
    settings
        How to calibrate, without a ball profile; None for the defaults.
    """
    session, truth = simulated(preset, seed, **options)
    key = repr((preset, seed, truth.options, settings))
    if key not in _calibrated:
        _calibrated[key] = computed_once(key, lambda: calibrate(session, settings))
    return _calibrated[key], session, truth


def observed(session: Session) -> Observations:
    assert session.observations is not None
    return session.observations


def with_observations(session: Session, keep: np.ndarray | None = None, uv: FloatArray | None = None) -> Session:
    """The session with some of its observations, or with others' image points."""
    o = observed(session)
    o = o if uv is None else replace(o, uv=uv)
    return replace(session, observations=o if keep is None else o.select(keep))


def codes(calibration: Calibration) -> set[str]:
    """The codes of its findings."""
    return {finding.code for finding in calibration.rig.quality.findings}


@dataclass(frozen=True)
class Errors:
    """A calibration against the truth, both in the datum of the points (see `errors_of`)."""

    centre_mm: FloatArray
    rotation_deg: FloatArray
    points_mm: FloatArray
    scale: float
    centre_score: FloatArray
    rotation_score: FloatArray
    focal_score: FloatArray
    point_score: FloatArray


def errors_of(calibration: Calibration, truth: Truth) -> Errors:
    """Found minus true, after the similarity that lays the true points over the found ones.

    That similarity is the datum of the stated uncertainties: scores are errors over them. Only the ball's points count.
    """
    features, found = calibration.features, calibration.points_mm
    known = np.flatnonzero(np.isfinite(found[:, 0]) & (features.placement < len(truth.placements)))
    index = {
        (int(t), truth.ball.points[p]): i
        for i, (t, p) in enumerate(zip(truth.ball.dot_target, truth.ball.dot_point, strict=True))
    }
    names = calibration.observations.points
    true = np.array(
        [
            truth.points_mm(int(features.placement[i]))[index[int(features.target[i]), names[features.point[i]]]]
            for i in known
        ]
    )
    datum = fit_similarity(true, found[known])
    cameras = {c.id: c for c in truth.cameras}
    centre, turn, focal = [], [], []
    for c in calibration.rig.cameras:
        assert c.sigma is not None
        centre.append(c.centre_mm - datum.apply(cameras[c.id].centre_mm[None])[0])
        turn.append(np.rad2deg(log_rotation(c.rotation @ datum.rotation @ cameras[c.id].rotation.T)))
        focal.append(c.intrinsics[0] - cameras[c.id].intrinsics[0])
    sigmas = [c.sigma for c in calibration.rig.cameras if c.sigma is not None]
    points = found[known] - datum.apply(true)
    return Errors(
        np.array(centre),
        np.array(turn),
        points,
        datum.scale,
        np.array(centre) / np.array([s.centre_mm for s in sigmas]),
        np.array(turn) / np.array([s.rotation_deg for s in sigmas]),
        np.array(focal) / np.array([s.intrinsics[0] for s in sigmas]),
        points / calibration.points_sigma_mm[known],
    )


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def session_of_points(preset: str, places: FloatArray, noise_px: float = 0.04, seed: int = 1) -> tuple[Session, Truth]:
    """A preset's cameras looking at points (placements, m, 3) of one's own choice; every point is a target's dot A.

    The session has no scale, sphere or target set.
    """
    session, truth = simulated(preset, seed)
    view = look(truth.cameras)
    rng = np.random.default_rng(seed)
    parts = [observe(view, points, None) for points in places]
    placement = np.concatenate([np.full(len(part.camera), t) for t, part in enumerate(parts)])
    uv = np.concatenate([part.uv for part in parts])
    point = np.concatenate([part.point for part in parts])
    observations = Observations(
        tuple(f"P{t + 1}" for t in range(len(places))),
        tuple(c.id for c in session.cameras),
        ("A",),
        placement,
        np.concatenate([part.camera for part in parts]),
        point + 1,
        np.zeros_like(point),
        np.clip(uv + noise_px * rng.normal(size=uv.shape), -0.49, None),
    )
    return (
        replace(
            session,
            placements=tuple(Placement(name) for name in observations.placements),
            observations=observations,
            bar_poses=(),
            bars=(),
            scale=None,
            target_set=None,
            sphere_diameter_mm=None,
        ),
        truth,
    )


@pytest.fixture
def unstrained(monkeypatch: pytest.MonkeyPatch) -> None:
    """Uncertainties but for what a ball may be strained by in space, which every one holds: simulated balls are not."""
    monkeypatch.setattr(corrections, "strain_variance", lambda *_: np.zeros((5, 5)))
