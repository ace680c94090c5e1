"""Calibrating and verifying, and the results; cancelled at any moment; what was taken stays."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.context import Context
from spherecal_gui import project as changes
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import translate
from spherecal_gui.project import Project
from spherecal_gui.project_folder import profile_of
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.outcome import Outcome, read_outcome
from spherecal_gui.tasks.task import BackgroundTask
from spherecal_gui.texts import verdict_word

if TYPE_CHECKING:  # results need scipy, for which the window does not wait
    from spherecal_gui.controllers.controller import Controller
    from spherecal_gui.presenters.calibrate_presenter import CourseOfWork


class ComputationController(ControllerPart):
    """The computations of the open project, and the result that is read after it was opened."""

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.course: CourseOfWork | None = None  # of the last calibration
        self._task: BackgroundTask | None = None  # whose course it is
        self.seen_bars = jobs.ObservedBars()
        self._reference_of: tuple[Path | None, str | None] = (None, None)  # the project that it was looked up for
        main.cameras.connected.connect(self._read_result)

    def close(self) -> None:
        """Forget what was computed; all is on disk already."""
        self.course = self._task = None
        self.seen_bars, self._reference_of = jobs.ObservedBars(), (None, None)

    def _read_result(self) -> None:
        """The result on disk, after a project was opened."""
        project = self.project
        if project is None or project.calibrated is None or self.main.outcome is not None or self.runner.running:
            return

        self.runner.start("results", self._reading(project), self._result_read, self.main.failed("results"))

    def _reading(self, project: Project) -> Callable[[Context], Outcome]:
        """Read the project's result, and compare it with the calibration in use."""
        profile, bars = profile_of(project), self.main.cameras.bars
        return lambda context: read_outcome(project.result_folder, project.folder, profile, bars, context)

    def _result_read(self, outcome: Outcome) -> None:
        self.main.outcome = outcome
        self.main.bars.take_over_plan()
        self.main.result_changed.emit()

    def calibrate(self) -> bool:
        """Start the calibration."""
        project = self.project
        if project is None or self.runner.running:
            return False
        read, reference = self._reading(project), self.kept_reference()

        def work(context: Context) -> tuple[changes.Verdict, Outcome]:
            return jobs.calibrate(project, context, reference), read(context)

        from spherecal_gui.presenters.calibrate_presenter import CourseOfWork  # needs numpy

        begun = self.main.cameras.start_alone("calibrate", work, self._calibrated)
        if begun:
            self.course, self._task = CourseOfWork(), self.runner.task
            self.main.changed.emit()
        return begun

    def follow(self) -> None:
        """Take over what the calibration has reported; after its end, too: its last news count."""
        if self.course is not None and self._task is not None:
            for one in self._task.take_news():
                self.course.add(one)

    def _calibrated(self, found: tuple[changes.Verdict, Outcome]) -> None:
        self.follow()
        verdict, self.main.outcome = found
        self.main.revise(changes.with_calibration, verdict)
        self.main.bars.take_over_plan()
        self.main.result_changed.emit()
        kind = {"valid": "good", "use with care": "info"}.get(verdict, "bad")
        text = translate("Calibrate", "The calibration is finished: {verdict}.").format(verdict=verdict_word(verdict))
        self.main.tell(kind, text)
        self._warn_of_frame()  # the last word, which the window keeps on the screen

    def kept_reference(self) -> str | None:
        """The camera whose frame was the world so far; it stays so, that coordinates of two days can be compared."""
        project = self.project
        if project is None:
            return None
        if project.folder != self._reference_of[0]:
            self._reference_of = (project.folder, jobs.kept_reference(profile_of(project), project.result_folder))
        return self._reference_of[1]

    def _warn_of_frame(self) -> None:
        """Say so where the world is another camera's frame than before."""
        wanted, result = self._reference_of[1], self.main.result
        if wanted is None or result is None or result.rig.reference_camera in (None, wanted):
            return
        text = translate("Calibrate", "The frame has changed: it was that of {before}, now it is that of {now}.")
        hint = translate("Calibrate", "{before} could not be placed. Coordinates of before do not fit these.")
        names = {"before": wanted, "now": result.rig.reference_camera}
        self.main.tell("info", text.format(**names), hint.format(**names))

    def stop_here(self) -> None:
        """Ask the calibration to end with what there is so far."""
        self.runner.stop_here()
        self.main.changed.emit()

    def repair(self, option: str, value: str) -> None:
        """Ask for a repair at the next calibration; no image on disk is touched by it."""
        self._with_repairs(changes.with_repair, option, value)

    def take_back(self, option: str, value: str) -> None:
        """No longer ask for a repair."""
        self._with_repairs(changes.without_repair, option, value)

    def _with_repairs(self, change: Callable[[Project, str, str], Project], option: str, value: str) -> None:
        if self.project is not None and self.runner.running is None:
            self.main.revise(change, option, value)
            self.main.result_changed.emit()

    def accept_results(self) -> None:
        """The results were looked at."""
        if self.project is not None:
            self.main.change(accepted=self.project.calibrated)

    def verify(self) -> bool:
        """Measure the check bars in the poses taken."""
        project = self.project
        if project is None:
            return False
        read = self._reading(project)

        def work(context: Context) -> tuple[changes.Verdict, Outcome]:
            verdict = jobs.verify(project, context, self.seen_bars)
            jobs.keep_if_in_use(profile_of(project), project.result_folder, verdict)
            return verdict, read(context)

        return self.main.cameras.start_alone("verify", work, self._verified)

    def _verified(self, found: tuple[changes.Verdict, Outcome]) -> None:
        verdict, self.main.outcome = found
        self.main.revise(changes.with_verification, verdict)
        self.main.result_changed.emit()
        text = translate("Verify", "The verification is finished: {verdict}.").format(verdict=verdict_word(verdict))
        said_by_page = (*changes.VERIFIED, "undecided", "no data")  # the page and the rail are amber
        self.main.tell("good" if verdict in said_by_page else "bad", text)
