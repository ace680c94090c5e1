"""What is written: the report, the rig's profile, exports; and the command lines that do the same."""

import shlex
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from spherecal.base.context import Context
from spherecal.base.errors import OutputError
from spherecal_files.filesystem import write_below
from spherecal_gui import languages
from spherecal_gui import project as changes
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import translate
from spherecal_gui.presenters.start_presenter import picture_name
from spherecal_gui.project import Project
from spherecal_gui.tasks import jobs


class SavingController(ControllerPart):
    """What is written of the open project."""

    draw_rig: Callable[[], bytes] | None = None  # a picture of the rig for its profile, where one is shown

    def _save(self, work: Callable[[Project, Context], Path | str], message: str) -> bool:
        project = self.project

        def done(what: Path | str) -> None:
            self.main.revise(changes.with_saved)
            self.main.tell("good", message.format(what=what))

        if project is None:
            return False
        self.main.update(changes.without_failure(project, "save"))
        return self.runner.start("save", lambda context: work(project, context), done, self.main.failed("save"))

    def write_report(self, output: Path) -> bool:
        """Write the report as a PDF; whether that was begun."""
        language, simulated = languages.now(), translate("Save", "SIMULATED: no calibration of a real rig")

        def work(project: Project, context: Context) -> Path:
            return jobs.report(project, output, language, simulated if project.simulated else "", context)

        return self._save(work, translate("Save", "The report is in {what}."))

    def set_note(self, note: str) -> None:
        """What the operator has written on the calibration; it goes into the profile and the report."""
        self.main.change(note=note)

    def save_profile(self, profile: Path, put_to_use: bool, note: str = "") -> bool:
        """Add the calibration to a rig profile's history; whether that was begun."""
        message = translate("Save", "Saved in the rig's profile as calibration {what}.")
        picture = self.draw_rig() if self.draw_rig is not None else b""

        def work(project: Project, context: Context) -> str:
            number = jobs.save_profile(project.result_folder, project.folder, profile, put_to_use, note, context)
            if picture:
                with suppress(OutputError):  # it only adorns the start page; the calibration is saved
                    write_below(profile, picture_name(number), picture)
            return number

        return self._save(work, message)

    def export(self, form: str, output: Path) -> bool:
        """Write the rig in another program's format, in the project's frame; whether that was begun."""
        frame = self.main.user_frame.frame

        def work(project: Project, context: Context) -> Path:
            return jobs.export(project.result_folder, form, output, context, frame)

        return self._save(work, translate("Save", "Written to {what}."))

    def commands(self) -> tuple[str, ...]:
        """The command lines that give the same bytes."""
        if self.project is None:
            return ()
        if self.project.purpose == "check":
            words = ["spherecal", "check", str(self.project.folder), "--profile", str(self.main.profile_folder)]
            if self.project.repaired is not None:
                words += ["--repair", str(self.project.repair_folder)]
            return (shlex.join([*words, "-o", str(self.project.folder / "check.json")]),)
        session, result = str(self.project.folder), str(self.project.result_folder)
        repairs = [word for repair in self.project.repairs_now for word in repair]
        kept = self.main.computation.kept_reference() if self.project.purpose == "calibrate" else None
        reference = ["--reference", kept] if kept is not None else []
        method = ["--method", "board"] if self.project.by_board else []
        lines = [["spherecal", "calibrate", session, "-o", result, *method, *repairs, *reference]]
        if self.project.purpose == "verify":
            lines = []
        if self.project.check_poses:
            checks = str(self.project.verification_folder)
            limit = ["--limit", self.project.limit] if self.project.limit else []
            lines.append(["spherecal", "verify", checks, "--rig", f"{result}/rig.json", "-o", result, *limit])
        if frame := self.main.user_frame.command():
            lines.append(list(frame))
        return tuple(shlex.join(line) for line in lines)
