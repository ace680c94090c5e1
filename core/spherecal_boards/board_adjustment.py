"""The joint adjustment of cameras and board placements: robust first, then gate and plain least squares in turns."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.ball_model import Rigid
from spherecal.adjust.bundle import CAUCHY_PX, GATE_LEAST_PX, GATE_ROUNDS, GATE_SIGMAS, START_INTRINSICS
from spherecal.adjust.levenberg import Minimum, Settings
from spherecal.adjust.problem import sorted_problem
from spherecal.adjust.rows import NO_PRIORS, Priors
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.geometry.camera import INTRINSIC_NAMES, project
from spherecal_boards.board_model import BoardModel, BoardViews
from spherecal_boards.board_start import LEAST_POINTS, BoardPose
from spherecal_boards.frames import cameras_only, minimise, redundancy
from spherecal_boards.frames_covariance import FrameCovariance, frame_covariance
from spherecal_boards.intrinsic_priors import poorly_determined, poorly_observed, priors_of

START_ITERATIONS = 60
ViewPoses = dict[tuple[int, int], list[BoardPose]]


@dataclass(frozen=True)
class BoardNetwork:
    """What a joint adjustment works on: views, intrinsics to estimate (c,16), who shares them (c,), known ones (c,16).

    `reference` is the camera whose pose is fixed.
    """

    views: BoardViews
    free: BoolArray
    group: IntArray
    known: FloatArray
    reference: int


@dataclass(frozen=True)
class BoardAdjusted:
    """An adjusted network: state, model, rows (observation of each row), used (n,), who has a prior (c,).

    `noise_known`: the priors are weighed by the sigma0 of an adjustment. `joint` False: cameras are as they were
    chained.
    """

    state: State
    model: BoardModel
    rows: IntArray
    used: BoolArray
    minimum: Minimum
    redundancy: int
    covariance: FrameCovariance | None
    has_prior: BoolArray
    noise_known: bool = False
    joint: bool = True

    @property
    def variance(self) -> float:
        """The square of sigma0; NaN without redundancy."""
        return 2 * self.minimum.cost / self.redundancy if self.redundancy > 0 else float("nan")

    @property
    def sigma0(self) -> float:
        """The standard deviation of unit weight; 1 without redundancy."""
        return float(np.sqrt(self.variance)) if self.redundancy > 0 else 1.0


def place_boards(views: BoardViews, found: ViewPoses, state: State, cameras: BoolArray) -> State:
    """The state with a pose of each placement that placed cameras see: the one of their poses that fits all best.

    NaN where no camera with a pose sees the board.

    `cameras`: cameras that have a pose, (c,).
    """
    rotation = np.full((views.n_placements, 3, 3), np.nan)
    translation = np.full((views.n_placements, 3), np.nan)
    by_placement: dict[int, list[tuple[int, list[BoardPose]]]] = {}
    for (camera, placement), poses in found.items():
        if cameras[camera]:
            by_placement.setdefault(placement, []).append((camera, poses))
    for placement, seen in by_placement.items():
        best = np.inf
        for camera, poses in seen:
            for pose in poses:
                r = state.rotation[camera].T @ pose.rotation
                t = state.rotation[camera].T @ (pose.translation - state.translation[camera])
                cost = sum(min(view_error(views, state, c, placement, r, t), 1e3) for c, _ in seen)
                if cost < best:
                    best, rotation[placement], translation[placement] = cost, r, t
    return replace(state, placement_rotation=rotation, placement_translation=translation)


def view_error(
    views: BoardViews, state: State, camera: int, placement: int, rotation: FloatArray, translation: FloatArray
) -> float:
    """Median distance in px of a view's points from those predicted for a pose of the board; infinite behind.

    `rotation`, `translation`: pose of the board in the world, (3,3) and (3,) mm.
    """
    rows = views.of(camera, placement)
    world = views.points_mm[views.point[rows]] @ rotation.T + translation
    x = world @ state.rotation[camera].T + state.translation[camera]
    if (x[:, 2] <= 0).any():
        return np.inf
    off = project(x, state.intrinsics[camera]) - views.uv[rows]
    return float(np.median(np.linalg.norm(off, axis=1)))


def robust_start(network: BoardNetwork, state: State, candidates: BoolArray, context: Context) -> State:
    """A state after robust adjustments: poses, then the main intrinsics, then all.

    Cauchy's loss, every observation with the same weight (docs/formulation.md, section Adjustment).

    `candidates`: observations that take part, (n,).
    """
    for names in ((), START_INTRINSICS, None):
        free = network.free if names is None else network.free & np.isin(INTRINSIC_NAMES, names)
        model, _ = _model(network, candidates, free, NO_PRIORS, False)
        typical = float(np.median(np.linalg.norm(model.residuals(state), axis=1)))
        for cauchy in (typical, CAUCHY_PX) if typical > CAUCHY_PX else (CAUCHY_PX,):
            watch = progress(context, "robust adjustment", START_ITERATIONS)
            settings = Settings(cauchy=cauchy, max_iterations=START_ITERATIONS, tolerance=1e-4)
            state = minimise(model, state, settings, watch).state
    return state


def adjust_boards(
    network: BoardNetwork, start: State, first: BoolArray, candidates: BoolArray, context: Context
) -> BoardAdjusted:
    """The least-squares network from a start, with covariance; intrinsics that the data do not determine get a prior.

    `first`: observations of the robust start, (n,); `candidates`: observations of which all that agree take part in the
    end, (n,).
    """
    state = robust_start(network, start, first, context)
    group, views = network.group, network.views
    has_prior = poorly_observed(group, network.free, views.camera[candidates], views.placement[candidates])
    priors = priors_of(group, network.known, has_prior, 1.0)
    adjusted = _refine(network, state, candidates, priors, has_prior, context)
    for _ in range(1 + views.n_cameras):
        weak = poorly_determined(adjusted.model.problem, adjusted.state, adjusted.covariance, adjusted.variance)
        again = has_prior | weak
        if not again.any() or ((again == has_prior).all() and adjusted.noise_known):
            break
        # again with the noise that only the adjustment tells
        noise, has_prior = adjusted.sigma0, again
        priors = priors_of(group, network.known, has_prior, noise)
        adjusted = _refine(network, adjusted.state, candidates, priors, has_prior, context)
        adjusted = replace(adjusted, noise_known=True)
    return adjusted


def leave_chained(network: BoardNetwork, state: State, candidates: BoolArray, context: Context) -> BoardAdjusted:
    """The cameras as they were chained, the board's placements alone adjusted to them; without covariance.

    `candidates`: observations that may take part, (n,).
    """
    views = network.views
    gated = gate(network, state, candidates)
    nobody = np.zeros(views.n_cameras, dtype=bool)
    model, rows = _model(network, gated, np.zeros_like(network.free), NO_PRIORS, True, free_poses=False)
    minimum = minimise(model, state, Settings(max_iterations=60), progress(context, "joint adjustment", 20))
    return BoardAdjusted(
        minimum.state, model, rows, gated, minimum, redundancy(model, minimum.state), None, nobody, joint=False
    )


def _refine(
    network: BoardNetwork, state: State, candidates: BoolArray, priors: Priors, has_prior: BoolArray, context: Context
) -> BoardAdjusted:
    used, rounds = candidates, 0
    while True:
        rounds += 1
        gated = gate(network, state, candidates)
        model, rows = _model(network, gated, network.free, priors, True)
        minimum = minimise(model, state, Settings(), progress(context, "joint adjustment", 20))
        state = minimum.state
        if (gated == used).all() or rounds == GATE_ROUNDS:
            break
        used = gated
    context.report("uncertainty", 0.0)
    views = network.views
    covariance = frame_covariance(model, state, model.point_rows(state, *board_points(views, gated)))
    return BoardAdjusted(
        state, model, rows, gated, minimum, redundancy(model, state), covariance, has_prior & network.free.any(axis=1)
    )


def board_points(views: BoardViews, used: BoolArray) -> tuple[IntArray, IntArray, BoolArray]:
    """All points of the board at every placement that is used: placement, point, and whether it was seen, (p,) each.

    `views`, `used`: what the cameras see, and which observations are used, (n,).
    """
    count = len(views.points_mm)
    placements = np.unique(views.placement[used])
    seen = np.zeros((views.n_placements, count), dtype=bool)
    seen[views.placement[used], views.point[used]] = True
    return np.repeat(placements, count), np.tile(np.arange(count), len(placements)), seen[placements].ravel()


def _model(
    network: BoardNetwork, used: BoolArray, free: BoolArray, priors: Priors, weighted: bool, free_poses: bool = True
) -> tuple[BoardModel, IntArray]:
    """The adjustment of the used observations, and which observation each of its rows is."""
    views, rows = network.views, np.flatnonzero(used)
    seen = np.bincount(views.camera[rows], minlength=views.n_cameras) > 0
    sigma = views.sigma[rows] if weighted and views.sigma is not None else None
    problem, order = sorted_problem(
        views.camera[rows],
        views.point[rows],
        views.uv[rows],
        sigma,
        len(views.points_mm),
        free_pose=seen & (np.arange(views.n_cameras) != network.reference) & free_poses,
        free_intrinsics=free & seen[:, None],
        group=network.group,
        priors=priors,
        ball=Rigid(views.placement[rows], np.ones(views.n_placements, dtype=bool)),
    )
    return BoardModel(problem, cameras_only(problem)), rows[order]


def residual_size(views: BoardViews, state: State) -> FloatArray:
    """Lengths of the residuals (n,) px, infinite where there is no prediction in front of the camera."""
    return np.where(np.isfinite(r := np.linalg.norm(residuals_px(views, state), axis=1)), r, np.inf)


def residuals_px(views: BoardViews, state: State) -> FloatArray:
    """Predicted minus observed (n,2) px; NaN without a prediction in front of the camera."""
    world = np.einsum("nij,nj->ni", state.placement_rotation[views.placement], state.points[views.point])
    world += state.placement_translation[views.placement]
    x = np.einsum("nij,nj->ni", state.rotation[views.camera], world) + state.translation[views.camera]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        residual = project(x, state.intrinsics[views.camera]) - views.uv
        return np.where(x[:, 2:3] > 0, residual, np.nan)


def gate(network: BoardNetwork, state: State, candidates: BoolArray) -> BoolArray:
    """Candidates (n,) within the gate of their predicted image point, of cameras and placements that keep enough.

    4.5 robust standard deviations of each camera, at least 0.15 px (docs/formulation.md, section Adjustment).
    """
    views = network.views
    size = residual_size(views, state)
    limit = np.zeros(views.n_cameras)
    for c in np.unique(views.camera[candidates]):
        noise = float(np.median(size[candidates & (views.camera == c)])) / 1.1774  # Rayleigh's median
        limit[c] = max(GATE_SIGMAS * noise, GATE_LEAST_PX)
    keep = candidates & (size <= limit[views.camera])
    for index, count in ((views.placement, views.n_placements), (views.camera, views.n_cameras)):
        keep &= (np.bincount(index[keep], minlength=count) >= LEAST_POINTS)[index]
    return keep


def progress(context: Context, stage: str, expected: int) -> Callable[[int, float], None]:
    """A function that reports a minimiser's steps, and stops it when the user asks."""

    def on_step(iteration: int, cost: float) -> None:
        context.report_iteration(stage, iteration / (iteration + expected / 2), iteration, cost)

    return on_step
