"""Which cameras may have moved together: linear tests of common motions, for `group_motion` to fit the best of them.

For ranking these are good enough. A common motion of a group is tested by sums over its cameras, so that the matrices
are made up once for all groups.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from spherecal.adjust.parameter_layout import POSE
from spherecal.ball.image_poses import ImagePoses
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.diagnose.pose_graph import Fitted

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
    def of(images: ImagePoses, fitted: Fitted, n_cameras: int) -> "GroupSearch":
        """The tests at a fit without motions."""
        m, n_times = len(images.camera), int(images.placement.max()) + 1
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
        values, axes = np.linalg.eigh(a * size[:, None] * size)
        good = values > LEAST_CURVATURE
        along = axes[:, good].T @ (f * size)
        return float((along**2 / values[good]).sum())

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
