"""The open cameras and the targets in their live images, found and followed in threads of their own; who was moved."""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.targets.detection import Detections, DetectionSettings, Detector
from spherecal.targets.family import make_target_set
from spherecal.targets.following import Follower
from spherecal.targets.images import balance_mosaic
from spherecal.targets.masks import Rectangle
from spherecal_boards.board_images import BoardDetector
from spherecal_cameras.averaging import STILL_PX, stillness
from spherecal_cameras.camera_network import WireCamera
from spherecal_cameras.camera_settings import CameraProfile
from spherecal_cameras.capture import SessionCamera
from spherecal_cameras.new_recording import RigCameras
from spherecal_cameras.plan import CapturePlan
from spherecal_cameras.protocol import CameraInfo, CameraSource, Discovery, Frame, SetupReport
from spherecal_gui.coverage import Dots, dot_keys
from spherecal_gui.tasks.jobs import detector_of

# Of the median dot. At rest it stays below 0.03 px (simulated rigs, 32 to 420 dots); a camera that warms up drifts by
# some tenths in an hour. A ball that was moved shows in every camera that sees it.
BUMP_PX = 1.0
_OTHERS_STILL_PX = 0.25  # the others: a ball nudged by BUMP_PX in one camera's image moves by more in another's
_LEAST_DOTS = 16  # that two images have in common: half of a bar's
_LEAST_OTHERS = 2  # cameras that must have stayed where they are
_SETTLE_S = 1.0  # images that arrive sooner after a movement may still be older than it
_AGREE = 2  # images in a row that show the shift: one alone may be of a ball in motion


@dataclass
class _Seen:
    """A camera's dots when the scene came to rest, and what has become of them."""

    keys: IntArray
    uv: FloatArray
    at_s: float
    shift_px: float | None = None
    moved_s: float | None = None
    agreeing: int = 0
    bumped: bool = False


class BumpWatch:
    """Fed with every camera's dots, image after image, by one thread; `bumped` may be read by others."""

    def __init__(self) -> None:
        self._seen: dict[str, _Seen] = {}
        self._settled_s: float | None = None  # from then on images are of the new scene; None: from the next one on
        self.bumped: Mapping[str, float] = {}  # px by camera; exchanged whole, so no lock is needed

    def forget_scene(self) -> None:
        """The scene is another: what was seen of it tells nothing more."""
        self._seen, self._settled_s = {}, None

    def forgive(self) -> None:
        """Somebody has seen to the cameras: they count as they stand now."""
        self.forget_scene()
        self.bumped = {}

    def feed(self, camera: str, target: IntArray, point: IntArray, uv: FloatArray, at_s: float) -> None:
        """One image's dots: their targets (n,), points on them (n,), and places `uv` (n, 2) px."""
        keys = dot_keys(target, point)
        if self._settled_s is None:
            self._settled_s = at_s + _SETTLE_S
        if at_s < self._settled_s:
            return
        known = self._seen.get(camera)
        shift = None if known is None else _shift(known, keys, uv)
        if known is None or shift is None:  # the ball has gone, or something else is there now
            self._seen[camera] = _Seen(keys, uv, at_s)
            return
        known.at_s, known.shift_px = at_s, shift
        if shift <= BUMP_PX:
            known.moved_s, known.agreeing = None, 0
            if known.bumped:  # back where it was
                known.bumped = False
                self.bumped = {name: px for name, px in self.bumped.items() if name != camera}
        else:
            known.moved_s = at_s if known.moved_s is None else known.moved_s
            known.agreeing += 1
        self._judge()

    def _judge(self) -> None:
        """One camera alone has moved, or several: then it was the ball."""
        moved = [name for name, one in self._seen.items() if one.moved_s is not None and name not in self.bumped]
        if not moved:
            return
        if len(moved) > 1:
            self.forget_scene()
            return
        camera = self._seen[moved[0]]
        since = camera.moved_s or 0.0
        others = [
            one.at_s > since and one.shift_px <= _OTHERS_STILL_PX
            for name, one in self._seen.items()
            if name != moved[0] and name not in self.bumped and one.shift_px is not None
        ]
        if camera.agreeing >= _AGREE and len(others) >= _LEAST_OTHERS and all(others):
            camera.bumped = True
            self.bumped = {**self.bumped, moved[0]: float(camera.shift_px or 0.0)}


