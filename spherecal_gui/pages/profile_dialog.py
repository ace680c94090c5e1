"""The rig's profile: all its calibrations, the one in use, what changed between two of them, which one to use."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QDialog, QHBoxLayout, QInputDialog, QVBoxLayout, QWidget

from spherecal.base.errors import SpherecalError
from spherecal_gui import limits_in_force as limits
from spherecal_gui.languages import Cell, error_line, figure
from spherecal_gui.presenters.results_presenter import compared_text
from spherecal_gui.presenters.start_presenter import ProfileRow, picture_of, profile_rows, validity_of
from spherecal_gui.tasks.outcome import Compared
from spherecal_gui.widgets.basic import Chip, add, button, enable, label, once, say
from spherecal_gui.widgets.table import Table
from spherecal_rigs.compare_rigs import compare, seen_volume
from spherecal_rigs.rig_source import entry_volume
from spherecal_rigs.store import apply, open_profile

_PICTURE_PX = 300


class ProfileDialog(QDialog):
    """Table of calibrations; `applied` when another one was put to use."""

    applied = Signal()

    def __init__(self, folder: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._folder = folder
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("The rig's profile"))
        self.picture = label("", wrap=False)
        self.chip, self.details = Chip(), label("", "soft")
        words = add(QVBoxLayout(), add(QHBoxLayout(), self.chip, None), self.details, None)
        headings = [
            self.tr("Number"), self.tr("calibrated"), self.tr("state"), self.tr("verified"), self.tr("rms\npx"),
            self.tr("in use"),
        ]  # fmt: skip
        self.table = Table(headings, sortable=False)
        self.table.itemSelectionChanged.connect(self._selected)
        self.message, self.why_not = label(""), label("", level="caution")
        self.compare = button(self.tr("Compare with the one in use"), "compare-profile")
        self.compare.clicked.connect(lambda: self._try(self._show_change))
        self.use = once(button(self.tr("Put this one to use"), "use-profile"))
        self.use.clicked.connect(lambda: self._try(self._apply))
        close = button(self.tr("Close"), "close", act=self.accept)
        column = add(QVBoxLayout(self), add(QHBoxLayout(), self.picture, (words, 1)), (self.table, 1))
        add(column, self.message, self.why_not, add(QHBoxLayout(), self.compare, self.use, None, close))
        self.resize(860, 560)
        self._fill()

    def _fill(self) -> None:
        chosen = self.table.chosen  # stays chosen: a second click must not hit another one
        word, level, details = validity_of(self._folder)
        self.chip.show_state(word, level, details)
        self.details.setText(details)
        rows = profile_rows(self._folder)
        self._rows = {row.number: row for row in rows}
        self._active = next((row.number for row in rows if row.in_use), None)
        self.table.fill([_cells(row) for row in rows])
        picture = QPixmap(str(picture_of(self._folder, self._active)))
        self.picture.setVisible(not picture.isNull())
        if not picture.isNull():
            mode = Qt.TransformationMode.SmoothTransformation
            self.picture.setPixmap(picture.scaledToWidth(_PICTURE_PX, mode))
        if rows and not self.table.select_name(chosen or rows[0].number):
            self.table.selectRow(0)
        self._selected()

    def _selected(self) -> None:
        row = self._rows.get(self.table.chosen or "")
        other = row is not None and not row.in_use
        enable(self.compare, other and self._active is not None, self.tr("Choose one that is not in use."))
        forbidden = ""
        if row is None or not row.valid:
            forbidden = self.tr("It is not valid: it cannot be put to use.")
        elif row.refused:
            forbidden = self.tr("Its verification failed: it cannot be put to use.")
        elif not (limits.now().unverified_use or row.verified):
            forbidden = self.tr("It was not verified, and the limits forbid its use.")
        enable(self.use, other and not forbidden, forbidden if other else self.tr("It is in use already."))
        say(self.why_not, forbidden if other else "", "caution")

    def _try(self, act: Callable[[], None]) -> None:
        try:
            act()
        except SpherecalError as error:
            say(self.message, error_line(error), "bad", hides=False)

    def _show_change(self) -> None:
        kept, number = open_profile(self._folder), str(self.table.chosen)
        before = kept.rig(number)
        volume = entry_volume(kept.entry(number)) or seen_volume(before)
        _, metric = compare(before, kept.rig(), volume)
        made = f"{kept.entry(number).calibrated_at.astimezone():%Y-%m-%d %H:%M}"
        say(self.message, *compared_text(Compared(number, made, metric)), hides=False)

    def _apply(self) -> None:
        kept, number = open_profile(self._folder), str(self.table.chosen)
        care, note, asked = kept.entry(number).care, "", ""
        if care:
            asked = "\n".join([care, self.tr("It is to be used with care. Why may it be put to use?")])
        elif kept.entry(number).contradicted:
            asked = self.tr("Its verification failed. Why may it be put to use?")
        elif not self._rows[number].verified:
            asked = self.tr("It was not verified. Why may it be put to use?")
        if asked:
            note, given = QInputDialog.getText(self, self.tr("Put this one to use"), asked)
            if not given or not note.strip():
                say(self.message, self.tr("It was not put to use: a reason is needed."), "caution", hides=False)
                return
        apply(kept, number, note)
        text = self.tr("Calibration {number} is in use now.").format(number=number)
        say(self.message, text, "good", hides=False)
        self._fill()
        self.applied.emit()


def _cells(row: ProfileRow) -> list[Cell | tuple[str, Cell, str]]:
    state, verdict = (row.state, row.state, row.level), (row.verdict, row.verdict, row.verdict_level)
    return [row.number, row.made, state, verdict, figure(row.rms_px, 3), ("✓" if row.in_use else "", "", "good")]
