"""What the window remembers: its place, its look, the sounds."""

import os
from pathlib import Path

from PySide6.QtCore import QSettings


def window_settings() -> QSettings:
    """A small file of the user's; SPHERECAL_SETTINGS names another one."""
    named = os.environ.get("SPHERECAL_SETTINGS")
    if named:
        return QSettings(named, QSettings.Format.IniFormat)
    return QSettings(QSettings.Format.IniFormat, QSettings.Scope.UserScope, "spherecal", "wizard")


def default_projects() -> Path:
    """Where projects are kept unless another folder is named."""
    named = os.environ.get("SPHERECAL_PROJECTS")
    return Path(named) if named else Path.home() / "SphereCal"
