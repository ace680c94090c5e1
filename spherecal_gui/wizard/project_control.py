"""What the wizard knows: the open project, the running work; every change is on disk before it is shown."""

import logging
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QCoreApplication, QObject, Signal

from spherecal.base.errors import SpherecalError
from spherecal_gui import project as changes
from spherecal_gui.project import Project
from spherecal_gui.project_folder import profile_of, save_project
from spherecal_gui.tasks.outcome import Outcome
from spherecal_gui.tasks.task import Runner
from spherecal_gui.texts import error_text
from spherecal_gui.workflow import Running, WorkflowState, resolve

if TYPE_CHECKING:  # cameras, detection and results need scipy, for which the window does not wait
    from spherecal.report.result_folder import Result
    from spherecal.uses.check import Check
    from spherecal_gui.presenters.calibrate import CourseOfWork
    from spherecal_gui.tasks.kept_check import CheckSummary
    from spherecal_gui.tasks.live import Connection, LiveView

log = logging.getLogger("spherecal.gui")
translate = QCoreApplication.translate


class ProjectControl(QObject):
    """The open project and the one piece of work that runs; what all parts of the controller build on.

    `changed` when the workflow's state may be another, `said` (kind, what, what to do) when people should know.
    `logged` for the log pane, `taken` when a set was taken, `result_changed` when there is another result.
    """

    changed = Signal()
    said = Signal(str, str, str)
    logged = Signal(str)
    taken = Signal(str)
    result_changed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.runner = Runner(self)
        self.runner.started.connect(self._work_started)
        self.runner.ended.connect(self._work_ended)
        self.project: Project | None = None
        self.connection: Connection | None = None
        self.live: LiveView | None = None
        self.outcome: Outcome | None = None
        self.check_found: Check | CheckSummary | None = None
        self.course: CourseOfWork | None = None  # of the last calibration, for a window made anew
        self.check_after: Check | None = None  # the same check with the repaired rig
        self._resolved: tuple[Project, Running, WorkflowState] | None = None
        self.draw_rig: Callable[[], bytes] | None = None  # a picture of the rig for its profile, where one is shown

    @property
    def result(self) -> "Result | None":
        """The result that is shown; None where there is none."""
        return self.outcome.result if self.outcome is not None else None

    @property
    def profile_folder(self) -> Path | None:
        """The profile of the rig that the project calibrates, beside the projects."""
        return profile_of(self.project) if self.project is not None else None

    @property
    def running(self) -> Running:
        """What goes on now: the work, the cameras that are open, those that are lost or were moved."""
        return Running(self.runner.running, self.connection is not None, self.lost_cameras(), self.moved_cameras())

    def lost_cameras(self) -> tuple[str, ...]:
        """The names of cameras that send no images now."""
        if self.connection is None:
            return ()
        statuses = self.connection.source.statuses()
        return tuple(
            name
            for serial, name in self.connection.names.items()
            if serial in statuses and not statuses[serial].state.usable
        )

    def moved_cameras(self) -> tuple[str, ...]:
        """The names of cameras that were moved, and that nobody has seen to yet."""
        live = self.live
        if live is None or self.connection is None:
            return ()
        return tuple(self.connection.names[serial] for serial in live.watch.bumped)

    @property
    def state(self) -> WorkflowState | None:
        """The workflow's state; None without a project."""
        if self.project is None:
            return None
        running, known = self.running, self._resolved
        if known is None or known[0] is not self.project or known[1] != running:
            known = self._resolved = self.project, running, resolve(self.project, running)
        return known[2]

    def _update(self, project: Project) -> None:
        """Take over a changed project: on disk first. Where the disk refuses it is said, and the next change tries."""
        self._try(lambda: save_project(project))
        self.project = project
        self.changed.emit()

    def _try(self, act: Callable[[], object]) -> bool:
        """Do something that the disk may refuse; whether it was done. The window says what is in the way."""
        try:
            act()
        except (SpherecalError, OSError) as error:
            self.tell("bad", *error_text(error))
            return False
        return True

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
        """Say something that people should know.

        Parameters
        ----------
        kind
            `good`, `bad` or `info`.
        text
            What it is.
        hint
            What to do about it; empty for nothing.
        """
        self.note(f"{text} {hint}".strip())
        self.said.emit(kind, text, hint)

    def _failed(self, step: str) -> Callable[[BaseException], None]:
        def tell(error: BaseException) -> None:
            text, hint = error_text(error)
            log.error("%s", text, exc_info=error)
            if self.project is not None:
                self._update(changes.with_failure(self.project, step, f"{text} {hint}".strip()))
            self.tell("bad", text, hint)

        return tell

    def go(self, step: str) -> None:
        """Go to a step, if it is not blocked."""
        state = self.state
        if state is None or self.project is None or step == self.project.step or not state.of(step).open:
            return
        self._update(replace(self.project, step=step))
