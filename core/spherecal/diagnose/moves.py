"""Cameras that moved between placements: a second pose for some images, by Rao's score test of all (score.py)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.special import chdtri

from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.diagnose.score import ScoreTest, change_of, changes_of, spread

# The reference for moves: how much the poses of a camera's images differ without any move. Noise alone makes chi-square
# of them. A lens beyond the model, a point spread that is not Gaussian, or a ball that
# is not quite still shifts every image of a camera a little. The smaller the part of the image that it shares with
# the others, the larger that shift.

# Inflation counts as far as it is sure at this level, so that it is 1 with noise alone.
SURE = 0.05
# The median of n values is as sure as the mean of this share of them.
MEDIAN = 0.64
# A rig of which more cameras than this seem to have moved has another fault (lenses, the ball's shape).
MOST_MOVED_SHARE, MOST_MOVED = 0.15, 2
# What lenses do is not normal: a few images have most of it, so that the limit grows with the square. With smooth
# fields of 0.01 to 0.3 px and high radial orders (demo, rigs A and B) the largest statistic of a recording was up to 8
# times the mean of the inflated chi-square at an inflation of 2.3, and 24 times at 7.3 (dome15, one lens for all).
# Moves of 1 mm beside the fields reach 8 to 20 times: the larger ones alone are then found.
Scatter = tuple[float, int]  # chi-square of how much some images' poses differ, and its degrees of freedom


def inflation(own: Scatter, others: Sequence[Scatter]) -> float:
    """The scatter of images' poses over that of noise, at least 1; as large as that of the worst unmoved camera."""
    known = [one for one in others if one[1] > 0]
    if not known:
        return max(1.0, _at_least(own))
    moved = most_moved(len(known) + 1) - 1
    worst = sorted(_at_least(one) for one in known)[: max(len(known) - moved, 1)][-1]
    return max(1.0, _at_least(own), usual_inflation(known), worst)


def taken_up(force: FloatArray, matrix: FloatArray, size: FloatArray, least: float) -> Scatter:
    """What steps against forces (u,) take off a sum of squares, along axes of the matrix (u,u) with enough curvature.

    `size` (u,): units of the steps; `least`: curvature that counts in them.
    """
    values, axes = np.linalg.eigh(matrix * size[:, None] * size)
    good = values > least
    along = axes[:, good].T @ (force * size)
    return float((along**2 / values[good]).sum()), int(good.sum())


def most_moved(n_cameras: int) -> int:
    """The largest number of cameras that can be concluded to have moved."""
    return max(MOST_MOVED, int(MOST_MOVED_SHARE * n_cameras))


def usual_inflation(scatters: Sequence[Scatter]) -> float:
    """The scatter of the images' poses of most cameras over that of noise, as far as it is certain; 0 without any."""
    known = [one for one in scatters if one[1] > 0]
    if not known:
        return 0.0
    freedom = max(int(MEDIAN * sum(dof for _, dof in known)), 1)
    usual = float(np.median([statistic / dof for statistic, dof in known]))
    return _at_least((usual * freedom, freedom))


def _at_least(scatter: Scatter) -> float:
    statistic, dof = scatter
    return statistic / _sure_chi_square(dof) if dof > 0 else 0.0


@cache  # every camera asks for that of every other
def _sure_chi_square(dof: int) -> float:
    return float(chdtri(dof, SURE))


def raised(limit: float, scatter: float) -> float:
    """The statistic that a move must exceed where poses scatter more than noise explains."""
    return limit * scatter**2


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


