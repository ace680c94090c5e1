"""The wizard's controller: projects are opened and closed here, all else is done by its parts. Knows no widgets."""

import threading
import time
from contextlib import ExitStack
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from PySide6.QtCore import QObject

from spherecal.base.errors import OutputError
from spherecal_files.lock import InUse, locked
from spherecal_gui import limits_in_force as limits
from spherecal_gui.controllers.advice_controller import AdviceController
from spherecal_gui.controllers.bar_controller import BarController, StagingController
from spherecal_gui.controllers.camera_controller import CameraController
from spherecal_gui.controllers.computation_controller import CheckController, ComputationController
from spherecal_gui.controllers.project_controller import ProjectController
from spherecal_gui.controllers.recording_controller import RecordingController, SetController
from spherecal_gui.controllers.saving_controller import FrameController, SavingController
from spherecal_gui.controllers.tuning_controller import TuningController
from spherecal_gui.languages import translate, word
from spherecal_gui.presenters.step_states import left_text
from spherecal_gui.project import Computation, Project
from spherecal_gui.project_folder import (
    FILE,
    discard,
    is_project,
    load_project,
    new_folder,
    profile_of,
    remove_if_empty,
    save_project,
)
from spherecal_gui.workflow import Running, WorkflowState, resolve


class Controller(ProjectController):
    """The open project, its workflow, and a part for each role of what can be done with it."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        # In the order in which they hear of a change; each uses only those above it when it is made.
        self.cameras = CameraController(self)
        self.tuning = TuningController(self)
        self.recording = RecordingController(self)
        self.sets = SetController(self)
        self.advice = AdviceController(self)
        self.bars = BarController(self)
        self.staging = StagingController(self)
        self.computation = ComputationController(self)
        self.checks = CheckController(self)
        self.user_frame = FrameController(self)
        self.saving = SavingController(self)
        self.keeps_empty = False  # a project that never had a camera, too: it is opened again at once
        self._is_new = False
        self._held = ExitStack()
        self._resolved: tuple[Project, Running, WorkflowState] | None = None

    @property
    def running(self) -> Running:
        """What goes on now: the work, the cameras that are open, those that are lost or were moved."""
        cameras = self.cameras
        lost, moved = cameras.lost(), cameras.moved()
        return Running(self.runner.running, cameras.connection is not None, lost, moved, self.gone)

    @property
    def state(self) -> WorkflowState | None:
        """The workflow's state; None without a project."""
        if self.project is None:
            return None
        running, known = self.running, self._resolved
        if known is None or known[0] is not self.project or known[1] != running:
            known = self._resolved = self.project, running, resolve(self.project, running)
        return known[2]

    def progress_text(self) -> str:
        """What runs, how far it is, how long it still takes: one text for header and page; empty where nothing runs."""
        task = self.runner.task
        if task is None:
            return ""
        course = self.computation.course if task.name == "calibrate" else None
        share = course.fraction if course is not None else 0.0
        left = left_text(time.perf_counter() - task.began_s, share, task.usual_s)
        percent = f"{100 * share:.0f} %" if course is not None else ""
        at = course.stage if course is not None else task.stage
        stage = word("stages", at, at) if at else ""
        return " · ".join(part for part in (percent, stage, left) if part)

    def go(self, step: str) -> None:
        """Go to a step, if it is not blocked."""
        state = self.state
        if state is None or self.project is None or step == self.project.step or not state.of(step).open:
            return
        self.move(replace(self.project, step=step))

    def new_project(self, source: str, parent: Path, bench: str = "") -> None:
        """Begin a calibration in a new folder."""
        self.close_project()
        limit = limits.now().verification_limit
        self._begin_new(Project(new_folder(parent, datetime.now()), source, bench, limit=limit))

    def new_check(self, like: Project) -> None:
        """Begin a check with the cameras and the bench of an earlier calibration."""
        self.close_project()
        folder = new_folder(like.folder.parent, datetime.now(), "check")
        self._begin_new(Project(folder, like.source, like.bench, placements=("P1",), purpose="check"))

    def _begin_new(self, project: Project) -> None:
        save_project(project)
        self._begin(project)
        self._is_new = True

    def new_verification(self, like: Project) -> None:
        """Begin a verification of the calibration in use, with the cameras and the bench of an earlier project."""
        from spherecal_gui.in_use import result_of  # needs scipy

        self.close_project()
        folder = new_folder(like.folder.parent, datetime.now(), "verification")
        limit = limits.now().verification_limit
        project = Project(folder, like.source, like.bench, placements=(), purpose="verify", limit=limit)
        try:
            number, verdict = result_of(profile_of(project), project.result_folder)
        except BaseException:
            if folder.is_dir():
                discard(folder)
            raise
        calibrated = Computation((("profile", number),), verdict)
        project = replace(project, calibrated=calibrated, accepted=calibrated)
        save_project(project)
        self._begin(project)

    def calibrate_like_this(self) -> None:
        """Begin a calibration with the cameras and the bench of the open check."""
        like = self.project
        if like is not None and self.runner.running is None:
            self.new_project(like.source, like.folder.parent, like.bench)

    def open_project(self, folder: Path) -> None:
        """Go on with a project where it was left."""
        self.close_project()
        if is_project(folder):
            self._hold(folder)
        try:
            self._begin(load_project(folder))
        except BaseException:
            self._held.close()
            raise

    def _hold(self, folder: Path) -> None:
        try:
            self._held.enter_context(locked(folder / FILE, wait_s=0.0))
        except InUse:
            raise
        except OutputError:  # a folder that may only be read can be looked at
            return

    def _begin(self, project: Project) -> None:
        self._hold(project.folder)
        self.project = project
        self.recording.load(project)
        self.checks.load(project)
        self.note(translate("Log", "project {folder}").format(folder=project.folder))
        self.changed.emit()
        self.cameras.connect_all()

    def close_project(self) -> None:
        """Let go of cameras and project; all is on disk already."""
        for part in (self.bars, self.advice, self.tuning):  # what they work out beside the window is stopped first
            part.close()
        self.runner.close()
        self.cameras.close()
        for thread in threading.enumerate():
            if thread.name == "step":  # it still writes at which step the project is
                thread.join()
        self._held.close()
        if self.project is not None and self._is_new and not self.keeps_empty:
            remove_if_empty(self.project)
        self._is_new = False
        self.project, self.outcome = None, None
        for part in (self.recording, self.computation, self.checks):
            part.close()
        self.changed.emit()

    def discard(self) -> None:
        """Leave the calibration in use as it is; this one stays in its folder."""
        if self.project is None or self.runner.running is not None:
            return
        message = translate("Save", "The calibration in use was not changed. This one stays in {folder}.")
        message = message.format(folder=self.project.folder)
        self.close_project()
        self.tell("info", message)
