"""One set after the other through the rig: places, values, bodies, contradictions, health."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.threads import on_one_blas_thread
from spherecal.data.rig import Rig
from spherecal.data.rig_camera import posed
from spherecal_measuring import measured_sets
from spherecal_measuring.health import RigHealth
from spherecal_measuring.lateness import Timing, Velocities, at_one_moment
from spherecal_measuring.measuring_task import Task
from spherecal_measuring.places import Layouts, LocatedPoints, triangulate_places
from spherecal_measuring.pose import Unmeasured, measure_bar, measure_body, measure_ruler
from spherecal_measuring.rejection import reject_views
from spherecal_verify.outlying_views import LEAST_REDUNDANCY, CheckedPoints, Views
from spherecal_verify.participation import lens_corrected
from spherecal_verify.uncertainty import PointErrors, point_errors

_POINTS = 1024  # names of points on a target; a key is target * _POINTS + point
_FORGET = 0.98  # of the noise's sums from set to set: some 50 sets count
_ROOM_S = 5e-3  # views of what moves are first compared as if exposed so far apart, whatever is stated
_MATTERS = 0.5  # of an image point's standard deviation: less is not worth an adjustment of its own
_STILL_PX = 2.0  # what a target at rest may move from set to set and still count for the cameras' health


class Measurer:
    """Measures sets with a rig, and remembers motion, noise and health of earlier ones; `task` None: every point."""

    def __init__(self, rig: Rig, task: Task | None = None) -> None:
        self.rig, self.task = rig, task or Task()
        self._index = {camera.id: i for i, camera in enumerate(rig.cameras)}
        self._layouts = Layouts(self.task.target_set, ())
        self._image_motion, self._point_motion, self._motion = Velocities(), Velocities(), Velocities()
        self._health = RigHealth(rig)
        self._cost, self._redundancy = 0.0, 0.0
        self._last_s: float | None = None
        self._cameras = posed(rig.cameras)

    @property
    def health(self) -> measured_sets.Health:
        """The rig's health over all sets so far."""
        return self._health.state

    @on_one_blas_thread
    def measure(self, observed: measured_sets.ObservedSet) -> measured_sets.MeasuredSet:
        """The points of one set in the rig's world, what the task asks for, and what contradicts, by rig cameras."""
        o = observed.observations
        in_rig = np.array([self._index.get(name, -1) for name in o.cameras], dtype=np.int64)
        rows = np.flatnonzero(in_rig[o.camera] >= 0)
        camera, target, point = in_rig[o.camera[rows]], o.target[rows], o.point[rows]
        key, feature = np.unique(target * _POINTS + point, return_inverse=True)
        sigma = np.ones((len(rows), 2)) if o.sigma is None else o.sigma[rows]
        expected = self._expected_noise(observed)
        uv, sigma = lens_corrected(self.rig.cameras, camera, o.uv[rows], sigma, expected)
        plain = Views(feature, camera, uv, sigma, len(key), self._cameras)
        checked, errors, velocity = self._checked(plain, key, observed, expected)
        if o.points != self._layouts.points:
            self._layouts = Layouts(self.task.target_set, o.points)
        places = triangulate_places(key // _POINTS, key % _POINTS, self._layouts, self.task.wanted, errors)
        if self._last_s is not None or observed.time_s is None:  # what moves is not known to in the first set
            self._learn_noise(checked)
        still = self._still_points(feature, len(key), velocity, observed.time_s)
        self._health.add(observed.number, plain, checked, key, still, expected)
        values, bodies, missing = self._derived(places, errors)
        exposed = list((observed.exposure_s or {}).values())
        result = measured_sets.MeasuredSet(
            observed.number, observed.id, observed.time_s, places.names, places.places_mm, places.covariance,
            places.views, np.array([len(dots) for dots in places.dots], dtype=np.int64),
            self._speeds(places, observed.time_s), values, bodies, missing,
            _contradictions(self.rig, checked, key // _POINTS), _camera_residuals(self.rig, checked), checked.noise,
            max(exposed) - min(exposed) if len(exposed) > 1 else None, None,
        )  # fmt: skip
        if observed.time_s is not None:
            self._last_s = observed.time_s
        if observed.arrived_s is not None:
            result = replace(result, latency_s=time.perf_counter() - observed.arrived_s)
        return result

    def _expected_noise(self, observed: measured_sets.ObservedSet) -> float:
        """What image points of earlier sets showed, in units of sigma; else what their sigmas or the rig say."""
        if self._redundancy >= LEAST_REDUNDANCY:
            return float(np.sqrt(self._cost / self._redundancy))
        return 1.0 if observed.observations.sigma is not None else self.rig.quality.sigma0 or 1.0

    def _learn_noise(self, checked: CheckedPoints) -> None:
        views, kept = checked.views, checked.kept
        seen = np.unique(views.feature[kept])
        freedom = max(2 * int(kept.sum()) - 3 * len(seen), 0)
        cost = float(((checked.points.residual[kept] / views.sigma[kept]) ** 2).sum()) if freedom else 0.0
        self._cost, self._redundancy = _FORGET * self._cost + cost, _FORGET * self._redundancy + freedom

    def _checked(
        self, plain: Views, key: IntArray, observed: measured_sets.ObservedSet, expected: float
    ) -> tuple[CheckedPoints, PointErrors, FloatArray]:
        """The points at the set's moment, their errors, and the image points' velocities (n, 2) px/s, NaN unknown."""
        if observed.time_s is None:
            checked = reject_views(plain, expected)
            return checked, point_errors(checked, self.rig), np.full(plain.uv.shape, np.nan)
        timing = self._timing(observed)
        at_s = observed.time_s + timing.late_s[plain.camera]
        of_view = key[plain.feature] * len(self.rig.cameras) + plain.camera
        seen = self._image_motion.of(of_view, plain.uv, at_s)
        self._image_motion.keep(of_view, plain.uv, at_s, seen)
        # where nothing is known of a motion, that of the fastest is assumed
        speed = np.linalg.norm(seen.now, axis=1)
        fastest = float(np.nanmax(speed, initial=0.0))
        room_s = _ROOM_S if timing.exact else max(timing.sd_s, _ROOM_S)
        room = np.where(np.isfinite(speed), speed, fastest)[:, None] * room_s
        moves = bool((room > _MATTERS * plain.sigma * expected).any())
        checked = reject_views(replace(plain, sigma=np.hypot(plain.sigma, room)) if moves else plain, expected)
        time_s, target = np.full(len(key), observed.time_s), key // _POINTS
        if moves:
            checked, errors, motion = at_one_moment(
                plain, checked, timing, lambda x: self._point_motion.of(key, x, time_s).shared_by(target), target,
                expected, self.rig,
            )  # fmt: skip
        else:
            errors = point_errors(checked, self.rig)
            motion = self._point_motion.of(key, checked.points.points, time_s)
        self._point_motion.keep(key, checked.points.points, time_s, motion)
        return checked, errors, seen.mean

    def _timing(self, observed: measured_sets.ObservedSet) -> Timing:
        """Each camera's moment: exact, or off by what is stated, or else by what the moments scatter."""
        exposed = observed.exposure_s or {}
        here = (
            np.array([c.id in exposed for c in self.rig.cameras]) if exposed else np.ones(len(self.rig.cameras), bool)
        )
        if self.task.correct_exposure and exposed:
            late = [exposed.get(c.id, observed.time_s or 0.0) - (observed.time_s or 0.0) for c in self.rig.cameras]
            return Timing(np.array(late), 0.0, True, here)
        sd_s = self.task.exposure_sd_s
        if sd_s is None:
            sd_s = float(np.std(list(exposed.values()))) if len(exposed) > 1 else 0.0
        return Timing(np.zeros(len(self.rig.cameras)), sd_s, False, here)

    def _still_points(self, feature: IntArray, n: int, velocity: FloatArray, time_s: float | None) -> BoolArray:
        """Points that did not move since the last set: a camera that exposes late would seem moved by the others."""
        if time_s is None or self.task.exposure_sd_s == 0.0:
            return np.ones(n, dtype=bool)
        still = np.ones(n, dtype=bool)
        if self._last_s is None:
            return ~still
        shift = np.linalg.norm(velocity, axis=1) * (time_s - self._last_s)
        still[feature[~(shift <= _STILL_PX)]] = False
        return still

    def _speeds(self, places: LocatedPoints, time_s: float | None) -> FloatArray:
        """Of the places, mm/s, since the last set; NaN where unknown."""
        if time_s is None:
            return np.full(len(places), np.nan)
        column = {name: i for i, name in enumerate(self._layouts.points)}
        key = [name.target * _POINTS + column.get(name.point, _POINTS - 1) for name in places.names]
        at_s = np.full(len(places), time_s)
        names = np.array(key, dtype=np.int64)
        motion = self._motion.of(names, places.places_mm, at_s)
        self._motion.keep(names, places.places_mm, at_s, motion)
        return np.linalg.norm(motion.mean, axis=1)

    def _derived(
        self, places: LocatedPoints, errors: PointErrors
    ) -> tuple[
        tuple[measured_sets.MeasuredValue, ...], tuple[measured_sets.BodyPose, ...], tuple[tuple[str, str], ...]
    ]:
        task = self.task
        values = [(one.name, measure_ruler(one, places, self.rig, errors.with_scale)) for one in task.rulers]
        for bar in task.bars:
            values += [(bar.id, one) for one in measure_bar(bar, places, errors, self.rig, task.temperature_c)]
        bodies = [(body.name, measure_body(body, places)) for body in task.bodies]
        return (
            tuple(value for _, value in values if not isinstance(value, Unmeasured)),
            tuple(pose for _, pose in bodies if not isinstance(pose, Unmeasured)),
            tuple((name, one.reason) for name, one in (*values, *bodies) if isinstance(one, Unmeasured)),
        )


def measure_sets(
    sets: Iterable[measured_sets.ObservedSet], measurer: Measurer, context: Context | None = None
) -> Iterator[measured_sets.MeasuredSet]:
    """Measure sets as they come; the one seam of command line, window and Python."""
    context = context or Context()
    for one in sets:
        context.check()
        yield measurer.measure(one)


def _contradictions(rig: Rig, checked: CheckedPoints, target: IntArray) -> tuple[measured_sets.Contradiction, ...]:
    """Views left out by target and camera, most first; then targets of which points were given up."""
    views = checked.views
    of_view = target[views.feature]
    out = ~checked.kept & ~checked.contradicting[views.feature] & np.isfinite(checked.points.residual[:, 0])
    found = []
    pairs, count = np.unique(np.stack([of_view[out], views.camera[out]]), axis=1, return_counts=True)
    for (one, camera), views_out in zip(pairs.T.tolist(), count.tolist(), strict=True):
        of = int(((of_view == one) & (views.camera == camera)).sum())
        found.append(measured_sets.Contradiction(one, rig.cameras[camera].id, views_out, of))
    found.sort(key=lambda c: -c.views)
    given_up, count = np.unique(target[checked.contradicting], return_counts=True)
    for one, points in zip(given_up.tolist(), count.tolist(), strict=True):
        found.append(measured_sets.Contradiction(one, None, points, int((target == one).sum())))
    return tuple(found)


def _camera_residuals(rig: Rig, checked: CheckedPoints) -> tuple[measured_sets.CameraResidual, ...]:
    """Every camera that sees anything."""
    found = []
    square = (checked.points.residual**2).sum(axis=1)
    out = ~checked.kept & np.isfinite(square)
    for i, camera in enumerate(rig.cameras):
        mine = checked.views.camera == i
        if mine.any():
            used = mine & checked.kept
            rms = float(np.sqrt(square[used].mean())) if used.any() else None
            found.append(measured_sets.CameraResidual(camera.id, int(mine.sum()), int((mine & out).sum()), rms))
    return tuple(found)
