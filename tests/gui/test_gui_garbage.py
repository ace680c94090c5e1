"""Garbage in cycles: what a worker makes is collected, and nothing of the window in a worker's thread."""

import gc
import os
import subprocess
import sys
import threading
import time
from collections import Counter

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QCoreApplication
from PySide6.QtWidgets import QPushButton, QVBoxLayout, QWidget

from spherecal_gui.tasks.task import Runner, due

SECONDS = 2.0
USUAL = (700, 10, 10)


class Ring:
    """An object in a cycle of its own; made in one thread and ended in another, so that each has its own count."""

    made = ended = 0

    def __init__(self) -> None:
        self.me = self
        Ring.made += 1

    def __del__(self) -> None:
        Ring.ended += 1

    @classmethod
    def alive(cls) -> int:
        """How many there are."""
        return cls.made - cls.ended


def where_pages_end() -> Counter:
    """How many pages, built and dropped while two workers make garbage, ended in the window's thread (True) or not."""
    ended, stop = Counter(), threading.Event()

    class Page(QWidget):
        def __init__(self) -> None:
            super().__init__()
            self.me = self  # a page and what it is connected to refer to each other
            column = QVBoxLayout(self)
            for _ in range(10):
                column.addWidget(QPushButton("x"))

        def __del__(self) -> None:
            ended[threading.current_thread() is threading.main_thread()] += 1

    def work() -> None:
        while not stop.wait(0.001):
            for _ in range(2000):
                Ring()

    workers = [threading.Thread(target=work) for _ in range(2)]
    for one in workers:
        one.start()
    until = time.monotonic() + SECONDS
    while time.monotonic() < until:
        Page()
        QCoreApplication.processEvents()
    stop.set()
    for one in workers:
        one.join()
    gc.collect()
    return ended


def test_no_page_ends_in_a_worker(qapp) -> None:
    assert not gc.isenabled(), "the suite's application collects as the program's does"
    ended = where_pages_end()
    assert ended[True] > 10
    assert not ended[False]


def test_left_to_python_they_do_or_the_program_crashes() -> None:
    """Else the test above would pass for the wrong reason."""
    program = (
        "from PySide6.QtWidgets import QApplication; from tests.gui.test_gui_garbage import where_pages_end;"
        "application = QApplication([]); print(where_pages_end()[False])"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode < 0 or int(ended.stdout.split()[-1]) > 0, ended.stderr


def test_what_a_long_calculation_drops_is_collected_meanwhile(qapp, qtbot) -> None:
    runner, seen, most = Runner(), [], 400_000
    gc.collect()
    before = Ring.alive()

    def work(_: object) -> int:
        for _ in range(most):
            Ring()
            if Ring.alive() - before > 100_000:
                time.sleep(0.01)  # a calculation does something else meanwhile
        return most

    assert runner.start("work", work, seen.append, seen.append)
    highest = 0
    while not seen:
        qtbot.wait(5)
        highest = max(highest, Ring.alive())
    assert seen == [most]
    assert highest - before < most / 2, "collected while it ran"
    gc.collect()
    assert Ring.alive() == before


@pytest.mark.parametrize(
    ("count", "busy", "generation"),
    [
        ((700, 99, 99), False, None),
        ((701, 0, 0), False, 0),
        ((701, 10, 99), False, 0),
        ((701, 11, 0), False, 1),
        ((701, 11, 11), False, 2),
        ((701, 11, 11), True, 1),
        ((701, 11, 1001), True, 2),
    ],
)
def test_which_generation_is_due(count: tuple[int, int, int], busy: bool, generation: int | None) -> None:
    assert due(count, USUAL, busy) == generation
