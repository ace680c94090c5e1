"""Levenberg-Marquardt: the one minimiser of the project.

Marquardt's damping (of the diagonal) keeps steps independent of units, unlike the identity of older programs
(least_squares.py). Damping control after H. B. Nielsen, IMM-REP-1999-05.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray

# Damping of more than this is no step any more.
MOST_DAMPING = 1e16
# Perfect observations end at rounding errors, where no step helps any more: cost per observation.
ROUNDING = 1e-16

OnStep = Callable[[int, float], None]
L = TypeVar("L")


@dataclass(frozen=True)
class Damping:
    """How the damping follows the steps: Nielsen's rule, or tenfold up and down where `by_gain` is False.

    Nielsen's rule needs the gain, decrease over predicted decrease, which means little where the weights follow the
    state: `by_gain` False is for these. `fastest`: by it, a step lowers the damping to no less than this share.
    """

    least: float = 0.0
    by_gain: bool = True
    fastest: float = 1 / 10

    def after_success(self, damping: float, gain: float) -> float:
        """The damping after a step that lowered the cost."""
        return damping * max(self.fastest, 1 - (2 * gain - 1) ** 3) if self.by_gain else max(damping / 10, self.least)

    def after_failure(self, damping: float, failures: int) -> float:
        """The damping after a step that did not lower the cost."""
        return damping * (2.0**failures if self.by_gain else 10.0)


@dataclass(frozen=True)
class Settings:
    """How to minimise.

    `cauchy`: scale of Cauchy's loss in units of sigma; None is plain least squares; `max_iterations`: steps at most,
    refused ones included; `tolerance`: converged when a step lowers the cost by less than this share of it. 1e-10
    leaves the parameters within 1e-4 of their standard uncertainty on rigs A and B (benchmarks/bench_adjustment.py);
    `first_damping`: damping of the first step, relative to the diagonal; `damping`: how it follows the steps.
    """

    cauchy: float | None = None
    max_iterations: int = 60
    tolerance: float = 1e-10
    first_damping: float = 1e-4
    damping: Damping = Damping()


@dataclass(frozen=True)
class Minimum:
    """Where the minimiser ended: the state, half the (robust) sum of squares, and whether it converged.

    `iterations` are all steps, refused ones included; `costs` those at the start and after every step that was taken.
    """

    state: State
    cost: float
    iterations: int
    converged: bool
    costs: tuple[float, ...]


class LeastSquares(Protocol[L]):
    """A least-squares problem for `levenberg_marquardt`; L is what it keeps of a linearisation."""

    @property
    def count(self) -> int:
        """Observations."""
        ...

    def linearise(self, state: State) -> L:
        """The equations at a state, with its weights."""
        ...

    def cost(self, state: State, linear: L) -> float:
        """Half the sum of squares at a state; infinite where it is not defined."""
        ...

    def step(self, state: State, linear: L, damping: float) -> tuple[State, float] | None:
        """The state after one damped step and the decrease of cost that is predicted; None where it is singular."""
        ...


def levenberg_marquardt(
    model: LeastSquares[L], state: State, settings: Settings, on_step: OnStep | None = None
) -> Minimum:
    """The state of least cost near `state`."""
    if not model.count:
        return Minimum(state, 0.0, 0, False, (0.0,))
    linear: L | None = model.linearise(state)
    cost, damping, failures = model.cost(state, linear), settings.first_damping, 0
    costs, iteration = [cost], 0
    for iteration in range(1, settings.max_iterations + 1):
        if linear is None:
            linear = model.linearise(state)
        trial = model.step(state, linear, damping)
        new_cost, predicted = (np.inf, 0.0) if trial is None else (model.cost(trial[0], linear), trial[1])
        if trial is not None and new_cost < cost and predicted > 0:
            gain, decrease = (cost - new_cost) / predicted, (cost - new_cost) / cost
            state, linear, cost = trial[0], None, new_cost
            if not settings.damping.by_gain:
                linear = model.linearise(state)
                cost = model.cost(state, linear)
            damping, failures = settings.damping.after_success(damping, gain), 0
            costs.append(cost)
            is_done = decrease < settings.tolerance
        else:
            is_done = trial is not None and (
                abs(predicted) <= settings.tolerance * cost or cost < ROUNDING * model.count
            )
            failures += 1
            damping = settings.damping.after_failure(damping, failures)
        if on_step is not None:
            on_step(iteration, cost)
        if is_done:
            return Minimum(state, cost, iteration, True, tuple(costs))
        if damping > MOST_DAMPING:
            break
    return Minimum(state, cost, iteration, False, tuple(costs))


def solve_damped(matrix: FloatArray, gradient: FloatArray, diagonal: FloatArray, damping: float) -> FloatArray | None:
    """The step (d,) of damped normal equations (d,d), (d,), used up; None where they are singular.

    Large matrices are worked on in place: at 1500 unknowns each pass over one costs as much as a tenth of its factor.
    """
    own = np.einsum("ii->i", matrix)
    own += damping * np.maximum(diagonal, 1e-30)
    # unit diagonal before factorising: pixels, radians and millimetres differ by ten orders of magnitude
    scale = 1.0 / np.sqrt(np.maximum(own, 1e-300))
    with np.errstate(over="ignore", invalid="ignore"):  # of a wild start; the step is looked at below
        matrix *= scale[:, None]
        matrix *= scale
    try:
        factor = cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return None
    step = -scale * cho_solve(factor, scale * gradient, check_finite=False)
    return step if np.isfinite(step).all() else None
