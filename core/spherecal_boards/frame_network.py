"""Least squares over cameras and frames, whose own unknowns are eliminated block by block (decision 0017).

A board's placement has six (its pose), a frame of a waved bar three a mark; known lengths tie points of one block.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from scipy.linalg import LinAlgError

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Free
from spherecal.adjust.least_squares import assembled, predicted_decrease
from spherecal.adjust.levenberg import Minimum, OnStep, Settings, levenberg_marquardt, solve_damped
from spherecal.adjust.linear import Reduced
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem, moved, prior_residuals
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.threads import one_blas_thread

# Weighted residuals (n,2), derivatives by camera (n,2,w) and by the part (n,2,k).
Linearised: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]

# Numbers of a dense block of couplings: 32 MB.
_BLOCK = 4_000_000


@dataclass(frozen=True)
class Ties:
    """Rows inside frames, weighted: frame (m,), derivatives by its q = s k unknowns (m,q), residual (m,)."""

    frame: IntArray
    rows: FloatArray
    residual: FloatArray


@dataclass(frozen=True)
class FrameModel(ABC):
    """Frames of `parts` parts, each of a few unknowns: a board's is one of six, a bar's three a point."""

    problem: Problem
    parts: int

    @property
    def observed(self) -> Problem:
        """The problem with the placements, if there are any."""
        return self.problem

    @property
    def part(self) -> IntArray:
        """The part of every observation, (n,): frame * parts + part of the frame."""
        return self.observed.placement if self.observed.n_placements else self.observed.point

    @property
    def n_frames(self) -> int:
        """How many frames."""
        return self.observed.n_placements or self.observed.n_points // self.parts

    def residuals(self, state: State) -> FloatArray:
        """Weighted residuals (n,2)."""
        return engine.residuals(self.observed, state)

    def linearise(self, state: State, robust: FloatArray | None) -> Linearised:
        """Weighted residuals (n,2), derivatives by camera (n,2,w) and by the part (n,2,k), rows times `robust` (n,)."""
        linear = engine.linearise(self.observed, state, robust)
        by_part = linear.by_placement if self.observed.n_placements else linear.by_point
        return linear.residual, linear.by_camera, by_part

    def ties(self, state: State) -> Ties:
        """Rows inside frames; none where their points are fixed."""
        return Ties(np.zeros(0, dtype=np.int64), np.zeros((0, POSE)), np.zeros(0))

    @abstractmethod
    def moved_frames(self, state: State, step: FloatArray) -> State:
        """The state after a step (f,q) of the frames."""


@dataclass(frozen=True)
class ReducedFrames:
    """Cameras' normal equations (d,d), (d,) and diagonal (d,) after eliminating frames, and what these need again.

    `gradient_own` (f,q), `inverse` (f,q,q) of the damped normal equations; `coupling` (m,k,w) of parts and cameras.
    """

    matrix: FloatArray
    gradient: FloatArray
    diagonal: FloatArray
    inverse: FloatArray
    gradient_own: FloatArray
    coupling: FloatArray
    pair_part: IntArray
    pair_camera: IntArray
    parts: int


def sum_by(index: IntArray, values: FloatArray, n: int) -> FloatArray:
    """Sums of values (m, ...) over equal indices (m,), (n, ...)."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    columns = [np.bincount(index, flat[:, k], n) for k in range(flat.shape[1])]
    return np.stack(columns, axis=1, dtype=np.float64).reshape(n, *values.shape[1:])


def reduce(model: FrameModel, state: State, linear: Linearised, damping: float) -> ReducedFrames:
    """The cameras' normal equations with the frames eliminated and the priors' rows added; valid above the diagonal."""
    residual, by_camera, by_part = linear
    problem, layout = model.problem, model.problem.layout
    width = by_camera.shape[2]
    matrix, gradient = np.zeros((layout.expanded, layout.expanded)), np.zeros(layout.expanded)
    for c in range(problem.n_cameras):
        rows = np.flatnonzero(problem.camera == c)
        own = slice(c * width, (c + 1) * width)
        jacobian = by_camera[rows].reshape(-1, width)
        matrix[own, own] = jacobian.T @ jacobian
        gradient[own] = jacobian.T @ residual[rows].ravel()
    diagonal = matrix.diagonal().copy()

    transposed = by_part.transpose(0, 2, 1)
    own_matrix, own_gradient = _own_equations(model, state, transposed, residual)
    inverse = _inverses(own_matrix, damping)
    key, position = np.unique(model.part * problem.n_cameras + problem.camera, return_inverse=True)
    coupling = sum_by(position.reshape(-1), transposed @ by_camera, len(key))
    pair_part, pair_camera = (pair.astype(np.int64) for pair in np.divmod(key, problem.n_cameras))
    reduced = ReducedFrames(
        matrix, gradient, diagonal, inverse, own_gradient, coupling, pair_part, pair_camera, model.parts
    )
    for first, dense in dense_couplings(reduced, problem.n_cameras):
        block = slice(first, first + len(dense))
        weighted = inverse[block] @ dense
        matrix -= dense.reshape(-1, layout.expanded).T @ weighted.reshape(-1, layout.expanded)
        gradient -= np.einsum("fqe,fq->e", weighted, own_gradient[block])
    cameras = Reduced(matrix, gradient, diagonal, np.zeros((0, 3, 3)), np.zeros((0, 3)))
    normal = assembled(problem, state, cameras)
    return replace(reduced, matrix=normal.matrix, gradient=normal.gradient, diagonal=normal.diagonal)


