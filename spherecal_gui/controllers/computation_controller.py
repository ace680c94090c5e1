"""Calibrating, verifying, checking and repairing; cancelled at any moment; what was taken stays."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.context import Context
from spherecal_gui import languages
from spherecal_gui import project as changes
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import translate, verdict_word
from spherecal_gui.project import Project
from spherecal_gui.project_folder import profile_of
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.outcome import Outcome, read_outcome
from spherecal_gui.tasks.task import BackgroundTask

if TYPE_CHECKING:  # results need scipy, for which the window does not wait
    from spherecal.data.session import Session
    from spherecal_gui.controllers.controller import Controller
    from spherecal_gui.presenters.calibrate_presenter import CourseOfWork
    from spherecal_rigs.check_rig import Check


class ComputationController(ControllerPart):
    """The computations of the open project, and the result that is read after it was opened."""

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.course: CourseOfWork | None = None  # of the last calibration
        self._task: BackgroundTask | None = None  # whose course it is
        self.seen_bars: Session | None = None  # that of the check bars, with what was found in its images
        self._reference_of: tuple[Path | None, str | None] = (None, None)  # the project that it was looked up for
        main.cameras.connected.connect(self._read_result)

    def close(self) -> None:
        """Forget what was computed; all is on disk already."""
        self.course = self._task = self.seen_bars = None
        self._reference_of = (None, None)

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
            verdict, self.seen_bars = jobs.verify(project, context, self.seen_bars)
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


class CheckController(ControllerPart):
    """The check of the open project: what it `found`, and what it finds `after` a repair."""

    found: "Check | None" = None
    after: "Check | None" = None  # the same check with the repaired rig

    def load(self, project: Project) -> None:
        """Take up the check that is kept with a project."""
        if project.checked is not None:
            from spherecal_gui.tasks.kept_check import read_kept_check  # needs scipy, OpenCV and the kernels: a second

            kept = read_kept_check(project.folder)
            self.found = kept if kept is not None and kept.verdict == project.checked.verdict else None

    def close(self) -> None:
        """Forget the check; it is on disk already."""
        self.found, self.after = None, None

    def check(self) -> bool:
        """Compare what was taken with the calibration in use."""
        project, profile = self.project, self.main.profile_folder
        if project is None or profile is None:
            return False
        return self.main.cameras.start_alone("check", partial(jobs.check, project, profile), self._checked)

    def _checked(self, found: "Check") -> None:
        self.found, self.after = found, None
        self.main.revise(changes.with_check, found.verdict)
        self.main.result_changed.emit()
        text = translate("Check", "The check is finished: {verdict}.").format(verdict=verdict_word(found.verdict))
        self.main.tell("good" if found.verdict == "ok" else "bad", text)

    def repair_cameras(self) -> bool:
        """Calibrate the cameras again that a check found moved, all others as they are."""
        project, profile, found = self.project, self.main.profile_folder, self.found
        if project is None or profile is None or found is None or not found.to_repair:
            return False
        work = partial(jobs.repair, project, profile, found.to_repair)
        return self.main.cameras.start_alone("check", work, self._repaired)

    def _repaired(self, done: "tuple[changes.Verdict, Check]") -> None:
        verdict, self.after = done
        self.main.revise(changes.with_repaired, verdict)
        self.main.result_changed.emit()
        text = translate("Check", "The repair is finished: {verdict}.").format(verdict=verdict_word(verdict))
        self.main.tell("good" if verdict == "valid" else "bad", text)

    def use_repair(self) -> bool:
        """Put the repaired calibration to use: into the profile, where the one before it stays."""
        project, profile = self.project, self.main.profile_folder
        if project is None or profile is None or project.repaired is None:
            return False

        def done(number: str) -> None:
            self.main.revise(changes.with_repair_in_use)
            text = translate("Check", "The repaired calibration is in use, as number {number}.")
            self.main.tell("good", text.format(number=number))

        repaired = languages.listed(self.found.to_repair if self.found is not None else ())
        note = translate("Check", "repaired after a check: {cameras}").format(cameras=repaired)
        work = partial(jobs.save_profile, project.repair_folder, project.folder, profile, True, note)
        return self.runner.start("check", work, done, self.main.failed("check"))
