"""A network solved with one model of the ball, with weights, covariance, and priors where the data need them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable
from spherecal.adjust.bundle import Adjustment, datum_defect, refine, robust_start
from spherecal.adjust.camera_effects import MOTION, Corrections
from spherecal.adjust.corrections import corrected, first_effects, with_corrections
from spherecal.adjust.covariance import covariance
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.deformable import shape_noise_of
from spherecal.adjust.intrinsic_priors import (
    LEAST_NOISE,
    like_the_others,
    poorly_determined,
    poorly_observed,
    shown_lenses,
    with_intrinsic_priors,
)
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.network import Network
from spherecal.adjust.problem import NO_PRIORS, LengthRows, Priors, Problem
from spherecal.adjust.reresection import with_right_poses
from spherecal.adjust.state import State
from spherecal.adjust.weights import rough_noise, weighted
from spherecal.ball.rigid import RigidNetwork
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context, Stopwatch
from spherecal.base.memory import release_freed
from spherecal.initialise.incremental import InitialPoses


@dataclass(frozen=True)
class Run:
    """A running calibration: what is known before, the camera whose frame is the world, progress and stage times.

    `known` (c,16) intrinsics before the adjustment. `next_references`: cameras to take instead of `reference`, in this
    order, where the adjustment leaves out all that it observed. `plain`, as in the paper: every observation weighs the
    same, and a bar gives nothing but the scale. `rough`: uncertainty with a bar's lengths is computed later, if at all.
    """

    known: FloatArray
    reference: int
    plain: bool = False
    next_references: tuple[int, ...] = ()
    context: Context = field(default_factory=Context)
    watch: Stopwatch = field(default_factory=Stopwatch)
    rough: bool = False

    def accepting_partial(self) -> "Run":
        """The same, for work whose caller has a partial result."""
        return replace(self, context=self.context.accepting_partial())

    def reference_in(self, adjusted: Adjustment) -> int:
        """The camera whose frame is the world: the first of the references that still observes anything."""
        seen = np.bincount(adjusted.problem.camera, minlength=adjusted.problem.n_cameras) > 0
        return next((c for c in (self.reference, *self.next_references) if seen[c]), self.reference)


# Nominal intrinsics that are simply wrong make the fit many times worse when fixed; right ones hardly change it.
MOST_WORSE_BY_FIXING = 2.0


@dataclass(frozen=True)
class Begun:
    """A free form before effects: its network, adjustment, placed and ambiguous cameras, and what effects it asks for.

    It is the same whether turns are applied or not.
    """

    network: Network
    adjusted: Adjustment
    placed: BoolArray
    ambiguous: BoolArray
    effects: Corrections | None


@dataclass(frozen=True)
class BallFit:
    """A network solved in one form, in the reference camera's frame.

    `network` has the weights and priors of the solution; in the rigid form its features are dots of the ball, and
    `rigid` says which. `has_prior` (c,): cameras whose intrinsics have a prior, since the data do not determine them.
    `ambiguous` (c,): those without a pose because two fit equally well. `free`: of the soft form, the free one, which
    shows what is wrong without taking a moved camera for a ball that gave way. `begun`: where the free form began,
    if its images may turn.
    """

    network: Network
    adjusted: Adjustment
    cofactors: Covariance | None
    has_prior: BoolArray
    placed: BoolArray
    rigid: RigidNetwork | None = None
    free: "BallFit | None" = None
    ambiguous: BoolArray | None = None
    begun: Begun | None = None

    @property
    def by_features(self) -> Adjustment:
        """The adjustment with a point for every feature (placement, target, point)."""
        if self.rigid is None:
            return self.adjusted
        return replace(self.adjusted, state=self.rigid.as_features(self.adjusted.state))


def solve_free(
    network: Network, start: InitialPoses, candidates: BoolArray, run: Run, begun: Begun | None = None
) -> BallFit:
    """The free form from the start of the network, with some of its observations (n,).

    `begun`: where another solution of the same network began, of which turns were not applied, or were.
    """

    def solution(described: Network) -> BallFit:
        if begun is None or described.priors is not begun.network.priors:
            return solve_from(described, start, candidates, run)
        network = replace(begun.network, turning=described.turning)
        return _from_begun(replace(begun, network=network), run)

    return solve_with_priors(network, candidates & start.placed[network.camera], start.placed, solution, run)


def solve_from(
    network: Network, start: InitialPoses, candidates: BoolArray, run: Run, rigid: RigidNetwork | None = None
) -> BallFit:
    """The solution from a rough start; `rigid` None in the free form."""
    placed = start.placed
    state, used = robust_start(network, start.state, candidates, placed, run.context)
    found = with_right_poses(network, state, used, candidates, placed, run.context)
    state, used = found.state, found.used & ~found.ambiguous[network.camera]
    placed = placed & ~found.ambiguous
    network = replace(network, noise=rough_noise(network, state, used))
    adjusted = refine(network, state, used, placed, run.context)
    if rigid is None and not run.plain:
        network, adjusted = weighted(network, adjusted, placed, run.context)
        return _from_begun(Begun(network, adjusted, placed, found.ambiguous, first_effects(network, adjusted)), run)
    return replace(finished_solution(network, adjusted, placed, run, rigid), ambiguous=found.ambiguous)


def _from_begun(begun: Begun, run: Run) -> BallFit:
    network, adjusted = corrected(begun.network, begun.adjusted, begun.placed, None, begun.effects, run.context)
    if network.corrections is not None:
        network, adjusted = weighted(network, adjusted, begun.placed, run.context)
    fit = _with_covariance(network, adjusted, begun.placed, run, None)
    is_needed = begun.effects is not None and MOTION in begun.effects.evidence  # 100 MB of a million observations
    return replace(fit, ambiguous=begun.ambiguous, begun=begun if is_needed else None)


def with_lengths(fit: BallFit, rows: LengthRows, factor: float, run: Run) -> BallFit:
    """The solution including known lengths between features."""
    free = None if fit.free is None else with_lengths(fit.free, rows, factor, run)
    if fit.rigid is not None:
        rows = replace(rows, points=fit.rigid.places.point[rows.points])
    # rows are to weigh against image points as both really scatter
    rows = replace(rows, covariance=rows.covariance / max(fit.adjusted.variance, LEAST_NOISE**2))
    network = replace(fit.network, lengths=rows, ball=fit.network.ball.scaled(factor))
    state = fit.adjusted.state.scaled(factor)
    adjusted = refine(network, state, fit.adjusted.used, fit.placed, run.context)
    again = finished_solution(network, adjusted, fit.placed, replace(run, plain=True), fit.rigid)
    return replace(again, has_prior=fit.has_prior, free=free)


def finished_solution(
    network: Network, adjusted: Adjustment, placed: BoolArray, run: Run, rigid: RigidNetwork | None = None
) -> BallFit:
    """The solution with its weights and its covariance; `rigid` None in the free form, of which the latter is asked."""
    if not run.plain:
        network, adjusted = weighted(network, adjusted, placed, run.context)
        places = None if rigid is None else rigid.places
        network, adjusted = corrected(network, adjusted, placed, places, None, run.context)
        if network.corrections is not None:
            network, adjusted = weighted(network, adjusted, placed, run.context)
    return _with_covariance(network, adjusted, placed, run, rigid)


def _with_covariance(
    network: Network, adjusted: Adjustment, placed: BoolArray, run: Run, rigid: RigidNetwork | None
) -> BallFit:
    adjusted = replace(adjusted, state=adjusted.state.seen_from(run.reference_in(adjusted)))
    run.context.report("uncertainty", 0.0)
    release_freed()
    places = None if rigid is None else rigid.places
    cofactors = covariance(adjusted.problem, adjusted.state, places)
    release_freed()
    return BallFit(network, adjusted, cofactors, np.zeros(len(placed), dtype=bool), placed, rigid)


def with_effects_unknown(fit: BallFit) -> BallFit:
    """The fit with the covariance in which fields of lenses and motions of images are unknown too: of the one taken."""
    if fit.cofactors is None or fit.cofactors.of_effects is not None:
        return fit
    return replace(fit, cofactors=with_corrections(fit.cofactors, fit.network, fit.adjusted))


def solve_with_priors(
    network: Network, candidates: BoolArray, placed: BoolArray, solution: Callable[[Network], BallFit], run: Run
) -> BallFit:
    """The solution of observations (n,) and placed cameras (c,); those that the data do not determine get a prior."""
    has_prior = poorly_observed(network, candidates) & placed
    fit = solution(with_intrinsic_priors(network, run.known, has_prior, 1.0))

    def again(fit: BallFit, has_prior: BoolArray) -> BallFit:  # with the noise and the lenses that it tells
        shown = shown_lenses(network.free, fit.placed, has_prior)
        known, sigma = like_the_others(run.known, fit.adjusted.state.intrinsics, shown)
        noise = float(np.sqrt(fit.adjusted.variance))
        return solution(with_intrinsic_priors(network.corrected_as(fit.network), known, has_prior, noise, sigma))

    if has_prior.any():
        fit = again(fit, has_prior)
    while fit.cofactors is not None:
        weak = poorly_determined(fit.adjusted.problem, fit.adjusted.state, fit.cofactors, fit.adjusted.variance)
        if not (weak & ~has_prior).any():
            break
        held = again(fit, has_prior | weak)
        if held.adjusted.variance > MOST_WORSE_BY_FIXING * fit.adjusted.variance:
            break
        fit, has_prior = held, has_prior | weak
    return replace(fit, has_prior=has_prior)


def without_priors(rigid: RigidNetwork) -> RigidNetwork:
    """The same network with nothing known of its intrinsics."""
    return replace(rigid, network=replace(rigid.network, priors=NO_PRIORS))


def rigid_solution(
    rigid: RigidNetwork, first: Adjustment, placed: BoolArray, run: Run, priors: Priors | None = None
) -> BallFit:
    """The solution from `first`, which is of the same network with `priors`; None for another."""

    def solution(described: Network) -> BallFit:
        is_first = described.priors is priors and first.is_settled
        own = first if is_first else refine(described, first.state, first.used, placed, run.context)
        return finished_solution(described, own, placed, run, rigid)

    return solve_with_priors(rigid.network, first.used, placed, solution, run)


# --- the shape noise of the ball's dots, from the data ---------------------------------------------------------------
#
# A variance component by its quadratic form: with it the soft form's variance of unit weight is the free form's. See
# docs/decisions/0012-soft-ball.md.

# The variance of unit weight of rig A scatters by 1.2 % from recording to recording.
TOLERANCE = 0.003
MOST_TRIALS = 8
# While the shape noise is sought the network itself hardly moves: 1e-6 of its cost is far below the tolerance.
TRIAL_SETTINGS = {"tolerance": 1e-6, "max_iterations": 6}


@dataclass(frozen=True)
class _Trial:
    """Logarithms of a shape noise and of the variance that it leaves, relative to the one to be reached."""

    shape_sd: float
    excess: float


def estimate_shape_variance(
    rigid: RigidNetwork, first: Adjustment, free: BallFit, variance: float, context: Context
) -> tuple[float, Adjustment]:
    """The shape noise (for a sd of unit weight of 1; 0 where nothing asks for it) and the network adjusted with it."""
    state, used, problem, rows = _start(rigid, first, free)
    settings = Settings(**TRIAL_SETTINGS)  # type: ignore[arg-type]
    redundancy = max(problem.rows - problem.unknowns + datum_defect(problem), 1)
    shape_sd, trials = 0.0, list[_Trial]()
    while True:
        context.report("soft ball", len(trials) / MOST_TRIALS)
        done = minimise(_with_shape_variance(problem, shape_sd), state, settings)
        state, ratio = done.state, 2 * done.cost / redundancy / variance
        if abs(ratio - 1) < TOLERANCE or (shape_sd == 0.0 and ratio <= 1) or len(trials) == MOST_TRIALS:
            return shape_sd, Adjustment(state, _with_shape_variance(problem, shape_sd), rows, used, done, redundancy)
        if shape_sd == 0.0:
            tied = shape_noise_of(problem, engine.linearise(problem, state, None))
            per_row = np.einsum("gii->g", tied.normal) / (2.0 * np.diff(tied.start))
            shape_sd = float(np.sqrt((ratio - 1) / np.median(per_row)))
            continue
        trials.append(_Trial(float(np.log(shape_sd)), float(np.log(ratio))))
        shape_sd = float(np.exp(_next(trials)))


def adjusted_with(rigid: RigidNetwork, first: Adjustment, free: BallFit, shape_sd: float) -> Adjustment:
    """The network adjusted with a known shape noise."""
    state, used, problem, rows = _start(rigid, first, free)
    problem = _with_shape_variance(problem, shape_sd)
    done = minimise(problem, state, Settings())
    redundancy = problem.rows - problem.unknowns + datum_defect(problem)
    return Adjustment(done.state, problem, rows, used, done, redundancy)


def _start(rigid: RigidNetwork, first: Adjustment, free: BallFit) -> tuple[State, BoolArray, Problem, IntArray]:
    """The rigid form's state, the observations of dots that it knows, and their problem with a shape noise of 1."""
    network, state = rigid.softened(1.0).network, first.state
    used = free.adjusted.used & np.isfinite(state.points[network.feature, 0])
    used &= (network.views(used) >= 2)[network.feature]
    state = replace(state, points=np.where(np.isfinite(state.points), state.points, 0.0))
    problem, rows = network.problem(used, network.free, free.placed, weighted=True)
    return state, used, problem, rows


def _with_shape_variance(problem: Problem, shape_sd: float) -> Problem:
    """The problem of `_start` with another shape noise."""
    assert isinstance(problem.ball, Deformable)
    return replace(problem, ball=replace(problem.ball, shape_sd=shape_sd * problem.ball.shape_sd))


def _next(trials: list[_Trial]) -> float:
    """Where the secant through the last two trials is zero, within the bounds that all trials leave (logarithm)."""
    last = trials[-1]
    low = max((t.shape_sd for t in trials if t.excess > 0), default=-np.inf)
    high = min((t.shape_sd for t in trials if t.excess <= 0), default=np.inf)
    slope = -0.5  # between none, where the images' noise prevails, and -2, where the shape noise does
    if len(trials) > 1 and trials[-2].excess != last.excess:
        slope = min((trials[-2].excess - last.excess) / (trials[-2].shape_sd - last.shape_sd), -0.05)
    step = last.shape_sd - float(np.clip(last.excess / slope, -1.5, 1.5))
    if low < step < high:
        return step
    return 0.5 * (low + high) if np.isfinite(low + high) else last.shape_sd + np.sign(last.excess)