def _own_equations(
    model: FrameModel, state: State, transposed: FloatArray, residual: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The frames' own normal equations (f,q,q) and gradient (f,q), from by_part' (n,k,2) and the ties."""
    n_parts, k = model.n_frames * model.parts, transposed.shape[1]
    blocks = sum_by(model.part, transposed @ transposed.transpose(0, 2, 1), n_parts)
    gradient = sum_by(model.part, (transposed @ residual[:, :, None])[:, :, 0], n_parts)
    matrix = np.zeros((model.n_frames, model.parts, k, model.parts, k))
    each = np.arange(model.parts)
    matrix[:, each, :, each] = blocks.reshape(model.n_frames, model.parts, k, k).transpose(1, 0, 2, 3)
    q = model.parts * k
    matrix, gradient = matrix.reshape(-1, q, q), gradient.reshape(-1, q)
    ties = model.ties(state)
    if len(ties.frame):
        matrix += sum_by(ties.frame, ties.rows[:, :, None] * ties.rows[:, None], model.n_frames)
        gradient += sum_by(ties.frame, ties.rows * ties.residual[:, None], model.n_frames)
    return matrix, gradient


def dense_couplings(reduced: ReducedFrames, n_cameras: int) -> Iterator[tuple[int, FloatArray]]:
    """Blocks of frames: the first one's index and their couplings to all cameras' columns, (b,q,e)."""
    _, k, width = reduced.coupling.shape
    n_frames, parts = len(reduced.inverse), reduced.parts
    step = max(1, _BLOCK // max(parts * k * n_cameras * width, 1))
    for first in range(0, n_frames, step):
        last = min(first + step, n_frames)
        begin, end = np.searchsorted(reduced.pair_part, [first * parts, last * parts])
        dense = np.zeros(((last - first) * parts, k, n_cameras, width))
        dense[reduced.pair_part[begin:end] - first * parts, :, reduced.pair_camera[begin:end]] = reduced.coupling[
            begin:end
        ]
        yield first, dense.reshape(last - first, parts * k, n_cameras * width)


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


def minimise(model: FrameModel, state: State, settings: Settings, on_step: OnStep | None = None) -> Minimum:
    """The state of least cost near `state`."""
    with one_blas_thread():
        return levenberg_marquardt(_Frames(model, settings.cauchy), state, settings, on_step)


@dataclass(frozen=True)
class _Frames:
    """Frames with their loss (see levenberg.LeastSquares)."""

    model: FrameModel
    cauchy: float | None

    @property
    def count(self) -> int:
        return len(self.model.part)

    def linearise(self, state: State) -> Linearised:
        robust = None
        if self.cauchy is not None:
            robust = 1.0 / np.sqrt(1.0 + (self.model.residuals(state) ** 2).sum(axis=1) / self.cauchy**2)
        return self.model.linearise(state, robust)

    def cost(self, state: State, linear: Linearised) -> float:
        return total_cost(self.model, state, self.cauchy)

    def step(self, state: State, linear: Linearised, damping: float) -> tuple[State, float] | None:
        problem = self.model.problem
        try:
            normal = reduce(self.model, state, linear, damping)
        except LinAlgError:
            return None
        step = solve_damped(normal.matrix, normal.gradient, normal.diagonal, damping)
        if step is None:
            return None
        expanded = problem.layout.expanded_rows(step).reshape(problem.n_cameras, -1)
        pulled = np.einsum("mkw,mw->mk", normal.coupling, expanded[normal.pair_camera])
        pulled = sum_by(normal.pair_part, pulled, self.model.n_frames * self.model.parts).reshape(
            normal.gradient_own.shape
        )
        frame_step = -np.einsum("fqr,fr->fq", normal.inverse, normal.gradient_own + pulled)
        new = self.model.moved_frames(moved(problem, state, step, np.zeros_like(state.points)), frame_step)
        if (new.intrinsics[:, :2] <= 0).any():  # no lens: as good as singular
            return None
        residual, by_camera, by_part = linear
        after = residual + np.einsum("nij,nj->ni", by_camera, expanded[problem.camera])
        part_step = frame_step.reshape(self.model.n_frames * self.model.parts, -1)
        after += np.einsum("nij,nj->ni", by_part, part_step[self.model.part])
        ties = self.model.ties(state)
        tied = ties.residual + np.einsum("mq,mq->m", ties.rows, frame_step[ties.frame])
        predicted = (residual**2).sum() - (after**2).sum() + (ties.residual**2).sum() - (tied**2).sum()
        return new, 0.5 * float(predicted) + predicted_decrease(problem, state, step)


def total_cost(model: FrameModel, state: State, cauchy: float | None) -> float:
    """Half the (robust) sum of squares of all rows; infinite where it is not defined."""
    squared = (model.residuals(state) ** 2).sum(axis=1)
    if cauchy is not None:
        squared = cauchy**2 * np.log1p(squared / cauchy**2)
    rest = (prior_residuals(model.problem, state)[0] ** 2).sum() + (model.ties(state).residual ** 2).sum()
    total = 0.5 * float(squared.sum() + rest)
    return total if np.isfinite(total) else np.inf


def cameras_only(problem: Problem) -> Problem:
    """The same problem without placements: the layout of its cameras alone."""
    return replace(problem, ball=Free())


def redundancy(model: FrameModel, state: State) -> int:
    """Equations less unknowns; the reference camera's pose is locked, so that nothing is open."""
    problem = model.problem
    rows = 2 * len(problem.uv) + len(model.ties(state).frame) + len(problem.layout.prior_columns)
    _, _, by_part = model.linearise(state, None)
    touched = sum_by(model.part, (by_part**2).sum(axis=1), model.n_frames * model.parts)
    return rows - problem.layout.size - int((touched > 0).sum())
