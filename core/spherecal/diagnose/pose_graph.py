"""Which cameras did not move: the images' own poses compared with poses of the cameras and of the placed ball.

Of m images of c cameras and t placements the rig has only c + t - 1 poses. The normal equations that the images left
say how much worse these fit than the images' own: a quadratic form, so that adjustments are small and need no
observations. The amount is chi-square distributed as long as nothing moved. A camera that did gets a second pose; every
camera and every way to part its images in two is tried, the best is kept, and so on. Large moves do no harm, since with
the right one the rest fits.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from spherecal.adjust.parameter_layout import POSE
from spherecal.ball.image_poses import ImagePoses, hang_together
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.diagnose.moves import (
    LEAST_CHANGE_PX,
    TIE,
    Move,
    Scatter,
    alike,
    inflation,
    most_moved,
    move_limit,
    raised,
    taken_up,
)
from spherecal.geometry.rotation import cross_matrix, exp_rotation
from spherecal.geometry.transform import IDENTITY, Pose, Similarity, pose_change

# Levenberg-Marquardt: 5 to 12 steps where the images are parted rightly, up to 60 where they are not. Of all ways to
# part them only those are tried that promise most by linear tests, and only the best of these after a few steps are
# carried on. Where the poses contradict each other more than SMALL times as much as noise lets them, the fit that the
# tests start from may be far off, and all are tried (0.05 mm: up to 10 times; 0.5 mm on rig B: 200 times).
SMALL = 100.0
TRIED, FIRST_STEPS, CARRIED_ON = 8, 8, 4
STEPS, FIRST_DAMPING, LEAST_DAMPING, GROWTH, LAST_DECREASE = 60, 1e-4, 1e-12, 8.0, 1e-4
# A fit ends where an undamped step promises less of the cost: 15 of 20 steps were refused at the minimum before.
LAST_PROMISE = 1e-10
SETTLED_DAMPING = 1e-10
# What is left once the moves are known, over its degrees of freedom: 0.9 to 1.6 where moves are all there is, also with
# lenses that misfit by 0.01 px; 6 to 11 where lenses that misfit by 0.03 px feign moves (rigs A and B).
EXPLAINED = 3.0
# Of chi-square over its degrees of freedom; noise alone leaves more in one of 3 million recordings.
NOISE_SIGMAS = 5.0
# A direction in which an image's pose keeps less of its stiffness, the rig's poses following, says nothing.
LEAST_STIFFNESS = 1e-6
# A move of 20 mm may leave what looks like further ones of 4 % of its statistic.
LEAST_SHARE = 0.05

Split = tuple[int, tuple[int, ...]]  # a camera, and the placements where it was elsewhere


@dataclass(frozen=True)
class PoseComposition:
    """Which poses, counted by sort, make up that of each image (m,): camera @ motion (-1: none) @ ball."""

    camera: IntArray
    ball: IntArray
    motion: IntArray
    cameras: int
    balls: int
    motions: int = 0

    @staticmethod
    def of(images: ImagePoses, splits: tuple[Split, ...] = ()) -> "PoseComposition":
        """Every camera and placement with one pose, but for cameras with second ones, numbered after the others."""
        camera = images.camera.copy()
        for k, split in enumerate(splits):
            camera[images.of(*split)] = images.n_cameras + k
        still = np.full(len(camera), -1)
        counts = images.n_cameras + len(splits), int(images.placement.max()) + 1
        return PoseComposition(camera, images.placement, still, *counts)

    @property
    def unknowns(self) -> int:
        """How many poses are estimated: all but the one that is the world."""
        some = (self.camera, self.ball, self.motion[self.motion >= 0])
        return sum(len(np.unique(each)) for each in some) - 1

    @property
    def freedom(self) -> int:
        """Degrees of freedom: six for each image less six for each unknown pose."""
        return POSE * (len(self.camera) - self.unknowns)


@dataclass(frozen=True)
class Fitted:
    """Poses of the cameras (further ones of split cameras after them), and what they leave of v'Pv.

    `rotation` (k,3,3), `translation` (k,3) of all poses, in the order cameras, balls, motions.
    """

    cost: float
    rotation: FloatArray
    translation: FloatArray
    layout: PoseComposition
    images: ImagePoses

    @cached_property
    def forces(self) -> FloatArray:
        """How the images' own poses pull at the rig, (6m,)."""
        return self.stiffness @ _System(self.images, self.layout).offset((self.rotation, self.translation))

    @cached_property
    def stiffness(self) -> FloatArray:
        """What of the images' normal matrix the rig's poses do not take up, (6m,6m): asked of one fit in a hundred."""
        system = _System(self.images, self.layout)
        return system.stiffness(system.normal_equations((self.rotation, self.translation)))

    def pose(self, which: int | IntArray) -> Pose:
        """One of the poses, or some of them."""
        return self.rotation[which], self.translation[which]

    @property
    def by_ball(self) -> FloatArray:
        """How a motion of the ball in the world changes the images' poses, (m,6,6)."""
        return _by_ball(*self.pose(self.layout.camera))


