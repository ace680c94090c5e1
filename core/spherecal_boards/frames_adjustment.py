"""What the adjustments of boards and bars share: their outcome, the robust steps, gates, and who gets a prior."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spherecal.adjust.bundle import CAUCHY_PX, GATE_LEAST_PX, GATE_SIGMAS
from spherecal.adjust.datum import moved_cameras, moved_points
from spherecal.adjust.intrinsic_priors import LEAST_NOISE, LEAST_OBSERVATIONS, WORST_RELATIVE_FOCAL_SD, prior_sigmas
from spherecal.adjust.levenberg import Minimum, Settings
from spherecal.adjust.parameter_layout import POSE, symmetric
from spherecal.adjust.problem import NO_PRIORS, Priors, Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.threads import one_blas_thread
from spherecal.geometry.camera import project
from spherecal_boards.frame_network import FrameModel, ReducedFrames, dense_couplings, minimise, reduce, sum_by

# Numbers of a dense block of points' derivatives: 16 MB.
_BLOCK = 2_000_000


@dataclass(frozen=True)
class PointRows:
    """Points as functions of their frames: frame (p,), place (p,3), derivatives (p,3,q), who defines the datum (p,)."""

    frame: IntArray
    place: FloatArray
    by_frame: FloatArray
    in_datum: np.ndarray


@dataclass(frozen=True)
class FrameCovariance:
    """Cofactors of cameras (c,w,w), points (p,3,3) and all cameras (c*w,c*w), each without the scale's share.

    `relative_scale`: root of its cofactor; `stretch` (c*w,): change of the parameters when the whole grows by 1.
    """

    cameras: FloatArray
    points: FloatArray
    relative_scale: float
    all_cameras: FloatArray
    stretch: FloatArray


def frame_covariance(model: FrameModel, state: State, points: PointRows) -> FrameCovariance | None:
    """Cofactors at the minimum, for a standard deviation of unit weight of 1; None where the network is singular."""
    with one_blas_thread():
        found = frame_factors(model, state)
        return None if found is None else _transformed(model, state, points, *found)


def frame_factors(model: FrameModel, state: State) -> tuple[ReducedFrames, FloatArray] | None:
    """The reduced equations and cofactors (e,e) of the cameras' columns, the reference's pose fixed; or None."""
    try:
        normal = reduce(model, state, model.linearise(state, None), 0.0)
        inverse = _inverse(symmetric(normal.matrix))
    except (LinAlgError, np.linalg.LinAlgError):
        return None
    layout = model.problem.layout
    return normal, layout.expanded_rows(layout.expanded_rows(inverse).T)


def _inverse(matrix: FloatArray) -> FloatArray:
    if not len(matrix):
        return matrix
    diagonal = matrix.diagonal()
    if not (np.isfinite(matrix).all() and (diagonal > 0).all()):
        raise LinAlgError
    scale = 1.0 / np.sqrt(diagonal)
    factor = cho_factor(matrix * scale[:, None] * scale)
    # below this the reduced system's digits are all lost to cancellation
    if np.abs(np.diag(factor[0])).min() < 1e-9:
        raise LinAlgError
    return cho_solve(factor, np.eye(len(matrix))) * scale[:, None] * scale


def _transformed(
    model: FrameModel, state: State, points: PointRows, normal: ReducedFrames, inverse: FloatArray
) -> FrameCovariance:
    motions, camera_motions, spread = _motions(model, state, points)
    moments = np.linalg.inv(np.einsum("pig,pih->gh", motions[points.in_datum], motions[points.in_datum]))
    within = np.where(points.in_datum[:, None, None], motions.transpose(0, 2, 1) @ points.by_frame, 0.0)
    pull_frames = sum_by(points.frame, within, model.n_frames)  # (f,7,q)
    noise = np.einsum("fgq,fqr,fhr->gh", pull_frames, normal.inverse, pull_frames)
    gauge_rows = np.zeros((7, len(inverse)))
    order = np.argsort(points.frame, kind="stable")
    bounds = points.frame[order]
    covariance = np.zeros((len(points.place), 3, 3))
    moved = motions @ moments  # G M (p,3,7)
    for first, dense in dense_couplings(normal, model.problem.n_cameras):
        block = slice(first, first + len(dense))
        shift = -normal.inverse[block] @ dense  # K (b,q,e)
        gauge_rows += np.einsum("bgq,bqe->ge", pull_frames[block], shift)
    at_once = max(1, _BLOCK // (normal.inverse.shape[1] * max(len(inverse), 1)))
    for first, dense in dense_couplings(normal, model.problem.n_cameras):
        begin, end = np.searchsorted(bounds, [first, first + len(dense)])
        for start in range(begin, end, at_once):
            own = order[start : min(start + at_once, end)]
            frame = points.frame[own]
            through = points.by_frame[own] @ normal.inverse[frame]
            by_camera = -through @ dense[frame - first] - moved[own] @ gauge_rows
            mixed = through @ pull_frames[frame].transpose(0, 2, 1) @ moved[own].transpose(0, 2, 1)
            covariance[own] = (by_camera @ inverse) @ by_camera.transpose(0, 2, 1)
            covariance[own] += through @ points.by_frame[own].transpose(0, 2, 1) - mixed - mixed.transpose(0, 2, 1)
    covariance += moved @ noise @ moved.transpose(0, 2, 1)
    similarity = moments @ (gauge_rows @ inverse @ gauge_rows.T + noise) @ moments
    gauge_weights = camera_motions @ moments  # B C B' + G M N M G', B = 1 - G M A, (e,e)
    mixed = inverse @ gauge_rows.T @ gauge_weights.T
    noisy = gauge_rows @ inverse @ gauge_rows.T + noise
    cameras = inverse - mixed - mixed.T + gauge_weights @ noisy @ gauge_weights.T
    width = len(cameras) // model.problem.n_cameras
    own = np.array([cameras[c : c + width, c : c + width] for c in range(0, len(cameras), width)])
    relative = float(np.sqrt(similarity[6, 6])) / spread
    return FrameCovariance(own, covariance, relative, cameras, camera_motions[:, 6] * spread)


def _motions(model: FrameModel, state: State, points: PointRows) -> tuple[FloatArray, FloatArray, float]:
    """Shifts, turns and stretch of points (p,3,7) and cameras (e,7) about the points' centroid, and their spread."""
    centroid = points.place[points.in_datum].mean(axis=0)
    offset = points.place - centroid
    spread = float(np.sqrt((offset[points.in_datum] ** 2).sum(axis=1).mean()))
    of_points = moved_points(points.place, centroid, spread)
    return of_points, moved_cameras(model.problem, state, centroid, spread), spread


