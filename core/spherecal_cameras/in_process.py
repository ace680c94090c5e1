"""What the replay and the simulated source have in common: cameras without hardware, inside the program."""

import os
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Protocol, Self, runtime_checkable

from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal_cameras import protocol
from spherecal_cameras.status_log import StatusLog

_PULSE_S = 0.001  # apart from each other in a simulated set
_PAUSE_S = 0.02
_PATIENCE_S = 2.0  # an image is rendered in 0.5 s at most; kernels of the first one are compiled for up to a minute


@runtime_checkable
class Staged(Protocol):
    """A source whose scene can be changed by the program: it knows placements and bar poses by id."""

    @property
    def poses(self) -> tuple[str, ...]:
        """The ids, placements first."""
        ...

    @property
    def shown(self) -> str:
        """The id of what the cameras see now."""
        ...

    def show(self, pose: str) -> None:
        """Let the cameras see another placement or bar pose, by its id; InputError where there is none."""
        ...


class NoImage(Exception):
    """A camera that does not deliver this time; `late` where another try may help."""

    def __init__(self, cause: str, remedy: str, state: protocol.CameraState | None = None) -> None:
        super().__init__(cause)
        self.cause, self.remedy, self.state = cause, remedy, state


class InProcessSource(ABC):
    """Base of sources without hardware; a derived class gives `camera_infos` and `take_image`."""

    kind: protocol.SourceKind
    label: str

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._settings: dict[str, protocol.CameraSettings] = {}
        self._log = StatusLog()
        self._latest: dict[str, protocol.Frame] = {}
        self._frame_ids: dict[str, int] = {}
        self._arrivals: dict[str, deque[float]] = {}
        self._live: threading.Thread | None = None
        self._live_end = threading.Event()
        self._live_hz: float | None = None
        self._pool: ThreadPoolExecutor | None = None
        self._began_s = time.perf_counter()
        self.sets_taken = 0

    @abstractmethod
    def camera_infos(self) -> tuple[protocol.CameraInfo, ...]:
        """The cameras of the source."""

    @abstractmethod
    def take_image(
        self, serial: str, settings: protocol.CameraSettings, number: int, attempt: int, timeout_s: float
    ) -> protocol.Frame:
        """An image for set `number` (0: the live view), at try `attempt`, from 1; NoImage where there is none."""

    def triggered(self, exposed_s: Mapping[str, float]) -> None:  # noqa: B027 - a scene at rest needs nothing
        """A set is to be taken, each image exposed at a moment of perf_counter (s): for sources whose scene moves."""

    def discover(self, context: Context | None = None) -> protocol.Discovery:
        """The cameras of the recording or the simulated rig."""
        if context is not None:
            context.check()
        infos = tuple(sorted(self.camera_infos(), key=lambda info: info.serial))
        return protocol.Discovery(
            infos, (protocol.ProducerVerdict(self.label, True, f"{counted(len(infos), 'camera')}.", "", infos),)
        )

    def open(
        self, serials: Iterable[str], settings: Mapping[str, protocol.CameraSettings]
    ) -> tuple[protocol.SetupReport, ...]:
        """Open exactly these cameras; a report of each."""
        wanted = tuple(dict.fromkeys(serials))
        known = {info.serial for info in self.camera_infos()}
        if not wanted:
            raise protocol.CameraError(Phrase("error-no-camera-named"))
        for serial in wanted:
            if serial not in known:
                raise protocol.CameraError(
                    Phrase("error-no-such-camera", {"camera": serial}), Phrase("there-are", {"names": sorted(known)})
                )
        with self._lock:
            self._settings = {serial: settings.get(serial, protocol.CameraSettings()) for serial in wanted}
            self._log.keep_only(wanted, protocol.CameraState.CONNECTED)
            self._latest = {serial: frame for serial, frame in self._latest.items() if serial in wanted}
        return tuple(self._report(serial) for serial in wanted)

    def apply(self, settings: Mapping[str, protocol.CameraSettings]) -> tuple[protocol.SetupReport, ...]:
        """Give open cameras new settings, by serial; a report of each."""
        with self._lock:
            for serial, new in settings.items():
                if serial not in self._settings:
                    raise protocol.CameraError(Phrase("error-camera-not-open", {"camera": serial}))
                self._settings[serial] = new
        return tuple(self._report(serial) for serial in settings)

    def describe(self, serial: str) -> tuple[protocol.FeatureReport, ...]:
        """The settings of a camera as a list of features."""
        return self._report(serial).features

    def _report(self, serial: str) -> protocol.SetupReport:
        info = next(info for info in self.camera_infos() if info.serial == serial)
        settings = self._settings[serial]
        features = tuple(
            protocol.FeatureReport(name, name, str(value), str(value))
            for name, value in (
                ("exposure", settings.exposure_us),
                ("gain", settings.gain_db),
                ("pixel format", settings.pixel_format),
                ("trigger mode", settings.trigger),
            )
        )
        size = info.image_size
        if settings.region is not None:
            size = (settings.region.width, settings.region.height)
        return protocol.SetupReport(serial, features, size)

    def start_live(self, rate_hz: float = 5.0) -> None:
        """Keep fresh images coming at `rate_hz`, by one thread for all cameras."""
        if not self._settings:
            raise protocol.CameraError(Phrase("error-none-open"))
        self.stop_live()
        self._live_hz = rate_hz
        self._live_end = threading.Event()
        arguments = (1.0 / rate_hz, self._live_end)
        self._live = threading.Thread(target=self._run_live, args=arguments, name="live", daemon=True)
        self._live.start()
        for serial in self._settings:
            self._log.set_state(serial, protocol.CameraState.STREAMING)

    def stop_live(self) -> None:
        """No images but those of sets."""
        if self._live is not None:
            self._live_end.set()
            self._live.join(_PATIENCE_S)
            self._live = None
            self._live_hz = None
            for serial in self._settings:
                if self.statuses()[serial].state == protocol.CameraState.STREAMING:
                    self._log.set_state(serial, protocol.CameraState.CONNECTED)

    def _run_live(self, period_s: float, end: threading.Event) -> None:
        while not end.is_set():
            began = time.perf_counter()
            for serial, settings in list(self._settings.items()):
                if end.is_set():
                    return
                try:
                    image = self.take_image(serial, settings, 0, 1, period_s)
                    if end.is_set():
                        return
                    self._deliver(image)
                    self._log.set_state(serial, protocol.CameraState.STREAMING)
                except NoImage as missing:
                    if missing.state is not None:
                        self._log.set_state(serial, missing.state, missing.cause, missing.remedy)
            end.wait(max(period_s - (time.perf_counter() - began), _PAUSE_S))

    def latest(self, serial: str) -> protocol.Frame | None:
        """The camera's newest image, None if there was none yet."""
        return self._latest.get(serial)

    def capture_set(
        self, request: protocol.CaptureRequest | None = None, context: Context | None = None
    ) -> protocol.FrameSet:
        """Take one set, with exposures 1 ms apart from one camera to the next."""
        request, context = request or protocol.CaptureRequest(), context or Context()
        if not self._settings:
            raise protocol.CameraError(Phrase("error-none-open"))
        serials = request.cameras or tuple(self._settings)
        if unknown := [serial for serial in serials if serial not in self._settings]:
            raise protocol.CameraError(Phrase("error-camera-not-open", {"camera": unknown[0]}))
        began = time.perf_counter()
        self.sets_taken += 1
        late: dict[str, None] = {}
        attempt, frames, missing = 0, {}, ()
        while attempt <= request.retries:
            attempt += 1
            context.check()
            frames, missing = self._try(serials, attempt, request.timeout_s, context)
            if not missing:
                break
            late |= dict.fromkeys(one.camera for one in missing)
        taken = [frame.taken_s for frame in frames.values()]
        spread = max(taken) - min(taken) if len(taken) > 1 else None
        seconds = time.perf_counter() - began
        return protocol.FrameSet(self.sets_taken, frames, tuple(missing), tuple(late), attempt, seconds, spread)

    def _try(
        self, serials: Sequence[str], attempt: int, timeout_s: float, context: Context
    ) -> tuple[dict[str, protocol.Frame], tuple[protocol.MissingFrame, ...]]:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(min(os.cpu_count() or 1, 4), thread_name_prefix="cameras")
        number = self.sets_taken
        began = time.perf_counter()
        exposed = {serial: began + position * _PULSE_S for position, serial in enumerate(serials)}
        self.triggered(exposed)
        jobs = {
            serial: self._pool.submit(self.take_image, serial, self._settings[serial], number, attempt, timeout_s)
            for serial in serials
        }
        frames: dict[str, protocol.Frame] = {}
        missing: list[protocol.MissingFrame] = []
        for serial, job in jobs.items():
            context.check()
            try:
                frame = replace(job.result(), taken_s=exposed[serial], round=number)
            except NoImage as none:
                missing.append(protocol.MissingFrame(serial, none.cause, none.remedy))
                if none.state is not None:
                    self._log.set_state(serial, none.state, none.cause, none.remedy)
                continue
            frames[serial] = frame
            self._deliver(frame)
            if self.statuses()[serial].state not in (protocol.CameraState.STREAMING, protocol.CameraState.CONNECTED):
                self._log.set_state(
                    serial, protocol.CameraState.STREAMING if self._live else protocol.CameraState.CONNECTED
                )
        return frames, tuple(missing)

    def statuses(self) -> dict[str, protocol.CameraStatus]:
        """The state of every open camera, by serial."""
        return self._log.statuses()

    def take_events(self) -> Sequence[protocol.CameraEvent]:
        """The events since the last call, oldest first."""
        return self._log.take_events()

    def close(self) -> None:
        """End the live view and release everything."""
        self.stop_live()
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None
        with self._lock:
            self._settings, self._latest = {}, {}
            self._log.keep_only(())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def next_frame_id(self, serial: str) -> int:
        """The next number of the camera's own counter of images, from 1."""
        with self._lock:
            self._frame_ids[serial] = self._frame_ids.get(serial, 0) + 1
            return self._frame_ids[serial]

    def stamp_ns(self) -> int:
        """The time of the clock that all these cameras share, in ns since the source was made."""
        return int((time.perf_counter() - self._began_s) * 1e9)

    def _deliver(self, frame: protocol.Frame) -> None:
        with self._lock:
            status = self.statuses().get(frame.camera)
            if status is None:
                return
            self._latest[frame.camera] = frame
            arrivals = self._arrivals.setdefault(frame.camera, deque(maxlen=20))
            arrivals.append(frame.arrived_s)
            span = arrivals[-1] - arrivals[0]
            rate = (len(arrivals) - 1) / span if span > 0 else 0.0
            counters = replace(
                status.counters, delivered=status.counters.delivered + 1, rate_hz=rate, wanted_hz=self._live_hz
            )
            self._log.count(frame.camera, counters, frame.temperature_c)
