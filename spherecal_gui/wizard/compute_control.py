"""Calibrating and verifying, cancelled at any moment; what was taken stays."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from PySide6.QtCore import QCoreApplication, QObject

from spherecal.base.context import Context
from spherecal_gui import project as changes
from spherecal_gui.project_folder import profile_of
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.outcome import Outcome
from spherecal_gui.texts import verdict_word
from spherecal_gui.wizard.bar_control import BarControl

if TYPE_CHECKING:  # checks need scipy, for which the window does not wait
    from spherecal.uses.check import Check

translate = QCoreApplication.translate

_Found = TypeVar("_Found")  # what a piece of work gives


class ComputeControl(BarControl):
    """The computations of the open project."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._seen_bars = jobs.ObservedBars()
        self._reference_of: tuple[Path | None, str | None] = (None, None)  # the project that it was looked up for

    def close_project(self) -> None:
        """Let go of cameras and project; all is on disk already."""
        self._seen_bars, self._reference_of = jobs.ObservedBars(), (None, None)
        super().close_project()

    def calibrate(self) -> bool:
        """Start the calibration."""
        project = self.project
        if project is None or self.runner.running:
            return False
        self._update(changes.without_failure(project, "calibrate"))
        read = self._reading(project)
        reference = self._kept_reference()

        def work(context: Context) -> tuple[changes.Verdict, Outcome]:
            repairs = project.repairs_now
            verdict = jobs.calibrate(project.folder, project.result_folder, repairs, context, reference)
            return verdict, read(context)

        return self.runner.start(
            "calibrate", self._alone(work), self._calibrated, self._computing_failed("calibrate"), self._cancelled
        )

    def _calibrated(self, found: tuple[changes.Verdict, Outcome]) -> None:
        self._resume_live()
        verdict, self.outcome = found
        if self.project is not None:
            self._update(changes.with_calibration(self.project, verdict))
        self._take_over_plan()
        self.result_changed.emit()
        kind = {"valid": "good", "use with care": "info"}.get(verdict, "bad")
        text = translate("Calibrate", "The calibration is finished: {verdict}.").format(verdict=verdict_word(verdict))
        self.tell(kind, text)
        self._warn_of_frame()  # the last word, which the window keeps on the screen

    def _kept_reference(self) -> str | None:
        """The camera whose frame was the world so far; it stays so, that coordinates of two days can be compared."""
        project = self.project
        if project is None:
            return None
        if project.folder != self._reference_of[0]:
            self._reference_of = (project.folder, jobs.kept_reference(profile_of(project), project.result_folder))
        return self._reference_of[1]

    def _warn_of_frame(self) -> None:
        """Say so where the world is another camera's frame than before."""
        wanted, result = self._reference_of[1], self.result
        if wanted is None or result is None or result.rig.reference_camera in (None, wanted):
            return
        text = translate("Calibrate", "The frame has changed: it was that of {before}, now it is that of {now}.")
        hint = translate("Calibrate", "{before} could not be placed. Coordinates of before do not fit these.")
        names = {"before": wanted, "now": result.rig.reference_camera}
        self.tell("info", text.format(**names), hint.format(**names))

    def _computing_failed(self, step: str) -> Callable[[BaseException], None]:
        tell = self._failed(step)

        def resume(error: BaseException) -> None:
            self._resume_live()
            tell(error)

        return resume

    def _cancelled(self) -> None:
        self._resume_live()
        self.tell("info", translate("Calibrate", "Cancelled. What was captured is kept."))

    def cancel(self) -> None:
        """Ask the running work to stop."""
        self.runner.cancel()
        self.changed.emit()

    def stop_here(self) -> None:
        """Ask the calibration to end with what there is so far."""
        self.runner.stop_here()
        self.changed.emit()

    def _alone(self, work: Callable[[Context], _Found]) -> Callable[[Context], _Found]:
        """The work without live images: it needs their cores. They are ended beside the window, which never waits."""
        live = self.live

        def run(context: Context) -> _Found:
            if live is not None:
                live.stop()
            return work(context)

        return run

    def _resume_live(self) -> None:
        if self.live is not None:
            self.live.start(self.live_hz)

    def check(self) -> bool:
        """Compare what was taken with the calibration in use."""
        project, profile = self.project, self.profile_folder
        if project is None or profile is None or self.runner.running:
            return False
        self._update(changes.without_failure(project, "check"))
        work = self._alone(lambda context: jobs.check(project.folder, profile, project.folder / "check.json", context))
        return self.runner.start("check", work, self._checked, self._computing_failed("check"), self._cancelled)

    def _checked(self, found: "Check") -> None:
        self._resume_live()
        self.check_found, self.check_after = found, None
        if self.project is not None:
            self._update(changes.with_check(self.project, found.verdict))
        self.result_changed.emit()
        text = translate("Check", "The check is finished: {verdict}.").format(verdict=verdict_word(found.verdict))
        self.tell("good" if found.verdict == "ok" else "bad", text)

    def repair_cameras(self) -> bool:
        """Calibrate the cameras anew that a check found moved, all others as they are."""
        project, profile, found = self.project, self.profile_folder, self.check_found
        if project is None or profile is None or found is None or not found.to_repair or self.runner.running:
            return False
        self._update(changes.without_failure(project, "check"))
        work = self._alone(
            lambda context: jobs.repair(project.folder, profile, found.to_repair, project.repair_folder, context)
        )
        return self.runner.start("check", work, self._repaired, self._computing_failed("check"), self._cancelled)

    def _repaired(self, done: "tuple[changes.Verdict, Check]") -> None:
        self._resume_live()
        verdict, self.check_after = done
        if self.project is not None:
            self._update(changes.with_repaired(self.project, verdict))
        self.result_changed.emit()
        text = translate("Check", "The repair is finished: {verdict}.").format(verdict=verdict_word(verdict))
        self.tell("good" if verdict == "valid" else "bad", text)

    def use_repair(self) -> bool:
        """Put the repaired calibration to use: into the profile, where the one before it stays."""
        project, profile = self.project, self.profile_folder
        if project is None or profile is None or project.repaired is None:
            return False

        def done(number: str) -> None:
            if self.project is not None:
                self._update(changes.with_repair_in_use(self.project))
            text = translate("Check", "The repaired calibration is in use, as number {number}.")
            self.tell("good", text.format(number=number))

        note = translate("Check", "repaired after a check: {cameras}").format(cameras=", ".join(self.repaired_names))

        def work(context: Context) -> str:
            return jobs.save_profile(project.repair_folder, project.folder, profile, True, note, context)

        return self.runner.start("check", work, done, self._failed("check"))

    @property
    def repaired_names(self) -> tuple[str, ...]:
        """The cameras that the check found moved."""
        return tuple(self.check_found.to_repair) if self.check_found is not None else ()

    def repair(self, option: str, value: str) -> None:
        """Ask for a repair at the next calibration; no image on disk is touched by it.

        Parameters
        ----------
        option
            Of the command line: `--leave-out`, `--split` or `--swap`.
        value
            What it is asked for, such as C05@P3.
        """
        if self.project is not None and self.runner.running is None:
            self._update(changes.with_repair(self.project, option, value))
            self.result_changed.emit()

    def take_back(self, option: str, value: str) -> None:
        """No longer ask for a repair.

        Parameters
        ----------
        option, value
            As for `repair`.
        """
        if self.project is not None and self.runner.running is None:
            self._update(changes.without_repair(self.project, option, value))
            self.result_changed.emit()

    def image_path(self, set_id: str, camera: str) -> Path | None:
        """The image that a camera took of a set; None where it took none.

        Parameters
        ----------
        set_id
            A placement or a pose of a bar.
        camera
            Its name.
        """
        folder = self._folder_of(set_id)
        return folder.images(set_id).get(camera) if folder is not None else None

    def accept_results(self) -> None:
        """The results were looked at."""
        if self.project is not None:
            self._update(changes.with_accepted(self.project))

    def verify(self) -> bool:
        """Measure the check bars in the poses taken."""
        project = self.project
        if project is None or self.runner.running:
            return False
        self._update(changes.without_failure(project, "verify"))
        read = self._reading(project)

        def work(context: Context) -> tuple[changes.Verdict, Outcome]:
            verdict = jobs.verify(
                project.verification_folder, project.result_folder, project.limit, context, self._seen_bars
            )
            jobs.keep_if_in_use(profile_of(project), project.result_folder, verdict)
            return verdict, read(context)

        return self.runner.start(
            "verify", self._alone(work), self._verified, self._computing_failed("verify"), self._cancelled
        )

    def _verified(self, found: tuple[changes.Verdict, Outcome]) -> None:
        self._resume_live()
        verdict, self.outcome = found
        if self.project is not None:
            self._update(changes.with_verification(self.project, verdict))
        self.result_changed.emit()
        text = translate("Verify", "The verification is finished: {verdict}.").format(verdict=verdict_word(verdict))
        open_ones = ("undecided", "no data")  # no alarm: the page and the rail are amber
        self.tell("good" if verdict in changes.VERIFIED else "info" if verdict in open_ones else "bad", text)
