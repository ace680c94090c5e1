"""What a bundle adjustment works on: observations, unknowns in blocks, rows of other kinds, and their layout.

The unknowns come in blocks: cameras (pose and intrinsics), placements (pose of the rigid ball, only in the rigid
form) and points. Points are eliminated (Schur complement) except the few that length rows tie to each other; what
remains is the reduced system. The engine fills it camera by camera, in a layout where every camera has all its
columns; `Layout.fold` then drops locked columns and adds up those of cameras that share intrinsics.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from spherecal.adjust.ball_model import FREE, BallModel, Free, Stored
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.rotation import exp_rotation

POSE = 6  # columns of a pose: rotation, then shift (docs/conventions.md)


@dataclass(frozen=True)
class State:
    """The values of all unknowns.

    Attributes
    ----------
    rotation, translation
        Poses of the cameras, (c,3,3) and (c,3).
    intrinsics
        (c,16), see docs/conventions.md.
    points
        (p,3): of the world in the free form, else of the ball's frame.
    placement_rotation, placement_translation
        Poses (t,3,3) and (t,3) that bring the ball's points to the world; t = 0 in the free form.
    bend
        How far each feature (dot at a placement) of a deformable ball is off the shape in the world, (f,3); else (0,3).
    anchored
        Points whose frame a stored shape of the ball holds, (p,); else (0,).
    """

    rotation: FloatArray
    translation: FloatArray
    intrinsics: FloatArray
    points: FloatArray
    placement_rotation: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    placement_translation: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    bend: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    anchored: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    @property
    def is_anchored(self) -> bool:
        """Whether a stored shape holds the ball's frame."""
        return len(self.anchored) > 0

    def scaled(self, factor: float) -> "State":
        """The same network with all lengths multiplied by `factor`."""
        return replace(
            self,
            translation=self.translation * factor,
            points=self.points * factor,
            placement_translation=self.placement_translation * factor,
            bend=self.bend * factor,
        )

    def free(self, points: FloatArray) -> "State":
        """The free form: the same cameras and points (f,3) of the world."""
        return State(self.rotation, self.translation, self.intrinsics, points)

    def seen_from(self, camera: int) -> "State":
        """The same network in the frame of a camera: its pose is R = I, t = 0.

        In the rigid form the ball's frame moves along, so a placement that defines the world frame (R = I) still does.
        """
        r, t = self.rotation[camera], self.translation[camera]
        rotation = self.rotation @ r.T
        moved = replace(
            self,
            rotation=rotation,
            translation=self.translation - rotation @ t,
            points=self.points @ r.T + t,
            bend=self.bend @ r.T,
        )
        if self.is_anchored:  # the placements move instead of the shape; the first one is the world itself
            turn, shift = r @ self.placement_rotation, self.placement_translation @ r.T + t
            turn[0], shift[0] = np.eye(3), 0.0
            points = np.where(self.anchored[:, None], self.points, moved.points)
            return replace(moved, points=points, placement_rotation=turn, placement_translation=shift)
        turn = r @ self.placement_rotation @ r.T
        return replace(
            moved, placement_rotation=turn, placement_translation=self.placement_translation @ r.T + t - turn @ t
        )


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

    @staticmethod
    def between(first: IntArray, second: IntArray, length: FloatArray, sigma: FloatArray) -> "LengthRows":
        """Independent distances between pairs of points, (m,) indices, with standard uncertainties (m,)."""
        ends = np.column_stack([first, second])
        return LengthRows(ends, np.broadcast_to([-1.0, 1.0], ends.shape), length, np.diag(np.square(sigma)))

    @cached_property
    def whitening(self) -> FloatArray:
        """The matrix (m,m) that makes the rows' errors independent and of unit size."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)), dtype=np.float64)

    def select(self, keep: BoolArray) -> "LengthRows":
        """Some of the rows, (m,) bool."""
        return LengthRows(
            self.points[keep], self.coefficient[keep], self.length[keep], self.covariance[np.ix_(keep, keep)]
        )


NO_LENGTHS = LengthRows(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 0)))


@dataclass(frozen=True)
class Priors:
    """Known values of intrinsics: value (c,16) and sigma (c,16), infinite where nothing is known."""

    value: FloatArray
    sigma: FloatArray

    def is_known(self, camera: int, intrinsic: int) -> bool:
        """Whether anything is known of an intrinsic of a camera."""
        return len(self.sigma) > 0 and bool(np.isfinite(self.sigma[camera, intrinsic]))


NO_PRIORS = Priors(np.zeros((0, 16)), np.zeros((0, 16)))


@dataclass(frozen=True)
class Problem:
    """A bundle adjustment without its values; observations are sorted by point, then place (if any), then camera.

    Attributes
    ----------
    camera, point, uv, weight
        Of each observation: camera and point (n,), image point (n,2) px, 1/sigma (n,2), the square root of its weight.
    n_points
        Points, observed or not.
    free_pose, free_intrinsics
        What is estimated of each camera, (c,) and (c,16).
    group
        Which cameras share intrinsics, (c,).
    ball
        How the ball joins the observations.
    lengths, priors
        Rows of other kinds; NO_LENGTHS and NO_PRIORS without any.
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

    @property
    def elimination_order(self) -> IntArray:
        """Observed points, those that the same cameras (and placements) see side by side, (o,).

        They fill the same blocks of the reduced system, so an engine can eliminate them together.
        """
        return self.elimination_runs[0]

    @cached_property
    def elimination_runs(self) -> tuple[IntArray, BoolArray]:
        """The elimination order (o,) and where in it (o,) points begin that other cameras or placements see."""
        tag = np.random.default_rng(0).integers(1, 2**62, self.n_cameras + self.n_placements, dtype=np.uint64)
        pattern = np.zeros(self.n_points, dtype=np.uint64)  # sums of tags: equal for equal sets, wrapping around
        np.add.at(pattern, self.point, tag[self.camera])
        if self.n_placements:
            np.add.at(pattern, self.point, tag[self.n_cameras + self.placement])
        order = np.argsort(pattern, kind="stable")
        order = order[np.diff(self.point_start)[order] > 0]
        return order, np.append(True, pattern[order][1:] != pattern[order][:-1])[: len(order)]

    @cached_property
    def kept_points(self) -> IntArray:
        """Points that length rows touch: they stay in the reduced system."""
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
        """Scalar observation equations: two an image point, one a length, one a prior, three a dot known before."""
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
        return replace(
            self,
            camera=self.camera[keep],
            point=self.point[keep],
            uv=self.uv[keep],
            weight=self.weight[keep],
            ball=self.ball.select(keep),
        )


