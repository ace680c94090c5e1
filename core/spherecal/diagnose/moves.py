"""Cameras that moved between placements: a second pose for some images of a camera, tested for all of them at once."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import chi2

from spherecal.adjust.problem import POSE
from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.diagnose.score import Given, Probe, Scores, conditional, settle, settle_all

# chi-square (6 degrees of freedom) that noise exceeds in 4 of 100,000 tests; with it 0.05 mm and 50 urad are seen on
# rigs A and B before lengths suffer. More tests raise it, so that noise moves a camera in one of
# 500 recordings.
LEAST_STATISTIC = 30.0
FALSE_ALARM = 0.002
# Moves that shift image points by less are no moves: what detection errs by alike in one image reaches that (0.005 px,
# rendered images of the demo), and lengths suffer from none. 0.05 mm and 50 urad shift them by 0.02 to 0.1 px.
LEAST_CHANGE_PX = 0.01
# What a move found in the rigid form must reach in the free one, where a changed ball cannot feign it (1 in 350).
CONFIRMED = 20.0
# Where all lenses misfit, no polynomial follows them quite; what is left reached 115 at a median of 25 among cameras.
STANDS_OUT = 6.0
# Fewer image points than this in an image test nothing.
LEAST_POINTS = 8
# Two cameras that alone see their common points share a move: their statistics differ by less than 0.1 (rig B, free
# form); this is a likelihood of one in twenty.
TIE = 6.0
# A rig of which more cameras than this seem to have moved has another fault (lenses, the ball's shape).
MOST_MOVED_SHARE, MOST_MOVED = 0.15, 2


@dataclass(frozen=True)
class Move:
    """A camera (index) that stood elsewhere in `placements` (indices, at least one, not all that it saw).

    `step` (6,) its change of pose there (rotation, shift in network units), `statistic` chi-square on `dof`.
    `image_change_px` is by how much that shifts its image points (rms per axis). `rivals`: cameras whose move would
    explain the observations as well.
    """

    camera: int
    placements: tuple[int, ...]
    statistic: float
    dof: int
    step: FloatArray
    image_change_px: float
    rivals: tuple[int, ...] = ()


@dataclass(frozen=True)
class MoveTests:
    """The tests of all cameras: columns of every image and the sets of images that may stand elsewhere together."""

    scores: Scores
    camera: IntArray
    placement: IntArray
    points: IntArray
    sets: tuple[tuple[int, ...], ...]
    limit: float

    def columns(self, images: tuple[int, ...] | IntArray) -> IntArray:
        """The tested columns of some images, (k*6,)."""
        return (POSE * np.asarray(images)[:, None] + np.arange(POSE)).ravel()


def prepare(probe: Probe, placement: IntArray) -> MoveTests | None:
    """Tests of all images of a network; placement (n,): of each of its rows. None where no camera has two images."""
    problem = probe.problem
    n_placements = int(placement.max(initial=0)) + 1
    key = problem.camera * n_placements + placement
    images, image, count = np.unique(key, return_inverse=True, return_counts=True)
    enough = count >= LEAST_POINTS
    number = np.where(enough, np.cumsum(enough) - 1, -1)
    images = images[enough]
    camera, at = images // n_placements, images % n_placements
    sets = [s for c in np.unique(camera) for s in alike(np.flatnonzero(camera == c))]
    if not sets:
        return None
    column = number[image.reshape(-1)]
    column = np.where(column >= 0, POSE * column, -1)
    scores = probe.scores(probe.rows(probe.linear.by_camera[:, :, :POSE], column, POSE * len(images)))
    return MoveTests(scores, camera, at, count[enough], tuple(sets), move_limit(len(sets)))


def move_limit(tests: int) -> float:
    """The statistic that a move must exceed where so many are tested."""
    return max(LEAST_STATISTIC, float(chi2.isf(FALSE_ALARM / tests, POSE)))


def alike(images: IntArray) -> list[tuple[int, ...]]:
    """Sets of a camera's images (k,), in order of time, that may have another pose: each alone, all from one on.

    A set and its complement are the same test, since the camera's own pose is estimated.
    """
    if len(images) < 2:
        return []
    alone = [(int(i),) for i in (images if len(images) > 2 else images[1:])]
    later = [tuple(map(int, images[k:])) for k in range(2, len(images) - 1)]
    return alone + later


def find_moves(probe: Probe, tests: MoveTests, given: Given | None = None) -> list[Move]:
    """Cameras that moved, the clearest first, each tested with those before it (and `given`) already corrected.

    It stops one beyond the number that is credible (`credible` tells).
    """
    given = given or Given.nothing()
    most = most_moved(probe.problem.n_cameras) + 1
    moves: list[Move] = []
    squares, redundancy = probe.squares, probe.redundancy
    while len({move.camera for move in moves}) < most and len(moves) < 2 * most:
        variance = squares / max(redundancy, 1)
        statistic, dof, value = _all_sets(tests, given, variance)
        best = int(np.argmax(statistic))
        if not statistic[best] > tests.limit:
            break
        images = tests.sets[best]
        move = _move(probe, tests, images, float(statistic[best]), int(dof[best]), value[best])
        moves.append(replace(move, rivals=_rivals(tests, statistic, move.camera)))
        given = _and(given, tests.columns(images), np.tile(np.eye(POSE), (len(images), 1)))
        squares, redundancy = squares - statistic[best] * variance, redundancy - int(dof[best])
    return [move for move in moves if move.image_change_px >= LEAST_CHANGE_PX]


def _rivals(tests: MoveTests, statistic: FloatArray, camera: int) -> tuple[int, ...]:
    """Cameras of sets of images that explain as much as the best one, the camera's own."""
    near = [tests.camera[s[0]] for s, value in zip(tests.sets, statistic, strict=True) if value > max(statistic) - TIE]
    return tuple(sorted({int(c) for c in near} - {camera}))


