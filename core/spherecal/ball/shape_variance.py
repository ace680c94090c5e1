"""The shape noise of the ball's dots, from the data: as much as explains the misfit of the rigid form.

A variance component by its quadratic form: with it the soft form's variance of unit weight is the free form's. See
docs/decisions/0012-soft-ball.md.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable
from spherecal.adjust.bundle import Adjustment, datum_defect
from spherecal.adjust.deformable import shape_noise_of
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.ball.fit import BallFit
from spherecal.ball.rigid import RigidNetwork
from spherecal.base.arrays import BoolArray, IntArray
from spherecal.base.context import Context

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
