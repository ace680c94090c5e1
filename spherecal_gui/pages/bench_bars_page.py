"""The bars of the library: marks, certified lengths, certificate, and what each is for on this bench."""

from dataclasses import fields, replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QComboBox,
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QVBoxLayout,
    QWidget,
)

from spherecal_gui.controllers.bench_desk import BenchDesk
from spherecal_gui.languages import word
from spherecal_gui.presenters.bench_presenter import BarDraft, LengthDraft, Problems, certificate_state
from spherecal_gui.widgets.basic import (
    MARKS,
    Downwards,
    WheelGuard,
    add,
    bare,
    button,
    clear,
    label,
    named,
    say,
    spaced,
)
from spherecal_gui.widgets.fields import TextField, show_fields

_COLUMNS = tuple(one.name for one in fields(LengthDraft))
_LIST_PX = 330
_MARK_PX, _STICKER_PX = 64, 76


class BarsTab(QWidget):
    """A list on the left, the chosen bar on the right."""

    said = Signal(str, str)  # text, level

    def __init__(self, desk: BenchDesk) -> None:
        super().__init__()
        self.desk, self.chosen = desk, 0
        self._rows: list[dict[str, QLineEdit]] = []
        self._row_problems: list[QLabel] = []
        self.form = self._form()
        add(spaced(QHBoxLayout(self), 18), self._left(), (self.form, 1))

    def _left(self) -> QVBoxLayout:
        self.list = named(QListWidget(), "bars", self.tr("Bars of this computer"))
        self.list.setMinimumWidth(_LIST_PX)
        self.list.setWordWrap(True)
        self.list.currentRowChanged.connect(self._choose)
        grid = QGridLayout()
        self.add = button(self.tr("New bar"), "add-bar", act=self.add_bar)
        self.remove = button(self.tr("Remove"), "remove-bar", act=self._remove)
        self.take_table = button(self.tr("Import CSV"), "import-bars", act=self._import)
        self.give_table = button(self.tr("Export CSV"), "export-bars", act=self._export)
        for number, one in enumerate((self.add, self.remove, self.take_table, self.give_table)):
            grid.addWidget(one, number // 2, number % 2)
        title = label(self.tr("Bars of this computer"), "big", wrap=False)
        return add(QVBoxLayout(), title, (self.list, 1), grid)

    def _form(self) -> QWidget:
        inner = QWidget()
        grid = spaced(QGridLayout(), 14, 8)
        day, materials = self.tr("2026-11-21"), self.tr("Steel 11.5, aluminium 23, carbon fibre about 0.")
        self.fields = {
            "serial": TextField("bar-serial", self.tr("Serial number")),
            "description": TextField("bar-description", self.tr("Description")),
            "expansion": TextField("bar-expansion", self.tr("Expansion (10⁻⁶/K)"), "11.5", materials),
            "reference": TextField("bar-reference", self.tr("Lengths are valid at (°C)"), "20"),
            "certificate": TextField("bar-certificate", self.tr("Certificate, no.")),
            "laboratory": TextField("bar-laboratory", self.tr("Laboratory")),
            "issued": TextField("bar-issued", self.tr("Calibrated on"), day),
            "valid_until": TextField("bar-valid-until", self.tr("Valid until"), day),
        }
        self.role = named(QComboBox(), "bar-role", self.tr("On this bench"))
        self.role.addItem(self.tr("is not here"), "none")
        self.role.addItem(self.tr("gives the scale"), "scale")
        self.role.addItem(self.tr("verifies"), "check")
        self.role.activated.connect(lambda _: self._put("", role=str(self.role.currentData())))
        self.role.installEventFilter(WheelGuard(self.role))
        self.role_problem = label("", level="bad")
        role = QWidget()
        title = label(self.tr("On this bench"), wrap=False)
        add(bare(QVBoxLayout(role), 2), title, self.role, self.role_problem, None)
        grid.addWidget(self.fields["serial"], 0, 0)
        grid.addWidget(self.fields["description"], 0, 1, 1, 2)
        grid.addWidget(role, 0, 3)
        for at in range(4):
            grid.setColumnStretch(at, 1)
        self.lengths = QGridLayout()
        self.lengths.setHorizontalSpacing(6)
        self.lengths_problem = label("", level="bad")
        self.more = button(self.tr("Add a length"), "add-length", act=self._more)
        self.state = label("", "big")
        head = add(QHBoxLayout(), label(self.tr("Certificate and material"), "big", wrap=False), (self.state, 1))
        below = spaced(QGridLayout(), 14, 8)
        for at, key in enumerate(("certificate", "laboratory", "issued", "valid_until", "expansion", "reference")):
            below.addWidget(self.fields[key], at // 4, at % 4)
        title = label(self.tr("Certified lengths (mm)"), "big", wrap=False)
        column = add(spaced(QVBoxLayout(inner), 10), grid, title, self.lengths, self.lengths_problem)
        add(column, add(QHBoxLayout(), self.more, None), head, below, None)
        for key, one in self.fields.items():
            one.line.textEdited.connect(lambda text, key=key: self._put(key, **{key: text}))
        return Downwards(inner)

    @property
    def bar(self) -> BarDraft | None:
        """The chosen bar."""
        bars = self.desk.draft.bars
        return bars[self.chosen] if 0 <= self.chosen < len(bars) else None

    def _put(self, what: str, **changes: Any) -> None:
        """Change the chosen bar; typing on at the same `what` is one step of undo."""
        if self.bar is not None:
            bars = list(self.desk.draft.bars)
            bars[self.chosen] = replace(self.bar, **changes)
            self.desk.change(f"bar.{self.chosen}.{what}" if what else "", replace(self.desk.draft, bars=tuple(bars)))

    def _length_edited(self, number: int, key: str, text: str) -> None:
        if self.bar is not None:
            lengths = list(self.bar.lengths)
            lengths[number] = replace(lengths[number], **{key: text})
            self._put(f"length.{number}.{key}", lengths=tuple(lengths))

    def _more(self) -> None:
        if self.bar is not None:
            last = self.bar.lengths[-1] if self.bar.lengths else LengthDraft()
            another = LengthDraft(last.from_mark, last.from_sticker, factor=last.factor)
            self._put("", lengths=(*self.bar.lengths, another))
            self._rows[-1]["to_mark"].setFocus()

    def _less(self, number: int) -> None:
        if self.bar is not None:
            self._put("", lengths=self.bar.lengths[:number] + self.bar.lengths[number + 1 :])

    def add_bar(self) -> None:
        """A new bar, to be filled in."""
        self.chosen = len(self.desk.draft.bars)
        self.desk.add_bar()
        self.fields["serial"].line.setFocus()

    def _remove(self) -> None:
        if self.bar is not None:
            gone, self.chosen = self.chosen, max(self.chosen - 1, 0)
            self.desk.remove_bar(gone)

    def _import(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, self.tr("A table of bars"), "", "CSV (*.csv *.txt *.tsv)")
        if path:
            self.import_table(Path(path))

    def import_table(self, path: Path) -> None:
        """Take over the bars of a table, and say what became of each line."""
        found = self.desk.import_table(path)
        if isinstance(found, str):
            self.said.emit(found, "bad")
            return
        if found.entered:
            self._choose([one.serial for one in self.desk.draft.bars].index(found.entered[0]))
        self.said.emit(found.text, "caution" if found.lines or found.other else "good")

    def _export(self) -> None:
        path, _ = QFileDialog.getSaveFileName(self, self.tr("A table of bars"), "bars.csv", "CSV (*.csv)")
        if path:
            problem = self.desk.export_table(Path(path))
            text = problem or self.tr("The table is in {file}.").format(file=path)
            self.said.emit(text, "bad" if problem else "good")

    def _choose(self, row: int) -> None:
        if row >= 0 and row != self.chosen:
            self.chosen = row
            self.desk.on_change()

    def show_draft(self, problems: Problems) -> None:
        """The list, and the chosen bar."""
        bars = self.desk.draft.bars
        self.chosen = min(self.chosen, max(len(bars) - 1, 0))
        self._show_list(problems)
        bar = self.bar
        self.form.setVisible(bar is not None)
        self.remove.setEnabled(bar is not None)
        if bar is None:
            return
        place = f"bar.{self.chosen}."
        show_fields(self.fields, bar, problems, place)
        self.role.setCurrentIndex(self.role.findData(bar.role))
        say(self.role_problem, problems.get(f"{place}role", ""), "bad")
        self._show_lengths(bar, problems, place)
        say(self.lengths_problem, problems.get(f"{place}lengths", ""), "bad")
        text, level = certificate_state(bar, date.today())
        say(self.state, f"{MARKS[level]} {text}", level)

    def _show_list(self, problems: Problems) -> None:
        self.list.blockSignals(True)
        bars = self.desk.draft.bars
        while self.list.count() > len(bars):
            self.list.takeItem(self.list.count() - 1)
        roles = {"scale": self.tr("gives the scale"), "check": self.tr("verifies"), "none": ""}
        for number, bar in enumerate(bars):
            item = self.list.item(number)
            if item is None:
                item = QListWidgetItem()
                self.list.addItem(item)
            wrong = any(key.startswith(f"bar.{number}.") for key in problems)
            text, level = certificate_state(bar, date.today())
            mark = MARKS["bad"] if wrong else MARKS[level]
            nominal = next((one.nominal or one.certified for one in bar.lengths if one.nominal or one.certified), "")
            size = f"  ·  {nominal} mm" if nominal else ""
            serial = bar.serial or self.tr("new bar")  # not within the f-string: lupdate does not look there
            state = self.tr("something is missing") if wrong else text
            item.setText(f"{mark} {serial}{size}\n    {' · '.join(one for one in (roles[bar.role], state) if one)}")
        self.list.setCurrentRow(self.chosen if bars else -1)
        self.list.blockSignals(False)

    def _show_lengths(self, bar: BarDraft, problems: Problems, place: str) -> None:
        if len(self._rows) != len(bar.lengths):
            self._make_rows(len(bar.lengths))
        for number, length in enumerate(bar.lengths):
            said = []
            for key in _COLUMNS:
                line, text = self._rows[number][key], getattr(length, key)
                if line.text() != text:
                    line.setText(text)
                problem = problems.get(f"{place}length.{number}.{key}", "")
                line.setAccessibleDescription(problem)
                if problem:
                    said.append(f"{line.accessibleName()}: {problem}")
            say(self._row_problems[number], "\n".join(f"✕ {one}" for one in said), "bad")

    def _make_rows(self, count: int) -> None:
        clear(self.lengths)
        self._rows, self._row_problems = [], []
        titles = {key: word("bar-columns", key) for key in _COLUMNS}
        examples = {"from_sticker": "201", "to_sticker": "202", "nominal": "500", "certified": "500.012",
                    "uncertainty": "0.004", "factor": "2"}  # fmt: skip
        wide = {"nominal": 3, "certified": 3, "uncertainty": 2}
        for at, (key, title) in enumerate(titles.items()):
            self.lengths.addWidget(label(title, "soft", wrap=False), 0, at)
            self.lengths.setColumnStretch(at, wide.get(key, 1))
        for number in range(count):
            row: dict[str, QLineEdit] = {}
            for at, key in enumerate(_COLUMNS):
                line = QLineEdit(placeholderText=examples.get(key, ""))
                named(line, f"length-{number}-{key}", titles[key])
                line.setMinimumWidth(_MARK_PX if key.endswith("mark") or key == "factor" else _STICKER_PX)
                line.textEdited.connect(partial(self._length_edited, number, key))
                self.lengths.addWidget(line, 2 * number + 1, at)
                row[key] = line
            gone = button("✕", f"remove-length-{number}", tip=self.tr("Remove this length"))
            gone.setAccessibleName(gone.toolTip())
            gone.clicked.connect(lambda _=False, number=number: self._less(number))
            self.lengths.addWidget(gone, 2 * number + 1, len(_COLUMNS), alignment=Qt.AlignmentFlag.AlignTop)
            below = label("", level="bad")
            self.lengths.addWidget(below, 2 * number + 2, 0, 1, len(_COLUMNS) + 1)
            self._rows.append(row)
            self._row_problems.append(below)
