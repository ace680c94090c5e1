"""Sets of live cameras: captured one after the other, targets found around their last places."""

import threading
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import dataclass
from math import inf

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Observations
from spherecal.data.rig import Rig, RigCamera
from spherecal.targets.detection import Detections, DetectionSettings, Detector
from spherecal.targets.family import DOTS
from spherecal.targets.images import balance_mosaic
from spherecal.targets.target_set import TargetSet
from spherecal_cameras.protocol import CameraError, CameraSource, CaptureRequest, Discovery, Frame, FrameSet
from spherecal_files.filesystem import as_id
from spherecal_measuring.measured_sets import ObservedSet
from spherecal_measuring.search_regions import FULL_PERIOD_S, RegionSearch

_PATIENCE_S = 0.1  # between looks at the user's wish to stop
_WORKERS = 2  # images at a time; kernels leave the interpreter alone


@dataclass(frozen=True)
class LiveSettings:
    """How sets are taken: at most `rate_hz` a second, `sets` of them or for `seconds` (None: until stopped).

    `timeout_s` is that of one set; cameras that deliver nothing until then are left out of it. `period_s`: how often
    each whole image is searched; 0 searches whole images only.
    """

    rate_hz: float = 10.0
    sets: int | None = None
    seconds: float | None = None
    timeout_s: float = 1.0
    period_s: float = FULL_PERIOD_S


def rig_cameras_of(rig: Rig, discovery: Discovery, names: Mapping[str, str] | None = None) -> dict[str, RigCamera]:
    """The rig's camera for each serial number that was found: by serial, else by the camera's name."""
    by_serial = {camera.serial: camera for camera in rig.cameras if camera.serial}
    found = {serial: by_serial[serial] for serial in discovery.serials if serial in by_serial}
    by_name: dict[str, str] = {}
    for info in discovery.cameras:
        for name in ((names or {}).get(info.serial, ""), info.user_name, info.serial):
            camera = rig.camera(as_id(name, "")) if name and info.serial not in found else None
            if camera is not None and camera.id in by_name:
                alike = {"name": repr(camera.id), "cameras": [by_name[camera.id], info.serial]}
                raise InputError(Phrase("error-camera-ambiguous", alike))
            if camera is not None and camera not in found.values():
                found[info.serial], by_name[camera.id] = camera, info.serial
    if not found:
        there = [info.user_name or info.serial for info in discovery.cameras[:12]] or Phrase("nothing")
        raise InputError(
            Phrase("error-cameras-not-rigs", {"found": there, "cameras": [camera.id for camera in rig.cameras[:12]]})
        )
    return {serial: found[serial] for serial in discovery.serials if serial in found}


