"""What a bundle adjustment works on: observations, unknowns in blocks, rows of other kinds, and their layout.

The unknowns come in blocks: cameras (pose and intrinsics), placements (pose of the rigid ball, only in the rigid
form) and points. Points are eliminated (Schur complement) except the few that length rows tie to each other; what
remains is the reduced system. The engine fills it camera by camera, in a layout where every camera has all its
columns. `Layout.fold_matrix` then drops locked columns and adds up those of cameras that share intrinsics.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from spherecal.adjust.ball_model import FREE, BallModel, Stored
from spherecal.adjust.parameter_layout import POSE, Layout
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.rotation import exp_rotation


@dataclass(frozen=True)
class LengthRows:
    """Known distances: |sum of coefficient (m,k) * points (m,k)| = length (m,), with a covariance (m,m).

    Each end is a point, or a mark that its dots give: a sum of them whose coefficients add up to 1 (the first end's
    to -1). A coefficient of 0 pads the row. One bar in many poses errs alike: its certificate correlates its rows.
    """

    points: IntArray
    coefficient: FloatArray
    length: FloatArray
    covariance: FloatArray

    @cached_property
    def whitening(self) -> FloatArray:
        """The matrix (m,m) that makes the rows' errors independent and of unit size."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)), dtype=np.float64)

    def select(self, keep: BoolArray) -> "LengthRows":
        """Some of the rows, (m,) bool."""
        covariance = self.covariance[np.ix_(keep, keep)]
        return LengthRows(self.points[keep], self.coefficient[keep], self.length[keep], covariance)


NO_LENGTHS = LengthRows(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 0)))


@dataclass(frozen=True)
class Priors:
    """Known values of intrinsics: value (c,16) and sigma (c,16), infinite where nothing is known."""

    value: FloatArray
    sigma: FloatArray

    def is_known(self, camera: int, intrinsic: int) -> bool:
        """Whether anything is known about an intrinsic of a camera."""
        return len(self.sigma) > 0 and bool(np.isfinite(self.sigma[camera, intrinsic]))


NO_PRIORS = Priors(np.zeros((0, 16)), np.zeros((0, 16)))


@dataclass(frozen=True)
class Problem:
    """A bundle adjustment without its values; observations are sorted by point, then place (if any), then camera.

    `camera, point, uv, weight`: of each observation: camera and point (n,), image point (n,2) px, 1/sigma (n,2), the
    square root of its weight; `n_points`: points, observed or not; `free_pose, free_intrinsics`: what is estimated of
    each camera, (c,) and (c,16); `group`: which cameras share intrinsics, (c,); `ball`: how the ball joins the
    observations; `lengths, priors`: rows of other kinds; NO_LENGTHS and NO_PRIORS without any.
    """

    camera: IntArray
    point: IntArray
    uv: FloatArray
    weight: FloatArray
    n_points: int
    free_pose: BoolArray
    free_intrinsics: BoolArray
    group: IntArray
    ball: BallModel = FREE
    lengths: LengthRows = NO_LENGTHS
    priors: Priors = NO_PRIORS

    @property
    def placement(self) -> IntArray:
        """Pose of the ball at each observation (n,), (0,) in the free form."""
        return self.ball.placement

    @property
    def n_placements(self) -> int:
        """Poses of the ball, 0 in the free form."""
        return len(self.ball.free_placement)

    @property
    def has_lengths(self) -> bool:
        """Whether known lengths give the size of the network."""
        return len(self.lengths.length) > 0

    @property
    def n_cameras(self) -> int:
        """Cameras in the problem, observed or not."""
        return len(self.group)

    @cached_property
    def point_start(self) -> IntArray:
        """First observation of each point and the end, (p + 1,)."""
        return np.searchsorted(self.point, np.arange(self.n_points + 1))

    @cached_property
    def elimination_runs(self) -> tuple[IntArray, BoolArray]:
        """The elimination order (o,), and where in it (o,) runs begin."""
        width = POSE + len(self.intrinsic_columns)
        return elimination_runs(self.camera, self.placement, self.point_start, self.n_cameras, self.n_placements, width)

    @cached_property
    def kept_points(self) -> IntArray:
        """Points that length rows use: they stay in the reduced system."""
        return np.unique(self.lengths.points[self.lengths.coefficient != 0])

    @cached_property
    def layout(self) -> "Layout":
        """Columns of the reduced system."""
        return _layout(self)

    @cached_property
    def intrinsic_columns(self) -> IntArray:
        """The intrinsics that any camera estimates, indices into the 16."""
        return np.flatnonzero(self.free_intrinsics.any(axis=0))

    @property
    def rows(self) -> int:
        """Scalar observation equations: two for an image point, one for a length or prior, three for a stored dot."""
        others = len(self.lengths.length) + len(self.layout.prior_columns) + 3 * int(self.known_points.sum())
        return 2 * len(self.uv) + others

    @cached_property
    def known_points(self) -> BoolArray:
        """Observed points (p,) that the stored shape knows."""
        seen = np.diff(self.point_start) > 0
        return seen & self.ball.shape.known if isinstance(self.ball, Stored) else np.zeros_like(seen)

    @property
    def unknowns(self) -> int:
        """Scalar unknowns, observed points and datum included."""
        observed = np.diff(self.point_start) > 0
        observed[self.kept_points] = False
        return self.layout.size + 3 * int(observed.sum())

    def select(self, keep: BoolArray | IntArray | slice) -> "Problem":
        """The same problem with only some of the observations."""
        rows = {name: getattr(self, name)[keep] for name in ("camera", "point", "uv", "weight")}
        return replace(self, ball=self.ball.select(keep), **rows)


