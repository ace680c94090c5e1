"""A folder of images from elsewhere, made a session once somebody agrees; which board calibrates."""

from datetime import datetime
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtGui import QCloseEvent
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

from spherecal.base.context import Context
from spherecal.base.errors import SpherecalError
from spherecal.targets.family import CODE_COUNT, make_target_set
from spherecal_app.recordings.image_layout import ImageLayout, recognise
from spherecal_boards.pattern_entry import SQUARED, board_entry, partial_board
from spherecal_gui import languages
from spherecal_gui.languages import error_line
from spherecal_gui.project_folder import new_folder
from spherecal_gui.tasks.task import Runner
from spherecal_gui.widgets.basic import WheelGuard, add, button, enable, label, say
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


_NAMED = 8
_PATIENCE_MS = 3_000


class ImportDialog(QDialog):
    """`imported` once the session is made; the images are copied, where they come from nothing changes."""

    imported = Signal(str, str)  # the folder; what was assumed

    def __init__(self, images: Path, projects: Path, parent: QWidget | None = None) -> None:
        """InputError where no cameras and placements can be read from the names."""
        super().__init__(parent)
        self.setWindowTitle(self.tr("Import images"))
        self._images, self._projects = images, projects
        self.layout_found = recognise(images)
        self._board: dict[str, object] | None = None
        self._runner = Runner(self)
        grid = QGridLayout()
        for row, (title, text) in enumerate(self._rows(self.layout_found)):
            grid.addWidget(label(title, "soft", wrap=False), row, 0)
            grid.addWidget(label(text), row, 1)
        grid.setColumnStretch(1, 1)
        self.diameter = number_field("", self.tr("Diameter of the ball"), (0.0, 10_000.0), "mm")
        self.diameter.setSpecialValueText(self.tr("not known"))
        self.shows_board = QCheckBox(self.tr("They show a board, not the ball"))
        self.shows_board.clicked.connect(self._choose_board)
        self.message = label(self.tr("The images are copied. Lenses that the images do not name are assumed."), "soft")
        self.cancel = button(self.tr("Cancel"), "import-cancel", act=self.close)
        self.begin = button(self.tr("Import"), "import-begin", "primary", act=self.start)
        ball = label(self.tr("Diameter of the ball"), "soft", wrap=False)
        shown = add(QHBoxLayout(), ball, self.diameter, self.shows_board, None)
        add(QVBoxLayout(self), grid, shown, self.message, add(QHBoxLayout(), None, self.cancel, self.begin))
        self.setMinimumWidth(640)

    def _rows(self, found: ImageLayout) -> list[tuple[str, str]]:
        cameras, placements = list(found.files), list(found.placements)
        lists = [(self.tr("Cameras: {count}"), cameras), (self.tr("Placements: {count}"), placements)]
        if found.left_out:
            lists.append((self.tr("Left out: {count}"), [str(one) for one in found.left_out]))
        rows = [(self.tr("Folder"), str(self._images)), (self.tr("Read as"), found.pattern)]
        return rows + [(text.format(count=len(names)), languages.some(names, _NAMED)) for text, names in lists]

    def _choose_board(self) -> None:
        if not self.shows_board.isChecked():
            self._board = None
            return
        dialog = BoardDialog(self, images=True)
        dialog.chosen.connect(self._set_board)
        dialog.finished.connect(lambda _: self.shows_board.setChecked(self._board is not None))
        dialog.open()

    def _set_board(self, board: dict[str, object]) -> None:
        self._board = board

    def start(self) -> None:
        """Make the session, beside the window."""
        from spherecal_app.api import new_session  # loads the calibration

        folder = new_folder(self._projects, datetime.now(), "import")
        board, diameter = self._board, self.diameter.value() or None
        targets = None if board is not None else make_target_set(CODE_COUNT)

        def work(context: Context) -> tuple[str, str]:
            made = new_session(
                folder, self._images, board=board, targets=targets, sphere_diameter_mm=diameter, context=context
            )
            return str(folder), "; ".join(str(one) for one in made.assumed)

        self.begin.setEnabled(False)
        self.message.setText(self.tr("Importing"))
        self._runner.start("import", work, self._done, self._failed)

    def _done(self, made: tuple[str, str]) -> None:
        self.imported.emit(*made)
        self.accept()

    def _failed(self, error: BaseException) -> None:
        self.begin.setEnabled(True)
        say(self.message, error_line(error), "bad")

    def closeEvent(self, event: QCloseEvent) -> None:
        """Stop what runs."""
        self._runner.abandon(_PATIENCE_MS)
        super().closeEvent(event)
