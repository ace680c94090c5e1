"""Faults of simulated cameras behind the real Harvesters path: each is injected, seen, healed and timed.

For tests, studies and benchmarks of spherecal_cameras; needs the simulated producer (a C++ compiler).
"""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.protocol import CameraSettings, CaptureRequest, EventKind
from spherecal_gentl.producer import producer_control as control
from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera
from spherecal_gentl.producer.region import ANY_ADDRESS

TIMEOUT_S = 0.4
LIMIT_S = 15.0


@dataclass(frozen=True)
class Rig:
    """Simulated cameras and the source that has them open."""

    control: ProducerControl
    source: GenicamSource


@contextmanager
def rig(cameras: list[SimulatedCamera], settings: CameraSettings | None = None) -> Iterator[Rig]:
    """Simulated cameras opened by a GenicamSource, taking sets by software trigger."""
    settings = settings or CameraSettings(exposure_us=1000.0)
    before = dict(os.environ)
    with ProducerControl(cameras) as steering:
        os.environ.update(steering.environment)
        try:
            with GenicamSource() as source:
                serials = source.discover().serials
                source.open(serials, dict.fromkeys(serials, settings))
                yield Rig(steering, source)
        finally:
            os.environ.clear()
            os.environ.update(before)


@dataclass(frozen=True)
class Fault:
    """What is done to a camera, and how it is undone."""

    name: str
    inject: Callable[[Rig, str], None]
    heal: Callable[[Rig, str], None]
    needs_camera_named: bool = True


def _nothing(_: Rig, __: str) -> None:
    """Some faults pass by themselves."""


def _set(**fields: float) -> Callable[[Rig, str], None]:
    return lambda rig, serial: rig.control.set(serial, **fields)


WIDTH = 0x00  # its register in device.xml


def _clear(rig: Rig, serial: str) -> None:
    rig.control.clear_faults(serial)


def _kill(number: signal.Signals) -> Callable[[Rig, str], None]:
    def act(rig: Rig, _: str) -> None:
        pid = rig.source.service_pid
        assert pid is not None
        os.kill(pid, number)

    return act


def _hold_elsewhere(rig: Rig, serial: str) -> None:
    """Another program takes the camera while it is unplugged."""
    rig.control.set(serial, open_error=control.ACCESS_DENIED)
    rig.control.unplug(serial)
    rig.control.plug(serial)


def _address_conflict(rig: Rig, serial: str) -> None:
    rig.control.set(serial, open_error=control.NOT_AVAILABLE)
    rig.control.unplug(serial)
    rig.control.plug(serial)


FAULTS = (
    Fault("unplugged, plugged in again", lambda r, s: r.control.unplug(s), lambda r, s: r.control.plug(s)),
    Fault("power cycle of 1 s", lambda r, s: r.control.power_cycle(s, 1.0), _nothing),
    Fault("held by another program", _hold_elsewhere, _clear),
    Fault("address conflict", _address_conflict, _clear),
    Fault(
        "register reads fail",
        _set(read_error=control.IO_ERROR, read_error_address=ANY_ADDRESS, read_error_count=-1),
        _clear,
    ),
    Fault(
        "register writes fail",
        _set(write_error=control.IO_ERROR, write_error_address=ANY_ADDRESS, write_error_count=-1),
        _clear,
    ),
    Fault("registers take 0.3 s", _set(port_delay_us=300_000), _clear),
    Fault("stream error", _set(event_error=control.IO_ERROR, event_error_count=1), _nothing),
    Fault("incomplete image", _set(incomplete_count=1), _nothing),
    Fault("image lost on the way", _set(lost_frame_count=1), _nothing),
    Fault("trigger dropped", _set(dropped_trigger_count=1), _nothing),
    Fault("image 0.6 s late", _set(late_ms=600, late_count=1), _nothing),
    Fault(
        "register read, unknown error code",
        _set(read_error=control.UNKNOWN_CODE, read_error_address=WIDTH, read_error_count=-1),
        _clear,
    ),
    Fault("stream, unknown error code (crash)", _set(event_error=control.UNKNOWN_CODE, event_error_count=1), _nothing),
    Fault("producer crashes", _set(crash_count=1), _nothing),
    Fault("camera process: SIGSEGV", _kill(signal.SIGSEGV), _nothing, False),
    Fault("camera process: SIGKILL", _kill(signal.SIGKILL), _nothing, False),
    Fault("camera process hangs: SIGSTOP", _kill(signal.SIGSTOP), _nothing, False),
)


@dataclass(frozen=True)
class Outcome:
    """One injection: seconds until it was seen and until sets were complete again, None if never; was it named."""

    seen_s: float | None
    named: bool
    recovered_s: float | None
    others_lost: bool


def injected(rig: Rig, fault: Fault, serial: str) -> Outcome:
    """Inject a fault while sets are taken, heal it when it has been seen, wait for a complete set."""
    source = rig.source
    source.take_events()
    request = CaptureRequest(timeout_s=TIMEOUT_S, retries=0)
    began = time.perf_counter()
    fault.inject(rig, serial)
    seen: float | None = None
    named = others = False
    while seen is None and time.perf_counter() - began < LIMIT_S:
        taken = source.capture_set(request)
        missing = {one.camera for one in taken.missing}
        events = [e for e in source.take_events() if e.kind is not EventKind.SERVICE_BACK]
        bad = [e for e in events if e.status is None or not e.status.state.usable or e.status.cause]
        told = {e.camera for e in bad}
        if missing or bad:
            seen = min([e.at_s for e in bad] or [time.perf_counter()]) - began
            crashed = any(e.kind is EventKind.SERVICE_LOST for e in bad)
            named = serial in missing | told or not fault.needs_camera_named
            others = bool((missing | told) - {serial, None}) and not crashed
    healed = time.perf_counter()
    fault.heal(rig, serial)
    while time.perf_counter() - healed < LIMIT_S:
        if source.capture_set(request).complete and all(s.state.usable for s in source.statuses().values()):
            return Outcome(seen, named, time.perf_counter() - healed, others)
    return Outcome(seen, named, None, others)
