"""The camera process: one round-robin loop that owns Harvesters and every camera; genicam keeps Python's lock.

With a thread for each camera it is late by 116 ms (95th percentile), in one loop by 5 (12 cameras at 15 frames/s).
"""

import faulthandler
import gc
import os
import signal
import sys
import time
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection, wait
from pathlib import Path

from spherecal_cameras.genicam import messages, words
from spherecal_cameras.genicam.device import Device, DeviceLost
from spherecal_cameras.genicam.features import FeatureError, plain
from spherecal_cameras.genicam.hub import Producer, access_of
from spherecal_cameras.genicam.rings import TouchMark
from spherecal_cameras.genicam.slots import SLOW_S, LateAnswers, Slot, assess, attach, why_not_opened
from spherecal_cameras.genicam.wire import Inbox, pack
from spherecal_cameras.matching import TRIGGERED
from spherecal_cameras.protocol import CameraSettings, CameraState, SetupReport

_IDLE_S = 0.002
_HEARTBEAT_S = 0.1
_CHECK_S = 0.5  # between two looks at one camera's health
_TEMPERATURE_S = 2.0
_SLOW_SHARE = 20  # checks may take this part of the time
# A call that hangs keeps Python from seeing that the program has gone: then the system ends the process.
_HUNG_S = 60.0
_OPEN_S = 20.0  # GigE cameras with unreachable addresses try for some seconds

_SET_UP_S = 10.0
# From an action command to the moment that it names: it must have reached every camera by then, and switches queue
# packets for some ms. Clocks of one network differ by less than 1 us; of two that were never joined, by anything.
_LEAD_S = 0.05
_CLOCKS_NS = 10_000_000

_NICE = 5

# what TouchMark tells the program after a crash
ACTIONS = ("", "loading its driver", "opening it", "setting it up", "reading images", "triggering it", "checking it")
LOADING, OPENING, SETTING_UP, READING, TRIGGERING, CHECKING = range(1, 7)


def run(connection: Connection, touch_name: str, log_file: str | None) -> None:
    """Serve one program until it quits or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the program's; it ends us
    _die_with_parent()
    _give_way()
    _quiet(log_file)
    faulthandler.dump_traceback_later(_HUNG_S, exit=True)
    touch = TouchMark(touch_name, create=False)
    service = _Service(connection, touch)
    try:
        service.serve()
    except (EOFError, BrokenPipeError, ConnectionResetError):
        pass  # the program is gone
    finally:
        service.close()
        touch.close()
        faulthandler.cancel_dump_traceback_later()


def _die_with_parent() -> None:
    """Have Linux end us with the program even while a driver's call hangs; elsewhere `_HUNG_S` does it."""
    if sys.platform.startswith("linux"):
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def _give_way() -> None:
    """Let the window's thread go first where cores are few: buffers bridge what is lost, a hand at a mouse does not.

    Twelve cameras of 5 MP taking sets on two cores: a 16 ms timer of the program late by 2.2 ms (95th percentile; 7.6
    at most), without it 2.8 (16).
    """
    if hasattr(os, "nice"):
        with suppress(OSError):
            os.nice(_NICE)


def _quiet(log_file: str | None) -> None:
    """Send what drivers print into the log file, or nowhere."""
    target = os.open(os.devnull, os.O_WRONLY)
    if log_file is not None:
        with suppress(OSError):
            Path(log_file).parent.mkdir(parents=True, exist_ok=True)
            large = Path(log_file).exists() and Path(log_file).stat().st_size > 1_000_000
            target = os.open(log_file, os.O_WRONLY | os.O_CREAT | (os.O_TRUNC if large else os.O_APPEND))
    os.dup2(target, 1)
    os.dup2(target, 2)
    faulthandler.enable()


