"""The bundle adjustment (2) of a problem as a least-squares problem, and its reduced normal equations."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable, Stored
from spherecal.adjust.deformable import LEAST_DAMPING, ShapeNoise, shape_noise_of
from spherecal.adjust.levenberg import Damping, Minimum, OnStep, Settings, levenberg_marquardt, solve_damped
from spherecal.adjust.linear import Linear, PointEquations, Reduced
from spherecal.adjust.problem import Problem, length_residuals, moved, prior_residuals
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.base.threads import one_blas_thread


@dataclass(frozen=True)
class NormalEquations:
    """The reduced system: matrix (d,d) valid in its upper triangle, gradient and undamped diagonal (d,)."""

    matrix: FloatArray
    gradient: FloatArray
    diagonal: FloatArray
    reduced: Reduced


@dataclass(frozen=True)
class _Bundle:
    """A problem with its loss (see levenberg.LeastSquares)."""

    problem: Problem
    cauchy: float | None

    @property
    def count(self) -> int:
        return len(self.problem.uv)

    def linearise(self, state: State) -> ShapeNoise:
        """The observations' equations at a state, with the shape noise of a deformable ball's places."""
        linear = engine.linear_model(self.problem, state, _robust_weight(self.problem, state, self.cauchy))
        return shape_noise_of(self.problem, linear)

    def cost(self, state: State, linear: ShapeNoise) -> float:
        residual = engine.residuals(self.problem, state)
        squared = (residual**2).sum(axis=1)
        if self.cauchy is not None:
            squared = self.cauchy**2 * np.log1p(squared / self.cauchy**2)
        total = 0.5 * float(squared.sum() - linear.taken(residual) + _other_squares(self.problem, state))
        return total if np.isfinite(total) else np.inf

    def equations(self, state: State, linear: Linear, damping: float) -> NormalEquations:
        return normal_equations(self.problem, state, linear, damping)

    def step(self, state: State, linear: ShapeNoise, damping: float) -> tuple[State, float] | None:
        problem = self.problem
        normal = self.equations(state, linear.linear, damping)
        step = solve_damped(normal.matrix, normal.gradient, normal.diagonal, damping)
        if step is None:
            return None
        whole = problem.layout.expanded_rows(step)
        point_step, after = linear.back_substitute(normal.reduced, whole)
        residual = linear.linear.residual
        before = 0.5 * float((residual**2).sum() - linear.taken(residual))
        new = moved(problem, state, step, point_step)
        if (new.intrinsics[:, :2] <= 0).any():  # no lens: as good as singular
            return None
        # the model's cost is that of the weighted rows; only the decrease is comparable
        of_shape = 0.5 * (_shape_squares(problem, state) - _shape_squares(problem, new))
        return new, before - after + predicted_decrease(problem, state, step) + of_shape


def minimise(problem: Problem, state: State, settings: Settings, on_step: OnStep | None = None) -> Minimum:
    """The state of least cost (2) near `state`; the shape noise of a deformable ball's dots is in its `shape_residual`.

    BLAS runs on one thread: beside compiled kernels more threads made small factorisations 3-10 times slower.
    """
    is_soft = isinstance(problem.ball, Deformable)
    settings = replace(settings, damping=Damping(LEAST_DAMPING, by_gain=False)) if is_soft else settings
    with one_blas_thread():
        found = levenberg_marquardt(_Bundle(problem, settings.cauchy), state, settings, on_step)
        if not is_soft or not len(problem.uv):
            return found
        noise = shape_noise_of(problem, engine.linear_model(problem, found.state, None))
        return replace(found, state=replace(found.state, shape_residual=noise.shape_residual(found.state)))


def _robust_weight(problem: Problem, state: State, cauchy: float | None) -> FloatArray | None:
    """Square roots of the weights (n,) by which Cauchy's loss scales each observation's rows."""
    if cauchy is None:
        return None
    residual = engine.residuals(problem, state)
    return 1.0 / np.sqrt(1.0 + (residual**2).sum(axis=1) / cauchy**2)


def _other_squares(problem: Problem, state: State) -> float:
    """The squares of all rows but the image points'."""
    squares = (prior_residuals(problem, state)[0] ** 2).sum() + (length_residuals(problem, state)[0] ** 2).sum()
    return squares + _shape_squares(problem, state)


def _shape_squares(problem: Problem, state: State) -> float:
    if not isinstance(problem.ball, Stored):
        return 0.0
    off, pull = problem.ball.shape.off(state.points)
    return float((off * pull)[problem.known_points].sum())


def normal_equations(problem: Problem, state: State, linear: Linear, damping: float) -> NormalEquations:
    """The reduced normal equations, points (and shape noise) eliminated, with priors, lengths and a stored shape."""
    return assembled(problem, state, engine.reduce(problem, linear, damping, _known(problem, state)))


def _known(problem: Problem, state: State) -> PointEquations | None:
    if not isinstance(problem.ball, Stored):
        return None
    known = problem.known_points
    information = np.where(known[:, None, None], problem.ball.shape.information, 0.0)
    return PointEquations(information, np.where(known[:, None], problem.ball.shape.off(state.points)[1], 0.0))


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
    if problem.has_lengths:
        first_kept = layout.size - 3 * len(problem.kept_points)
        own = rows[len(prior) :]
        for points, coefficient in zip(problem.lengths.points.T, problem.lengths.coefficient.T, strict=True):
            used = np.flatnonzero(coefficient)
            columns = first_kept + 3 * np.searchsorted(problem.kept_points, points[used])
            own[used[:, None], columns[:, None] + np.arange(3)] += coefficient[used, None] * by_difference[used]
        own[:] = problem.lengths.whitening @ own
    return rows, np.concatenate([prior, length])


def predicted_decrease(problem: Problem, state: State, step: FloatArray) -> float:
    """By how much a step (d,) of the reduced unknowns lowers the cost of prior and length rows, as linearised."""
    rows, residual = extra_rows(problem, state)
    return 0.5 * float((residual**2).sum() - ((residual + rows @ step) ** 2).sum())


# --- Levenberg's adjustment with the identity as damping, as older programs have it ----------------------------------

# As in SBA and its kin: a thousandth of the largest diagonal element to begin with. That is a camera's, which has more
# points than a point has cameras. Nielsen's rule as he gives it.
_FIRST = 1e-3
_TOLERANCE = 1e-8


class _Levenberg(_Bundle):
    """The free form with no rows but observations: (J'J + lambda 1) d = -J'v."""

    def cost(self, state: State, linear: ShapeNoise) -> float:
        with np.errstate(all="ignore"):
            total = 0.5 * float((engine.residuals(self.problem, state) ** 2).sum())
        return total if np.isfinite(total) else np.inf

    def equations(self, state: State, linear: Linear, damping: float) -> NormalEquations:
        n = self.problem.n_points
        of_points = PointEquations(np.tile(damping * np.eye(3), (n, 1, 1)), np.zeros((n, 3)))
        normal = assembled(self.problem, state, engine.reduce(self.problem, linear, 0.0, of_points))
        return replace(normal, diagonal=np.ones_like(normal.gradient))


def minimise_with_identity(problem: Problem, state: State, most_steps: int, on_step: OnStep | None = None) -> Minimum:
    """The state that Levenberg's method reaches in `most_steps`."""
    with one_blas_thread():
        diagonal = engine.reduce(problem, engine.linear_model(problem, state, None), 0.0).diagonal
        settings = Settings(None, most_steps, _TOLERANCE, _FIRST * float(diagonal.max()), Damping(fastest=1 / 3))
        return levenberg_marquardt(_Levenberg(problem, None), state, settings, on_step)
