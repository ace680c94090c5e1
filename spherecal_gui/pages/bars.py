"""Bars: the poses of the bar that gives the scale, and the verification by a check bar."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QHBoxLayout, QLabel, QSplitter, QVBoxLayout, QWidget

from spherecal_gui.pages.base import PageAction
from spherecal_gui.pages.live_page import LivePage
from spherecal_gui.presenters.bars import errors_of, length_cells, next_pose, pose_state
from spherecal_gui.presenters.results import bar_verdict
from spherecal_gui.widgets.basic import MARKS, Card, button, clear, enable, label, set_level
from spherecal_gui.widgets.charts import ErrorChart
from spherecal_gui.widgets.table import Table
from spherecal_gui.widgets.tile import Wall
from spherecal_gui.wizard.controller import Controller
from spherecal_gui.workflow import Status, Step


class ScalePage(LivePage):
    """The poses of one role of bars, one after the other."""

    def __init__(self, controller: Controller, parent: QWidget | None = None) -> None:
        super().__init__(controller, parent)
        self.column = QVBoxLayout(self)
        self.told = label("", "huge")
        self.column.addWidget(self.told)
        self.poses = QHBoxLayout()
        self.poses.setSpacing(18)
        self.column.addLayout(self.poses)
        self.wall = Wall()
        self.column.addWidget(self.wall, 1)
        row = QHBoxLayout()
        self.again = button(self.tr("Take the last pose again"), "retake-pose")
        self.again.clicked.connect(self._retake)
        row.addStretch(1)
        row.addWidget(self.again)
        self.column.addLayout(row)
        self._last: str | None = None

    def pose_ids(self) -> tuple[str, ...]:
        """The poses of this page."""
        return self.project.scale_poses if self.project is not None else ()

    @property
    def current(self) -> str | None:
        """The pose to take next."""
        return next_pose(self.pose_ids(), self.project.taken) if self.project is not None else None

    @property
    def is_taking(self) -> bool:
        """Whether a pose is being taken, or the lengths measured."""
        return self.step is not None and self.controller.runner.running == self.step.id

    def enter(self, step: Step) -> None:
        """Show the first pose that is missing."""
        self.step = step
        self._stage()
        super().enter(step)

    def _stage(self) -> None:
        pose = self.current or (self.pose_ids()[-1] if self.pose_ids() else None)
        if self.controller.staged_poses and pose is not None and pose in self.controller.staged_poses:
            self.controller.show_pose(pose)

    def refresh(self) -> None:
        """A pose was taken."""
        if self.project is None:
            return
        self.show_cameras()
        taken = [pose for pose in self.pose_ids() if pose in self.project.taken]
        if taken and taken[-1] != self._last and not self.is_taking and self.isVisible():
            self._stage()
        self._last = taken[-1] if taken else None
        clear(self.poses)
        for pose in self.pose_ids():
            there = pose in self.project.taken
            self.poses.addWidget(self._mark(pose, there, pose == self.current))
        self.poses.addStretch(1)
        idle = self.controller.runner.running is None
        none = self.tr("No pose was taken yet.")
        enable(self.again, idle and bool(taken) and self.controller.connection is not None, none)
        self.tick()
        self.action_changed.emit()

    @staticmethod
    def _mark(pose: str, there: bool, current: bool) -> QLabel:
        mark = label(f"{MARKS['good'] if there else '▸' if current else MARKS['none']} {pose}", "big", wrap=False)
        set_level(mark, "good" if there else "none")
        return mark

    def tick(self) -> None:
        """Follow the cameras."""
        if self.project is None or self.wall.isHidden():
            return
        self.follow()
        targets = {name: sight.dots.targets for name, sight in self.sights().items()}
        pose = self.current
        state = pose_state(targets, pose is None, self.is_taking, self.pose_ids()[-1] if self.pose_ids() else "")
        text = state.text if pose is None or self.is_taking else f"{pose} · {state.text}"
        if text != self.told.text():
            self.told.setText(text)
            set_level(self.told, state.level)

    def _retake(self) -> None:
        if self._last is not None and self.step is not None:
            if self.controller.staged_poses:
                self.controller.show_pose(self._last)
            self.controller.take(self._last, self.step.id)

    def action(self) -> PageAction | None:
        """Take the next pose."""
        running, pose = self.controller.runner.running, self.current
        if pose is None:
            return PageAction(self.tr("All poses taken"), False, self.tr("Every pose is there."), done=True)
        text = self.tr("Take {pose}  (space)").format(pose=pose)
        if running:
            return PageAction(text, False, self.tr("Work is running."))
        if self.controller.connection is None:
            return PageAction(text, False, self.tr("The cameras are not connected."))
        return PageAction(text)

    def act(self) -> None:
        """Take it."""
        pose = self.current
        if pose is not None and self.step is not None:
            self.controller.take(pose, self.step.id)


class VerifyPage(ScalePage):
    """Poses of the check bar, then the errors of its lengths."""

    def __init__(self, controller: Controller, parent: QWidget | None = None) -> None:
        super().__init__(controller, parent)
        self.split = QSplitter(Qt.Orientation.Vertical)
        outcome = Card()
        self.word = label("", "huge", wrap=False)
        self.sentence = label("", "big")
        self.rule = label("", "soft")
        words = QHBoxLayout()
        words.addWidget(self.word)
        words.addSpacing(14)
        words.addWidget(self.sentence, 1)
        outcome.body.addLayout(words)
        self.errors = ErrorChart()
        outcome.body.addWidget(self.errors, 1)
        outcome.body.addWidget(self.rule)
        self.table = Table(
            [
                self.tr("Length"),
                self.tr("n"),
                self.tr("mean E, mm"),
                self.tr("sd, mm"),
                self.tr("largest, mm"),
                self.tr("U, mm"),
            ]
        )
        self.table.setMinimumHeight(150)
        self.errors.setMinimumHeight(120)
        self.split.addWidget(outcome)
        self.split.addWidget(self.table)
        self.split.setStretchFactor(0, 2)
        self.split.setStretchFactor(1, 1)
        self.column.insertWidget(2, self.split, 1)

    def pose_ids(self) -> tuple[str, ...]:
        """The poses of the check bars."""
        return self.project.check_poses if self.project is not None else ()

    def refresh(self) -> None:
        """A pose was taken, or the lengths were measured."""
        super().refresh()
        if self.project is None:
            return
        result = self.controller.result
        bars = result.bars if result is not None and self.project.verified is not None else None
        self.split.setVisible(bars is not None)
        self.wall.setVisible(bars is None)
        self.told.setVisible(bars is None)
        if bars is None:
            return
        verdict = bar_verdict(bars)
        state = self.state
        stale = state is not None and state.status is Status.STALE
        self.word.setText(f"{verdict.word}  {self.tr('(out of date)')}" if stale else verdict.word)
        set_level(self.word, "caution" if stale else verdict.level)
        self.sentence.setText(verdict.sentence)
        shown = errors_of(bars)
        self.errors.show_errors(shown.names, shown.errors, shown.limits, shown.exceeding)
        self.rule.setText(self.tr("Grey: limits k u of each error. Rule: {rule}").format(rule=bars.rule))
        rows = length_cells(bars)
        self.table.fill([[(cell, _value(cell), "") for cell in row] for row in rows])

    def dress(self) -> None:
        """Draw in the new colours."""
        self.refresh()

    def action(self) -> PageAction | None:
        """Take poses, then measure."""
        if self.current is not None:
            return super().action()
        running = self.controller.runner.running
        if running == "verify":
            return PageAction(self.tr("Measuring"), False, self.tr("The lengths are being measured."))
        state = self.state
        done = state is not None and (
            state.status is Status.DONE or (self.project.verified is not None and state.status is Status.FAILED)
        )
        text = self.tr("Measure the bar")
        if running:
            return PageAction(text, False, self.tr("Work is running."))
        if done:
            return PageAction(text, False, self.tr("It is measured; take a pose again to measure anew."), done=True)
        return PageAction(text)

    def act(self) -> None:
        """Take the next pose, or measure."""
        if self.current is not None:
            super().act()
        else:
            self.controller.verify()


def _value(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell
