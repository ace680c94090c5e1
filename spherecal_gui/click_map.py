"""Where the buttons are on the screen, for a driver that clicks them with a real mouse: SPHERECAL_MAP=FILE.

Beside it, in times.json, what the walk took as the window itself counts it.
"""

import json
import os
import time
from pathlib import Path

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QCheckBox, QPushButton, QWidget

from spherecal.base.filesystem import write_whole

VARIABLE = "SPHERECAL_MAP"
_EVERY_MS, _BEAT_MS = 100, 20


class ClickMap(QObject):
    """Writes the visible buttons' places several times a second: key -> [x, y, enabled, text, has the focus].

    `enabled`: a press is heard now; on a button that has just changed its meaning it is not (footer.QUIET_S).
    """

    def __init__(self, path: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._path = path
        self.times = WalkTimes(path.with_name("times.json"), self)
        self._ticks = 0
        self._timer = QTimer(self, interval=_EVERY_MS)
        self._timer.timeout.connect(self.write)
        self._timer.start()

    def write(self) -> None:
        """Write it now, whole, with how often that was done."""
        self._ticks += 1
        found: dict[str, list] = {"": [self._ticks, 0, False, "", False]}  # a window that is busy does not count on
        for window in QApplication.topLevelWidgets():
            buttons: list[QWidget] = [*window.findChildren(QPushButton), *window.findChildren(QCheckBox)]
            for one in buttons:
                key = str(one.property("key") or one.objectName())
                if one.isVisible() and key:  # one without a key would stand where the count is
                    middle = one.mapToGlobal(one.rect().center())
                    heard = one.isEnabled() and not one.property("quiet")
                    text = one.text() if isinstance(one, (QPushButton, QCheckBox)) else ""
                    found[key] = [middle.x(), middle.y(), heard, text, one.hasFocus()]
        write_whole(self._path, json.dumps(found).encode())
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
    return bool(getattr(thumbnail, "has_image", False)) and not getattr(thumbnail, "past", False)


def wanted() -> Path | None:
    """The file that the environment asks for."""
    named = os.environ.get(VARIABLE)
    return Path(named) if named else None