def sorted_problem(
    camera: IntArray, point: IntArray, uv: FloatArray, sigma: FloatArray | None, n_points: int, **blocks: object
) -> tuple[Problem, IntArray]:
    """A Problem from observations in any order, and the order it put them in, (n,) indices.

    Parameters
    ----------
    camera, point, uv
        As of the Problem.
    sigma
        Standard deviations (n,2) px of the image points; None where all weigh the same.
    n_points
        Points, observed or not.
    blocks
        The other fields of the Problem.
    """
    ball = blocks.pop("ball", Free())
    assert isinstance(ball, BallModel)
    order = np.lexsort((camera, ball.place, point) if len(ball.place) else (camera, point))
    weight = np.ones_like(uv) if sigma is None else 1.0 / sigma
    problem = Problem(
        camera[order], point[order], uv[order], weight[order], n_points, ball=ball.select(order), **blocks  # type: ignore[arg-type]
    )  # fmt: skip
    return problem, order


@dataclass(frozen=True)
class Layout:
    """Where each block has its columns in the expanded system, and how that folds into the reduced one.

    `block_offset`, `block_width`: `n_cameras` cameras first, then placements, then kept points. `column` (expanded,) is
    the reduced column or -1 where nothing is estimated. Prior rows: reduced column, camera and intrinsic of each.
    """

    n_cameras: int
    block_offset: IntArray
    block_width: IntArray
    expanded: int
    size: int
    column: IntArray
    prior_columns: IntArray
    prior_camera: IntArray
    prior_intrinsic: IntArray

    @cached_property
    def _fold(self) -> sparse.csr_array:
        used = np.flatnonzero(self.column >= 0)
        return sparse.csr_array((np.ones(len(used)), (self.column[used], used)), shape=(self.size, self.expanded))

    @cached_property
    def _first(self) -> IntArray | None:
        """The first expanded column of each reduced one (d,), where that keeps their order."""
        used = np.flatnonzero(self.column >= 0)
        first = used[np.unique(self.column[used], return_index=True)[1]]
        return first if (np.diff(first) > 0).all() else None  # another order would mix the two triangles

    @cached_property
    def _is_plain(self) -> bool:
        """Whether no two expanded columns share a reduced one, so that folding is mere selection."""
        return np.count_nonzero(self.column >= 0) == self.size

    @property
    def _intrinsics(self) -> IntArray:
        """The reduced columns of each camera's intrinsics (c,i)."""
        width = int(self.block_width[0]) if self.n_cameras else POSE
        return self.column[: self.n_cameras * width].reshape(self.n_cameras, width)[:, POSE:]

    @cached_property
    def lens_owner(self) -> IntArray:
        """For each camera (c,) the first one whose intrinsics are the same unknowns; itself where it is alone."""
        intrinsics = self._intrinsics
        _, first, same = np.unique(intrinsics, axis=0, return_index=True, return_inverse=True)
        return np.where((intrinsics >= 0).any(axis=1), first[same.reshape(-1)], np.arange(self.n_cameras))

    @cached_property
    def _share_all(self) -> bool:
        """Whether cameras that share an intrinsic share all, so that one camera can keep the lens for all."""
        own = self._intrinsics[np.unique(self.lens_owner)]
        used = own[own >= 0]
        return len(np.unique(used)) == len(used)

    def fold_matrix(self, expanded: FloatArray, is_gathered: bool = False) -> FloatArray:
        """The reduced matrix (d, d), valid in its upper triangle, from the upper block triangle of the expanded one.

        `is_gathered`: only the first camera of each `lens_owner` has anything in the lens' columns.
        """
        if self._first is not None and (self._is_plain or (is_gathered and self._share_all)):
            return expanded if self.size == self.expanded else expanded[np.ix_(self._first, self._first)]
        half = self._fold @ symmetric(expanded)
        return np.asarray((self._fold @ half.T).T)

    def fold_vector(self, expanded: FloatArray) -> FloatArray:
        """The reduced vector (d,) from the expanded one."""
        return self._fold @ expanded

    def expand_vector(self, reduced: FloatArray) -> FloatArray:
        """The expanded vector from the reduced one; zero where nothing is estimated."""
        padded = np.append(reduced, 0.0)
        return padded[self.column]

    def expand_rows(self, reduced: FloatArray) -> FloatArray:
        """A reduced matrix (d, m) brought to expanded rows (e, m)."""
        return np.vstack([reduced, np.zeros((1, reduced.shape[1]))])[self.column]


