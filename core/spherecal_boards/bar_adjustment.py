"""The joint adjustment of cameras and a waved bar's marks, its lengths as rows: robust, then gate and plain."""

from dataclasses import dataclass, field, replace

import numpy as np

from spherecal.adjust.bundle import GATE_ROUNDS, PAIR_GATES, START_INTRINSICS, usable_features
from spherecal.adjust.levenberg import Minimum, Settings
from spherecal.adjust.network import Network
from spherecal.adjust.problem import sorted_problem
from spherecal.adjust.rows import NO_PRIORS, Priors
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.data.session import Session
from spherecal.geometry.camera import INTRINSIC_NAMES
from spherecal_boards.bar_marks import BarRecording, known_lengths
from spherecal_boards.bar_model import BarModel, Lengths
from spherecal_boards.bar_scatter import length_scatter
from spherecal_boards.board_intrinsic_priors import poorly_observed
from spherecal_boards.frame_network import minimise, redundancy
from spherecal_boards.frames_adjustment import (
    Adjusted,
    camera_residuals,
    gates_px,
    progress,
    robust_steps,
    sizes,
    with_priors,
    within_gate,
)
from spherecal_boards.frames_covariance import frame_covariance

# The bar's own scatter is known when it changes by no more than this share from round to round.
SCATTER_STEADY = 0.02


@dataclass(frozen=True)
class BarNetwork:
    """What the adjustment works on; `network` has the features frame * slots + slot, `known` (c,16) intrinsics."""

    session: Session
    recording: BarRecording
    network: Network
    known: FloatArray
    reference: int
    placed: BoolArray


@dataclass(frozen=True)
class BarAdjusted(Adjusted):
    """An adjusted network of a bar; `covariance` has the cofactors of `points` (p,)."""

    model: BarModel
    points: IntArray = field(kw_only=True)


def adjust_bar(work: BarNetwork, state: State, context: Context) -> BarAdjusted:
    """The least-squares network from a start, with covariance; intrinsics that the data leave open get a prior."""
    network, candidates = work.network, work.placed[work.network.camera]
    state, good = _robust_start(work, state, candidates, context)
    used = candidates & good[network.feature]
    has_prior = poorly_observed(network.group, network.free, network.camera[used], network.feature[used])

    def refine(last: BarAdjusted | None, priors: Priors) -> BarAdjusted:
        if last is None:
            return _refine(work, state, used, priors, _usual_noise(work, state, used), context)
        return _refine(work, last.state, last.used, priors, last.sigma0, context)

    return with_priors(refine, network.group, work.known, network.free, has_prior)


def chain_pairs(work: BarNetwork, state: State, parents: tuple[tuple[int, int], ...], context: Context) -> BarAdjusted:
    """Cameras chained over pairs (parent, camera) in order, each adjusted alone; marks triangulated; no covariance.

    A camera keeps the intrinsics of the pair that placed it.
    """
    start, rotation, translation = state, state.rotation.copy(), state.translation.copy()
    intrinsics = state.intrinsics.copy()
    for parent, camera in parents:
        both = np.isin(np.arange(len(work.placed)), (parent, camera))
        alone = replace(work, placed=both, reference=parent)
        pair = _adjusted_pair(alone, start, context)
        rotation_change = pair.rotation[camera] @ pair.rotation[parent].T
        translation_change = pair.translation[camera] - rotation_change @ pair.translation[parent]
        rotation[camera] = rotation_change @ rotation[parent]
        translation[camera] = rotation_change @ translation[parent] + translation_change
        intrinsics[camera] = pair.intrinsics[camera]
    state = replace(state, rotation=rotation, translation=translation, intrinsics=intrinsics)
    points, good = usable_features(work.network, state, work.placed[work.network.camera])
    state = replace(state, points=np.where(good[:, None], points, np.nan))
    used = work.placed[work.network.camera] & good[work.network.feature]
    used = _gate(work.network, state, work.placed, used)
    seen = work.network.views(used) >= 2
    lengths = known_lengths(work.session, work.recording, seen)
    model, rows = _model(work, used, np.zeros_like(work.network.free), lengths, NO_PRIORS, True)
    whole = replace(state, points=np.where(seen[:, None], state.points, 0.0))
    cost = 0.5 * float((model.residuals(whole) ** 2).sum())
    state = replace(state, points=np.where(seen[:, None], state.points, np.nan))
    nobody = np.zeros(len(work.placed), dtype=bool)
    minimum = Minimum(state, cost, 0, True, (cost,))
    count, points = redundancy(model, whole), np.flatnonzero(seen)
    return BarAdjusted(state, model, used, minimum, count, None, nobody, joint=False, points=points, rows=rows)


def _adjusted_pair(work: BarNetwork, state: State, context: Context) -> State:
    """Two cameras adjusted to all that both see, the bar's lengths as rows."""
    network = work.network
    candidates = work.placed[network.camera]
    candidates &= (network.views(candidates) >= 2)[network.feature]
    state, good = _robust_start(work, state, candidates, context)
    used = candidates & good[network.feature]
    return _gated(work, state, used, NO_PRIORS, _usual_noise(work, state, used), context, alone=True)[0]


def _robust_start(work: BarNetwork, state: State, candidates: BoolArray, context: Context) -> tuple[State, BoolArray]:
    """A state after robust adjustments (poses, main intrinsics, all), and the points that are known, (p,)."""
    network = work.network
    points, good = usable_features(network, state, candidates)
    for names in ((), START_INTRINSICS, None):
        free = network.free if names is None else network.free & np.isin(INTRINSIC_NAMES, names)
        state = replace(state, points=np.where(good[:, None], points, 0.0))
        lengths = known_lengths(work.session, work.recording, good)
        model, _ = _model(work, candidates & good[network.feature], free, lengths, NO_PRIORS, False)
        state = robust_steps(model, state, context)
        points, good = usable_features(network, state, candidates)
    return replace(state, points=np.where(good[:, None], points, np.nan)), good


