"""How late each camera exposes, estimated from motion, and points brought to one moment."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri, ndtri, stdtrit

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.rig import Rig
from spherecal.geometry.camera import project, project_with_point_derivatives
from spherecal_measuring.rejection import reject_views
from spherecal_verify.outlying_views import CheckedPoints, Views
from spherecal_verify.uncertainty import PointErrors, point_errors

# Beyond it the sets before say nothing of how a target carried by hand moved since.
_LONGEST_S = 3.0


@dataclass(frozen=True)
class Motion:
    """Of values (n, w), per second: `mean` velocities since the last set, those `now`, their `change`; NaN unknown.

    Now: that of the parabola through three sets, its `sd` (n,) what the change changed, or all of it with fewer.
    """

    mean: FloatArray
    now: FloatArray
    sd: FloatArray
    change: FloatArray
    _jerk: FloatArray
    _passed: FloatArray

    def shared_by(self, group: IntArray) -> "Motion":
        """The same, with the mean of their group's (n,) where a value's own velocity is unknown."""
        known = np.isfinite(self.now[:, 0])
        if known.all() or not known.any():
            return self
        _, of = np.unique(group, return_inverse=True)
        sums = np.zeros((of.max() + 1, self.now.shape[1] + 2))
        np.add.at(sums, of[known], np.column_stack([self.now, self.sd, np.ones(len(known))])[known])
        with np.errstate(invalid="ignore"):
            mean = (sums[:, :-1] / sums[:, -1:])[of]
        now = np.where(known[:, None], self.now, mean[:, :-1])
        return replace(self, now=now, sd=np.where(known, self.sd, mean[:, -1]))


@dataclass(frozen=True)
class _Past:
    key: IntArray
    value: FloatArray
    at_s: FloatArray
    motion: Motion


class Velocities:
    """Velocities of named vectors from set to set: of image points, or of points in space."""

    def __init__(self) -> None:
        self._past: _Past | None = None

    def of(self, key: IntArray, value: FloatArray, at_s: FloatArray) -> Motion:
        """The motion of values (n, w) with keys (n,) at times (n,) s by the sets before; unknown for new ones."""
        n, w = value.shape
        x, mean, acceleration = (np.full((n, w), np.nan) for _ in range(3))
        at, jerk, passed = (np.full(n, np.nan) for _ in range(3))
        past = self._past
        if past is not None and len(past.key):
            row = np.searchsorted(past.key, key).clip(max=len(past.key) - 1)
            same = past.key[row] == key
            row = row[same]
            x[same], at[same] = past.value[row], past.at_s[row]
            before = past.motion
            for new, old in zip(
                (mean, acceleration, jerk, passed),
                (before.mean, before.change, before._jerk, before._passed),
                strict=True,
            ):
                new[same] = old[row]
        dt = at_s - at
        with np.errstate(invalid="ignore"):
            dt[~((dt > 0) & (dt <= _LONGEST_S))] = np.nan
        velocity = (value - x) / dt[:, None]
        change = (velocity - mean) / ((dt + passed) / 2)[:, None]
        jerk_now = np.linalg.norm(change - acceleration, axis=1) / ((dt + passed) / 2)
        now = velocity + np.nan_to_num(change) * dt[:, None] / 2
        sd = np.fmax(jerk_now, jerk) * dt * (dt + passed) / 6
        sd = np.where(np.isfinite(jerk_now), sd, np.linalg.norm(change, axis=1) * dt / 2)
        sd = np.where(np.isfinite(sd), sd, np.linalg.norm(velocity, axis=1))
        return Motion(velocity, now, sd, change, jerk_now, dt)

    def keep(self, key: IntArray, value: FloatArray, at_s: FloatArray, motion: Motion) -> None:
        """Remember a set with its motion for the next: values (n, w), their numbers and times (n,), as in `of`."""
        order = np.argsort(key, kind="stable")
        arrays = (motion.mean, motion.now, motion.sd, motion.change, motion._jerk, motion._passed)
        self._past = _Past(key[order], value[order], at_s[order], Motion(*(array[order] for array in arrays)))


_TURNS = 2  # velocity times moment is no linear form; the first finds the moments, the second the velocities as well
_CHANCE = 1e-3  # that moments which are as good as stated are taken for worse
_LIMIT = 0.975  # 95 % limits are to hold
_LEAST_SD = 0.1  # mm/s: less moves nothing in 5 ms


@dataclass(frozen=True)
class Timing:
    """Each camera's moment after that of the `exposed`, `late_s` (c,): exact, or 0 with a standard uncertainty."""

    late_s: FloatArray
    sd_s: float
    exact: bool
    exposed: BoolArray

    @property
    def spread(self) -> FloatArray:
        """Moments (c, q) of standard deviation 1, their mean 0, by q independent numbers; none where exact."""
        if self.exact:
            return np.zeros((len(self.late_s), 0))
        e = self.exposed.astype(float)
        n = max(float(e.sum()), 2.0)
        return np.sqrt(n / (n - 1)) * (np.diag(e) - np.outer(e, e) / n)