# One view of a plane board leaves the focal length open.
_LEAST_FRAMES = 2


def priors_of(group: IntArray, known: FloatArray, has_prior: BoolArray, noise: float) -> Priors:
    """Priors (c,16) of the groups of cameras that need one, weighed as both scatter; or NO_PRIORS."""
    if not has_prior.any():
        return NO_PRIORS
    members = np.isin(group, group[has_prior])
    sigma = prior_sigmas(known) / max(noise, LEAST_NOISE)
    return Priors(known, np.where(members[:, None], sigma, np.inf))


def poorly_observed(group: IntArray, free: BoolArray, camera: IntArray, frame: IntArray) -> BoolArray:
    """Cameras (c,) whose group has too few observations, or frames, to estimate intrinsics."""
    count = int(group.max()) + 1
    observations = np.bincount(group[camera], minlength=count)
    seen = np.unique(np.stack([group[camera], frame]), axis=1)
    frames = np.bincount(seen[0], minlength=count)
    few = (observations < LEAST_OBSERVATIONS) | (frames < _LEAST_FRAMES)
    return free.any(axis=1) & few[group]


def poorly_determined(problem: Problem, state: State, covariance: FrameCovariance | None, variance: float) -> BoolArray:
    """Cameras (c,) whose focal length is less certain than a data sheet's; all free ones where all is singular."""
    columns = problem.intrinsic_columns
    if not len(columns) or columns[0] != 0:
        return np.zeros(problem.n_cameras, dtype=bool)
    if covariance is None:
        return problem.free_intrinsics[:, 0]
    sd = np.sqrt(np.maximum(variance * covariance.cameras[:, POSE, POSE], 0.0))
    return problem.free_intrinsics[:, 0] & (sd > WORST_RELATIVE_FOCAL_SD * state.intrinsics[:, 0])


