"""Sounds for accepted, rejected and done: tones that are made here and played by what the system has."""

import io
import os
import sys
import tempfile
import wave
from pathlib import Path

import numpy as np
from PySide6.QtCore import QProcess

from spherecal_files.filesystem import remove_below
from spherecal_files.programs import find_program
from spherecal_gui import languages
from spherecal_gui.languages import translate

_RATE = 22_050
# Up: captured. Down: not good. Three up: all done. One: ready. Three times low: a camera is lost. Told apart by ear.
_TONES = {
    "good": (660, 990), "bad": (440, 294), "done": (523, 659, 784), "ready": (880,), "lost": (294, 220, 294, 220),
}  # fmt: skip
_TEST_MS = 5_000
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

    def test(self) -> str:
        """Play a sound and wait until it was played; why it cannot be, empty where it was. Nobody hears of a mute."""
        if sys.platform == "win32":
            self.play("done")
            return ""
        if self._player is None:
            text = translate("Sounds", "There is no program that plays sounds; one of these is needed: {names}.")
            return text.format(names=languages.listed(name for name, *_ in _PLAYERS))
        playing = QProcess()
        playing.start(self._player[0], [*self._player[1:], str(self._file("done"))])
        ended = playing.waitForFinished(_TEST_MS)
        if ended and playing.exitStatus() == QProcess.ExitStatus.NormalExit and playing.exitCode() == 0:
            return ""
        playing.kill()
        said = bytes(playing.readAllStandardError().data()).decode(errors="replace").strip().splitlines()
        text = translate("Sounds", "The sound device does not work: {why}. Choose one in the system's settings.")
        return text.format(why=said[-1].rstrip(".") if said else self._player[0])

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
