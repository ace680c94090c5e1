"""Motions of a group: cameras on one beam, the ball between exposures, or the whole rig for a while.

Each hypothesis adds poses to the small adjustment of `pose_graph`, and is judged by what it leaves of v'Pv and how many
unknowns it takes (G. Schwarz, Estimating the dimension of a model, 1978; decision 0009). Which groups are tried comes
from linear tests, good enough for ranking: a group's is a sum over its cameras, so that the matrices are made up once.
"""

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import gammaln

from spherecal.adjust.parameter_layout import POSE
from spherecal.ball.image_poses import ImagePoses
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.diagnose.moves import LEAST_CHANGE_PX, TIE, move_limit, raised, taken_up
from spherecal.diagnose.pose_graph import EXPLAINED, Explained, Fitted, PoseComposition, fit_layout, variance_factor
from spherecal.geometry.rotation import log_rotation
from spherecal.geometry.transform import pose_change

# Up to so many cameras all groups of at most half of them are tried (2,500 in 50 ms at four placements); with more, the
# search begins with the cameras that alone explain most.
MOST_EVERY, FIRST = 12, 3
# Numbers in the matrices of the groups that are tested at a time (32 MB); of 12 cameras at 25 placements all 2,510
# groups at once took 5 GB.
_AT_ONCE = 4_000_000
# Of a motion's curvature beside that of the images alone. What two groups share is small: 1e-7 on a hall of 12 cameras.
LEAST_CURVATURE = 1e-9

PlacementSets = tuple[tuple[int, ...], ...]  # for each motion the placements at which it holds


@dataclass(frozen=True)
class GroupSearch:
    """`force` (c,t,6) and `stiffness` (c,t,c,t,6,6) of motions of the ball that single images see."""

    force: FloatArray
    stiffness: FloatArray

    @staticmethod
    def of(images: ImagePoses, fitted: Fitted) -> "GroupSearch":
        """The tests at a fit without motions."""
        m, n_times, n_cameras = len(images.camera), int(images.placement.max()) + 1, images.n_cameras
        j = fitted.by_ball
        force = np.zeros((n_cameras, n_times, POSE))
        force[images.camera, images.placement] = np.einsum("mij,mi->mj", j, fitted.forces.reshape(m, POSE))
        blocks = fitted.stiffness.reshape(m, POSE, m, POSE)
        stiffness = np.zeros((n_cameras, n_times, n_cameras, n_times, POSE, POSE))
        stiffness[images.camera[:, None], images.placement[:, None], images.camera, images.placement] = np.einsum(
            "aij,aibk,bkl->abjl", j, blocks, j, optimize=True
        )
        return GroupSearch(force, stiffness)

    def groups(self, motions: PlacementSets, variance: float) -> list[BoolArray]:
        """The groups (c,) of cameras whose motions explain most: of any size up to half, and of one camera."""
        n, p = len(self.force), len(motions)
        at = np.zeros((p, self.force.shape[1]))
        for k, placements in enumerate(motions):
            at[k, list(placements)] = 1.0
        force = np.einsum("pt,cti->cpi", at, self.force).reshape(n, POSE * p)
        stiffness = np.einsum("pt,ctdsij->cpdsij", at, self.stiffness, optimize=True)
        stiffness = np.einsum("qs,cpdsij->cdpiqj", at, stiffness, optimize=True).reshape(n, n, POSE * p, POSE * p)
        seen = np.flatnonzero(np.einsum("ccii->c", stiffness) > 0)
        if len(seen) < 3:
            return []
        tests = _Tests(force, stiffness, seen, variance)
        best = tests.best_of_all() if len(seen) <= MOST_EVERY else tests.best_grown()
        if 2 * len(best) > len(seen):  # the others, moving the other way, are the same
            best = frozenset(seen.tolist()) - best
        alone = frozenset({max(seen.tolist(), key=lambda c: tests.gain([c]))})
        return [np.isin(np.arange(n), sorted(group)) for group in dict.fromkeys((best, alone)) if group]