@dataclass(frozen=True)
class Explained:
    """The moves that explain the images' poses, the fit with them and its `variance_factor`."""

    moves: tuple[Move, ...]
    variance_factor: float
    fitted: Fitted

    @property
    def is_simple(self) -> bool:
        """Whether at most one camera moved, once, and no more than noise is left: no group explains that better."""
        noise = 1 + NOISE_SIGMAS * np.sqrt(2 / self.fitted.layout.freedom)
        return len(self.moves) <= 1 and self.variance_factor <= noise


def explain(images: ImagePoses, context: Context) -> Explained | None:
    """The cameras that moved, the most significant first, at most one more than is credible; None if unknown."""
    tried = [
        (c, tuple(int(images.placement[i]) for i in some))
        for c in range(images.n_cameras)
        for some in alike(np.flatnonzero(images.camera == c))
    ]
    before = fit_layout(images, PoseComposition.of(images))
    if before is None or not tried:
        return None
    steps, most = [_Step((), before, ())], most_moved(images.n_cameras)
    while len({move.camera for move in steps[-1].moves}) <= most and len(steps[-1].moves) <= 2 * most:
        more = _one_more(images, tried, steps[-1], context)
        if more is None:
            break
        steps.append(more)
    last = next((step for step in reversed(steps) if _sure(images, step, move_limit(len(tried)))), steps[0])
    if last.fitted.layout.freedom <= 0:
        return None
    moves = tuple(move for move in last.moves if move.image_change_px >= LEAST_CHANGE_PX)
    return Explained(moves, variance_factor(images, last.fitted), last.fitted)


def variance_factor(images: ImagePoses, fitted: Fitted) -> float:
    """What a fit leaves of v'Pv over its degrees of freedom: 1 where that is noise alone, infinite without freedom."""
    freedom = fitted.layout.freedom
    return fitted.cost / images.variance / freedom if freedom > 0 else np.inf


@dataclass(frozen=True)
class _Step:
    """A fit with some splits, and the moves that they are."""

    splits: tuple[Split, ...]
    fitted: Fitted
    moves: tuple[Move, ...]


def _one_more(images: ImagePoses, tried: list[Split], now: _Step, context: Context) -> _Step | None:
    """The step with the split that explains most; None if it is chance or only an effect of other splits."""
    ways = _promising(images, now.fitted, [way for way in tried if way not in now.splits])
    fits = _fits(images, now, ways, context)
    least = max([move_limit(len(tried)), *(LEAST_SHARE * move.statistic for move in now.moves)])
    if not fits or (now.fitted.cost - fits[0][0].cost) / images.variance <= least:
        return None
    best, way = fits[0]
    near = {c for one, (c, _) in fits if one.cost - best.cost < TIE * images.variance} - {way[0]}
    step = pose_change(best.pose(way[0]), best.pose(images.n_cameras + len(now.splits)))  # to its second pose
    statistic = (now.fitted.cost - best.cost) / images.variance
    change_px = images.change_px(np.flatnonzero(images.of(*way)), step)
    move = Move(*way, statistic, POSE, step, change_px, tuple(sorted(near)))
    return _Step((*now.splits, way), best, (*now.moves, move))