@dataclass(frozen=True)
class _State:
    """What is adjusted: points x (m, 3) mm, velocities off by (t, 3) mm/s of targets, numbers z (q,) for moments."""

    x: FloatArray
    off: FloatArray
    z: FloatArray


@dataclass(frozen=True)
class _Normal:
    """Normal equations for z, (q, q) and (q,), and what view i sees move beyond its point's answer, (n, 3, q)."""

    matrix: FloatArray
    right: FloatArray
    own: FloatArray
    x_step: FloatArray  # (m, 3) without velocities and z
    x_by_off: FloatArray  # (m, 3, 3)
    x_by_z: FloatArray  # (m, 3, q), velocities held
    off_step: FloatArray  # (t, 3) without z
    off_by_z: FloatArray  # (t, 3, q)
    off_covariance: FloatArray  # (t, 3, 3)
    own_by_off: FloatArray  # (n, 3, 3)


class _Adjustment:
    """The views kept of points (m,) of targets (m,), sorted; `target` is the index among all targets."""

    def __init__(self, checked: CheckedPoints, views: Views, target: IntArray, timing: Timing, noise: float) -> None:
        rows = np.flatnonzero(checked.kept)
        _, self.target = np.unique(target, return_inverse=True)
        self.rows = rows[np.lexsort((views.feature[rows], self.target[views.feature[rows]]))]
        self.views, self.timing, self.noise = views, timing, noise
        self.feature, self.camera = views.feature[self.rows], views.camera[self.rows]
        self.uv, self.weight = views.uv[self.rows], (noise * views.sigma[self.rows]) ** -2
        self.of_row = self.target[self.feature]

    def normal(self, state: _State, motion: Motion, sd: FloatArray, sd_s: float) -> _Normal:
        """At a state; `sd` (t,) mm/s of the targets' velocities, `sd_s` of the moments."""
        feature, camera, rotation = self.feature, self.camera, self.views.rotation[self.camera]
        late_s, velocity = self.late_s(state, sd_s)[camera], self.velocity(state, motion)[feature]
        at = state.x[feature] + self.way(state, motion, feature, late_s)
        seen = np.einsum("nij,nj->ni", rotation, at) + self.views.translation[camera]
        uv, by_x = project_with_point_derivatives(seen, self.views.intrinsics[camera])
        a = by_x @ rotation
        weighted = np.swapaxes(a * self.weight[:, :, None], 1, 2)
        m, b = weighted @ a, weighted @ (uv - self.uv)[:, :, None]
        by_z = velocity[:, :, None] * (sd_s * self.timing.spread[camera])[:, None, :]
        by_off = late_s[:, None, None] * np.eye(3)
        matrices = self._by_point(m)
        cofactor = np.zeros_like(matrices)  # for points that nobody sees
        there = np.linalg.det(matrices) > 0
        cofactor[there] = np.linalg.inv(matrices[there])
        x_by_off, x_by_z = -cofactor @ self._by_point(m @ by_off), -cofactor @ self._by_point(m @ by_z)
        own_by_off = by_off + x_by_off[feature]
        turned = np.swapaxes(own_by_off, 1, 2)
        prior = (sd**-2)[:, None, None] * np.eye(3)
        off_covariance = np.asarray(np.linalg.inv(prior + self._by_target(turned @ m @ by_off)), dtype=np.float64)
        off_by_z = -off_covariance @ self._by_target(turned @ (m @ by_z))
        held = prior @ state.off[:, :, None]
        off_step = -off_covariance @ (self._by_target(turned @ b) + held)
        own = by_z + x_by_z[feature] + own_by_off @ off_by_z[self.of_row]
        flat = own.reshape(3 * len(own), own.shape[2])
        right = flat.T @ b.ravel() + np.einsum("tiq,ti->q", off_by_z, held[:, :, 0])
        return _Normal(
            flat.T @ (m @ by_z).reshape(flat.shape), right, own, -(cofactor @ self._by_point(b))[:, :, 0], x_by_off,
            x_by_z, off_step[:, :, 0], off_by_z, off_covariance, own_by_off,
        )  # fmt: skip

    def late_s(self, state: _State, sd_s: float) -> FloatArray:
        """The moments (c,) s."""
        return self.timing.late_s + sd_s * self.timing.spread @ state.z

    def velocity(self, state: _State, motion: Motion) -> FloatArray:
        """Of the points, (m, 3) mm/s."""
        return np.nan_to_num(motion.now) + state.off[self.target]

    def way(self, state: _State, motion: Motion, feature: IntArray, late_s: FloatArray) -> FloatArray:
        """Of points `feature` (n,) until moments (n,), (n, 3) mm."""
        late = late_s[:, None]
        return self.velocity(state, motion)[feature] * late + np.nan_to_num(motion.change[feature]) * late**2 / 2

    def step(self, state: _State, motion: Motion, sd: FloatArray, sd_s: float) -> _State:
        """The next state."""
        n = self.normal(state, motion, sd, sd_s)
        z = -np.linalg.solve(n.matrix + np.eye(len(n.matrix)), n.right + state.z)
        off = n.off_step + n.off_by_z @ z
        x = n.x_step + np.einsum("mij,mj->mi", n.x_by_off, off[self.target]) + n.x_by_z @ z
        return _State(state.x + x, state.off + off, state.z + z)

    def by_calibration(self, own: FloatArray, errors: PointErrors, group: IntArray, groups: int) -> FloatArray:
        """How right sides follow the cameras' parameters, (groups, c, k, w): of views that move by `own` (n, 3, k)."""
        by_parameters = -errors.checked.points.normal[self.feature] @ errors.by_camera[self.rows] / self.noise**2
        c = len(self.views.rotation)
        found = np.zeros((groups * c, own.shape[2], errors.by_camera.shape[2]))
        at = group * c + self.camera
        order = np.argsort(at, kind="stable")
        there, first = np.unique(at[order], return_index=True)
        if len(there):
            found[there] = np.add.reduceat((np.swapaxes(own, 1, 2) @ by_parameters)[order], first, axis=0)
        return found.reshape(groups, c, *found.shape[1:])

    def _by_point(self, of_rows: FloatArray) -> FloatArray:
        return _sums(of_rows, self.feature, self.views.n_features)

    def _by_target(self, of_rows: FloatArray) -> FloatArray:
        return _sums(of_rows, self.of_row, int(self.target.max(initial=-1)) + 1)


