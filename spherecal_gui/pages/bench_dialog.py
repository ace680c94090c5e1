"""The bench editor: ball, bars with their certificates, placements and limits; the library of this computer."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QComboBox,
    QDialog,
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLineEdit,
    QMessageBox,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from spherecal_gui import limits_in_force as limits
from spherecal_gui.controllers.bench_desk import BenchDesk
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import translate
from spherecal_gui.pages.bench_bars_page import BarsTab
from spherecal_gui.presenters.bench_presenter import Problems, print_text, warnings
from spherecal_gui.widgets.basic import Downwards, add, button, enable, label, named, say, spaced
from spherecal_gui.widgets.fields import TextField, show_fields


class BallTab(QWidget):
    """One ball of the library, or a new one."""

    def __init__(self, desk: BenchDesk) -> None:
        super().__init__()
        self.desk = desk
        inner = QWidget()
        grid = spaced(QGridLayout(), 18, 12)
        self.fields = {
            "name": TextField("ball-name", self.tr("Name of the ball"), self.tr("such as Ball hall 3")),
            "diameter": TextField(
                "ball-diameter", self.tr("Diameter (mm)"), "500", self.tr("A centimetre is near enough.")
            ),
            "first": TextField("ball-first", self.tr("First target, no.")),
            "last": TextField("ball-last", self.tr("Last target, no.")),
            "width": TextField("ball-width", self.tr("Width of a sticker (mm)"), "28"),
            "measured": TextField("ball-measured", self.tr("Measured on a sticker (mm)")),
        }
        grid.addWidget(self.fields["name"], 0, 0, 1, 2)
        grid.addWidget(self.fields["diameter"], 0, 2)
        for at, key in enumerate(("first", "last", "width")):
            grid.addWidget(self.fields[key], 1, at)
            grid.setColumnStretch(at, 1)
        self.print_said = label("")
        line = add(QHBoxLayout(), (self.fields["measured"], 1), None, None)
        title = label(self.tr("Printed scale"), "big", wrap=False)
        message = self.tr("Without a bar that gives the scale, this distance does, good to a percent.")
        self.library = named(QComboBox(), "ball-library", self.tr("Ball of the library"))
        # the one that was typed is one step back
        self.library.activated.connect(lambda _: desk.take_ball(str(self.library.currentData())))
        which = add(QHBoxLayout(), label(self.tr("Which ball?"), "big", wrap=False), (self.library, 1), None)
        column = add(spaced(QVBoxLayout(inner), 12), which, grid, self._own(), title, self.print_said, line)
        add(column, label(message, "soft"), None)
        for key, one in self.fields.items():
            one.line.textEdited.connect(partial(self._edited, key))
        QVBoxLayout(self).addWidget(Downwards(inner))

    def _own(self) -> QHBoxLayout:
        """Targets that are not simply numbered."""
        self.own = label("", "soft")
        self.from_file = button(self.tr("Targets from a file"), "targets-file", act=self._choose_targets)
        self.by_number = button(self.tr("By number and width"), "targets-number", act=self.desk.own_targets)
        return add(QHBoxLayout(), self.from_file, self.by_number, (self.own, 1))

    def _choose_targets(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, self.tr("Target set"), "", "targets.json (*.json)")
        if path:
            self.take_targets(Path(path))

    def take_targets(self, path: Path) -> None:
        """The target set of a file."""
        if problem := self.desk.take_targets(path):
            say(self.own, problem, "bad", hides=False)

    def _edited(self, key: str, text: str) -> None:
        draft = self.desk.draft
        self.desk.change(f"ball.{key}", replace(draft, ball=replace(draft.ball, **{key: text})))

    def show_draft(self, problems: Problems) -> None:
        """What the draft has, and what is wrong with it."""
        ball = self.desk.draft.ball
        show_fields(self.fields, ball, problems, "ball.")
        for key in ("first", "last", "width"):
            self.fields[key].line.setEnabled(ball.own is None)
        say(self.own, ball.own_file, hides=False)
        self.by_number.setVisible(ball.own is not None)
        say(self.print_said, *print_text(ball), hides=False)
        wanted = [self.tr("a new ball"), *self.desk.balls]
        if wanted != [self.library.itemText(i) for i in range(self.library.count())]:
            self.library.clear()
            for number, name in enumerate(wanted):
                self.library.addItem(name, "" if number == 0 else name)
        known = self.desk.balls.get(self.desk.draft.ball.name.strip())
        self.library.setCurrentIndex(0 if known is None else max(self.library.findData(known.name), 0))


class RigTab(QWidget):
    """How many placements, the bars' temperature, the limits."""

    def __init__(self, desk: BenchDesk) -> None:
        super().__init__()
        self.desk = desk
        self.fields = {
            "placements": TextField("placements", self.tr("Placements of the ball"), "4"),
            "celsius": TextField("bars-celsius", self.tr("Bars' temperature (°C)"), "20.0"),
        }
        self.fields["celsius"].line.setToolTip(self.tr("Read it on the day, on the bar itself; empty: not read."))
        for key, one in self.fields.items():
            one.line.textEdited.connect(partial(self._edited, key))
        row = add(QHBoxLayout(), *((one, 1) for one in self.fields.values()), None)
        self.limit = label("")
        self.open_limits = button(self.tr("Open the limits"), "open-limits")
        line = add(QHBoxLayout(), self.open_limits, None)
        title = label(self.tr("Limits"), "big", wrap=False)
        add(spaced(QVBoxLayout(self), 12), row, title, self.limit, line, None)

    def _edited(self, key: str, text: str) -> None:
        self.desk.change(key, replace(self.desk.draft, **{key: text}))

    def show_draft(self, problems: Problems) -> None:
        """What the draft has."""
        show_fields(self.fields, self.desk.draft, problems)
        formula = limits.now().verification_limit
        message = self.tr("Permitted length error: {limit} mm (L in mm).").format(limit=formula)
        none = self.tr("No permitted length error is set: lengths are judged by their own uncertainty.")
        self.limit.setText(message if formula else none)