def _usual_noise(work: BarNetwork, state: State, used: BoolArray) -> float:
    """Robust standard deviation in units of the weights, for the lengths' rows to weigh against."""
    size = sizes(residuals_px(work.network, state))[used] / work.network.sigma[used].mean(axis=1)
    return max(float(np.median(size)) / 1.1774, 1e-3) if len(size) else 1.0


def _refine(
    work: BarNetwork, state: State, used: BoolArray, priors: Priors, noise: float, context: Context
) -> BarAdjusted:
    state, model, rows, gated, minimum = _gated(work, state, used, priors, noise, context)
    context.report("uncertainty", 0.0)
    points = np.flatnonzero(work.network.views(gated) >= 2)
    covariance = None
    if len(points) and len(model.lengths.frame):
        covariance = frame_covariance(model, minimum.state, model.point_rows(minimum.state, points))
    count, nobody = redundancy(model, minimum.state), np.zeros(len(work.placed), dtype=bool)
    return BarAdjusted(state, model, gated, minimum, count, covariance, nobody, points=points, rows=rows)


def _gated(
    work: BarNetwork, state: State, used: BoolArray, priors: Priors, noise: float, context: Context, alone: bool = False
) -> tuple[State, BarModel, IntArray, BoolArray, Minimum]:
    """Gate and least squares in turns until the gate stays; points without a place get one, but of a pair `alone`."""
    network, rounds, settings = work.network, 0, Settings(max_iterations=60) if alone else Settings()
    last = scatter = 0.0
    while True:
        rounds += 1
        state = state if alone else located(network, state, work.placed, used)
        gated = _gate(network, state, work.placed, used)
        seen = network.views(gated) >= 2
        lengths = known_lengths(work.session, work.recording, seen)
        model, rows = _model(work, gated, network.free, lengths, priors, True)
        if not alone:
            free = replace(state, points=usable_features(network, state, gated)[0])  # not held by the certificates
            scatter = length_scatter(model, free, noise)
        # certificates and dots are to weigh against each other as both really scatter
        lengths = replace(lengths, sigma=np.hypot(lengths.sigma, scatter) / noise, scatter=scatter)
        model = replace(model, lengths=lengths)
        whole = replace(state, points=np.where(seen[:, None], state.points, 0.0))
        minimum = minimise(model, whole, settings, progress(context, "joint adjustment", 20))
        state = replace(minimum.state, points=np.where(seen[:, None], minimum.state.points, np.nan))
        steady = abs(scatter - last) <= SCATTER_STEADY * scatter
        if ((gated == used).all() and steady) or rounds == GATE_ROUNDS:
            return state, model, rows, gated, minimum
        used, last = gated, scatter
        if scatter:  # the noise of a start that the lengths held is too large
            noise = float(np.sqrt(2 * minimum.cost / max(redundancy(model, minimum.state), 1)))


def _model(
    work: BarNetwork, used: BoolArray, free: BoolArray, lengths: Lengths, priors: Priors, weighted: bool
) -> tuple[BarModel, IntArray]:
    """The adjustment of the used observations, and which observation each of its rows is."""
    network = work.network
    rows = np.flatnonzero(used)
    seen = work.placed & (np.bincount(network.camera[rows], minlength=len(work.placed)) > 0)
    sigma = network.sigma[rows] if weighted else None
    pose = seen & (np.arange(len(seen)) != work.reference)
    problem, order = sorted_problem(
        network.camera[rows],
        network.feature[rows],
        network.uv[rows],
        sigma,
        network.n_features,
        free_pose=pose,
        free_intrinsics=free & seen[:, None],
        group=network.group,
        priors=priors,
    )
    return BarModel(problem, work.recording.slots, lengths), rows[order]


def located(network: Network, state: State, placed: BoolArray, used: BoolArray) -> State:
    """The state with points for features that had none, where most of the cameras as they now are agree on them.

    One camera that was knocked would leave all points that it sees without a place, and so without a contradiction.
    """
    missing = np.isnan(state.points[:, 0])
    rows = placed[network.camera] & missing[network.feature]
    rows &= (network.views(rows) >= 2)[network.feature]
    size = sizes(residuals_px(network, state))
    known = used & np.isfinite(size)
    if not rows.any() or not known.any():
        return state
    take = np.flatnonzero(rows)
    limit = gates_px(size, network.camera, known, len(network.group))
    agree = np.zeros_like(rows)
    agree[take] = network.agreeing(state, take, PAIR_GATES * limit[network.camera[take]])
    points, good = usable_features(network, state, agree)
    return replace(state, points=np.where((missing & good)[:, None], points, state.points))


def _gate(network: Network, state: State, placed: BoolArray, used: BoolArray) -> BoolArray:
    """Observations within the gate of their predicted image point, of points that keep two views."""
    size = sizes(residuals_px(network, state))
    keep = placed[network.camera] & within_gate(size, network.camera, used, len(network.group))
    return keep & (network.views(keep) >= 2)[network.feature]


def residuals_px(network: Network, state: State) -> FloatArray:
    """Predicted minus observed (n,2) px; NaN without a prediction in front of the camera."""
    return camera_residuals(state, state.points[network.feature], network.camera, network.uv)
