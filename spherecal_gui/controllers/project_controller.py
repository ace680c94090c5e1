"""What all parts of the controller build on: the open project and its result, the running work, the messages."""

import logging
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec

from PySide6.QtCore import QObject, Signal

from spherecal.base.errors import SpherecalError
from spherecal_gui import project as changes
from spherecal_gui.languages import error_text, translate
from spherecal_gui.project import Project
from spherecal_gui.project_folder import is_project, profile_of, save_project
from spherecal_gui.tasks.outcome import Outcome
from spherecal_gui.tasks.task import Runner

if TYPE_CHECKING:  # results need scipy, for which the window does not wait
    from spherecal_gui.controllers.controller import Controller
    from spherecal_rigs.result_folder import Result

log = logging.getLogger("spherecal.gui")

P = ParamSpec("P")


class ProjectController(QObject):
    """The open project and the one piece of work that runs; every change is on disk before it is shown."""

    changed = Signal()  # the workflow's state may be another
    said = Signal(str, str, str)  # kind, what, what to do: people should know
    logged = Signal(str)  # a line for the log pane
    result_changed = Signal()  # there is another result

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.runner = Runner(self)
        self.runner.started.connect(self._work_started)
        self.runner.ended.connect(self._work_ended)
        self.project: Project | None = None
        self.outcome: Outcome | None = None
        self._disk = threading.Lock()  # one project is written after the other
        self.gone = False  # the folder of the open project was deleted or moved while it was open

    @property
    def result(self) -> "Result | None":
        """The result that is shown; None where there is none."""
        return self.outcome.result if self.outcome is not None else None

    @property
    def profile_folder(self) -> Path | None:
        """The profile of the rig that the project calibrates, beside the projects."""
        return profile_of(self.project) if self.project is not None else None

    def look_for_folder(self) -> None:
        """Whether the folder of the open project is still there: nothing is written where it is not."""
        gone = self.project is not None and not is_project(self.project.folder)
        if gone != self.gone:
            self.gone = gone
            self.changed.emit()

    def update(self, project: Project) -> None:
        """Take over a changed project: on disk first. Where the disk refuses it is said, and the next change tries."""
        self.look_for_folder()
        if not self.gone:
            with self._disk:
                self.attempt(lambda: save_project(project))
        self.project = project
        self.changed.emit()

    def revise(self, change: Callable[Concatenate[Project, P], Project], *values: P.args, **named: P.kwargs) -> None:
        """Take over the open project as a function of project.py changes it."""
        if self.project is not None:
            self.update(change(self.project, *values, **named))

    def change(self, **fields: Any) -> None:
        """Take over the open project with other values of these fields; nothing where they have them already."""
        if self.project is not None and (changed := replace(self.project, **fields)) != self.project:
            self.update(changed)

    def move(self, project: Project) -> None:
        """Take over a project at another step, written beside the window; what the disk refuses is told later."""

        def write() -> None:
            with self._disk, suppress(SpherecalError, OSError):
                if self.project is project and not self.gone:
                    save_project(project)

        self.look_for_folder()
        self.project = project
        threading.Thread(target=write, name="step").start()
        self.changed.emit()

    def attempt(self, act: Callable[[], object]) -> bool:
        """Do something that the disk may refuse; whether it was done. The window says what is in the way."""
        try:
            act()
        except (SpherecalError, OSError) as error:
            self.tell("bad", *error_text(error))
            return False
        return True

    def cancel(self) -> None:
        """Ask the running work to stop."""
        self.runner.cancel()
        self.changed.emit()

    def _work_started(self, name: str) -> None:
        self.note(translate("Log", "{step}: started").format(step=name))
        self.changed.emit()

    def _work_ended(self, name: str) -> None:
        self.note(translate("Log", "{step}: ended").format(step=name))
        self.changed.emit()

    def note(self, text: str) -> None:
        """A line for the log pane and the log file."""
        log.info("%s", text)
        self.logged.emit(f"{datetime.now():%H:%M:%S}  {text}")

    def tell(self, kind: str, text: str, hint: str = "") -> None:
        """Say something that people should know."""
        self.note(f"{text} {hint}".strip())
        self.said.emit(kind, text, hint)

    def failed(self, step: str) -> Callable[[BaseException], None]:
        """What to call with the error when work for this step fails: it is noted with the step, and said."""

        def tell(error: BaseException) -> None:
            text, hint = error_text(error)
            log.error("%s", text, exc_info=error)
            if self.project is not None:
                folder = f"{self.project.folder}{os.sep}"
                if damaged := next((name for name in self.project.sets if f"{os.sep}{name}{os.sep}" in text), ""):
                    text = text.replace(folder, "")
                    hint = translate("Errors", "Retake {name}: what is on disk is damaged.").format(name=damaged)
                self.update(changes.with_failure(self.project, step, f"{text} {hint}".strip()))
            self.tell("bad", text, hint)

        return tell


class ControllerPart(QObject):
    """A role of the controller; `main` has the open project, the running work, and the other parts."""

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.main = main

    @property
    def project(self) -> Project | None:
        """The open project."""
        return self.main.project

    @property
    def runner(self) -> Runner:
        """Runs the one piece of work that the steps wait for."""
        return self.main.runner