def sorted_problem(
    camera: IntArray, point: IntArray, uv: FloatArray, sigma: FloatArray | None, n_points: int, **blocks: Any
) -> tuple[Problem, IntArray]:
    """A Problem from observations in any order, and the order (n,) it put them in; `sigma` None: all weigh the same."""
    ball = blocks.pop("ball", FREE)
    assert isinstance(ball, BallModel)
    order = np.lexsort((camera, ball.place, point) if len(ball.place) else (camera, point))
    weight = np.ones_like(uv) if sigma is None else 1.0 / sigma
    camera, point, uv, weight = camera[order], point[order], uv[order], weight[order]
    return Problem(camera, point, uv, weight, n_points, ball=ball.select(order), **blocks), order


def _layout(problem: Problem) -> Layout:
    n_cameras, intrinsics = problem.n_cameras, problem.intrinsic_columns
    counts = n_cameras, problem.n_placements, len(problem.kept_points)
    width = np.repeat([POSE + len(intrinsics), POSE, 3], counts)
    offset = np.concatenate([[0], np.cumsum(width)])
    column = np.full(offset[-1], -1)
    next_column = 0
    shared: dict[tuple[int, int], int] = {}
    prior_columns, prior_camera, prior_intrinsic = [], [], []
    for c in range(n_cameras):
        base = offset[c]
        if problem.free_pose[c]:
            column[base : base + POSE] = next_column + np.arange(POSE)
            next_column += POSE
        for i, intrinsic in enumerate(intrinsics):
            if not problem.free_intrinsics[c, intrinsic]:
                continue
            key = (int(problem.group[c]), int(intrinsic))
            if key not in shared:
                shared[key] = next_column
                next_column += 1
                if problem.priors.is_known(c, int(intrinsic)):
                    prior_columns.append(shared[key])
                    prior_camera.append(c)
                    prior_intrinsic.append(intrinsic)
            column[base + POSE + i] = shared[key]
    rest = int(offset[n_cameras])
    free = np.ones(int(offset[-1]) - rest, dtype=bool)
    free[: POSE * problem.n_placements] = np.repeat(problem.ball.free_placement, POSE)
    column[rest:][free] = next_column + np.arange(free.sum())
    priors = (np.array(each, dtype=np.int64) for each in (prior_columns, prior_camera, prior_intrinsic))
    size = next_column + int(free.sum())
    return Layout(n_cameras, offset[:-1], width, int(offset[-1]), size, column, *priors)


def moved(problem: Problem, state: State, reduced_step: FloatArray, point_step: FloatArray) -> State:
    """The state after a step: reduced unknowns (d,), eliminated points (p,3)."""
    layout, c = problem.layout, problem.n_cameras
    step = layout.expanded_rows(reduced_step)
    cameras = step[: c * (POSE + len(problem.intrinsic_columns))].reshape(c, -1)
    turn = exp_rotation(cameras[:, :3])
    rotation, translation = turn @ state.rotation, np.einsum("cij,cj->ci", turn, state.translation) + cameras[:, 3:POSE]
    intrinsics = state.intrinsics.copy()
    intrinsics[:, problem.intrinsic_columns] += cameras[:, POSE:]
    points = state.points + point_step
    after = c + problem.n_placements
    kept = problem.kept_points
    if len(kept):
        points[kept] += step[layout.block_offset[after] :].reshape(-1, 3)
    new = replace(state, rotation=rotation, translation=translation, intrinsics=intrinsics, points=points)
    if not problem.n_placements:
        return new
    start = layout.block_offset[c]
    poses = step[start : start + POSE * problem.n_placements].reshape(-1, POSE)
    # a placement turns about the ball's origin: its translation is only shifted
    placement_rotation = exp_rotation(poses[:, :3]) @ state.placement_rotation
    return replace(
        new, placement_rotation=placement_rotation, placement_translation=state.placement_translation + poses[:, 3:]
    )


