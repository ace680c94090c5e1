"""The soft form: the ball keeps its shape but for some play, X = R_t S + T_t + e with e ~ N(0, tau^2) per coordinate.

Between the free form (tau infinite) and the rigid one (tau 0). It is solved as the rigid form whose observations of one
dot at one placement have the dot's play in common as an error (generalised least squares; A. C. Aitken, 1936). So no
step depends on where the points are off the shape, and ties do not shrink the network, whose size nothing else holds.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.levenberg import (
    Minimum,
    NormalEquations,
    Settings,
    extra_rows,
    solve_damped,
)  # fmt: skip
from spherecal.adjust.linear import Linearisation, Reduced
from spherecal.adjust.problem import Problem, State, length_residuals, moved, prior_residuals
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.threads import one_blas_thread

# Below, the seven motions that no observation sees would wander; 1e-7 of a diagonal slows nothing else down.
LEAST_DAMPING = 1e-7


@dataclass(frozen=True)
class Groups:
    """Observations of one dot at one placement, (g,) of them, by dot: what shares one play.

    Observation `order[k]`, k from `start[g]`, belongs to group g; `of` (n,) tells it the other way round. Groups
    `dot_start[i]`.. are those of dot i; `place` (g,) is the feature's number in the free network, `placement` its pose.
    """

    order: IntArray
    start: IntArray
    of: IntArray
    dot_start: IntArray
    dot: IntArray
    place: IntArray
    placement: IntArray

    def sums(self, values: FloatArray) -> FloatArray:
        """Sums (g, ...) of values (n, ...) over each group."""
        return np.add.reduceat(values[self.order], self.start[:-1], axis=0) if len(self.order) else values[:0]


def groups_of(problem: Problem) -> Groups:
    """The groups of a problem in the rigid form."""
    assert problem.place is not None and problem.placement is not None
    order = np.lexsort((problem.camera, problem.place, problem.point))
    place, point = problem.place[order], problem.point[order]
    first = np.flatnonzero((np.diff(place, prepend=-1) != 0) | (np.diff(point, prepend=-1) != 0))
    of = np.empty(len(order), dtype=np.int64)
    of[order] = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(order))))
    dot = point[first]
    return Groups(
        order, np.append(first, len(order)), of, np.searchsorted(dot, np.arange(problem.n_points + 1)), dot,
        place[first], problem.placement[order][first],
    )  # fmt: skip


@dataclass(frozen=True)
class Softened:
    """A linearisation of the rigid form with the play in its weights.

    Of every group g: V (g,3,3) its normal matrix, `q` = tau^2 (I + tau^2 V)^-1, `p` = I - Q V (symmetric, as V and Q
    are functions of one matrix), `turn` (g,3,3) and `arm` (g,3) = R S.
    """

    problem: Problem
    groups: Groups
    linear: Linearisation
    normal: FloatArray
    q: FloatArray
    p: FloatArray
    turn: FloatArray
    arm: FloatArray

    @cached_property
    def by_place(self) -> FloatArray:
        """Derivatives (n,2,3) of image points by where the dot is in the world."""
        assert self.linear.by_placement is not None
        return self.linear.by_placement[:, :, 3:]

    def pulled(self, residual: FloatArray) -> FloatArray:
        """J' r of every group, (g,3)."""
        return self.groups.sums(np.einsum("nki,nk->ni", self.by_place, residual))

    def cost(self, residual: FloatArray, points: FloatArray) -> float:
        """Half of r'(I - J Q J') r, the least of the squares of image points and ties, and of a stored shape's."""
        b = self.pulled(residual)
        total = (residual**2).sum() - np.einsum("gi,gij,gj->", b, self.q, b)
        if self.problem.shape is not None:
            off, pull = self.problem.shape.off(points)
            total += (off * pull)[self.problem.known_points].sum()
        return 0.5 * float(total)


