"""Verify: the check bars in poses that the engine plans, then the errors of their lengths, limits and budget."""

import time
from dataclasses import replace
from datetime import date
from functools import partial

import numpy as np
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QLineEdit, QTabWidget, QWidget

from spherecal_gui import limits_in_force as limits
from spherecal_gui import theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.bars_page import ScalePage
from spherecal_gui.presenters.bars_presenter import BarGuide, lay_text, pose_columns, reminder
from spherecal_gui.presenters.connect_presenter import bars_with_nominal, lengths_texts
from spherecal_gui.presenters.placement_presenter import Hold
from spherecal_gui.presenters.step_states import VerifyFacts, verify_says
from spherecal_gui.rig_scenes import LiveParts, in_scene, rig_scene, verified_scene
from spherecal_gui.standing import Part, Said
from spherecal_gui.tasks.outcome import Outcome
from spherecal_gui.widgets.basic import MARKS, add, bare, button, clear, enable, label, named, option, plain, say
from spherecal_gui.widgets.fields import number_field
from spherecal_gui.widgets.scene_view import SceneView
from spherecal_gui.widgets.verification_view import VerificationView
from spherecal_gui.workflow import Status, Step, StepState

_NOT_READ_C = -10.0  # no bar is measured with in the frost: this means a temperature that nobody has read
_LIMIT_PX = 130  # in two lines: in one it would push the field out of 1280 px
_LOOK_S = 0.4  # between two looks at the bar; one takes 20 ms beside the window (6 cameras, 4 marks)


