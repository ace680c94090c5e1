"""Cameras that moved between placements: a second pose for some images of a camera, tested for all of them at once."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import chi2

from spherecal.adjust.problem import POSE
from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.diagnose.score import Given, Probe, Scores, settle, settle_all
from spherecal.diagnose.yardstick import Scatter, inflation, raised

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
# Of the cameras whose images differ most, so many are looked at closer; the one that moved is the first or second.
LOOKED_AT = 3
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


Block = tuple[FloatArray, FloatArray, FloatArray]


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

    @cached_property
    def images_of(self) -> dict[int, IntArray]:
        """The images (k,) of each camera."""
        return {int(c): np.flatnonzero(self.camera == c) for c in np.unique(self.camera)}

    @cached_property
    def blocks(self) -> dict[int, Block]:
        """g (6k,), A (6k,6k) and own products (6k,6k) of each camera's images."""
        columns = {c: self.columns(images) for c, images in self.images_of.items()}
        return {
            c: (self.scores.g[own], self.scores.matrix(own, own), self.scores.products(own))
            for c, own in columns.items()
        }

    def corrected(self, given: Given) -> dict[int, Block]:
        """The blocks with some changes taken out first."""
        if not given.fold.size:
            return self.blocks
        every = np.arange(len(self.scores.g))
        cross = self.scores.matrix(every, given.columns) @ given.fold
        inner = given.fold.T @ cross[given.columns]
        taken = cross @ np.linalg.pinv(inner, rcond=1e-10, hermitian=True)
        g = self.scores.g - taken @ (given.fold.T @ self.scores.g[given.columns])
        out = {}
        for c, (_, a, products) in self.blocks.items():
            own = self.columns(self.images_of[c])
            out[c] = (g[own], a - taken[own] @ cross[own].T, products)
        return out


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

    A move counts where it exceeds what noise does and what differs between the other images (`yardstick`). It stops one
    beyond the number that is credible (`credible` tells).
    """
    given = given or Given.nothing()
    most = most_moved(probe.problem.n_cameras) + 1
    moves: list[Move] = []
    squares, redundancy = probe.squares, probe.redundancy
    while len({move.camera for move in moves}) < most and len(moves) < 2 * most:
        found = _clearest(probe, tests, given, squares, redundancy)
        if found is None:
            break
        move, given, squares, redundancy = found
        moves.append(move)
    return [move for move in moves if move.image_change_px >= LEAST_CHANGE_PX]


def differ(probe: Probe, tests: MoveTests) -> bool:
    """Whether some images differ more than noise lets them, whatever may be the cause."""
    return bool(_all_sets(tests, tests.blocks, probe.variance)[0].max() > tests.limit)


def _clearest(
    probe: Probe, tests: MoveTests, given: Given, squares: float, redundancy: int
) -> tuple[Move, Given, float, int] | None:  # fmt: skip
    """The clearest further move, and what is given and left over with it; None where there is none."""
    variance = squares / max(redundancy, 1)
    blocks = tests.corrected(given)
    statistic, dof, value = _all_sets(tests, blocks, variance)
    of_set = tests.camera[[s[0] for s in tests.sets]]
    best = [int(np.argmax(np.where(of_set == c, statistic, -np.inf))) for c in np.unique(of_set)]
    beyond = [i for i in best if statistic[i] > tests.limit]
    for i in sorted(beyond, key=lambda i: -statistic[i])[:LOOKED_AT]:
        camera, images = int(of_set[i]), tests.sets[i]
        total = _scatter(blocks[camera], variance)
        own = (max(total[0] - float(statistic[i]), 0.0), total[1] - int(dof[i]))
        if statistic[i] <= raised(tests.limit, inflation(own, [])):
            continue
        further = _and(given, tests.columns(images), np.tile(np.eye(POSE), (len(images), 1)))
        left, freedom = squares - float(statistic[i]) * variance, redundancy - int(dof[i])
        after = left / max(freedom, 1)
        others = [_scatter(block, after) for c, block in tests.corrected(further).items() if c != camera]
        scatter = inflation((own[0] * variance / after, own[1]), others)
        if statistic[i] * variance / after > raised(tests.limit, scatter):
            move = _move(probe, tests, images, float(statistic[i]), int(dof[i]), value[i])
            return replace(move, rivals=_rivals(tests, statistic, camera)), further, left, freedom
    return None


def _scatter(block: Block, variance: float) -> Scatter:
    """How much the poses of a camera's images differ."""
    change = settle(*block, variance)
    return change.statistic, change.dof


def least_visible(probe: Probe, tests: MoveTests) -> FloatArray:
    """The shifts (c,2), in network units, below which a move of a camera would not be seen; NaN where none is tested.

    First as its images differ, then as they would with noise alone: in the rms over all directions, and the median over
    the ways to part the camera's images in two.
    """
    out = np.full((probe.problem.n_cameras, 2), np.nan)
    scatters = {c: _scatter(block, probe.variance) for c, block in tests.blocks.items()}
    for c, (_, a, _) in tests.blocks.items():
        scatter = inflation(scatters[c], [one for d, one in scatters.items() if d != c])
        needed = np.array([raised(tests.limit, scatter), tests.limit]) * probe.variance
        weakness = []
        for images in (s for s in tests.sets if tests.camera[s[0]] == c):
            columns = np.searchsorted(tests.images_of[c], images)[:, None] * POSE + np.arange(POSE)
            by_shift = np.linalg.eigvalsh(_summed(a, columns)[3:, 3:])
            if by_shift[0] > 0:
                weakness.append(float((1 / by_shift).mean()))
        if weakness:
            out[c] = np.sqrt(needed * np.median(weakness))
    return out


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


def most_moved(n_cameras: int) -> int:
    """How many cameras may have moved at most for it to be they who did."""
    return max(MOST_MOVED, int(MOST_MOVED_SHARE * n_cameras))


def _and(given: Given, columns: IntArray, fold: FloatArray) -> Given:
    """What is given with another change of pose."""
    return Given(np.concatenate([given.columns, columns]), np.asarray(block_diag(given.fold, fold)))


def credible(moves: list[Move], n_cameras: int) -> bool:
    """Whether so few cameras moved that it is they who did."""
    return len({move.camera for move in moves}) <= most_moved(n_cameras)


def _all_sets(
    tests: MoveTests, blocks: dict[int, Block], variance: float
) -> tuple[FloatArray, IntArray, FloatArray]:  # fmt: skip
    """Tests of all sets (k,) of images, from the cameras' blocks."""
    g, a, own = [], [], []
    for images in tests.sets:
        camera = int(tests.camera[images[0]])
        own_columns = np.searchsorted(tests.images_of[camera], images)[:, None] * POSE + np.arange(POSE)
        whole = blocks[camera]
        g.append(whole[0][own_columns].sum(axis=0))
        a.append(_summed(whole[1], own_columns))
        own.append(_summed(whole[2], own_columns))
    return settle_all(np.array(g), np.array(a), np.array(own), variance)


def _summed(matrix: FloatArray, columns: IntArray) -> FloatArray:
    """The sum (6,6) of all blocks of a matrix at columns (k,6)."""
    return matrix[columns[:, None, :, None], columns[None, :, None, :]].sum(axis=(0, 1))