def symmetric(upper: FloatArray) -> FloatArray:
    """The symmetric matrix of which only the upper triangle is valid."""
    full = np.triu(upper)
    full += np.triu(upper, 1).T
    return full


def _layout(problem: Problem) -> Layout:
    n_cameras, intrinsics = problem.n_cameras, problem.intrinsic_columns
    width = np.concatenate(
        [
            np.full(n_cameras, POSE + len(intrinsics)),
            np.full(problem.n_placements, POSE),
            np.full(len(problem.kept_points), 3),
        ]
    )
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
    return Layout(
        n_cameras,
        offset[:-1],
        width,
        int(offset[-1]),
        next_column + int(free.sum()),
        column,
        np.array(prior_columns, dtype=np.int64),
        np.array(prior_camera, dtype=np.int64),
        np.array(prior_intrinsic, dtype=np.int64),
    )


def moved(problem: Problem, state: State, reduced_step: FloatArray, point_step: FloatArray) -> State:
    """The state after a step: reduced unknowns (d,), eliminated points (p,3)."""
    layout, c = problem.layout, problem.n_cameras
    step = layout.expand_vector(reduced_step)
    cameras = step[: c * (POSE + len(problem.intrinsic_columns))].reshape(c, -1)
    rotation, translation = _moved_poses(state.rotation, state.translation, cameras[:, :POSE])
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


def _moved_poses(rotation: FloatArray, translation: FloatArray, step: FloatArray) -> tuple[FloatArray, FloatArray]:
    turn = exp_rotation(step[:, :3])
    return turn @ rotation, np.einsum("cij,cj->ci", turn, translation) + step[:, 3:]


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
