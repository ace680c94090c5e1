"""Is every camera still where the rig says? A linear test of one placement's or some bar poses' observations.

Each camera is given a small turn and shift of its own while the points follow the others; compared with image noise
and the calibration's covariance. The one that explains most is named and freed, then the others are tested again.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.data.rig import Rig
from spherecal.geometry.camera import project_with_derivatives
from spherecal.geometry.rotation import cross_matrix, exp_rotation
from spherecal.geometry.transform import PosedCameras
from spherecal_verify.outlying_views import LEAST_REDUNDANCY, CheckedPoints, Views

# A false alarm once in 1000 checks, however many cameras there are (Bonferroni); benchmarks/studies/check.md counts.
_FALSE_ALARM = 1e-3
# Single views beyond this many standard deviations are wrong matches; see outlying_views.
_GATE_SIGMAS, _GATE_PX = 4.5, 0.15
# A pose has six unknowns: fewer points than this in a camera say nothing of it.
LEAST_POINTS = 6
_MOST_MOVED = 0.5  # of the cameras: beyond it none can be taken for unmoved
_STEPS = 3  # a move of some degrees is found by relinearising
_SAYS_NOTHING = 1e-20  # relative to the largest, of six parameters' normal equations


@dataclass(frozen=True)
class CameraTest:
    """One camera: points seen in common, rms, its move if it had one, and whether that is more than chance.

    `turn_rad` (3,), `shift_mm` (3,) in its own frame; `move_px` rms in its image, `point_mm` the largest shift of a
    point; `p`: probability by chance, 0 for a camera that was named.
    """

    id: str
    points: int
    rms_px: float
    move_px: float
    turn_rad: FloatArray
    shift_mm: FloatArray
    point_mm: float
    p: float
    moved: bool


@dataclass(frozen=True)
class Consistency:
    """All cameras that could be tested; `noise` in sigmas, views left out; `rejected`: most views contradict."""

    cameras: tuple[CameraTest, ...]
    untested: tuple[str, ...]
    noise: float
    left_out: int
    rejected: tuple[str, ...] = ()

    @property
    def moved(self) -> tuple[CameraTest, ...]:
        """The cameras that have moved."""
        return tuple(camera for camera in self.cameras if camera.moved)


def examine_cameras(views: Views, rig: Rig, expected_noise: float, false_alarm: float = _FALSE_ALARM) -> Consistency:
    """Test every camera that sees enough points of three or more by a chi-squared of six (docs/verification.md)."""
    # two alone always agree across their common plane
    cameras = np.zeros((views.n_features, len(views.rotation)), dtype=bool)
    cameras[views.feature, views.camera] = True
    rows = np.flatnonzero((cameras.sum(axis=1) >= 3)[views.feature])
    views = replace(
        views, feature=views.feature[rows], camera=views.camera[rows], uv=views.uv[rows], sigma=views.sigma[rows]
    )
    keep = np.ones(len(views.uv), dtype=bool)
    found = _search(views, keep, rig, expected_noise, false_alarm)
    for _ in range(3):  # wrong matches can be found once the moved cameras are known
        gross = keep & (found.size > np.maximum(_GATE_SIGMAS * found.noise, _GATE_PX / views.sigma.max(axis=1)))
        if not gross.any():
            break
        keep &= ~gross
        found = _search(views, keep, rig, expected_noise, false_alarm)
    return _consistency(views, keep, rig, found)


@dataclass(frozen=True)
class _Found:
    """Moved cameras' turns and shifts (k, 6), every camera's own move and chance, the whitened residuals' size (n,)."""

    moved: tuple[int, ...]
    turn_shift: FloatArray
    p: FloatArray
    size: FloatArray
    noise: float
    system: "_System"