def softened(problem: Problem, state: State, groups: Groups) -> Softened:
    """The linearisation at a state."""
    assert problem.play is not None and state.placement_rotation is not None
    linear = engine.linearise(problem, state, None)
    by_place = linear.by_placement[:, :, 3:]
    normal = groups.sums(np.einsum("nki,nkj->nij", by_place, by_place))
    q, p = play_matrices(normal, problem.play[groups.place])
    turn = state.placement_rotation[groups.placement]
    arm = np.einsum("gij,gj->gi", turn, state.points[groups.dot])
    return Softened(problem, groups, linear, normal, q, p, turn, arm)


def play_matrices(normal: FloatArray, play: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Q = tau^2 (I + tau^2 V)^-1 and I - Q V = (I + tau^2 V)^-1 of V (g,3,3) and tau (g,)."""
    variance = (play**2)[:, None, None]
    p = np.linalg.inv(np.eye(3) + variance * normal)
    p = 0.5 * (p + p.transpose(0, 2, 1))
    return variance * p, p


def minimise_soft(
    problem: Problem, state: State, settings: Settings, on_step: Callable[[int, float], None] | None = None
) -> Minimum:
    """The state of least cost near `state`, the points' play in `state.bend`; `on_step` as in `minimise`."""
    with one_blas_thread():
        return _minimise(problem, state, settings, on_step)


def _minimise(
    problem: Problem, state: State, settings: Settings, on_step: Callable[[int, float], None] | None
) -> Minimum:
    if not len(problem.uv):
        return Minimum(state, 0.0, 0, False, (0.0,))
    groups = groups_of(problem)
    damping, costs, converged = settings.first_damping, list[float](), False
    soft = softened(problem, state, groups)
    cost = _total(soft, soft.linear.residual, state)
    for iteration in range(1, settings.max_iterations + 1):
        costs.append(cost)
        if on_step is not None:
            on_step(iteration, cost)
        trial, new_cost, predicted = _step(soft, state, damping)
        if trial is not None and new_cost < cost:
            converged = cost - new_cost < settings.tolerance * cost
            state, damping = trial, max(damping / 10, LEAST_DAMPING)
            soft = softened(problem, state, groups)  # the weights follow the state
            cost = _total(soft, soft.linear.residual, state)
        else:
            converged = trial is not None and abs(predicted) <= settings.tolerance * cost
            damping *= 10
        if converged or damping > 1e16:
            break
    costs.append(cost)
    bend = np.zeros((len(problem.play if problem.play is not None else ()), 3))
    bend[groups.place] = -np.einsum("gij,gj->gi", soft.q, soft.pulled(soft.linear.residual))
    return Minimum(replace(state, bend=bend), cost, len(costs) - 1, converged, tuple(costs))


def _total(soft: Softened, residual: FloatArray, state: State) -> float:
    extra = np.concatenate([prior_residuals(soft.problem, state)[0], length_residuals(soft.problem, state)[0]])
    total = soft.cost(residual, state.points) + 0.5 * float((extra**2).sum())
    return total if np.isfinite(total) else np.inf


def _step(soft: Softened, state: State, damping: float) -> tuple[State | None, float, float]:
    """The state after one damped step, its cost with the present weights, and the decrease that was predicted."""
    problem = soft.problem
    normal = soft_normal_equations(soft, state, damping)
    step = solve_damped(normal, damping)
    if step is None:
        return None, np.inf, 0.0
    dots, change = _back_substituted(soft, normal.reduced, problem.layout.expand_vector(step))
    trial = moved(problem, state, step, dots)
    if (trial.intrinsics[:, :2] <= 0).any():
        return None, np.inf, 0.0
    rows, extra = extra_rows(problem, state)
    before = soft.cost(soft.linear.residual, state.points)
    predicted = before - soft.cost(soft.linear.residual + change, trial.points)
    predicted += 0.5 * float((extra**2).sum() - ((extra + rows @ step) ** 2).sum())
    return trial, _total(soft, engine.residuals(problem, trial), trial), predicted


def soft_normal_equations(soft: Softened, state: State, damping: float) -> NormalEquations:
    """The reduced normal equations, dots and their play eliminated, with the rows of priors and lengths."""
    from spherecal.adjust.deformable_kernel import reduce_soft

    problem, layout, linear, groups = soft.problem, soft.problem.layout, soft.linear, soft.groups
    assert linear.by_placement is not None
    kept = np.full(problem.n_points, -1)
    kept[problem.kept_points] = problem.n_cameras + problem.n_placements + np.arange(len(problem.kept_points))
    reduced = Reduced(
        np.zeros((layout.expanded, layout.expanded)), np.zeros(layout.expanded), np.zeros(layout.expanded),
        np.zeros((problem.n_points, 3, 3)), np.zeros((problem.n_points, 3)),
    )  # fmt: skip
    information, pull = np.zeros((problem.n_points, 3, 3)), np.zeros((problem.n_points, 3))
    if problem.shape is not None:
        information, pull = problem.shape.information, problem.shape.off(state.points)[1]
    reduce_soft(
        groups.order, groups.start, groups.dot_start, problem.camera, groups.placement, problem.n_cameras, kept,
        linear.residual, linear.by_camera, linear.by_placement, np.ascontiguousarray(soft.turn), soft.arm, soft.q,
        soft.p, information, pull, layout.block_offset, layout.block_width, damping,
        reduced.matrix, reduced.gradient, reduced.diagonal, reduced.point_inverse, reduced.point_gradient,
    )  # fmt: skip
    matrix = layout.fold_matrix(reduced.matrix)
    gradient, diagonal = layout.fold_vector(reduced.gradient), layout.fold_vector(reduced.diagonal)
    rows, residual = extra_rows(problem, state)
    if len(rows):
        matrix += rows.T @ rows
        gradient += rows.T @ residual
        diagonal += (rows**2).sum(axis=0)
    return NormalEquations(matrix, gradient, diagonal, reduced)


def _back_substituted(soft: Softened, reduced: Reduced, step: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Steps of the eliminated dots (p,3) and the change (n,2) of all residuals, for an expanded step (e,)."""
    problem, groups, layout = soft.problem, soft.groups, soft.problem.layout
    linear = soft.linear
    assert linear.by_placement is not None and problem.placement is not None
    change = np.zeros_like(linear.residual)
    for block, rows in ((problem.camera, linear.by_camera), (
        problem.n_cameras + problem.placement, linear.by_placement)):  # fmt: skip
        columns = layout.block_offset[block][:, None] + np.arange(rows.shape[2])
        change += np.einsum("nij,nj->ni", rows, step[columns])
    kept = np.zeros((problem.n_points, 3))
    if len(problem.kept_points):
        kept[problem.kept_points] = step[layout.block_offset[problem.n_cameras + problem.n_placements] :].reshape(-1, 3)
    met = np.einsum("gji,gjk,gk->gi", soft.turn, soft.p, soft.pulled(change))
    pulled = np.zeros((problem.n_points, 3))
    np.add.at(pulled, groups.dot, met)
    dots = -np.einsum("pij,pj->pi", reduced.point_inverse, reduced.point_gradient + pulled)
    change += np.einsum("nij,nj->ni", linear.by_point, (dots + kept)[problem.point])
    return dots, change


def left_over(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """Residuals (n,2) that the play leaves, and how much of each observation's two rows its own point takes (n,)."""
    soft = softened(problem, state, groups_of(problem))
    groups, residual = soft.groups, soft.linear.residual
    off = np.einsum("gij,gj->gi", soft.q, soft.pulled(residual))
    through = soft.p @ soft.turn
    normal = np.zeros((problem.n_points, 3, 3))
    np.add.at(normal, groups.dot, through.transpose(0, 2, 1) @ soft.normal @ soft.turn)
    if problem.shape is not None:
        normal += problem.shape.information
    dots = np.linalg.pinv(normal, hermitian=True)[groups.dot]
    noise = soft.q + through @ dots @ through.transpose(0, 2, 1)
    taken = np.einsum("nki,nij,nkj->n", soft.by_place, noise[groups.of], soft.by_place)
    return residual - np.einsum("nki,ni->nk", soft.by_place, off[groups.of]), taken
