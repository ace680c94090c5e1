"""The ball as one rigid object: X = R_t S + T_t instead of a new point for every dot at every placement.

The free network places the dots of each placement; dots that two placements share give the motion between them. From
then on the unknowns are the ball's shape and one pose for each further placement. That strengthens the network (bars'
calibration error 11 to 17 times smaller on rigs A and B) and links cameras that never see the same side. See
docs/decisions/0006-rigid-ball.md.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable, Rigid
from spherecal.adjust.bundle import Adjustment
from spherecal.adjust.datum import Places
from spherecal.adjust.network import Network
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray, blocks_of_groups, sum_by
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Features
from spherecal.geometry.rotation import log_rotation
from spherecal.geometry.transform import IDENTITY, Similarity, fit_similarity

# Dots and targets that two placements must share to be aligned. 23 dots were enough to start on rigs A and B; fewer
# than three targets have their dots so close together that the turn is noise.
LEAST_SHARED, LEAST_TARGETS = 12, 3
# Dots farther from the aligned ones than this many times the median are blunders; normal ones stay below 4.
BLUNDER = 6.0


@dataclass(frozen=True)
class Alignment:
    """How the placements of a network are connected by dots they share, counted in `shared` (t,t).

    `root` (t,): the placement in whose frame each one's ball is described, itself where it shares too little;
    `rotation` (t,3,3), `translation` (t,3) carry that ball to the placement.
    """

    root: IntArray
    rotation: FloatArray
    translation: FloatArray
    shared: IntArray

    @property
    def moved(self) -> BoolArray:
        """Placements (t,) that have a pose to estimate."""
        return self.root != np.arange(len(self.root))

    @property
    def turned_deg(self) -> FloatArray:
        """The angle (k,) by which the ball is turned at each moved placement, against its root, degrees."""
        return np.rad2deg(np.linalg.norm(log_rotation(self.rotation[self.moved]), axis=1))


@dataclass(frozen=True)
class RigidNetwork:
    """A network of dots of the ball; `feature` (n,) is what each observation shows in the free network."""

    network: Network
    places: Places
    alignment: Alignment
    feature: IntArray

    def as_features(self, state: State) -> State:
        """The state with a point for every feature of the free network, where its placement moves it."""
        rotation = state.placement_rotation[self.places.placement]
        points = np.einsum("fij,fj->fi", rotation, state.points[self.places.point])
        points += state.placement_translation[self.places.placement]
        if len(state.shape_residual):
            points += state.shape_residual
        return state.free(points)

    def softened(self, shape_sd: float) -> "RigidNetwork":
        """The same ball with some shape noise (see Deformable) of the dots that may be seen at two placements."""
        seen = np.bincount(self.places.point, minlength=self.network.n_features)
        own = np.where(seen[self.places.point] > 1, shape_sd, 0.0)  # a bar's marks have none
        ball = self.network.ball
        deformable = Deformable(ball.placement, ball.free_placement, self.feature, own)
        return replace(self, network=replace(self.network, ball=deformable))


@dataclass(frozen=True)
class BallNetwork:
    """A free network of the dots of a ball, before the ball's shape joins its placements.

    `network` has no priors. `candidates` (n,): the observations to use, with those of cameras that only the ball's
    shape may link. The first `n_ball` of the placements are the ball's, the rest a bar's.
    """

    network: Network
    features: Features
    n_placements: int
    n_ball: int
    candidates: BoolArray

    def aligned(self, points: FloatArray) -> Alignment:
        """How the placements are connected by the dots that `points` (f,3) locates."""
        return align(self.features, points, self.n_placements, self.n_ball)


def align(features: Features, points: FloatArray, n_placements: int, n_ball: int) -> Alignment:
    """How the ball's placements are connected by shared dots (points (f,3)): a tree of the pairs with most of them."""
    dots, number = np.unique(np.stack([features.target, features.point], axis=1), axis=0, return_inverse=True)
    place, ball = np.full((n_ball, len(dots), 3), np.nan), features.placement < n_ball
    place[features.placement[ball], number.reshape(-1)[ball]] = points[ball]
    known = np.isfinite(place[:, :, 0])
    counts = known.astype(np.int64) @ known.T
    np.fill_diagonal(counts, 0)
    root = np.arange(n_placements)
    rotation, translation = np.tile(np.eye(3), (n_placements, 1, 1)), np.zeros((n_placements, 3))
    for t, (start, motion) in _outward(counts, _tree(counts, place, known, dots[:, 0])).items():
        root[t], rotation[t], translation[t] = start, motion.rotation, motion.translation
    shared = np.zeros((n_placements, n_placements), dtype=np.int64)
    shared[:n_ball, :n_ball] = counts
    return Alignment(root, rotation, translation, shared)