@dataclass(frozen=True)
class Move:
    """A camera (index) that was elsewhere in `placements` (indices, at least one, not all that it saw).

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
    """The tests of all cameras: `image` (n,) of each row (-1 where it has too few points) and what is known of each.

    `camera`, `placement`, `points` (m,) belong to the images, `sets` are images that may be from elsewhere together.
    `blocks`: by camera g (6k,), A (6k,6k) and own products (6k,6k) of its k images' poses. `limit`: the statistic that
    a move must exceed.
    """

    image: IntArray
    camera: IntArray
    placement: IntArray
    points: IntArray
    sets: tuple[tuple[int, ...], ...]
    blocks: dict[int, Block]
    limit: float

    @cached_property
    def images_of(self) -> dict[int, IntArray]:
        """The images (k,) of each camera."""
        return {int(c): np.flatnonzero(self.camera == c) for c in np.unique(self.camera)}

    def corrected(self, probe: ScoreTest, given: Sequence[tuple[int, ...]]) -> dict[int, Block]:
        """The blocks with changes of pose of some sets of images eliminated first."""
        if not given:
            return self.blocks
        by_pose = probe.by_pose()
        moved = [by_pose * np.isin(self.image, images)[:, None, None] for images in given]
        left = probe.past_unknowns(np.concatenate(moved, axis=2).reshape(2 * len(by_pose), -1))
        cross = self._by_image(by_pose, left.reshape(len(by_pose), 2, -1))
        force = {c: block[0].reshape(-1, POSE) for c, block in self.blocks.items()}
        g = np.concatenate([sum(self._force(force, i) for i in images) for images in given])
        inner = np.concatenate([cross[list(images)].sum(axis=0) for images in given])
        inverse = np.linalg.pinv(inner, rcond=1e-10, hermitian=True)
        out = {}
        for c, (own_g, a, products) in self.blocks.items():
            own = cross[self.images_of[c]].reshape(len(own_g), -1)
            out[c] = (own_g - own @ (inverse @ g), a - own @ inverse @ own.T, products)
        return out

    def _force(self, force: dict[int, FloatArray], image: int) -> FloatArray:
        camera = int(self.camera[image])
        return force[camera][np.searchsorted(self.images_of[camera], image)]

    def _by_image(self, by_pose: FloatArray, columns: FloatArray) -> FloatArray:
        """Products (m,6,k) of each image's derivatives (n,2,6) with columns (n,2,k)."""
        out = np.zeros((len(self.camera), POSE, columns.shape[2]))
        order = np.argsort(self.image, kind="stable")
        ends = np.searchsorted(self.image[order], np.arange(len(self.camera) + 1))
        for i in range(len(self.camera)):
            rows = order[ends[i] : ends[i + 1]]
            out[i] = by_pose[rows].reshape(-1, POSE).T @ columns[rows].reshape(2 * len(rows), -1)
        return out


def prepare(probe: ScoreTest, placement: IntArray, context: Context | None = None) -> MoveTests | None:
    """Tests of all images of a network, by the placements of its rows (n,); None where no camera has two images."""
    problem = probe.problem
    of_row, camera, at, count = _images(problem.camera, placement)
    sets = [s for c in np.unique(camera) for s in alike(np.flatnonzero(camera == c))]
    if not sets:
        return None
    blocks: dict[int, Block] = {}
    for c in np.unique(camera):
        if context is not None:
            context.check()
        own = np.flatnonzero(camera == c)
        rows = np.flatnonzero((problem.camera == c) & (of_row >= 0))
        shape, image = (2 * len(rows), POSE * len(own)), of_row[rows] - own[0]
        blocks[int(c)] = probe.block(rows, spread(probe.by_pose(rows), POSE * image, shape))
    return MoveTests(of_row, camera, at, count, tuple(sets), blocks, move_limit(len(sets)))


