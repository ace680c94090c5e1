"""The program's side of the camera process: starts it, talks to it, sees it end and starts it again."""

import atexit
import contextlib
import itertools
import multiprocessing
import threading
import time
from collections import Counter as Tally
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from spherecal.base.messages.values import Phrase
from spherecal_cameras import protocol
from spherecal_cameras.genicam import child, messages, words
from spherecal_cameras.genicam.discovery import end_word
from spherecal_cameras.genicam.rings import FrameStore, TouchMark, remove_orphans, shared_memory_name
from spherecal_cameras.genicam.trust import Admitted, Refusal, TrustStore, admit_again
from spherecal_cameras.genicam.wire import Inbox, WireError, pack
from spherecal_cameras.status_log import StatusLog

# Silence of the process that is not announced (`Working`): heartbeats come every 0.1 s, and the slowest register read
# seen took 0.5 s (a lost GigE camera with retries).
_HUNG_S = 3.0
_START_S = 20.0  # importing and loading on a busy machine; 0.5 s on an idle one
_ANSWER_S = 60.0
_LOOK_S = 0.5
_END_S = 3.0
_MOST_IMAGE_BYTES = 1 << 30  # 150 MP of 16 bits are 300 MB
# A camera whose driver crashed so often without an image in between is left out for some time, for the others' sake.
_CRASHES = 3
_LEFT_OUT_S = 60.0
_PAUSE_S = 1.0  # between crashes in a row, so that starting processes do not fill the machine
_OUTSIDE = ("SIGKILL", "SIGTERM", "SIGINT")  # no camera's fault


Gate = Callable[[str], Admitted | Refusal]


