"""What moved where no single camera did: cameras on a beam, the ball between exposures, or the whole rig for a while.

All are tested on the footing of the moved cameras of `pose_graph`: further poses in the same small adjustment of the
images' own poses, judged by what they leave of v'Pv and how many unknowns they take (G. Schwarz, Estimating the
dimension of a model, 1978). Which cameras belong together is searched by linear tests, one camera after the other.
"""

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import gammaln

from spherecal.adjust.image_poses import ImagePoses
from spherecal.adjust.problem import POSE
from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.context import Context
from spherecal.diagnose.moves import LEAST_CHANGE_PX, TIE, move_limit
from spherecal.diagnose.pose_graph import EXPLAINED, Explained, Fitted, Layout, fit_layout
from spherecal.diagnose.yardstick import raised
from spherecal.geometry.rotation import log_rotation

# A group that moved leaves next to nothing of what the images' poses differ by; lenses beyond their model, where some
# group always seems to explain something, leave most of it.
LEAST_SHARE = 0.7
# Up to so many cameras all 2048 groups are tried (50 ms); else the search begins with those that alone explain most.
MOST_EVERY, FIRST = 12, 3

# Of a motion's curvature beside that of the images alone. What two groups share is small: 1e-7 on a hall of 12 cameras.
LEAST_CURVATURE = 1e-9

Kind = Literal["cameras", "ball", "placement"]


@dataclass(frozen=True)
class Together:
    """Cameras that moved together before the first of `placements`, or for which the ball stood elsewhere there.

    Or, kind `placement`, the one at which every camera stands elsewhere than at the others.
    `cameras`, `placements`: indices; `change_px` by how much image points shift (rms per axis, in all of these images);
    `shift` (network units), `turn_rad`: the largest motion, of the cameras' or the ball's middle. `statistic`
    chi-square on `freedom`; `left` over its degrees of freedom. `rival`: the other kind explains as much.
    """

    kind: Kind
    cameras: tuple[int, ...]
    placements: tuple[int, ...]
    statistic: float
    freedom: int
    left: float
    change_px: float
    shift: float
    turn_rad: float
    rival: bool = False


@dataclass(frozen=True)
class _Way:
    """A hypothesis: `sets` of placements, each with a motion of its own, and the cameras (c,) that see it.

    For a placement that contradicts the others there is no group: each image there has a pose of its own.
    """

    kind: Kind
    sets: tuple[tuple[int, ...], ...]
    group: BoolArray | None


def explain_together(
    images: ImagePoses, n_cameras: int, ball_centre: FloatArray, single: Fitted | None, context: Context
) -> Together | None:
    """The group that explains the images' poses better than nothing and than moves of single cameras; None without.

    `ball_centre` (3,) in the ball's frame; `single`: the poses with moves of single cameras that are credible.
    """
    before = fit_layout(images, Layout.of(images, n_cameras))
    seen = np.unique(images.placement)
    if before is None or len(seen) < 2 or len(np.unique(images.camera)) < 3:
        return None
    freedom = POSE * (len(images.camera) - before.layout.unknowns)
    tests = _Tests.of(images, before, n_cameras)
    tried: list[tuple[_Way, Fitted]] = []
    ways = _ways(seen)
    for k, (kind, sets) in enumerate(ways):
        context.report("moved cameras", k / len(ways))
        for group in [None] if kind == "placement" else tests.groups(sets, images.variance):
            way = _Way(kind, sets, group)
            fitted = fit_layout(images, _layout(images, n_cameras, way))
            if fitted is not None:
                tried.append((way, fitted))
    if not tried or freedom <= 0:
        return None
    noise = max(1.0, min(_left(images, one) for _, one in tried))
    scored = sorted(((score_of(images, one, way.group, noise), k) for k, (way, one) in enumerate(tried)))
    best, (way, fitted) = scored[0][0], tried[scored[0][1]]
    least = min(score_of(images, one, None, noise) for one in (before, single) if one is not None)
    extra = POSE * (fitted.layout.unknowns - before.layout.unknowns)
    statistic = (before.cost - fitted.cost) / images.variance
    excess = before.cost / images.variance - freedom
    if (
        best >= least or _left(images, fitted) > EXPLAINED
        or statistic < LEAST_SHARE * excess or statistic <= raised(_limit(images, way, extra), noise)
    ):  # fmt: skip
        return None
    found = _described(images, n_cameras, way, fitted, ball_centre, statistic, extra)
    other = any(score < best + TIE and tried[k][0].kind != way.kind for score, k in scored[1:])
    return replace(found, rival=other) if found.change_px >= LEAST_CHANGE_PX else None


