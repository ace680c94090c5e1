"""One piece of work in a thread of its own, with progress and cancelling; where garbage is collected meanwhile."""

import gc
import sys
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from PySide6.QtCore import QObject, QThread, QTimer, Signal, Slot

from spherecal.base.context import Context, Progress
from spherecal.base.errors import Cancelled

_EVERY_MS = 25
# Of collections of what is half new until one of everything is due while work runs; with all libraries loaded that
# holds all threads for 130 to 230 ms. Python's own 10 count where no work runs.
_MANY = 1000

_working: set[object] = set()  # tasks: while any works the collector looks at what is new, not at everything


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
        """Collect the oldest generation whose time has come."""
        generation = due(gc.get_count(), gc.get_threshold(), bool(_working))
        if generation == 2 and len(sys.modules) > self._modules:
            self._modules = len(sys.modules)  # what is there is mostly of libraries and stays: set aside
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


T = TypeVar("T")
Work = Callable[[Context], T]

_LEFT: list[Callable[[], object]] = []  # whether work runs on that was left behind; keeps a thread's object


def leave_behind(runs: Callable[[], object]) -> None:
    """Nobody waits for this work any more: it compiles kernels. `runs`: whether it still does."""
    _LEFT.append(runs)


def something_left() -> bool:
    """Whether work that nobody waited for runs on."""
    return threading.active_count() > 1 or any(runs() for runs in _LEFT)


class BackgroundTask(QThread):
    """Runs `work(context)`; ends with one of `succeeded`, `failed`, `cancelled`. Progress is a mailbox, not events."""

    succeeded = Signal(object)
    failed = Signal(object)
    cancelled = Signal()

    def __init__(self, name: str, work: Work[object], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.name, self._work = name, work
        self._stop, self._enough = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._news: list[Progress] = []
        self.latest: Progress | None = None  # what was reported last, whoever has taken the news
        self.began_s = time.perf_counter()
        self.usual_s: float | None = None  # what such work usually takes here, where that is known
        self.setObjectName(f"task {name}")

    def run(self) -> None:
        """Do the work (called by QThread)."""
        _working.add(self)
        try:
            result = self._work(Context(self._note, self._stop.is_set, self._enough.is_set))
        except Cancelled:
            self.cancelled.emit()
        except Exception as error:
            self.failed.emit(error)
        else:
            self.succeeded.emit(result)
        finally:
            _working.discard(self)

    def cancel(self) -> None:
        """Ask the work to stop."""
        self._stop.set()

    def stop_here(self) -> None:
        """Ask the work to end with what there is so far, as soon as there is something."""
        self._enough.set()

    @property
    def stopping(self) -> bool:
        """Whether it was asked to stop."""
        return self._stop.is_set()

    @property
    def keeping(self) -> bool:
        """Whether it was asked to end with what there is so far."""
        return self._enough.is_set()

    def take_news(self) -> list[Progress]:
        """The progress since the last call, oldest first; of each stage the last event and all iterations are kept."""
        with self._lock:
            news, self._news = self._news, []
        return news

    @property
    def stage(self) -> str:
        """What it is busy with; empty before it has said so."""
        return self.latest.stage if self.latest is not None else ""

    def _note(self, progress: Progress) -> None:
        with self._lock:
            self.latest = progress
            if self._news and self._news[-1].stage == progress.stage and progress.iteration is None:
                self._news[-1] = progress
            else:
                self._news.append(progress)


class Runner(QObject):
    """Runs one task at a time and tells how it ended, always in the window's thread."""

    started = Signal(str)
    ended = Signal(str)
    lasted = Signal(str, float)  # name, seconds; of work that came to its end

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.task: BackgroundTask | None = None
        self._then: dict[str, Callable[..., None] | None] = {}  # what to call, by how it ended

    @property
    def running(self) -> str | None:
        """The name of the running task."""
        return self.task.name if self.task is not None else None

    def start(
        self,
        name: str,
        work: Work[T],
        on_done: Callable[[T], None],
        on_failed: Callable[[BaseException], None],
        on_cancelled: Callable[[], None] | None = None,
    ) -> bool:
        """Start work; False where something runs already. `on_cancelled` None: nothing is."""
        if self.task is not None:
            return False
        self._then = {"done": on_done, "failed": on_failed, "cancelled": on_cancelled}
        task = BackgroundTask(name, work, self)
        task.succeeded.connect(self._succeeded)
        task.failed.connect(self._failed)
        task.cancelled.connect(self._cancelled)
        self.task = task
        task.start()
        self.started.emit(name)
        return True

    def cancel(self) -> None:
        """Ask the running work to stop."""
        if self.task is not None:
            self.task.cancel()

    def stop_here(self) -> None:
        """Ask the running work to end with what there is so far."""
        if self.task is not None:
            self.task.stop_here()

    def close(self, patience_ms: int = 5000) -> bool:
        """Stop what runs and wait for it; whether it has ended."""
        if self.task is None:
            return True
        self.task.cancel()
        return self.task.wait(patience_ms)

    def abandon(self, patience_ms: int) -> None:
        """Stop what runs, or leave it behind unheard: Qt ends the program with the object of a running thread."""
        if self.close(patience_ms) or self.task is None:
            return
        task, self.task = self.task, None
        for one in (task.succeeded, task.failed, task.cancelled):
            one.disconnect()
        task.setParent(None)
        leave_behind(task.isRunning)

    @Slot(object)
    def _succeeded(self, result: object) -> None:
        if self.task is not None:
            self.lasted.emit(self.task.name, time.perf_counter() - self.task.began_s)
        self._end("done", result)

    @Slot(object)
    def _failed(self, error: BaseException) -> None:
        self._end("failed", error)

    @Slot()
    def _cancelled(self) -> None:
        self._end("cancelled")

    def _end(self, how: str, *found: object) -> None:
        task, self.task, callback = self.task, None, self._then.get(how)
        if task is not None:
            task.wait()
            task.deleteLater()
            self.ended.emit(task.name)
        if callback is not None:
            callback(*found)
