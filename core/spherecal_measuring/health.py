"""A rig's health from what is measured with it, kept in its profile."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig
from spherecal_files.json_file import finite
from spherecal_measuring.measured_sets import CameraHealth, Health
from spherecal_rigs.check_rig import Verdict, camera_cause, camera_entry, camera_state, keep
from spherecal_verify.consistency import CameraTest, Consistency, examine_cameras
from spherecal_verify.outlying_views import CheckedPoints, Views

FAST_SETS = 5  # half a second at 10 Hz
SLOW_SETS = 100
# Of one test, by image noise alone: 7560 tests an hour at 10 Hz, so one false alarm in 130 hours.
_FALSE_ALARM = 1e-6
# A move below it hides among the errors of lenses, dots and refraction that residuals of real rigs hold; and below
# twice the camera's own residuals at the calibration: a few targets at rest see one place of each lens, whose error is
# the same in every set. With half of them 470 of 1500 sets of three rigs with lens errors of 0.05 px had an alarm, with
# twice them none of 6000 sets (benchmarks/studies/measure.md).
_LEAST_MOVE_PX, _OF_CALIBRATION = 0.1, 2.0
_FAST_POINTS, _SLOW_POINTS = 60, 24  # of a set: a test takes some 20 ms with them, and 60 dots show 0.1 px at once
_MOVED_MM = 5.0  # a point counts again in the long test once it was moved by as much: a fifth of a sticker


@dataclass(frozen=True)
class _Sample:
    """Some points of a set with all their views; `feature` counts from 0."""

    feature: IntArray
    camera: IntArray
    uv: FloatArray
    sigma: FloatArray
    n: int


class RigHealth:
    """The rig's health, fed with one set after the other (`add`); `state` may be read at any time."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        c = len(rig.cameras)
        self._count, self._square, self._out = np.zeros(c, int), np.zeros(c), np.zeros(c, int)
        self._fast: deque[_Sample] = deque(maxlen=FAST_SETS)
        self._slow: list[_Sample] = []
        self._placed: dict[int, FloatArray] = {}
        # of the last sets, and of the many since the long test before: a creep is seen by the latter alone
        self._moved: dict[str, dict[str, CameraTest | None]] = {"fast": {}, "slow": {}}
        self._named_at: dict[str, int] = {}
        # the newest of each kind, by camera
        self._tests: dict[str, dict[str, CameraTest]] = {"fast": {}, "slow": {}}
        self.sets = 0

    def add(
        self, number: int, views: Views, checked: CheckedPoints, key: IntArray, take: BoolArray, expected_noise: float
    ) -> None:
        """Take in a set, points by key (m,), those that did not move tested; every 5 sets, and over all every 100."""
        self.sets += 1
        c = len(self._rig.cameras)
        kept = checked.kept
        square = (checked.points.residual[kept] ** 2).sum(axis=1)
        self._count += np.bincount(views.camera[kept], minlength=c)
        self._square += np.bincount(views.camera[kept], square, c)
        out = ~kept & np.isfinite(checked.points.residual[:, 0])
        self._out += np.bincount(views.camera[out], minlength=c)
        good = take & np.isfinite(checked.points.points[:, 0])
        good &= np.bincount(views.feature, minlength=views.n_features) >= 3
        self._fast.append(_sample(views, good, _FAST_POINTS))
        # points that the long test has not seen where they are now; they are remembered
        new = np.zeros(len(key), dtype=bool)
        for i in np.flatnonzero(good).tolist():
            before = self._placed.get(int(key[i]))
            if before is None or float(np.abs(checked.points.points[i] - before).max()) > _MOVED_MM:
                new[i] = True
                self._placed[int(key[i])] = checked.points.points[i]
        new = good & new
        self._slow.append(_sample(views, new, _SLOW_POINTS))
        if self.sets % FAST_SETS == 0:
            self._test(number, "fast", list(self._fast), views, expected_noise)
        if self.sets % SLOW_SETS == 0:
            self._test(number, "slow", self._slow, views, expected_noise)
            self._slow, self._placed = [], {}

    def _test(self, number: int, kind: str, samples: Sequence[_Sample], views: Views, expected_noise: float) -> None:
        # all samples as views of one set of points
        first = np.cumsum([0, *(one.n for one in samples)])
        joined = replace(
            views,
            n_features=int(first[-1]),
            feature=np.concatenate([one.feature + at for one, at in zip(samples, first[:-1], strict=True)]),
            camera=np.concatenate([one.camera for one in samples]),
            uv=np.concatenate([one.uv for one in samples]),
            sigma=np.concatenate([one.sigma for one in samples]),
        )
        if not joined.n_features:
            return
        found = examine_cameras(joined, self._rig, expected_noise, _FALSE_ALARM)
        self._learn(number, kind, found)

    def _learn(self, number: int, kind: str, found: Consistency) -> None:
        for test in found.cameras:
            self._tests[kind][test.id] = test
            camera = self._rig.camera(test.id)
            before = (camera.rms_px or 0.0) if camera is not None else 0.0
            named = test.moved and test.move_px > max(_LEAST_MOVE_PX, _OF_CALIBRATION * before)
            self._moved[kind][test.id] = test if named else None
            if named:
                self._named_at.setdefault(test.id, number)

    @property
    def state(self) -> Health:
        """What is known so far of every camera of the rig."""
        cameras = []
        for i, camera in enumerate(self._rig.cameras):
            n = int(self._count[i])
            rms = float(np.sqrt(self._square[i] / n)) if n else None
            cameras.append(
                CameraHealth(
                    camera.id,
                    n,
                    rms,
                    camera.rms_px,
                    int(self._out[i]),
                    # the last test that named it, where that kind of test has not cleared it since
                    self._moved["fast"].get(camera.id) or self._moved["slow"].get(camera.id),
                    self._named_at.get(camera.id),
                )
            )
        tests = self._tests["fast"] | self._tests["slow"]
        return Health(self.sets, tuple(cameras), tuple(tests[c.id] for c in self._rig.cameras if c.id in tests))


