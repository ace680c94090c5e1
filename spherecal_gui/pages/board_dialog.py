"""Which board calibrates: what is printed on it, and a sheet to print where there is none yet."""

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLineEdit,
    QVBoxLayout,
    QWidget,
)

from spherecal.base.errors import SpherecalError
from spherecal_boards.pattern_entry import SQUARED, board_entry, partial_board
from spherecal_gui.languages import error_line
from spherecal_gui.widgets.basic import WheelGuard, add, button, enable, label
from spherecal_gui.widgets.fields import number_field

_MARKED = ("charuco", "aprilgrid")


class BoardDialog(QDialog):
    """The fields of a board; with `images` that show it, what they can tell need not be stated."""

    chosen = Signal(dict)  # as session.json has it: somebody begins with it

    def __init__(self, parent: QWidget | None = None, images: bool = False) -> None:
        super().__init__(parent)
        self._images = images
        self.setWindowTitle(self.tr("Calibrate with a board"))
        self._guard = WheelGuard(self)
        column = QVBoxLayout(self)
        message = self.tr("No ball is needed. Show the board in a dozen places and tilts, to two cameras at a time.")
        if not images:
            column.addWidget(label(message, "soft"))
        self.kind = QComboBox()
        self.kind.addItem("ChArUco", "charuco")
        self.kind.addItem("AprilGrid", "aprilgrid")
        self.kind.addItem(self.tr("Chessboard"), "chessboard")
        self.kind.addItem(self.tr("Circles"), "circles")
        self.kind.addItem(self.tr("Circles, asymmetric"), "asymmetric-circles")
        self.rows, self.columns = (number_field("", "", (2, 1000), "", digits=0) for _ in range(2))
        self.pitch, self.marker = (number_field("", "", (0.1, 10_000.0), "mm", digits=3) for _ in range(2))
        for one, value in ((self.rows, 6), (self.columns, 9), (self.pitch, 30.0), (self.marker, 22.0)):
            one.setValue(value)
        self.dictionary = QLineEdit("DICT_5X5_100")
        self._labels = {name: label("") for name in ("rows", "columns", "pitch", "marker", "dictionary")}
        grid = QGridLayout()
        grid.addWidget(label(self.tr("Board")), 0, 0)
        grid.addWidget(self.kind, 0, 1)
        parts: tuple[QWidget, ...] = (self.rows, self.columns, self.pitch, self.marker, self.dictionary)
        self._parts = dict(zip(self._labels, parts, strict=True))
        for number, (name, part) in enumerate(self._parts.items(), start=1):
            grid.addWidget(self._labels[name], number, 0)
            grid.addWidget(part, number, 1)
            part.installEventFilter(self._guard)
        self.looked = QCheckBox(self.tr("The images show the rest (rows, columns, markers)"))
        self.looked.setChecked(images)
        grid.addWidget(self.looked, len(self._parts) + 1, 1)
        self.problem = label("", level="bad")
        self.sheet = button(self.tr("Save a sheet to print"), "board-sheet", act=self._print)
        begin = self.tr("Images of this board") if images else self.tr("Calibrate with this board")
        self.begin = button(begin, "board-begin", "primary", act=self._begin)
        add(column, grid, self.problem, add(QHBoxLayout(), self.sheet, self.begin))
        self.kind.currentIndexChanged.connect(self._kind_changed)
        self.looked.toggled.connect(self._kind_changed)
        for spin in (self.rows, self.columns, self.pitch, self.marker):
            spin.valueChanged.connect(self._check)
        self.dictionary.textChanged.connect(self._check)
        self._kind_changed()

    @property
    def _needed(self) -> dict[str, object]:
        """The fields that somebody has to state, and their values."""
        kind = str(self.kind.currentData())
        seen = self._images and self.looked.isChecked() and kind in SQUARED
        fields: dict[str, object] = {"pitch": self.pitch.value()}
        if not seen:
            fields |= {"rows": int(self.rows.value()), "columns": int(self.columns.value())}
        if kind == "aprilgrid" or (kind in _MARKED and not seen):
            fields["marker"] = self.marker.value()
        if kind in _MARKED and not seen:
            fields["dictionary"] = self.dictionary.text().strip()
        return fields

    @property
    def entry(self) -> dict[str, object]:
        """The board as session.json has it, without what its images show."""
        names = {"pitch": "pitch_mm", "marker": "marker_mm"}
        fields = {names.get(name, name): value for name, value in self._needed.items()}
        return {"kind": str(self.kind.currentData()), **fields}

    def _kind_changed(self) -> None:
        kind = str(self.kind.currentData())
        tags = kind == "aprilgrid"
        rows, columns, pitch = self.tr("Rows of dots"), self.tr("Columns of dots"), self.tr("From row to row")
        if kind in ("charuco", "chessboard"):
            rows, columns = self.tr("Rows of inner corners"), self.tr("Columns of inner corners")
            pitch = self.tr("Side of a square")
        elif tags:
            rows, columns, pitch = self.tr("Rows of tags"), self.tr("Columns of tags"), self.tr("From tag to tag")
        marker, dictionary = self.tr("Side of a marker"), self.tr("OpenCV's name of the markers")
        for name, text in zip(self._labels, (rows, columns, pitch, marker, dictionary), strict=True):
            self._labels[name].setText(text)
            self._parts[name].setAccessibleName(text)
        self.dictionary.setText("DICT_APRILTAG_36h11" if tags else "DICT_5X5_100")
        self.looked.setVisible(self._images and kind in SQUARED)
        self.sheet.setVisible(not self._images)
        needed = self._needed
        for name, part in self._parts.items():
            self._labels[name].setVisible(name in needed)
            part.setVisible(name in needed)
        self._check()

    def _check(self) -> None:
        said = ""
        try:
            if partial_board(self.entry) is None:
                board_entry(self.entry)
        except SpherecalError as error:
            said = error_line(error)
        self.problem.setText(said)
        for one in (self.sheet, self.begin):
            enable(one, not said, said)

    def _print(self) -> None:
        path, _ = QFileDialog.getSaveFileName(self, self.tr("Save a sheet to print"), "board.pdf", "PDF (*.pdf)")
        if path:
            self.save_sheet(Path(path))

    def save_sheet(self, path: Path) -> None:
        """Write the sheet, on the smallest page that takes the board; say so where none does."""
        from spherecal_app.api import write_board_sheet  # loads the calibration, which takes a second

        for page in ("A4", "A3", "A2", "A1", "A0"):
            try:
                write_board_sheet(self.entry, path, page)
            except SpherecalError as error:
                self.problem.setText(error_line(error))
            else:
                self.problem.setText("")
                return

    def _begin(self) -> None:
        self.chosen.emit(self.entry)
        self.accept()
