"""Start: the rig in use; calibrate, verify or check; go on with recent work."""

import random
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal, SignalInstance
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from spherecal.base.errors import SpherecalError
from spherecal_gui import theme
from spherecal_gui.languages import error_text
from spherecal_gui.presenters.bars_presenter import bench_reminder
from spherecal_gui.presenters.start_presenter import FAULTS, SURPRISE, ProjectLine, in_use, picture_of, project_lines
from spherecal_gui.project_folder import TRAINING_PROFILE, profile_shown, rig_bench
from spherecal_gui.widgets.basic import Card, Chip, add, bare, button, clear, enable, label, plain, say, spaced
from spherecal_gui.widgets.icons import Drawing

if TYPE_CHECKING:  # dialogs that need scipy; imported when they are first shown
    from spherecal_gui.pages.images_dialogs import BoardDialog
    from spherecal_gui.pages.profile_dialog import ProfileDialog

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

    def __init__(self, projects: Path) -> None:
        super().__init__()
        self.projects = projects
        self._lines: list[ProjectLine] = []
        self.board_dialog: BoardDialog | None = None
        self._profile: ProfileDialog | None = None
        middle = QWidget()
        middle.setMaximumWidth(_WIDEST_PX)
        outer = add(QHBoxLayout(self), None, (middle, 100), None)  # a wide screen has larger drawings, no wider lines
        outer.setContentsMargins(theme.WIDE, theme.GAP, theme.WIDE, theme.PAD)
        cards = add(spaced(QHBoxLayout(), theme.PAD), (self._calibrate(), 1), (self._verify(), 1), (self._check(), 1))
        add(bare(QVBoxLayout(middle), theme.PAD), self._rig(), (cards, 6), (self._recent(), 4))

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
        title = label(self.tr("Rig in use"), "title", wrap=False)
        line = add(spaced(QHBoxLayout(), theme.GAP), title, self.validity, None)
        words = spaced(QVBoxLayout(), theme.TIGHT)
        add(words, None, line, self.age, self.newest, self.due, self.certificates, None)
        card.body.setSpacing(theme.PAD)
        add(card.body, self.picture, (words, 1), (self.profile, Qt.AlignmentFlag.AlignVCenter))
        return card

    def _card(self, title: str, text: str, drawing: str, *buttons: QPushButton) -> Card:
        card = Card(title)
        add(card.body, label(text), (Drawing(drawing), 1), *buttons)
        return card

    def _check(self) -> Card:
        self.check = button(self.tr("Check the rig"), "check", "card", icon="zoom-check")
        self.check.clicked.connect(lambda: self._with_newest(self.check_wanted))
        text = self.tr("Has a camera moved since? One minute, one placement of the ball.")
        return self._card(self.tr("Check"), text, "check", self.check)

    def _choose_board(self) -> None:
        from spherecal_gui.pages.images_dialogs import BoardDialog  # needs scipy and cv2

        if self.board_dialog is None:
            self.board_dialog = BoardDialog(self)
            self.board_dialog.chosen.connect(self.board_wanted)
        self.board_dialog.show()

    def _calibrate(self) -> Card:
        self.live = button(self.tr("Calibrate the rig"), "new-live", "card", icon="sphere")
        self.live.clicked.connect(lambda: self.wanted.emit("genicam"))
        self.board = button(self.tr("Calibrate with a board"), "new-board", act=self._choose_board)
        self.board.setToolTip(plain(self.tr("ChArUco, AprilGrid, chessboard or circles; no ball is needed.")))
        text = self.tr("A new calibration of the whole rig, from the cameras to the report.")
        return self._card(self.tr("Calibrate"), text, "calibrate", self.board, self.live)

    def _verify(self) -> Card:
        self.verify = button(self.tr("Verify the rig"), "verify", "card", icon="ruler-2")
        self.verify.clicked.connect(lambda: self._with_newest(self.verification_wanted))
        text = self.tr("Does the rig measure right? The check bar is measured, and the result printed.")
        return self._card(self.tr("Verify"), text, "verify", self.verify)

    def _recent(self) -> Card:
        self.recent = Card()
        self.training = button(self.tr("Train on a simulated rig"), "new-simulated", icon="school")
        self.training.clicked.connect(lambda: self.train(""))
        head = add(QHBoxLayout(), label(self.tr("Recent"), "big", wrap=False), None, self.training)
        self._rows = spaced(QVBoxLayout(), theme.TIGHT)
        other = button(self.tr("Open another folder"), "open-project", icon="folder-open")
        other.clicked.connect(lambda: self._open(self.tr("Open a project")))
        self.replay = button(self.tr("Replay a recorded session"), "new-replay", icon="player-record")
        self.replay.clicked.connect(self.choose_recording)
        self.bars = button(self.tr("Bench, bars and balls"), "bench", act=self.bench_wanted, icon="ruler-2")
        line = add(QHBoxLayout(), other, self.replay, self.bars, None)
        add(self.recent.body, head, self._rows, None, line)
        return self.recent

    @property
    def profile_folder(self) -> Path:
        """The rig's profile; where there is none yet, that of training."""
        return profile_shown(self.projects)

    def refresh(self) -> None:
        """Show the projects that there are."""
        self._lines = project_lines(self.projects)
        clear(self._rows)
        if not self._lines:
            text = self.tr("Nothing yet. Projects are kept in {folder}.").format(folder=self.projects)
            self._rows.addWidget(label(text, "soft"))
        for line in self._lines[:_MOST_RECENT]:
            self._rows.addWidget(self._row(line))
        self._show_profile_state(self._newest() is not None)
        say(self.certificates, *bench_reminder(rig_bench(self.projects), date.today()))

    def _show_profile_state(self, done: bool) -> None:
        there = (self.profile_folder / "profile.json").is_file()
        found = in_use(self.profile_folder)
        none = self.tr("Save a calibration in the rig's profile; then it can be checked.")
        self.age.setText(found.age if found is not None else none)
        why = self.tr("No calibration is in use yet: calibrate, then save it in the rig's profile.")
        enable(self.check, found is not None and done, why)
        enable(self.verify, found is not None and done, why)
        enable(self.profile, there, why)
        say(self.newest, found.verified if found is not None else "")
        say(self.due, found.next_check if found is not None else "")
        number = found.number if found is not None else None
        picture = QPixmap(str(picture_of(self.profile_folder, number))) if there else QPixmap()
        self.picture.setVisible(not picture.isNull())
        self.profile.setVisible(there)
        if not picture.isNull():
            ratio = self.devicePixelRatioF()
            picture = picture.scaledToHeight(int(_PICTURE_PX[1] * ratio), Qt.TransformationMode.SmoothTransformation)
            picture.setDevicePixelRatio(ratio)
            self.picture.setPixmap(picture)

    def _newest(self) -> ProjectLine | None:
        """The newest calibration of what the profile is of."""
        lines = [line for line in self._lines if line.calibrated]
        if (self.profile_folder / "profile.json").is_file():
            training = self.profile_folder.name == TRAINING_PROFILE
            lines = [line for line in lines if line.simulated == training]
        return lines[0] if lines else None

    def _row(self, line: ProjectLine) -> QWidget:
        box = QWidget()
        go = button(line.title, f"open-{line.folder.name}", act=lambda: self.opened.emit(str(line.folder)))
        where, source = label(line.where, level=line.level), label(line.source, "soft", wrap=False)
        add(bare(QHBoxLayout(box)), go, (where, 1), source)
        return box

    def _open(self, title: str) -> None:
        if folder := QFileDialog.getExistingDirectory(self, title, str(self.projects)):
            self.opened.emit(folder)

    def choose_recording(self) -> None:
        """Have somebody choose a recorded session, and show it as live cameras."""
        self._open(self.tr("A recorded session with images"))

    def train(self, fault: str) -> None:
        """The walk on a simulated rig in which this goes wrong; SURPRISE for one of all faults."""
        if fault == SURPRISE:
            fault = random.choice(FAULTS[1:])
        self.wanted.emit("simulated:demo" + (f"+{fault}" if fault else ""))

    def _with_newest(self, wanted: SignalInstance) -> None:
        if (done := self._newest()) is not None:
            wanted.emit(str(done.folder))

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
