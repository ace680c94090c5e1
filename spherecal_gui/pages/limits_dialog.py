"""The limits, which the responsible person of the rig sets."""

from dataclasses import replace
from html import escape
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QDialog,
    QDoubleSpinBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QVBoxLayout,
    QWidget,
)

from spherecal_gui import theme
from spherecal_gui.languages import word
from spherecal_gui.presenters.limits_presenter import SPANS, LimitsDesk, limit_problems, value_text
from spherecal_gui.widgets.basic import Downwards, WheelGuard, add, button, enable, label, named, say, spaced
from spherecal_gui.widgets.fields import number_field
from spherecal_rigs.limits_file import Limits

_SIZE = (940, 540)  # fits 1280 x 800 from afar as well


class LimitsDialog(QDialog):
    """The limits with their units; `changed` (lines of text) when some were saved."""

    changed = Signal(list)

    def __init__(self, profile: Path, parent: QWidget | None = None, desk: LimitsDesk | None = None) -> None:
        super().__init__(parent)
        self.desk = desk or LimitsDesk(profile)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("Limits"))
        self.fields: dict[str, QDoubleSpinBox | QLineEdit | QCheckBox] = {}
        self.problems: dict[str, QLabel] = {}
        self._given: dict[str, tuple[float, float]] = {}
        self._filling = True  # the fields are being made or filled
        self._guard = WheelGuard(self)
        self.state, self.message = label(""), label("", hidden=True)
        add(spaced(QVBoxLayout(self), 10), self.state, self.message, (self._scrolled(), 1), self._buttons())
        self.resize(*_SIZE)
        self.show_limits(self.desk.kept)
        self._refresh()

    def _scrolled(self) -> QWidget:
        inner = QWidget()
        column = QVBoxLayout(inner)
        column.setContentsMargins(0, 0, 8, 0)
        grid = QGridLayout()
        grid.setColumnStretch(0, 1)
        grid.setHorizontalSpacing(18)
        for row, name in enumerate(SPANS):
            self._add_field(grid, 2 * row, name)
        self.profile = label("", level="caution")
        add(column, grid, self.profile, None)
        return Downwards(inner)

    def _add_field(self, grid: QGridLayout, row: int, name: str) -> None:
        title, control = label(word("limits", name)), self._control(name)
        named(control, f"limit-{name}", f"{title.text()} {word('limit-units', name)}".strip())
        control.setMinimumWidth(round(theme.pt(150)))
        title.setBuddy(control)
        problem = label("", level="bad", hidden=True)
        grid.addWidget(title, row, 0)
        grid.addWidget(control, row, 1)
        grid.addWidget(problem, row + 1, 0, 1, 2)
        self.fields[name], self.problems[name] = control, problem

    def _control(self, name: str) -> QDoubleSpinBox | QLineEdit | QCheckBox:
        span, digits = SPANS[name]
        if span is not None:
            number = number_field("", "", span, word("limit-units", name), digits)
            number.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            number.installEventFilter(self._guard)
            number.valueChanged.connect(self._edited)
            return number
        if isinstance(getattr(Limits(), name), bool):
            box = QCheckBox(value_text(name, False))
            box.toggled.connect(lambda on: box.setText(value_text(name, on)))
            box.toggled.connect(self._edited)
            return box
        line = QLineEdit(placeholderText="0.03+L/20000", maxLength=60)
        line.textChanged.connect(self._edited)
        return line

    def _buttons(self) -> QHBoxLayout:
        self.delivered = button(self.tr("Back to the delivered values"), "delivered-limits")
        self.delivered.clicked.connect(lambda: self.show_limits(Limits()))
        self.save = button(self.tr("Save"), "save-limits", act=self._save)
        self.close_button = button(self.tr("Close"), "close-limits", act=self.accept)
        return add(QHBoxLayout(), self.delivered, None, self.save, self.close_button)

    @property
    def limits(self) -> Limits:
        """As the fields have them."""
        found: dict[str, object] = {}
        for name, field in self.fields.items():
            if isinstance(field, QDoubleSpinBox):
                value, shown = self._given[name]  # the field rounds: what nobody has changed stays as it was given
                found[name] = value if field.value() == shown else type(value)(field.value())
            else:
                found[name] = field.isChecked() if isinstance(field, QCheckBox) else field.text().strip()
        return replace(Limits(), **found)

    def show_limits(self, limits: Limits) -> None:
        """Put values into the fields; they hold when they are saved."""
        self._filling = True
        for name, field in self.fields.items():
            value = getattr(limits, name)
            if isinstance(field, QDoubleSpinBox):
                field.setValue(value)
                self._given[name] = (value, field.value())
            elif isinstance(field, QCheckBox):
                field.setChecked(value)
            else:
                field.setText(value)
        self._filling = False
        self._edited()

    def _edited(self) -> None:
        if self._filling:
            return
        problems = limit_problems(self.limits)
        for name, shown in self.problems.items():
            say(shown, problems.get(name, ""), "bad")
            self.fields[name].setAccessibleDescription(problems.get(name) or self._why(name))
        unsaved = self.limits != self.desk.kept
        news = unsaved or bool(self.desk.profile_text())
        why = self.desk.damage or next(iter(problems.values()), "") or self.tr("Nothing was changed.")
        enable(self.save, news and not problems and not self.desk.damage, why)
        self.close_button.setText(self.tr("Close without saving") if unsaved else self.tr("Close"))
        self.close_button.setAccessibleName(self.close_button.text())

    def _why(self, name: str) -> str:
        return " ".join((word("limit-reasons", name), self.desk.damage)).strip()

    def _refresh(self) -> None:
        """As the file is: saved, or damaged."""
        desk = self.desk
        say(self.state, desk.state_text(), "bad" if desk.damage else "none")
        for name, field in self.fields.items():
            field.setEnabled(not desk.damage)
            field.setToolTip(f"<qt>{escape(self._why(name))}</qt>")  # so that it is folded into lines
        enable(self.delivered, not desk.damage, desk.damage)
        say(self.profile, desk.profile_text(), "caution")
        self._edited()

    def _save(self) -> None:
        said, problem = self.desk.save(self.limits)
        saved = self.tr("Saved; the new limits apply from now on.")
        say(self.message, problem or saved, "bad" if problem else "good")
        self._refresh()
        self.changed.emit(said)
