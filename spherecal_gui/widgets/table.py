"""Tables that can be sorted by a click and read from a distance."""

from collections.abc import Sequence

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from spherecal_gui import languages, theme
from spherecal_gui.languages import Cell

_PADDING_PX, _ARROW_PX = 9.0, 14.0


class _Item(QTableWidgetItem):
    """Sorts by its value, not by its text."""

    def __lt__(self, other: QTableWidgetItem) -> bool:
        mine, theirs = self.data(Qt.ItemDataRole.UserRole), other.data(Qt.ItemDataRole.UserRole)
        if isinstance(mine, (int, float)) and isinstance(theirs, (int, float)):
            return mine < theirs
        return self.text() < other.text()


class _Headings(QHeaderView):
    """As wide as their longest line; Qt takes two lines for one, and keeps room for an arrow in every column."""

    def sectionSizeFromContents(self, index: int) -> QSize:
        """Width of the longest line with padding, height as Qt says."""
        size = super().sectionSizeFromContents(index)
        model = self.model()
        text = str(model.headerData(index, self.orientation()) or "") if model is not None else ""
        metrics = QFontMetricsF(theme.font(theme.BODY, bold=True))
        widest = max((metrics.horizontalAdvance(line) for line in text.split("\n")), default=0.0)
        arrow = _ARROW_PX if index == self.sortIndicatorSection() and self.isSortIndicatorShown() else 0.0
        return QSize(round(widest + 2 * _PADDING_PX + arrow), size.height())


class Table(QTableWidget):
    """A table that is only read; `spare`: columns that are left out in this order where there is no room for all."""

    def __init__(self, headings: Sequence[str], sortable: bool = True, spare: Sequence[int] = ()) -> None:
        super().__init__(0, len(headings))
        self._spare = tuple(spare)
        self.setHorizontalHeader(_Headings(Qt.Orientation.Horizontal, self))
        self.horizontalHeader().setSectionsClickable(sortable)
        self.setHorizontalHeaderLabels(list(headings))
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setAlternatingRowColors(True)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.verticalHeader().hide()
        self.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.horizontalHeader().setHighlightSections(False)
        self._sortable = sortable

    def fill(self, rows: Sequence[Sequence[Cell | tuple[str, Cell, str]]], sort_by: int | None = None) -> None:
        """Fill the table; the first cell names the row. A cell is a value, or its text, value and level."""
        self.setSortingEnabled(False)
        self.setRowCount(len(rows))
        for i, row in enumerate(rows):
            for j, cell in enumerate(row):
                text, value, level = cell if isinstance(cell, tuple) else (str(cell), cell, "")
                item = _Item(languages.by_locale(text))
                item.setData(Qt.ItemDataRole.UserRole, value)
                words = j == 0 or (isinstance(value, str) and value != "-")
                side = Qt.AlignmentFlag.AlignLeft if words else Qt.AlignmentFlag.AlignRight
                item.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
                if level in ("good", "caution", "bad"):
                    item.setForeground(QColor(theme.now().of(level)))
                self.setItem(i, j, item)
        # each heading over its column: at the side where the column's cells are written
        for column in range(self.columnCount()):
            cell, heading = self.item(0, column), self.horizontalHeaderItem(column)
            if cell is not None and heading is not None:
                side = Qt.AlignmentFlag(cell.textAlignment()) & Qt.AlignmentFlag.AlignHorizontal_Mask
                heading.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
        self.verticalHeader().setDefaultSectionSize(int(theme.pt(32)))
        self.horizontalHeader().setMinimumSectionSize(int(theme.pt(32)))  # Qt's own is the font's widest letter
        if self._sortable:
            order = Qt.SortOrder.AscendingOrder if sort_by is None else Qt.SortOrder.DescendingOrder
            self.horizontalHeader().setSortIndicator(sort_by or 0, order)
        self.setSortingEnabled(self._sortable)
        self._leave_out()

    def _leave_out(self) -> None:
        """Leave out as many columns as it takes for the others to be in sight."""
        for column in self._spare:
            self.setColumnHidden(column, False)
        wide = {
            column: max(self.sizeHintForColumn(column), self.horizontalHeader().sectionSizeHint(column))
            for column in range(self.columnCount())
        }
        for column in self._spare:
            if sum(wide.values()) <= self.viewport().width():
                return
            self.setColumnHidden(column, True)
            del wide[column]

    def resizeEvent(self, event: QResizeEvent) -> None:
        """There is room for more columns, or for fewer."""
        super().resizeEvent(event)
        self._leave_out()

    def name_of(self, row: int) -> str:
        """The name of a row."""
        item = self.item(row, 0)
        return item.text() if item is not None else ""

    @property
    def chosen(self) -> str | None:
        """The name of the row that is selected."""
        rows = self.selectionModel().selectedRows()
        return self.name_of(rows[0].row()) if rows else None

    def select_name(self, name: str) -> bool:
        """Select the row of this name; whether there is one."""
        row = next((row for row in range(self.rowCount()) if self.name_of(row) == name), None)
        if row is not None:
            self.selectRow(row)
        return row is not None