def _search(views: Views, keep: BoolArray, rig: Rig, expected: float, false_alarm: float) -> _Found:
    """Name moved cameras one by one, the one that explains most first, until the others agree."""
    c = len(rig.cameras)
    poses = np.zeros((c, 6))
    moved: list[int] = []
    while True:
        # the linear system about the moved cameras' best poses
        system = _System.at(views, keep, rig, poses)
        for _ in range(_STEPS if moved else 0):
            poses = poses.copy()
            poses[moved] += system.solve(moved)
            system = _System.at(views, keep, rig, poses)
        noise = max(system.noise(moved), expected)
        shift, p = system.tests(moved, noise)
        candidates = np.where(np.isin(np.arange(c), moved), 1.0, p)
        best = int(np.nanargmin(candidates)) if np.isfinite(candidates).any() else -1
        full = len(moved) >= _MOST_MOVED * c
        if best < 0 or candidates[best] >= false_alarm / c or full:
            total = poses + np.where(np.isin(np.arange(c), moved)[:, None], 0.0, shift)
            chance = p.copy()
            chance[moved] = 0.0
            return _Found(tuple(moved), total, chance, system.sizes(moved), noise, system)
        # of the most significant cameras, the one that leaves the smallest residuals when it is freed
        doubtful = np.flatnonzero(candidates <= max(candidates[best], 1e-12)).tolist()
        moved.append(min(doubtful, key=lambda i: system.noise([*moved, i])) if len(doubtful) > 1 else best)


