"""Levenberg-Marquardt on the reduced (Schur) system: the one minimiser of the project.

Marquardt's damping (of the diagonal) keeps steps independent of units; the identity damping of older programs is what
makes poor starts fail ([Tao21] Table II). Damping control after H. B. Nielsen, IMM-REP-1999-05.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spherecal.adjust import engine
from spherecal.adjust.linear import Linear, Reduced
from spherecal.adjust.problem import Problem, State, length_residuals, moved, prior_residuals
from spherecal.base.arrays import FloatArray
from spherecal.base.threads import one_blas_thread


@dataclass(frozen=True)
class Settings:
    """How to minimise.

    `cauchy_px` (in units of sigma) makes the loss robust, None is plain least squares. Converged when a step lowers
    the cost by less than `tolerance` of it: 1e-10 leaves the parameters within 1e-4 of their standard uncertainty on
    rig A and B (benchmarks/adjustment.py).
    """

    cauchy: float | None = None
    max_iterations: int = 60
    tolerance: float = 1e-10
    first_damping: float = 1e-4


@dataclass(frozen=True)
class Minimum:
    """Where the minimiser ended: the state, half the (robust) sum of squares, and whether it converged."""

    state: State
    cost: float
    iterations: int
    converged: bool
    costs: tuple[float, ...]


@dataclass(frozen=True)
class NormalEquations:
    """The reduced system: matrix (d,d) valid in its upper triangle, gradient and undamped diagonal (d,)."""

    matrix: FloatArray
    gradient: FloatArray
    diagonal: FloatArray
    reduced: Reduced


def minimise(
    problem: Problem, state: State, settings: Settings, on_step: Callable[[int, float], None] | None = None
) -> Minimum:
    """The state of least cost near `state`; `on_step(iteration, cost)` is called after each step and may raise.

    BLAS is held to one thread: beside compiled kernels more threads made small factorisations 3-10 times slower.
    """
    with one_blas_thread():
        return _minimise(problem, state, settings, on_step)


def _minimise(
    problem: Problem, state: State, settings: Settings, on_step: Callable[[int, float], None] | None
) -> Minimum:
    if not len(problem.uv):
        return Minimum(state, 0.0, 0, False, (0.0,))
    damping, growth = settings.first_damping, 2.0
    cost = total_cost(problem, state, settings.cauchy)
    costs = [cost]
    linear = None
    for iteration in range(1, settings.max_iterations + 1):
        if linear is None:
            linear = engine.linear_model(problem, state, _robust_weight(problem, state, settings.cauchy))
        trial = _step(problem, state, linear, damping)
        new_cost = np.inf if trial is None else total_cost(problem, trial[0], settings.cauchy)
        # the model's cost is that of the weighted rows; only the decrease is comparable
        predicted = 0.0 if trial is None else trial[1]
        if trial is not None and new_cost < cost and predicted > 0:
            gain = (cost - new_cost) / predicted
            decrease = (cost - new_cost) / cost
            state, cost, linear = trial[0], new_cost, None
            damping, growth = damping * max(1 / 10, 1 - (2 * gain - 1) ** 3), 2.0
            costs.append(cost)
            if on_step is not None:
                on_step(iteration, cost)
            if decrease < settings.tolerance:
                return Minimum(state, cost, iteration, True, tuple(costs))
        else:
            if trial is not None and abs(predicted) <= settings.tolerance * cost:
                return Minimum(state, cost, iteration, True, tuple(costs))
            damping, growth = damping * growth, growth * 2
            if damping > 1e16:
                break
            if on_step is not None:
                on_step(iteration, cost)
    return Minimum(state, cost, len(costs) - 1, False, tuple(costs))


def total_cost(problem: Problem, state: State, cauchy: float | None) -> float:
    """Half the (robust) sum of squared weighted residuals of all rows; infinite where it is not defined."""
    squared = (engine.residuals(problem, state) ** 2).sum(axis=1)
    if cauchy is not None:
        squared = cauchy**2 * np.log1p(squared / cauchy**2)
    rest = (prior_residuals(problem, state)[0] ** 2).sum() + (length_residuals(problem, state)[0] ** 2).sum()
    total = 0.5 * float(squared.sum() + rest)
    return total if np.isfinite(total) else np.inf


def _robust_weight(problem: Problem, state: State, cauchy: float | None) -> FloatArray | None:
    """Square roots of the weights (n,) by which Cauchy's loss scales each observation's rows."""
    if cauchy is None:
        return None
    residual = engine.residuals(problem, state)
    return 1.0 / np.sqrt(1.0 + (residual**2).sum(axis=1) / cauchy**2)


def _step(problem: Problem, state: State, linear: Linear, damping: float) -> tuple[State, float] | None:
    """The state after one damped step and the decrease of cost that the linear model predicts; None if singular."""
    normal = normal_equations(problem, state, linear, damping)
    step = solve_damped(normal, damping)
    if step is None:
        return None
    point_step, model_cost = engine.back_substitute(problem, linear, normal.reduced, problem.layout.expand_vector(step))
    before = 0.5 * float((linear.residual**2).sum())
    new_state = moved(problem, state, step, point_step)
    if (new_state.intrinsics[:, :2] <= 0).any():  # no lens: as good as singular
        return None
    predicted = before - model_cost + _extra_decrease(problem, state, step)
    return new_state, predicted


def solve_damped(normal: NormalEquations, damping: float) -> FloatArray | None:
    """The step (d,) of the damped normal equations, None where they are singular; the matrix is used up.

    Large matrices are worked on in place: at 1500 unknowns each pass over one costs as much as a tenth of its factor.
    """
    matrix = normal.matrix
    diagonal = np.einsum("ii->i", matrix)
    diagonal += damping * np.maximum(normal.diagonal, 1e-30)
    # unit diagonal before factorising: pixels, radians and millimetres differ by ten orders of magnitude
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    with np.errstate(over="ignore", invalid="ignore"):  # of a wild start; the step is looked at below
        matrix *= scale[:, None]
        matrix *= scale
    try:
        factor = cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return None
    step = -scale * cho_solve(factor, scale * normal.gradient, check_finite=False)
    return step if np.isfinite(step).all() else None


def normal_equations(problem: Problem, state: State, linear: Linear, damping: float) -> NormalEquations:
    """The reduced normal equations with the rows of priors and lengths added; points damped, the rest not."""
    return assembled(problem, state, engine.reduce(problem, linear, damping))


def assembled(problem: Problem, state: State, reduced: Reduced) -> NormalEquations:
    """What is left of the observations once their points are eliminated, with the rows of priors and lengths."""
    layout = problem.layout
    matrix = layout.fold_matrix(reduced.matrix, reduced.is_gathered)
    gradient = layout.fold_vector(reduced.gradient)
    diagonal = layout.fold_vector(reduced.diagonal)
    rows, residual = extra_rows(problem, state)
    if len(rows):
        matrix += rows.T @ rows
        gradient += rows.T @ residual
        diagonal += (rows**2).sum(axis=0)
    return NormalEquations(matrix, gradient, diagonal, reduced)


def extra_rows(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """Derivatives (m, d) by the reduced unknowns, and residuals (m,), of prior and length rows."""
    layout = problem.layout
    prior, prior_weight = prior_residuals(problem, state)
    length, by_difference = length_residuals(problem, state)
    rows = np.zeros((len(prior) + len(length), layout.size))
    rows[np.arange(len(prior)), layout.prior_columns] = prior_weight
    if problem.lengths is not None:
        first_kept = layout.size - 3 * len(problem.kept_points)
        own = rows[len(prior) :]
        for points, coefficient in zip(problem.lengths.points.T, problem.lengths.coefficient.T, strict=True):
            used = np.flatnonzero(coefficient)
            columns = first_kept + 3 * np.searchsorted(problem.kept_points, points[used])
            own[used[:, None], columns[:, None] + np.arange(3)] += coefficient[used, None] * by_difference[used]
        own[:] = problem.lengths.whitening @ own
    return rows, np.concatenate([prior, length])


def _extra_decrease(problem: Problem, state: State, step: FloatArray) -> float:
    rows, residual = extra_rows(problem, state)
    return 0.5 * float((residual**2).sum() - ((residual + rows @ step) ** 2).sum())