class _Service:
    def __init__(self, connection: Connection, touch: TouchMark) -> None:
        self._connection, self._touch = connection, touch
        self._inbox = Inbox(connection, messages.COMMANDS)
        self._producers: dict[str, Producer] = {}
        self._slots: dict[str, Slot] = {}
        self._acquiring = False
        self._live_s: float | None = None
        self._next_live_s = 0.0
        self._next_heartbeat_s = 0.0
        self._running = True
        self._late = LateAnswers()

    # --- the loop ----------------------------------------------------------------------------------------------------

    def serve(self) -> None:
        self._send(messages.Hello(messages.WIRE_VERSION, os.getpid()))
        gc.freeze()
        while self._running:
            busy = False
            while wait([self._connection], 0.0):
                for command in self._inbox.messages():
                    self._obey(command)
                busy = True
            for slot in self._slots.values():
                busy |= self._pump(slot)
            self._live_trigger()
            self._look_after()
            if not busy:
                wait([self._connection], _IDLE_S)  # sleeps without Python's lock, wakes at a command

    def close(self) -> None:
        """Close cameras and producers, as far as they let themselves be closed."""
        faulthandler.dump_traceback_later(_HUNG_S / 6, exit=True)
        for _, device in self._there():
            device.close()
        for producer in self._producers.values():
            producer.close()

    def _there(self) -> list[tuple[Slot, Device]]:
        """The cameras that are open now."""
        return [(slot, slot.device) for slot in self._slots.values() if slot.device is not None]

    def _send(self, report: messages.Report) -> None:
        self._connection.send_bytes(pack(report))

    def _obey(self, command: messages.Command) -> None:
        match command:
            case messages.Open():
                self._keep_open(command)
            case messages.Apply():
                self._send(messages.Answer(command.request, self._apply(command.settings)))
            case messages.UseRing():
                self._use_ring(command)
            case messages.Acquire():
                self._acquire(command.on)
            case messages.Live():
                self._live_s = None if command.rate_hz is None else 1.0 / command.rate_hz
                self._next_live_s = 0.0
            case messages.Trigger():
                self._trigger(command.round, command.serials)
            case messages.Describe():
                slot = self._slots.get(command.serial)
                device = slot.device if slot else None
                self._send(messages.Answer(command.request, features=device.describe() if device else ()))
            case messages.Indicate():
                slot = self._slots.get(command.serial)
                device = slot.device if slot else None
                self._send(messages.Answer(command.request, features=device.indicate(command.on) if device else ()))
            case messages.Quit():
                self._running = False

    # --- opening and losing ------------------------------------------------------------------------------------------

    def _keep_open(self, command: messages.Open) -> None:
        wanted = {camera.serial: camera for camera in command.cameras}
        for serial in [s for s in self._slots if s not in wanted]:
            self._touch.set(self._slots[serial].number, CHECKING)
            slot = self._slots.pop(serial)
            if slot.device is not None:
                slot.device.close()
        for number, camera in enumerate(command.cameras):
            known = self._slots.get(camera.serial)
            if known is None or not known.is_for(camera):
                self._slots[camera.serial] = known = Slot(number, camera)
            known.number, known.tries = number, 0
        reports = []
        for slot in self._slots.values():
            new = wanted[slot.serial].settings
            if slot.device is None:
                slot.settings = new
                reports += self._open(slot)
            else:
                reports += self._set_up(slot, new)
        self._touch.set(-1, 0)
        self._send(messages.Answer(command.request, tuple(reports)))

    def _open(self, slot: Slot) -> list[SetupReport]:
        """Try to open a camera; says what came out, and the report if it worked."""
        self._send(messages.Working(f"opening camera {slot.serial}", _OPEN_S))
        if slot.producer not in self._producers or self._producers[slot.producer].problem:
            self._touch.set(slot.number, LOADING)
            self._producers[slot.producer] = Producer(slot.producer, slot.load, slot.sha256)
        producer = self._producers[slot.producer]
        if producer.problem:
            return self._cannot(slot, words.state_in_words("no producer", file=producer.file, why=producer.problem))
        self._touch.set(slot.number, OPENING)
        listed = producer.find(slot.serial, slot.device_id)
        if listed is None or slot.tries:
            with suppress(Exception):
                producer.rescan()
            listed = producer.find(slot.serial, slot.device_id)
        if listed is None:
            return self._cannot(slot, words.state_in_words("not listed"))
        access = access_of(listed)
        if access == "busy":
            return self._cannot(slot, words.state_in_words("busy", why=""))
        try:
            device = Device(producer, listed, slot.serial, slot.settings)
        except Exception as error:
            why = why_not_opened(error, access)
            if why[0] is CameraState.BUSY and slot.failure is not None:
                why = slot.failure  # Harvesters has kept it open since then
            slot.failure = why if why[0] is CameraState.ERROR else None
            return self._cannot(slot, why)
        finally:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # Harvesters has taken it over
        return self._ready(slot, device)

    def _ready(self, slot: Slot, device: Device) -> list[SetupReport]:
        try:
            report = self._write(slot, device)
            if self._acquiring:
                device.acquire(True)
        except DeviceLost as error:
            device.close()
            slot.device = None
            return self._cannot(slot, words.state_in_words("lost", why=error))
        slot.tries, slot.failure = 0, None
        self._say(slot, CameraState.STREAMING if device.acquiring else CameraState.CONNECTED)
        return [report]

    def _write(self, slot: Slot, device: Device) -> SetupReport:
        """Give a camera the settings of its slot, and say how large its images are."""
        self._touch.set(slot.number, SETTING_UP)
        self._announce_set_up(slot)
        report = device.set_up(slot.settings)
        if slot.device is None:
            if slot.ring is not None and slot.ring.slot_bytes >= device.image_bytes():
                device.use_ring(attach(slot.ring))
            slot.device = device
        self._send(messages.Opened(report, device.image_bytes(), slot.opened_before))
        slot.opened_before = True
        return report

    def _cannot(self, slot: Slot, state: tuple[CameraState, str, str]) -> list[SetupReport]:
        slot.wait_longer()
        self._say(slot, *state)
        return []

    def _lost(self, slot: Slot, error: Exception) -> None:
        if slot.device is not None:
            slot.device.close()
            slot.device = None
        slot.tries = 0
        slot.wait_longer()
        self._say(slot, *words.state_in_words("lost", why=plain(error)))

    def _say(self, slot: Slot, state: CameraState, cause: str = "", remedy: str = "") -> None:
        report = messages.StateIs(slot.serial, state, cause, remedy)
        if report != slot.said:
            slot.said = report
            self._send(report)

    # --- set-up ------------------------------------------------------------------------------------------------------

    def _apply(self, settings: dict[str, CameraSettings]) -> tuple[SetupReport, ...]:
        reports = []
        for serial, new in settings.items():
            slot = self._slots.get(serial)
            if slot is not None:
                slot.settings = new
                reports += self._set_up(slot, new) if slot.device is not None else []
        return tuple(reports)

    def _set_up(self, slot: Slot, settings: CameraSettings) -> list[SetupReport]:
        device = slot.device
        assert device is not None
        slot.settings = settings
        try:
            report = self._write(slot, device)
            self._say(slot, CameraState.STREAMING if device.acquiring else CameraState.CONNECTED)
        except DeviceLost as error:
            self._lost(slot, error)
            return []
        return [report]

    def _announce_set_up(self, slot: Slot) -> None:
        """Some drivers take seconds: packet sizes are tried out, and four cameras of 16 MP queue 320 MB of buffers."""
        self._send(messages.Working(f"setting up camera {slot.serial}", _SET_UP_S))

    def _use_ring(self, ring: messages.UseRing) -> None:
        slot = self._slots.get(ring.serial)
        if slot is not None:
            slot.ring = ring
            if slot.device is not None:
                slot.device.use_ring(attach(ring))

    # --- images ------------------------------------------------------------------------------------------------------

    def _acquire(self, on: bool) -> None:
        self._acquiring = on
        for slot, device in self._there():
            self._touch.set(slot.number, SETTING_UP)
            self._announce_set_up(slot)
            try:
                device.acquire(on)
                self._say(slot, CameraState.STREAMING if on else CameraState.CONNECTED)
            except DeviceLost as error:
                self._lost(slot, error)

    def _pump(self, slot: Slot) -> bool:
        device = slot.device
        if device is None or not device.acquiring:
            return False
        self._touch.set(slot.number, READING)
        try:
            frame = device.pump()
        except DeviceLost as error:
            self._lost(slot, error)
            return True
        self._touch.set(-1, 0)
        if frame is None:
            return False
        self._send(frame)
        return True

    def _trigger(self, round_number: int, serials: tuple[str, ...]) -> None:
        refused: dict[str, str] = {}
        chosen = [self._slots[serial] for serial in serials if serial in self._slots]
        # a camera that answers slowly comes last: the others shall be exposed together
        scheduled = [slot for slot in chosen if slot.settings.trigger == "scheduled" and slot.device is not None]
        refused |= self._schedule(scheduled, round_number)
        for slot in sorted(chosen, key=lambda slot: slot.slowness_s > SLOW_S):
            if slot.device is None or slot in scheduled:
                continue  # its state says why
            self._touch.set(slot.number, TRIGGERING)
            began = time.perf_counter()
            try:
                slot.device.trigger(round_number)
            except FeatureError as error:
                refused[slot.serial] = str(error)
                slot.next_check_s = 0.0
            self._note_late(slot, time.perf_counter() - began)
        self._touch.set(-1, 0)
        if round_number:
            self._send(messages.Triggered(round_number, refused))

    def _schedule(self, slots: list[Slot], round_number: int) -> dict[str, str]:
        """One action command a driver for all its cameras, for a moment of their common clock that is still to come."""
        refused: dict[str, str] = {}
        at_s = time.perf_counter() + _LEAD_S
        by_producer: dict[str, list[tuple[Slot, int]]] = {}
        for slot in slots:
            assert slot.device is not None
            try:
                by_producer.setdefault(slot.producer, []).append((slot, slot.device.schedule(round_number, at_s)))
            except FeatureError as error:
                refused[slot.serial] = str(error)
        for producer, together in by_producer.items():
            times = [at_ns for _, at_ns in together]
            problem = "their clocks differ" if max(times) - min(times) > _CLOCKS_NS else ""
            try:
                if not problem:
                    self._producers[producer].act(times[0])
            except FeatureError as error:
                problem = str(error)
            if problem:
                refused |= {slot.serial: problem for slot, _ in together}
        return refused

    def _live_trigger(self) -> None:
        now = time.perf_counter()
        if self._live_s is None or not self._acquiring or now < self._next_live_s:
            return
        self._next_live_s = now + self._live_s
        ready = [(s, device) for s, device in self._there() if s.settings.trigger in TRIGGERED]
        able = [s for s, d in ready if s.settings.trigger == "scheduled" or d.features.name("software trigger")]
        self._trigger(0, tuple(slot.serial for slot in able))

    # --- health ------------------------------------------------------------------------------------------------------

    def _look_after(self) -> None:
        """One camera's health at a time, so that the loop never pauses long; a heartbeat when it is due."""
        now = time.perf_counter()
        for slot in self._slots.values():
            if slot.device is None and now >= slot.next_try_s:
                self._open(slot)
                break
            if slot.device is not None and now >= slot.next_check_s:
                slot.next_check_s = now + _CHECK_S
                self._check(slot, slot.device, now)
                break
        if now >= self._next_heartbeat_s:
            self._next_heartbeat_s = now + _HEARTBEAT_S
            faulthandler.dump_traceback_later(_HUNG_S, exit=True)
            there = self._there()
            counters = {s.serial: replace(d.counters(self._wanted_hz(s)), late=s.late) for s, d in there}
            self._send(messages.Alive(counters, {s.serial: d.temperature_c for s, d in there}))

    def _check(self, slot: Slot, device: Device, now: float) -> None:
        self._touch.set(slot.number, CHECKING)
        try:
            device.check()
            # a camera that answers slowly delays all others: check it less often, and report it now and then
            after = time.perf_counter()
            seconds = after - now
            slot.next_check_s = after + max(_CHECK_S, _SLOW_SHARE * seconds)
            slot.slowness_s = seconds
            self._note_late(slot, seconds)
            if now >= slot.next_temperature_s:
                slot.next_temperature_s = now + _TEMPERATURE_S
                device.read_temperature()
                device.read_clock_state()
                device.latch_clock()
        except DeviceLost as error:
            self._lost(slot, error)
            return
        finally:
            self._touch.set(-1, 0)
        self._say(slot, *assess(slot, device, now))
        if device.outgrown:
            self._set_up(slot, slot.settings)  # with a larger ring

    def _note_late(self, slot: Slot, seconds: float) -> None:
        if seconds > SLOW_S:
            slot.late += 1
            if (said := self._late.note(slot.serial, seconds, time.perf_counter())) is not None:
                self._send(said)

    def _wanted_hz(self, slot: Slot) -> float | None:
        if slot.settings.trigger == "free":
            return slot.settings.frame_rate_hz
        return 1.0 / self._live_s if self._live_s and slot.settings.trigger in TRIGGERED else None
