"""Real cameras behind the protocol: discovery, the camera process, and sets taken through it."""

import itertools
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal_cameras.genicam.discovery import discover, producer_files
from spherecal_cameras.genicam.messages import FrameMeta, RequestedCamera
from spherecal_cameras.genicam.service import CameraService, default_log_file
from spherecal_cameras.genicam.trust import Ask, TrustStore, admit_again
from spherecal_cameras.matching import TRIGGERED, SetMatcher, Sighting
from spherecal_cameras.protocol import (
    CameraError,
    CameraEvent,
    CameraSettings,
    CameraState,
    CameraStatus,
    CaptureRequest,
    Discovery,
    FeatureReport,
    Frame,
    FrameSet,
    MissingFrame,
    SetupReport,
    SourceKind,
    TriggerMode,
)
from spherecal_gentl.producer.build_producer import CTI_FILE

_LOOK_S = 0.02  # between two looks at the user's wish to stop
# More time for the first images after opening: four of 16 MP took 4.2 s on a machine full of other work.
_COLD_S = 4.0
_DRAIN_S = 0.5  # for cameras without time stamps: a late image must not pass for one of the next round


class GenicamSource(AbstractContextManager["GenicamSource"]):
    """GenICam cameras behind the protocol (see `CameraSource`)."""

    kind: SourceKind = "genicam"

    def __init__(self, producers: Sequence[str] = (), log_file: Path | None = None, ask: Ask | None = None) -> None:
        self._own = tuple(producers)
        self._ask = ask
        self._trust = TrustStore()
        self._log_file = log_file or default_log_file()
        self._discovery: Discovery | None = None
        self._service: CameraService | None = None
        self._live_hz: float | None = None
        self._rounds = itertools.count(1)
        self._took_s: float | None = None  # the last complete set since the cameras were set up
        self._capturing = threading.Lock()

    @property
    def label(self) -> str:
        """Empty for real cameras; says so where any of them is a simulated camera of the simulated producer."""
        cameras = self._discovery.cameras if self._discovery is not None else ()
        simulated = any(Path(camera.producer).name == CTI_FILE for camera in cameras)
        return "SIMULATED: cameras of the simulated producer, no real ones" if simulated else ""

    # --- finding and opening -----------------------------------------------------------------------------------------

    def discover(self, context: Context | None = None) -> Discovery:
        """The cameras of all producer files, each tried in a process of its own."""
        self._trust = TrustStore()
        self._discovery = discover(producer_files(self._own), context, self._trust, self._ask)
        return self._discovery

    def open(self, serials: Iterable[str], settings: Mapping[str, CameraSettings]) -> tuple[SetupReport, ...]:
        """Open and set up exactly these cameras; a report of each that could be opened."""
        wanted = list(dict.fromkeys(serials))
        if not wanted:
            raise CameraError(Phrase("error-no-camera-named"))
        discovery = self._discovery or self.discover()
        if any(discovery.camera(serial) is None for serial in wanted):
            discovery = self.discover()
        for serial in wanted:
            if discovery.camera(serial) is None:
                raise CameraError(Phrase("error-no-such-camera", {"camera": serial}), _what_is_there(discovery))
        self._took_s = None
        if self._service is None:
            self._service = CameraService(self._log_file, lambda file: admit_again(self._trust, file))
        cameras = [(serial, discovery.camera(serial)) for serial in wanted]
        return self._service.open(
            RequestedCamera(serial, info.producer, "", "", settings.get(serial, CameraSettings()), info.device_id)
            for serial, info in cameras
            if info
        )

    def apply(self, settings: Mapping[str, CameraSettings]) -> tuple[SetupReport, ...]:
        """Give open cameras new settings, by serial; a report of each that can be reached."""
        service = self._opened()
        for serial in settings:
            if serial not in service.settings():
                raise CameraError(Phrase("error-camera-not-open", {"camera": serial}))
        self._took_s = None
        return service.apply(settings)

    def describe(self, serial: str) -> tuple[FeatureReport, ...]:
        """All features of an open camera with their present values; none while it is lost."""
        return self._opened().describe(serial)

    def indicate(self, serial: str, on: bool) -> bool:
        """Switch a camera's own light, to find the camera in the rig; whether it has one."""
        return self._opened().indicate(serial, on)

    def _opened(self) -> CameraService:
        if self._service is None:
            raise CameraError(Phrase("error-none-open"))
        return self._service

    @property
    def service_pid(self) -> int | None:
        """The process id of the camera process, None while there is none."""
        return self._service.pid if self._service is not None else None

    # --- live --------------------------------------------------------------------------------------------------------

    def start_live(self, rate_hz: float = 5.0) -> None:
        """Keep fresh images coming, triggered at `rate_hz`."""
        self._live_hz = rate_hz
        self._opened().acquire(True, rate_hz)

    def stop_live(self) -> None:
        """No images but those of sets."""
        self._live_hz = None
        if self._service is not None:
            self._service.acquire(False, None)

    def latest(self, serial: str) -> Frame | None:
        """The camera's newest image, None if there was none yet."""
        return self._service.frames.latest(serial) if self._service is not None else None

    def statuses(self) -> dict[str, CameraStatus]:
        """The state of every open camera, by serial."""
        return self._service.status_log.statuses() if self._service is not None else {}

    def take_events(self) -> Sequence[CameraEvent]:
        """The events since the last call, oldest first."""
        return self._service.status_log.take_events() if self._service is not None else ()

    # --- sets --------------------------------------------------------------------------------------------------------

    def capture_set(self, request: CaptureRequest | None = None, context: Context | None = None) -> FrameSet:
        """Take one set; tried again as often as the request says while a camera is missing."""
        request, context = request or CaptureRequest(), context or Context()
        service = self._opened()
        settings = service.settings()
        serials = request.cameras or tuple(settings)
        if unknown := [serial for serial in serials if serial not in settings]:
            raise CameraError(Phrase("error-camera-not-open", {"camera": unknown[0]}))
        chosen = {serial: settings[serial] for serial in serials}
        with self._capturing:
            if not service.acquiring:
                service.acquire(True, None)
            service.pause_live(True)
            try:
                return self._capture(service, chosen, request, context)
            finally:
                service.listen(None)
                service.pause_live(False)

    def _capture(
        self, service: CameraService, settings: Mapping[str, CameraSettings], request: CaptureRequest, context: Context
    ) -> FrameSet:
        began = time.perf_counter()
        attempts: list[_Attempt] = []
        late: dict[str, None] = {}

        def hear(meta: FrameMeta) -> None:
            for attempt in attempts:  # a triggered image of an earlier try that comes late completes that try
                if attempt is attempts[-1] or meta.round == attempt.number:
                    attempt.offer(meta)

        service.listen(hear)
        while len(attempts) <= request.retries:
            patience_s = request.timeout_s + (2 * self._took_s if self._took_s is not None else 0.0)
            if self._took_s is None and not attempts:
                patience_s += _COLD_S
            attempts.append(_Attempt(service, settings, next(self._rounds)))
            attempts[-1].run(patience_s, context, attempts[:-1])
            missing = min((attempt.missing() for attempt in attempts), key=len)
            if not missing:
                self._took_s = attempts[-1].took_s
                break
            late |= dict.fromkeys(missing)
            if len(attempts) <= request.retries:
                _recover(service, missing, request.timeout_s, context)
        best = min(reversed(attempts), key=lambda attempt: len(attempt.missing()))
        return best.result(tuple(late), len(attempts), time.perf_counter() - began)

    def close(self) -> None:
        """Release all cameras and end the camera process."""
        if self._service is not None:
            self._service.close()
            self._service = None

    def __exit__(self, *_: object) -> None:
        self.close()


