"""Save and report: where the result is, the report, the rig's profile, exports, the command lines."""

from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import (
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QLineEdit,
    QPlainTextEdit,
    QProgressBar,
    QVBoxLayout,
    QWidget,
)

from spherecal_documents.export.write_export import FORMATS
from spherecal_gui import limits_in_force as limits
from spherecal_gui import theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.frame_dialog import FrameDialog
from spherecal_gui.pages.wizard_page import Page
from spherecal_gui.presenters.frame_presenter import FrameChoice, frame_words
from spherecal_gui.presenters.start_presenter import in_use
from spherecal_gui.presenters.step_states import SaveFacts, save_says
from spherecal_gui.project import VERIFIED
from spherecal_gui.project_folder import profile_of
from spherecal_gui.rig_scenes import outcome_scene
from spherecal_gui.standing import Said
from spherecal_gui.widgets.basic import (
    Card,
    add,
    bare,
    button,
    details_button,
    enable,
    label,
    named,
    open_file,
    option,
    say,
)
from spherecal_gui.widgets.scene_view import SceneView
from spherecal_gui.workflow import Status, Step


class SavePage(Page):
    """What is done with the result."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        to_calibrate = partial(controller.go, "calibrate")
        self.deeds = {"save": self._save_profile, "report": self._write_report, "results": to_calibrate}
        self.headline = self.word = label("", "huge")
        self.progress = QProgressBar(minimum=0, maximum=0, textVisible=False)
        self.progress_words, self.end = label("", "big"), label("", "")
        self._opens = False  # the report, once it is written
        self._opened: bool | None = None
        self._for_the_desk = self._commands()
        self.scene = SceneView()
        self.scene.setMinimumHeight(0)
        self._drawn: object = None
        self._room = QWidget()  # in its place, where there is nothing to show
        column = add(QVBoxLayout(self), self.word, self.progress, self.progress_words, self.end)
        add(column, self._profile(), self._files(), self._for_the_desk, (self.scene, 1), (self._room, 1))
        self._compared: tuple[object, bool] = (None, False)
        self.dialog: FrameDialog | None = None

    def _profile(self) -> QWidget:
        card = Card(self.tr("The rig's profile"))
        self.keeps = label("", "soft")
        self.apply = option(self.tr("Put it to use now"))
        self.apply.setChecked(True)
        self.profile = button(self.tr("Save in the profile"), "save-profile", act=self._save_profile)
        says = self.tr("Note: by whom, and why")
        self.note = named(QLineEdit(placeholderText=says), "note", says)
        self.note.textChanged.connect(self._enable)
        self.note.editingFinished.connect(self._keep_note)
        self.apply.toggled.connect(self._enable)
        tip = self.tr("The calibration in use stays as it is; this one stays in its folder, and nothing is deleted.")
        self.discard = button(self.tr("Discard"), "discard", act=self.controller.discard, tip=tip)
        self.why_not = label("", "", level="caution")
        row = add(QHBoxLayout(), self.profile, self.apply, (self.note, 1), self.discard)
        add(card.body, self.keeps, row, self.why_not)
        return card

    @property
    def is_kept(self) -> bool:
        """Whether the profile holds this very calibration."""
        rig, history = self.open_project.result_folder / "rig.json", self.profile_path / "history"
        if not rig.is_file() or not history.is_dir():
            return False
        entries = sorted(history.glob("*/rig.json"))
        key = (rig, rig.stat().st_mtime_ns, tuple(entries))
        if key != self._compared[0]:  # the page is drawn again more often than anything is saved
            whole = rig.read_bytes()
            self._compared = (key, any(one.read_bytes() == whole for one in entries))
        return self._compared[1]

    def _why_not_saved(self) -> str:
        """What is in the way of saving in the profile, and of putting it to use if asked; empty where nothing is."""
        invalid = self.tr("The calibration is not valid: it cannot be put to use. Save it without.")
        refused = self.tr("Its verification failed: it cannot be put to use. Find the cause, or save it without.")
        forbidden = self.tr("It was not verified, and the limits forbid its use: verify it, or save it without.")
        failed = self.tr("Its verification failed: write in the note why it is put to use all the same.")
        undecided = self.tr("Its verification decided nothing: write in the note why it is put to use.")
        careful = self.tr("It is to be used with care: write in the note why it is put to use.")
        rows = (
            (self._is_stale, self.tr("The calibration is out of date.")),
            (not self.apply.isChecked(), ""),
            (self._calibration == "not valid", invalid),
            (self._refused, refused),
            (self._doubtful and not limits.now().unverified_use, forbidden),
            (bool(self.note.text().strip()), ""),
            (self._failed, failed),
            (self._doubtful and self.open_project.verified is not None, undecided),
            (self._doubtful, self.tr("It was not verified: write in the note why it is put to use.")),
            (self._calibration == "use with care", careful),
        )
        return next((text for applies, text in rows if applies), "")

    @property
    def _is_stale(self) -> bool:
        state = self.state
        reason = state.reason if state is not None and state.status is Status.STALE else None
        return reason is not None and reason.code == "calibration stale"

    @property
    def _doubtful(self) -> bool:
        """Whether it is not known to be good: that it is put to use all the same needs a reason."""
        project = self.open_project
        return not self._failed and (project.verified is None or project.verified.verdict not in VERIFIED)

    @property
    def _failed(self) -> bool:
        """Whether its verification failed: that is never the same as a missing one."""
        verified = self.open_project.verified
        return verified is not None and verified.verdict == "inconsistent"

    @property
    def _refused(self) -> bool:
        """Whether it failed and nobody answers for its use (`spherecal override`)."""
        result = self.controller.result
        return self._failed and (result is None or result.bars is None or result.bars.override is None)

    @property
    def _calibration(self) -> str:
        return self.open_project.calibrated.verdict if self.open_project.calibrated is not None else "not valid"

    def _enable(self) -> None:
        if self.project is None:
            return
        idle, why = self.controller.runner.running is None, self._why_not_saved()
        busy = self.tr("Work is running.")
        enable(self.profile, idle and not why, why or busy)
        action = self.action()
        saves = self.state is not None and (self.state.status is Status.STALE or not self.is_kept)
        self.apply.setVisible(saves)
        self.profile.setVisible(saves and (action is None or action.does != "save"))  # else the large button does it
        stale = self.tr("The calibration is out of date.") if self._is_stale else ""
        problem = self.controller.user_frame.problem
        if self._refused:
            problem = problem or self.tr("Its verification failed: it cannot be exported.")
        enable(self.export, idle and not stale and not problem, stale or problem if idle else busy)
        shown = idle and not stale and self.controller.outcome is not None
        enable(self.axes, shown, stale or self.tr("There is no calibration yet.") if idle else busy)
        result, frame = self.controller.result, self.controller.user_frame.frame
        given = frame_words(frame.definition if frame else None, result.rig.reference_camera if result else None)
        words = self.controller.user_frame.problem or self.tr("Exports are given in: {frame}.").format(frame=given)
        say(self.given_in, words, "bad" if self.controller.user_frame.problem else "none")
        self.discard.setEnabled(idle)
        self.discard.setVisible(not self.is_kept)
        say(self.why_not, why if idle and not self.is_kept else "", "caution")
        self.action_changed.emit()

    def _files(self) -> QWidget:
        card = Card(self.tr("Files"))
        self.folder, self.given_in = label("", "soft"), label("")
        self.open = button(self.tr("Open the folder"), "open-folder")
        self.open.clicked.connect(lambda: open_file(self.open_project.result_folder))
        self.report = button(self.tr("Open the report"), "open-report", act=self._open_report)
        self.form = named(QComboBox(), "", self.tr("Format of the export"))
        self.form.addItems(sorted(FORMATS))
        self.export = button(self.tr("Export"), "export", act=self._export)
        self.axes = button(self.tr("Origin and axes"), "origin-and-axes", act=self._choose_axes)
        other = label(self.tr("For another program:"), wrap=False)
        row = add(QHBoxLayout(), self.open, self.report, None, other, self.form, self.export)
        add(card.body, self.folder, row, add(QHBoxLayout(), (self.given_in, 1), self.axes))
        return card

    def _commands(self) -> QWidget:
        title, left = self.tr("The same on the command line"), Qt.AlignmentFlag.AlignLeft
        self.commands = named(QPlainTextEdit(readOnly=True), "", title)
        self.commands.setMaximumHeight(66)
        copy = button(self.tr("Copy as command"), "copy-command", act=self._copy)
        inner, whole = QWidget(), QWidget()
        add(bare(QVBoxLayout(inner)), label(title, "soft"), self.commands, (copy, left))
        add(bare(QVBoxLayout(whole)), (details_button(inner), left), inner)
        return whole

    @property
    def report_path(self) -> Path:
        """Where the report goes: beside the result, which stays as the command line writes it."""
        return self.open_project.folder / "report.pdf"

    @property
    def profile_path(self) -> Path:
        """The rig's profile: beside the projects, one for each place where projects are kept."""
        return profile_of(self.open_project)

    def enter(self, step: Step) -> None:
        """Nothing was opened yet."""
        self._opens, self._opened = False, None
        self.note.setText(self.open_project.note)
        super().enter(step)

    def show_project(self) -> None:
        """Show what there is."""
        self.keeps.setText(
            self.tr("A simulated rig has a profile of its own: it never counts as the calibration of a real one.")
            if self.open_project.simulated
            else self.tr("Keeps every calibration of this rig; the one in use changes only when you say so.")
        )
        self._for_the_desk.setVisible(not theme.is_far())
        self._show_rig()
        self.tick()
        if self._opens and self.controller.runner.running is None:
            self._opens = False
            if self.report_path.is_file() and "save" not in self.open_project.failures:
                self._open_report()
        self._show_end()
        self.folder.setText(str(self.open_project.result_folder))
        commands = "\n".join(self.controller.saving.commands())
        if commands != self.commands.toPlainText():
            self.commands.setPlainText(commands)
        self._enable()
        enable(self.report, self.report_path.is_file(), self.tr("It is not written yet."))

    def _show_rig(self) -> None:
        outcome = self.controller.outcome
        if outcome is not self._drawn:
            self._drawn = outcome
            self.scene.show_scene(outcome_scene(outcome) if outcome is not None else None)
        shown = outcome is not None and not theme.is_far()  # large text needs its room
        self.scene.setVisible(shown)
        self._room.setVisible(not shown)

    def _keep_note(self) -> None:
        """What the operator has written goes into the profile and the report."""
        self.controller.change(note=self.note.text().strip())

    def _save_profile(self) -> None:
        self._keep_note()
        self.controller.saving.save_profile(self.profile_path, self.apply.isChecked(), self.open_project.note)

    def _export(self) -> None:
        name = self.form.currentText()
        named = f"SIMULATED-rig-{name}" if self.open_project.simulated else f"rig-{name}"
        path, _ = QFileDialog.getSaveFileName(self, self.tr("Export"), str(self.open_project.folder / named))
        if path:
            self.controller.saving.export(name, Path(path))

    def _choose_axes(self) -> None:
        outcome = self.controller.outcome
        if outcome is None:
            return
        choice = FrameChoice(outcome.result, outcome.places, self.controller.user_frame.definition)
        if self.dialog is not None:  # not deleted on close: PySide crashes where its page goes at that very moment
            self.dialog.deleteLater()
        self.dialog = FrameDialog(choice, self)
        self.dialog.accepted.connect(lambda: self.controller.user_frame.choose(choice.definition))
        self.dialog.open()

    def _open_report(self) -> None:
        self._opened = open_file(self.report_path)
        self._show_end()

    def _show_end(self) -> None:
        """What was saved where, and when the next check is due: a run that is finished says so."""
        lines = []
        found = in_use(self.profile_path) if self.is_kept else None
        if found is not None:
            text = self.tr("In use: calibration {number}, in {folder}.")
            lines += [text.format(number=found.number, folder=self.profile_path), found.next_check]
        if self.report_path.is_file():
            lines.append(self.tr("Report: {path}").format(path=self.report_path))
        if self._opened is False:
            lines.append(self.tr("No program was found here that opens it: copy the file, or open it elsewhere."))
        say(self.end, "\n".join(line for line in lines if line))
        self.folder.setVisible(not lines)

    def _copy(self) -> None:
        QGuiApplication.clipboard().setText("\n".join(self.controller.saving.commands()))
        self.controller.tell("info", self.tr("Copied."))

    def says(self) -> Said:
        """Save what is not in the profile yet; then the report."""
        task, doubtful = self.controller.runner.task, self._doubtful
        good = self._calibration, not doubtful, self._failed, self.is_kept, self._is_stale
        asked = self.apply.isChecked(), self._why_not_saved(), self.report_path.is_file()
        work = ("", False) if task is None else (task.name, task.stopping)
        undecided = doubtful and self.open_project.verified is not None
        left = self.controller.progress_text()
        return save_says(SaveFacts(self.open_state.status, *good, *asked, *work, left, undecided))

    def tick(self) -> None:
        """How far the writing is."""
        writing = self.controller.runner.running == "save"
        self.progress.setVisible(writing)
        self.progress_words.setVisible(writing)
        self.progress_words.setText(self.said().left if writing else "")

    def _write_report(self) -> None:
        self._opens = True
        self._keep_note()
        self.controller.saving.write_report(self.report_path)
