"""The user's frame: the project's frame.json, made again with each calibration; else that of its rig's profile."""

from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.errors import InputError
from spherecal_files.filesystem import remove_below
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import translate
from spherecal_gui.project_folder import profile_of
from spherecal_gui.tasks.outcome import Outcome
from spherecal_gui.texts import error_text

if TYPE_CHECKING:  # rotations need scipy, for which the window does not wait
    from spherecal_gui.controllers.controller import Controller
    from spherecal_rigs.user_frame import FrameDefinition, UserFrame

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

    @property
    def file(self) -> Path | None:
        """Where the project keeps its frame."""
        return self.project.folder / _FILE if self.project is not None else None

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
        path = self.file
        if path is None or self.project is None or self.main.outcome is None or self.runner.running:
            return False
        from spherecal_rigs.framed_rig import frame_of, write_frame  # needs scipy
        from spherecal_rigs.user_frame import FrameDefinition

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
        words = ["spherecal", "frame", str(self.project.result_folder), "-o", str(self.file)]
        for option, name in zip(("--origin", "--x", "--xy"), definition.places, strict=False):
            words += [option, name]
        if any(definition.offset_mm):
            words += ["--offset", *(f"{value!r}" for value in definition.offset_mm)]
        if definition.turns:
            words += ["--turn", *definition.turns]
        return tuple(words)