@dataclass(frozen=True)
class _System:
    """Whitened residuals (n, 2) with the points eliminated, and derivatives by the cameras' poses and parameters.

    `normal` (6c, 6c) and `gradient` (6c,) of all poses, `whole` (cw, cw) of all parameters;
    `chance` (6c, 6c) is the calibration's share in the gradient's covariance. `by_pose` (n, 2, 6) in px,
    `cofactor` (m, 3, 3) of the points, `by_point` (n, 2, 3) whitened.
    """

    views: Views
    keep: BoolArray
    residual: FloatArray
    by_pose: FloatArray
    by_point: FloatArray
    cofactor: FloatArray
    normal: FloatArray
    gradient: FloatArray
    chance: FloatArray
    whole: FloatArray
    redundancy: int

    @staticmethod
    def at(views: Views, keep: BoolArray, rig: Rig, poses: FloatArray) -> "_System":
        rotation_change = exp_rotation(poses[:, :3])
        translation = np.einsum("cij,cj->ci", rotation_change, views.translation) + poses[:, 3:]
        moved = replace(views, cameras=PosedCameras(views.intrinsics, rotation_change @ views.rotation, translation))
        found = moved.triangulate(keep)
        good = keep & np.isfinite(found.residual[:, 0])
        rotation, k = moved.rotation[views.camera], views.intrinsics[views.camera]
        x = np.einsum("nij,nj->ni", rotation, found.points[views.feature]) + moved.translation[views.camera]
        x = np.where(good[:, None], x, [0.0, 0.0, 1.0])
        _, by_x, by_intrinsics = project_with_derivatives(x, k)
        by_pose = np.concatenate([-by_x @ cross_matrix(x), by_x], axis=2)
        covariance = rig.covariance
        columns = covariance.intrinsics if covariance is not None else np.arange(0)
        parameters = np.concatenate([by_pose, by_intrinsics[:, :, columns]], axis=2)
        root = (good[:, None] / views.sigma)[:, :, None]
        by_point, white = root * (by_x @ rotation), root * parameters
        residual = np.where(good[:, None], np.nan_to_num(found.residual) / views.sigma, 0.0)
        cofactor = np.where(np.isfinite(found.covariance), found.covariance, 0.0)
        whole = _reduced_normal(views, white, by_point, cofactor)
        c, w = len(rig.cameras), parameters.shape[2]
        pose_rows = (np.arange(c)[:, None] * w + np.arange(6)).ravel()
        gradient = np.zeros((c, 6))
        np.add.at(gradient, views.camera, np.einsum("nki,nk->ni", white[:, :, :6], residual))
        chance = np.zeros((6 * c, 6 * c))
        if covariance is not None:
            by_all = whole[pose_rows]
            chance = by_all @ covariance.matrix @ by_all.T
        redundancy = 2 * int(good.sum()) - 3 * len(np.unique(views.feature[good]))
        of_poses, of_rows = whole[np.ix_(pose_rows, pose_rows)], (residual, by_pose, by_point)
        return _System(views, good, *of_rows, cofactor, of_poses, gradient.ravel(), chance, whole, redundancy)

    def solve(self, free: list[int]) -> FloatArray:
        """The poses (k, 6) of some cameras that fit best, the others as they are."""
        rows = _rows(free)
        step = -np.linalg.lstsq(self.normal[np.ix_(rows, rows)], self.gradient[rows], rcond=1e-10)[0]
        return np.asarray(step.reshape(-1, 6), dtype=np.float64)

    def sizes(self, free: list[int]) -> FloatArray:
        """Whitened residuals' size (n,), to first order, after freed cameras' poses are fitted and points follow."""
        if not free:
            return np.linalg.norm(self.residual, axis=1)
        step = np.zeros((len(self.views.rotation), 6))
        step[free] = self.solve(free)
        return np.linalg.norm(self.residual + self.effect(step) / self.views.sigma, axis=1)

    def effect(self, step: FloatArray) -> FloatArray:
        """The change of the residuals (n, 2) px by steps (c, 6) of the poses, with the points following."""
        direct = np.einsum("nki,ni->nk", self.by_pose, step[self.views.camera])
        shift = self.point_shift(step)[self.views.feature]
        return (direct + np.einsum("nki,ni->nk", self.by_point, shift) * self.views.sigma) * self.keep[:, None]

    def point_shift(self, step: FloatArray) -> FloatArray:
        """How the points (m, 3) mm follow steps (c, 6) of the poses."""
        direct = np.einsum("nki,ni->nk", self.by_pose, step[self.views.camera]) / self.views.sigma
        pull = np.zeros((self.views.n_features, 3))
        np.add.at(pull, self.views.feature, np.einsum("nki,nk->ni", self.by_point, direct * self.keep[:, None]))
        return -np.einsum("mij,mj->mi", self.cofactor, pull)

    def noise(self, free: list[int]) -> float:
        """sqrt(v'Pv / redundancy) with some cameras freed; 0 where nothing is redundant."""
        redundancy = self.redundancy - 6 * len(free)
        if redundancy < 10:
            return 0.0
        gain = float(self.gradient[_rows(free)] @ -self.solve(free).ravel()) if free else 0.0
        return float(np.sqrt(max((self.residual**2).sum() - gain, 0.0) / redundancy))

    def tests(self, moved: list[int], noise: float) -> tuple[FloatArray, FloatArray]:
        """Each camera's move (c, 6) as the only further one, and its chance (c,), NaN where it cannot be tested."""
        c = len(self.views.rotation)
        normal, gradient = self.normal, self.gradient
        covariance = noise**2 * normal + self.chance
        if moved:
            rows = _rows(moved)
            m = np.eye(6 * c)
            m[:, rows] -= np.linalg.lstsq(normal[np.ix_(rows, rows)], normal[rows], rcond=1e-10)[0].T
            normal, gradient, covariance = m @ normal, m @ gradient, m @ covariance @ m.T
        moves, p = np.zeros((c, 6)), np.full(c, np.nan)
        points = np.bincount(self.views.camera[self.keep], minlength=c)
        for i in np.flatnonzero(points >= LEAST_POINTS).tolist():
            if i in moved:
                continue
            rows = _rows([i])
            own, spread = normal[np.ix_(rows, rows)], covariance[np.ix_(rows, rows)]
            size = np.diag(spread)
            # a camera of another rig, whose views say nothing of a move; turns are to millimetres as 1e7 to 1 (px^2)
            if not (np.isfinite(spread).all() and size.max() > 0 and (size > _SAYS_NOTHING * size.max()).all()):
                continue
            moves[i] = -np.linalg.lstsq(own, gradient[rows], rcond=1e-10)[0]
            # whitened by the normal matrix, so that turns and millimetres are of one size
            root = np.sqrt(size)
            values, vectors = np.linalg.eigh(spread / np.outer(root, root))
            good = values > 1e-9 * values[-1]
            score = (vectors[:, good].T @ (gradient[rows] / root)) ** 2 / values[good]
            p[i] = float(chdtrc(int(good.sum()), float(score.sum())))
        return moves, p


