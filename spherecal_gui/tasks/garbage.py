"""Python's cyclic garbage: collected in the window's thread, as what Qt owns must not be destroyed in a worker's."""

import gc
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from PySide6.QtCore import QObject, QTimer

_EVERY_MS = 25
# Of collections of what is half new until one of everything is due while work runs; with all libraries loaded that
# holds all threads for 130 to 230 ms. Python's own 10 count where no work runs.
_MANY = 1000

_lock = threading.Lock()
_working = [0]


@contextmanager
def working() -> Iterator[None]:
    """While any work runs the collector looks at what is new, not at everything."""
    with _lock:
        _working[0] += 1
    try:
        yield
    finally:
        with _lock:
            _working[0] -= 1


class Collector(QObject):
    """Collects in the thread of its parent's event loop in place of Python, by Python's own thresholds."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._modules = 0
        self._timer = QTimer(self, interval=_EVERY_MS)
        self._timer.timeout.connect(self.collect_due)

    def start(self) -> None:
        """Take it over from Python."""
        gc.disable()
        self._timer.start()

    def stop(self) -> None:
        """Leave it to Python again."""
        self._timer.stop()
        gc.enable()

    def collect_due(self) -> None:
        """Collect the oldest generation whose time has come.

        Where libraries were loaded since, most of what is there is theirs and stays: it is never gone through again.
        """
        generation = due(gc.get_count(), gc.get_threshold(), _working[0] > 0)
        if generation == 2 and len(sys.modules) > self._modules:
            self._modules = len(sys.modules)  # most of what is there is of libraries and stays: set aside
            gc.collect(1)
            gc.freeze()
        elif generation is not None:
            gc.collect(generation)


def due(count: tuple[int, int, int], threshold: tuple[int, int, int], busy: bool) -> int | None:
    """The oldest generation that is to be collected now; None where none is."""
    limits = (*threshold[:2], _MANY if busy else threshold[2])
    if count[0] <= limits[0]:
        return None  # the older ones get their objects by collections of the younger
    return 2 if count[2] > limits[2] and count[1] > limits[1] else 1 if count[1] > limits[1] else 0