def prior_residuals(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """Weighted residuals (m,) of the prior rows and their weights 1/sigma (m,)."""
    layout = problem.layout
    if not len(layout.prior_columns):
        return np.zeros(0), np.zeros(0)
    where = (layout.prior_camera, layout.prior_intrinsic)
    weight = 1.0 / problem.priors.sigma[where]
    return (state.intrinsics[where] - problem.priors.value[where]) * weight, weight


def length_residuals(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """Residuals (m,) of the length rows, made independent, and the plain lengths' derivatives by their ends, (m,3)."""
    rows = problem.lengths
    if not problem.has_lengths:
        return np.zeros(0), np.zeros((0, 3))
    difference = np.einsum("mk,mki->mi", rows.coefficient, state.points[rows.points])
    length = np.linalg.norm(difference, axis=1)
    return rows.whitening @ (length - rows.length), difference / length[:, None]


# --- in which order points are eliminated, and which of them by one matrix product -----------------------------------
#
# A run is worked on in the columns of all cameras and placements that any of its points meets. Points that meet the
# same ones make a run; so do neighbours that meet nearly the same, where the columns that are zero cost less than a
# product of their own would.

# Points of one run at most; more gain nothing.
MOST_POINTS = 64
# Taking a product of u columns from the reduced matrix costs as much as six of its 3 u^2 multiplications for a point.
_TAKING = 6


def elimination_runs(
    camera: IntArray, placement: IntArray, point_start: IntArray, n_cameras: int, n_placements: int, width: int
) -> tuple[IntArray, BoolArray]:
    """The observed points in the order of elimination (o,), and where in it (o,) runs begin.

    `camera`, `placement` (n,): of observations, `point_start` (p+1,): sorted by point; `width`: columns of a camera.
    """
    n_points = len(point_start) - 1
    point = np.repeat(np.arange(n_points), np.diff(point_start))
    meets = np.zeros((n_points, n_cameras + n_placements), dtype=bool)
    meets[point, camera] = True
    if n_placements:
        meets[point, n_cameras + placement] = True
    patterns = np.packbits(meets, axis=1)
    tag = np.random.default_rng(0).integers(1, 2**62, patterns.shape[1], dtype=np.uint64)
    code = np.where(np.diff(point_start) > 0, (patterns * tag).sum(axis=1, dtype=np.uint64), 0)  # wrapping around
    _, first, group, count = np.unique(code, return_index=True, return_inverse=True, return_counts=True)
    in_order = np.argsort(first)  # points of one sticker follow each other, and see much the same
    cameras = int.from_bytes(np.packbits(np.arange(n_cameras + n_placements) < n_cameras).tobytes(), "big")
    sets = [int.from_bytes(row.tobytes(), "big") for row in patterns[first[in_order]]]
    run = np.empty(len(first), dtype=np.int64)
    run[in_order] = _runs(sets, count[in_order].tolist(), cameras, width)
    order = np.lexsort((np.arange(n_points), group, run[group]))
    order = order[np.diff(point_start)[order] > 0]
    own = run[group[order]]
    begins = np.append(True, own[1:] != own[:-1])[: len(order)]
    in_run = np.arange(len(order)) - np.maximum.accumulate(np.where(begins, np.arange(len(order)), 0))
    return order, in_run % MOST_POINTS == 0


def _runs(sets: list[int], counts: list[int], cameras: int, width: int) -> list[int]:
    """The run of each of some sets of blocks (bits) that so many points meet: neighbours together where it pays."""

    def cost(blocks: int, points: int) -> int:
        seen = (blocks & cameras).bit_count()
        return (width * seen + POSE * (blocks.bit_count() - seen)) ** 2 * (_TAKING + points)

    runs, number = [0][: len(sets)], 0
    blocks, points = (sets[0], counts[0]) if sets else (0, 0)
    for other, more in zip(sets[1:], counts[1:], strict=True):
        together = blocks | other
        if points + more <= MOST_POINTS and cost(together, points + more) < cost(blocks, points) + cost(other, more):
            blocks, points = together, points + more
        else:
            blocks, points, number = other, more, number + 1
        runs.append(number)
    return runs
