"""What the wizard does: each button ends here. Knows no widgets; the parts before this one add role upon role."""

import shlex
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QCoreApplication

from spherecal.base.context import Context
from spherecal.base.filesystem import write_below
from spherecal_gui import languages
from spherecal_gui import project as changes
from spherecal_gui.presenters.start import picture_name
from spherecal_gui.tasks import jobs
from spherecal_gui.wizard.frame_control import FrameControl

translate = QCoreApplication.translate


class Controller(FrameControl):
    """The open project and all that can be done with it; here: what is written."""

    def _save(self, work: Callable[[Context], Path | str], message: str) -> bool:
        def done(what: Path | str) -> None:
            if self.project is not None:
                self._update(changes.with_saved(self.project))
            self.tell("good", message.format(what=what))

        if self.project is None:
            return False
        self._update(changes.without_failure(self.project, "save"))
        return self.runner.start("save", work, done, self._failed("save"))

    def write_report(self, output: Path) -> bool:
        """Write the report as a PDF; whether that was begun."""
        project = self.project
        if project is None:
            return False
        message = translate("Save", "The report is in {what}.")
        language = languages.now()
        notice = translate("Save", "SIMULATED: no calibration of a real rig") if project.simulated else ""
        return self._save(lambda context: jobs.report(project, output, language, notice, context), message)

    def set_note(self, note: str) -> None:
        """What the operator has written on the calibration; it goes into the profile and the report."""
        if self.project is not None and note != self.project.note:
            self._update(changes.with_note(self.project, note))

    def discard(self) -> None:
        """Leave the calibration in use as it is; this one stays in its folder."""
        if self.project is None or self.runner.running is not None:
            return
        message = translate("Save", "The calibration in use was left as it is. This one stays in {folder}.")
        message = message.format(folder=self.project.folder)
        self.close_project()
        self.tell("info", message)

    def save_profile(self, profile: Path, put_to_use: bool, note: str = "") -> bool:
        """Add the calibration to a rig profile's history; whether that was begun.

        Parameters
        ----------
        profile
            Its folder.
        put_to_use
            Whether it becomes the calibration in use.
        note
            By whom and why.
        """
        project = self.project
        if project is None:
            return False
        message = translate("Save", "Saved in the rig's profile as calibration {what}.")
        picture = self.draw_rig() if self.draw_rig is not None else b""

        def work(context: Context) -> str:
            number = jobs.save_profile(project.result_folder, project.folder, profile, put_to_use, note, context)
            if picture:
                write_below(profile, picture_name(number), picture)
            return number

        return self._save(work, message)

    def export(self, form: str, output: Path) -> bool:
        """Write the rig in another program's format, in the project's frame; whether that was begun.

        Parameters
        ----------
        form
            The format's name, as `spherecal export --to` has it.
        output
            The file or folder to write.
        """
        project = self.project
        if project is None:
            return False
        message = translate("Save", "Written to {what}.")
        frame = self.frame
        return self._save(lambda context: jobs.export(project.result_folder, form, output, context, frame), message)

    def commands(self) -> tuple[str, ...]:
        """The command lines that give the same bytes."""
        if self.project is None:
            return ()
        if self.project.purpose == "check":
            words = ["spherecal", "check", str(self.project.folder), "--profile", str(self.profile_folder)]
            if self.project.repaired is not None:
                words += ["--repair", str(self.project.repair_folder)]
            return (shlex.join([*words, "-o", str(self.project.folder / "check.json")]),)
        session, result = str(self.project.folder), str(self.project.result_folder)
        repairs = [word for repair in self.project.repairs_now for word in repair]
        kept = self._kept_reference() if self.project.purpose == "calibrate" else None
        reference = ["--reference", kept] if kept is not None else []
        method = ["--method", "board"] if self.project.by_board else []
        lines = [["spherecal", "calibrate", session, "-o", result, *method, *repairs, *reference]]
        if self.project.purpose == "verify":
            lines = []
        if self.project.check_poses:
            checks = str(self.project.verification_folder)
            limit = ["--limit", self.project.limit] if self.project.limit else []
            lines.append(["spherecal", "verify", checks, "--rig", f"{result}/rig.json", "-o", result, *limit])
        if frame := self.frame_command():
            lines.append(list(frame))
        return tuple(shlex.join(line) for line in lines)