def _shift(known: _Seen, keys: IntArray, uv: FloatArray) -> float | None:
    """How far the median dot has gone, px; None where too few dots are the same."""
    _, old, new = np.intersect1d(known.keys, keys, return_indices=True)
    if len(old) < _LEAST_DOTS:
        return None
    return float(np.median(np.linalg.norm(uv[new] - known.uv[old], axis=1)))


# Cameras count as warm when their temperature changes by less than this in a minute. A camera that is switched on
# gains some 20 K in 30 to 60 minutes, the time that makers of measuring systems ask for; this is the end of it.
STEADY_K_PER_MIN = 0.1
_WINDOW_S = 180.0
_LEAST_S = 60.0
_EVERY_S = 2.0


class WarmUp:
    """The cameras' temperatures over the last minutes; fed by one thread, asked by another."""

    def __init__(self) -> None:
        self._readings: dict[str, tuple[tuple[float, float], ...]] = {}  # s, °C; exchanged whole, so no lock is needed

    def feed(self, serial: str, at_s: float, celsius: float | None) -> None:
        """A temperature that came with an image; None where the camera has none to tell."""
        kept = self._readings.get(serial, ())
        if celsius is None or (kept and at_s - kept[-1][0] < _EVERY_S):
            return
        self._readings[serial] = (*(one for one in kept if at_s - one[0] <= _WINDOW_S), (at_s, celsius))

    def rate_k_per_min(self, serial: str) -> float | None:
        """How fast the camera warms (or cools) for certain; None before a minute of readings."""
        kept = self._readings.get(serial, ())
        if not kept or kept[-1][0] - kept[0][0] < _LEAST_S:
            return None
        at, celsius = np.array(kept).T
        at = (at - at[0]) / 60
        (slope, offset), spread = np.polyfit(at, celsius, 1), float(((at - at.mean()) ** 2).sum())
        left = celsius - slope * at - offset
        error = float(np.sqrt((left**2).sum() / max(len(at) - 2, 1) / spread))
        step = min((change for change in np.abs(np.diff(celsius)).tolist() if change > 0), default=0.0)
        # three standard errors, as sensors jitter, and one step: of a coarse one it may have come at any moment
        certain = max(abs(float(slope)) - 3 * error - step / float(at[-1]), 0.0)
        return certain if slope > 0 else -certain

    def unsteady(self) -> dict[str, float]:
        """The cameras that are not warm yet, by serial, with their rates in K/min."""
        rates = {serial: self.rate_k_per_min(serial) for serial in self._readings}
        return {serial: rate for serial, rate in rates.items() if rate is not None and abs(rate) >= STEADY_K_PER_MIN}


_PAUSE_S = 0.02
_PATIENCE_S = 2.0  # a detection takes 0.7 s at most, kernels of the first one up to a minute
# Detections of all cameras together while their dots are followed, for targets that come into sight and for the focus:
# with twelve cameras a quarter of a core, as much as following takes.
_DETECTIONS_HZ = 12.0
_REMEMBERED = 3  # images of a camera that must agree for it to count as still
_BRIGHT = 0.98  # of full scale: the sensor clips
_STRIDE = 8


@dataclass(frozen=True, eq=False)
class Sight:
    """What is known of a camera's newest examined image."""

    frame: Frame
    dots: Dots
    blur_px: float | None  # median standard deviation of the dots' edges; None without dots
    saturated: float  # share of pixels at full scale
    brightness: float  # mean over full scale
    motion_px: float | None  # of the scene over the last images
    histogram: IntArray  # (64,) counts of grey values

    @property
    def still(self) -> bool:
        """Whether the scene stood still over the last images."""
        return self.motion_px is not None and self.motion_px <= STILL_PX


