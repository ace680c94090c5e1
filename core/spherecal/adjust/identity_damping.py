"""Levenberg's adjustment with the identity as damping, as older programs have it: for comparison only.

Such damping does not know the unknowns' units and limits pixels, radians and lengths by the same number. Under it the
claim of [Tao21]'s Table II, that poor points need spherical projection, can be seen. The product damps the diagonal.
"""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spherecal.adjust import engine
from spherecal.adjust.levenberg import Minimum
from spherecal.adjust.linear import Linearisation
from spherecal.adjust.parameter_layout import symmetric
from spherecal.adjust.problem import Problem, moved
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.base.threads import one_blas_thread

# As in SBA and its kin: a thousandth of the largest diagonal element to begin with, Nielsen's rule, fifty steps.
_FIRST = 1e-3
_MOST = 1e30
ITERATIONS = 50


def minimise_with_identity(
    problem: Problem, state: State, tolerance: float = 1e-8, most_steps: int = ITERATIONS
) -> Minimum:
    """The state that Levenberg's method reaches (free form, no rows but observations)."""
    with one_blas_thread():
        cost, growth = _cost(problem, state), 2.0
        costs = [cost]
        linear = engine.linearise(problem, state, None)
        damping = _FIRST * _largest_diagonal(problem, linear)
        for iteration in range(1, most_steps + 1):
            new = _step(problem, state, linear, damping)
            new_cost = np.inf if new is None else _cost(problem, new[0])
            if new is None or new_cost >= cost or new[1] <= 0:
                damping, growth = damping * growth, growth * 2
                if damping > _MOST:
                    break
                continue
            gain, decrease = (cost - new_cost) / new[1], (cost - new_cost) / cost
            state, cost = new[0], new_cost
            costs.append(cost)
            if decrease < tolerance:
                return Minimum(state, cost, iteration, True, tuple(costs))
            damping, growth = damping * max(1 / 3, 1 - (2 * gain - 1) ** 3), 2.0
            linear = engine.linearise(problem, state, None)
        return Minimum(state, cost, len(costs) - 1, False, tuple(costs))


def _largest_diagonal(problem: Problem, linear: Linearisation) -> float:
    """The largest element of J'J's diagonal, over cameras and points."""
    by_point = np.zeros((problem.n_points, 3))
    np.add.at(by_point, problem.point, (linear.by_point**2).sum(axis=1))
    by_camera = np.zeros((problem.n_cameras, linear.by_camera.shape[2]))
    np.add.at(by_camera, problem.camera, (linear.by_camera**2).sum(axis=1))
    return float(max(by_point.max(), by_camera.max()))


def _cost(problem: Problem, state: State) -> float:
    with np.errstate(all="ignore"):
        cost = 0.5 * float((engine.residuals(problem, state) ** 2).sum())
    return cost if np.isfinite(cost) else np.inf


def _step(problem: Problem, state: State, linear: Linearisation, damping: float) -> tuple[State, float] | None:
    """The state after a step of (J'J + lambda 1) d = -J'v, the points eliminated, and the decrease it promises."""
    layout, n = problem.layout, problem.n_points
    width = linear.by_camera.shape[2]
    by_point = linear.by_point
    v = np.zeros((n, 3, 3))
    np.add.at(v, problem.point, by_point.transpose(0, 2, 1) @ by_point)
    g = np.zeros((n, 3))
    np.add.at(g, problem.point, np.einsum("nij,ni->nj", by_point, linear.residual))
    inverse = np.linalg.inv(v + damping * np.eye(3))
    dense = np.zeros((n, 3, problem.n_cameras, width))
    np.add.at(
        dense.transpose(0, 2, 1, 3), (problem.point, problem.camera), by_point.transpose(0, 2, 1) @ linear.by_camera
    )
    coupling = dense.reshape(n, 3, -1)
    matrix = np.zeros((layout.expanded, layout.expanded))
    gradient = np.zeros(layout.expanded)
    for c in range(problem.n_cameras):
        rows, own = problem.camera == c, slice(c * width, (c + 1) * width)
        jacobian = linear.by_camera[rows].reshape(-1, width)
        matrix[own, own] = jacobian.T @ jacobian
        gradient[own] = jacobian.T @ linear.residual[rows].ravel()
    weighted = inverse @ coupling
    matrix -= coupling.reshape(3 * n, -1).T @ weighted.reshape(3 * n, -1)
    gradient -= np.einsum("pie,pi->e", weighted, g)
    folded = symmetric(layout.fold_matrix(matrix))
    folded[np.diag_indices_from(folded)] += damping
    step = _solve(folded, layout.fold_vector(gradient))
    if step is None:
        return None
    expanded = layout.expand_vector(step)
    point_step = -np.einsum("pij,pj->pi", inverse, g + coupling @ expanded)
    new = moved(problem, state, step, point_step)
    if (new.intrinsics[:, :2] <= 0).any():
        return None
    by_camera = expanded.reshape(problem.n_cameras, width)[problem.camera]
    after = linear.residual + np.einsum("nij,nj->ni", linear.by_camera, by_camera)
    after += np.einsum("nij,nj->ni", by_point, point_step[problem.point])
    return new, 0.5 * float((linear.residual**2).sum() - (after**2).sum())


def _solve(matrix: FloatArray, gradient: FloatArray) -> FloatArray | None:
    if not np.isfinite(matrix).all() or (matrix.diagonal() <= 0).any():
        return None
    scale = 1 / np.sqrt(matrix.diagonal())
    try:
        factor = cho_factor(matrix * scale[:, None] * scale)
    except LinAlgError:
        return None
    step = -scale * cho_solve(factor, scale * gradient)
    return step if np.isfinite(step).all() else None
