"""The joint adjustment of cameras and board placements: robust first, then gate and plain least squares in turns."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.ball_model import Rigid
from spherecal.adjust.bundle import GATE_ROUNDS, START_INTRINSICS
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.problem import NO_PRIORS, Priors, sorted_problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.geometry.camera import INTRINSIC_NAMES, project
from spherecal_boards import frames_adjustment
from spherecal_boards.board_start import LEAST_POINTS, BoardModel, BoardPose, BoardViews
from spherecal_boards.frame_network import cameras_only, minimise, redundancy
from spherecal_boards.frames_adjustment import frame_covariance, poorly_observed

ViewPoses = dict[tuple[int, int], list[BoardPose]]


@dataclass(frozen=True)
class BoardNetwork:
    """Views, intrinsics to estimate (c,16), who shares them (c,), known ones (c,16), the camera whose pose is fixed."""

    views: BoardViews
    free: BoolArray
    group: IntArray
    known: FloatArray
    reference: int


@dataclass(frozen=True)
class BoardAdjusted(frames_adjustment.Adjusted):
    """An adjusted network of a board."""

    model: BoardModel


def place_boards(views: BoardViews, found: ViewPoses, state: State, cameras: BoolArray) -> State:
    """The state with poses of the placements that placed cameras (c,) see, each that which fits all best; or NaN."""
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
    """Median distance in px of a view's points from those predicted for a pose of the board; infinite behind."""
    rows = views.of(camera, placement)
    world = views.points_mm[views.point[rows]] @ rotation.T + translation
    x = world @ state.rotation[camera].T + state.translation[camera]
    if (x[:, 2] <= 0).any():
        return np.inf
    off = project(x, state.intrinsics[camera]) - views.uv[rows]
    return float(np.median(np.linalg.norm(off, axis=1)))


def robust_start(network: BoardNetwork, state: State, candidates: BoolArray, context: Context) -> State:
    """A state after robust adjustments (Cauchy's loss): poses, then the main intrinsics, then all."""
    for names in ((), START_INTRINSICS, None):
        free = network.free if names is None else network.free & np.isin(INTRINSIC_NAMES, names)
        model, _ = _model(network, candidates, free, NO_PRIORS, False)
        state = frames_adjustment.robust_steps(model, state, context)
    return state


def adjust_boards(
    network: BoardNetwork, start: State, first: BoolArray, candidates: BoolArray, context: Context
) -> BoardAdjusted:
    """The least-squares network from a start, with covariance; intrinsics not determined by the data get a prior."""
    state = robust_start(network, start, first, context)
    group, views = network.group, network.views
    has_prior = poorly_observed(group, network.free, views.camera[candidates], views.placement[candidates])

    def refine(last: BoardAdjusted | None, priors: Priors) -> BoardAdjusted:
        return _refine(network, state if last is None else last.state, candidates, priors, context)

    return frames_adjustment.with_priors(refine, group, network.known, network.free, has_prior)


def leave_chained(network: BoardNetwork, state: State, candidates: BoolArray, context: Context) -> BoardAdjusted:
    """The cameras as they were chained, the board's placements alone adjusted to them; without covariance."""
    views = network.views
    gated = gate(network, state, candidates)
    nobody = np.zeros(views.n_cameras, dtype=bool)
    model, rows = _model(network, gated, np.zeros_like(network.free), NO_PRIORS, True, free_poses=False)
    minimum = minimise(
        model, state, Settings(max_iterations=60), frames_adjustment.progress(context, "joint adjustment", 20)
    )
    count = redundancy(model, minimum.state)
    return BoardAdjusted(minimum.state, model, gated, minimum, count, None, nobody, joint=False, rows=rows)


def _refine(
    network: BoardNetwork, state: State, candidates: BoolArray, priors: Priors, context: Context
) -> BoardAdjusted:
    used, rounds = candidates, 0
    while True:
        rounds += 1
        gated = gate(network, state, candidates)
        model, rows = _model(network, gated, network.free, priors, True)
        minimum = minimise(model, state, Settings(), frames_adjustment.progress(context, "joint adjustment", 20))
        state = minimum.state
        if (gated == used).all() or rounds == GATE_ROUNDS:
            break
        used = gated
    context.report("uncertainty", 0.0)
    views = network.views
    covariance = frame_covariance(model, state, model.point_rows(state, *board_points(views, gated)))
    nobody = np.zeros(views.n_cameras, dtype=bool)
    return BoardAdjusted(state, model, gated, minimum, redundancy(model, state), covariance, nobody, rows=rows)


def board_points(views: BoardViews, used: BoolArray) -> tuple[IntArray, IntArray, BoolArray]:
    """All points of the board at every placement that is used: placement, point, and whether it was seen, (p,) each."""
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
    return BoardModel(cameras_only(problem), 1, problem), rows[order]


def residuals_px(views: BoardViews, state: State) -> FloatArray:
    """Predicted minus observed (n,2) px; NaN without a prediction in front of the camera."""
    world = np.einsum("nij,nj->ni", state.placement_rotation[views.placement], state.points[views.point])
    world += state.placement_translation[views.placement]
    return frames_adjustment.camera_residuals(state, world, views.camera, views.uv)


def gate(network: BoardNetwork, state: State, candidates: BoolArray) -> BoolArray:
    """Candidates (n,) within 4.5 robust sd of their camera's, at least 0.15 px, in views with enough of them."""
    views = network.views
    size = frames_adjustment.sizes(residuals_px(views, state))
    keep = candidates & frames_adjustment.within_gate(size, views.camera, candidates, views.n_cameras)
    for index, count in ((views.placement, views.n_placements), (views.camera, views.n_cameras)):
        keep &= (np.bincount(index[keep], minlength=count) >= LEAST_POINTS)[index]
    return keep
