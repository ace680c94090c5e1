"""Which cameras stood still: the images' own poses against those of cameras and of a ball that was placed some times.

Of m images of c cameras and t placements the rig has only c + t - 1 poses. How much worse these fit than the images'
own, by the normal equations that the images left (a quadratic form: small adjustments, no observations), is chi-square
distributed as long as nothing moved. A camera that did gets a second pose; every camera and every way to part its
images in two is tried, the best is kept, and so on. Large moves do no harm, since with the right one the rest fits.
"""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust.image_poses import ImagePoses, hang_together
from spherecal.adjust.problem import POSE
from spherecal.arrays import FloatArray, IntArray
from spherecal.context import Context
from spherecal.diagnose.moves import LEAST_CHANGE_PX, TIE, Move, alike, most_moved, move_limit
from spherecal.diagnose.yardstick import Scatter, inflation, raised
from spherecal.geometry.rotation import cross_matrix, exp_rotation, log_rotation
from spherecal.geometry.transform import IDENTITY, Similarity

# Levenberg-Marquardt: 5 to 12 steps where the images are parted rightly, up to 60 where they are not. Of all ways to
# part them only those are tried that promise most by linear tests, and only the best of these after a few steps are
# carried on. Where the poses contradict each other more than SMALL times as much as noise lets them, the fit that the
# tests start from may be far off, and all are tried (0.05 mm: up to 10 times; 0.5 mm on rig B: 200 times).
SMALL = 100.0
TRIED, FIRST_STEPS, CARRIED_ON = 8, 8, 4
STEPS, FIRST_DAMPING, LEAST_DAMPING, GROWTH, LAST_DECREASE = 60, 1e-4, 1e-12, 8.0, 1e-4
# What is left once the moves are known, over its degrees of freedom: 0.9 to 1.6 where moves are all there is, also with
# lenses that misfit by 0.01 px; 6 to 11 where lenses that misfit by 0.03 px feign moves (rigs A and B).
EXPLAINED = 3.0
# A move of 20 mm may leave what looks like further ones of 4 % of its statistic.
LEAST_SHARE = 0.05

Split = tuple[int, tuple[int, ...]]  # a camera, and the placements where it stood elsewhere


@dataclass(frozen=True)
class Fitted:
    """Poses of the cameras (further ones of split cameras after them), and what they leave of v'Pv.

    `block` (m,): the pose that each image has; `left` (m,): what it has of `cost`; `forces` (6m,): how the images' own
    poses pull at the rig; `stiffness` (6m,6m): what of their normal matrix the rig's poses do not take up.
    """

    cost: float
    rotation: FloatArray
    translation: FloatArray
    block: IntArray
    left: FloatArray
    forces: FloatArray
    stiffness: FloatArray


@dataclass(frozen=True)
class Explained:
    """The moves that explain the images' poses, and what is left over its degrees of freedom."""

    moves: tuple[Move, ...]
    left: float


def explain(images: ImagePoses, n_cameras: int, context: Context) -> Explained | None:
    """The cameras that moved, the clearest first, one more than is credible at most; None where nothing can be told."""
    tried = [(c, tuple(int(images.placement[i]) for i in some)) for c in range(n_cameras) for some in _ways(images, c)]
    before = fit(images, n_cameras, ())
    if before is None or not tried:
        return None
    splits: tuple[Split, ...] = ()
    moves: list[Move] = []
    while len({move.camera for move in moves}) <= most_moved(n_cameras) and len(moves) <= 2 * most_moved(n_cameras):
        ways = _promising(images, before, [way for way in tried if way not in splits])
        fits = _fits(images, n_cameras, splits, ways, context)
        least = max([move_limit(len(tried)), *(LEAST_SHARE * move.statistic for move in moves)])
        if not fits or (before.cost - fits[0][0].cost) / images.variance <= least:
            break
        best, way = fits[0]
        others = _scatters(images, best)
        statistic = (before.cost - best.cost) / images.variance
        if statistic <= raised(move_limit(len(tried)), inflation(others.pop(way[0]), list(others.values()))):
            break
        near = {c for one, (c, _) in fits if one.cost - best.cost < TIE * images.variance}
        moves.append(_move(images, n_cameras + len(splits), before, best, way, tuple(sorted(near - {way[0]}))))
        splits, before = (*splits, way), best
    unknowns = len(set(images.camera.tolist())) + len(splits) + len(set(images.placement.tolist())) - 1
    freedom = POSE * (len(images.camera) - unknowns)
    told = tuple(move for move in moves if move.image_change_px >= LEAST_CHANGE_PX)
    return Explained(told, before.cost / images.variance / freedom) if freedom > 0 else None


