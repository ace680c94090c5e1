"""A folder of images from elsewhere: how its files are read, what they show; made a session once somebody agrees."""

from datetime import datetime
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QCheckBox, QDialog, QGridLayout, QHBoxLayout, QVBoxLayout, QWidget

from spherecal.base.context import Context
from spherecal.targets.family import CODE_COUNT, make_target_set
from spherecal_app.recordings.image_layout import ImageLayout, recognise
from spherecal_gui import languages
from spherecal_gui.languages import error_line
from spherecal_gui.pages.board_dialog import BoardDialog
from spherecal_gui.project_folder import new_folder
from spherecal_gui.tasks.task import Runner
from spherecal_gui.widgets.basic import add, button, label, say
from spherecal_gui.widgets.fields import number_field

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