def _sure(images: ImagePoses, step: _Step, limit: float) -> bool:
    """Whether all moves, each leaving what the others do, exceed what differs between the images beside them."""
    scatters = _scatters(images, step.fitted)
    for move in step.moves:
        others = [one for c, one in scatters.items() if c != move.camera]
        if move.statistic <= raised(limit, inflation(scatters[move.camera], others)):
            return False
    return True


def _promising(images: ImagePoses, before: Fitted, ways: list[Split]) -> list[Split]:
    """The ways that explain most by the linear test at a fit, the best first; all if the test is not possible."""
    explained: list[float] = []
    if before.cost > SMALL * POSE * len(images.camera) * images.variance:
        return ways
    for way in ways:
        columns = POSE * np.flatnonzero(images.of(*way))[:, None] + np.arange(POSE)
        force = before.forces[columns].sum(axis=0)
        matrix = before.stiffness[columns[:, None, :, None], columns[None, :, None, :]].sum(axis=(0, 1))
        explained.append(float(force @ np.linalg.pinv(matrix, rcond=1e-9, hermitian=True) @ force))
    return [ways[k] for k in np.argsort(-np.array(explained), kind="stable")[:TRIED]]


def _scatters(images: ImagePoses, fitted: Fitted) -> dict[int, Scatter]:
    """How much the images' poses of each camera differ from the rig's: what poses of their own would explain."""
    out: dict[int, Scatter] = {}
    for c in np.unique(images.camera):
        columns = (POSE * np.flatnonzero(images.camera == c)[:, None] + np.arange(POSE)).ravel()
        force, matrix = fitted.forces[columns], fitted.stiffness[np.ix_(columns, columns)]
        size = 1 / np.sqrt(np.maximum(images.normal[columns, columns], 1e-300))
        squares, dof = taken_up(force, matrix, size, LEAST_STIFFNESS)
        out[int(c)] = squares / images.variance, dof
    return out


def _fits(images: ImagePoses, now: _Step, ways: list[Split], context: Context) -> list[tuple[Fitted, Split]]:
    """The fits with one more split each, the best first."""

    def cost(pair: tuple[Fitted, Split]) -> float:
        return pair[0].cost

    def fitted(some: list[Split], steps: int) -> list[tuple[Fitted, Split]]:
        found = []
        for k, way in enumerate(some):
            context.report("moved cameras", k / len(some))
            found.append((fit_layout(images, PoseComposition.of(images, (*now.splits, way)), steps), way))
        return sorted(((one, way) for one, way in found if one is not None), key=cost)

    rough = fitted(ways, FIRST_STEPS)
    return sorted(fitted([way for _, way in rough[:CARRIED_ON]], STEPS) + rough[CARRIED_ON:], key=cost)


def fit_layout(images: ImagePoses, layout: PoseComposition, steps: int = STEPS) -> Fitted | None:
    """The poses of a layout nearest to the images' own; None where images are not connected."""
    start = _start(images, layout)
    if start is None:
        return None
    system = _System(images, layout)
    poses, damping = start, FIRST_DAMPING
    offset = system.offset(poses)
    cost = float(offset @ images.normal @ offset)
    equations, may_be_minimum = None, False
    for _ in range(steps):
        equations = equations or system.normal_equations(poses)
        # rigs sway so easily that a damped step is small far from the minimum too
        if may_be_minimum and system.promise(equations, offset) < LAST_PROMISE * (images.variance + cost):
            break
        step = system.step(equations, offset, damping)
        trial = system.moved(poses, step)
        there = system.offset(trial)
        new = float(there @ images.normal @ there)
        if not new < cost:
            may_be_minimum = damping <= FIRST_DAMPING
            damping *= GROWTH
            if damping > 1 / FIRST_DAMPING:
                break
            continue
        may_be_minimum = cost - new < LAST_DECREASE * (images.variance + new)
        done = may_be_minimum and damping <= SETTLED_DAMPING
        poses, offset, cost, damping = trial, there, new, max(damping / GROWTH, LEAST_DAMPING)
        if done:
            break
        equations = None
    return Fitted(cost, *poses, layout, images)


