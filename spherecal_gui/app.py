"""The program: one QApplication, our hooks, the wizard's window."""

import argparse
import json
import logging
import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from PySide6.QtCore import QObject, QProcess, Qt, QTimer, Signal, Slot
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QApplication, QMessageBox

import spherecal
from spherecal.base.resources import resource_path
from spherecal_app.kernel_state import state
from spherecal_files.programs import own_program
from spherecal_gui import click_map, languages
from spherecal_gui.tasks.task import Collector, leave_behind, something_left
from spherecal_gui.widgets.basic import plain
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.wizard.window_settings import window_settings

log = logging.getLogger("spherecal.gui")


def make_window(projects: Path | None = None) -> WizardWindow:
    """Build the window without showing it; a QApplication must exist."""
    sys.setswitchinterval(0.001)  # work in threads hands the interpreter back five times sooner than by default
    return WizardWindow(projects)


class Hooks(QObject):
    """Exceptions that nobody caught, from any thread, end in the log and in one dialog; the program goes on."""

    caught = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.save_bundle: Callable[[str], object] | None = None
        self.caught.connect(self._tell, Qt.ConnectionType.QueuedConnection)
        self._telling = False

    def install(self) -> None:
        """Take over from Python's own hooks, which only print."""
        sys.excepthook = self._main
        threading.excepthook = self._thread

    def _main(self, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        text = "".join(traceback.format_exception(kind, error, trace))
        log.error("uncaught: %s", text)
        print(text, file=sys.stderr)
        self.caught.emit(text)

    def _thread(self, args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None:
            self._main(args.exc_type, args.exc_value, args.exc_traceback)

    def _tell(self, text: str) -> None:
        if self._telling:
            return
        self._telling = True
        text_of_box = self.tr("Something went wrong inside the program. What was recorded is safe.")
        box = QMessageBox(QMessageBox.Icon.Critical, "SphereCal", text_of_box)
        box.setInformativeText(self.tr("You can go on. If it happens again, send these details to us."))
        box.setDetailedText(plain(f"SphereCal {spherecal.__version__}, Python {sys.version}\n\n{text}"))
        box.addButton(QMessageBox.StandardButton.Close)
        save = box.addButton(self.tr("Save a support bundle"), QMessageBox.ButtonRole.ActionRole)
        save.setVisible(self.save_bundle is not None)
        box.exec()
        if box.clickedButton() is save and self.save_bundle is not None:
            self.save_bundle(text)
        self._telling = False


def main(arguments: list[str] | None = None) -> int:
    """Show the window until it is closed; the exit code."""
    given = sys.argv if arguments is None else arguments
    parser = argparse.ArgumentParser(prog="spherecal", description="The wizard.")
    parser.add_argument("--source", metavar="NAME", help="begin at once: genicam, simulated[:RIG] or replay:SESSION")
    parser.add_argument("--open", type=Path, metavar="FOLDER", help="go on with a project")
    parser.add_argument("--bench", type=Path, metavar="FILE", help="targets, ball and bars: a session.json")
    parser.add_argument("--language", choices=tuple(languages.LANGUAGES), help="instead of the system's")
    parser.add_argument("--projects", type=Path, metavar="FOLDER", help="where projects are kept (default ~/SphereCal)")
    options, rest = parser.parse_known_args(given[1:])
    application = QApplication([given[0], *rest])
    application.setApplicationName("SphereCal")
    application.setWindowIcon(QIcon(str(resource_path("icons", "spherecal.svg"))))
    hooks = Hooks()
    hooks.install()
    collector = Collector(application)
    collector.start()
    program = Program(options.projects, options.language)
    hooks.save_bundle = program.save_bundle
    program.window.bench = str(options.bench.resolve()) if options.bench is not None else ""
    if named := os.environ.get("SPHERECAL_MAP"):
        click_map.ClickMap(Path(named), program)
    program.ending = Ending(program.close_window, application.quit, program)
    if options.open is not None:
        program.window.open_project(str(options.open))
    elif options.source is not None:
        program.window.new_project(options.source)
    program.compiling.start()
    code = application.exec()
    program.compiling.stop()
    end_children()
    collector.stop()
    if something_left():  # a library must not be unloaded under a thread that compiles; all is on disk
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


class Program(QObject):
    """The one window, made again in another language when somebody asks for it; the project goes on where it was."""

    def __init__(self, projects: Path | None = None, language: str | None = None) -> None:
        super().__init__()
        self._projects = projects
        self.ending: Ending | None = None
        self.compiling = Compiling(self)
        self.compiling.progressed.connect(self._show_compiling)
        self._percent = 100
        languages.use(language or str(window_settings().value("language", languages.preferred())))
        self.window = self._make()

    def _make(self) -> WizardWindow:
        window = make_window(self._projects)
        window.header.language_chosen.connect(self.speak, Qt.ConnectionType.QueuedConnection)
        window.show_compiling(self._percent)
        window.show()
        return window

    @Slot(int)
    def _show_compiling(self, percent: int) -> None:
        self._percent = percent
        self.window.show_compiling(percent)

    def close_window(self) -> bool:
        """Close the window of now; whether it has closed."""
        return self.window.close()

    def save_bundle(self, trouble: str) -> None:
        """A support bundle that tells of this trouble, by the window of now."""
        self.window.save_bundle(trouble)

    def speak(self, language: str) -> None:
        """Make the window again in this language; not while work runs."""
        old = self.window
        if language == languages.now() or not old.may_close():
            return
        project = old.controller.project
        old.settings.setValue("language", language)
        old.controller.keeps_empty = True
        if not old.close():
            return
        languages.use(language)
        self.window = self._make()
        old.deleteLater()
        if project is not None:
            self.window.open_project(str(project.folder))


_AGAIN_MS = 1000  # a computation may still be stopping: the window refuses to close until it has
_MOST_TIMES = 15


class Ending(QObject):
    """Closes the window when the system asks the program to end; `close` says whether it has closed."""

    def __init__(self, close: Callable[[], bool], quit_now: Callable[[], None], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._close, self._quit, self._times = close, quit_now, 0
        for number in (signal.SIGTERM, signal.SIGINT):  # Python hears them at the next tick of the collector's timer
            signal.signal(number, lambda *_: QTimer.singleShot(0, self._end))

    def _end(self) -> None:
        self._times += 1
        if self._close():
            self._quit()
        elif self._times < _MOST_TIMES:
            QTimer.singleShot(_AGAIN_MS, self._end)
        else:  # nothing is lost: all that was recorded is on disk
            end_children()
            os._exit(128 + signal.SIGTERM)


def end_children() -> None:
    """End the processes that this one has started, such as that of the cameras."""
    for child in multiprocessing.active_children():
        child.terminate()


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
