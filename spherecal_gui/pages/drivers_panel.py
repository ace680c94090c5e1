"""On Connect: why no camera is found and what to do; the list of makers and their drivers."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QAbstractItemView, QDialog, QHBoxLayout, QVBoxLayout, QWidget

from spherecal_gui.presenters.drivers_presenter import DriverNote, makers_rows
from spherecal_gui.widgets.basic import add, bare, button, clear, details_button, label, plain, spaced
from spherecal_gui.widgets.table import Table


class DriversPanel(QWidget):
    """One block for each reason; `of_drivers`: the list of makers is offered too."""

    allowed = Signal(str)  # the file of a driver
    builtin = Signal()  # the built-in driver is to be used
    cured = Signal(str)  # the command that mends this computer's network

    def __init__(self, of_drivers: bool = True) -> None:
        super().__init__()
        self._notes: list[DriverNote] | None = None
        self._blocks = spaced(QVBoxLayout(), 10)
        self.makers = button(self.tr("Makers and their drivers"), "makers", act=self.show_makers)
        if not of_drivers:
            self.makers.hide()
        add(bare(QVBoxLayout(self)), self._blocks, add(QHBoxLayout(), self.makers, None))
        self.hide()

    def show_notes(self, notes: list[DriverNote]) -> None:
        """Show these; nothing where there are none."""
        if notes == self._notes:
            return
        self._notes = notes
        clear(self._blocks)
        for note in notes:
            self._blocks.addWidget(self._block(note))
        self.setVisible(bool(notes))

    def _block(self, note: DriverNote) -> QWidget:
        box = QWidget()
        column = bare(QVBoxLayout(box), 2)
        if note.title:
            column.addWidget(label(note.title, "big", level=note.level))
        for step in note.steps:
            line = label(f"• {step}")
            line.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)  # commands are copied
            line.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            column.addWidget(line)
        if note.allow:
            yes = button(self.tr("Allow this driver"), "allow-driver", act=lambda: self.allowed.emit(note.allow))
            column.addWidget(yes, 0, Qt.AlignmentFlag.AlignLeft)
        if note.builtin:
            use = button(self.tr("Use the built-in driver"), "builtin-driver", act=self.builtin)
            column.addWidget(use, 0, Qt.AlignmentFlag.AlignLeft)
        if note.cure:
            cure = button(
                self.tr("Do it now"), "apply-cure", act=lambda: self.cured.emit(note.cure), tip=plain(note.cure)
            )
            column.addWidget(cure, 0, Qt.AlignmentFlag.AlignLeft)
        if note.details:
            said = label(note.details, "soft")
            column.addWidget(details_button(said), 0, Qt.AlignmentFlag.AlignLeft)
            column.addWidget(said)
        return box

    def show_makers(self) -> QDialog:
        """The list of makers."""
        dialog = MakersDialog(self)
        dialog.show()
        return dialog


class MakersDialog(QDialog):
    """Makers, the package of each one's driver, its file, where it usually lies on this system."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("Makers and their drivers"))
        message = self.tr("Install the maker's package; its driver is then found by itself. Never copy the .cti file.")
        self.table = Table(
            [self.tr("Maker"), self.tr("Package"), self.tr("Driver's file"), self.tr("Usual folder")], sortable=False
        )
        self.table.fill(makers_rows())
        self.table.setWordWrap(False)  # else rows are made for columns that are not yet as wide as their texts
        self.table.resizeRowsToContents()
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        close = button(self.tr("Close"), "close-makers", act=self.accept)
        add(QVBoxLayout(self), label(message), (self.table, 1), add(QHBoxLayout(), None, close))
        self.resize(1100, 640)