def _promising(images: ImagePoses, before: Fitted, ways: list[Split]) -> list[Split]:
    """The ways that explain most by the linear test at a fit, the best first; all where that says nothing."""
    explained: list[float] = []
    if before.cost > SMALL * POSE * len(images.camera) * images.variance:
        return ways
    for camera, placements in ways:
        own = np.flatnonzero((images.camera == camera) & np.isin(images.placement, placements))
        columns = POSE * own[:, None] + np.arange(POSE)
        force = before.forces[columns].sum(axis=0)
        matrix = before.stiffness[columns[:, None, :, None], columns[None, :, None, :]].sum(axis=(0, 1))
        explained.append(float(force @ np.linalg.pinv(matrix, rcond=1e-9, hermitian=True) @ force))
    return [ways[k] for k in np.argsort(-np.array(explained), kind="stable")[:TRIED]]


def _scatters(images: ImagePoses, fitted: Fitted) -> dict[int, Scatter]:
    """How much the images' poses of each camera differ from the rig's."""
    count = len(images.camera)
    by_placement = (len(set(images.placement.tolist())) - 1) / count  # each image's share in the placements' poses
    out: dict[int, Scatter] = {}
    for c in np.unique(images.camera):
        own = images.camera == c
        left = max(float(fitted.left[own].sum()), 0.0) / images.variance
        freedom = own.sum() * (1 - by_placement) - len(np.unique(fitted.block[own]))
        out[int(c)] = (left, max(int(POSE * freedom), 0))
    return out


def _fits(
    images: ImagePoses, n_cameras: int, splits: tuple[Split, ...], ways: list[Split], context: Context
) -> list[tuple[Fitted, Split]]:  # fmt: skip
    """The fits with one more split each, the best first."""

    def cost(pair: tuple[Fitted, Split]) -> float:
        return pair[0].cost

    def fitted(some: list[Split], steps: int) -> list[tuple[Fitted, Split]]:
        found = []
        for k, way in enumerate(some):
            context.report("moved cameras", k / len(some))
            found.append((fit(images, n_cameras, (*splits, way), steps), way))
        return sorted(((one, way) for one, way in found if one is not None), key=cost)

    rough = fitted(ways, FIRST_STEPS)
    return sorted(fitted([way for _, way in rough[:CARRIED_ON]], STEPS) + rough[CARRIED_ON:], key=cost)


def _ways(images: ImagePoses, camera: int) -> list[tuple[int, ...]]:
    return alike(np.flatnonzero(images.camera == camera))


def _move(
    images: ImagePoses, block: int, before: Fitted, after: Fitted, way: Split, rivals: tuple[int, ...]
) -> Move:  # fmt: skip
    """The last split as a move; `block` is its second pose."""
    camera, placements = way
    rotation, translation = after.rotation, after.translation
    turn = rotation[block] @ rotation[camera].T
    step = np.concatenate([log_rotation(turn[None])[0], translation[block] - turn @ translation[camera]])
    own = np.flatnonzero((images.camera == camera) & np.isin(images.placement, placements))
    squares = float(np.einsum("i,nij,j->", step, images.by_pose_px2[own], step))
    change_px = float(np.sqrt(squares / (2 * images.points[own].sum())))
    return Move(camera, placements, (before.cost - after.cost) / images.variance, POSE, step, change_px, rivals)


def fit(images: ImagePoses, n_cameras: int, splits: tuple[Split, ...], steps: int = STEPS) -> Fitted | None:
    """The rig nearest to the images' poses, some cameras with second poses; None where images do not hang together."""
    block = images.camera.copy()
    for k, (camera, placements) in enumerate(splits):
        block[(images.camera == camera) & np.isin(images.placement, placements)] = n_cameras + k
    blocks = n_cameras + len(splits)
    start = _start(images, block, blocks)
    if start is None:
        return None
    system = _System(images, block, blocks)
    poses, damping = start, FIRST_DAMPING
    offset = system.offset(poses)
    cost = float(offset @ images.normal @ offset)
    for _ in range(steps):
        step = system.step(poses, offset, damping)
        trial = system.moved(poses, step)
        there = system.offset(trial)
        new = float(there @ images.normal @ there)
        if not new < cost:
            damping *= GROWTH
            if damping > 1 / FIRST_DAMPING:
                break
            continue
        done = cost - new < LAST_DECREASE * (images.variance + new)
        poses, offset, cost, damping = trial, there, new, max(damping / GROWTH, LEAST_DAMPING)
        if done:
            break
    forces = images.normal @ offset
    left = (offset * forces).reshape(-1, POSE).sum(axis=1)
    return Fitted(cost, poses[0][:blocks], poses[1][:blocks], block, left, forces, system.stiffness(poses))