Equations = tuple[FloatArray, FloatArray]  # weighted derivatives (6m,u) and the unknowns' normal matrix (u,u)
# Rows and columns of what `_by_ball` fills: a shift turns nothing.
_NOT_ZERO = np.nonzero(np.kron([[1, 0], [1, 1]], np.ones((3, 3))))


def _start(images: ImagePoses, layout: PoseComposition) -> Pose | None:
    """Cameras and balls from one image after the other, those with most points first; the first is the world."""
    still = layout.motion < 0
    cameras: dict[int, Similarity] = {}
    balls = {int(layout.ball[np.argmax(np.where(still, images.points, 0))]): IDENTITY}
    poses = zip(images.rotation, images.translation, strict=True)
    own = [Similarity(1.0, rotation, translation) for rotation, translation in poses]
    at = list(zip(layout.camera.tolist(), layout.ball.tolist(), strict=True))
    for rows in (np.flatnonzero(still), np.arange(len(still))):  # moved images last: they are where they are not
        poses = {at[i]: own[i] for i in rows}
        hang_together(poses, {at[i]: int(images.points[i]) for i in rows}, cameras, balls)
    if not set(layout.camera.tolist()) <= set(cameras) or not set(layout.ball.tolist()) <= set(balls):
        return None
    motions = [IDENTITY] * layout.motions
    for k in range(layout.motions):
        i = int(np.argmax(np.where(layout.motion == k, images.points, -1)))
        motions[k] = cameras[at[i][0]].inverse.after(own[i]).after(balls[at[i][1]].inverse)
    every = [cameras.get(c, IDENTITY) for c in range(layout.cameras)]
    every += [balls.get(t, IDENTITY) for t in range(layout.balls)]
    every += motions
    return np.array([p.rotation for p in every]), np.array([p.translation for p in every])


