"""The cameras that the camera process is to keep open: what is known of each, and how their states are judged."""

import time

from spherecal_cameras.genicam import words
from spherecal_cameras.genicam.device import Device
from spherecal_cameras.genicam.features import plain
from spherecal_cameras.genicam.messages import RequestedCamera, Slow, StateIs, UseRing
from spherecal_cameras.genicam.rings import Ring
from spherecal_cameras.genicam.words import error_id
from spherecal_cameras.protocol import CameraState

_AGAIN_S = (0.3, 0.5, 1.0, 2.0)  # pauses before a lost camera is looked for again; the last one repeats
_SILENT_S = 3.0  # without a hardware trigger
_UNANSWERED = 3  # software triggers
_UNANSWERED_S = 1.5
_INCOMPLETE_S = 5.0  # how long incomplete images are remembered
SLOW_S = 0.1  # a register read takes 0.2 to 1 ms over GigE, 500 ms with the retries of a failing line
# Between two words about late answers: a bad line has one every second, for as long as it is bad.
_NOTICE_S, _LONGEST_NOTICE_S = 10.0, 600.0
_WELL_AGAIN_S = 60.0


class Slot:
    """A camera that is to be kept open: its device, if it is there, and what was last said about it."""

    def __init__(self, number: int, wanted: RequestedCamera) -> None:
        self.number = number
        self.serial, self.producer, self.settings = wanted.serial, wanted.producer, wanted.settings
        self.load, self.sha256, self.device_id = wanted.load, wanted.sha256, wanted.device_id
        self.device: Device | None = None
        self.ring: UseRing | None = None
        self.said: StateIs | None = None
        self.opened_before = False
        self.failure: tuple[CameraState, str, str] | None = None  # why it could not be opened the last time
        self.tries = 0
        self.next_try_s = 0.0
        self.next_check_s = 0.0
        self.next_temperature_s = 0.0
        self.slowness_s = 0.0
        self.late = 0  # answers

    def is_for(self, wanted: RequestedCamera) -> bool:
        """Whether it is the camera that is requested, by the same driver."""
        key = self.serial, self.producer, self.sha256, self.device_id
        return key == (wanted.serial, wanted.producer, wanted.sha256, wanted.device_id)

    def wait_longer(self) -> None:
        """Set the time of the next attempt to open."""
        self.next_try_s = time.perf_counter() + _AGAIN_S[min(self.tries, len(_AGAIN_S) - 1)]
        self.tries += 1


class LateAnswers:
    """What is said of cameras that answer late: the latest of them at once, then less and less often while it lasts."""

    def __init__(self) -> None:
        self._next_s, self._pause_s, self._last_s = 0.0, _NOTICE_S, float("-inf")
        self._worst: Slow | None = None

    def note(self, serial: str, seconds: float, now: float) -> Slow | None:
        """What is to be said now, None for nothing."""
        if now - self._last_s > _WELL_AGAIN_S:
            self._next_s, self._pause_s, self._worst = 0.0, _NOTICE_S, None
        self._last_s = now
        if self._worst is None or seconds > self._worst.seconds:
            self._worst = Slow(serial, seconds)
        if now < self._next_s:
            return None
        self._next_s, self._pause_s = now + self._pause_s, min(2 * self._pause_s, _LONGEST_NOTICE_S)
        said, self._worst = self._worst, None
        return said


def assess(slot: Slot, device: Device, now: float) -> tuple[CameraState, str, str]:
    """The state of an open camera, its cause and its remedy, in words."""
    if not device.acquiring:
        return CameraState.CONNECTED, "", ""
    if device.unreadable:
        return words.state_in_words("unreadable", why=device.unreadable)
    if now - device.last_incomplete_s < _INCOMPLETE_S:
        return words.state_in_words("incomplete")
    silent = now - device.last_image_s
    if slot.settings.trigger == "hardware" and silent > _SILENT_S:
        return words.state_in_words("no hardware trigger")
    if device.unanswered >= _UNANSWERED and silent > _UNANSWERED_S:
        return words.state_in_words("no software trigger")
    return CameraState.STREAMING, "", ""


def attach(ring: UseRing) -> Ring:
    """The ring that the program has made; images are numbered on after those in it."""
    attached = Ring(ring.name, ring.slots, ring.slot_bytes, create=False)
    attached.continue_after(attached.last())
    return attached


def why_not_opened(error: Exception, access: str) -> tuple[CameraState, str, str]:
    """The state, cause and remedy of a camera that could not be opened, by the driver's error."""
    text = plain(error)
    if "genapi" in type(error).__module__:
        return words.state_in_words("no description", why=text)
    if error_id(str(error)) in (-1004, -1005):  # resource in use, access denied
        return words.state_in_words("busy", why=f" ({text})" if text else "")
    if access == "unreachable":
        return words.state_in_words("unreachable", why=text)
    if error_id(str(error)) in (-1006, -1010, -1011, -1014):  # invalid handle, input/output, timeout, not available
        return words.state_in_words("lost", why=text)
    return words.state_in_words("failed", why=text)
