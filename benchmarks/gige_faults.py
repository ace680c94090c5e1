"""Faults on the wire: simulated GigE cameras behind the Aravis producer, each fault made, seen, healed and timed."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.protocol import CameraSettings, CameraState, CaptureRequest, FrameSet
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.producer.build_producer import DISCOVERY_VARIABLE, build_producer

TIMEOUT_S = 0.6
LIMIT_S = 20.0


@dataclass(frozen=True)
class Wire:
    """The rig and the source that has its cameras open."""

    rig: GigeRig
    source: GenicamSource


@contextmanager
def wire(cameras: list[GigeCamera]) -> Iterator[Wire]:
    """Cameras on the wire, opened by a GenicamSource on the rig's computer; only as root."""
    before = os.environ.get(DISCOVERY_VARIABLE)
    producer = build_producer(aravis=True)
    with GigeRig(cameras) as rig, rig.entered():
        os.environ[DISCOVERY_VARIABLE] = str(producer.parent)
        try:
            with GenicamSource() as source:
                serials = source.discover().serials
                source.open(serials, dict.fromkeys(serials, CameraSettings(exposure_us=1000.0)))
                source.capture_set()  # streams are set up with the first
                yield Wire(rig, source)
        finally:
            del os.environ[DISCOVERY_VARIABLE]
            if before is not None:
                os.environ[DISCOVERY_VARIABLE] = before


@dataclass(frozen=True)
class WireFault:
    """What is done to a camera, how it is undone, and by what it is recognised: a state, and words of its cause."""

    name: str
    fault: tuple[str | float, ...]
    heal: tuple[str | float, ...]
    state: CameraState
    words: str


_INCOMPLETE, _LOST, _BUSY = CameraState.INCOMPLETE_FRAMES, CameraState.LOST, CameraState.BUSY
FAULTS = (
    WireFault("5 % of the packets lost", ("loss", "X", 5), ("loss", "X", 0), _INCOMPLETE, "parts missing"),
    WireFault("30 of 300 packets lost in a row", ("burst", "X", 30, 300), ("burst", "X", 0, 1), _INCOMPLETE, "parts"),
    WireFault("line of 5 Mbit/s", ("thin", "X", 5), ("thin", "X", 0), _INCOMPLETE, "parts missing"),
    WireFault("cable out and in", ("unplug", "X"), ("plug", "X"), _LOST, "not found"),
    WireFault("power off and on", ("power_off", "X"), ("power_on", "X"), _LOST, "not found"),
    WireFault("a second program takes control", ("seize", "X"), ("release", "X"), _BUSY, "nother program"),
    WireFault("address of another camera", ("conflict", "X", "Y"), ("home", "X"), _LOST, "same address"),
    WireFault("address of another subnet", ("subnet", "X"), ("home", "X"), _LOST, "not in the network"),
)


@dataclass(frozen=True)
class WireOutcome:
    """Seconds until a set was incomplete or a state changed, until the right cause was shown, until sets were whole."""

    seen_s: float | None
    named_s: float | None
    recovered_s: float | None


def injected(wire: Wire, fault: WireFault, serial: str, other: str) -> WireOutcome:
    """Make a fault while sets are taken, heal it when it has been named, wait for a whole set."""

    def make(words: tuple[str | float, ...]) -> None:
        wire.rig.fault(str(words[0]), *[{"X": serial, "Y": other}.get(str(w), w) for w in words[1:]])

    began = time.perf_counter()
    make(fault.fault)
    seen: float | None = None
    named: float | None = None
    while named is None and time.perf_counter() - began < LIMIT_S:
        taken = _set(wire)
        status = wire.source.statuses()[serial]
        now = time.perf_counter() - began
        if seen is None and (not taken.complete or not status.state.usable):
            seen = now
        if status.state is fault.state and fault.words in status.cause:
            named = now
    healed = time.perf_counter()
    make(fault.heal)
    while time.perf_counter() - healed < LIMIT_S:
        if _set(wire).complete and all(status.state.usable for status in wire.source.statuses().values()):
            return WireOutcome(seen, named, time.perf_counter() - healed)
    return WireOutcome(seen, named, None)


def _set(wire: Wire) -> FrameSet:
    return wire.source.capture_set(CaptureRequest(timeout_s=TIMEOUT_S, retries=0))
