"""The limits: seen by everybody, changed by the responsible person with a PIN."""

from dataclasses import replace
from html import escape
from pathlib import Path

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QDialog,
    QDoubleSpinBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QVBoxLayout,
    QWidget,
)

from spherecal_gui import theme
from spherecal_gui.presenters.limits import (
    LimitField,
    LimitsDesk,
    change_text,
    limit_fields,
    limit_problems,
    value_text,
)
from spherecal_gui.widgets.basic import Downwards, WheelGuard, button, enable, label, set_level
from spherecal_rigs.limits_file import MOST_PIN, Limits

_TICK_MS = 200
_HISTORY_PX = 120  # six lines
_SIZE = (940, 700)  # fits 1280 x 800 with the window's frame and a task bar


class LimitsDialog(QDialog):
    """The limits with their units, the lock, who has changed what; `changed` (lines of text) when some were saved."""

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
        column = QVBoxLayout(self)
        column.setSpacing(10)
        column.addLayout(self._head())
        column.addWidget(self._pin_row())
        self.message = label("")
        self.message.hide()
        column.addWidget(self.message)
        column.addWidget(self._scrolled(), 1)
        column.addLayout(self._buttons())
        self._timer = QTimer(self)
        self._timer.setInterval(_TICK_MS)
        self._timer.timeout.connect(self._tick)
        self.resize(*_SIZE)
        self.show_limits(self.desk.kept.limits)
        self._refresh()

    # --- parts -------------------------------------------------------------------------------------------------------

    def _head(self) -> QHBoxLayout:
        row = QHBoxLayout()
        self.state = label("", "big")
        self.unlock = button(self.tr("Unlock"), "unlock-limits")
        self.unlock.clicked.connect(self._ask_pin)
        row.addWidget(self.state, 1)
        row.addWidget(self.unlock)
        return row

    def _pin_row(self) -> QWidget:
        self.pin_box = QWidget()
        row = QGridLayout(self.pin_box)
        row.setContentsMargins(0, 0, 0, 0)
        self.name, self.pin, self.again = QLineEdit(), QLineEdit(), QLineEdit()
        self.name.setText(self.desk.last_name)
        for place, (field, text, name) in enumerate(
            (
                (self.name, self.tr("Your name"), "limits-name"),
                (self.pin, self.tr("PIN"), "limits-pin"),
                (self.again, self.tr("The PIN again"), "limits-pin-again"),
            )
        ):
            field.setObjectName(name)
            field.setAccessibleName(text)
            field.setMaxLength(MOST_PIN)
            field.returnPressed.connect(self._give_pin)
            caption = label(text, wrap=False)
            caption.setBuddy(field)
            row.addWidget(caption, 0, place)
            row.addWidget(field, 1, place)
            self.again_caption = caption  # of the last one
        for field in (self.pin, self.again):
            field.setEchoMode(QLineEdit.EchoMode.Password)
        self.give = button(self.tr("Unlock"), "give-pin")
        self.give.clicked.connect(self._give_pin)
        row.addWidget(self.give, 1, 3)
        self.pin_box.hide()
        return self.pin_box

    def _scrolled(self) -> QWidget:
        inner = QWidget()
        column = QVBoxLayout(inner)
        column.setContentsMargins(0, 0, 8, 0)
        grid = QGridLayout()
        grid.setColumnStretch(0, 1)
        grid.setHorizontalSpacing(18)
        for row, field in enumerate(limit_fields()):
            self._add_field(grid, 2 * row, field)
        column.addLayout(grid)
        self.profile = label("")
        set_level(self.profile, "caution")
        column.addWidget(self.profile)
        column.addWidget(label(self.tr("Changes"), "big", wrap=False))
        self.history = QPlainTextEdit()
        self.history.setReadOnly(True)
        self.history.setTabChangesFocus(True)
        self.history.setAccessibleName(self.tr("Changes"))
        self.history.setFixedHeight(round(theme.pt(_HISTORY_PX)))
        column.addWidget(self.history)
        self.honest = label(self.desk.honest_text(), "soft")
        column.addWidget(self.honest)
        column.addStretch(1)
        area = Downwards()
        area.setWidget(inner)
        return area

    def _add_field(self, grid: QGridLayout, row: int, field: LimitField) -> None:
        title = label(field.title)
        control = self._control(field)
        control.setObjectName(f"limit-{field.name}")
        control.setAccessibleName(f"{field.title} {field.unit}".strip())
        control.setMinimumWidth(round(theme.pt(150)))
        title.setBuddy(control)
        problem = label("")
        set_level(problem, "bad")
        problem.hide()
        grid.addWidget(title, row, 0)
        grid.addWidget(control, row, 1)
        grid.addWidget(problem, row + 1, 0, 1, 2)
        self.fields[field.name], self.problems[field.name] = control, problem

    def _control(self, field: LimitField) -> QDoubleSpinBox | QLineEdit | QCheckBox:
        if field.span is not None:
            number = QDoubleSpinBox()
            number.setDecimals(field.digits)
            number.setRange(*field.span)
            number.setSuffix(f" {field.unit}")
            number.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            number.installEventFilter(self._guard)
            number.valueChanged.connect(self._edited)
            return number
        if isinstance(getattr(Limits(), field.name), bool):
            box = QCheckBox(value_text(field.name, False))
            box.toggled.connect(lambda on: box.setText(value_text(field.name, on)))
            box.toggled.connect(self._edited)
            return box
        line = QLineEdit()
        line.setPlaceholderText("0.03+L/20000")
        line.setMaxLength(60)
        line.textChanged.connect(self._edited)
        return line

    def _buttons(self) -> QHBoxLayout:
        row = QHBoxLayout()
        self.delivered = button(self.tr("Back to the delivered values"), "delivered-limits")
        self.delivered.clicked.connect(lambda: self.show_limits(Limits()))
        self.save = button(self.tr("Save"), "save-limits")
        self.save.clicked.connect(self._save)
        self.close_button = button(self.tr("Close"), "close-limits")
        self.close_button.clicked.connect(self.accept)
        row.addWidget(self.delivered)
        row.addStretch(1)
        row.addWidget(self.save)
        row.addWidget(self.close_button)
        return row

    # --- values ------------------------------------------------------------------------------------------------------

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
            shown.setText(problems.get(name, ""))
            shown.setVisible(name in problems)
            self.fields[name].setAccessibleDescription(problems.get(name) or self._whys[name])
        news = self.limits != self.desk.kept.limits or bool(self.desk.profile_text())
        why = "" if self.desk.unlocked else self.desk.state_text()
        why = why or next(iter(problems.values()), "") or self.tr("Nothing was changed.")
        enable(self.save, self.desk.unlocked and news and not problems, why)
        unsaved = self.desk.unlocked and self.limits != self.desk.kept.limits
        self.close_button.setText(self.tr("Close without saving") if unsaved else self.tr("Close"))
        self.close_button.setAccessibleName(self.close_button.text())

    @property
    def _whys(self) -> dict[str, str]:
        locked = "" if self.desk.unlocked else f" {self.desk.state_text()}"
        return {field.name: f"{field.why}{locked}" for field in limit_fields()}

    def _refresh(self) -> None:
        """Locked or not."""
        desk = self.desk
        self.state.setText(desk.state_text())
        set_level(self.state, "bad" if desk.damage else "good" if desk.unlocked else "caution")
        self.unlock.setVisible(not desk.unlocked)
        enable(self.unlock, not desk.damage, desk.damage)
        whys = self._whys
        for name, field in self.fields.items():
            field.setEnabled(desk.unlocked)
            field.setToolTip(f"<qt>{escape(whys[name])}</qt>")  # so that it is folded into lines
        enable(self.delivered, desk.unlocked, desk.state_text())
        self.profile.setText(desk.profile_text())
        self.profile.setVisible(bool(self.profile.text()))
        lines = [change_text(one) for one in reversed(desk.kept.changes)]
        self.history.setPlainText("\n".join(lines) or self.tr("No limit was changed yet."))
        self._edited()

    def _save(self) -> None:
        said, problem = self.desk.save(self.limits)
        self._tell(problem or self.tr("Saved; the new limits apply from now on."), "bad" if problem else "good")
        self._refresh()
        self.changed.emit(said)

    # --- the lock ----------------------------------------------------------------------------------------------------

    def _ask_pin(self) -> None:
        """Show where name and PIN are given; where there is no PIN yet, it is chosen there."""
        first = not self.desk.has_pin
        for part in (self.again, self.again_caption):
            part.setVisible(first)
        self.give.setText(self.tr("Set this PIN") if first else self.tr("Unlock"))
        self.give.setAccessibleName(self.give.text())
        self.unlock.hide()
        self.pin_box.show()
        hint = self.tr("No PIN was set yet. The responsible person chooses one of four characters or more.")
        self._tell(hint if first else "", "none")
        (self.pin if self.name.text() else self.name).setFocus()
        self._timer.start()
        self._tick()

    def _give_pin(self) -> None:
        if self.desk.unlocked or self.desk.wait_s > 0:
            return
        problem = self.desk.unlock(self.name.text(), self.pin.text(), self.again.text())
        self._tell(problem, "bad")
        if problem:
            self.pin.selectAll()
            self.pin.setFocus()
            self._tick()
            return
        self._timer.stop()
        self.pin.clear()
        self.again.clear()
        self.pin_box.hide()
        self._refresh()
        next(iter(self.fields.values())).setFocus()

    def _tick(self) -> None:
        """After a wrong PIN the next is not looked at for a while; the window goes on."""
        waiting = self.desk.wait_s > 0
        if waiting:
            self._tell(self.desk.wait_text(), "bad")
        elif not self.give.isEnabled():
            self._tell("", "none")
        self.pin.setReadOnly(waiting)
        enable(self.give, not waiting, self.desk.wait_text() if waiting else "")

    def _tell(self, text: str, level: str) -> None:
        self.message.setText(text)
        self.message.setVisible(bool(text))
        set_level(self.message, level)

    def done(self, result: int) -> None:
        """Closed: locked again."""
        self._timer.stop()
        self.desk.lock()
        super().done(result)