@dataclass(frozen=True, eq=False)
class Connection:
    """What connecting gave: the open source, its cameras and what the bench holds."""

    source: CameraSource
    discovery: Discovery
    reports: tuple[SetupReport, ...]
    cameras: tuple[SessionCamera, ...]  # as session.json will have them
    plan: CapturePlan
    names: Mapping[str, str]  # of the rig's cameras
    profile: CameraProfile = field(default_factory=CameraProfile)
    rig: RigCameras = field(default_factory=lambda: RigCameras((), {}))  # says why others are not among them
    wire: tuple[WireCamera, ...] = ()

    @property
    def answering_again(self) -> tuple[str, ...]:
        """The cameras of the rig that could not be used when they were opened, and send images now."""
        states = self.source.statuses()
        back = (serial for serial in self.rig.problems if serial in states and states[serial].state.usable)
        return tuple(serial for serial in back if self.source.latest(serial) is not None)

    def detector(self) -> Detector | BoardDetector:
        """What finds in images what calibrates; before a bench is described, the targets that SphereCal prints."""
        return detector_of(self.plan) or Detector(make_target_set())

    def info(self, serial: str) -> CameraInfo | None:
        """What was found about a camera."""
        return self.discovery.camera(serial)


class LiveView:
    """One thread detects targets in the newest images, which takes 0.2 to 0.7 s; another follows the dots meanwhile."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self._source = connection.source
        self._serials = [camera.serial for camera in connection.cameras]
        self.masks: Mapping[str, tuple[Rectangle, ...]] = {}  # by serial; exchanged whole, so no lock is needed
        self._known = {camera.serial: _known(camera) for camera in connection.cameras}
        self._sights: dict[str, Sight] = {}
        self._history: dict[str, deque[Detections]] = {}
        self._seen: dict[str, float] = {}
        self._followers: dict[str, Follower] = {}
        self._told = threading.Lock()  # sights and history are of both threads
        self._scene, self._changed_s = 0, -np.inf
        self._end = threading.Event()
        self._threads: list[threading.Thread] = []
        self.problem: BaseException | None = None
        self.watch, self.warm_up = BumpWatch(), WarmUp()
        self.rounds = 0

    def start(self, rate_hz: float = 5.0) -> None:
        """Begin: images at this rate, detection as fast as it goes."""
        self._source.start_live(rate_hz)
        self._end.clear()
        running = {thread.name for thread in self._threads}
        for name, work in (("detection", self._detect), ("following", self._follow)):
            if name not in running:
                self._threads.append(threading.Thread(target=self._run, args=(work,), name=name, daemon=True))
                self._threads[-1].start()

    def stop(self) -> None:
        """End detection and live images; a thread whose kernels are still compiled ends, or goes on, when they are."""
        self._end.set()
        for thread in self._threads:
            thread.join(_PATIENCE_S)
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        self._source.stop_live()

    def frame(self, serial: str) -> Frame | None:
        """The camera's newest image."""
        return self._source.latest(serial)

    def sight(self, serial: str) -> Sight | None:
        """The camera's newest examined image; it may be a little older than `frame`."""
        return self._sights.get(serial)

    def forget(self) -> None:
        """The scene was changed: what was seen before says nothing about stillness."""
        with self._told:
            self._scene, self._changed_s = self._scene + 1, time.perf_counter()
            self._history.clear()
            self._followers.clear()
        self.watch.forget_scene()

    def _run(self, work: Callable[[], bool]) -> None:
        """Repeat a thread's work; without any it rests."""
        try:
            while not self._end.is_set():
                if not work():
                    self._end.wait(_PAUSE_S)
        except Exception as error:
            self.problem = error

    @cached_property
    def _detector(self) -> Detector | BoardDetector | None:
        return self.connection.detector()

    def _detect(self) -> bool:
        """Detect in each camera's newest image; whether there was a new one."""
        worked = False
        for serial in self._serials:
            if self._end.is_set():
                return worked
            frame, seen = self._source.latest(serial), self._seen.get(serial, -np.inf)
            if frame is None or seen == frame.arrived_s:
                continue
            if serial in self._followers and frame.arrived_s - seen < len(self._serials) / _DETECTIONS_HZ:
                continue
            self._seen[serial] = frame.arrived_s
            self.warm_up.feed(serial, frame.arrived_s, frame.temperature_c)
            self._examine(serial, frame)
            worked = True
        self.rounds += worked
        return worked

    def _examine(self, serial: str, frame: Frame) -> None:
        detector, scene = self._detector, self._scene
        if detector is None:
            self._tell(serial, frame, None)
            return
        known = replace(self._known[serial], ignore=self.masks.get(serial, ()))
        found = detector.detect(balance_mosaic(frame.image), known)
        # an image that was exposed before the scene was changed would be compared with those of the new one
        if scene == self._scene and frame.taken_s >= self._changed_s:
            self.watch.feed(serial, found.target, found.point, found.uv, frame.taken_s)
        # a board's points all look alike: followed ones would be taken for those beside them
        follower = Follower(frame.image, frame.bits, found) if isinstance(detector, Detector) and len(found) else None
        with self._told:
            self._followers.pop(serial, None)
            if follower is not None and scene == self._scene:
                self._followers[serial] = follower
        self._tell(serial, frame, found)

    def _follow(self) -> bool:
        """Follow the dots into each camera's newest image; whether there was a new one."""
        worked = False
        for serial in self._serials:
            frame, follower, sight = self._source.latest(serial), self._followers.get(serial), self._sights.get(serial)
            if self._end.is_set() or frame is None or follower is None or sight is None:
                continue
            if frame.arrived_s <= sight.frame.arrived_s:
                continue
            worked = True
            found = follower.follow(frame.image, frame.bits, self.masks.get(serial, ()))
            if found is not None:
                self._tell(serial, frame, found, follower)
            elif self._followers.get(serial) is follower:
                self._followers.pop(serial, None)
        return worked

    def _tell(self, serial: str, frame: Frame, found: Detections | None, by: Follower | None = None) -> None:
        """Keep what was found in a camera's image, unless a newer one has been followed meanwhile."""
        blur, motion = None, None
        dots = Dots(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 2)), frame.image.shape[::-1])
        if found is not None:
            dots = Dots(found.target, found.point, found.uv, frame.image.shape[::-1])
            known_blur = found.blur_px[~np.isnan(found.blur_px)]  # a board's points tell none
            blur = float(np.median(known_blur)) if len(known_blur) else None
        full, sample = float(2**frame.bits - 1), frame.image[::_STRIDE, ::_STRIDE]
        histogram = np.bincount((sample.ravel() >> max(frame.bits - 6, 0)).clip(0, 63), minlength=64)
        saturated, brightness = float((sample >= _BRIGHT * full).mean()), float(sample.mean() / full)
        with self._told:
            newest = self._sights.get(serial)
            if newest is not None and newest.frame.arrived_s > frame.arrived_s and serial in self._followers:
                return
            if by is not None and self._followers.get(serial) is not by:  # detected anew, or of another scene
                return
            if found is not None:
                past = self._history.setdefault(serial, deque(maxlen=_REMEMBERED))
                past.append(found)
                motion = stillness(serial, list(past)).motion_px if len(past) == _REMEMBERED else None
            self._sights[serial] = Sight(frame, dots, blur, saturated, brightness, motion, histogram)


def _known(camera: SessionCamera) -> DetectionSettings:
    """What session.json knows of the camera, for detection."""
    pitch, focal = camera.entry.get("pixel_pitch_um"), camera.entry.get("focal_length_mm")
    return DetectionSettings(focal_px=focal / pitch * 1e3 if pitch and focal else None)