def camera_normal(views: Views, keep: BoolArray, rig: Rig) -> FloatArray:
    """The normal matrix (c*w, c*w) of all cameras' parameters (rig.CameraCovariance's order), the points eliminated."""
    return _System.at(views, keep, rig, np.zeros((len(rig.cameras), 6))).whole


def noise_alone(checked: CheckedPoints, rig: Rig) -> float:
    """The image points' noise in units of sigma without what the cameras' own uncertainty adds to the residuals.

    That counts by itself in budgets (on rigs A it made the marks' noise 4 % too large); as it is where unknown.
    """
    points = len(np.unique(checked.views.feature[checked.kept]))
    redundancy = 2 * int(checked.kept.sum()) - 3 * points
    if rig.covariance is None or redundancy < LEAST_REDUNDANCY:
        return checked.noise
    by_cameras = float(np.einsum("ij,ji->", camera_normal(checked.views, checked.kept, rig), rig.covariance.matrix))
    # a covariance that explains more than the residuals is itself in doubt
    return float(np.sqrt(max(checked.noise**2 - by_cameras / redundancy, checked.noise**2 / 4)))


def _rows(cameras: list[int]) -> np.ndarray:
    return (np.array(cameras, dtype=np.int64)[:, None] * 6 + np.arange(6)).ravel()


def _reduced_normal(views: Views, white: FloatArray, by_point: FloatArray, cofactor: FloatArray) -> FloatArray:
    """The normal matrix (c*w, c*w) of all cameras' parameters with the points eliminated."""
    c, w = len(views.rotation), white.shape[2]
    normal = np.zeros((c, w, c, w))
    own = np.einsum("nki,nkj->nij", white, white)
    for camera in range(c):
        normal[camera, :, camera] = own[views.camera == camera].sum(axis=0)
    cross = np.einsum("nki,nkj->nij", white, by_point)  # (n, w, 3)
    seen = np.zeros((views.n_features, c, w, 3))
    np.add.at(seen, (views.feature, views.camera), cross)
    flat = seen.reshape(views.n_features, c * w, 3)
    weighted = flat @ cofactor
    whole = normal.reshape(c * w, c * w)
    whole -= np.tensordot(weighted, flat, axes=([0, 2], [0, 2]))
    return (whole + whole.T) / 2


def _consistency(views: Views, keep: BoolArray, rig: Rig, found: _Found) -> Consistency:
    system, tests, untested = found.system, [], []
    residual = system.residual * views.sigma
    for i, camera in enumerate(rig.cameras):
        rows = np.flatnonzero(system.keep & (views.camera == i))
        if len(rows) < LEAST_POINTS or np.isnan(found.p[i]):
            untested.append(camera.id)
            continue
        step = np.zeros((len(rig.cameras), 6))
        step[i] = found.turn_shift[i]
        image = np.einsum("nki,i->nk", system.by_pose[rows], step[i])
        shift = system.point_shift(step)[np.unique(views.feature[rows])]
        size, change = (_rms(residual[rows]), _rms(image)), (step[i, :3], step[i, 3:])
        most = float(np.linalg.norm(shift, axis=1).max())
        tests.append(CameraTest(camera.id, len(rows), *size, *change, most, float(found.p[i]), i in found.moved))
    # most of whose views were gross errors, with enough of them to decide
    n = len(rig.cameras)
    seen, out = np.bincount(views.camera, minlength=n), np.bincount(views.camera[~keep], minlength=n)
    rejected = tuple(rig.cameras[i].id for i in np.flatnonzero((seen >= LEAST_POINTS) & (2 * out > seen)))
    return Consistency(tuple(tests), tuple(untested), found.noise, int((~keep).sum()), rejected)


def _rms(vectors: FloatArray) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))