def unsteady(images: ImagePoses, found: Explained) -> Together:
    """The camera that stood elsewhere more than once: it hangs loose, or exposes while the ball still moves.

    None of its poses is then to be relied on, however well a pose for each image fits.
    """
    count = Counter(move.camera for move in found.moves)
    camera = max(count, key=lambda c: (count[c], -c))
    own = [move for move in found.moves if move.camera == camera]
    return Together(
        "ball", (camera,), tuple(sorted({t for move in own for t in move.placements})),
        sum(move.statistic for move in own), sum(move.dof for move in own), found.left,
        float(np.sqrt(np.mean([move.image_change_px**2 for move in own]))),
        max(float(np.linalg.norm(move.step[3:])) for move in own),
        max(float(np.linalg.norm(move.step[:3])) for move in own),
    )  # fmt: skip


def score_of(images: ImagePoses, fitted: Fitted, group: BoolArray | None = None, noise: float = 1.0) -> float:
    """Schwarz's criterion of a hypothesis, smaller is better, with the choice of a group (c,) as unknowns too.

    `noise`: what the best hypothesis leaves, over its degrees of freedom.
    """
    choice = 0.0
    if group is not None:
        n, k = len(group), int(group.sum())
        choice = 2 * float(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1))
    rows = POSE * len(images.camera)
    return fitted.cost / images.variance / noise + POSE * fitted.layout.unknowns * np.log(rows) + choice


