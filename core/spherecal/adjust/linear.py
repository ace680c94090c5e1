"""The linearisation of a large problem, computed block by block when needed: it takes 400 bytes an observation."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from spherecal.adjust.ball_model import Deformable
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base import arrays
from spherecal.base.arrays import BoolArray, FloatArray, IntArray, blocks

# Up to this number of observations (60 MB) the linearisation is kept in memory. Computed again where it is needed, a
# step of the bench's hall50 and hall100 takes 1.3 times as long.
MOST_IN_MEMORY = 150_000


class Linearisation(NamedTuple):
    """Weighted residuals (n,2), derivatives by camera (n,2,6+k), point (n,2,3), placement (n,2,6) or, free, (0,2,6)."""

    residual: FloatArray
    by_camera: FloatArray
    by_point: FloatArray
    by_placement: FloatArray

    @property
    def width(self) -> int:
        """Columns of a camera: its pose and intrinsics."""
        return self.by_camera.shape[2]

    def at(self, rows: slice | IntArray) -> "Linearisation":
        """The same of some observations."""
        by_placement = self.by_placement[rows] if len(self.by_placement) else self.by_placement
        return Linearisation(self.residual[rows], self.by_camera[rows], self.by_point[rows], by_placement)


class Blocks(NamedTuple):
    """Blocks of columns in the expanded layout: cameras, placements, points that are kept, lenses that cameras share.

    `offset`, `width`: first column and number of columns (b,); `lens` (c,): block of the lens that a camera shares; -1.
    """

    offset: IntArray
    width: IntArray
    lens: IntArray


class Reduced(NamedTuple):
    """Normal equations in the expanded layout (upper block triangle) after eliminating the points.

    `diagonal` (e,) is the diagonal before elimination; `point_inverse` (p,3,3) and `point_gradient` (p,3) serve the
    back substitution. `is_gathered`: of cameras that share a lens, only the first has anything in its columns.
    """

    matrix: FloatArray
    gradient: FloatArray
    diagonal: FloatArray
    point_inverse: FloatArray
    point_gradient: FloatArray
    is_gathered: bool = False


@dataclass(frozen=True)
class PointEquations:
    """Information on the points besides their observations: normal matrices (p,3,3) and gradients (p,3)."""

    normal: FloatArray
    gradient: FloatArray


Linearise = Callable[[Problem, State, FloatArray | None], Linearisation]


@dataclass(frozen=True)
class LinearByBlocks:
    """The linearisation of a problem at a state, computed for the rows that are asked for."""

    problem: Problem
    state: State
    robust_weight: FloatArray | None
    linearise: Linearise

    @cached_property
    def _residual(self) -> FloatArray:
        return np.full_like(self.problem.uv, np.nan)

    @cached_property
    def residual(self) -> FloatArray:
        """Weighted residuals (n,2), of rows that were asked for as they were then."""
        for rows in blocks(len(self._residual)):
            if np.isnan(self._residual[rows]).any():
                self.at(rows)
        return self._residual

    @property
    def width(self) -> int:
        """Columns of a camera: its pose and intrinsics."""
        return POSE + len(self.problem.intrinsic_columns)

    def at(self, rows: slice | IntArray) -> Linearisation:
        """The linearisation of some observations."""
        robust = None if self.robust_weight is None else self.robust_weight[rows]
        found = self.linearise(self.problem.select(rows), self.state, robust)
        self._residual[rows] = found.residual
        return found


# A linearisation of which some rows are asked for at a time.
Linear: TypeAlias = Linearisation | LinearByBlocks


def linear_model(problem: Problem, state: State, robust_weight: FloatArray | None, linearise: Linearise) -> Linear:
    """The linearisation: in memory where that is small or places have shape noise, else computed by blocks."""
    if len(problem.uv) <= MOST_IN_MEMORY or isinstance(problem.ball, Deformable):
        return linearise(problem, state, robust_weight)
    return LinearByBlocks(problem, state, robust_weight, linearise)


class PointBlock(NamedTuple):
    """Some points (m,) and their observations: rows `begin` to `end` (m,) of what follows."""

    points: IntArray
    begin: IntArray
    end: IntArray
    camera: IntArray
    placement: IntArray
    place: IntArray
    linear: Linearisation


def point_blocks(
    problem: Problem, linear: Linear, points: IntArray, may_begin: BoolArray | None = None
) -> Iterator[PointBlock]:
    """The points (m,) in order, in parts of some `ROWS_AT_ONCE` observations which begin where they may (m,)."""
    placement, place = problem.ball.placement, problem.ball.place
    start = problem.point_start
    if isinstance(linear, Linearisation):
        yield PointBlock(points, start[points], start[points + 1], problem.camera, placement, place, linear)
        return
    count = start[points + 1] - start[points]
    at = np.arange(len(points)) if may_begin is None else np.flatnonzero(may_begin)
    number = (np.cumsum(count) - count)[at] // arrays.ROWS_AT_ONCE
    for first, last in pairwise([*at[np.flatnonzero(np.diff(number, prepend=-1))].tolist(), len(points)]):
        some, own = points[first:last], count[first:last]
        end = np.cumsum(own)
        begin = end - own
        rows = np.repeat(start[some] - begin, own) + np.arange(end[-1])
        of_rows, at_rows = (each[rows] if len(each) else each for each in (placement, place))
        yield PointBlock(some, begin, end, problem.camera[rows], of_rows, at_rows, linear.at(rows))
