"""A placement: counters against need, image coverage, pairs; taken by space bar or by itself when still."""

import time
from dataclasses import replace

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QTabWidget, QVBoxLayout, QWidget

from spherecal.base.arrays import IntArray
from spherecal_gui import coverage as cov
from spherecal_gui import theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.live_page import LivePage
from spherecal_gui.pages.wizard_page import PageAction
from spherecal_gui.presenters.guidance_presenter import advice_text, is_enough, next_text, now_text, to_go_text
from spherecal_gui.presenters.look_presenter import TileState
from spherecal_gui.presenters.placement_presenter import (
    AutoTrigger,
    Scene,
    advice,
    is_stuck,
    island_text,
    need_lists,
    need_text,
)
from spherecal_gui.project import FEW_PLACEMENTS
from spherecal_gui.standing import Part, worst
from spherecal_gui.tasks.ghost import drawn
from spherecal_gui.widgets.basic import button, enable, label, option, set_level
from spherecal_gui.widgets.charts import CoverageChart, PairMatrix
from spherecal_gui.widgets.icons import give_icon
from spherecal_gui.widgets.need_label import NeedLabel
from spherecal_gui.widgets.scene_view import SceneView, make_scene_view
from spherecal_gui.widgets.tile import Wall
from spherecal_gui.widgets.top_view import TopView
from spherecal_gui.wizard.keys import SEEN_S
from spherecal_gui.workflow import Step

_HOLD_PX = 8
_TALL_PX = 700  # of a page on a larger screen than 1280 x 800
_CARRY_S = 5.0  # until it is moved again: where it was last seen may be older than where it lay
_LOOK_S = 0.25  # between two looks at the ball; one takes 8 to 11 ms (6 cameras, 260 dots each)