def _move(
    probe: Probe, tests: MoveTests, images: tuple[int, ...], statistic: float, dof: int, step: FloatArray
) -> Move:
    columns = tests.columns(images)
    own = tests.scores.products(columns)
    change = np.tile(step, len(images))
    camera = int(tests.camera[images[0]])
    weight = probe.problem.weight[probe.problem.camera == camera].mean()
    shift = float(np.sqrt(change @ own @ change / (2 * tests.points[list(images)].sum()))) / weight
    return Move(camera, tuple(int(tests.placement[i]) for i in images), statistic, dof, step, shift)


def rows_of(probe: Probe, placement: IntArray, move: Move) -> tuple[IntArray, BoolArray]:
    """A moved camera's rows in a probe (k,), and whether each is one of those that moved (k,) bool."""
    rows = np.flatnonzero(probe.problem.camera == move.camera)
    return rows, np.isin(placement[rows], move.placements)


def pose_values(probe: Probe, rows: IntArray, moved: BoolArray) -> FloatArray:
    """Derivatives (k,2,6) of a camera's rows by a change of pose of its moved images."""
    return probe.linear.by_camera[rows, :, :POSE] * moved[:, None, None]


def confirmed(probe: Probe, placement: IntArray, moves: list[Move]) -> list[Move]:
    """The moves that another form of the network bears out; placement (n,) of the probe's rows.

    A move that would hardly show there (two cameras that alone see their points share it) is believed as long as no
    other one is refuted: what feigns one move feigns several.
    """
    tried = [(move, *_seen_there(probe, placement, move)) for move in moves]
    refuted = any(expected >= CONFIRMED and found < CONFIRMED for _, expected, found in tried)
    return [move for move, expected, found in tried if found >= CONFIRMED or (expected < CONFIRMED and not refuted)]


def _seen_there(probe: Probe, placement: IntArray, move: Move) -> tuple[float, float]:
    """Chi-square that a move of this size should have in another form of the network, and what it has."""
    rows, moved = rows_of(probe, placement, move)
    if moved.sum() < LEAST_POINTS:
        return 0.0, 0.0
    block = probe.block(rows, pose_values(probe, rows, moved))
    change = settle(*block, probe.variance)
    return float(move.step @ block[1] @ move.step) / probe.variance, change.statistic


def moves_beside(
    probe: Probe, placement: IntArray, tests: MoveTests, fields: dict[int, FloatArray]
) -> list[Move]:  # fmt: skip
    """Moves that stand out when each camera's own misfit is corrected for; fields: derivatives (k,2,m) of its rows.

    One for each camera at most.
    """
    best: list[Move] = []
    for camera, values in fields.items():
        rows = np.flatnonzero(probe.problem.camera == camera)
        found = []
        for images in (s for s in tests.sets if tests.camera[s[0]] == camera):
            moved = np.isin(placement[rows], tests.placement[list(images)])
            block = probe.block(rows, np.concatenate([values, pose_values(probe, rows, moved)], axis=2))
            change = settle(*conditional(*block, np.arange(values.shape[2])), probe.variance)
            found.append(_move(probe, tests, images, change.statistic, change.dof, change.value))
        best += [max(found, key=lambda move: move.statistic)] if found else []
    usual = float(np.median([move.statistic for move in best])) if best else 0.0
    return [move for move in best if move.statistic > max(tests.limit, STANDS_OUT * usual)]


def most_moved(n_cameras: int) -> int:
    """How many cameras may have moved at most for it to be they who did."""
    return max(MOST_MOVED, int(MOST_MOVED_SHARE * n_cameras))


def _and(given: Given, columns: IntArray, fold: FloatArray) -> Given:
    """What is given with another change of pose."""
    return Given(np.concatenate([given.columns, columns]), np.asarray(block_diag(given.fold, fold)))


def credible(moves: list[Move], n_cameras: int) -> bool:
    """Whether so few cameras moved that it is they who did."""
    return len({move.camera for move in moves}) <= most_moved(n_cameras)


def _all_sets(tests: MoveTests, given: Given, variance: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Tests of all sets (k,) once what is given is corrected for."""
    g, a, own = [], [], []
    images_of = {int(c): np.flatnonzero(tests.camera == c) for c in np.unique(tests.camera)}
    blocks = {c: tests.scores.corrected(tests.columns(images), given) for c, images in images_of.items()}
    for images in tests.sets:
        camera = int(tests.camera[images[0]])
        own_columns = np.searchsorted(images_of[camera], images)[:, None] * POSE + np.arange(POSE)
        whole = blocks[camera]
        g.append(whole[0][own_columns].sum(axis=0))
        a.append(_summed(whole[1], own_columns))
        own.append(_summed(whole[2], own_columns))
    return settle_all(np.array(g), np.array(a), np.array(own), variance)


def _summed(matrix: FloatArray, columns: IntArray) -> FloatArray:
    """The sum (6,6) of all blocks of a matrix at columns (k,6)."""
    return matrix[columns[:, None, :, None], columns[None, :, None, :]].sum(axis=(0, 1))
