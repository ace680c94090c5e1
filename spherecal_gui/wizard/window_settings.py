"""What the window remembers: its place, its look, the sounds."""

import os
from pathlib import Path

from PySide6.QtCore import QByteArray, QSettings


class WindowSettings:
    """A small file of the user's; SPHERECAL_SETTINGS names another one."""

    def __init__(self) -> None:
        named = os.environ.get("SPHERECAL_SETTINGS")
        if named:
            self._kept = QSettings(named, QSettings.Format.IniFormat)
        else:
            self._kept = QSettings(QSettings.Format.IniFormat, QSettings.Scope.UserScope, "spherecal", "wizard")

    def flag(self, name: str, default: bool = False) -> bool:
        """A yes or no."""
        return str(self._kept.value(name, default)).lower() == "true"

    def set_flag(self, name: str, value: bool) -> None:
        """Remember a yes or no."""
        self._kept.setValue(name, value)

    def text(self, name: str, default: str = "") -> str:
        """A text."""
        return str(self._kept.value(name, default))

    def set_text(self, name: str, value: str) -> None:
        """Remember a text."""
        self._kept.setValue(name, value)

    @property
    def geometry(self) -> QByteArray | None:
        """Where the window was."""
        value = self._kept.value("geometry")
        return value if isinstance(value, QByteArray) else None

    @geometry.setter
    def geometry(self, value: QByteArray) -> None:
        self._kept.setValue("geometry", value)

    def sync(self) -> None:
        """Write it now."""
        self._kept.sync()


def default_projects() -> Path:
    """Where projects are kept unless another folder is named."""
    named = os.environ.get("SPHERECAL_PROJECTS")
    return Path(named) if named else Path.home() / "SphereCal"