class PlacementPage(LivePage):
    """One page for all placements; it shows the one of the step."""

    wants_dots = True

    def __init__(self, controller: Controller, parent: QWidget | None = None) -> None:
        super().__init__(controller, parent)
        self._trigger = AutoTrigger()
        self._turned = False
        self._tiles: list[TileState] = []
        self._drawn: object = None
        self._lacking = True  # a camera needs more dots, over all placements and what it sees now
        self._stuck = False  # it lies where it should, and a camera sees too little
        self._carried_s = 0.0
        self._by_itself = False  # what is shown was captured by itself
        self._good_since: float | None = None
        controller.advice.guidance_changed.connect(self._show_guidance)
        column = QVBoxLayout(self)
        head = QHBoxLayout()
        self.ready = label("", "huge", wrap=False)
        self.advice = label("", "huge")
        head.addWidget(self.advice, 1)
        head.addWidget(self.ready)
        column.addLayout(head)
        self.hold = QProgressBar()
        self.hold.setObjectName("hold-still")
        self.hold.setAccessibleName(self.tr("How long it has lain still"))
        self.hold.setTextVisible(False)
        policy = self.hold.sizePolicy()
        policy.setRetainSizeWhenHidden(True)  # the page must not jump when it comes
        self.hold.setSizePolicy(policy)
        self.hold.setFixedHeight(_HOLD_PX)
        self.hold.hide()
        column.addWidget(self.hold)
        self._looked_s = 0.0
        row = QHBoxLayout()
        self.wall = Wall()
        row.addWidget(self.wall, 5)
        row.addWidget(self._tabs(), 3)
        column.addLayout(row, 1)
        column.addLayout(self._buttons())
        controller.advice.ball_seen.connect(self._ball_seen)
        self.tabs.currentChanged.connect(self._tab_changed)

    def _buttons(self) -> QHBoxLayout:
        row = QHBoxLayout()
        self.automatic = option(self.tr("Capture by itself when still"))
        self.automatic.setObjectName("automatic")
        self.automatic.setToolTip(self.tr("Goes on to the next placement by itself too, where nothing is wrong."))
        self.again = button(self.tr("Retake"), "retake")
        self.again.clicked.connect(self._take)
        self.delete = button(self.tr("Delete"), "delete-set")
        self.delete.clicked.connect(self._delete)
        self.undo = button(self.tr("Undo"), "undo")
        self.undo.clicked.connect(self.controller.sets.undo)
        self.more = button(self.tr("One more placement"), "more")
        self.more.clicked.connect(self.controller.sets.add_placement)
        self.turned = button(self.tr("It was turned"), "was-turned")
        self.turned.setToolTip(self.tr("The ball is in the same place, but shows another side."))
        self.turned.clicked.connect(self._was_turned)
        self.turned.hide()
        self.keep = button(self.tr("Keep it as it is"), "keep-set")
        self.keep.clicked.connect(lambda: self.controller.sets.keep(self.set_id))
        self.fixed = button(self.tr("Fixed again"), "fixed-again")
        self.fixed.setToolTip(self.tr("The cameras that were moved are fixed: they count as they stand now."))
        self.fixed.clicked.connect(self.controller.cameras.accept_moved)
        row.addWidget(self.automatic)
        row.addStretch(1)
        for one in (self.put_there, self.fixed, self.turned, self.keep, self.again, self.delete, self.undo, self.more):
            row.addWidget(one)
        return row

    def _tabs(self) -> QTabWidget:
        self.tabs = QTabWidget()
        self.tabs.setObjectName("placement-tabs")
        self.tabs.setUsesScrollButtons(False)  # three names have room, if need be cut short
        self.tabs.setElideMode(Qt.TextElideMode.ElideRight)
        self.coverage = CoverageChart()
        covered = QWidget()
        column = QVBoxLayout(covered)
        column.addWidget(self.coverage, 1)
        self.more_dots, self.spread_dots = NeedLabel("bad"), NeedLabel("caution")
        for line in (self.more_dots, self.spread_dots):
            line.setToolTip(self.tr("A click on a camera shows its picture."))
            line.asked.connect(self._show_camera)
            column.addWidget(line)
        self.coverage_key = label(self.tr("Green: covered so far. Blue: what this placement adds."), "soft")
        column.addWidget(self.coverage_key)
        self._covered, self._paired = covered, QWidget()
        self.tabs.addTab(covered, self.tr("Coverage"))
        column = QVBoxLayout(self._paired)
        self.islands = label("", "big")
        column.addWidget(self.islands)
        self.pairs = PairMatrix()
        column.addWidget(self.pairs, 1)
        column.addWidget(
            label(self.tr("Dots that two cameras have in common, over all placements and this image."), "soft")
        )
        self.tabs.addTab(self._paired, self.tr("Pairs"))
        self.guidance, self._next_title = QWidget(), self.tr("Where next")
        column = QVBoxLayout(self.guidance)
        self.guide_text, self.now, self.then = label("", "big"), label(""), label("")
        self.top_view = TopView()
        self.to_go = label("", "title")
        self.put_there = button(self.tr("Put it there"), "put-there")
        self.put_there.setToolTip(self.tr("Training: moves the simulated ball to where it should go."))
        self.put_there.clicked.connect(self.controller.staging.put_there)
        self.put_there.hide()  # until it is known where to
        column.addWidget(self.guide_text)
        column.addWidget(self.to_go)
        column.addWidget(self.top_view, 1)
        self.in_space = button(self.tr("In space"), "in-space")
        give_icon(self.in_space, "cube")
        self.in_space.setCheckable(True)
        self.in_space.toggled.connect(self._show_in_space)
        self.space: SceneView | None = None
        self._space_at = column.count()
        column.addWidget(self.in_space, 0, Qt.AlignmentFlag.AlignLeft)
        column.addWidget(self.now)
        column.addWidget(self.then)
        message = self.tr("Expected error on 500 mm (95 %); the picture is seen from above.")
        self.guide_key = label(message, "soft")
        column.addWidget(self.guide_key)
        return self.tabs

    # --- what is shown -----------------------------------------------------------------------------------------------

    @property
    def set_id(self) -> str:
        """The placement of the step."""
        return (self.step.set_id if self.step is not None else None) or "P1"

    @property
    def is_taken(self) -> bool:
        """Whether the placement is there."""
        return self.project is not None and self.set_id in self.project.taken

    @property
    def headline(self) -> QLabel:
        """The label with the state of the page."""
        return self.advice

    @property
    def _is_flawed(self) -> bool:
        """Whether something is wrong with it as it was taken, and nobody has decided to keep it."""
        return any(not flaw.kept for flaw in self.open_project.flaws_of(self.set_id))

    @property
    def is_taking(self) -> bool:
        """Whether it is being taken."""
        return self.step is not None and self.controller.runner.running == self.step.id

    def enter(self, step: Step) -> None:
        """Another placement: draw everything again."""
        self._drawn, self._trigger, self._turned = None, AutoTrigger(), False
        self._by_itself, self._good_since, self._stuck = False, None, False
        self.step = step
        if not self.is_taken and self.tabs.indexOf(self.guidance) >= 0:
            self.tabs.setCurrentWidget(self.guidance)
        if self.controller.cameras.staged_poses:
            self.controller.staging.show_pose(self.set_id)
        super().enter(step)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keys only where the drawings leave room for them."""
        super().resizeEvent(event)
        self._drawn = None
        self._show_keys()

    def _show_keys(self) -> None:
        self.guide_key.setVisible(self.height() > _TALL_PX and not theme.is_far())
        self.coverage_key.setVisible(self.height() > _TALL_PX or not theme.is_far())

    def refresh(self) -> None:
        """Something was taken, deleted or has ended."""
        if self.project is None:
            return
        self.show_cameras()
        idle = self.controller.runner.running is None
        busy = self.tr("Work is running.")
        there = self.tr("This placement is not captured yet.")
        enable(
            self.again,
            idle and self.is_taken and self.controller.cameras.connection is not None,
            busy if not idle else there,
        )
        spare = not self.is_taken and len(self.project.placements) > FEW_PLACEMENTS
        self.delete.setText(self.tr("Skip this placement") if spare else self.tr("Delete"))
        enable(self.delete, idle and (self.is_taken or spare), busy if not idle else there)
        self.delete.setVisible(self.is_taken or spare)
        undo = self.controller.sets.can_undo
        enable(self.undo, idle and undo is not None, busy if not idle else self.tr("Nothing was deleted."))
        self.undo.setText(self.tr("Undo {name}").format(name=undo) if undo else self.tr("Undo"))
        enable(self.more, idle and self.controller.cameras.connection is not None, busy)
        flawed = self.is_taken and self._is_flawed
        self.keep.setVisible(flawed and idle)
        self.again.setVisible(self.is_taken and not flawed)  # then it is the large button
        self.undo.setVisible(undo is not None)
        self.fixed.setVisible(bool(self.controller.cameras.moved()))
        self._show_guidance()
        self._drawn = None
        self.tick()
        self.action_changed.emit()

    def dress(self) -> None:
        """Draw in the new colours."""
        self._drawn = None
        self._show_keys()
        if self.space is not None:
            self.space.dress()
        self.refresh()

    def scene(self) -> Scene:
        """What the cameras see now."""
        connection, sights = self.controller.cameras.connection, self.sights()
        if connection is None:
            return Scene({}, None)
        statuses = connection.source.statuses()
        lost = tuple(
            name
            for serial, name in connection.names.items()
            if serial in statuses and not statuses[serial].state.usable
        )
        counts = {
            name: 0 if name in lost else len(sights[name].dots) if name in sights else 0
            for name in connection.names.values()
        }
        seen = [sight for name, sight in sights.items() if len(sight.dots) and name not in lost]
        known = [sight for sight in seen if sight.motion_px is not None]
        still = all(sight.still for sight in known) if known and len(known) == len(seen) else None
        return Scene(counts, still, lost, self.open_project.by_board)

    def tick(self) -> None:
        """Follow the cameras."""
        if self.project is None:
            return
        self._tiles = self.follow()
        self._look_at_ball()
        self._show_planning()
        scene = self.scene()
        self._draw(scene)
        to_go = self.controller.advice.to_go
        in_place = self.is_taken or (to_go is not None and to_go.near)
        scene = replace(scene, made_up=bool(scene.short) and in_place and not self._lacking)
        self.some_are_enough = scene.made_up
        as_before, away = self._stands_as_before(scene), self._is_away
        message = advice(scene, self.is_taken, self.is_taking, as_before, away)
        self._stuck = is_stuck(scene, as_before, away)
        self.guide_text.setVisible(not self._stuck)  # the ball is there: one advice at a time
        self.say(message.text, message.level)
        self._show_counter(scene)
        waiting = self.automatic.isChecked() and not self.is_taken and not self.is_taking
        waiting = waiting and self.standing().level != "bad" and not as_before and not self._stuck
        waiting = waiting and (to_go is None or to_go.near)  # where it should go is known: there, and nowhere else
        self.turned.setVisible(as_before)
        taken = waiting and self._trigger.feed(scene, time.monotonic())
        self._show_hold(waiting)
        if taken:
            self._by_itself = True
            self._take()
        self._carry()
        self._go_on_by_itself()

    def _carry(self) -> None:
        """In training the ball goes to its ghost by itself where it is captured by itself: nobody carries it there."""
        to_go, guidance = self.controller.advice.to_go, self.controller.advice.guidance
        if to_go is None or guidance is None or to_go.near or self.is_taken or not self.automatic.isChecked():
            return
        now = time.monotonic()
        if now - self._carried_s > _CARRY_S and not guidance.coarse and self.controller.staging.can_put_there:
            self._carried_s = now
            self.controller.staging.put_there()

    def _go_on_by_itself(self) -> None:
        """On to the next placement, once what was captured by itself has been in sight for a while and is good."""
        state, standing = self.controller.state, self.standing()
        after = state.after(state.current) if state is not None else None
        good = self.is_taken and standing.default == "next" and standing.level == "good"
        if not (self._by_itself and good and self.automatic.isChecked()) or after is None:
            self._good_since = None
        elif self._good_since is None:
            self._good_since = time.monotonic()
        elif after.step.kind == "placement" and time.monotonic() - self._good_since > SEEN_S:
            self.controller.go(after.step.id)

    def _show_hold(self, waiting: bool) -> None:
        """How long it must still lie: until it is taken by itself, then until all images are there."""
        held = self._trigger.held(time.monotonic()) if waiting else 0.0
        self.hold.setVisible(waiting or self.is_taking)
        self.hold.setRange(0, 0 if self.is_taking else 100)
        if not self.is_taking:
            self.hold.setValue(round(100 * held))

    def _troubles(self) -> tuple[Part, ...]:
        """Beside what any page minds, the worst that a camera's own image shows: out of focus, dark, too bright."""
        level = worst(tile.level for tile in self._tiles)
        if level not in ("bad", "caution"):
            return super()._troubles()
        tile = next(tile for tile in self._tiles if tile.level == level)
        # a camera without targets needs another place of the ball, as the page's own sentence says
        return (*super()._troubles(), Part(level, f"{tile.name}: {tile.word}" if tile.dots else ""))

    def _show_counter(self, scene: Scene) -> None:
        """The cameras that see enough: in what was taken, else now."""
        mine = self.controller.recording.dots.get(self.set_id) if self.is_taken else None
        if mine is not None:
            seen = {name: len(mine[name]) if name in mine else 0 for name in scene.counts}
            scene = replace(scene, counts=seen, still=True, lost=())
        self.ready.setText(f"{len(scene.ready)} / {len(scene.counts)}")
        self.ready.setToolTip(self.tr("Cameras that see enough"))
        whole = bool(scene.counts) and (len(scene.ready) == len(scene.counts) or scene.made_up)
        standing = self.standing().level
        set_level(self.ready, standing if standing in ("bad", "caution") else "good" if whole else "caution")

    def _stands_as_before(self, scene: Scene) -> bool:
        """Whether the ball is where it was at the placement taken last, and nobody says that it was turned."""
        if self.is_taken or self._turned or scene.lost:
            return False
        last = max(
            (name for name in self.open_project.placements if name in self.open_project.taken),
            key=lambda name: self.open_project.taken[name],
            default=None,
        )
        before = self.controller.recording.dots.get(last) if last is not None else None
        now = {name: sight.dots for name, sight in self.sights().items()}
        return before is not None and cov.same_place(before, now)

    def _was_turned(self) -> None:
        """Somebody says that the ball does not stand as before."""
        self._turned = True
        self.tick()

    def _sets(self) -> list[cov.SetDots]:
        """The dots of all placements taken but this one."""
        return [
            self.controller.recording.dots[name]
            for name in self.open_project.placements
            if name in self.controller.recording.dots and name != self.set_id
        ]

    def _tab_changed(self) -> None:
        """Another chart is in sight: it may be older than what the cameras see."""
        if self.project is not None and self.step is not None:
            self._draw(self.scene())

    def _draw(self, scene: Scene) -> None:
        """Draw the chart in sight and what is said of coverage, if anything in them has changed."""
        cameras = list(scene.counts)
        mine = self.controller.recording.dots.get(self.set_id)
        sights = self.sights()
        seen = {name: sight.dots for name, sight in sights.items() if name not in scene.lost}
        live = dict(mine) if mine is not None else seen
        counts = [len(live[name]) if name in live else 0 for name in cameras]
        tab = self.tabs.currentWidget()
        key = (
            self.set_id,
            mine is not None,
            tuple(counts),
            tuple(self.controller.recording.dots),
            tab,
            tab.size().toTuple(),
        )
        if key == self._drawn:
            return
        self._drawn = key
        sets = self._sets()
        everything = [*sets, live]
        found = (cov.board_needs if scene.board else cov.needs)(everything, cameras)
        self._lacking = any(one.need == "more" for one in found)
        before = [cov.cells([one[name] for one in sets if name in one]) for name in cameras]
        now = [cov.cells([live[name]]) if name in live else np.zeros((cov.CELLS, cov.CELLS), int) for name in cameras]
        if tab is self._covered:
            self.coverage.show_cells(cameras, before, now, [one.level for one in found])
        project = self.open_project
        to_come = any(name not in project.taken for name in project.placements if name != self.set_id)
        more, spread = need_lists(found, to_come)
        self._show_on_tiles(cameras, before, now, found if not to_come or mine is not None else [])
        self.more_dots.show_need(more)
        self.spread_dots.show_need(spread, "none" if to_come else "caution")
        common = cov.common_dots(everything, cameras)
        if tab is self._paired:
            self.pairs.show_common(cameras, common)
        text, level = island_text(cov.islands(common), cameras)
        self.islands.setText(text)
        set_level(self.islands, level)

    def _show_on_tiles(
        self, cameras: list[str], before: list[IntArray], now: list[IntArray], found: list[cov.CameraNeed]
    ) -> None:
        """Lay what is covered over each image; outline the cameras that need more, and say what."""
        tiles = {tile.name: tile for tile in self.wall.tiles.values()}
        needs = {one.camera: one for one in found}
        for name, old, new in zip(cameras, before, now, strict=True):
            if name not in tiles:
                continue
            need = needs.get(name)
            message = need_text(need.need, old + new) if need is not None and need.need != "enough" else ""
            tiles[name].show_coverage(old, new, message)

    def _look_at_ball(self) -> None:
        """Where the ball is against its ghost, some times a second."""
        now = time.monotonic()
        if self.is_taken or self.is_taking or now - self._looked_s < _LOOK_S:
            return
        if self.controller.advice.look_at_ball(self.sights()):
            self._looked_s = now

    def _ball_seen(self) -> None:
        """The ball was looked at again."""
        if self.isVisible():
            self._show_ghosts()

    def _show_ghosts(self) -> None:
        """The ghost and the ball in every image, and how far it is to go."""
        guidance, to_go = self.controller.advice.guidance, self.controller.advice.to_go
        ghost = guidance.ghost if guidance is not None and not self.is_taken and not self._is_enough() else None
        wanted = ghost is not None
        found = drawn(ghost, self.controller.advice.lying) if ghost is not None else {}
        for tile in self.wall.tiles.values():
            tile.show_ghost(found.get(tile.name), to_go is not None and to_go.near)
        text, level = to_go_text(to_go) if wanted and to_go is not None else ("", "none")
        size = "big" if theme.is_far() else "title"  # large text needs its room
        if self.to_go.objectName() != size:
            self.to_go.setObjectName(size)
            self.to_go.style().polish(self.to_go)
        self.to_go.setText(text)
        set_level(self.to_go, level)
        self.to_go.setVisible(bool(text))
        near = to_go is not None and to_go.near
        self.put_there.setVisible(wanted and self.controller.staging.can_put_there and to_go is not None and not near)

    @property
    def _is_away(self) -> bool:
        """Whether the ball is known not to be where it should go."""
        to_go = self.controller.advice.to_go
        return to_go is not None and not to_go.near and not self._is_enough()

    def _is_enough(self) -> bool:
        """Whether one more placement would not be worth it."""
        shown = self.controller.advice.guidance
        return shown is not None and is_enough(shown, self._all_taken)

    @property
    def _all_taken(self) -> bool:
        return all(name in self.open_project.taken for name in self.open_project.placements)

    def _show_planning(self) -> None:
        """For how long the advice has been worked out."""
        seconds = self.controller.advice.planning_s
        if self.controller.advice.guidance is None and seconds is not None:
            text = self.tr("Working out where the ball should go next: {seconds:.0f} s").format(seconds=seconds)
            self.guide_text.setText(text)

    def _show_in_space(self) -> None:
        """The advice in space in place of from above."""
        shown, wanted = self.controller.advice.guidance, self.in_space.isChecked()
        if wanted and self.space is None:
            self.space = make_scene_view()
            layout = self.guidance.layout()
            assert isinstance(layout, QVBoxLayout)
            layout.insertWidget(self._space_at, self.space, 1)
        self.top_view.setVisible(not wanted)
        if self.space is not None:
            self.space.setVisible(wanted)
            scene = shown.scene if shown is not None else None
            if wanted and scene is not self.space.data:
                self.space.show_scene(scene)

    def close_page(self) -> None:
        """Let go of the 3-D view."""
        if self.space is not None:
            self.space.close_view()
        super().close_page()

    def _show_guidance(self) -> None:
        """The engine's advice, where it gives one."""
        shown, planning = self.controller.advice.guidance, self.controller.advice.planning
        at = self.tabs.indexOf(self.guidance)
        if shown is None and not planning:
            if at >= 0:
                self.tabs.removeTab(at)
            return
        if at < 0:
            self.tabs.insertTab(0, self.guidance, self._next_title)
            self.tabs.setCurrentIndex(0)
        self.top_view.show_guidance(None if self._is_enough() else shown)
        self._show_in_space()
        self.in_space.setVisible(not theme.is_far() or self.in_space.isChecked())
        if shown is None:
            self._show_planning()
            self.now.clear()
            self.then.clear()
            self._show_ghosts()
            return
        self.guide_text.setText(advice_text(shown, self._all_taken))
        self._show_ghosts()
        text, level = now_text(shown)
        self.now.setText(text)
        set_level(self.now, level)
        self.then.setText(next_text(shown, self._all_taken))

    def _show_camera(self, name: str) -> None:
        """One camera's picture, large; without a name those of all."""
        connection = self.controller.cameras.connection
        if connection is None:
            return
        self.wall.show_alone(next((serial for serial, one in connection.names.items() if one == name), None))

    # --- what is done ------------------------------------------------------------------------------------------------

    def _take(self) -> None:
        if self.step is not None:
            self.controller.sets.take(self.set_id, self.step.id)
            self.refresh()

    def _delete(self) -> None:
        if self.is_taken:
            self.controller.sets.delete(self.set_id)
        else:
            self.controller.sets.drop_placement(self.set_id)

    def action(self) -> PageAction:
        """Take it."""
        running = self.controller.runner.running
        lost = self.controller.cameras.lost()
        text = self.tr("Captured") if self.is_taken else self.tr("Capture  (space)")
        if self._stuck and not self.is_taken:
            text = self.tr("Capture anyway  (space)")
        if lost and not self.is_taken:
            text = self.tr("Capture without {cameras}").format(cameras=", ".join(lost))
        if self.is_taking:
            return PageAction(self.tr("Capturing"), False, self.tr("Images are being captured."))
        if running:
            return PageAction(text, False, self.tr("Work is running."))
        if self.is_taken and self._is_flawed:
            return PageAction(self.tr("Retake  (space)"), self.controller.cameras.connection is not None)
        if self.is_taken:
            return PageAction(text, False, self.tr("It is captured; Retake replaces it."), done=True)
        if self.controller.cameras.connection is None:
            return PageAction(text, False, self.tr("The cameras are not connected."))
        return PageAction(text, accepts=True)

    def act(self) -> None:
        """Take it."""
        self._take()