class VerifyPage(ScalePage):
    """Poses of the check bars, guided and accepted as they are laid; then what was measured."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.deeds = {**self.deeds, "measure": self._measure, "retake": self._retake_all}
        self.deeds["results"] = partial(controller.go, "calibrate")
        self._chosen: str | None = None
        self._looked_s = 0.0
        self._again = False  # measured, and more poses are asked for
        self._staged: str | None = None  # what a simulated rig was asked to show
        self._was_taking = False
        self._drawn: Outcome | None = None  # the outcome whose bars the scene shows
        controller.bars.seen.connect(self._bar_seen)
        self.pose_box = QWidget()
        self.grid = bare(QGridLayout(self.pose_box))
        add(self.poses, self.pose_box, None)
        self.tabs = QTabWidget()
        self.view = SceneView()
        self._rig: object = None  # the result whose rig the scene shows
        self.tabs.addTab(self.view, self.tr("In space"))
        self.tabs.addTab(self.wall, self.tr("Images"))
        self.column.insertWidget(2, self.tabs, 1)
        self.outcome = VerificationView()
        self.outcome.panel.said.connect(self.controller.tell)
        self.column.insertWidget(3, self.outcome, 1)
        self._add_buttons()
        self.lengths = label("", "soft")
        self.column.insertWidget(1, self.lengths)
        self.certificates = label("", hidden=True)
        self.column.insertWidget(2, self.certificates)

    def _add_buttons(self) -> None:
        self.automatic = named(option(self.tr("Capture by itself when it lies right")), "automatic-bar")
        self.as_it_lies = button(self.tr("Capture it as it lies"), "take-anyway", act=self._take)
        self.enough = button(self.tr("Enough: measure now"), "measure-now", act=self._measure)
        self.more = button(self.tr("More poses"), "more-poses", act=self._more_poses)
        self.limit_label = label(self.tr("Permitted length error (mm)"))
        self.limit_label.setFixedWidth(_LIMIT_PX)
        limit = QLineEdit(placeholderText=self.tr("e.g. 0.03+L/20000"))
        self.limit = named(limit, "limit", self.tr("Limit of the length errors: A + L/K in mm"))
        self.limit.setMinimumWidth(self.limit.fontMetrics().horizontalAdvance(self.limit.placeholderText()) + 24)
        self.limit.setMaximumWidth(220)
        self._limit_tip = self.tr(
            "The largest error that is allowed, such as 0.03+L/20000; empty: judged by its own uncertainty."
        )
        self.limit.editingFinished.connect(self._limit_given)
        says = self.tr("Temperature of the bar")
        tip = self.tr("Read it on the bar: a steel bar of 500 mm grows by 0.006 mm for each degree.")
        self.celsius = number_field("bar-celsius", says, (_NOT_READ_C, 60.0), "°C", digits=1, tip=tip)
        self.celsius.setSpecialValueText(self.tr("not read"))
        self.celsius.editingFinished.connect(self._celsius_given)
        self.celsius_label = label(self.tr("Bar"), wrap=False)
        add(self.poses, add(QHBoxLayout(), self.celsius_label, self.celsius, 14, self.limit_label, self.limit))
        self.row.insertWidget(0, self.automatic)
        add(self.row, self.as_it_lies, self.enough, self.more)

    def _put_wall(self) -> None:
        """In a tab, beside the scene with the pose that is asked for; it has its own way to capture by itself."""

    # --- poses -------------------------------------------------------------------------------------------------------

    def pose_ids(self) -> tuple[str, ...]:
        """The poses of the check bars."""
        return self.project.check_poses if self.project is not None else ()

    @property
    def current(self) -> str | None:
        """The pose that was chosen, else the next one that is missing."""
        return self._chosen if self._chosen in self.pose_ids() else super().current

    @property
    def guided(self) -> bool:
        """Whether the engine says where the bar goes."""
        return self.current is not None and self.controller.bars.planned_pose(self.current) is not None

    @property
    def guide(self) -> BarGuide | None:
        """What was last seen of the bar in the pose that is asked for."""
        guide = self.controller.bars.guide
        return guide if guide is not None and guide.pose == self.current else None

    def show_standing(self) -> None:
        """Where the bar goes, or what was measured."""
        self.headline = self.outcome.word if self.project is not None and self.shows_outcome else self.message
        super().show_standing()

    @property
    def shows_outcome(self) -> bool:
        """Whether what was measured is shown, and not where the bar goes."""
        result = self.controller.result
        measured = result is not None and result.bars is not None and self.open_project.verified is not None
        return measured and not self._again and self._chosen is None

    def enter(self, step: Step) -> None:
        """Show the first pose that is missing."""
        self._chosen, self._again, self._staged, self._hold = None, False, None, Hold()
        self.limit.setText(self.open_project.limit)
        warm = self.controller.bars.celsius()
        self.celsius.setValue(_NOT_READ_C if warm is None else warm)
        super().enter(step)

    def _show_poses(self) -> None:
        clear(self.grid)
        for column, poses in enumerate(pose_columns(self.pose_ids())):
            for row, pose in enumerate(poses):
                there = pose in self.open_project.taken
                mark = MARKS["good"] if there else "\u25b8" if pose == self.current else MARKS["none"]
                one = button(f"{mark} {self.pose_ids().index(pose) + 1}", f"pose-{pose}", "pose")
                one.setProperty("level", "good" if there else "none")
                one.setCheckable(True)
                one.setChecked(pose == self.current)
                one.setToolTip(self.tr("Captured; a click retakes it.") if there else self.tr("Not captured yet."))
                one.clicked.connect(partial(self._choose, pose))
                self.grid.addWidget(one, row, column)

    def _choose(self, pose: str, _: bool = False) -> None:
        if self.controller.runner.running is None:
            self._chosen, self._hold = pose, Hold()
            self._stage()
            self.refresh()

    def _retake_all(self) -> None:
        """From the first pose on: nothing was measured in those that are there."""
        self._chosen = self.pose_ids()[0]
        self._more_poses()

    def _more_poses(self) -> None:
        self._again = True
        self._stage()
        self.refresh()

    def _celsius_given(self) -> None:
        value = self.celsius.value()
        if value != self.controller.bars.celsius():
            self.controller.change(bar_celsius=None if value == _NOT_READ_C else value)  # of poses taken from now on
        self.setFocus()

    def _measure(self) -> None:
        """Measure with the poses that are there, and show what comes out."""
        self._again, self._chosen = False, None
        self.controller.computation.verify()

    def _limit_given(self) -> None:
        wrong = self.controller.bars.set_limit(self.limit.text().strip())
        if wrong:
            self.controller.tell("bad", wrong)
        self.setFocus()

    # --- what is shown -----------------------------------------------------------------------------------------------

    def show_project(self) -> None:
        """A pose was taken, or the lengths were measured."""
        if self._chosen in self.open_project.taken and not self.is_taking and self._was_taking:
            self._chosen = None
        self._was_taking = self.is_taking
        super().show_project()
        shown = self.shows_outcome
        if self.isVisible() and not shown and not self.is_taking and self.current != self._staged:
            self._stage()  # the plan came after the page: the result was still being read
        self.outcome.setVisible(shown)
        for part in (self.tabs, self.message, self.pose_box, self.enough):
            part.setVisible(not shown)
        self.again.setVisible(not self.guided)  # else a click on the pose does it
        self.automatic.setVisible(not shown and self.guided)
        self.as_it_lies.setVisible(not shown and self.guided)
        self.more.setVisible(shown and any(pose not in self.open_project.taken for pose in self.pose_ids()))
        idle, also = self.controller.runner.running is None, self.said().also
        enable(self.enough, "measure-now" in also, self.tr("No pose is captured yet."))
        self.as_it_lies.setEnabled("take-anyway" in also)
        self._show_limit(idle)
        self.celsius.setEnabled(idle)
        for part in (self.celsius, self.celsius_label):
            part.setVisible(not shown)
        for part in (self.limit, self.limit_label):  # beside the poses there is no room for it from afar
            part.setVisible(shown or not theme.is_far())
        self.limit_label.setWordWrap(not shown)  # alone in its row it has all the room
        self.limit_label.setFixedWidth(self.limit_label.sizeHint().width() if shown else _LIMIT_PX)
        bars = self.controller.result.bars if self.controller.result is not None else None
        if shown and bars is not None:
            self.outcome.show_bars(bars, stale=self.open_state.status is Status.STALE)
            if self.controller.outcome is not self._drawn:
                self._drawn = self.controller.outcome
                self.outcome.show_rig(verified_scene(self._drawn) if self._drawn is not None else None)
        self._show_lengths()
        self._show_guide()

    def _show_limit(self, idle: bool) -> None:
        may = limits.now().verification_limit_open
        if not self.limit.hasFocus() and self.limit.text().strip() != self.open_project.limit:
            self.limit.setText(self.open_project.limit)
        self.limit.setEnabled(idle and may)
        locked = self.tr("Locked: the responsible person sets this limit (Menu, Limits).")
        self.limit.setToolTip(plain(self._limit_tip if may else locked))
        self.limit.setAccessibleDescription("" if may else locked)

    def _show_lengths(self) -> None:
        """What the check bars are called by, where the bench's description has it."""
        artefacts = self.open_project.artefacts
        checks, connection = artefacts.check_bars if artefacts is not None else (), self.controller.cameras.connection
        known = bars_with_nominal(connection, checks)
        bars = [bar for bar in self.controller.cameras.bars if bar.id in checks]
        say(self.certificates, *reminder(bars, date.today()))  # of what is measured with
        say(self.lengths, "\n".join(f"{bar.id} (mm): {'; '.join(lengths_texts(bar))}" for bar in known))

    def _stage(self) -> None:
        pose = self.current
        self._staged = pose if pose is not None and self.controller.staging.can_show(pose) else None
        super()._stage()

    def tick(self) -> None:
        """Follow the cameras, and look where the bar lies."""
        if self.project is None or self.shows_outcome:
            return
        if self.guided:
            self.follow()
            if self.wall.isVisible():
                self._show_ghosts()
            self._show_guide()
            self._look()
        else:
            super().tick()

    def _show_ghosts(self) -> None:
        pose = self.current if not self.is_taking else None
        found = self.controller.bars.ghosts(pose) if pose is not None else {}
        accepted = self.guide is not None and self.guide.accepted
        for tile in self.wall.tiles.values():
            tile.show_ghost(found.get(tile.name), accepted)

    def _look(self) -> None:
        now, pose = time.monotonic(), self.current
        if pose is None or self.is_taking or now - self._looked_s < _LOOK_S:
            return
        if self.controller.bars.look_at(pose, self.sights()):
            self._looked_s = now

    def _bar_seen(self) -> None:
        """The bar was looked at: take it, where that is asked for and it has lain right for a while."""
        if self.project is None or not self.isVisible() or self.shows_outcome:
            return
        self._show_guide()
        self.action_changed.emit()
        ready = self.guide is not None and self.guide.level == "good" and self.automatic.isChecked()
        if self._hold.lasts(ready and not self.is_taking, time.monotonic()):
            self._take()

    def _show_guide(self) -> None:
        if not self.guided or self.current is None:
            at = self.tabs.indexOf(self.view)
            if at >= 0:
                self.tabs.removeTab(at)
            return
        if self.tabs.indexOf(self.view) < 0:
            self.tabs.insertTab(0, self.view, self.tr("In space"))
            self.tabs.setCurrentIndex(0)
        self._show_space(self.current)
        self.show_standing()

    def _show_space(self, pose: str) -> None:
        """The rig with its live images, the bar where it should lie and where it lies, in the measuring volume."""
        outcome, planned = self.controller.outcome, self.controller.bars.planned_pose(pose)
        if outcome is None or planned is None or outcome.plan is None:
            return
        if outcome is not self._rig:
            self._rig = outcome
            self.view.show_scene(rig_scene(outcome.result.rig))
        data, box = self.view.data, outcome.plan.box
        if data is None or not self.view.isVisible():
            return
        signs = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
        corners = box.middle + (signs * box.half) @ box.axes
        bars = [(in_scene(data, np.stack([planned.start_mm, planned.end_mm])), False)]
        lying = self.controller.bars.lying_ends
        if lying is not None and np.isfinite(lying).all():
            bars.append((in_scene(data, lying), True))
        near = self.guide is not None and self.guide.accepted
        levels, images = self.tiles_now()
        self.view.show_live(LiveParts(None, near, tuple(bars), levels, images, box=in_scene(data, corners)))

    # --- its state ---------------------------------------------------------------------------------------------------

    def says(self) -> Said:
        """Where the bar goes, or what was measured."""
        state, bars, pose = self.open_state, self.bar_facts(), self.current
        measuring = self.controller.runner.running == "verify" and self.controller.sets.taking is None
        done = (Status.DONE, Status.CARE, *((Status.FAILED,) if self.open_project.verified is not None else ()))
        current = state.status in done
        planned = self.controller.bars.planned_pose(pose) if pose is not None else None
        if self.guide is not None:
            bars = replace(bars, guide=(self.guide.text, self.guide.level, self.guide.accepted))
        elif planned is not None:
            bars = replace(bars, guide=(lay_text(planned), "none", False))
        outcome = self.outcome.words if self.shows_outcome else None
        outdated = state.reason is not None and state.reason.code == "calibration stale"
        empty = self.open_project.verified is not None and self.open_project.verified.verdict == "no data"
        taken = any(one in self.open_project.taken for one in self.pose_ids())
        return verify_says(VerifyFacts(bars, outcome, measuring, current, taken, outdated, empty))

    def _step_part(self, state: StepState) -> Part:
        """While poses are laid where the bar goes comes first, and not what was measured before."""
        if not self.shows_outcome and state.status is Status.CARE:
            return Part("caution")
        stale = state.status is Status.STALE and state.reason is not None and state.reason.code == "changed"
        return Part("none") if stale and not self.shows_outcome else super()._step_part(state)
