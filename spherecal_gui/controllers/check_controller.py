"""Checking the calibration in use, and repairing it."""

from typing import TYPE_CHECKING

from spherecal.base.context import Context
from spherecal_gui import languages
from spherecal_gui import project as changes
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import translate
from spherecal_gui.project import Project
from spherecal_gui.tasks import jobs
from spherecal_gui.texts import verdict_word

if TYPE_CHECKING:  # checks need scipy, for which the window does not wait
    from spherecal_gui.tasks.kept_check import CheckSummary
    from spherecal_rigs.check_rig import Check


class CheckController(ControllerPart):
    """The check of the open project: what it `found`, and what it finds `after` a repair."""

    found: "Check | CheckSummary | None" = None
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

        def work(context: Context) -> "Check":
            return jobs.check(project, profile, context)

        return self.main.cameras.start_alone("check", work, self._checked)

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

        def work(context: Context) -> "tuple[changes.Verdict, Check]":
            return jobs.repair(project, profile, found.to_repair, context)

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

        def work(context: Context) -> str:
            return jobs.save_profile(project.repair_folder, project.folder, profile, True, note, context)

        return self.runner.start("check", work, done, self.main.failed("check"))
