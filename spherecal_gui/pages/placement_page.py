"""A placement: counters against need, image coverage, pairs; taken by space bar or by itself when still."""

import time
from dataclasses import replace

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QHBoxLayout, QProgressBar, QPushButton, QTabWidget, QVBoxLayout, QWidget

from spherecal.base.arrays import IntArray
from spherecal_gui import coverage as cov
from spherecal_gui import project as changes
from spherecal_gui import theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.live_page import LOOK_S, LivePage
from spherecal_gui.presenters.look_presenter import TileState
from spherecal_gui.presenters.placement_presenter import (
    AutoTrigger,
    Scene,
    is_enough,
    island_text,
    need_lists,
    need_text,
    next_text,
    now_text,
)
from spherecal_gui.presenters.step_states import PlacementFacts, placement_says
from spherecal_gui.project import FEW_PLACEMENTS
from spherecal_gui.rig_scenes import LiveParts, live_ball, rig_in_use, rig_scene
from spherecal_gui.standing import Part, Said, worst
from spherecal_gui.tasks.ghost import drawn
from spherecal_gui.widgets.basic import add, button, label, named, option, say, set_level, spaced
from spherecal_gui.widgets.charts import CoverageChart, PairMatrix
from spherecal_gui.widgets.fields import NeedLabel
from spherecal_gui.widgets.scene_view import SceneView
from spherecal_gui.widgets.tile import Wall
from spherecal_gui.workflow import Step

_HOLD_PX = 8
_TALL_PX = 700  # of a page on a larger screen than 1280 x 800
_CARRY_S = 5.0  # until it is moved again: where it was last seen may be older than where it lay