class LiveSets:
    """The sets of an open source: iterate over it; the next set is captured while the last one is searched."""

    def __init__(
        self,
        source: CameraSource,
        cameras: Mapping[str, RigCamera],
        target_set: TargetSet,
        settings: LiveSettings | None = None,
        context: Context | None = None,
    ) -> None:
        self._source, self._cameras = source, dict(cameras)
        self._settings, self._context = settings or LiveSettings(), context or Context()
        detector = Detector(target_set)
        self._searches: dict[str, RegionSearch] = {}
        for i, (serial, camera) in enumerate(self._cameras.items()):
            turn = (i + 1) / len(self._cameras)
            period = self._settings.period_s
            self._searches[serial] = RegionSearch(detector.detect, known_of(camera), turn, period)
        self._ids = tuple(camera.id for camera in self._cameras.values())
        self._stop = threading.Event()
        self.missing: dict[str, int] = {}

    def stop(self) -> None:
        """End after the set that is being taken."""
        self._stop.set()

    def __iter__(self) -> Iterator[ObservedSet]:
        capture_pool, search_pool = ThreadPoolExecutor(1, "capture"), ThreadPoolExecutor(_WORKERS, "search")
        began, most = time.perf_counter(), self._settings
        last, until = most.sets or inf, began + (most.seconds or inf)
        number, captured_s, searched_s = 0, 0.0, 0.0
        try:
            future = capture_pool.submit(self._capture, 0.0)
            while not self._stop.is_set() and number < last and time.perf_counter() < until:
                taken, captured_s = self._wait(future)
                # captured so that it is there when this set is done, not before: waiting images are late ones
                pause = max(searched_s - captured_s, 1 / self._settings.rate_hz - captured_s, 0.0)
                future = capture_pool.submit(self._capture, pause)
                start = time.perf_counter()
                number += 1
                yield self._search(number, taken, search_pool, began)
                searched_s = time.perf_counter() - start
        finally:
            self._stop.set()
            for pool in (capture_pool, search_pool):
                pool.shutdown(wait=True, cancel_futures=True)

    def _capture(self, pause_s: float) -> tuple[FrameSet, float]:
        """A set with one image or more, and the seconds that it took."""
        self._stop.wait(pause_s)
        request = CaptureRequest(tuple(self._cameras), self._settings.timeout_s, 0)
        silent = 0
        while True:
            start = time.perf_counter()
            try:
                taken = self._source.capture_set(request)
            except (CancelledError, KeyError, RuntimeError):  # what a source meets that is closed meanwhile
                raise CameraError(Phrase("error-closed-measuring")) from None
            for one in taken.missing:
                self.missing[one.camera] = self.missing.get(one.camera, 0) + 1
            if taken.frames or self._stop.is_set():
                return taken, time.perf_counter() - start
            silent += 1
            if silent >= 3:
                one = taken.missing[0]
                values = {"camera": self._cameras[one.camera].id, "cause": one.cause}
                raise CameraError(Phrase("error-no-camera-sends", values), one.remedy)

    def _wait(self, future: Future[tuple[FrameSet, float]]) -> tuple[FrameSet, float]:
        while True:
            self._context.check()
            try:
                return future.result(_PATIENCE_S)
            except TimeoutError:  # it may have ended between the wait and this look
                if future.done():
                    return future.result()

    def _search(self, number: int, taken: FrameSet, pool: ThreadPoolExecutor, began: float) -> ObservedSet:
        frames = [(serial, frame) for serial, frame in taken.frames.items() if serial in self._searches]
        for serial, frame in frames:
            camera = self._cameras[serial]
            height, width = frame.image.shape
            if (width, height) != camera.image_size:
                values = {
                    "camera": camera.id, "width": width, "height": height, "rig_width": camera.image_size[0],
                    "rig_height": camera.image_size[1],
                }  # fmt: skip
                raise InputError(Phrase("error-sends-size", values))
        jobs = [pool.submit(self._search_one, serial, frame) for serial, frame in frames]
        found = [job.result() for job in jobs]
        index = {serial: i for i, serial in enumerate(self._cameras)}
        observations = collected([index[serial] for serial, _ in frames], found, self._ids)
        exposure = {self._cameras[serial].id: frame.taken_s - began for serial, frame in frames}
        moment = float(np.mean(list(exposure.values()))) if exposure else None
        arrived = max((frame.arrived_s for _, frame in frames), default=None)
        return ObservedSet(number, "", observations, moment, exposure, arrived)

    def _search_one(self, serial: str, frame: Frame) -> Detections:
        # whether an image is a mosaic takes 20 ms to decide by its pixels; the cameras' own word is free
        image = frame.image if frame.pixel_format.startswith("Mono") else balance_mosaic(frame.image)
        return self._searches[serial].find(image, frame.taken_s)


def known_of(camera: RigCamera) -> DetectionSettings:
    """What the rig says of a camera, for detection: focal length, principal point and image size."""
    k = camera.intrinsics
    return DetectionSettings(float(k[0]), (float(k[2]), float(k[3])), camera.image_size)


def collected(cameras: list[int], found: list[Detections], ids: tuple[str, ...]) -> Observations:
    """The detections of some cameras' images as the observations of one set."""
    count = [len(one) for one in found]
    none: list[np.ndarray] = [np.empty((0, 2))]
    points = next((one.points for one in found if len(one)), DOTS)  # a part without targets names no family
    return Observations(
        ("",), ids, points, np.zeros(sum(count), dtype=np.int64), np.repeat(np.array(cameras, dtype=np.int64), count),
        np.concatenate([np.empty(0, np.int64), *(one.target for one in found)]),
        np.concatenate([np.empty(0, np.int64), *(one.point for one in found)]),
        np.concatenate([*none, *(one.uv for one in found)]),
        np.concatenate([*none, *(one.sigma_uv for one in found)]),
    )  # fmt: skip