def _tree(shared: IntArray, place: FloatArray, known: BoolArray, target: IntArray) -> dict[tuple[int, int], Similarity]:
    """Motions (s, t), s < t, of a spanning tree (J. Kruskal, 1956) of the pairs that share most and agree."""
    part = np.arange(len(shared))
    first, second = np.triu_indices(len(shared), 1)
    order = np.argsort(-shared[first, second], kind="stable")
    motions: dict[tuple[int, int], Similarity] = {}
    for s, t in zip(first[order], second[order], strict=True):
        if part[s] == part[t] or shared[s, t] < LEAST_SHARED:
            continue
        common = known[s] & known[t]
        motion = fit_motion(place[s, common], place[t, common], target[common], with_scale=False)
        if motion is not None:
            motions[int(s), int(t)] = motion
            part[part == part[t]] = part[s]
    return motions


def fit_motion(source: FloatArray, goal: FloatArray, tags: IntArray, with_scale: bool) -> Similarity | None:
    """The motion of dots from one placement (n,3) to another (n,3), None where too few agree; `tags`: their targets."""
    if len(source) < LEAST_SHARED:
        return None
    motion = fit_similarity(source, goal, with_scale)
    keep = np.ones(len(source), dtype=bool)
    for _ in range(5):
        off = np.linalg.norm(motion.apply(source) - goal, axis=1)
        keep = off <= BLUNDER * np.median(off[keep]) + 1e-12
        if keep.sum() < LEAST_SHARED or len(np.unique(tags[keep])) < LEAST_TARGETS:
            return None
        motion = fit_similarity(source[keep], goal[keep], with_scale)
    return motion


def _outward(shared: IntArray, motions: dict[tuple[int, int], Similarity]) -> dict[int, tuple[int, Similarity]]:
    """For every placement in a tree, its root and the motion of the ball from the root to it."""
    both = {**motions, **{(t, s): motion.inverse for (s, t), motion in motions.items()}}
    carried: dict[int, tuple[int, Similarity]] = {}
    for start in np.argsort(-shared.sum(axis=1), kind="stable").tolist():
        if start in carried or not any(a == start for a, _ in both):
            continue
        carried[start] = (start, IDENTITY)
        waiting = [start]
        while waiting:
            s = waiting.pop(0)
            for (a, t), motion in both.items():
                if a == s and t not in carried:
                    carried[t] = (start, motion.after(carried[s][1]))
                    waiting.append(t)
    return carried


def share_shape(network: Network, features: Features, state: State, alignment: Alignment) -> tuple[RigidNetwork, State]:
    """The rigid network of a free one, and its start: cameras, placements as aligned, points unknown (NaN)."""
    block = np.zeros(len(alignment.root), dtype=np.int64)
    block[alignment.moved] = 1 + np.arange(alignment.moved.sum())  # block 0 is the world
    keys = np.stack([alignment.root[features.placement], features.target, features.point], axis=1)
    dots, point = np.unique(keys, axis=0, return_inverse=True)
    point = point.reshape(-1)
    ball = Rigid(block[features.placement][network.feature], np.arange(1 + alignment.moved.sum()) > 0)
    rigid = replace(network, feature=point[network.feature], n_features=len(dots), ball=ball)
    turned = np.concatenate([np.eye(3)[None], alignment.rotation[alignment.moved]])
    shifted = np.concatenate([np.zeros((1, 3)), alignment.translation[alignment.moved]])
    start = replace(state, points=np.full((len(dots), 3), np.nan))
    start = replace(start, placement_rotation=turned, placement_translation=shifted)
    return RigidNetwork(rigid, Places(point, block[features.placement]), alignment, network.feature), start


# --- Whether cameras agree on how the dots of a ball moved between placements, or only their lenses do not fit ---
#
# Where the rigid form fits worse than free points, either the ball changed its shape or the cameras err: a lens
# beyond its model, a pose that drifts. Let r_i be the residual of view i of a dot at one placement in the rigid form,
# B_i its derivatives by the dot and H_ij = B_i (B'B)^-1 B_j'. A separate place for the dot there reduces the sum of
# squares by sum_ij r_i' H_ij r_j. A dot that moved contributes to the terms i = j and to those between cameras;
# errors of single cameras contribute only to the former. The terms between cameras are therefore compared with their
# expectation for noise. See docs/decisions/0011-ball-or-lenses.md.

# The part on which cameras agree, over the noise's share of the squares. Of balls bent by 0.05 to 0.2 mm on rigs A, B
# and random ones 0.52 to 49 (by 0.01 to 0.03 mm 0.05 to 0.4: lengths are then as good in either form). Of 112 realistic
# recordings with lenses beyond their model 299 are below: the adjustment spreads their errors over poses and shape.
LEAST_AGREED = 0.4
SURE = 3.0
# Least over greatest eigenvalue of a dot's B'B: rays that cross at less than about half a degree do not locate it.
_LEAST_SHARE = 1e-4