class PlacementPage(LivePage):
    """One page for all placements; it shows the one of the step."""

    wants_dots = True

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.deeds = {"capture": self._take, "next": self._next}
        self._trigger = AutoTrigger()
        self._turned = False
        self._facts = PlacementFacts()
        self._tiles: list[TileState] = []
        self._drawn: object = None
        self._lacking = True  # a camera needs more dots, over all placements and what it sees now
        self._carried_s = 0.0
        controller.advice.guidance_changed.connect(self._show_guidance)
        self.ready = label("", "huge", wrap=False)
        self.headline = self.advice = label("", "huge")
        self.advice.setAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignTop)
        self.hold = named(QProgressBar(textVisible=False), "hold-still", self.tr("How long it has lain still"))
        policy = self.hold.sizePolicy()
        policy.setRetainSizeWhenHidden(True)  # the page must not jump when it comes
        self.hold.setSizePolicy(policy)
        self.hold.setFixedHeight(_HOLD_PX)
        self.hold.hide()
        self._looked_s = 0.0
        self.wall = Wall()
        head = add(spaced(QHBoxLayout(), theme.PAD), (self.advice, 1), self.ready)
        row = add(QHBoxLayout(), (self.wall, 5), (self._tabs(), 3))
        add(QVBoxLayout(self), head, self.hold, (row, 1), self._buttons())
        controller.advice.ball_seen.connect(self._ball_seen)
        self.tabs.currentChanged.connect(self._tab_changed)

    def _buttons(self) -> QHBoxLayout:
        tip = self.tr("Once the ball lies still where it should.")
        self.automatic = named(option(self.tr("Capture by itself when still")), "automatic", tip=tip)
        row = add(QHBoxLayout(), self.automatic, None)
        sets, cameras, change = self.controller.sets, self.controller.cameras, self.controller.revise
        self.small: dict[str, QPushButton] = {}
        for key, text, act, tip in (
            ("put-there", self.tr("Put it there"), self.controller.staging.put_there,
             self.tr("Training: moves the simulated ball to where it should go.")),
            ("fixed-again", self.tr("Fixed again"), cameras.accept_moved,
             self.tr("The cameras that were moved are fixed: they count as they stand now.")),
            ("mask-spots", self.tr("Mask the bright spots"), self.controller.recording.mask_spots,
             self.tr("The outlined bright spots stay where they are when the ball moves: nothing in them counts.")),
            ("leave-spots", self.tr("Leave the bright spots"), self.controller.recording.leave_spots, ""),
            ("was-turned", self.tr("It was turned"), self._was_turned,
             self.tr("The ball is in the same place, but shows another side.")),
            ("keep-set", self.tr("Keep it as it is"), lambda: change(changes.with_kept, self.set_id), ""),
            ("retake", self.tr("Retake"), self._take, ""),
            ("delete-set", self.tr("Delete"), lambda: sets.delete(self.set_id), ""),
            ("skip", self.tr("Skip this placement"), lambda: change(changes.without_placement, self.set_id), ""),
            ("undo", self.tr("Undo"), sets.undo, ""),
            ("more", self.tr("One more placement"), sets.add_placement, ""),
        ):  # fmt: skip
            one = self.small[key] = button(text, key, tip=tip)
            one.clicked.connect(lambda _=False, act=act: act())
            one.hide()
            row.addWidget(one)
        return row

    def _tabs(self) -> QTabWidget:
        self.tabs = QTabWidget()
        self.tabs.setObjectName("placement-tabs")
        self.tabs.setUsesScrollButtons(False)  # three names have room, if need be cut short
        self.tabs.setElideMode(Qt.TextElideMode.ElideRight)
        self.coverage = CoverageChart()
        self.more_dots, self.spread_dots = NeedLabel("bad"), NeedLabel("caution")
        for line in (self.more_dots, self.spread_dots):
            line.setToolTip(self.tr("A click on a camera shows its picture."))
            line.asked.connect(self._show_camera)
        self.coverage_key = label(self.tr("Green: covered so far. Blue: what this placement adds."), "soft")
        self._covered, self._paired, self.guidance = QWidget(), QWidget(), QWidget()
        add(QVBoxLayout(self._covered), (self.coverage, 1), self.more_dots, self.spread_dots, self.coverage_key)
        self.tabs.addTab(self._covered, self.tr("Coverage"))
        self.islands, self.pairs = label("", "big"), PairMatrix()
        key = label(self.tr("Dots that two cameras have in common, over all placements and this image."), "soft")
        add(QVBoxLayout(self._paired), self.islands, (self.pairs, 1), key)
        self.tabs.addTab(self._paired, self.tr("Pairs"))
        self._next_title = self.tr("In space")
        self.guide_text, self.now, self.then = label("", "big"), label(""), label("")
        self.space = SceneView()
        self.space.setMinimumSize(200, 90)  # the words below it need room under an instruction of three lines
        self.guide_key = label(self.tr("Expected error on 500 mm (95 %)."), "soft")
        add(QVBoxLayout(self.guidance), self.guide_text, (self.space, 1), self.now, self.then, self.guide_key)
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

    def enter(self, step: Step) -> None:
        """Another placement: draw everything again."""
        self._drawn, self._trigger, self._turned = None, AutoTrigger(), False
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
        """Room for two lines of instruction, so that the images keep their place when it changes."""
        self.advice.setMinimumHeight(2 * self.advice.fontMetrics().lineSpacing())
        told = "±" in self.now.text()  # else it would be the key to nothing
        self.guide_key.setVisible(told and self.height() > _TALL_PX and not theme.is_far())
        self.coverage_key.setVisible(self.height() > _TALL_PX or not theme.is_far())

    def show_project(self) -> None:
        """Something was taken, deleted or has ended."""
        self.show_cameras()
        undo = self.controller.sets.can_undo
        self.small["undo"].setText(self.tr("Undo {name}").format(name=undo) if undo else self.tr("Undo"))
        self._show_guidance()
        self._drawn = None
        self.tick()

    def dress(self) -> None:
        """Draw in the new colours."""
        self._drawn = None
        self._show_keys()
        super().dress()

    def scene(self) -> Scene:
        """What the cameras see now."""
        connection, sights = self.controller.cameras.connection, self.sights()
        if connection is None:
            return Scene({}, None)
        statuses, names = connection.source.statuses(), connection.names
        lost = tuple(names[s] for s in names if s in statuses and not statuses[s].state.usable)
        there = {name: sight for name, sight in sights.items() if name not in lost}
        counts = {name: len(there[name].dots) if name in there else 0 for name in names.values()}
        seen = [sight for sight in there.values() if len(sight.dots)]
        known = [sight for sight in seen if sight.motion_px is not None]
        still = all(sight.still for sight in known) if known and len(known) == len(seen) else None
        return Scene(counts, still, lost, self.open_project.by_board)

    def tick(self) -> None:
        """Follow the cameras."""
        if self.project is None:
            return
        self._tiles = self.follow()
        self._look_at_ball()
        scene = self.scene()
        self._draw(scene)
        facts = self._facts = self._facts_of(scene)
        self.some_are_enough = facts.scene.made_up
        self.show_standing()
        said = self.standing().said
        for key, one in self.small.items():
            one.setVisible(key in said.also)
        self.ready.setText(said.count)
        level = self.standing().level
        whole = facts.scene.made_up or len(facts.scene.ready) == len(facts.scene.counts) > 0
        set_level(self.ready, level if level in ("bad", "caution") else "good" if whole else "caution")
        say(self.guide_text, self._reason())
        self._show_space()
        waiting = self.automatic.isChecked() and not (facts.taken or facts.work or facts.as_before or facts.stuck)
        waiting = waiting and not facts.away and level != "bad"  # where it should go is known: there, and nowhere else
        taken = waiting and self._trigger.feed(facts.scene, time.monotonic())
        # how long it must still lie: until it is taken by itself, then until all images are there
        held = self._trigger.held(time.monotonic()) if waiting else 0.0
        self.hold.setVisible(waiting or self.is_taking)
        self.hold.setRange(0, 0 if self.is_taking else 100)
        if not self.is_taking:
            self.hold.setValue(round(100 * held))
        if taken:
            self._take()
        self._carry()

    def _facts_of(self, scene: Scene) -> PlacementFacts:
        project, advice, sets = self.open_project, self.controller.advice, self.controller.sets
        to_go = advice.to_go if advice.guidance is not None and not self.recorded else None
        in_place = self.is_taken or (to_go is not None and to_go.near)
        made_up = (bool(scene.short) and in_place and not self._lacking) or self.recorded
        mine = self.controller.recording.dots.get(self.set_id) if self.is_taken else None
        if mine is not None:
            counts = {name: len(mine[name]) if name in mine else 0 for name in scene.counts}
            scene = replace(scene, counts=counts, still=True)
        flawed = self.is_taken and any(not flaw.kept for flaw in project.flaws_of(self.set_id))
        how = self.is_taken, flawed, self.work, self.controller.cameras.connection is not None
        where = self._stands_as_before(scene), to_go, self._is_enough(), self.recorded
        spare, moved = len(project.placements) > FEW_PLACEMENTS, bool(self.controller.cameras.moved())
        can = sets.can_undo is not None, self.controller.staging.can_put_there, bool(self.controller.recording.spots)
        return PlacementFacts(replace(scene, made_up=made_up), *how, *where, spare, moved, *can)

    def says(self) -> Said:
        """What to do with this placement."""
        return placement_says(replace(self._facts, taken=self.is_taken, work=self.work))

    def _next(self) -> None:
        state = self.controller.state
        after = state.after(state.current) if state is not None else None
        if after is not None:
            self.controller.go(after.step.id)

    def _carry(self) -> None:
        """In training the ball goes to its ghost by itself where it is captured by itself: nobody carries it there."""
        to_go, guidance = self.controller.advice.to_go, self.controller.advice.guidance
        if to_go is None or guidance is None or to_go.near or self.is_taken or not self.automatic.isChecked():
            return
        now = time.monotonic()
        if now - self._carried_s > _CARRY_S and not guidance.coarse and self.controller.staging.can_put_there:
            self._carried_s = now
            self.controller.staging.put_there()

    def _troubles(self) -> tuple[Part, ...]:
        """Beside what any page minds, the worst that a camera's own image shows: out of focus, dark, too bright."""
        level = worst(tile.level for tile in self._tiles)
        if level not in ("bad", "caution"):
            return super()._troubles()
        tile = next(tile for tile in self._tiles if tile.level == level)
        # a camera without targets needs another place of the ball, as the page's own sentence says
        return (*super()._troubles(), Part(level, f"{tile.name}: {tile.word}" if tile.dots else ""))

    def _stands_as_before(self, scene: Scene) -> bool:
        """Whether the ball is where it was at the placement taken last, and nobody says that it was turned."""
        if self.is_taken or self._turned or scene.lost or self.recorded:
            return False
        taken = {name: at for name, at in self.open_project.taken.items() if name in self.open_project.placements}
        before = self.controller.recording.dots.get(max(taken, key=lambda name: taken[name], default=""))
        now = {name: sight.dots for name, sight in self.sights().items()}
        return before is not None and cov.same_place(before, now)

    def _was_turned(self) -> None:
        self._turned = True
        self.tick()

    def _sets(self) -> list[cov.SetDots]:
        """The dots of all placements taken but this one."""
        dots = self.controller.recording.dots
        return [dots[name] for name in self.open_project.placements if name in dots and name != self.set_id]

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
        of_dots = tuple(counts), tuple(self.controller.recording.dots)
        key = (self.set_id, mine is not None, *of_dots, tab, tab.size().toTuple())
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
        fixed = self.recorded or project.purpose == "check"  # nothing of it can be changed, or one placement is all
        told = not fixed and (not to_come or mine is not None)
        self._show_on_tiles(cameras, before, now, found if told else [])
        if fixed:
            more = spread = None
        self.more_dots.show_need(more)
        self.spread_dots.show_need(spread, "none" if to_come else "caution")
        common = cov.common_dots(everything, cameras)
        if tab is self._paired:
            self.pairs.show_common(cameras, common)
        say(self.islands, *island_text(cov.islands(common), cameras), hides=False)

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
        if self.is_taken or self.is_taking or now - self._looked_s < LOOK_S:
            return
        self.controller.advice.survey(self.sights())
        if self.controller.advice.look_at_ball(self.sights()):
            self._looked_s = now

    def _ball_seen(self) -> None:
        if self.isVisible():
            self._show_ghosts()

    def _show_ghosts(self) -> None:
        """The ghost and the ball in every image, and how far it is to go."""
        guidance, to_go = self.controller.advice.guidance, self.controller.advice.to_go
        ghost = guidance.ghost if guidance is not None and not self.is_taken and not self._is_enough() else None
        found = drawn(ghost, self.controller.advice.lying) if ghost is not None else {}
        for tile in self.wall.tiles.values():
            tile.show_ghost(found.get(tile.name), to_go is not None and to_go.near)
        self._show_space()

    def _show_space(self) -> None:
        """The ball as it lies now, the cameras' images and how they are, in the scene."""
        data, known, lying = self.space.data, self.controller.advice.known, self.controller.advice.lying
        if data is None or not self.space.isVisible():
            return
        to_go, ghost = self.controller.advice.to_go, known.ghost if known is not None else None
        ball = live_ball(data, ghost, lying) if ghost is not None and not self.is_taken else None
        levels, images = self.tiles_now()
        self.space.show_live(LiveParts(ball, to_go is not None and to_go.near, (), levels, images))

    def _is_enough(self) -> bool:
        shown = self.controller.advice.guidance
        return shown is not None and is_enough(shown, self._all_taken)

    @property
    def _all_taken(self) -> bool:
        return all(name in self.open_project.taken for name in self.open_project.placements)

    def _show_guidance(self) -> None:
        advice, at = self.controller.advice, self.tabs.indexOf(self.guidance)
        shown, known = advice.guidance, advice.known
        if self.space.data is None and known is None:  # as the cameras stood when they were calibrated last
            rig = rig_in_use(self.controller.profile_folder, self.scene().counts)
            self.space.show_scene(rig_scene(rig) if rig is not None else None)
        elif shown is None and known is not None and known.scene is not None and self.space.data is None:
            self.space.show_scene(known.scene)
        if shown is None and advice.planning_s is None and self.space.data is None:
            if at >= 0:
                self.tabs.removeTab(at)
            return
        if at < 0:
            self.tabs.insertTab(0, self.guidance, self._next_title)
            self.tabs.setCurrentIndex(0)
        if shown is not None and shown.scene is not self.space.data:  # the last one stays until there is a newer one
            self.space.show_scene(shown.scene)
        say(self.now, *(now_text(shown) if shown is not None else ("",)), hides=False)
        self.then.setText(next_text(shown, self._all_taken) if shown is not None else "")
        self._show_keys()
        self._show_ghosts()

    def _reason(self) -> str:
        """Why the ball goes nowhere now: the place is being worked out, or no other one is worth a walk."""
        seconds = self.controller.advice.planning_s
        if self._all_taken and self.is_taken:
            seconds = None  # nobody asked where it would go next
        if self.controller.advice.guidance is None and seconds is not None:
            return self.tr("Working out where the ball should go next: {seconds:.0f} s").format(seconds=seconds)
        return self.tr("Enough: one more placement would not be worth it.") if self._is_enough() else ""

    def _show_camera(self, name: str) -> None:
        """One camera's picture, large; without a name those of all."""
        names = self.controller.cameras.names
        self.wall.show_alone(next((serial for serial, one in names.items() if one == name), None))

    # --- what is done ------------------------------------------------------------------------------------------------

    def _take(self) -> None:
        if self.step is not None:
            self.controller.sets.take(self.set_id, self.step.id)
            self.refresh()
