"""Where the buttons are on the screen, for a driver that clicks them with a real mouse: SPHERECAL_MAP=FILE."""

import json
from pathlib import Path

from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QApplication, QCheckBox, QPushButton, QWidget

from spherecal_files.filesystem import write_whole

_EVERY_MS = 100


class ClickMap(QObject):
    """Writes where the buttons are, ten times a second: key -> [x, y, a press is heard now, text, has the focus]."""

    def __init__(self, path: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._path = path
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
