"""Bars: the poses of the bar that gives the scale."""

import time

from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QVBoxLayout

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.coverage import same_place
from spherecal_gui.pages.live_page import LivePage, RigSpace
from spherecal_gui.presenters.bars_presenter import next_pose, pose_name
from spherecal_gui.presenters.placement_presenter import Hold
from spherecal_gui.presenters.step_states import GOOD_CAMERAS, LEAST_MARKS, BarFacts, bar_says, seeing
from spherecal_gui.standing import Said
from spherecal_gui.widgets.basic import MARKS, add, button, clear, enable, label, named, option, spaced
from spherecal_gui.widgets.tile import Wall
from spherecal_gui.workflow import Step


class ScalePage(LivePage):
    """The poses of one role of bars, one after the other."""

    some_are_enough = True

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.deeds = {"capture": self._take}
        self.headline = self.message = label("", "huge")
        self.poses = spaced(QHBoxLayout(), 18)
        self.column = add(QVBoxLayout(self), self.message, self.poses)
        self.wall = Wall()
        self.space: RigSpace | None = None
        self.by_itself: QCheckBox | None = None
        self._hold = Hold()
        self._put_wall()
        self.again = button(self.tr("Retake the last pose"), "retake-pose", act=self._retake)
        first = (self.by_itself,) if self.by_itself is not None else ()
        self.row = add(QHBoxLayout(), *first, None, self.again)
        self.column.addLayout(self.row)
        self._last: str | None = None

    def _put_wall(self) -> None:
        """The images, and the scene beside them."""
        self.space = RigSpace(self.controller)
        self.column.addLayout(add(QHBoxLayout(), (self.wall, 5), (self.space.view, 3)), 1)
        tip = self.tr("Once the bar was moved and lies still where three cameras see it.")
        self.by_itself = named(option(self.tr("Capture by itself when still")), "automatic-scale", tip=tip)

    def pose_ids(self) -> tuple[str, ...]:
        """The poses of this page."""
        return self.project.scale_poses if self.project is not None else ()

    @property
    def current(self) -> str | None:
        """The pose to take next."""
        return next_pose(self.pose_ids(), self.project.taken) if self.project is not None else None

    def bar_targets(self) -> frozenset[int]:
        """The targets on the bar of the next pose; empty where its bar is not known."""
        project, connection = self.project, self.controller.cameras.connection
        if project is None or connection is None or project.artefacts is None:
            return frozenset()
        scale = project.artefacts.scale_bar if self.current in project.scale_poses else None
        bar = scale or dict(project.pose_bars).get(self.current or "")
        marks = [one.marks.values() for one in connection.plan.bars if one.id == bar]
        return frozenset(mark.target for own in marks for mark in own)

    def enter(self, step: Step) -> None:
        """Show the first pose that is missing."""
        self.step = step
        self._stage()
        super().enter(step)

    def _stage(self) -> None:
        pose = self.current or (self.pose_ids()[-1] if self.pose_ids() else None)
        if pose is not None and self.controller.staging.can_show(pose):
            self.controller.staging.show_pose(pose)

    def show_project(self) -> None:
        """A pose was taken."""
        self.show_cameras()
        taken = [pose for pose in self.pose_ids() if pose in self.open_project.taken]
        if taken and taken[-1] != self._last and not self.is_taking and self.isVisible():
            self._stage()
        self._last = taken[-1] if taken else None
        self._show_poses()
        idle = self.controller.runner.running is None
        none = self.tr("No pose is captured yet.")
        enable(self.again, idle and bool(taken) and self.controller.cameras.connection is not None, none)
        self.tick()

    def _show_poses(self) -> None:
        clear(self.poses)
        for pose in self.pose_ids():
            there = pose in self.open_project.taken
            mark = MARKS["good"] if there else "▸" if pose == self.current else MARKS["none"]
            self.poses.addWidget(label(f"{mark} {pose}", "big", wrap=False, level="good" if there else "none"))
        self.poses.addStretch(1)

    def tick(self) -> None:
        """Follow the cameras."""
        if self.project is None or self.wall.isHidden():
            return
        self.follow()
        self._follow_space()
        self.show_standing()
        if self.by_itself is not None and self.by_itself.isChecked():
            self._take_by_itself(time.monotonic())

    def _take_by_itself(self, now_s: float) -> None:
        """Take a bar that was moved since the last pose and has lain still for a while."""
        own, sights = self.bar_targets(), self.sights()
        seen = {name: sight for name, sight in sights.items() if sight.dots.targets_among(own) >= LEAST_MARKS}
        dots = {name: sight.dots.of_targets(own) if own else sight.dots for name, sight in seen.items()}
        before = self.controller.recording.dots.get(self._last or "")
        moved = before is None or not same_place(before, dots)
        button = self.said().button
        may = button is not None and button.enabled and button.does == "capture"
        lies = len(seen) >= GOOD_CAMERAS and all(sight.still for sight in seen.values())
        if self._hold.lasts(may and moved and lies, now_s):
            self._take()

    def _follow_space(self) -> None:
        """The bar as it lies, in the rig as the placements have it."""
        from spherecal_gui.tasks.ghost import bar_ends  # needs scipy

        known = self.controller.advice.known
        if self.space is None:
            return
        ends = None
        if known is not None and known.ghost is not None:
            dots = {name: sight.dots for name, sight in self.sights().items()}
            ends = bar_ends(known.ghost.lenses, dots, self.bar_targets())
        self.space.follow({}, *self.tiles_now(), bars=(ends,) if ends is not None else (), with_ball=False)

    def bar_facts(self) -> BarFacts:
        """The pose to take next, and who sees the bar."""
        own = self.bar_targets()
        targets = {name: sight.dots.targets_among(own) for name, sight in self.sights().items()}
        connected, pose = self.controller.cameras.connection is not None, self.current
        name = pose_name(pose, self.pose_ids()) if pose is not None else None
        return BarFacts(name, seeing(targets), self.work, connected, recorded=self.recorded)

    def says(self) -> Said:
        """What to do with the bar."""
        return bar_says(self.bar_facts())

    def _retake(self) -> None:
        if self._last is not None and self.step is not None:
            if self.controller.staging.can_show(self._last):
                self.controller.staging.show_pose(self._last)
            self.controller.sets.take(self._last, self.step.id)

    def _take(self) -> None:
        if self.current is not None and self.step is not None:
            self.controller.sets.take(self.current, self.step.id)