@dataclass(frozen=True)
class _Tests:
    """Tests of p motions: `force` (c,6p), `stiffness` (c,c,6p,6p); `seen` (k,): cameras that have images there."""

    force: FloatArray
    stiffness: FloatArray
    seen: IntArray
    variance: float

    def gain(self, group: list[int]) -> float:
        """The reduction of the sum of squares by common motions of a group."""
        if not group:
            return 0.0
        f = self.force[group].sum(axis=0)
        a = self.stiffness[np.ix_(group, group)].sum(axis=(0, 1))
        size = np.where(a.diagonal() > 0, 1 / np.sqrt(np.maximum(a.diagonal(), 1e-300)), 0.0)  # 0: none of them sees it
        return taken_up(f, a, size, LEAST_CURVATURE)[0]

    def best_of_all(self) -> frozenset[int]:
        """The group that explains most, after subtraction of the gain by chance from so many choices."""
        n = len(self.seen)
        members = ((np.arange(1, 2**n - 1)[:, None] >> np.arange(n)) & 1).astype(float)
        members = members[members.sum(axis=1) <= n / 2]  # the others, moving the other way, are the same
        count = max(_AT_ONCE // (n * self.force.shape[1] ** 2), 1)
        parts = np.split(members, range(count, len(members), count))
        gain = np.concatenate([self._gains(part) for part in parts])
        size = members.sum(axis=1)
        choice = 2 * (gammaln(n + 1) - gammaln(size + 1) - gammaln(n - size + 1)) * self.variance
        return frozenset(self.seen[members[int(np.argmax(gain - choice))] > 0].tolist())

    def _gains(self, members: FloatArray) -> FloatArray:
        """`gain` (g,) of groups, members (g,k) 1 or 0 of the cameras seen."""
        f = members @ self.force[self.seen]
        a = np.einsum("gc,cdij->gdij", members, self.stiffness[np.ix_(self.seen, self.seen)], optimize=True)
        a = np.einsum("gd,gdij->gij", members, a, optimize=True)
        size = np.sqrt(np.maximum(np.einsum("gii->gi", a), 1e-300))
        a = a / size[:, :, None] / size[:, None, :] + LEAST_CURVATURE * np.eye(a.shape[1])
        return ((f / size) * np.linalg.solve(a, (f / size)[:, :, None])[:, :, 0]).sum(axis=1)

    def best_grown(self) -> frozenset[int]:
        """The best of the groups that grow from single cameras, and from the halves that differ most."""
        alone = np.array([self.gain([int(c)]) for c in self.seen])
        starts = [frozenset({int(c)}) for c in self.seen[np.argsort(-alone, kind="stable")[:FIRST]]]
        own, force = np.einsum("ccij->cij", self.stiffness[np.ix_(self.seen, self.seen)]), self.force[self.seen]
        root = np.linalg.pinv(own.mean(axis=0), rcond=1e-9, hermitian=True)
        apart = np.linalg.eigh(force @ root @ force.T)[1][:, -1]  # cameras of one group pull in one direction
        halves = (apart > 0, apart < 0)
        starts += [frozenset(self.seen[half].tolist()) for half in halves if half.any() and not half.all()]
        return max((self._grown(start) for start in starts), key=lambda one: (one[0], sorted(one[1])))[1]

    def _grown(self, group: frozenset[int]) -> tuple[float, frozenset[int]]:
        """Gain and group, with cameras added or removed as long as that explains markedly more."""
        least = 2 * np.log(len(self.force)) * self.variance
        now = self.gain(sorted(group))
        while True:
            tried = [(self.gain(sorted(group ^ {int(c)})), group ^ {int(c)}) for c in self.seen]
            better, other = max(tried, key=lambda one: (one[0], sorted(one[1])))
            if better <= now + least or not other or len(other) == len(self.seen):
                return now, group
            now, group = better, other


# A group that moved leaves next to nothing of what the images' poses differ by; lenses beyond their model, where some
# group always seems to explain something, leave most of it.
LEAST_SHARE = 0.7

Kind = Literal["cameras", "ball", "placement"]


@dataclass(frozen=True)
class GroupMotion:
    """Which images show a motion of a group.

    Kind `cameras`: the `cameras` moved together before the first of `placements`. `ball`: to them the ball was in
    another place at `placements` than to the other cameras. `placement`: there, all poses relative to each other differ
    from those at the other placements.

    `cameras`, `placements`: indices. `image_change_px`: by how much image points shift, rms per axis, in all of these
    images. `translation` (network units), `rotation_rad`: the largest motion, of the cameras' centroid or the ball's.
    `statistic`: chi-square on `dof`. `variance_factor`: with the motion in the model. `ambiguous`: another kind
    explains as much.
    """

    kind: Kind
    cameras: tuple[int, ...]
    placements: tuple[int, ...]
    statistic: float
    dof: int
    variance_factor: float
    image_change_px: float
    translation: float
    rotation_rad: float
    ambiguous: bool = False


@dataclass(frozen=True)
class _Tried:
    """Motions, each at some placements, that cameras (c,) see, as fitted; without: an image of one has its own pose."""

    kind: Kind
    motions: PlacementSets
    group: BoolArray | None
    fitted: Fitted
    statistic: float
    dof: int


def find_group_motion(
    images: ImagePoses, ball_centre: FloatArray, single: Fitted | None, context: Context
) -> GroupMotion | None:
    """The group motion that explains the images' poses better than none and than moves of single cameras; else None.

    Schwarz's criterion compares them. The motion counts where it leaves at most 3 times noise and explains 70 % of what
    noise does not (decision 0009).
    """
    still = fit_layout(images, PoseComposition.of(images))
    if still is None or still.layout.freedom <= 0 or len(np.unique(images.camera)) < 3:
        return None
    tried = _fit_all(images, still, context)
    if not tried:
        return None
    noise = max(1.0, min(variance_factor(images, one.fitted) for one in tried))
    score = [_criterion(images, one.fitted, one.group, noise) for one in tried]
    best = int(np.argmin(score))
    least = min(_criterion(images, one, None, noise) for one in (still, single) if one is not None)
    if score[best] >= least or not _is_significant(images, tried[best], still, noise):
        return None
    found = _described(images, tried[best], ball_centre)
    ambiguous = any(s < score[best] + TIE and one.kind != found.kind for s, one in zip(score, tried, strict=True))
    return replace(found, ambiguous=ambiguous) if found.image_change_px >= LEAST_CHANGE_PX else None


def unstable_camera(found: Explained) -> GroupMotion:
    """The camera with the most moves, as a motion between exposures: none of its poses is to be relied on."""
    count = Counter(move.camera for move in found.moves)
    camera = max(count, key=lambda c: (count[c], -c))
    own = [move for move in found.moves if move.camera == camera]
    times = tuple(sorted({t for move in own for t in move.placements}))
    sure = sum(move.statistic for move in own), sum(move.dof for move in own), found.variance_factor
    change_px = float(np.sqrt(np.mean([move.image_change_px**2 for move in own])))
    shift, turn = (max(float(np.linalg.norm(move.step[part])) for move in own) for part in (slice(3, 6), slice(3)))
    return GroupMotion("ball", (camera,), times, *sure, change_px, shift, turn)


# --- hypotheses and their fits ---------------------------------------------------------------------------------------


def _fit_all(images: ImagePoses, still: Fitted, context: Context) -> list[_Tried]:
    """The hypotheses that can be fitted, in a fixed order."""
    search = GroupSearch.of(images, still)
    tried = []
    all_motions = _all_motions(np.unique(images.placement))
    for k, (kind, motions) in enumerate(all_motions):
        context.report("moved cameras", k / len(all_motions))
        for group in [None] if kind == "placement" else search.groups(motions, images.variance):
            fitted = fit_layout(images, _layout(images, motions, group))
            if fitted is not None:
                statistic = (still.cost - fitted.cost) / images.variance
                dof = POSE * (fitted.layout.unknowns - still.layout.unknowns)
                tried.append(_Tried(kind, motions, group, fitted, statistic, dof))
    return tried


def _all_motions(seen: IntArray) -> list[tuple[Kind, PlacementSets]]:
    """Motions from one placement on, at all placements one by one, or at a single one."""
    times = [int(t) for t in seen]
    each: list[PlacementSets] = [((t,),) for t in times]
    together: list[PlacementSets] = [(tuple(times[k:]),) for k in range(1, len(times))]
    # between exposures: relative to the first placement, as a common motion at all is no motion; or at one alone
    between: list[PlacementSets] = [tuple((t,) for t in times[1:]), *(each if len(times) > 2 else each[-1:])]
    kinds: list[tuple[Kind, list[PlacementSets]]] = [
        ("cameras", together),
        ("ball", between),
        ("placement", each if len(times) > 2 else []),
    ]
    return [(kind, motions) for kind, all_motions in kinds for motions in all_motions]


def _layout(images: ImagePoses, motions: PlacementSets, group: BoolArray | None) -> PoseComposition:
    still, n_cameras = PoseComposition.of(images), images.n_cameras
    if group is None:
        there = np.flatnonzero(images.placement == motions[0][0])
        others = np.delete(there, np.argmax(images.points[there]))  # the one left defines the ball's pose there
        camera = still.camera.copy()
        camera[others] = n_cameras + np.arange(len(others))
        return replace(still, camera=camera, cameras=n_cameras + len(others))
    motion = still.motion.copy()
    for k, placements in enumerate(motions):
        motion[group[images.camera] & np.isin(images.placement, placements)] = k
    return replace(still, motion=motion, motions=len(motions))


# --- judging ---------------------------------------------------------------------------------------------------------


def _criterion(images: ImagePoses, fitted: Fitted, group: BoolArray | None, noise: float) -> float:
    """Schwarz's criterion with the choice of a group (c,), smaller is better; `noise`: the best's variance factor."""
    choice = 0.0
    if group is not None:
        n, k = len(group), int(group.sum())
        choice = 2 * float(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1))
    rows = POSE * len(images.camera)
    return fitted.cost / images.variance / noise + POSE * fitted.layout.unknowns * np.log(rows) + choice


def _is_significant(images: ImagePoses, best: _Tried, still: Fitted, noise: float) -> bool:
    """Whether a hypothesis explains nearly all of the misfit beyond noise, and more than chance does."""
    excess = still.cost / images.variance - still.layout.freedom
    # by chance: that of a single move for every motion, and the choice of a group
    n = 0 if best.group is None else len(best.group)
    limit = move_limit(len(images.camera)) * max(best.dof // POSE, 1) + 2 * n * np.log(2)
    explains = variance_factor(images, best.fitted) <= EXPLAINED and best.statistic >= LEAST_SHARE * excess
    return bool(explains and best.statistic > raised(limit, noise))


# --- the result ------------------------------------------------------------------------------------------------------


def _described(images: ImagePoses, best: _Tried, ball_centre: FloatArray) -> GroupMotion:
    times = tuple(sorted(t for placements in best.motions for t in placements))
    if best.kind == "ball" and len(best.motions) > 1:  # the first is only where they are counted from
        times = tuple(int(t) for t in np.unique(images.placement))
    if best.group is None:
        group, (rows, steps, translation) = (), _displaced(images, best.fitted)
    else:
        group = tuple(int(c) for c in np.flatnonzero(best.group))
        rows, steps, translation = _moved_together(best, list(group), ball_centre)
    factor, change_px = variance_factor(images, best.fitted), images.change_px(rows, steps)
    turn = float(np.linalg.norm(steps[:, :3], axis=1).max(initial=0.0))
    return GroupMotion(best.kind, group, times, best.statistic, best.dof, factor, change_px, translation, turn)


def _moved_together(best: _Tried, group: list[int], ball_centre: FloatArray) -> tuple[IntArray, FloatArray, float]:
    """The images (k,) that show the motions, how their poses change (k,6), and the largest translation of the group."""
    fitted = best.fitted
    layout = fitted.layout
    first = layout.cameras + layout.balls
    rotation, translation = fitted.rotation[first:], fitted.translation[first:]
    translations = []
    for k, placements in enumerate(best.motions):
        if best.kind == "ball":
            ball = layout.cameras + placements[0]
            centre = fitted.rotation[ball] @ ball_centre + fitted.translation[ball]
            translations.append(np.linalg.norm(rotation[k] @ centre + translation[k] - centre))
        else:
            centroid = -np.einsum("cji,cj->ci", *fitted.pose(np.array(group))).mean(axis=0)
            translations.append(np.linalg.norm(rotation[k].T @ (centroid - translation[k]) - centroid))
    rows = np.flatnonzero(layout.motion >= 0)
    motions = np.concatenate([log_rotation(rotation), translation], axis=1)[layout.motion[rows]]
    return rows, np.einsum("mij,mj->mi", fitted.by_ball[rows], motions), float(max(translations))


def _displaced(images: ImagePoses, fitted: Fitted) -> tuple[IntArray, FloatArray, float]:
    """The images (k,) with poses of their own at one placement, their changes of pose (k,6), largest translation."""
    rows = np.flatnonzero(fitted.layout.camera >= images.n_cameras)
    before, after = images.camera[rows], fitted.layout.camera[rows]
    centres = -np.einsum("cji,cj->ci", fitted.rotation, fitted.translation)
    largest = np.linalg.norm(centres[after] - centres[before], axis=1).max(initial=0.0)
    return rows, pose_change(fitted.pose(before), fitted.pose(after)), float(largest)