class CameraService:
    """One camera process and what is known about its cameras. Thread-safe; `close` it."""

    def __init__(self, log_file: Path | None = None, gate: Gate | None = None) -> None:
        self._gate = gate or (lambda file: admit_again(TrustStore(), file))
        self._order: tuple[messages.RequestedCamera, ...] = ()  # the cameras as the process numbers them
        self._log_file = None if log_file is None else str(log_file)
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._requests = itertools.count(1)
        self._answers: dict[int, messages.Answer] = {}
        self._wanted: dict[str, messages.RequestedCamera] = {}
        self._left_out: dict[str, float] = {}  # until when
        self._free: set[str] = set()  # cameras without a trigger
        self._crashes: Tally[str] = Tally()  # since the last image
        self._acquiring = False
        self._live_hz: float | None = None
        self.frames = FrameStore()
        self.status_log = StatusLog()
        self._listener: Callable[[messages.FrameMeta], None] | None = None
        self._triggered: dict[int, messages.Triggered] = {}
        self._refused_version = False
        self._closing = False
        self._generation = 0
        self._process: BaseProcess | None = None
        self._connection: Any | None = None  # Connection, PipeConnection on Windows
        self._back_since: float | None = None
        self._touch: TouchMark | None = None
        self._thread: threading.Thread | None = None

    # --- for the source ----------------------------------------------------------------------------------------------

    @property
    def pid(self) -> int | None:
        """The camera process's id, None while there is none."""
        process = self._process
        return process.pid if process is not None else None

    def open(self, cameras: Iterable[messages.RequestedCamera]) -> tuple[protocol.SetupReport, ...]:
        """Keep exactly these cameras open; a report of each that could be opened."""
        with self._lock:
            self._wanted = {camera.serial: camera for camera in cameras}
            self._left_out.clear()
            self._crashes.clear()
            self.status_log.keep_only(self._wanted)
            self.frames.keep_only(self._wanted)
            if self._closing:
                raise protocol.CameraError(Phrase("error-cameras-closed"))
            if self._thread is None:
                remove_orphans()
                self._touch = TouchMark(shared_memory_name(), create=True)
                # this thread starts every process: Linux ends a child with the thread that made it (PR_SET_PDEATHSIG)
                self._thread = threading.Thread(target=self._run, name="cameras", daemon=True)
                self._thread.start()
                atexit.register(self.close)  # runs before multiprocessing's own, which would end the process under us
                while self._connection is None and not self._closing:
                    self._changed.wait(0.1)
        return self._ask(lambda request: messages.Open(request, self._admitted())).reports

    def apply(self, settings: Mapping[str, protocol.CameraSettings]) -> tuple[protocol.SetupReport, ...]:
        """Give cameras new settings, by serial, and keep them for later openings; a report of each that is open."""
        with self._lock:
            for serial, new in settings.items():
                self._wanted[serial] = replace(self._wanted[serial], settings=new)
        return self._ask(lambda request: messages.Apply(request, dict(settings))).reports

    def describe(self, serial: str) -> tuple[protocol.FeatureReport, ...]:
        """All features of an open camera; empty while it is lost."""
        return self._ask(lambda request: messages.Describe(request, serial)).features

    def indicate(self, serial: str, on: bool) -> bool:
        """Switch an open camera's own light; whether it has one that can be switched."""
        return bool(self._ask(lambda request: messages.Indicate(request, serial, on)).features)

    def acquire(self, on: bool, live_hz: float | None) -> None:
        """Let cameras send images or not, and trigger them for a live view."""
        with self._lock:
            self._acquiring, self._live_hz = on, live_hz
            self._tell(messages.Acquire(on))
            self._tell(messages.Live(live_hz))

    def pause_live(self, paused: bool) -> None:
        """Stop the triggers of the live view while a set is taken, or begin them again."""
        self._tell(messages.Live(None if paused else self._live_hz))

    @property
    def acquiring(self) -> bool:
        """Whether cameras are to send images."""
        return self._acquiring

    def trigger(self, round_number: int, serials: Iterable[str]) -> None:
        """Trigger cameras once; `refusals` says later which did not take it."""
        self._tell(messages.Trigger(round_number, tuple(serials)))

    def is_triggered(self, round_number: int) -> bool:
        """Whether a trigger round has been sent to all its cameras."""
        with self._lock:
            return round_number in self._triggered

    def refusals(self, round_number: int) -> dict[str, str]:
        """The cameras that refused a trigger round, and why; empty for a round not reported yet, or long ago."""
        with self._lock:
            known = self._triggered.get(round_number)
            return dict(known.refused) if known else {}

    def listen(self, listener: Callable[[messages.FrameMeta], None] | None) -> None:
        """Call a function, which may copy it and nothing slower, with every image that arrives; None: none any more."""
        self._listener = listener

    def trigger_modes(self) -> dict[str, protocol.TriggerMode]:
        """How every wanted camera is triggered: one without a trigger runs free, whatever its settings say."""
        with self._lock:
            return {s: "free" if s in self._free else w.settings.trigger for s, w in self._wanted.items()}

    def settings(self) -> dict[str, protocol.CameraSettings]:
        """The settings of every wanted camera."""
        with self._lock:
            return {serial: wanted.settings for serial, wanted in self._wanted.items()}

    def close(self) -> None:
        """End the process and free all shared memory; may be called twice."""
        with self._lock:
            if self._closing:
                return
            self._closing = True
            self._tell(messages.Quit())
            self._changed.notify_all()
        thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join()
        atexit.unregister(self.close)
        with self._lock:
            self.frames.close()
            if self._touch is not None:
                self._touch.unlink()
                self._touch = None

    # --- talking -----------------------------------------------------------------------------------------------------

    def _tell(self, command: messages.Command) -> None:
        """Send a command; a process that has just ended gets the state of things at its restart instead."""
        with self._lock:
            if self._connection is not None:
                with contextlib.suppress(OSError, ValueError):
                    self._connection.send_bytes(pack(command))

    def _ask(self, make: Callable[[int], messages.Command]) -> messages.Answer:
        """Send a command and wait for its answer; asked again if the process ends meanwhile."""
        deadline = time.perf_counter() + _ANSWER_S
        with self._lock:
            while not self._closing and time.perf_counter() < deadline:
                request, generation = next(self._requests), self._generation
                self._tell(make(request))
                while not self._closing and generation == self._generation and time.perf_counter() < deadline:
                    if request in self._answers:
                        return self._answers.pop(request)
                    self._changed.wait(0.1)
        if self._refused_version:
            raise protocol.CameraError(Phrase("error-camera-process-version"))
        raise protocol.CameraError(Phrase("error-camera-process"))

    # --- the service's thread ----------------------------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            context = multiprocessing.get_context("spawn")
            ours, theirs = context.Pipe()
            assert self._touch is not None
            self._touch.set(-1, 0)
            process = context.Process(
                target=child.run, args=(theirs, self._touch.name, self._log_file), name="spherecal-cameras", daemon=True
            )
            process.start()
            theirs.close()
            with self._lock:
                self._process, self._connection = process, ours
                again = self._generation > 0
                self._generation += 1
                if again:
                    # bring the new process to where the old one was
                    self._tell(messages.Open(0, self._admitted()))
                    for ring in self.frames.in_use():
                        self._tell(ring)
                    self._tell(messages.Acquire(self._acquiring))
                    self._tell(messages.Live(self._live_hz))
                self._changed.notify_all()
            reason = self._follow()
            with self._lock:
                if self._closing:
                    return
                self._note_loss(reason)

    def _follow(self) -> str:
        """Obey the process's reports until it ends; how it ended."""
        process, connection = self._process, self._connection
        assert process is not None and connection is not None
        ends, inbox = [connection, process.sentinel], Inbox(connection, messages.REPORTS)
        deadline = time.perf_counter() + _START_S
        reason = ""
        while not reason:
            ready = wait(ends, min(deadline - time.perf_counter(), _LOOK_S))
            self._let_in_again()
            try:
                while connection in ready:
                    for report in inbox.messages():
                        allowed = min(report.allow_s, _START_S * 2) if isinstance(report, messages.Working) else 0.0
                        deadline = time.perf_counter() + _HUNG_S + allowed
                        self._take(report)
                    ready = wait(ends, 0.0)
            except WireError as error:
                reason = f"sent {error}"
                break
            except (EOFError, OSError):
                ready = [process.sentinel]
            if process.sentinel in ready:
                process.join(_END_S)
                reason = end_word(process.exitcode)
            elif time.perf_counter() > deadline:
                reason = f"hung for {_HUNG_S:.0f} s"
        self._bury(process, connection)
        return reason

    def _bury(self, process: BaseProcess, connection: Any) -> None:
        with self._lock:
            connection.close()
            self._connection = None
        if process.is_alive():
            if self._closing:
                process.join(_END_S)
            process.kill()
        process.join()
        process.close()
        self._process = None

    def _note_loss(self, reason: str) -> None:
        """Say that the process is gone, and with which camera it was busy."""
        assert self._touch is not None
        number, action = self._touch.get()
        order = self._order
        culprit = order[number].serial if 0 <= number < len(order) else None
        doing = child.ACTIONS[action] if 0 < action < len(child.ACTIONS) else "serving it"
        during = f" while {doing} (camera {culprit})" if culprit else ""
        self.status_log.event(
            protocol.EventKind.SERVICE_LOST,
            f"The camera process ended ({reason}){during}.",
            "It is started again by itself; images already taken are safe.",
            culprit,
        )
        for serial in self._wanted:
            if serial not in self._left_out:
                self.status_log.set_state(
                    serial, protocol.CameraState.LOST, "The camera process is being started again.", "Wait."
                )
        self._back_since = time.perf_counter()
        if culprit is not None and reason not in _OUTSIDE:
            self._crashes[culprit] += 1
            if self._crashes[culprit] >= _CRASHES:
                self._left_out[culprit] = time.perf_counter() + _LEFT_OUT_S
                self.status_log.set_state(culprit, *words.state_in_words("left out", times=self._crashes[culprit]))
        if self._crashes.total() > _CRASHES:
            self._changed.wait(_PAUSE_S)

    def _let_in_again(self) -> None:
        """Try left out cameras again when their time is over."""
        if not self._left_out:
            return
        with self._lock:
            now = time.perf_counter()
            back = [serial for serial, until in self._left_out.items() if now >= until]
            for serial in back:
                del self._left_out[serial]
            if back:
                self._tell(messages.Open(0, self._admitted()))

    def _admitted(self) -> tuple[messages.RequestedCamera, ...]:
        """The cameras that are not left out, with what to load for them now; their drivers are looked at each time."""
        admitted: list[messages.RequestedCamera] = []
        looked: dict[str, Admitted | Refusal] = {}
        for camera in (camera for serial, camera in self._wanted.items() if serial not in self._left_out):
            found = looked.setdefault(camera.producer, looked.get(camera.producer) or self._gate(camera.producer))
            if isinstance(found, Refusal):
                self.status_log.set_state(camera.serial, protocol.CameraState.ERROR, found.message, found.hint)
            else:
                admitted.append(replace(camera, load=found.load, sha256=found.sha256))
        self._order = tuple(admitted)
        return self._order

    # --- reports -----------------------------------------------------------------------------------------------------

    def _take(self, report: messages.Report) -> None:
        serial = report.report.serial if isinstance(report, messages.Opened) else getattr(report, "serial", None)
        if serial is not None and serial not in self._wanted:
            return  # of a camera that was let go of, or of none that there is
        if isinstance(report, messages.FrameMeta):
            self.frames.announce(report)
            if self._crashes:
                self._crashes.pop(report.serial, None)
            listener = self._listener
            if listener is not None:
                listener(report)
            return
        with self._lock:
            match report:
                case messages.Alive():
                    for name, counters in report.counters.items():
                        self.status_log.count(name, counters, report.temperatures.get(name))
                case messages.Opened():
                    self._opened(report)
                case messages.StateIs():
                    self.status_log.set_state(report.serial, report.state, report.cause, report.remedy)
                case messages.Answer():
                    if report.request:
                        self._answers[report.request] = report
                    self._say_back()
                case messages.Triggered():
                    self._triggered = {k: v for k, v in self._triggered.items() if k > report.round - 8}
                    self._triggered[report.round] = report
                case _:
                    self._take_word(report)
            self._changed.notify_all()

    def _take_word(self, report: messages.Report) -> None:
        if isinstance(report, messages.Slow):
            self.status_log.event(protocol.EventKind.NOTICE, *words.slow(report.serial, report.seconds), report.serial)
        elif isinstance(report, messages.Hello) and report.version != messages.WIRE_VERSION:
            self._refused_version = True
            self._closing = True

    def _opened(self, report: messages.Opened) -> None:
        """Give the camera a ring that its images fit into."""
        serial = report.report.serial
        untriggered = {"trigger mode", "software trigger"} & set(report.report.missing)
        (self._free.add if untriggered else self._free.discard)(serial)
        try:
            if not 0 < report.image_bytes <= _MOST_IMAGE_BYTES:
                raise protocol.CameraError(Phrase("error-image-bytes", {"camera": serial, "bytes": report.image_bytes}))
            self._tell(self.frames.ring_for(serial, report.image_bytes))
        except protocol.CameraError as error:
            self.status_log.set_state(serial, protocol.CameraState.ERROR, error.message, error.hint)
            return
        if report.again:
            self.status_log.add(serial, reopened=1)

    def _say_back(self) -> None:
        if self._back_since is None:
            return
        seconds = time.perf_counter() - self._back_since
        self._back_since = None
        usable = sum(1 for status in self.status_log.statuses().values() if status.state.usable)
        self.status_log.event(
            protocol.EventKind.SERVICE_BACK,
            f"The camera process is back after {seconds:.1f} s with {usable} of {len(self._wanted)} cameras.",
        )


def default_log_file() -> Path:
    """Where the camera process writes what drivers print."""
    from platformdirs import user_log_path

    return user_log_path("spherecal", appauthor=False) / "cameras.log"
