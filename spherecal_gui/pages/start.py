"""Start: check, calibrate or verify; go on with what was begun; train on a simulated rig with faults."""

import random
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QComboBox, QFileDialog, QHBoxLayout, QVBoxLayout, QWidget

from spherecal.base.errors import SpherecalError
from spherecal_gui.presenters.start import (
    FAULTS,
    ProjectLine,
    age_text,
    fault_text,
    number_in_use,
    picture_of,
    project_lines,
    verified_text,
)
from spherecal_gui.project_folder import TRAINING_PROFILE, profile_shown
from spherecal_gui.texts import error_text
from spherecal_gui.widgets.basic import Card, Chip, button, clear, enable, label, plain, set_level

if TYPE_CHECKING:  # the studies take a second to import
    from spherecal_gui.pages.board_dialog import BoardDialog
    from spherecal_gui.pages.profile_dialog import ProfileDialog
    from spherecal_gui.pages.studies_dialog import StudiesDialog

_PICTURE_PX = 110
_SURPRISE = "surprise"


class StartPage(QWidget):
    """Three equal cards, and what was begun before."""

    wanted = Signal(str)  # a new calibration with this source
    opened = Signal(str)  # a project's folder
    board_wanted = Signal(dict)  # a new calibration with live cameras and this board
    check_wanted = Signal(str)  # the project whose cameras and bench a check is made with
    verification_wanted = Signal(str)  # likewise
    said = Signal(str, str, str)

    def __init__(self, projects: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.projects = projects
        self._lines: list[ProjectLine] = []
        self._studies: StudiesDialog | None = None
        self.board_dialog: BoardDialog | None = None
        self._profile: ProfileDialog | None = None
        column = QVBoxLayout(self)
        column.setContentsMargins(40, 10, 40, 10)
        column.setSpacing(14)
        title = label(self.tr("What do you want to do?"), "huge")
        column.addWidget(title)
        row = QHBoxLayout()
        row.setSpacing(18)
        row.addWidget(self._check(), 1)
        row.addWidget(self._calibrate(), 1)
        row.addWidget(self._verify(), 1)
        column.addLayout(row, 5)
        lower = QHBoxLayout()
        lower.setSpacing(18)
        self.recent = Card(self.tr("Go on with"))
        self._rows = QVBoxLayout()
        self._rows.setSpacing(6)
        self.recent.body.addLayout(self._rows)
        self.recent.body.addStretch(1)
        other = button(self.tr("Open another folder"), "open-project")
        other.clicked.connect(self._open_other)
        line = QHBoxLayout()
        line.addWidget(other)
        line.addStretch(1)
        self.recent.body.addLayout(line)
        lower.addWidget(self.recent, 2)
        lower.addWidget(self._training(), 1)
        column.addLayout(lower, 4)

    # --- cards -------------------------------------------------------------------------------------------------------

    def _check(self) -> Card:
        card = Card(self.tr("Check"))
        card.body.addWidget(label(self.tr("Is the calibration in use still good? One minute, one placement.")))
        self.validity = Chip()
        self.validity.show_state(self.tr("no calibration in use"), "none")
        self.validity.clicked.connect(self.show_profile)
        self.age = label("", "soft")
        self.picture = label("", wrap=False)
        words = QVBoxLayout()
        line = QHBoxLayout()
        line.addWidget(self.validity)
        line.addStretch(1)
        words.addLayout(line)
        words.addWidget(self.age)
        words.addStretch(1)
        middle = QHBoxLayout()
        middle.addWidget(self.picture)
        middle.addLayout(words, 1)
        card.body.addLayout(middle)
        card.body.addStretch(1)
        self.profile = button(self.tr("The rig's profile"), "profile")
        self.profile.clicked.connect(self.show_profile)
        self.check = button(self.tr("Check the rig"), "check", "primary")
        self.check.clicked.connect(self._check_newest)
        card.body.addWidget(self.profile)
        card.body.addWidget(self.check)
        return card

    def _calibrate(self) -> Card:
        card = Card(self.tr("Calibrate"))
        card.body.addWidget(label(self.tr("A new calibration of the whole rig, from the cameras to the report.")))
        card.body.addStretch(1)
        self.replay = button(self.tr("Replay a recorded session"), "new-replay")
        self.replay.clicked.connect(self._choose_recording)
        self.live = button(self.tr("Calibrate the rig"), "new-live", "primary")
        self.live.clicked.connect(lambda: self.wanted.emit("genicam"))
        self.board = button(self.tr("Calibrate with a board"), "new-board")
        self.board.setToolTip(plain(self.tr("ChArUco, AprilGrid, chessboard or circles; no ball is needed.")))
        self.board.clicked.connect(self._choose_board)
        for one in (self.replay, self.board, self.live):
            card.body.addWidget(one)
        return card

    def _choose_board(self) -> None:
        from spherecal_gui.pages.board_dialog import BoardDialog

        if self.board_dialog is None:
            self.board_dialog = BoardDialog(self)
            self.board_dialog.chosen.connect(self.board_wanted)
        self.board_dialog.show()

    def _verify(self) -> Card:
        card = Card(self.tr("Verify"))
        card.body.addWidget(label(self.tr("Measure the check bar with the calibration in use, and print the result.")))
        card.body.addStretch(1)
        self.newest = label("", "soft")
        card.body.addWidget(self.newest)
        self.verify = button(self.tr("Verify the rig"), "verify", "primary")
        self.verify.clicked.connect(self._verify_newest)
        card.body.addWidget(self.verify)
        return card

    def _training(self) -> Card:
        card = Card(self.tr("Training"))
        card.body.addWidget(label(self.tr("The whole walk on a simulated rig, without any camera."), "soft"))
        self.fault = QComboBox()
        self.fault.setObjectName("fault")
        self.fault.setAccessibleName(self.tr("What goes wrong in training"))
        for fault in FAULTS:
            self.fault.addItem(fault_text(fault), fault)
        self.fault.addItem(self.tr("a surprise"), _SURPRISE)
        card.body.addWidget(self.fault)
        self.training = button(self.tr("Train on a simulated rig"), "new-simulated")
        self.training.clicked.connect(self._train)
        card.body.addWidget(self.training)
        card.body.addStretch(1)
        self.studies = button(self.tr("Compare methods"), "compare-methods")
        self.studies.clicked.connect(self.show_studies)
        card.body.addWidget(self.studies)
        return card

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
        for line in self._lines[:5]:
            self._rows.addWidget(self._row(line))
        done = self._newest()
        self._show_profile_state(done)

    def _show_profile_state(self, done: ProjectLine | None) -> None:
        there = (self.profile_folder / "profile.json").is_file()
        age = age_text(self.profile_folder) if there else ""
        self.age.setText(age or self.tr("Save a calibration in the rig's profile; then it can be checked."))
        why = self.tr("No calibration is in use yet: calibrate, then save it in the rig's profile.")
        enable(self.check, bool(age) and done is not None, why)
        enable(self.verify, bool(age) and done is not None, why)
        self.newest.setText(verified_text(self.profile_folder) if age else why)
        enable(self.profile, there, why)
        number = number_in_use(self.profile_folder) if there else None
        picture = QPixmap(str(picture_of(self.profile_folder, number))) if there else QPixmap()
        self.picture.setVisible(not picture.isNull())
        if not picture.isNull():
            mode = Qt.TransformationMode.SmoothTransformation
            self.picture.setPixmap(picture.scaledToWidth(_PICTURE_PX, mode))

    def _newest(self) -> ProjectLine | None:
        """The newest calibration of what the profile is of."""
        lines = [line for line in self._lines if line.calibrated]
        if (self.profile_folder / "profile.json").is_file():
            training = self.profile_folder.name == TRAINING_PROFILE
            lines = [line for line in lines if line.simulated == training]
        return lines[0] if lines else None

    def _row(self, line: ProjectLine) -> QWidget:
        box = QWidget()
        row = QHBoxLayout(box)
        row.setContentsMargins(0, 0, 0, 0)
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

    def _choose_recording(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, self.tr("A recorded session with images"), str(self.projects))
        if folder:
            self.wanted.emit(f"replay:{folder}")

    def _train(self) -> None:
        fault = str(self.fault.currentData())
        if fault == _SURPRISE:
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
        from spherecal_gui.pages.profile_dialog import ProfileDialog

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
            from spherecal_gui.pages.studies_dialog import StudiesDialog

            self._studies = StudiesDialog(self.projects / "studies", self)
        self._studies.show()
        self._studies.raise_()

    def close_work(self) -> bool:
        """Stop a study that runs; whether it has ended."""
        return self._studies is None or self._studies.close_work()
