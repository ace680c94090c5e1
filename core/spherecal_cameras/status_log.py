"""What a source knows of its cameras: their states, counters and the events not yet taken."""

import logging
import threading
import time
from collections import deque
from collections.abc import Iterable
from dataclasses import replace

from spherecal_cameras.protocol import CameraEvent, CameraState, CameraStatus, Counters, EventKind

_EVENTS_KEPT = 1000

log = logging.getLogger("spherecal.cameras")


class StatusLog:
    """States and events; thread-safe, and never waits."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._statuses: dict[str, CameraStatus] = {}
        self._events: deque[CameraEvent] = deque(maxlen=_EVENTS_KEPT)

    def keep_only(self, serials: Iterable[str], state: CameraState = CameraState.FOUND) -> None:
        """Keep these cameras only; what is known of them stays, `state` is that of the others."""
        with self._lock:
            self._statuses = {one: self._statuses.get(one, CameraStatus(one, state)) for one in serials}

    def statuses(self) -> dict[str, CameraStatus]:
        """The state of every wanted camera, by serial."""
        with self._lock:
            return dict(self._statuses)

    def take_events(self) -> list[CameraEvent]:
        """The events since the last call, oldest first."""
        with self._lock:
            events = list(self._events)
            self._events.clear()
        return events

    def set_state(self, serial: str, state: CameraState, cause: str = "", remedy: str = "") -> None:
        """Note a camera's state, and make an event of it if it has changed."""
        with self._lock:
            status = self._statuses.get(serial)
            if status is None or (status.state, status.cause) == (state, cause):
                return
            self._statuses[serial] = status = replace(status, state=state, cause=cause, remedy=remedy)
        self.event(EventKind.STATE, f"Camera {serial}: {state.value}. {cause}".strip(), remedy, serial, status)

    def event(
        self,
        kind: EventKind,
        message: str,
        hint: str = "",
        camera: str | None = None,
        status: CameraStatus | None = None,
    ) -> None:
        """Note that something happened, and log it."""
        with self._lock:
            self._events.append(CameraEvent(kind, message, hint, camera, time.perf_counter(), status))
        well = kind == EventKind.SERVICE_BACK or (status is not None and status.state.usable)
        log.log(logging.INFO if well else logging.WARNING, "%s", message)

    def count(self, serial: str, counters: Counters, temperature_c: float | None) -> None:
        """Take over what was counted elsewhere; what is counted here stays."""
        with self._lock:
            status = self._statuses.get(serial)
            if status is not None:
                own = replace(counters, overwritten=status.counters.overwritten, reopened=status.counters.reopened)
                self._statuses[serial] = replace(status, counters=own, temperature_c=temperature_c)

    def add(self, serial: str, overwritten: int = 0, reopened: int = 0) -> None:
        """Count images that could not be fetched in time, or returns after a loss."""
        with self._lock:
            status = self._statuses.get(serial)
            if status is not None:
                old = status.counters
                new = replace(old, overwritten=old.overwritten + overwritten, reopened=old.reopened + reopened)
                self._statuses[serial] = replace(status, counters=new)