def _sample(views: Views, good: BoolArray, most: int) -> _Sample:
    """At most so many of the good points, evenly from all."""
    chosen = np.flatnonzero(good)
    if len(chosen) > most:
        chosen = chosen[np.linspace(0, len(chosen) - 1, most).round().astype(int)]
    index = np.full(views.n_features, -1)
    index[chosen] = np.arange(len(chosen))
    rows = np.flatnonzero(index[views.feature] >= 0)
    return _Sample(index[views.feature[rows]], views.camera[rows], views.uv[rows], views.sigma[rows], len(chosen))


_ORDER: tuple[Verdict, ...] = ("ok", "watch", "recalibrate")


def keep_health(profile: Path, health: Health, rig: Rig, temperature_c: float | None = None) -> bool:
    """Keep the health in the profile; False for no profile, and for too few sets to judge."""
    if health.sets < SLOW_SETS or not health.tests:
        return False
    return keep(profile, health_document(health, rig), temperature_c)


def health_document(health: Health, rig: Rig) -> dict[str, object]:
    """The health in the form of check.json: every camera that was tested, by its newest test."""
    tolerance = None if rig.length_map is None else rig.length_map.typical_mm
    named = {one.camera: one.moved for one in health.cameras if one.moved is not None}
    states = [
        camera_state(named.get(test.id, test), rig, tolerance)
        for test in health.tests
        if not test.moved or test.id in named
    ]
    worst = _ORDER[max((_ORDER.index(state.verdict) for state in states), default=0)]
    causes = [camera_cause(state) for state in states if state.verdict == worst != "ok"]
    agree = Phrase("health-agree", {"sets": health.sets, "cameras": len(states)})
    said = Phrase("health-causes", {"sets": health.sets, "causes": causes}) if causes else agree
    return {
        "verdict": worst,
        "sentence": phrase(said),
        "tolerance_mm": finite(tolerance),
        "cameras": [camera_entry(state) for state in states],
        "balls": [],
        "lengths": [],
    }
