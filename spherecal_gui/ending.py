"""SIGTERM and Ctrl-C end the program as closing the window does: cameras are let go of, children end."""

import multiprocessing
import os
import signal
import socket
from collections.abc import Callable

from PySide6.QtCore import QObject, QSocketNotifier, QTimer

_AGAIN_MS = 1000  # a computation may still be stopping: the window refuses to close until it has
_MOST_TIMES = 15


class Ending(QObject):
    """Closes the window when the system asks the program to end; `close` says whether it has closed."""

    def __init__(self, close: Callable[[], bool], quit_now: Callable[[], None], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._close, self._quit, self._times = close, quit_now, 0
        self._reader, self._writer = socket.socketpair()
        for one in (self._reader, self._writer):
            one.setblocking(False)
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: None)  # Python wakes the socket; Qt hears it there
        self._notifier = QSocketNotifier(self._reader.fileno(), QSocketNotifier.Type.Read, self)
        self._notifier.activated.connect(self._heard)

    def _heard(self) -> None:
        numbers = self._reader.recv(64)
        if signal.SIGTERM in numbers or signal.SIGINT in numbers:
            self._end()

    def _end(self) -> None:
        self._times += 1
        if self._close():
            self._quit()
        elif self._times < _MOST_TIMES:
            QTimer.singleShot(_AGAIN_MS, self._end)
        else:  # nothing is lost: all that was recorded is on disk
            end_children()
            os._exit(128 + signal.SIGTERM)


def end_children() -> None:
    """End the processes that this one has started, such as that of the cameras."""
    for child in multiprocessing.active_children():
        child.terminate()