def _by_ball(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Derivatives (m,6,6) of the images' poses by turns and shifts, in the world, of what cameras at poses see."""
    out = np.zeros((len(rotation), POSE, POSE))
    out[:, :3, :3] = out[:, 3:, 3:] = rotation
    out[:, 3:, :3] = cross_matrix(translation) @ rotation
    return out


class _System:
    """The small adjustment: unknowns are turns and shifts of cameras and, in the world, of the ball and of motions."""

    def __init__(self, images: ImagePoses, layout: PoseComposition) -> None:
        self.images, self.camera = images, layout.camera
        self.ball = layout.cameras + layout.ball
        self.moving = np.flatnonzero(layout.motion >= 0)
        self.motion = layout.cameras + layout.balls + layout.motion[self.moving]
        self.count = layout.cameras + layout.balls + layout.motions
        used = np.isin(np.arange(self.count), np.concatenate([self.camera, self.ball, self.motion]))
        used[self.ball[np.argmax(np.where(layout.motion < 0, images.points, 0))]] = False  # the world
        self.columns = (POSE * np.flatnonzero(used)[:, None] + np.arange(POSE)).ravel()
        self.transposed, self._order = self._pattern()

    def _pattern(self) -> tuple[Any, IntArray]:
        """The transposed derivatives by cameras, ball and motions, sparse, and the order of their numbers."""
        m, place = len(self.camera), np.full(POSE * self.count, -1)
        place[self.columns] = np.arange(len(self.columns))
        every, (of_row, of_column) = POSE * np.arange(m)[:, None], _NOT_ZERO
        own = np.arange(POSE)
        rows = [every + own, every + of_row, every[self.moving] + of_row]
        poses = [(self.camera, own), (self.ball, of_column), (self.motion, of_column)]
        row = np.concatenate([one.ravel() for one in rows])
        column = place[np.concatenate([(POSE * pose[:, None] + within).ravel() for pose, within in poses])]
        order = np.lexsort((column, row))
        order = order[column[order] >= 0]
        begin = np.searchsorted(row[order], np.arange(POSE * m + 1))
        numbers = (np.zeros(len(order)), column[order], begin)
        return sparse.csc_array(numbers, shape=(len(self.columns), POSE * m)), order

    def _seen_by(self, poses: Pose) -> Pose:
        """Poses (m,3,3), (m,3) from the ball's world to the images: the cameras' after the motions."""
        rotation, translation = poses[0][self.camera], poses[1][self.camera].copy()
        translation[self.moving] += np.einsum("nij,nj->ni", rotation[self.moving], poses[1][self.motion])
        rotation[self.moving] = rotation[self.moving] @ poses[0][self.motion]
        return rotation, translation

    def offset(self, poses: Pose) -> FloatArray:
        """Turns and shifts (6m,) that take the images' own poses to the rig's."""
        first, away = self._seen_by(poses)
        there = np.einsum("nij,nj->ni", first, poses[1][self.ball]) + away
        own = self.images.rotation, self.images.translation
        return pose_change(own, (first @ poses[0][self.ball], there)).ravel()

    def normal_equations(self, poses: Pose) -> Equations:
        """The weighted derivatives (6m,u) of the offsets by the unknowns, and the unknowns' normal matrix (u,u).

        The derivatives are sparse, as an image follows two or three poses: with dense ones the search for motions took
        163 s instead of 60 (12 cameras, 25 placements).
        """
        own, (of_row, of_column) = self.camera[self.moving], _NOT_ZERO
        by_ball = _by_ball(*self._seen_by(poses))[:, of_row, of_column]
        by_motion = _by_ball(poses[0][own], poses[1][own])[:, of_row, of_column]
        numbers = np.concatenate([np.ones(POSE * len(self.camera)), by_ball.ravel(), by_motion.ravel()])
        self.transposed.data[:] = numbers[self._order]
        weighted = (self.transposed @ self.images.normal).T
        return weighted, self.transposed @ weighted

    def stiffness(self, equations: Equations) -> FloatArray:
        """The images' normal matrix (6m,6m) past what the unknowns take up; the equations are used up."""
        weighted, matrix = equations
        size = 1 / np.sqrt(np.maximum(matrix.diagonal(), 1e-300))
        weighted *= size
        return (
            self.images.normal
            - weighted @ np.linalg.pinv(matrix * size[:, None] * size, rcond=1e-12, hermitian=True) @ weighted.T
        )

    def step(self, equations: Equations, offset: FloatArray, damping: float) -> FloatArray:
        """The damped Gauss-Newton step (k,6)."""
        step = np.zeros(POSE * self.count)
        step[self.columns] = self._change(equations, offset, damping)[0]
        return step.reshape(-1, POSE)

    def promise(self, equations: Equations, offset: FloatArray) -> float:
        """By how much the cost would fall with an undamped step if all were linear."""
        change, gradient = self._change(equations, offset, SETTLED_DAMPING)
        return -float(gradient @ change)

    @staticmethod
    def _change(equations: Equations, offset: FloatArray, damping: float) -> tuple[FloatArray, FloatArray]:
        """The damped step of the unknowns (u,), and the gradient (u,) of half the cost."""
        weighted, matrix = equations
        gradient = weighted.T @ offset
        size = 1 / np.sqrt(np.maximum(matrix.diagonal(), 1e-300))
        matrix = matrix * size[:, None] * size + damping * np.eye(len(size))
        return -np.linalg.solve(matrix, gradient * size) * size, gradient

    @staticmethod
    def moved(poses: Pose, step: FloatArray) -> Pose:
        """The poses after a step."""
        rotation = exp_rotation(step[:, :3])
        return rotation @ poses[0], np.einsum("kij,kj->ki", rotation, poses[1]) + step[:, 3:]
