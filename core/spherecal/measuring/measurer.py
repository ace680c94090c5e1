"""One set after the other through the rig: places, values, bodies, contradictions, health."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.context import Context
from spherecal.geometry.camera import project
from spherecal.measuring.health import RigHealth
from spherecal.measuring.motion import Velocities, enlarged, moving, with_time_errors
from spherecal.measuring.places import Layouts, Places, locate
from spherecal.measuring.pose import measure_body
from spherecal.measuring.rejection import reject_views
from spherecal.measuring.results import (
    BodyPose,
    CameraResidual,
    Contradiction,
    Health,
    MeasuredSet,
    MeasuredValue,
    ObservedSet,
)
from spherecal.measuring.task import Task
from spherecal.measuring.values import Unmeasured, measure_bar, measure_ruler
from spherecal.rig import Rig
from spherecal.threads import on_one_blas_thread
from spherecal.verify.outlying_views import LEAST_REDUNDANCY, CheckedPoints, Views
from spherecal.verify.uncertainty import PointErrors, point_errors

STAGE = "measure"
_POINTS = 1024  # names of points on a target; a key is target * _POINTS + point
_FORGET = 0.98  # of the noise's sums from set to set: some 50 sets count
_STILL_PX = 2.0  # what a target at rest may move from set to set and still count for the cameras' health


class Measurer:
    """Measures sets with a rig; it remembers what it needs of earlier ones: motion, noise, health."""

    def __init__(self, rig: Rig, task: Task | None = None) -> None:
        self.rig, self.task = rig, task or Task()
        self._index = {camera.id: i for i, camera in enumerate(rig.cameras)}
        self._layouts = Layouts(self.task.target_set, ())
        self._image_motion, self._point_motion, self._motion = Velocities(), Velocities(), Velocities()
        self._health = RigHealth(rig)
        self._cost, self._redundancy = 0.0, 0.0
        self._last_s: float | None = None
        self._intrinsics = np.array([c.intrinsics for c in rig.cameras]).reshape(-1, 16)
        self._rotation = np.array([c.rotation for c in rig.cameras]).reshape(-1, 3, 3)
        self._translation = np.array([c.translation_mm for c in rig.cameras]).reshape(-1, 3)

    @property
    def health(self) -> Health:
        """The rig's health over all sets so far."""
        return self._health.state

    @on_one_blas_thread
    def measure(self, observed: ObservedSet) -> MeasuredSet:
        """One set; cameras that the rig does not have are left out."""
        o = observed.observations
        in_rig = np.array([self._index.get(name, -1) for name in o.cameras], dtype=np.int64)
        rows = np.flatnonzero(in_rig[o.camera] >= 0)
        camera, target, point = in_rig[o.camera[rows]], o.target[rows], o.point[rows]
        key, feature = np.unique(target * _POINTS + point, return_inverse=True)
        sigma = np.ones((len(rows), 2)) if o.sigma is None else o.sigma[rows]
        plain = Views(feature, camera, o.uv[rows], sigma, len(key), self._intrinsics, self._rotation, self._translation)
        expected = self._expected_noise(o.sigma is not None)
        views, velocity, sd_s = self._with_motion(plain, key, observed, expected)
        checked = reject_views(views, expected)
        if self.task.correct_exposure and observed.time_s is not None:
            views, checked = self._at_one_moment(plain, views, checked, key, observed, expected)
        errors = point_errors(views, checked, self.rig.covariance, self.rig)
        if views is not plain and sd_s:
            errors = with_time_errors(errors, views, checked, sigma, velocity, sd_s)
        if o.points != self._layouts.points:
            self._layouts = Layouts(self.task.target_set, o.points)
        places = locate(key // _POINTS, key % _POINTS, self._layouts, self.task.wanted, views, checked, errors)
        if not sd_s or not moving(velocity, sd_s, sigma).any():
            self._learn_noise(views, checked)
        still = self._still_points(feature, len(key), velocity, observed.time_s)
        self._health.add(observed.number, plain, checked, key, still, expected)
        values, bodies, missing = self._derived(places, views, errors)
        result = MeasuredSet(
            observed.number, observed.id, observed.time_s, places.names, places.places_mm, places.covariance,
            places.views, self._speeds(places, observed.time_s), values, bodies, missing,
            _contradictions(self.rig, views, checked, key // _POINTS), _camera_residuals(self.rig, views, checked),
            checked.noise, _skew(observed), None,
        )  # fmt: skip
        if observed.time_s is not None:
            self._last_s = observed.time_s
        if observed.arrived_s is not None:
            result = replace(result, latency_s=time.perf_counter() - observed.arrived_s)
        return result

    # --- noise and motion --------------------------------------------------------------------------------------------

    def _expected_noise(self, with_sigma: bool) -> float:
        """What image points of earlier sets showed, in units of sigma; else what their sigmas or the rig say."""
        if self._redundancy >= LEAST_REDUNDANCY:
            return float(np.sqrt(self._cost / self._redundancy))
        return 1.0 if with_sigma else self.rig.quality.sigma0 or 1.0

    def _learn_noise(self, views: Views, checked: CheckedPoints) -> None:
        kept = checked.kept
        seen = np.unique(views.feature[kept])
        freedom = max(2 * int(kept.sum()) - 3 * len(seen), 0)
        cost = float(((checked.points.residual[kept] / views.sigma[kept]) ** 2).sum()) if freedom else 0.0
        self._cost, self._redundancy = _FORGET * self._cost + cost, _FORGET * self._redundancy + freedom

    def _with_motion(
        self, views: Views, key: IntArray, observed: ObservedSet, noise: float
    ) -> tuple[Views, FloatArray, float]:
        """The views at the set's moment, image velocities (n, 2) px/s, and the standard uncertainty of times."""
        n = len(views.uv)
        velocity = np.full((n, 2), np.nan)
        if observed.time_s is None:
            return views, velocity, 0.0
        exposed = observed.exposure_s or {}
        at_s = self._exposure(observed)[views.camera]
        of_view = key[views.feature] * len(self.rig.cameras) + views.camera
        velocity = self._image_motion.of(of_view, views.uv, at_s)
        if self.task.correct_exposure:
            uv = views.uv + np.nan_to_num(velocity) * (observed.time_s - at_s)[:, None]
            views, spread = replace(views, uv=uv), 0.0
        else:
            known = [exposed[c.id] for c in self.rig.cameras if c.id in exposed]
            spread = float(np.std(known)) if len(known) > 1 else 0.0
        sd_s = spread if self.task.exposure_sd_s is None else self.task.exposure_sd_s
        if sd_s and moving(velocity, sd_s, noise * views.sigma).any():
            views = enlarged(views, velocity, sd_s)
        return views, velocity, sd_s

    def _at_one_moment(
        self, plain: Views, views: Views, checked: CheckedPoints, key: IntArray, observed: ObservedSet, noise: float
    ) -> tuple[Views, CheckedPoints]:
        """Views brought to the set's moment by the points' velocities in space, and the points anew.

        Velocities in the images, with which `views` were moved, lag: at 1 m/s and 10 Hz perspective changes them by
        some per cent from set to set, 0.15 mm for 5 ms of skew; velocities in space by nothing on a straight way.
        """
        velocity = self._point_motion.of(key, checked.points.points, np.full(len(key), observed.time_s))
        v, x = velocity[views.feature], checked.points.points[views.feature]
        known = np.isfinite(v).all(axis=1) & np.isfinite(x).all(axis=1)
        if not known.any():
            return views, checked
        late = self._exposure(observed)[views.camera] - (observed.time_s or 0.0)
        here, there = (self._project(views.camera[known], at) for at in (x[known], (x + v * late[:, None])[known]))
        uv = views.uv.copy()
        uv[known] = plain.uv[known] - (there - here)
        views = replace(views, uv=uv)
        return views, reject_views(views, noise)

    def _project(self, camera: IntArray, points: FloatArray) -> FloatArray:
        x = np.einsum("nij,nj->ni", self._rotation[camera], points) + self._translation[camera]
        return project(x, self._intrinsics[camera])

    def _exposure(self, observed: ObservedSet) -> FloatArray:
        """Each camera's moment of exposure (c,)."""
        exposed = observed.exposure_s or {}
        return np.array([exposed.get(c.id, observed.time_s or 0.0) for c in self.rig.cameras])

    def _still_points(self, feature: IntArray, n: int, velocity: FloatArray, time_s: float | None) -> BoolArray:
        """Points that stood still since the last set: a camera that exposes late would seem moved by the others."""
        if time_s is None or self.task.exposure_sd_s == 0.0:
            return np.ones(n, dtype=bool)
        still = np.ones(n, dtype=bool)
        if self._last_s is None:
            return ~still
        shift = np.linalg.norm(velocity, axis=1) * (time_s - self._last_s)
        still[feature[~(shift <= _STILL_PX)]] = False
        return still

    def _speeds(self, places: Places, time_s: float | None) -> FloatArray:
        """Of the places, mm/s, since the last set; NaN where unknown."""
        if time_s is None:
            return np.full(len(places), np.nan)
        column = {name: i for i, name in enumerate(self._layouts.points)}
        key = [name.target * _POINTS + column.get(name.point, _POINTS - 1) for name in places.names]
        at_s = np.full(len(places), time_s)
        return np.linalg.norm(self._motion.of(np.array(key, dtype=np.int64), places.places_mm, at_s), axis=1)

    # --- what is asked for -------------------------------------------------------------------------------------------

    def _derived(
        self, places: Places, views: Views, errors: PointErrors
    ) -> tuple[tuple[MeasuredValue, ...], tuple[BodyPose, ...], tuple[tuple[str, str], ...]]:
        values: list[MeasuredValue] = []
        bodies: list[BodyPose] = []
        missing: list[tuple[str, str]] = []
        for ruler in self.task.rulers:
            one = measure_ruler(ruler, places, self.rig, errors.with_scale)
            if isinstance(one, Unmeasured):
                missing.append((ruler.name, one.reason))
            else:
                values.append(one)
        for bar in self.task.bars:
            for value in measure_bar(bar, places, views, errors, self.rig, self.task.temperature_c):
                if isinstance(value, Unmeasured):
                    missing.append((bar.id, value.reason))
                else:
                    values.append(value)
        for body in self.task.bodies:
            pose = measure_body(body, places)
            if isinstance(pose, Unmeasured):
                missing.append((body.name, pose.reason))
            else:
                bodies.append(pose)
        return tuple(values), tuple(bodies), tuple(missing)


def measure_sets(
    sets: Iterable[ObservedSet], measurer: Measurer, context: Context | None = None
) -> Iterator[MeasuredSet]:
    """Measure sets as they come; the one seam of command line, window and Python."""
    context = context or Context()
    for observed in sets:
        context.check()
        yield measurer.measure(observed)


def _skew(observed: ObservedSet) -> float | None:
    times = list((observed.exposure_s or {}).values())
    return max(times) - min(times) if len(times) > 1 else None


def _contradictions(rig: Rig, views: Views, checked: CheckedPoints, target: IntArray) -> tuple[Contradiction, ...]:
    """Views left out by target and camera, most first; then targets of which points were given up."""
    of_view = target[views.feature]
    out = ~checked.kept & ~checked.contradicting[views.feature] & np.isfinite(checked.points.residual[:, 0])
    found = []
    pairs, count = np.unique(np.stack([of_view[out], views.camera[out]]), axis=1, return_counts=True)
    for (one, camera), views_out in zip(pairs.T.tolist(), count.tolist(), strict=True):
        of = int(((of_view == one) & (views.camera == camera)).sum())
        found.append(Contradiction(one, rig.cameras[camera].id, views_out, of))
    found.sort(key=lambda c: -c.views)
    given_up, count = np.unique(target[checked.contradicting], return_counts=True)
    for one, points in zip(given_up.tolist(), count.tolist(), strict=True):
        found.append(Contradiction(one, None, points, int((target == one).sum())))
    return tuple(found)


def _camera_residuals(rig: Rig, views: Views, checked: CheckedPoints) -> tuple[CameraResidual, ...]:
    """Every camera that sees anything."""
    found = []
    square = (checked.points.residual**2).sum(axis=1)
    out = ~checked.kept & np.isfinite(square)
    for i, camera in enumerate(rig.cameras):
        mine = views.camera == i
        if mine.any():
            used = mine & checked.kept
            rms = float(np.sqrt(square[used].mean())) if used.any() else None
            found.append(CameraResidual(camera.id, int(mine.sum()), int((mine & out).sum()), rms))
    return tuple(found)
