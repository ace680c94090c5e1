"""Sounds for accepted, rejected and done: tones that are made here and played by what the system has."""

import io
import os
import sys
import tempfile
import wave
from pathlib import Path

import numpy as np
from PySide6.QtCore import QProcess

from spherecal.base.filesystem import remove_below
from spherecal.base.working_folder import find_program

_RATE = 22_050
# Up: good. Down: not good. Three up: all done. Told apart without looking.
_TONES = {"good": (660, 990), "bad": (440, 294), "done": (523, 659, 784)}
_PLAYERS = (("paplay",), ("pw-play",), ("aplay", "-q"), ("afplay",))


def tone_bytes(kind: str) -> bytes:
    """The sound as a WAV file."""
    parts = []
    for pitch in _TONES[kind]:
        t = np.arange(int(0.14 * _RATE)) / _RATE
        fade = np.minimum(1.0, np.minimum(t, t[::-1]) / 0.012)
        parts.append(0.5 * fade * np.sin(2 * np.pi * pitch * t))
    samples = (np.concatenate(parts) * 32767).astype("<i2")
    data = io.BytesIO()
    with wave.open(data, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(_RATE)
        file.writeframes(samples.tobytes())
    return data.getvalue()


class Sounds:
    """Plays sounds unless muted; a machine that cannot stays silent."""

    def __init__(self) -> None:
        self.muted = False
        self._files: dict[str, Path] = {}
        found = ([find_program(name), *words] for name, *words in _PLAYERS)
        self._player = next(([name, *words] for name, *words in found if name), None)

    def play(self, kind: str) -> bool:
        """Play a sound; whether one was started."""
        if self.muted or kind not in _TONES or os.environ.get("QT_QPA_PLATFORM") == "offscreen":
            return False
        path = self._file(kind)
        if sys.platform == "win32":
            import winsound

            winsound.PlaySound(str(path), winsound.SND_FILENAME | winsound.SND_ASYNC)
            return True
        if self._player is None:
            return False
        started = QProcess.startDetached(self._player[0], [*self._player[1:], str(path)])
        return bool(started[0] if isinstance(started, tuple) else started)

    def _file(self, kind: str) -> Path:
        if kind not in self._files:
            with tempfile.NamedTemporaryFile(prefix=f"spherecal-{kind}-", suffix=".wav", delete=False) as file:
                file.write(tone_bytes(kind))
            self._files[kind] = Path(file.name)
        return self._files[kind]

    def close(self) -> None:
        """Remove the files."""
        for path in self._files.values():
            remove_below(path.parent, path.name)
        self._files = {}
