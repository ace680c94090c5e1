"""Levenberg's adjustment with the identity as damping, as older programs have it: for comparison only."""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.least_squares import assembled
from spherecal.adjust.levenberg import Damping, Minimum, OnStep, Settings, levenberg_marquardt, solve_damped
from spherecal.adjust.linear import Linear, PointEquations
from spherecal.adjust.problem import Problem, moved
from spherecal.adjust.state import State
from spherecal.base.threads import one_blas_thread

# As in SBA and its kin: a thousandth of the largest diagonal element to begin with. That is a camera's, which has more
# points than a point has cameras. Nielsen's rule as he gives it.
_FIRST = 1e-3
_TOLERANCE = 1e-8


@dataclass(frozen=True)
class _Levenberg:
    """A problem of the free form with no rows but observations (see levenberg.LeastSquares)."""

    problem: Problem
    damping = Damping(fastest=1 / 3)

    @property
    def count(self) -> int:
        return len(self.problem.uv)

    def linearise(self, state: State) -> Linear:
        return engine.linear_model(self.problem, state, None)

    def cost(self, state: State, linear: Linear) -> float:
        with np.errstate(all="ignore"):
            total = 0.5 * float((engine.residuals(self.problem, state) ** 2).sum())
        return total if np.isfinite(total) else np.inf

    def accepted(self, state: State, cost: float) -> tuple[Linear | None, float]:
        return None, cost

    def step(self, state: State, linear: Linear, damping: float) -> tuple[State, float] | None:
        """The state after a step of (J'J + lambda 1) d = -J'v, and the decrease it promises."""
        problem, n = self.problem, self.problem.n_points
        of_points = PointEquations(np.tile(damping * np.eye(3), (n, 1, 1)), np.zeros((n, 3)))
        reduced = engine.reduce(problem, linear, 0.0, of_points)
        normal = assembled(problem, state, reduced)
        step = solve_damped(normal.matrix, normal.gradient, np.ones_like(normal.gradient), damping)
        if step is None:
            return None
        by_points, after = engine.back_substitute(problem, linear, reduced, problem.layout.expanded_rows(step))
        new = moved(problem, state, step, by_points)
        if (new.intrinsics[:, :2] <= 0).any():  # no lens: as good as singular
            return None
        return new, 0.5 * float((linear.residual**2).sum()) - after


def minimise_with_identity(problem: Problem, state: State, most_steps: int, on_step: OnStep | None = None) -> Minimum:
    """The state that Levenberg's method reaches in `most_steps`."""
    model = _Levenberg(problem)
    with one_blas_thread():
        diagonal = engine.reduce(problem, model.linearise(state), 0.0).diagonal
        settings = Settings(None, most_steps, _TOLERANCE, _FIRST * float(diagonal.max()))
        return levenberg_marquardt(model, state, settings, on_step)
