"""What the window remembers: its place, its look, the sounds, how long work took the last times."""

import os
from collections.abc import Sequence
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


_KEPT = 5  # runs that are remembered of each kind of work


def pace_key(name: str) -> str:
    """What work is remembered under in the settings: all placements are alike."""
    return f"pace-{name.partition(':')[0]}"


def read_durations(text: str) -> tuple[float, ...]:
    """Durations as the settings keep them; nonsense counts as none."""
    try:
        found = tuple(float(part) for part in text.split())
    except ValueError:
        return ()
    return tuple(one for one in found if 0 < one < 1e5)[-_KEPT:]


def with_duration(text: str, seconds: float) -> str:
    """The newest durations with one more, as the settings keep them."""
    return " ".join(f"{one:.1f}" for one in (*read_durations(text), seconds)[-_KEPT:])


def expected_s(durations: Sequence[float]) -> float | None:
    """How long such work usually takes: the middle of the last times."""
    return sorted(durations)[len(durations) // 2] if durations else None
