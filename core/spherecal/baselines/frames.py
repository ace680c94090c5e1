"""Least squares over cameras and frames: what is seen together has unknowns of its own and meets no other frame.

A board's placement has six (its pose), a frame of a waved bar three a mark. The frames' unknowns are eliminated, block
by block; known lengths inside a frame tie its points without leaving its block, so that thousands of frames cost
what thousands of points do. Cameras, their columns and their derivatives are those of `adjust/`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spherecal.adjust.levenberg import Minimum, extra_rows, one_blas_thread
from spherecal.adjust.problem import Problem, State, moved, prior_residuals, symmetric
from spherecal.arrays import FloatArray, IntArray

# Numbers of a dense block of couplings: 32 MB.
_BLOCK = 4_000_000
_FIRST_DAMPING = 1e-4


@dataclass(frozen=True)
class Ties:
    """Rows inside frames, weighted: frame (m,), derivatives by its unknowns (m,q), residual (m,)."""

    frame: IntArray
    rows: FloatArray
    residual: FloatArray


class FrameModel(Protocol):
    """What frames are made of; `problem` has the cameras' layout and no placements, `frame` (n,) of observations."""

    @property
    def problem(self) -> Problem:
        """Observations, cameras, priors."""
        ...

    @property
    def frame(self) -> IntArray:
        """The frame of every observation, (n,)."""
        ...

    @property
    def n_frames(self) -> int:
        """How many frames."""
        ...

    @property
    def width(self) -> int:
        """Unknowns of a frame, q."""
        ...

    def residuals(self, state: State) -> FloatArray:
        """Weighted residuals (n,2)."""
        ...

    def linearise(self, state: State, robust: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weighted residuals (n,2), derivatives by camera (n,2,w) and by frame (n,2,q)."""
        ...

    def ties(self, state: State) -> Ties:
        """Rows inside frames."""
        ...

    def moved_frames(self, state: State, step: FloatArray) -> State:
        """The state after a step (f,q) of the frames."""
        ...


@dataclass(frozen=True)
class Reduced:
    """Cameras' normal equations (d,d), (d,) and undamped diagonal (d,) after eliminating the frames, and the frames'.

    `own` (f,q,q) and `gradient_own` (f,q) are the frames' normal equations, `inverse` (f,q,q) of the damped ones,
    `coupling` (m,q,w) for every frame `pair_frame` (m,) and camera `pair_camera` (m,) that meet.
    """

    matrix: FloatArray
    gradient: FloatArray
    diagonal: FloatArray
    inverse: FloatArray
    gradient_own: FloatArray
    coupling: FloatArray
    pair_frame: IntArray
    pair_camera: IntArray


def sum_by(index: IntArray, values: FloatArray, n: int) -> FloatArray:
    """Sums of values (m, ...) over equal indices, (n, ...)."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    columns = [np.bincount(index, flat[:, k], n) for k in range(flat.shape[1])]
    return np.stack(columns, axis=1, dtype=np.float64).reshape(n, *values.shape[1:])


def reduce(
    model: FrameModel, state: State, linear: tuple[FloatArray, FloatArray, FloatArray], damping: float
) -> Reduced:  # fmt: skip
    """The cameras' normal equations with the frames eliminated and the priors' rows added; valid above the diagonal."""
    residual, by_camera, by_frame = linear
    problem, layout, q = model.problem, model.problem.layout, model.width
    width = by_camera.shape[2]
    matrix, gradient = np.zeros((layout.expanded, layout.expanded)), np.zeros(layout.expanded)
    for c in range(problem.n_cameras):
        rows = np.flatnonzero(problem.camera == c)
        own = slice(c * width, (c + 1) * width)
        jacobian = by_camera[rows].reshape(-1, width)
        matrix[own, own] = jacobian.T @ jacobian
        gradient[own] = jacobian.T @ residual[rows].ravel()
    diagonal = layout.fold_vector(matrix.diagonal().copy())

    transposed = by_frame.transpose(0, 2, 1)
    own_matrix = sum_by(model.frame, transposed @ by_frame, model.n_frames)
    own_gradient = sum_by(model.frame, (transposed @ residual[:, :, None])[:, :, 0], model.n_frames)
    ties = model.ties(state)
    own_matrix += sum_by(ties.frame, ties.rows[:, :, None] * ties.rows[:, None], model.n_frames)
    own_gradient += sum_by(ties.frame, ties.rows * ties.residual[:, None], model.n_frames)
    inverse = _inverses(own_matrix, damping)

    key, position = np.unique(model.frame * problem.n_cameras + problem.camera, return_inverse=True)
    coupling = sum_by(position.reshape(-1), transposed @ by_camera, len(key))
    pair_frame, pair_camera = key // problem.n_cameras, key % problem.n_cameras
    reduced = Reduced(matrix, gradient, diagonal, inverse, own_gradient, coupling, pair_frame, pair_camera)
    for first, dense in dense_couplings(reduced, problem.n_cameras, q):
        block = slice(first, first + len(dense))
        weighted = inverse[block] @ dense
        matrix -= dense.reshape(-1, layout.expanded).T @ weighted.reshape(-1, layout.expanded)
        gradient -= np.einsum("fqe,fq->e", weighted, own_gradient[block])
    folded, folded_gradient = layout.fold_matrix(matrix), layout.fold_vector(gradient)
    rows, row_residual = extra_rows(problem, state)
    if len(rows):
        folded = folded + rows.T @ rows
        folded_gradient = folded_gradient + rows.T @ row_residual
        diagonal = diagonal + (rows**2).sum(axis=0)
    return replace(reduced, matrix=folded, gradient=folded_gradient, diagonal=diagonal)


def dense_couplings(reduced: Reduced, n_cameras: int, q: int):
    """Blocks of frames: the first one's index and their couplings to all cameras' columns, (b,q,e)."""
    width = reduced.coupling.shape[2]
    n_frames = len(reduced.inverse)
    step = max(1, _BLOCK // max(q * n_cameras * width, 1))
    for first in range(0, n_frames, step):
        last = min(first + step, n_frames)
        begin, end = np.searchsorted(reduced.pair_frame, [first, last])
        dense = np.zeros((last - first, n_cameras, q, width))
        dense[reduced.pair_frame[begin:end] - first, reduced.pair_camera[begin:end]] = reduced.coupling[begin:end]
        yield first, dense.transpose(0, 2, 1, 3).reshape(last - first, q, n_cameras * width)


def _inverses(matrix: FloatArray, damping: float) -> FloatArray:
    """Inverses (f,q,q) of damped normal matrices; unknowns that nothing observes stay where they are."""
    damped = matrix.copy()
    diagonal = np.einsum("fii->fi", damped)
    unseen = diagonal <= 0
    diagonal *= 1.0 + damping
    diagonal[unseen] = 1.0
    scale = 1.0 / np.sqrt(diagonal)
    try:
        inverse = np.linalg.inv(damped * scale[:, :, None] * scale[:, None])
    except np.linalg.LinAlgError as error:
        raise LinAlgError from error
    inverse *= scale[:, :, None] * scale[:, None]
    inverse[unseen] = 0.0
    inverse.transpose(0, 2, 1)[unseen] = 0.0
    return inverse


def minimise(
    model: FrameModel, state: State, cauchy: float | None, max_iterations: int, tolerance: float = 1e-10,
    on_step: Callable[[int, float], None] | None = None,
) -> Minimum:  # fmt: skip
    """The state of least cost near `state`: Levenberg-Marquardt as in `adjust/levenberg.py`.

    `cauchy` (in units of sigma) makes the loss robust; converged when a step lowers the cost by less than `tolerance`.
    """
    with one_blas_thread():
        return _minimise(model, state, cauchy, max_iterations, tolerance, on_step)


def _minimise(
    model: FrameModel, state: State, cauchy: float | None, max_iterations: int, tolerance: float,
    on_step: Callable[[int, float], None] | None,
) -> Minimum:  # fmt: skip
    damping, growth = _FIRST_DAMPING, 2.0
    cost = total_cost(model, state, cauchy)
    costs, linear = [cost], None
    for iteration in range(1, max_iterations + 1):
        if linear is None:
            linear = model.linearise(state, _robust_weight(model, state, cauchy))
        trial = _step(model, state, linear, damping)
        new_cost = np.inf if trial is None else total_cost(model, trial[0], cauchy)
        if trial is not None and new_cost < cost and trial[1] > 0:
            gain, decrease = (cost - new_cost) / trial[1], (cost - new_cost) / cost
            state, cost, linear = trial[0], new_cost, None
            damping, growth = damping * max(1 / 10, 1 - (2 * gain - 1) ** 3), 2.0
            costs.append(cost)
            if decrease < tolerance:
                return Minimum(state, cost, iteration, True, tuple(costs))
        else:
            # perfect observations end at rounding errors, where no step helps any more
            if trial is not None and (abs(trial[1]) <= tolerance * cost or cost < 1e-16 * max(len(model.frame), 1)):
                return Minimum(state, cost, iteration, True, tuple(costs))
            damping, growth = damping * growth, growth * 2
            if damping > 1e16:
                break
        if on_step is not None:
            on_step(iteration, cost)
    return Minimum(state, cost, len(costs) - 1, False, tuple(costs))


def total_cost(model: FrameModel, state: State, cauchy: float | None) -> float:
    """Half the (robust) sum of squares of all rows; infinite where it is not defined."""
    squared = (model.residuals(state) ** 2).sum(axis=1)
    if cauchy is not None:
        squared = cauchy**2 * np.log1p(squared / cauchy**2)
    rest = (prior_residuals(model.problem, state)[0] ** 2).sum() + (model.ties(state).residual ** 2).sum()
    total = 0.5 * float(squared.sum() + rest)
    return total if np.isfinite(total) else np.inf


def _robust_weight(model: FrameModel, state: State, cauchy: float | None) -> FloatArray | None:
    if cauchy is None:
        return None
    return 1.0 / np.sqrt(1.0 + (model.residuals(state) ** 2).sum(axis=1) / cauchy**2)


def _step(
    model: FrameModel, state: State, linear: tuple[FloatArray, FloatArray, FloatArray], damping: float
) -> tuple[State, float] | None:  # fmt: skip
    """The state after one damped step and the decrease of cost that the linear model predicts; None if singular."""
    problem = model.problem
    try:
        normal = reduce(model, state, linear, damping)
    except LinAlgError:
        return None
    step = _solve_damped(normal, damping)
    if step is None:
        return None
    expanded = problem.layout.expand_vector(step).reshape(problem.n_cameras, -1)
    pulled = np.einsum("mqw,mw->mq", normal.coupling, expanded[normal.pair_camera])
    right = normal.gradient_own + sum_by(normal.pair_frame, pulled, model.n_frames)
    frame_step = -np.einsum("fqr,fr->fq", normal.inverse, right)
    # the frames' own unknowns are theirs to move
    cameras = replace(state, placement_rotation=None, placement_translation=None)
    cameras = moved(problem, cameras, step, np.zeros_like(state.points))
    new = replace(
        cameras, placement_rotation=state.placement_rotation, placement_translation=state.placement_translation
    )
    new = model.moved_frames(new, frame_step)
    if (new.intrinsics[:, :2] <= 0).any():  # no lens: as good as singular
        return None
    residual, by_camera, by_frame = linear
    after = residual + np.einsum("nij,nj->ni", by_camera, expanded[problem.camera])
    after += np.einsum("nij,nj->ni", by_frame, frame_step[model.frame])
    ties = model.ties(state)
    tied = ties.residual + np.einsum("mq,mq->m", ties.rows, frame_step[ties.frame])
    rows, row_residual = extra_rows(problem, state)
    predicted = (residual**2).sum() - (after**2).sum() + (ties.residual**2).sum() - (tied**2).sum()
    predicted += (row_residual**2).sum() - ((row_residual + rows @ step) ** 2).sum()
    return new, 0.5 * float(predicted)


def _solve_damped(normal: Reduced, damping: float) -> FloatArray | None:
    matrix = symmetric(normal.matrix)
    if not len(matrix):
        return np.zeros(0)
    matrix[np.diag_indices_from(matrix)] += damping * np.maximum(normal.diagonal, 1e-30)
    if not (np.isfinite(matrix).all() and (matrix.diagonal() > 0).all()):
        return None
    scale = 1.0 / np.sqrt(matrix.diagonal())
    try:
        factor = cho_factor(matrix * scale[:, None] * scale)
    except LinAlgError:
        return None
    step = -scale * cho_solve(factor, scale * normal.gradient)
    return step if np.isfinite(step).all() else None


def cameras_only(problem: Problem) -> Problem:
    """The same problem without placements: the layout of its cameras alone."""
    return replace(problem, placement=None, n_placements=0)


def redundancy(model: FrameModel, state: State) -> int:
    """Equations less unknowns; the reference camera's pose is locked, so that nothing is open."""
    problem = model.problem
    rows = 2 * len(problem.uv) + len(model.ties(state).frame) + len(problem.layout.prior_columns)
    return rows - problem.layout.size - seen_unknowns(model, state)


def seen_unknowns(model: FrameModel, state: State) -> int:
    """Unknowns of frames that some observation depends on."""
    _, _, by_frame = model.linearise(state, None)
    touched = sum_by(model.frame, (by_frame**2).sum(axis=1), model.n_frames)
    return int((touched > 0).sum())