def at_one_moment(
    plain: Views,
    rough: CheckedPoints,
    timing: Timing,
    motion_of: Callable[[FloatArray], Motion],
    target: IntArray,
    expected_noise: float,
    rig: Rig,
) -> tuple[CheckedPoints, PointErrors, Motion]:
    """A set's points at its moment, errors and motion; `motion_of`: by the sets before; `target` (m,) of each."""
    adjustment = _Adjustment(rough, plain, target, timing, expected_noise)
    x = rough.points.points
    motion, groups = motion_of(x), int(adjustment.target.max(initial=-1)) + 1
    state = _State(x, np.zeros((groups, 3)), np.zeros(timing.spread.shape[1]))
    # as their points'; where nothing is known they may be as fast as the fastest, either way
    speed = np.linalg.norm(motion.now, axis=1)
    known = np.isfinite(speed)
    square = np.bincount(adjustment.target[known], motion.sd[known] ** 2, groups)
    count = np.bincount(adjustment.target[known], minlength=groups)
    fastest = float(speed[known].max(initial=0.0))
    sd = np.maximum(np.where(count > 0, np.sqrt(square / np.maximum(count, 1)), fastest), _LEAST_SD)
    sd_s = 0.0 if timing.exact else _sd_of_moments(adjustment, state, motion, sd, rough, rig)
    if not timing.exact and sd_s == 0.0:
        checked = reject_views(plain, expected_noise)
        return checked, point_errors(checked, rig), motion_of(checked.points.points)
    for _ in range(_TURNS):
        state = adjustment.step(state, motion, sd, sd_s)
        motion = motion_of(state.x)
    way = adjustment.way(state, motion, plain.feature, adjustment.late_s(state, sd_s)[plain.camera])
    there, here = (_project(plain, state.x[plain.feature] + by) for by in (way, 0.0))
    uv = plain.uv - np.nan_to_num(there - here)
    checked = reject_views(replace(plain, uv=uv), expected_noise)
    state = replace(state, x=checked.points.points)
    final = _Adjustment(checked, plain, target, timing, checked.noise)
    return checked, _errors(final, state, motion, sd, sd_s, point_errors(checked, rig)), motion


