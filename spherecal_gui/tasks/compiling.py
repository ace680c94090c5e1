"""The kernels compiled in the background from the first start on, so that no calibration waits for them."""

import json
import sys
from contextlib import suppress

from PySide6.QtCore import QObject, QProcess, Signal, Slot

from spherecal_app.kernel_state import state
from spherecal_files.programs import own_program
from spherecal_gui.tasks.task import leave_behind

_PATIENCE_MS = 2000


class Compiling(QObject):
    """Runs `spherecal compile-kernels` when idle, where kernels are still to be compiled; ends with the program."""

    progressed = Signal(int)  # percent; 100 when it has ended, however it has

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._process = QProcess(self)
        self._process.setProcessChannelMode(QProcess.ProcessChannelMode.SeparateChannels)
        self._process.readyReadStandardOutput.connect(self._read)
        self._process.finished.connect(self._ended)
        self._process.errorOccurred.connect(self._ended)

    def start(self, idle: bool = True) -> bool:
        """Begin, unless there is nothing to do; whether it has begun. `idle`: only while nothing else runs."""
        if getattr(sys, "frozen", False) or state() != "to compile":
            return False
        when = ["--idle"] if idle else []
        program, *arguments = own_program("spherecal", "compile-kernels", *when, "--json", "--quiet")
        self._process.start(program, arguments)
        return True

    def stop(self) -> None:
        """End it; what is compiled so far is kept. Its processes yield to all others, and may take their time to go."""
        if self._process.state() == QProcess.ProcessState.NotRunning:
            return
        self._process.terminate()
        if self._process.waitForFinished(_PATIENCE_MS):
            return
        self._process.kill()  # its parts see that it is gone, and end
        if not self._process.waitForFinished(_PATIENCE_MS):
            self._process.setParent(None)  # else Qt waits for it
            leave_behind(lambda process=self._process: process.state() != QProcess.ProcessState.NotRunning)

    @Slot()
    def _read(self) -> None:
        for line in bytes(self._process.readAllStandardOutput().data()).decode("utf-8", "replace").splitlines():
            with suppress(ValueError, KeyError, TypeError):
                said = json.loads(line)
                self.progressed.emit(min(round(100 * said["done"] / max(said["all"], 1)), 99))

    @Slot()
    def _ended(self) -> None:
        self.progressed.emit(100)
