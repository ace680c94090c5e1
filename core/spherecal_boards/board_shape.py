"""Boards that differ from their nominal shape: residuals that repeat for the same points, and estimated points."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Rigid
from spherecal.adjust.bundle import GATE_ROUNDS, datum_defect
from spherecal.adjust.covariance import covariance
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.datum import Places
from spherecal.adjust.least_squares import minimise as minimise_points
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.problem import Priors, Problem, sorted_problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.data.findings import Finding
from spherecal.diagnose.score import make_score_test
from spherecal.geometry.transform import fit_similarity
from spherecal_boards.board_adjustment import BoardAdjusted, BoardNetwork, board_points, gate
from spherecal_boards.board_start import BoardModel
from spherecal_boards.frame_network import cameras_only
from spherecal_boards.frames_adjustment import FrameCovariance, priors_of, progress
from spherecal_boards.frames_evidence import Tested, frame_test

# Shifts of points that noise alone makes up explain their own number's worth of residuals: 1.0 +- 0.1 for 80 points.
# The laser print of the shared recording has 11 in each camera alone.
_REPEATS = 2.0


@dataclass(frozen=True)
class BoardSolution:
    """A board's adjustment with fixed or estimated points, prepared for tests; covariance.points are board_points'."""

    adjusted: BoardAdjusted
    tested: Tested | None
    print_mm: float | None = None
    print_relative: float = 0.0


def nominal_solution(adjusted: BoardAdjusted) -> BoardSolution:
    """The solution with the board's points fixed."""
    done = adjusted.minimum, adjusted.redundancy
    return BoardSolution(adjusted, frame_test(adjusted.model, adjusted.state, *done) if adjusted.joint else None)


def shape_finding(adjusted: BoardAdjusted) -> list[Finding]:
    """A warning where the points' best shifts explain more of the residuals than noise makes of them."""
    rigid = adjusted.model.rigid
    linear = engine.linearise(rigid, adjusted.state, None)
    count = np.bincount(rigid.point, minlength=rigid.n_points)
    normal, gradient = np.zeros((rigid.n_points, 3, 3)), np.zeros((rigid.n_points, 3))
    np.add.at(normal, rigid.point, linear.by_point.transpose(0, 2, 1) @ linear.by_point)
    np.add.at(gradient, rigid.point, np.einsum("nij,ni->nj", linear.by_point, linear.residual))
    often = count >= 3
    if often.sum() < 4 or adjusted.redundancy <= 3 * often.sum():
        return []
    values, vectors = np.linalg.eigh(normal[often])
    along = np.einsum("pij,pi->pj", vectors, gradient[often])
    fixed = values > 1e-4 * values[:, -1:]  # depth that hardly shows is left alone
    explained = np.where(fixed, along**2 / np.where(fixed, values, 1.0), 0.0)
    shift = np.where(fixed, along / np.where(fixed, values, 1.0), 0.0)
    noise = (2 * adjusted.minimum.cost - explained.sum()) / (adjusted.redundancy - fixed.sum())
    ratio = explained.sum() / fixed.sum() / noise
    if ratio < _REPEATS:
        return []
    off = float(np.sqrt((shift[:, 1:] ** 2).sum(axis=1).mean()))  # across the line of sight
    return [Finding("board-shape", "warning", {"off_mm": off})]


