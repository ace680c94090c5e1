"""What is written: the report, the rig's profile, exports and their frame; and the command lines that do the same."""

import shlex
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.context import Context
from spherecal.base.errors import InputError, OutputError
from spherecal_files.filesystem import remove_below, write_below
from spherecal_gui import languages
from spherecal_gui import project as changes
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import error_text, translate
from spherecal_gui.presenters.start_presenter import picture_name
from spherecal_gui.project import Project
from spherecal_gui.project_folder import profile_of
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.outcome import Outcome

if TYPE_CHECKING:
    from spherecal_gui.controllers.controller import Controller
    from spherecal_rigs.user_frame import FrameDefinition, UserFrame


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


_FILE = "frame.json"


class FrameController(ControllerPart):
    """In which frame the project's exports are given; `problem` says why its own cannot be had any more."""

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.frame: UserFrame | None = None
        self.definition: FrameDefinition | None = None
        self.problem = ""
        self._frame_of: tuple[Path, Outcome | None] | None = None  # for which result it was made
        main.changed.connect(self._renew_frame)
        main.result_changed.connect(self._renew_frame)

    def _renew_frame(self) -> None:
        """The project's frame with the result that is there now: its numbers are made from its definition again."""
        made_for = None if self.project is None else (self.project.folder, self.main.outcome)
        if made_for == self._frame_of:
            return
        self._frame_of, self.frame, self.definition, self.problem = made_for, None, None, ""
        if made_for is None:
            return
        if not (made_for[0] / _FILE).is_file():
            self.frame = self._frame_of_profile()
            return
        from spherecal_rigs.framed_rig import FRAME, frame_of, write_frame  # needs scipy

        path = made_for[0] / _FILE
        try:
            kept = FRAME.read(path)
            self.definition = kept.definition
            outcome, fresh = self.main.outcome, kept
            if outcome is not None:
                fresh = frame_of(kept.definition, outcome.places, outcome.result.rig)
        except InputError as error:
            why = translate("Frame", "The frame of this project cannot be made with this calibration: {why}")
            self.problem = why.format(why=error_text(error)[0])
            again = translate("Frame", "Choose origin and axes again.")
            bars = translate("Frame", "Verify again, or choose origin and axes again.")
            of_bars = self.definition is not None and any("/" in name for name in self.definition.places)
            self.main.tell("bad", self.problem, bars if of_bars else again)
            return
        turned, shifted = kept.rotation != fresh.rotation, kept.translation_mm != fresh.translation_mm
        about = (kept.input_sha256, kept.reference_camera) == (fresh.input_sha256, fresh.reference_camera)
        if turned.any() or shifted.any() or not about:
            self.main.attempt(lambda: write_frame(fresh, path))
        self.frame = fresh

    def _frame_of_profile(self) -> "UserFrame | None":
        """The frame kept with the rig; None where there is none, or where it is of another camera's world."""
        path = profile_of(self.project) / _FILE if self.project is not None else None
        if path is None or self.main.outcome is None or not path.is_file():
            return None
        from spherecal_rigs.framed_rig import FRAME  # needs scipy

        try:
            kept = FRAME.read(path)
        except InputError as error:
            self.main.note(error_text(error)[0])
            return None
        return kept if kept.reference_camera == self.main.outcome.result.rig.reference_camera else None

    def choose(self, definition: "FrameDefinition") -> bool:
        """Give exports in this frame from now on; the reference camera's own needs no file, unless the rig has one."""
        if self.project is None or self.main.outcome is None or self.runner.running:
            return False
        from spherecal_rigs.framed_rig import frame_of, write_frame  # needs scipy
        from spherecal_rigs.user_frame import FrameDefinition

        path = self.project.folder / _FILE
        if definition == FrameDefinition() and not (profile_of(self.project) / _FILE).is_file():
            done = self.main.attempt(lambda: remove_below(path.parent, path.name))
        else:
            places, rig = self.main.outcome.places, self.main.outcome.result.rig
            done = self.main.attempt(lambda: write_frame(frame_of(definition, places, rig), path))
        self._frame_of = None
        self.main.changed.emit()
        return done

    def command(self) -> tuple[str, ...]:
        """The words of the command line that makes the same frame.json; none where there is no frame."""
        if self.frame is None or self.project is None or self.definition is None:
            return ()
        definition = self.frame.definition
        words = ["spherecal", "frame", str(self.project.result_folder), "-o", str(self.project.folder / _FILE)]
        for option, name in zip(("--origin", "--x", "--xy"), definition.places, strict=False):
            words += [option, name]
        if any(definition.offset_mm):
            words += ["--offset", *(f"{value!r}" for value in definition.offset_mm)]
        if definition.turns:
            words += ["--turn", *definition.turns]
        return tuple(words)