def _images(camera: IntArray, placement: IntArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """The image of each row (n,), -1 where it has too few points, and cameras, placements and points (m,) of images."""
    n_placements = int(placement.max(initial=0)) + 1
    images, image, count = np.unique(camera * n_placements + placement, return_inverse=True, return_counts=True)
    enough = count >= LEAST_POINTS
    number = np.where(enough, np.cumsum(enough) - 1, -1)
    return number[image.reshape(-1)], images[enough] // n_placements, images[enough] % n_placements, count[enough]


def move_limit(tests: int) -> float:
    """The statistic that a move must exceed where so many are tested."""
    return max(LEAST_STATISTIC, float(chdtri(POSE, FALSE_ALARM / tests)))


def alike(images: IntArray) -> list[tuple[int, ...]]:
    """Sets of a camera's images (k,) that may have another pose: each alone, all from one on; no complements."""
    if len(images) < 2:
        return []
    alone = [(int(i),) for i in (images if len(images) > 2 else images[1:])]
    later = [tuple(map(int, images[k:])) for k in range(2, len(images) - 1)]
    return alone + later


def find_moves(probe: ScoreTest, tests: MoveTests) -> list[Move]:
    """Cameras that moved, the most significant first, each tested with those before it already corrected.

    A move counts where it exceeds what noise does and what differs between the other images (`yardstick`). The search
    stops one beyond the number that is credible (see `credible`).
    """
    most = most_moved(probe.problem.n_cameras) + 1
    moves: list[Move] = []
    given: list[tuple[int, ...]] = []
    squares, redundancy = probe.squares, probe.redundancy
    while len({move.camera for move in moves}) < most and len(moves) < 2 * most:
        found = _clearest(probe, tests, given, squares, redundancy)
        if found is None:
            break
        moves.append(found[0])
        given.append(found[1])
        squares, redundancy = squares - found[0].statistic * squares / max(redundancy, 1), redundancy - found[0].dof
    return [move for move in moves if move.image_change_px >= LEAST_CHANGE_PX]


def differ(probe: ScoreTest, tests: MoveTests) -> bool:
    """Whether some images differ more than noise explains, whatever the cause."""
    return bool(_all_sets(tests, tests.blocks, probe.variance)[0].max() > tests.limit)


def _clearest(
    probe: ScoreTest, tests: MoveTests, given: list[tuple[int, ...]], squares: float, redundancy: int
) -> tuple[Move, tuple[int, ...]] | None:
    """The most significant further move and its images; None if there is none."""
    variance = squares / max(redundancy, 1)
    blocks = tests.corrected(probe, given)
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
        shrunk = (squares - float(statistic[i]) * variance) / max(redundancy - int(dof[i]), 1) / variance
        others = tests.corrected(probe, [*given, images])
        scatters = [_scatter(block, shrunk * variance) for c, block in others.items() if c != camera]
        scatter = inflation((own[0] / shrunk, own[1]), scatters)
        if statistic[i] / shrunk > raised(tests.limit, scatter):
            move = _move(probe, tests, images, float(statistic[i]), int(dof[i]), value[i])
            near = of_set[statistic > max(statistic) - TIE]  # sets that explain as much as the best one
            return replace(move, rivals=tuple(sorted({int(c) for c in near} - {camera}))), images
    return None


def _scatter(block: Block, variance: float) -> Scatter:
    """How much the poses of a camera's images differ."""
    change = change_of(*block, variance)
    return change.statistic, change.dof


def scatters(probe: ScoreTest, tests: MoveTests) -> FloatArray:
    """By what factor (c,) the poses of images differ more than noise explains: of a camera, or of most cameras."""
    own = {c: _scatter(block, probe.variance) for c, block in tests.blocks.items()}
    out = np.full(probe.problem.n_cameras, usual_inflation(list(own.values())))
    for c, scatter in own.items():
        out[c] = max(out[c], inflation(scatter, []))
    return np.sqrt(np.maximum(out, 1.0))


def least_visible(probe: ScoreTest, tests: MoveTests) -> FloatArray:
    """Shifts (c,2), in network units, below which a move of a camera would not be seen; NaN where none is tested."""
    out = np.full((probe.problem.n_cameras, 2), np.nan)
    scatters = {c: _scatter(block, probe.variance) for c, block in tests.blocks.items()}
    for c, (_, a, _) in tests.blocks.items():
        scatter = inflation(scatters[c], [one for d, one in scatters.items() if d != c])
        needed = np.array([raised(tests.limit, scatter), tests.limit]) * probe.variance
        weakness = []
        for images in (s for s in tests.sets if tests.camera[s[0]] == c):
            by_shift = np.linalg.eigvalsh(_summed(a, _columns(tests, c, images))[3:, 3:])
            if by_shift[0] > 0:
                weakness.append(float((1 / by_shift).mean()))
        if weakness:
            out[c] = np.sqrt(needed * np.median(weakness))
    return out


def _move(
    probe: ScoreTest, tests: MoveTests, images: tuple[int, ...], statistic: float, dof: int, step: FloatArray
) -> Move:
    camera = int(tests.camera[images[0]])
    own = _summed(tests.blocks[camera][2], _columns(tests, camera, images))  # no two images have a row in common
    weight = probe.problem.weight[probe.problem.camera == camera].mean()
    shift = float(np.sqrt(step @ own @ step / (2 * tests.points[list(images)].sum()))) / weight
    return Move(camera, tuple(int(tests.placement[i]) for i in images), statistic, dof, step, shift)


def rows_of(probe: ScoreTest, placement: IntArray, move: Move) -> tuple[IntArray, BoolArray]:
    """A moved camera's rows in a probe (k,), and whether each is one of those that moved (k,) bool."""
    rows = np.flatnonzero(probe.problem.camera == move.camera)
    return rows, np.isin(placement[rows], move.placements)


def pose_values(probe: ScoreTest, rows: IntArray, moved: BoolArray) -> FloatArray:
    """Derivatives (k,2,6) of a camera's rows by a change of pose of its moved images."""
    return probe.by_pose(rows) * moved[:, None, None]


def confirmed(probe: ScoreTest, placement: IntArray, moves: list[Move]) -> list[Move]:
    """The moves that another form of the network confirms.

    A move may hardly show there, as when two cameras that alone see their points share it. It is then believed as long
    as no other one is refuted: what looks like one move looks like several.
    """
    tried = [(move, *_seen_there(probe, placement, move)) for move in moves]
    refuted = any(expected >= CONFIRMED and found < CONFIRMED for _, expected, found in tried)
    return [move for move, expected, found in tried if found >= CONFIRMED or (expected < CONFIRMED and not refuted)]


def _seen_there(probe: ScoreTest, placement: IntArray, move: Move) -> tuple[float, float]:
    """Chi-square that a move of this size should have in another form of the network, and that which it has."""
    rows, moved = rows_of(probe, placement, move)
    if moved.sum() < LEAST_POINTS:
        return 0.0, 0.0
    block = probe.block(rows, pose_values(probe, rows, moved))
    change = change_of(*block, probe.variance)
    return float(move.step @ block[1] @ move.step) / probe.variance, change.statistic


def credible(moves: list[Move], n_cameras: int) -> bool:
    """Whether few enough cameras moved to conclude that they, and not the others, moved."""
    return len({move.camera for move in moves}) <= most_moved(n_cameras)


def _all_sets(tests: MoveTests, blocks: dict[int, Block], variance: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Tests of all sets (k,) of images, from the cameras' blocks."""
    g, a, own = [], [], []
    for images in tests.sets:
        camera = int(tests.camera[images[0]])
        columns, whole = _columns(tests, camera, images), blocks[camera]
        g.append(whole[0][columns].sum(axis=0))
        a.append(_summed(whole[1], columns))
        own.append(_summed(whole[2], columns))
    return changes_of(np.array(g), np.array(a), np.array(own), variance)


def _columns(tests: MoveTests, camera: int, images: tuple[int, ...]) -> IntArray:
    """Where some images (k of them) have their columns in the camera's block, (k,6)."""
    return POSE * np.searchsorted(tests.images_of[camera], images)[:, None] + np.arange(POSE)


def _summed(matrix: FloatArray, columns: IntArray) -> FloatArray:
    """The sum (6,6) of all blocks of a matrix at columns (k,6)."""
    return matrix[columns[:, None, :, None], columns[None, :, None, :]].sum(axis=(0, 1))