def estimated_solution(
    network: BoardNetwork, adjusted: BoardAdjusted, candidates: BoolArray, context: Context
) -> BoardSolution:
    """The solution with the board's points estimated too (mean size nominal), from the one with fixed points."""
    views, nominal = network.views, network.views.points_mm
    noise = adjusted.sigma0
    state, used, rounds = adjusted.state, adjusted.used, 0
    while True:
        rounds += 1
        priors = priors_of(network.group, network.known, adjusted.has_prior, noise)
        problem, rows, seen = _problem(network, used, priors)
        state = _world_is_first_board(state, problem)
        settings = Settings(max_iterations=200)
        minimum = minimise_points(problem, state, settings, progress(context, "points of the board", 40))
        redundancy = problem.rows - problem.unknowns + datum_defect(problem)
        variance = 2 * minimum.cost / redundancy if redundancy > 0 else float("nan")
        state = _metric(minimum.state, nominal, seen, network.reference)
        gated = gate(network, state, candidates & seen[views.point])
        if (gated == used).all() or rounds == GATE_ROUNDS:
            break
        used = gated
        noise = float(np.sqrt(variance)) if np.isfinite(variance) else noise
    context.report("uncertainty", 0.0)
    off = (state.points - nominal)[seen]
    # scale by a similarity over all points: one coordinate of each is off by as much
    per_coordinate = float(np.sqrt((off**2).sum() / max(3 * len(off) - 7, 1)))
    spread = float(np.sqrt(((nominal[seen] - nominal[seen].mean(axis=0)) ** 2).sum()))
    placement, point, _ = board_points(views, used)
    at_first = _world_is_first_board(state, problem)
    cofactors = covariance(problem, at_first, Places(point, placement))
    tested = None
    if cofactors is not None and redundancy > 0:
        tested = Tested(make_score_test(problem, at_first, cofactors, minimum.cost, redundancy), cofactors)
    found = BoardAdjusted(
        replace(state, points=np.where(seen[:, None], state.points, nominal)),
        BoardModel(cameras_only(problem), 1, problem),
        used,
        minimum,
        redundancy,
        _as_frames(cofactors, problem, state, placement, point),
        adjusted.has_prior,
        rows=rows,
    )
    return BoardSolution(found, tested, per_coordinate, per_coordinate / spread)


def _problem(network: BoardNetwork, used: BoolArray, priors: Priors) -> tuple[Problem, IntArray, BoolArray]:
    """All cameras free, the first placement as the world, points seen twice estimated; its rows, and these points."""
    views = network.views
    twice = np.bincount(views.point[used], minlength=len(views.points_mm)) >= 2
    rows = np.flatnonzero(used & twice[views.point])
    seen = np.bincount(views.camera[rows], minlength=views.n_cameras) > 0
    shown = np.bincount(views.placement[rows], minlength=views.n_placements) > 0
    free_placement = shown.copy()
    free_placement[np.argmax(shown)] = False
    problem, order = sorted_problem(
        views.camera[rows],
        views.point[rows],
        views.uv[rows],
        None if views.sigma is None else views.sigma[rows],
        len(views.points_mm),
        free_pose=seen,
        free_intrinsics=network.free & seen[:, None],
        group=network.group,
        priors=priors,
        ball=Rigid(views.placement[rows], free_placement),
    )
    return problem, rows[order], twice


def _world_is_first_board(state: State, problem: Problem) -> State:
    """The same network with the world frame that of the board at its reference placement."""
    shown = np.bincount(problem.placement, minlength=problem.n_placements) > 0
    first = int(np.argmax(shown))
    return _carried(state, state.placement_rotation[first], state.placement_translation[first])


def _metric(state: State, nominal: FloatArray, seen: BoolArray, reference: int) -> State:
    """The network in the reference camera's frame, its board laid over the nominal one by a similarity."""
    state = state.seen_from(reference)
    fit = fit_similarity(state.points[seen], nominal[seen])
    return _carried(state.scaled(fit.scale), fit.rotation, fit.translation)


def _carried(state: State, rotation: FloatArray, translation: FloatArray) -> State:
    """The same network with the board's own frame turned and shifted."""
    points, placements = state.points @ rotation.T + translation, state.placement_rotation @ rotation.T
    shifted = state.placement_translation - placements @ translation
    return replace(state, points=points, placement_rotation=placements, placement_translation=shifted)


def _as_frames(
    cofactors: Covariance | None, problem: Problem, state: State, placement: np.ndarray, point: np.ndarray
) -> FrameCovariance | None:
    """The cofactors as those of frames; the scale's part comes from the print alone."""
    if cofactors is None:
        return None
    places = np.einsum("pij,pj->pi", state.placement_rotation[placement], state.points[point])
    centroid = (places + state.placement_translation[placement]).mean(axis=0)
    width = cofactors.cameras.shape[1]
    stretch = np.zeros((problem.n_cameras, width))
    stretch[:, 3:6] = np.einsum("cij,j->ci", state.rotation, centroid) + state.translation
    return FrameCovariance(cofactors.cameras, cofactors.points, 0.0, cofactors.all_cameras(), stretch.ravel())
