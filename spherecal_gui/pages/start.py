"""Start: check, calibrate or verify; go on with what was begun; train on a simulated rig."""

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QVBoxLayout, QWidget

from spherecal_gui.presenters.start import ProjectLine, project_lines
from spherecal_gui.widgets.basic import Card, Chip, button, clear, enable, label, set_level


class StartPage(QWidget):
    """Three equal cards, and what was begun before."""

    wanted = Signal(str)  # a new calibration with this source
    opened = Signal(str, str)  # a project's folder, the step to go to (empty: where it was left)

    def __init__(self, projects: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.projects = projects
        self._lines: list[ProjectLine] = []
        column = QVBoxLayout(self)
        column.setContentsMargins(40, 26, 40, 26)
        column.setSpacing(18)
        title = label(self.tr("What do you want to do?"), "huge")
        column.addWidget(title)
        row = QHBoxLayout()
        row.setSpacing(18)
        row.addWidget(self._check(), 1)
        row.addWidget(self._calibrate(), 1)
        row.addWidget(self._verify(), 1)
        column.addLayout(row, 3)
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
        column.addWidget(self.recent, 4)

    def _check(self) -> Card:
        card = Card(self.tr("Check"))
        card.body.addWidget(label(self.tr("Is the calibration in use still good? One minute, one placement.")))
        self.validity = Chip()
        self.validity.show_state(self.tr("no calibration in use"), "none")
        line = QHBoxLayout()
        line.addWidget(self.validity)
        line.addStretch(1)
        card.body.addLayout(line)
        card.body.addStretch(1)
        self.check = button(self.tr("Check"), "check", "primary")
        why = self.tr("The one-minute check is not part of this version yet: calibrate or verify instead.")
        enable(self.check, False, why)
        card.body.addWidget(label(why, "soft"))
        card.body.addWidget(self.check)
        return card

    def _calibrate(self) -> Card:
        card = Card(self.tr("Calibrate"))
        card.body.addWidget(label(self.tr("A new calibration of the whole rig, from the cameras to the report.")))
        card.body.addStretch(1)
        self.training = button(self.tr("Train on a simulated rig"), "new-simulated")
        self.training.clicked.connect(lambda: self.wanted.emit("simulated:demo"))
        self.replay = button(self.tr("Replay a recorded session"), "new-replay")
        self.replay.clicked.connect(self._choose_recording)
        self.live = button(self.tr("Calibrate the rig"), "new-live", "primary")
        self.live.clicked.connect(lambda: self.wanted.emit("genicam"))
        for one in (self.training, self.replay, self.live):
            card.body.addWidget(one)
        return card

    def _verify(self) -> Card:
        card = Card(self.tr("Verify"))
        card.body.addWidget(label(self.tr("Measure the check bar with the newest calibration, and print the result.")))
        card.body.addStretch(1)
        self.newest = label("", "soft")
        card.body.addWidget(self.newest)
        self.verify = button(self.tr("Verify"), "verify", "primary")
        self.verify.clicked.connect(self._verify_newest)
        card.body.addWidget(self.verify)
        return card

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
        done = next((line for line in self._lines if line.calibrated), None)
        self.newest.setText(done.title if done is not None else "")
        enable(self.verify, done is not None, self.tr("There is no calibration yet."))

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

    def _open_row(self) -> None:
        sender = self.sender()
        if sender is not None:
            self.opened.emit(str(sender.property("folder")), "")

    def _open_other(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, self.tr("Open a project"), str(self.projects))
        if folder:
            self.opened.emit(folder, "")

    def _choose_recording(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, self.tr("A recorded session with images"), str(self.projects))
        if folder:
            self.wanted.emit(f"replay:{folder}")

    def _verify_newest(self) -> None:
        done = next((line for line in self._lines if line.calibrated), None)
        if done is not None:
            self.opened.emit(str(done.folder), "verify")
