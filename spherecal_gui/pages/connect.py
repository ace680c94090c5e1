"""Connect: the cameras that were found, and what is on the bench."""

from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFileDialog, QGridLayout, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from spherecal_gui import theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.base import Page, PageAction
from spherecal_gui.pages.camera_dialog import CameraDialog
from spherecal_gui.pages.drivers_panel import DriversPanel
from spherecal_gui.presenters.connect import (
    BenchRow,
    CameraLine,
    bench_rows,
    camera_lines,
    connect_summary,
    drawn_bench,
    recording_text,
)
from spherecal_gui.presenters.drivers import driver_notes
from spherecal_gui.widgets.basic import MARKS, Card, Downwards, button, clear, label, plain, set_level
from spherecal_gui.widgets.bench_view import BenchView
from spherecal_gui.widgets.thumbnail import Thumbnail

_PICTURES, _WORDS = 1, 3  # columns of the table of cameras
_ROOMY_PX = 1200


def _at_the_left(one: QPushButton) -> QHBoxLayout:
    """A button no wider than its words ask for."""
    line = QHBoxLayout()
    line.addWidget(one)
    line.addStretch(1)
    return line


class ConnectPage(Page):
    """Two cards: cameras on the left, the bench on the right."""

    def __init__(self, controller: Controller, parent: QWidget | None = None) -> None:
        super().__init__(controller, parent)
        self.dialog: CameraDialog | None = None
        row = QHBoxLayout(self)
        self.cameras = Card(self.tr("Cameras"))
        self.summary = label("", "big")
        self.cameras.body.addWidget(self.summary)
        self.why = label("", "soft")
        self.cameras.body.addWidget(self.why)
        self.other = button(self.tr("Choose another"), "choose-recording")
        self.other.clicked.connect(self.recording_wanted)
        self.cameras.body.addLayout(_at_the_left(self.other))
        self._pictures: dict[str, Thumbnail] = {}
        inner = QWidget()
        self._grid = QGridLayout(inner)
        self._grid.setHorizontalSpacing(18)
        self._grid.setVerticalSpacing(10)
        scroll = Downwards()
        top = QWidget()
        column = QVBoxLayout(top)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(inner, 100)  # the rows grow with the page
        self.drivers = DriversPanel()
        self.drivers.allowed.connect(self.controller.cameras.allow_driver)
        column.addWidget(self.drivers)
        column.addStretch(1)
        scroll.setWidget(top)
        self.cameras.body.addWidget(scroll, 1)
        self.again = button(self.tr("Search again"), "search-again")
        self.again.clicked.connect(self.controller.cameras.connect_all)
        self.cameras.body.addLayout(_at_the_left(self.again))
        row.addWidget(self.cameras, 3)
        self.bench = Card(self.tr("On the bench"))
        hint = self.tr("Compare with what lies there: the targets' numbers, the names and lengths on the bars.")
        rows = QWidget()
        column = QVBoxLayout(rows)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(label(hint, "soft"))
        self._bench_rows = QVBoxLayout()
        self._bench_rows.setSpacing(12)
        column.addLayout(self._bench_rows)
        self.drawn = BenchView()
        column.addWidget(self.drawn, 1)
        scroll = Downwards()
        scroll.setWidget(rows)
        self.bench.body.addWidget(scroll, 1)
        self.choose = button(self.tr("Choose another description"), "choose-bench")
        self.choose.clicked.connect(self._choose)
        self.describe = button(self.tr("Describe the bench"), "describe-bench")
        self.describe.setToolTip(self.tr("Ball, targets, bars with their certificates, limits."))
        self.describe.clicked.connect(self.bench_wanted)
        self.bench.body.addWidget(self.describe)
        self.bench.body.addWidget(self.choose)
        row.addWidget(self.bench, 2)

    @property
    def headline(self) -> QLabel:
        """The label with the state of the page."""
        return self.summary

    def refresh(self) -> None:
        """Show what is there."""
        if self.project is None:
            return
        connection, running = self.controller.cameras.connection, self.controller.runner.running
        lines = camera_lines(connection, self.project.cameras)
        failure = self.project.failures.get("connect", "")
        wrong = recording_text(self.project.source) if failure else ""
        text, level = connect_summary(lines, running == "connect", wrong or failure)
        self.say(text, level)
        self.why.setText(failure if wrong else "")
        self.why.setVisible(bool(wrong))
        self.other.setVisible(bool(wrong))
        self.again.setVisible(not wrong)
        self._show_lines(lines)
        self.drivers.show_notes([] if running == "connect" else driver_notes(self.controller.cameras.driver_troubles))
        self._show_bench(bench_rows(connection, self.project.artefacts))
        self.drawn.show_bench(drawn_bench(connection))
        self.again.setEnabled(running is None)
        self.describe.setEnabled(running is None)
        self.choose.setEnabled(running is None and not self.project.taken)
        self.choose.setToolTip(
            self.tr("Placements are captured already: begin a new calibration for another bench.")
            if self.project.taken
            else self.tr("A session.json, or the folder of an earlier session.")
        )
        self.action_changed.emit()

    def tick(self) -> None:
        """States of cameras change by themselves."""
        if self.project is not None and self.controller.cameras.connection is not None:
            lines = camera_lines(self.controller.cameras.connection, self.project.cameras)
            if lines != getattr(self, "_shown", None):
                self.refresh()
            self._follow()

    def pictures(self) -> tuple[Thumbnail, ...]:
        """The cameras' images, in the order of the list."""
        return tuple(self._pictures.values())

    def resizeEvent(self, event: QResizeEvent) -> None:
        """With large text a small screen has no room for pictures."""
        super().resizeEvent(event)
        for picture in self._pictures.values():
            picture.setVisible(self._has_room)

    @property
    def _has_room(self) -> bool:
        return not theme.is_far() or self.width() > _ROOMY_PX

    def _follow(self) -> None:
        """Show the newest images."""
        live = self.controller.cameras.live
        if live is None:
            return
        for serial, picture in self._pictures.items():
            frame = live.frame(serial)
            if frame is not None:
                picture.show_image(frame.image, frame.bits, frame.arrived_s)

    def _show_lines(self, lines: list[CameraLine]) -> None:
        self._shown = lines
        clear(self._grid)
        for number in range(self._grid.rowCount()):
            self._grid.setRowStretch(number, 0)
        self._pictures = {}
        self._grid.setColumnStretch(_PICTURES, 2 if lines else 0)
        self._grid.setColumnStretch(_WORDS, 1)
        # With the letters for three metres the state is below: beside it the buttons would leave a small screen.
        below = theme.is_far()
        for number, line in enumerate(lines):
            name = label(f"{MARKS[line.level]}  {line.name}", "big", wrap=False)
            known = line.about or line.serial
            about = label(known if below else f"{line.model}\n{known}".strip(), "soft", wrap=False)
            about.setToolTip(plain(line.model))
            word = label(line.word)
            for part in (name, word):
                set_level(part, line.level)
            self._grid.setRowStretch(2 * number, 1)
            self._grid.addWidget(name, 2 * number, 0)
            self._grid.addWidget(about, 2 * number, 2)
            if below and line.level == "good":
                word.deleteLater()  # the mark and the sum above say it, and a screen has room for all cameras
            elif below:
                self._grid.addWidget(word, 2 * number + 1, 2, 1, 2)
            else:
                self._grid.addWidget(word, 2 * number, _WORDS)
            connection = self.controller.cameras.connection
            if connection is not None and line.serial in connection.names:
                picture = self._pictures[line.serial] = Thumbnail()
                picture.setVisible(self._has_room)
                self._grid.addWidget(picture, 2 * number, _PICTURES, 2 if below else 1, 1)
                one = button(self.tr("Which is it?"), f"camera-{line.name}")
                one.setToolTip(self.tr("Its picture, its name, exposure and gain; its light, where it has one."))
                one.setProperty("serial", line.serial)
                one.clicked.connect(self._open_camera)
                self._grid.addWidget(one, 2 * number, 4)

    def _open_camera(self) -> None:
        sender = self.sender()
        if sender is not None and self.controller.cameras.connection is not None:
            if self.dialog is not None:  # not deleted on close: PySide crashes where its page goes at that very moment
                self.dialog.deleteLater()
            self.dialog = CameraDialog(self.controller, str(sender.property("serial")), self)
            self.dialog.show()

    def _show_bench(self, rows: list[BenchRow]) -> None:
        clear(self._bench_rows)
        for row in rows:
            box = QWidget()
            column = QVBoxLayout(box)
            column.setContentsMargins(0, 0, 0, 0)
            column.setSpacing(0)
            column.addWidget(label(row.title, "soft"))
            value = label(row.value, "big")
            set_level(value, row.level)
            column.addWidget(value)
            self._bench_rows.addWidget(box)

    def _choose(self) -> None:
        path, _ = QFileDialog.getOpenFileName(
            self, self.tr("Description of the bench"), str(self.open_project.folder.parent), "session.json (*.json)"
        )
        if path:
            self.controller.cameras.choose_bench(path)

    def action(self) -> PageAction:
        """Confirm the bench: nobody calibrates with the wrong bar by default."""
        connection, running = self.controller.cameras.connection, self.controller.runner.running
        done = self.project is not None and self.project.artefacts is not None and connection is not None
        text = self.tr("Bench confirmed") if done else self.tr("Yes, this matches")
        if running:
            return PageAction(text, False, self.tr("The cameras are being looked for."))
        if connection is None:
            return PageAction(text, False, self.tr("There are no cameras yet."))
        return PageAction(text, not done, self.tr("It was confirmed already.") if done else "", done=done, accepts=True)

    def act(self) -> None:
        """Confirm."""
        self.controller.recording.confirm_bench()