START_ITERATIONS = 60


@dataclass(frozen=True)
class Adjusted:
    """An adjusted network: state, model, used (n,), observation of each row; `joint` False: cameras as chained."""

    state: State
    model: FrameModel
    used: BoolArray
    minimum: Minimum
    redundancy: int
    covariance: FrameCovariance | None
    has_prior: BoolArray
    joint: bool = True
    rows: IntArray = field(kw_only=True)

    @property
    def variance(self) -> float:
        """The square of sigma0; NaN without redundancy."""
        return 2 * self.minimum.cost / self.redundancy if self.redundancy > 0 else float("nan")

    @property
    def sigma0(self) -> float:
        """The standard deviation of unit weight; 1 without redundancy."""
        return float(np.sqrt(self.variance)) if self.redundancy > 0 else 1.0


A = TypeVar("A", bound=Adjusted)


def with_priors(
    refine: Callable[[A | None, Priors], A], group: IntArray, known: FloatArray, free: BoolArray, has_prior: BoolArray
) -> A:
    """The network refined until intrinsics left open have a prior, `known`, weighed with the noise found."""
    adjusted, noise_known = refine(None, priors_of(group, known, has_prior, 1.0)), False
    for _ in range(1 + len(group)):
        weak = poorly_determined(adjusted.model.problem, adjusted.state, adjusted.covariance, adjusted.variance)
        more = has_prior | weak
        if not more.any() or ((more == has_prior).all() and noise_known):
            break
        has_prior = more
        adjusted, noise_known = refine(adjusted, priors_of(group, known, has_prior, adjusted.sigma0)), True
    return replace(adjusted, has_prior=has_prior & free.any(axis=1))


def robust_steps(model: FrameModel, state: State, context: Context) -> State:
    """The state after least squares with Cauchy's loss, first in units of the typical residual where that is larger."""
    typical = float(np.median(np.linalg.norm(model.residuals(state), axis=1)))
    for cauchy in (typical, CAUCHY_PX) if typical > CAUCHY_PX else (CAUCHY_PX,):
        watch = progress(context, "robust adjustment", START_ITERATIONS)
        settings = Settings(cauchy=cauchy, max_iterations=START_ITERATIONS, tolerance=1e-4)
        state = minimise(model, state, settings, watch).state
    return state


def within_gate(size: FloatArray, camera: IntArray, used: BoolArray, n_cameras: int) -> BoolArray:
    """Observations (n,) whose residual is within 4.5 robust standard deviations of its camera's, at least 0.15 px.

    Of a camera of which none is used only what is within 0.15 px (docs/formulation.md, section Adjustment).
    """
    return size <= gates_px(size, camera, used, n_cameras)[camera]


def gates_px(size: FloatArray, camera: IntArray, used: BoolArray, n_cameras: int) -> FloatArray:
    """The gate (c,) px of each camera, by the residuals of its used observations (n,)."""
    limit = np.full(n_cameras, GATE_LEAST_PX)
    for c in np.unique(camera[used]):
        noise = float(np.median(size[used & (camera == c)])) / 1.1774  # Rayleigh's median
        limit[c] = max(GATE_SIGMAS * noise, GATE_LEAST_PX)
    return limit


def camera_residuals(state: State, world: FloatArray, camera: IntArray, uv: FloatArray) -> FloatArray:
    """Predicted minus observed (n,2) px of points (n,3) in the world; NaN without a prediction before the camera."""
    x = np.einsum("nij,nj->ni", state.rotation[camera], world) + state.translation[camera]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        residual = project(x, state.intrinsics[camera]) - uv
        return np.where(x[:, 2:3] > 0, residual, np.nan)


def sizes(residuals: FloatArray) -> FloatArray:
    """Lengths (n,) px of residuals (n,2), infinite where there is no prediction in front of the camera."""
    size = np.linalg.norm(residuals, axis=1)
    return np.where(np.isfinite(size), size, np.inf)


def progress(context: Context, stage: str, expected: int) -> Callable[[int, float], None]:
    """A function that reports a minimiser's steps; after half of the `expected` ones the stage counts as half done."""

    def on_step(iteration: int, cost: float) -> None:
        context.report_iteration(stage, iteration / (iteration + expected / 2), iteration, cost)

    return on_step
