"""The window with a clock: what a walk takes as the window itself counts it, in times.json beside SPHERECAL_MAP.

`python -m benchmarks.timed_window` in place of `python -m spherecal_gui`.
"""

import json
import sys
import time
from pathlib import Path

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QWidget

from spherecal_files.filesystem import write_whole
from spherecal_gui import click_map

_BEAT_MS = 20


class TimedMap(click_map.ClickMap):
    """The map of the buttons, with the times beside it."""

    def __init__(self, path: Path, parent: QObject | None = None) -> None:
        super().__init__(path, parent)
        self.times = WalkTimes(path.with_name("times.json"), self)

    def write(self) -> None:
        """Write both now."""
        super().write()
        self.times.write()


class WalkTimes(QObject):
    """Clicks, the seconds of each step, stalls of the window and pictures of its scenes, from the first click on."""

    def __init__(self, path: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._path, self._began_s, self._clicks = path, 0.0, 0
        self._stall_s = self._last_s = 0.0
        self._steps: dict[str, float] = {}
        self._first_s: float | None = None
        self._heard: set[int] = set()
        self._beat = QTimer(self, timerType=Qt.TimerType.PreciseTimer, interval=_BEAT_MS)
        self._beat.timeout.connect(self._tick)
        self._beat.start()

    def _tick(self) -> None:
        now = time.monotonic()
        if self._began_s and self._last_s:
            self._stall_s = max(self._stall_s, now - self._last_s - _BEAT_MS / 1e3)
        self._last_s = now

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Count the clicks that reach a window."""
        if event.type() == QEvent.Type.MouseButtonPress:
            self._clicks += 1
            self._began_s = self._began_s or time.monotonic()
        return False

    def write(self) -> None:
        """Write what there is so far."""
        for handle in QGuiApplication.topLevelWindows():
            if id(handle) not in self._heard:
                self._heard.add(id(handle))
                handle.installEventFilter(self)
        if not self._began_s:
            return
        now = time.monotonic() - self._began_s
        for window in QApplication.topLevelWidgets():
            project = getattr(getattr(window, "controller", None), "project", None)
            if project is not None:
                self._steps.setdefault(project.step, round(now, 2))
            scenes = window.findChildren(QWidget, "scene")  # in sight or not: the last page has none
            seen = [s for one in scenes if (s := getattr(one, "first_picture_s", None)) is not None]
            self._first_s = max([*seen, self._first_s or 0.0]) or None
        found = {"clicks": self._clicks, "seconds": round(now, 2), "entered, s": self._steps}
        found |= {"live pictures": len(shown := live_pictures()), "with dots": sum(map(bool, shown))}
        found |= {"longest stall, ms": round(1e3 * self._stall_s), "first picture of the scene, s": self._first_s}
        write_whole(self._path, json.dumps(found, indent=1).encode())


def live_pictures() -> list[int]:
    """The dots in each small live picture that is in sight and not of a camera that sends no more."""
    small = [one for window in QApplication.topLevelWidgets() for one in window.findChildren(QWidget, "thumbnail")]
    return [getattr(one, "dots", 0) for one in small if one.isVisible() and _is_live(one)]


def _is_live(thumbnail: QWidget) -> bool:
    return getattr(thumbnail, "image", None) is not None and not getattr(thumbnail, "past", False)


if __name__ == "__main__":
    from spherecal_gui.__main__ import main

    click_map.ClickMap = TimedMap
    sys.exit(main())
