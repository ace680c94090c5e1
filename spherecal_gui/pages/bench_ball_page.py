"""The ball, its targets and the check of their print; placements and limits of the bench."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QFileDialog, QGridLayout, QHBoxLayout, QVBoxLayout, QWidget

from spherecal_gui import limits_in_force as limits
from spherecal_gui.controllers.bench_desk import BenchDesk
from spherecal_gui.presenters.bench_presenter import Problems, print_text
from spherecal_gui.widgets.basic import Downwards, add, button, label, named, say, spaced
from spherecal_gui.widgets.fields import TextField


class BallTab(QWidget):
    """One ball of the library, or a new one."""

    touched = Signal()

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
        self.library.activated.connect(self._chosen)
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
        self.by_number = button(self.tr("By number and width"), "targets-number", act=self._number_targets)
        return add(QHBoxLayout(), self.from_file, self.by_number, (self.own, 1))

    def _number_targets(self) -> None:
        self.desk.own_targets()
        self.touched.emit()

    def _chosen(self) -> None:
        """Another ball of the library; the one that was typed is one step back."""
        self.desk.take_ball(str(self.library.currentData()))
        self.touched.emit()

    def _choose_targets(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, self.tr("Target set"), "", "targets.json (*.json)")
        if path:
            self.take_targets(Path(path))

    def take_targets(self, path: Path) -> None:
        """The target set of a file."""
        problem = self.desk.take_targets(path)
        self.touched.emit()
        if problem:
            say(self.own, problem, "bad", hides=False)

    def _edited(self, key: str, text: str) -> None:
        draft = self.desk.draft
        self.desk.change(f"ball.{key}", replace(draft, ball=replace(draft.ball, **{key: text})))
        self.touched.emit()

    def show_draft(self, problems: Problems) -> None:
        """What the draft has, and what is wrong with it."""
        ball = self.desk.draft.ball
        for key, one in self.fields.items():
            one.show_text(getattr(ball, key))
            one.show_problem(problems.get(f"ball.{key}", ""))
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

    touched = Signal()
    limits_wanted = Signal()

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
        self.open_limits = button(self.tr("Open the limits"), "open-limits", act=self.limits_wanted)
        line = add(QHBoxLayout(), self.open_limits, None)
        title = label(self.tr("Limits"), "big", wrap=False)
        add(spaced(QVBoxLayout(self), 12), row, title, self.limit, line, None)

    def _edited(self, key: str, text: str) -> None:
        self.desk.change(key, replace(self.desk.draft, **{key: text}))
        self.touched.emit()

    def show_draft(self, problems: Problems) -> None:
        """What the draft has."""
        for key, one in self.fields.items():
            one.show_text(getattr(self.desk.draft, key))
            one.show_problem(problems.get(key, ""))
        formula = limits.now().verification_limit
        message = self.tr("Permitted length error: {limit} mm (L in mm).").format(limit=formula)
        none = self.tr("No permitted length error is set: lengths are judged by their own uncertainty.")
        self.limit.setText(message if formula else none)