@dataclass(frozen=True)
class Agreement:
    """The part of the excess that cameras agree on, in units of the noise's share, and its standard uncertainty."""

    value: float
    sd: float

    @property
    def is_certain(self) -> bool:
        """Whether the dots moved."""
        return self.value > max(LEAST_AGREED, SURE * self.sd)


def agreement(rigid: Adjustment, feature: IntArray, free_variance: float) -> Agreement:
    """How far cameras agree on motions of dots; (0, inf) where no dot is seen at two placements."""
    problem = rigid.problem
    feature = feature[rigid.rows]
    sums = np.zeros(4)
    for first, last in blocks_of_groups(problem.point_start):
        rows = slice(int(problem.point_start[first]), int(problem.point_start[last]))
        linear = engine.linearise(problem.select(rows), rigid.state, None)
        sums += _terms(linear.by_point, linear.residual, problem.point[rows] - first, feature[rows])
    agreed, between, own, scatter = sums
    if not own > 0:
        return Agreement(0.0, np.inf)
    noise = free_variance * own
    return Agreement(float((agreed - free_variance * between) / noise), float(np.sqrt(2 * scatter) / own))


def _terms(by_point: FloatArray, residual: FloatArray, point: IntArray, feature: IntArray) -> FloatArray:
    """Sums over the places of dots: terms between cameras, and of unit noise their sum, own share, half scatter."""
    group, at = np.unique(feature, return_inverse=True)
    at = at.reshape(-1)
    n_points = int(point.max(initial=-1)) + 1
    square = np.einsum("nki,nkj->nij", by_point, by_point)
    force = np.einsum("nki,nk->ni", by_point, residual)
    here, everywhere = sum_by(at, square, len(group)), sum_by(point, square, n_points)
    dot = np.zeros(len(group), dtype=np.int64)
    dot[at] = point
    size = np.linalg.eigvalsh(here)
    good = (np.bincount(dot, minlength=n_points)[dot] > 1) & (size[:, 0] > _LEAST_SHARE * size[:, 2])
    inverse, of_dot = np.zeros_like(here), np.zeros_like(everywhere)
    inverse[good] = np.linalg.inv(here[good])
    of_dot[dot[good]] = np.linalg.inv(everywhere[dot[good]])

    gained = _quadratic(sum_by(at, force, len(group)), inverse)
    alone = np.bincount(at, _quadratic(force, inverse[at]), len(group))
    # a place takes up 3 of the noise, less what the dot itself does; of that a part lies between cameras
    taken = np.einsum("uij,uji->u", of_dot[dot], here)
    taken_alone = np.einsum("nij,njk,nkl,nli->n", inverse[at], square, of_dot[point], square)
    between = np.bincount(at, taken_alone, len(group)) - taken
    turned = np.einsum("nij,njk->nik", inverse[at], square)
    scatter = 3 - np.bincount(at, np.einsum("nij,nji->n", turned, turned), len(group))
    terms = gained - alone, between, 3 - taken, np.maximum(scatter, 0.0)
    return np.array([term[good].sum() for term in terms])


def _quadratic(vector: FloatArray, matrix: FloatArray) -> FloatArray:
    """v' M v, (n,)."""
    return np.einsum("ni,nij,nj->n", vector, matrix, vector)


# --- which form the network is taken in ------------------------------------------------------------------------------

FormName = Literal["free", "soft", "rigid"]

# The ratio of the variances scatters by 0.01 around 1 while the ball keeps its shape.
NOTICEABLE = 1.06


@dataclass(frozen=True)
class ModelChoice:
    """The form that was taken and why; `ratio`: variance of unit weight of the rigid form over the free one's.

    `shape_sd_mm`: in the soft form the standard deviation, per coordinate, of a dot's place on the ball, `stated` or
    estimated from the data. `facts`: the part of the reason that holds whatever was taken. `agreement`: how far cameras
    agree that dots moved on the ball; None where that was not tested. `sizes` (placements,): of the ball in the rigid
    form, relative to their mean; None where it has one size.
    """

    form: FormName
    reason: Phrase
    ratio: float | None = None
    limit: float | None = None
    alignment: Alignment | None = None
    shape_sd_mm: float | None = None
    stated: bool = False
    asked: bool = False
    facts: Phrase | None = None
    agreement: Agreement | None = None
    sizes: FloatArray | None = None

    @property
    def ball_changed(self) -> bool:
        """Whether the ball, and not errors of single cameras, is the cause if the rigid form fits worse."""
        return self.agreement is None or self.agreement.is_certain

    @property
    def beyond(self) -> bool:
        """Whether the rigid form fits worse than a ball that keeps its shape allows."""
        return self.ratio is not None and self.limit is not None and self.ratio > self.limit

    @property
    def refused(self) -> bool:
        """Whether the ball's shape seems to have changed too much for the rigid form."""
        return self.beyond and not self.asked and self.form != "rigid"