Poses = tuple[FloatArray, FloatArray]  # rotations (k,3,3) and translations (k,3): of the cameras, then the placements


def _start(images: ImagePoses, block: IntArray, blocks: int) -> Poses | None:
    """Cameras and placements from one image after the other, those with most points first; the first is the world."""
    cameras: dict[int, Similarity] = {}
    placements = {int(images.placement[np.argmax(images.points)]): IDENTITY}
    at = list(zip(block.tolist(), images.placement.tolist(), strict=True))
    poses = {
        key: Similarity(1.0, turn, shift)
        for key, turn, shift in zip(at, images.rotation, images.translation, strict=True)
    }
    hang_together(poses, dict(zip(at, images.points.tolist(), strict=True)), cameras, placements)
    if not set(block.tolist()) <= set(cameras) or not set(images.placement.tolist()) <= set(placements):
        return None
    n_placements = int(images.placement.max()) + 1
    every = [cameras.get(c, IDENTITY) for c in range(blocks)]
    every += [placements.get(t, IDENTITY) for t in range(n_placements)]
    return np.array([p.rotation for p in every]), np.array([p.translation for p in every])


class _System:
    """The small adjustment: unknowns are turns and shifts of the camera poses and, in the world, of the placements."""

    def __init__(self, images: ImagePoses, block: IntArray, blocks: int) -> None:
        self.images, self.block, self.placement = images, block, blocks + images.placement
        count, m = blocks + int(images.placement.max()) + 1, len(block)
        used = np.isin(np.arange(count), np.concatenate([block, self.placement]))
        used[blocks + images.placement[np.argmax(images.points)]] = False  # the world
        self.columns = (POSE * np.flatnonzero(used)[:, None] + np.arange(POSE)).ravel()
        self.count = count
        self.jacobian = np.zeros((m, POSE, count, POSE))
        self.jacobian[np.arange(m), :, block] = np.eye(POSE)

    def offset(self, poses: Poses) -> FloatArray:
        """Turns and shifts (6m,) that take the images' own poses to the rig's."""
        rotation, translation = poses
        first, second = rotation[self.block], rotation[self.placement]
        turn = first @ second @ self.images.rotation.transpose(0, 2, 1)
        there = np.einsum("nij,nj->ni", first, translation[self.placement]) + translation[self.block]
        shift = there - np.einsum("nij,nj->ni", turn, self.images.translation)
        return np.concatenate([log_rotation(turn), shift], axis=1).ravel()

    def derivatives(self, poses: Poses) -> FloatArray:
        """The offsets' derivatives by the unknowns (6m,u)."""
        rotation, translation = poses[0][self.block], poses[1][self.block]
        by_placement = np.zeros((len(rotation), POSE, POSE))
        by_placement[:, :3, :3] = by_placement[:, 3:, 3:] = rotation
        by_placement[:, 3:, :3] = cross_matrix(translation) @ rotation
        self.jacobian[np.arange(len(rotation)), :, self.placement] = by_placement
        return self.jacobian.reshape(POSE * len(rotation), -1)[:, self.columns]

    def stiffness(self, poses: Poses) -> FloatArray:
        """The images' normal matrix (6m,6m) past what the unknowns take up."""
        jacobian = self.derivatives(poses)
        weighted = self.images.normal @ jacobian
        matrix = jacobian.T @ weighted
        size = 1 / np.sqrt(np.maximum(matrix.diagonal(), 1e-300))
        weighted *= size
        return self.images.normal - weighted @ np.linalg.pinv(
            matrix * size[:, None] * size, rcond=1e-12, hermitian=True
        ) @ weighted.T  # fmt: skip

    def step(self, poses: Poses, offset: FloatArray, damping: float) -> FloatArray:
        """The damped Gauss-Newton step (k,6)."""
        jacobian = self.derivatives(poses)
        weighted = self.images.normal @ jacobian
        matrix, gradient = jacobian.T @ weighted, weighted.T @ offset
        size = 1 / np.sqrt(np.maximum(matrix.diagonal(), 1e-300))
        matrix = matrix * size[:, None] * size + damping * np.eye(len(size))
        step = np.zeros(POSE * self.count)
        step[self.columns] = -np.linalg.solve(matrix, gradient * size) * size
        return step.reshape(-1, POSE)

    @staticmethod
    def moved(poses: Poses, step: FloatArray) -> Poses:
        """The poses after a step."""
        turn = exp_rotation(step[:, :3])
        return turn @ poses[0], np.einsum("kij,kj->ki", turn, poses[1]) + step[:, 3:]
