"""Start: the rig in use; calibrate, verify or check; go on with recent work."""

import random
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from spherecal.base.errors import SpherecalError
from spherecal_gui import theme
from spherecal_gui.presenters.certificates import bench_reminder
from spherecal_gui.presenters.start_presenter import (
    FAULTS,
    SURPRISE,
    ProjectLine,
    age_text,
    next_check_text,
    number_in_use,
    picture_of,
    project_lines,
    verified_text,
)
from spherecal_gui.project_folder import TRAINING_PROFILE, profile_shown, rig_bench
from spherecal_gui.texts import error_text
from spherecal_gui.widgets.basic import Card, Chip, add, bare, button, clear, enable, label, plain, set_level
from spherecal_gui.widgets.drawing import Drawing
from spherecal_gui.widgets.icons import give_icon

if TYPE_CHECKING:  # dialogs that need scipy or matplotlib; imported when they are first shown
    from spherecal_gui.pages.board_dialog import BoardDialog
    from spherecal_gui.pages.profile_dialog import ProfileDialog
    from spherecal_gui.pages.studies_dialog import StudiesDialog

_PICTURE_PX = (160, 120)
_WIDEST_PX = 2000
_MOST_RECENT = 5


class StartPage(QWidget):
    """The rig in use, three cards, and recent work."""

    wanted = Signal(str)  # a new calibration with this source
    opened = Signal(str)  # a project's folder
    board_wanted = Signal(dict)  # a new calibration with live cameras and this board
    check_wanted = Signal(str)  # the project whose cameras and bench a check is made with
    verification_wanted = Signal(str)  # likewise
    bench_wanted = Signal()
    said = Signal(str, str, str)

    def __init__(self, projects: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.projects = projects
        self._lines: list[ProjectLine] = []
        self._studies: StudiesDialog | None = None
        self.board_dialog: BoardDialog | None = None
        self._profile: ProfileDialog | None = None
        outer = QHBoxLayout(self)  # a wide screen shows larger drawings, but no lines of a metre
        outer.setContentsMargins(theme.WIDE, theme.GAP, theme.WIDE, theme.PAD)
        middle = QWidget()
        middle.setMaximumWidth(_WIDEST_PX)
        outer.addStretch(1)
        outer.addWidget(middle, 100)
        outer.addStretch(1)
        column = bare(QVBoxLayout(middle), theme.PAD)
        column.addWidget(self._rig())
        row = QHBoxLayout()
        row.setSpacing(theme.PAD)
        for card in (self._calibrate(), self._verify(), self._check()):
            row.addWidget(card, 1)
        column.addLayout(row, 6)
        column.addWidget(self._recent(), 4)

    # --- cards -------------------------------------------------------------------------------------------------------

    def _rig(self) -> Card:
        """The rig in use: picture, state, when it was calibrated and verified, when the next check is due."""
        card = Card(horizontal=True)
        self.picture = label("", wrap=False)
        self.picture.setMinimumHeight(_PICTURE_PX[1])
        self.validity = Chip()
        self.validity.show_state(self.tr("no calibration in use"), "none")
        self.validity.clicked.connect(self.show_profile)
        self.age, self.newest, self.due = label("", ""), label("", "soft"), label("", "soft")
        self.certificates = label("", hidden=True)
        self.profile = button(self.tr("The rig's profile"), "profile", act=self.show_profile, icon="camera")
        words = QVBoxLayout()
        words.setSpacing(theme.TIGHT)
        line = QHBoxLayout()
        line.setSpacing(theme.GAP)
        line.addWidget(label(self.tr("Rig in use"), "title", wrap=False))
        line.addWidget(self.validity)
        line.addStretch(1)
        words.addStretch(1)
        words.addLayout(line)
        add(words, self.age, self.newest, self.due, self.certificates)
        words.addStretch(1)
        card.body.setSpacing(theme.PAD)
        card.body.addWidget(self.picture)
        card.body.addLayout(words, 1)
        card.body.addWidget(self.profile, 0, Qt.AlignmentFlag.AlignVCenter)
        return card

    def _card(self, title: str, text: str, drawing: str, *buttons: QPushButton) -> Card:
        card = Card(title)
        card.body.addWidget(label(text))
        card.body.addWidget(Drawing(drawing), 1)
        for one in buttons:
            card.body.addWidget(one)
        return card

    def _check(self) -> Card:
        self.check = button(self.tr("Check the rig"), "check", "card", act=self._check_newest, icon="zoom-check")
        text = self.tr("Has a camera moved since? One minute, one placement of the ball.")
        return self._card(self.tr("Check"), text, "check", self.check)

    def _choose_board(self) -> None:
        from spherecal_gui.pages.board_dialog import BoardDialog  # needs scipy and cv2

        if self.board_dialog is None:
            self.board_dialog = BoardDialog(self)
            self.board_dialog.chosen.connect(self.board_wanted)
        self.board_dialog.show()

    def _calibrate(self) -> Card:
        self.live = button(self.tr("Calibrate the rig"), "new-live", "card", act=lambda: self.wanted.emit("genicam"))
        give_icon(self.live, "sphere")
        self.board = button(self.tr("Calibrate with a board"), "new-board", act=self._choose_board)
        self.board.setToolTip(plain(self.tr("ChArUco, AprilGrid, chessboard or circles; no ball is needed.")))
        text = self.tr("A new calibration of the whole rig, from the cameras to the report.")
        return self._card(self.tr("Calibrate"), text, "calibrate", self.board, self.live)

    def _verify(self) -> Card:
        self.verify = button(self.tr("Verify the rig"), "verify", "card", act=self._verify_newest, icon="ruler-2")
        text = self.tr("Does the rig measure right? The check bar is measured, and the result printed.")
        return self._card(self.tr("Verify"), text, "verify", self.verify)

    def _recent(self) -> Card:
        self.recent = Card()
        self.training = button(self.tr("Train on a simulated rig"), "new-simulated", act=lambda: self.train(""))
        give_icon(self.training, "school")
        head = QHBoxLayout()
        head.addWidget(label(self.tr("Recent"), "big", wrap=False))
        head.addStretch(1)
        head.addWidget(self.training)
        self.recent.body.addLayout(head)
        self._rows = QVBoxLayout()
        self._rows.setSpacing(theme.TIGHT)
        self.recent.body.addLayout(self._rows)
        self.recent.body.addStretch(1)
        other = button(self.tr("Open another folder"), "open-project", act=self._open_other, icon="folder-open")
        self.replay = button(self.tr("Replay a recorded session"), "new-replay", act=self.choose_recording)
        give_icon(self.replay, "player-record")
        self.bars = button(self.tr("Bench, bars and balls"), "bench", act=self.bench_wanted, icon="ruler-2")
        line = QHBoxLayout()
        add(line, other, self.replay, self.bars)
        line.addStretch(1)
        self.recent.body.addLayout(line)
        return self.recent

    # --- what is shown -----------------------------------------------------------------------------------------------

    @property
    def profile_folder(self) -> Path:
        """The rig's profile; where there is none yet, that of training."""
        return profile_shown(self.projects)

    def refresh(self) -> None:
        """Show the projects that there are."""
        self._lines = project_lines(self.projects)
        clear(self._rows)
        if not self._lines:
            self._rows.addWidget(
                label(self.tr("Nothing yet. Projects are kept in {folder}.").format(folder=self.projects), "soft")
            )
        for line in self._lines[:_MOST_RECENT]:
            self._rows.addWidget(self._row(line))
        done = self._newest()
        self._show_profile_state(done)
        self._show_certificates()

    def _show_profile_state(self, done: ProjectLine | None) -> None:
        there = (self.profile_folder / "profile.json").is_file()
        age = age_text(self.profile_folder) if there else ""
        self.age.setText(age or self.tr("Save a calibration in the rig's profile; then it can be checked."))
        why = self.tr("No calibration is in use yet: calibrate, then save it in the rig's profile.")
        enable(self.check, bool(age) and done is not None, why)
        enable(self.verify, bool(age) and done is not None, why)
        self.newest.setText(verified_text(self.profile_folder) if age else "")
        enable(self.profile, there, why)
        self.due.setText(next_check_text(self.profile_folder) if age else "")
        for one in (self.newest, self.due):
            one.setVisible(bool(one.text()))
        number = number_in_use(self.profile_folder) if there else None
        picture = QPixmap(str(picture_of(self.profile_folder, number))) if there else QPixmap()
        self.picture.setVisible(not picture.isNull())
        self.profile.setVisible(there)
        if not picture.isNull():
            ratio = self.devicePixelRatioF()
            picture = picture.scaledToHeight(int(_PICTURE_PX[1] * ratio), Qt.TransformationMode.SmoothTransformation)
            picture.setDevicePixelRatio(ratio)
            self.picture.setPixmap(picture)

    def _show_certificates(self) -> None:
        """A reminder of certificates that have expired or soon will."""
        found = bench_reminder(rig_bench(self.projects), date.today())
        self.certificates.setText(found.text)
        set_level(self.certificates, found.level)
        self.certificates.setVisible(bool(found.text))

    def _newest(self) -> ProjectLine | None:
        """The newest calibration of what the profile is of."""
        lines = [line for line in self._lines if line.calibrated]
        if (self.profile_folder / "profile.json").is_file():
            training = self.profile_folder.name == TRAINING_PROFILE
            lines = [line for line in lines if line.simulated == training]
        return lines[0] if lines else None

    def _row(self, line: ProjectLine) -> QWidget:
        box = QWidget()
        row = bare(QHBoxLayout(box))
        go = button(line.title, f"open-{line.folder.name}")
        go.setProperty("folder", str(line.folder))
        go.clicked.connect(self._open_row)
        row.addWidget(go)
        where = label(line.where, "")
        set_level(where, line.level)
        row.addWidget(where, 1)
        row.addWidget(label(line.source, "soft", wrap=False))
        return box

    # --- what is done ------------------------------------------------------------------------------------------------

    def _open_row(self) -> None:
        sender = self.sender()
        if sender is not None:
            self.opened.emit(str(sender.property("folder")))

    def _open_other(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, self.tr("Open a project"), str(self.projects))
        if folder:
            self.opened.emit(folder)

    def choose_recording(self) -> None:
        """Have somebody choose a recorded session, and show it as live cameras."""
        folder = QFileDialog.getExistingDirectory(self, self.tr("A recorded session with images"), str(self.projects))
        if folder:
            self.opened.emit(folder)

    def train(self, fault: str) -> None:
        """The walk on a simulated rig in which this goes wrong; SURPRISE for one of all faults."""
        if fault == SURPRISE:
            fault = random.choice(FAULTS[1:])
        self.wanted.emit("simulated:demo" + (f"+{fault}" if fault else ""))

    def _verify_newest(self) -> None:
        done = self._newest()
        if done is not None:
            self.verification_wanted.emit(str(done.folder))

    def _check_newest(self) -> None:
        done = self._newest()
        if done is not None:
            self.check_wanted.emit(str(done.folder))

    def show_profile(self) -> None:
        """All calibrations of the rig."""
        from spherecal_gui.pages.profile_dialog import ProfileDialog  # needs scipy

        if not (self.profile_folder / "profile.json").is_file():
            self.said.emit("info", self.tr("No calibration was saved in the rig's profile yet."), "")
            return
        self.close_profile()
        try:
            self._profile = ProfileDialog(self.profile_folder, self)
        except SpherecalError as error:
            self.said.emit("bad", *error_text(error))
            return
        self._profile.applied.connect(self.refresh)
        self._profile.finished.connect(self._profile_closed)
        self._profile.show()

    def close_profile(self) -> None:
        """Close the list of calibrations, if it is open: another project may have another profile."""
        if self._profile is not None:
            self._profile.close()
            self._profile = None

    def _profile_closed(self) -> None:
        self._profile = None

    def show_studies(self) -> None:
        """The studies that compare methods."""
        if self._studies is None:
            from spherecal_gui.pages.studies_dialog import StudiesDialog  # needs matplotlib and the calibration

            self._studies = StudiesDialog(self.projects / "studies", self)
        self._studies.show()
        self._studies.raise_()

    def close_work(self) -> bool:
        """Stop a study that runs; whether it has ended."""
        return self._studies is None or self._studies.close_work()