_SIZE = (1180, 720)  # fits 1280 x 800 with the window's frame and a task bar
_MOST_LINES = 6  # lines of an import that are shown; the dialog must not outgrow the screen


class BenchDialog(QDialog):
    """`saved` (the bench's file, empty where only the library was changed) once it is on disk."""

    saved = Signal(str)
    limits_wanted = Signal()

    def __init__(self, desk: BenchDesk, parent: QWidget | None = None, holds: str = "") -> None:
        """`holds` says for what the bench counts once it is saved."""
        super().__init__(parent)
        self.desk, self._holds = desk, holds
        self.setWindowTitle(self.tr("The bench: ball, bars, limits"))
        self.message, self.summary = label("", hidden=True), label("")
        self.tabs = QTabWidget()
        self.ball, self.bars, self.rig = BallTab(desk), BarsTab(desk), RigTab(desk)
        self.tabs.addTab(self.ball, self.tr("Ball"))
        self.tabs.addTab(self.bars, self.tr("Bars"))
        self.tabs.addTab(self.rig, self.tr("Placements and limits"))
        self.bars.said.connect(self._tell)
        self.rig.open_limits.clicked.connect(self.limits_wanted)
        add(QVBoxLayout(self), self.message, (self.tabs, 1), self.summary, self._buttons())
        self.resize(*_SIZE)
        self._watch()
        if desk.trouble:
            self._tell(desk.trouble, "bad")
        desk.on_change = self.show_draft
        self.show_draft()

    def _buttons(self) -> QHBoxLayout:
        self.undo = button(self.tr("Undo"), "undo-bench", act=self.desk.undo)
        self.redo = button(self.tr("Redo"), "redo-bench", act=self.desk.redo)
        self.undo.setToolTip(QKeySequence(QKeySequence.StandardKey.Undo).toString())
        self.save = button(self.tr("Save"), "save-bench", "primary", act=self.save_bench)
        self.close_button = button(self.tr("Close"), "close-bench", act=self.reject)
        return add(QHBoxLayout(), self.undo, self.redo, None, self.save, self.close_button)

    def _watch(self) -> None:
        """Ctrl+Z goes one step back in the bench, not in the one field; Enter goes to the next field."""
        for line in self.findChildren(QLineEdit):
            line.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Whether the key means the whole dialog, and goes no further."""
        if event.type() in (QEvent.Type.KeyPress, QEvent.Type.ShortcutOverride) and isinstance(event, QKeyEvent):
            return self._heard(event) or super().eventFilter(watched, event)
        return super().eventFilter(watched, event)

    def _heard(self, event: QKeyEvent) -> bool:
        """Whether the key means the whole dialog; it does what it means once it is pressed, not only announced."""
        keys = QKeySequence.StandardKey
        for standard, act in ((keys.Undo, self.desk.undo), (keys.Redo, self.desk.redo), (keys.Save, self.save_bench)):
            if event.matches(standard):
                if event.type() == QEvent.Type.KeyPress:
                    act()
                event.accept()
                return True
        return False

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """The same keys where no field has the focus; Enter never closes."""
        if self._heard(event):
            return
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.focusNextChild()
        else:
            super().keyPressEvent(event)

    def show_draft(self) -> None:
        """The draft as it is, and what is wrong with it."""
        desk = self.desk
        _, problems = desk.checked()
        for tab in (self.ball, self.bars, self.rig):
            tab.show_draft(problems)
        self._watch()  # rows of lengths are made as they are needed
        enable(self.undo, bool(desk.past), self.tr("Nothing was changed."))
        enable(self.redo, bool(desk.future), self.tr("Nothing was undone."))
        for at, parts in enumerate((("ball.",), ("bar.",), ("placements", "celsius"))):
            wrong = any(key.startswith(parts) for key in problems)
            self.tabs.setTabText(at, f"{self.tabs.tabText(at).removesuffix(' ✕')}{' ✕' if wrong else ''}")
        known = warnings(desk.draft)
        if problems:
            message = self.tr("To be corrected before saving: {count}").format(count=len(problems))
            say(self.summary, message, "bad", hides=False)
        elif desk.draft.ball.empty:
            say(self.summary, self.tr("No ball is described: only the library of bars is saved."), hides=False)
        else:
            say(self.summary, " ".join(known) or self._holds, "caution" if known else "none", hides=False)
        why = next(iter(problems.values()), "") or self.tr("Nothing was changed.")
        enable(self.save, not problems and (desk.changed or not desk.draft.ball.empty), why)
        self.close_button.setText(self.tr("Close without saving") if desk.changed else self.tr("Close"))
        self.close_button.setAccessibleName(self.close_button.text())

    def _tell(self, text: str, level: str) -> None:
        lines = text.splitlines()
        more = self.tr("and {count} more").format(count=len(lines) - _MOST_LINES)
        say(self.message, "\n".join(lines if len(lines) <= _MOST_LINES else [*lines[:_MOST_LINES], more]), level)
        self.message.setToolTip("" if len(lines) <= _MOST_LINES else text)

    def save_bench(self) -> bool:
        """Write library and bench; whether that was done."""
        if not self.save.isEnabled():
            return False
        path, problem = self.desk.save()
        if problem:
            self._tell(problem, "bad")
            self.show_draft()
            return False
        self._tell(self.tr("Saved. {holds}").format(holds=self._holds).strip(), "good")
        self.show_draft()
        self.saved.emit(str(path) if path is not None else "")
        return True

    def reject(self) -> None:
        """Closing never loses what was typed without asking."""
        if not self.desk.changed:
            super().reject()
            return
        box = QMessageBox(self)
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        box.setIcon(QMessageBox.Icon.Question)
        box.setText(self.tr("Something was changed and is not saved."))
        save = box.addButton(self.tr("Save"), QMessageBox.ButtonRole.AcceptRole)
        drop = box.addButton(self.tr("Do not save"), QMessageBox.ButtonRole.DestructiveRole)
        stay = box.addButton(self.tr("Go on editing"), QMessageBox.ButtonRole.RejectRole)
        save.setEnabled(self.save.isEnabled())
        for one, name in ((save, "ask-save"), (drop, "ask-drop"), (stay, "ask-stay")):
            one.setProperty("key", name)
        box.setDefaultButton(stay)
        box.setEscapeButton(stay)
        box.finished.connect(lambda _: self._asked(box.clickedButton() is save, box.clickedButton() is drop))
        box.open()

    def _asked(self, save: bool, drop: bool) -> None:
        if drop or (save and self.save_bench()):
            super().reject()


def _holds(controller: Controller) -> str:
    project = controller.project
    if project is not None and project.simulated:
        return translate("Bench", "It holds for the real rig, not for this training.")
    if project is not None and project.taken:
        return translate("Bench", "It applies to the next calibration: this one already has images.")
    if project is not None:
        return translate("Bench", "It holds for this calibration and the next ones.")
    return translate("Bench", "It applies to the next calibrations of this rig.")


def show_bench(controller: Controller, projects: Path, window: QWidget) -> BenchDialog:
    """The editor with what is on the bench now, as far as it is known."""
    project, connection = controller.project, controller.cameras.connection
    real = project is not None and not project.simulated and connection is not None
    plan = connection.plan if real and connection is not None and connection.plan.target_set is not None else None
    folder = project.folder.parent if project is not None else projects
    dialog = BenchDialog(BenchDesk(folder, plan), window, _holds(controller))

    def saved(path: str) -> None:
        now = controller.project
        controller.note(translate("Log", "bench saved: {file}").format(file=path or dialog.desk.library))
        if path and now is not None and not now.simulated and not now.taken and controller.runner.running is None:
            controller.cameras.choose_bench(path)
        controller.changed.emit()

    dialog.saved.connect(saved)
    dialog.open()
    return dialog