def _limit(images: ImagePoses, way: _Way, extra: int) -> float:
    """The statistic that chance does not reach: that of a single move for every motion, and the choice of a group."""
    n = 0 if way.group is None else len(way.group)
    return move_limit(len(images.camera)) * max(extra // POSE, 1) + 2 * n * np.log(2)


def _left(images: ImagePoses, fitted: Fitted) -> float:
    freedom = POSE * (len(images.camera) - fitted.layout.unknowns)
    return fitted.cost / images.variance / freedom if freedom > 0 else np.inf


_Sets = tuple[tuple[int, ...], ...]


def _ways(seen: IntArray) -> list[tuple[Kind, _Sets]]:
    """The sets of placements of all hypotheses: from one on together, or one by one, all of them or a single one."""
    times = [int(t) for t in seen]
    each: list[_Sets] = [((t,),) for t in times]
    together: list[_Sets] = [(tuple(times[k:]),) for k in range(1, len(times))]
    # between exposures: relative to the first, since it is open how the groups stand to each other; or at one alone
    between: list[_Sets] = [tuple((t,) for t in times[1:]), *(each if len(times) > 2 else each[-1:])]
    kinds: list[tuple[Kind, list[_Sets]]] = [
        ("cameras", together),
        ("ball", between),
        ("placement", each if len(times) > 2 else []),
    ]
    return [(kind, sets) for kind, all_sets in kinds for sets in all_sets]


def _layout(images: ImagePoses, n_cameras: int, way: _Way) -> Layout:
    still = Layout.of(images, n_cameras)
    if way.group is None:
        there = np.flatnonzero(images.placement == way.sets[0][0])
        others = np.delete(there, np.argmax(images.points[there]))  # against which one the others stand is open
        camera = still.camera.copy()
        camera[others] = n_cameras + np.arange(len(others))
        return replace(still, camera=camera, cameras=n_cameras + len(others))
    motion = still.motion.copy()
    for k, placements in enumerate(way.sets):
        motion[way.group[images.camera] & np.isin(images.placement, placements)] = k
    return replace(still, motion=motion, motions=len(way.sets))


@dataclass(frozen=True)
class _Tests:
    """Linear tests of motions: `force` (c,t,6) and `stiffness` (c,t,c,t,6,6) of each image's view of the ball."""

    force: FloatArray
    stiffness: FloatArray

    @staticmethod
    def of(images: ImagePoses, fitted: Fitted, n_cameras: int) -> "_Tests":
        m, n_times = len(images.camera), int(images.placement.max()) + 1
        j = fitted.by_ball
        force = np.einsum("mij,mi->mj", j, fitted.forces.reshape(m, POSE))
        blocks = fitted.stiffness.reshape(m, POSE, m, POSE)
        stiffness = np.einsum("aij,aibk,bkl->abjl", j, blocks, j, optimize=True)
        forces = np.zeros((n_cameras, n_times, POSE))
        forces[images.camera, images.placement] = force
        whole = np.zeros((n_cameras, n_times, n_cameras, n_times, POSE, POSE))
        whole[images.camera[:, None], images.placement[:, None], images.camera, images.placement] = stiffness
        return _Tests(forces, whole)

    def groups(self, sets: tuple[tuple[int, ...], ...], variance: float) -> list[BoolArray]:
        """Groups (c,) of cameras whose motions at some sets of placements explain most: of any size, and a single one.

        Linear tests are good for ranking; the fit decides. None has more than half of the cameras.
        """
        n, p = len(self.force), len(sets)
        pick = np.zeros((p, self.force.shape[1]))
        for k, placements in enumerate(sets):
            pick[k, list(placements)] = 1.0
        force = np.einsum("pt,cti->cpi", pick, self.force).reshape(n, POSE * p)
        some = np.einsum("pt,ctdsij->cpdsij", pick, self.stiffness, optimize=True)
        some = np.einsum("qs,cpdsij->cdpiqj", pick, some, optimize=True).reshape(n, n, POSE * p, POSE * p)
        seen = np.flatnonzero(np.einsum("ccii->c", some) > 0)
        if len(seen) < 3:
            return []
        best = (
            _every_group(force, some, seen, variance) if len(seen) <= MOST_EVERY
            else self._grown_from_the_best(force, some, seen, variance)
        )  # fmt: skip
        if 2 * len(best) > len(seen):  # the others, moving the other way, are the same
            best = frozenset(seen.tolist()) - best
        alone = frozenset({max(seen.tolist(), key=lambda c: _gain(force, some, [c]))})
        return [np.isin(np.arange(n), sorted(group)) for group in dict.fromkeys((best, alone)) if group]

    def _grown_from_the_best(
        self, force: FloatArray, some: FloatArray, seen: IntArray, variance: float
    ) -> frozenset[int]:  # fmt: skip
        """The best of the groups that grow from single cameras, and from the halves that pull apart most."""
        alone = np.array([_gain(force, some, [int(c)]) for c in seen])
        starts = [frozenset({int(c)}) for c in seen[np.argsort(-alone, kind="stable")[:FIRST]]]
        own = np.einsum("ccij->cij", some[np.ix_(seen, seen)])
        root = np.linalg.pinv(own.mean(axis=0), rcond=1e-9, hermitian=True)
        alike = force[seen] @ root @ force[seen].T  # cameras of one group pull in one direction
        apart = np.linalg.eigh(alike)[1][:, -1]
        starts += [frozenset(seen[side].tolist()) for side in (apart > 0, apart < 0) if side.any() and not side.all()]
        least = 2 * np.log(len(force)) * variance
        found = [self._grown(force, some, start, seen, least) for start in starts]
        return max(found, key=lambda one: (one[0], sorted(one[1])))[1]

    @staticmethod
    def _grown(
        force: FloatArray, some: FloatArray, group: frozenset[int], seen: IntArray, least: float
    ) -> tuple[float, frozenset[int]]:
        """The group with cameras added or removed as long as that explains markedly more."""
        now = _gain(force, some, sorted(group))
        while True:
            tried = [(_gain(force, some, sorted(group ^ {int(c)})), group ^ {int(c)}) for c in seen]
            better, other = max(tried, key=lambda one: (one[0], sorted(one[1])))
            if better <= now + least or not other or len(other) == len(seen):
                return now, group
            now, group = better, other


def _every_group(force: FloatArray, some: FloatArray, seen: IntArray, variance: float) -> frozenset[int]:
    """The group of cameras that explains most, less what the choice of so many is worth."""
    n = len(seen)
    members = ((np.arange(1, 2**n - 1)[:, None] >> np.arange(n)) & 1).astype(float)
    members = members[members.sum(axis=1) <= n / 2]  # the others, moving the other way, are the same
    f = members @ force[seen]
    a = np.einsum("gc,cdij->gdij", members, some[np.ix_(seen, seen)], optimize=True)
    a = np.einsum("gd,gdij->gij", members, a, optimize=True)
    size = np.sqrt(np.maximum(np.einsum("gii->gi", a), 1e-300))
    a = a / size[:, :, None] / size[:, None, :] + LEAST_CURVATURE * np.eye(a.shape[1])
    gain = ((f / size) * np.linalg.solve(a, (f / size)[:, :, None])[:, :, 0]).sum(axis=1)
    count = members.sum(axis=1)
    choice = 2 * (gammaln(n + 1) - gammaln(count + 1) - gammaln(n - count + 1)) * variance
    return frozenset(seen[members[int(np.argmax(gain - choice))] > 0].tolist())


def _gain(force: FloatArray, some: FloatArray, group: list[int]) -> float:
    """What the squares shrink by with common motions of a group."""
    if not group:
        return 0.0
    f = force[group].sum(axis=0)
    a = some[np.ix_(group, group)].sum(axis=(0, 1))
    size = np.where(a.diagonal() > 0, 1 / np.sqrt(np.maximum(a.diagonal(), 1e-300)), 0.0)  # 0: none of them sees it
    values, axes = np.linalg.eigh(a * size[:, None] * size)
    good = values > LEAST_CURVATURE
    along = axes[:, good].T @ (f * size)
    return float((along**2 / values[good]).sum())


def _described(
    images: ImagePoses, n_cameras: int, way: _Way, fitted: Fitted, ball_centre: FloatArray, statistic: float, extra: int
) -> Together:
    """What a fitted hypothesis says of cameras and ball."""
    if way.group is None:
        return _described_placement(images, n_cameras, way, fitted, statistic, extra)
    layout = fitted.layout
    rotation, translation = fitted.rotation[layout.cameras :], fitted.translation[layout.cameras :]
    balls, motions = slice(0, layout.balls), slice(layout.balls, None)
    cameras = tuple(int(c) for c in np.flatnonzero(way.group))
    squares, points, shifts, turns = 0.0, 0, [], []
    turn = log_rotation(rotation[motions])
    for k, placements in enumerate(way.sets):
        own = np.flatnonzero(layout.motion == k)
        r, v = rotation[motions][k], translation[motions][k]
        if way.kind == "ball":
            centre = rotation[balls][placements[0]] @ ball_centre + translation[balls][placements[0]]
            shifts.append(float(np.linalg.norm(r @ centre + v - centre)))
        else:
            seen_from = -np.einsum("cji,cj->ci", fitted.rotation[list(cameras)], fitted.translation[list(cameras)])
            middle = seen_from.mean(axis=0)
            shifts.append(float(np.linalg.norm(r.T @ (middle - v) - middle)))
        turns.append(float(np.linalg.norm(turn[k])))
        step = np.concatenate([turn[k], v])
        change = np.einsum("mij,j->mi", fitted.by_ball[own], step)
        squares += float(np.einsum("mi,mij,mj->", change, images.by_pose_px2[own], change))
        points += int(images.points[own].sum())
    times = tuple(sorted(t for placements in way.sets for t in placements))
    if way.kind == "ball" and len(way.sets) > 1:
        times = tuple(int(t) for t in np.unique(images.placement))
    return Together(
        way.kind, cameras, times, statistic, extra, _left(images, fitted),
        float(np.sqrt(squares / (2 * max(points, 1)))), max(shifts), max(turns),
    )  # fmt: skip


def _described_placement(
    images: ImagePoses, n_cameras: int, way: _Way, fitted: Fitted, statistic: float, extra: int
) -> Together:
    """By how much the cameras stand elsewhere at one placement than at the others."""
    squares, points, shifts, turns = 0.0, 0, [0.0], [0.0]
    for i in np.flatnonzero(fitted.layout.camera >= n_cameras):
        block, camera = fitted.layout.camera[i], images.camera[i]
        turn = fitted.rotation[block] @ fitted.rotation[camera].T
        step = np.concatenate(
            [log_rotation(turn[None])[0], fitted.translation[block] - turn @ fitted.translation[camera]]
        )
        centres = [-fitted.rotation[k].T @ fitted.translation[k] for k in (block, camera)]
        shifts.append(float(np.linalg.norm(centres[0] - centres[1])))
        turns.append(float(np.linalg.norm(step[:3])))
        squares += float(step @ images.by_pose_px2[i] @ step)
        points += int(images.points[i])
    return Together(
        way.kind, (), way.sets[0], statistic, extra, _left(images, fitted),
        float(np.sqrt(squares / (2 * max(points, 1)))), max(shifts), max(turns),
    )  # fmt: skip