class _Attempt:
    """One try to take a set: triggers, collects copies of the images that fit, in the service's thread."""

    def __init__(self, service: CameraService, settings: Mapping[str, CameraSettings], number: int) -> None:
        self.number = number
        self._service = service
        self._settings = settings
        self._condition = threading.Condition()
        self._frames: dict[tuple[str, int], Frame] = {}
        known = service.trigger_modes()
        modes: dict[str, TriggerMode] = {serial: known[serial] for serial in settings}
        self._matcher: SetMatcher[tuple[str, int]] = SetMatcher(modes, number, time.perf_counter())
        self._software = tuple(serial for serial, mode in modes.items() if mode in TRIGGERED)
        self._timeout_s = self.took_s = 0.0

    def run(self, timeout_s: float, context: Context, earlier: Sequence["_Attempt"]) -> None:
        """Wait until all images of a try are there, or no missing one is expected; every image starts the time anew."""
        self._timeout_s = timeout_s
        if self._software:
            self._service.trigger(self.number, self._software)
        longest_s = max((one.exposure_us for one in self._settings.values()), default=0.0) * 1e-6
        deadline = time.perf_counter() + timeout_s + longest_s
        sent, began, lacking = not self._software, time.perf_counter(), len(self._settings)
        while time.perf_counter() < deadline:
            context.check()
            self.took_s = time.perf_counter() - began
            if any(not attempt.missing() for attempt in earlier):
                return
            if not sent and self._service.is_triggered(self.number):  # slow cameras take their time to be triggered
                sent, deadline = True, time.perf_counter() + timeout_s + longest_s
            with self._condition:
                if not self._matcher.missing():
                    return
                self._condition.wait(_LOOK_S)
                missing = self._matcher.missing()
            if len(missing) < lacking:
                lacking, deadline = len(missing), max(deadline, time.perf_counter() + timeout_s)
            states, refused = self._service.status_log.statuses(), self._service.refusals(self.number)
            if missing and all(serial in refused or not _expected(states.get(serial)) for serial in missing):
                return

    def offer(self, meta: FrameMeta) -> None:
        """Take an image if it fits; called in the service's thread."""
        key = (meta.serial, meta.sequence)
        seen = Sighting(meta.serial, meta.round, meta.taken_s, meta.uncertainty_s, key)
        with self._condition:
            if not self._matcher.offer(seen):
                return
            frame = self._service.frames.read(meta)
            if frame is None:
                self._service.status_log.add(meta.serial, overwritten=1)
                return
            kept = self._matcher.kept()
            self._frames = {k: v for k, v in self._frames.items() if k in kept} | {key: frame}
            if not self._matcher.missing():
                self._condition.notify_all()

    def missing(self) -> tuple[str, ...]:
        """The cameras without an image."""
        with self._condition:
            found = self._found()
        return tuple(serial for serial in self._settings if serial not in found)

    def _found(self) -> dict[str, Frame]:
        images = self._matcher.images()
        return {s: self._frames[i.item] for s, i in images.items() if i.item in self._frames}

    def result(self, late: tuple[str, ...], attempts: int, seconds: float) -> FrameSet:
        """The set as it is, with a word for every camera that is missing."""
        with self._condition:
            found = self._found()
        frames = {serial: found[serial] for serial in self._settings if serial in found}
        taken = [frame.taken_s for frame in frames.values()]
        common = bool(frames) and all(frame.common_clock for frame in frames.values())
        if common:
            taken = [(frame.time_stamp_ns or 0) * 1e-9 for frame in frames.values()]
        spread = max(taken) - min(taken) if len(taken) > 1 else None
        missing = tuple(self._why_missing(serial) for serial in self._settings if serial not in frames)
        return FrameSet(self.number, frames, missing, late, attempts, seconds, spread, common)

    def _why_missing(self, serial: str) -> MissingFrame:
        status = self._service.status_log.statuses().get(serial)
        refusal = self._service.refusals(self.number).get(serial)
        if status is not None and status.cause:
            return MissingFrame(serial, status.cause, status.remedy)
        if refusal is not None:
            other = "software" if self._settings[serial].trigger == "scheduled" else "free"
            return MissingFrame(serial, f"It does not take the trigger ({refusal}).", f"Set its trigger to `{other}`.")
        if self._settings[serial].trigger == "hardware":
            remedy = "Check the trigger box, its cable and the camera's trigger source; allow more time."
        else:
            remedy = "Check its cable and the network's load; allow more time."
        return MissingFrame(serial, f"It sent no image within {self._timeout_s:g} s.", remedy)


def _expected(status: CameraStatus | None) -> bool:
    return status is not None and (status.state.usable or status.state == CameraState.NO_TRIGGER)


def _recover(service: CameraService, missing: Sequence[str], patience_s: float, context: Context) -> None:
    """Before another try: give lost cameras a moment to return, and late images of this try time to pass by."""
    deadline = time.perf_counter() + max(patience_s, _DRAIN_S)
    drained = time.perf_counter() + _DRAIN_S
    while time.perf_counter() < deadline:
        context.check()
        statuses = service.status_log.statuses()
        back = all(_expected(statuses.get(serial)) for serial in missing)
        if back and (time.perf_counter() >= drained or all(_has_stamps(service, serial) for serial in missing)):
            return
        time.sleep(_LOOK_S)


def _has_stamps(service: CameraService, serial: str) -> bool:
    frame = service.frames.latest(serial)
    return frame is not None and frame.time_stamp_ns is not None


def _what_is_there(discovery: Discovery) -> Phrase:
    if discovery.cameras:
        return Phrase("there-are", {"names": list(discovery.serials)})
    if not discovery.producers:
        return Phrase("no-driver")
    return Phrase("list-cameras")