def _sd_of_moments(
    adjustment: _Adjustment, state: _State, motion: Motion, sd: FloatArray, rough: CheckedPoints, rig: Rig
) -> float:
    """The standard deviation of the moments: as stated, or what the images show where that is more beyond chance."""
    stated = adjustment.timing.sd_s
    normal = adjustment.normal(state, motion, sd, 1.0)
    errors = point_errors(replace(rough, views=adjustment.views), rig)
    group = np.zeros(len(adjustment.rows), dtype=np.int64)
    by_parameters = adjustment.by_calibration(normal.own, errors, group, 1)[0].swapaxes(0, 1)
    by_parameters = by_parameters.reshape(len(normal.right), -1)
    by_moments = normal.matrix @ normal.matrix
    expected = normal.matrix + by_parameters @ errors.cameras @ by_parameters.T + stated**2 * by_moments
    diagonal = np.diag(normal.matrix)
    size = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(expected * np.outer(size, size))
    found = values > 1e-9 * max(values[-1], 1e-300)
    whitened = (vectors[:, found] / np.sqrt(values[found])).T * size
    excess = float(((whitened @ normal.right) ** 2).sum())
    freedom = int(found.sum())
    if not freedom or excess <= chdtri(freedom, _CHANCE):
        return stated
    more = (excess - freedom) / float(np.trace(whitened @ by_moments @ whitened.T))
    few = float(stdtrit(freedom, _LIMIT) / ndtri(_LIMIT))  # a deviation that few cameras show is itself unsure
    return float(np.hypot(stated, few * np.sqrt(more)))


def _errors(
    adjustment: _Adjustment, state: _State, motion: Motion, sd: FloatArray, sd_s: float, errors: PointErrors
) -> PointErrors:
    """The points' errors with what velocities and moments add to them."""
    n, target = adjustment.normal(state, motion, sd, sd_s), adjustment.target
    groups = len(sd)
    c, w = len(adjustment.views.rotation), errors.by_camera.shape[2]
    # as the noise of each dot it is so much larger that the mean of the target's dots has it once
    dots = np.bincount(target[np.unique(adjustment.feature)], minlength=groups)
    noise = n.x_by_off @ n.off_covariance[target] @ np.swapaxes(n.x_by_off, 1, 2) * dots[target, None, None]
    off_by = -n.off_covariance[:, None] @ adjustment.by_calibration(n.own_by_off, errors, adjustment.of_row, groups)
    feature = adjustment.views.feature
    by_camera = errors.by_camera + n.x_by_off[feature] @ off_by[target[feature], adjustment.views.camera]
    group = np.zeros(len(adjustment.rows), dtype=np.int64)
    by_parameters = adjustment.by_calibration(n.own, errors, group, 1)[0].swapaxes(0, 1).reshape(-1, c * w)
    cofactor = np.linalg.inv(n.matrix + np.eye(len(n.matrix)))
    z_by = -cofactor @ by_parameters
    both = z_by @ errors.cameras
    return replace(
        errors,
        covariance=errors.covariance + noise,
        by_camera=by_camera * errors.checked.kept[:, None, None],
        cameras=np.block([[errors.cameras, both.T], [both, cofactor + both @ z_by.T]]),
        by_shared=n.x_by_z + n.x_by_off @ n.off_by_z[target],
    )


def _project(views: Views, at: FloatArray) -> FloatArray:
    """Of points (n, 3), one for each view."""
    seen = np.einsum("nij,nj->ni", views.rotation[views.camera], at) + views.translation[views.camera]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return project(seen, views.intrinsics[views.camera])


def _sums(of_rows: FloatArray, group: IntArray, groups: int) -> FloatArray:
    """Sums (groups, ...) of sorted rows."""
    found = np.zeros((groups, *of_rows.shape[1:]))
    there, first = np.unique(group, return_index=True)
    if len(there):
        found[there] = np.add.reduceat(of_rows, first, axis=0)
    return found
