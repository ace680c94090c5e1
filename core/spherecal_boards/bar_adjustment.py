"""The joint adjustment of cameras and a waved bar's marks, its lengths as rows: robust, then gate and plain."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from spherecal.adjust.bundle import GATE_ROUNDS, GATE_SIGMAS, PAIR_GATES, START_INTRINSICS, usable_features
from spherecal.adjust.levenberg import Minimum, Settings
from spherecal.adjust.network import Network
from spherecal.adjust.problem import NO_PRIORS, Priors, sorted_problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.data.session import Session
from spherecal.geometry.camera import INTRINSIC_NAMES
from spherecal_boards import frames_adjustment
from spherecal_boards.bar_marks import BarModel, BarRecording, Lengths, known_lengths
from spherecal_boards.frame_network import minimise, redundancy, sum_by
from spherecal_boards.frames_adjustment import frame_covariance, poorly_observed

# Twice the logarithm of the likelihoods' ratio from which a bar counts as unsteady: 3.3 standard deviations.
LEAST_EVIDENCE = 11.0
# Lengths for each number of the smooth change: with fewer it takes the scatter that is looked for.
LEAST_SHARE = 3


def length_scatter(model: BarModel, state: State, noise: float) -> float:
    """The sd in mm of the bar's length between frames by REML beside what varies smoothly with place and direction.

    0 where images of `noise` (sd of unit weight) explain it; `state` has points by the images alone. Lengths that even
    the scatter does not explain are left out.
    """
    lengths, difference = model.lengths, model.differences(state)
    size = np.linalg.norm(difference, axis=1)
    along = difference / size[:, None]
    off, variance = size - lengths.length, noise**2 * _variances(model, state, along)
    middle = np.nanmean(state.points.reshape(-1, model.parts, 3)[lengths.frame], axis=1)
    known = np.isfinite(off) & np.isfinite(variance) & (variance > 0)
    off, variance = off[known], variance[known]
    smooth = _smooth(along[known], middle[known]) * lengths.length[known, None]
    other = lengths.certificate[known, None] == np.unique(lengths.certificate)[1:]  # each certificate's own error
    smooth = np.hstack([smooth, other])
    if len(off) < LEAST_SHARE * smooth.shape[1]:
        return 0.0
    weight = 1 / np.sqrt(variance)[:, None]
    rest = off - smooth @ np.linalg.lstsq(weight * smooth, weight[:, 0] * off, rcond=None)[0]
    robust = max(float(np.median(rest**2 / chi2.median(1) - variance)), 0.0)
    kept = rest**2 <= GATE_SIGMAS**2 * (variance + robust)
    off, variance, smooth = off[kept], variance[kept], smooth[kept]

    def deviance(log_sd: float) -> float:
        return _deviance(off, variance + np.exp(2 * log_sd), smooth)

    usual = float(np.sqrt(np.median(variance)))
    bounds = np.log(1e-2 * usual), np.log(10 * (usual + float(np.std(off))))
    best = minimize_scalar(deviance, bounds=bounds, method="bounded")
    clear = _deviance(off, variance, smooth) - float(best.fun) >= LEAST_EVIDENCE
    return float(np.exp(best.x)) if clear else 0.0


def _deviance(off: FloatArray, variance: FloatArray, smooth: FloatArray) -> float:
    """Twice the negative logarithm of the restricted likelihood of lengths, but for a constant."""
    weight = 1 / np.sqrt(variance)
    q, r = np.linalg.qr(weight[:, None] * smooth)
    scaled = weight * off
    rest = scaled - q @ (q.T @ scaled)
    return float(np.log(variance).sum() + 2 * np.log(np.abs(np.diag(r))).sum() + rest @ rest)


def _smooth(along: FloatArray, middle: FloatArray) -> FloatArray:
    """Strains (m,24) of lengths along (m,3) at places (m,3): by direction, and linear in place."""
    i, j = np.triu_indices(3)
    place = (middle - middle.mean(axis=0)) / middle.std(axis=0).max()
    by_place = np.column_stack([np.ones(len(place)), place])
    return ((along[:, i] * along[:, j])[:, :, None] * by_place[:, None]).reshape(len(along), -1)


def _variances(model: BarModel, state: State, along: FloatArray) -> FloatArray:
    """Variances (m,) of lengths along (m,3) by the images alone, for unit weight of 1 and given cameras."""
    by_point = model.linearise(state, None)[2]
    normal = sum_by(model.part, by_point.transpose(0, 2, 1) @ by_point, model.n_frames * model.parts)
    good = np.isfinite(normal).all(axis=(1, 2)) & (np.linalg.cond(np.nan_to_num(normal)) < 1e12)
    cofactor = np.full_like(normal, np.inf)
    cofactor[good] = np.linalg.inv(normal[good])
    cofactor = cofactor.reshape(-1, model.parts, 3, 3)[model.lengths.frame]
    used = model.lengths.coefficient != 0
    each = np.einsum("mi,msij,mj->ms", along, np.where(used[:, :, None, None], cofactor, 0.0), along)
    return np.asarray((model.lengths.coefficient**2 * each).sum(axis=1), dtype=np.float64)


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
class BarAdjusted(frames_adjustment.Adjusted):
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

    return frames_adjustment.with_priors(refine, network.group, work.known, network.free, has_prior)


def chain_pairs(work: BarNetwork, state: State, parents: tuple[tuple[int, int], ...], context: Context) -> BarAdjusted:
    """Cameras chained over pairs in order, each with the intrinsics of the pair that placed it; no covariance."""
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
        state = frames_adjustment.robust_steps(model, state, context)
        points, good = usable_features(network, state, candidates)
    return replace(state, points=np.where(good[:, None], points, np.nan)), good


def _usual_noise(work: BarNetwork, state: State, used: BoolArray) -> float:
    """Robust standard deviation in units of the weights, for the lengths' rows to weigh against."""
    size = frames_adjustment.sizes(residuals_px(work.network, state))[used] / work.network.sigma[used].mean(axis=1)
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
        minimum = minimise(model, whole, settings, frames_adjustment.progress(context, "joint adjustment", 20))
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
    """The state with points where most cameras now agree on them: a knocked one would leave all its points without."""
    missing = np.isnan(state.points[:, 0])
    rows = placed[network.camera] & missing[network.feature]
    rows &= (network.views(rows) >= 2)[network.feature]
    size = frames_adjustment.sizes(residuals_px(network, state))
    known = used & np.isfinite(size)
    if not rows.any() or not known.any():
        return state
    take = np.flatnonzero(rows)
    limit = frames_adjustment.gates_px(size, network.camera, known, len(network.group))
    agree = np.zeros_like(rows)
    agree[take] = network.agreeing(state, take, PAIR_GATES * limit[network.camera[take]])
    points, good = usable_features(network, state, agree)
    return replace(state, points=np.where((missing & good)[:, None], points, state.points))


def _gate(network: Network, state: State, placed: BoolArray, used: BoolArray) -> BoolArray:
    """Observations within the gate of their predicted image point, of points that keep two views."""
    size = frames_adjustment.sizes(residuals_px(network, state))
    keep = placed[network.camera] & frames_adjustment.within_gate(size, network.camera, used, len(network.group))
    return keep & (network.views(keep) >= 2)[network.feature]


def residuals_px(network: Network, state: State) -> FloatArray:
    """Predicted minus observed (n,2) px; NaN without a prediction in front of the camera."""
    return frames_adjustment.camera_residuals(state, state.points[network.feature], network.camera, network.uv)
