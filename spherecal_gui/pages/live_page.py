"""What pages with live images share: tiles that follow the cameras, and the scene; the camera check of them all."""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QSignalBlocker
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QVBoxLayout, QWidget

from spherecal_gui import theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import moved_text, translate
from spherecal_gui.pages.connect_dialogs import MOST_GAIN_DB
from spherecal_gui.pages.wizard_page import Page
from spherecal_gui.presenters.look_presenter import (
    TileState,
    figures_text,
    summary,
    tile_state,
    usual_light,
    warm_up_text,
)
from spherecal_gui.presenters.step_states import LookFacts, Work, look_says
from spherecal_gui.rig_scenes import LiveParts, in_scene, live_ball, rig_in_use, rig_scene
from spherecal_gui.standing import Level, Said
from spherecal_gui.widgets.basic import add, button, enable, label, named, plain, say
from spherecal_gui.widgets.fields import number_field
from spherecal_gui.widgets.scene_view import SceneView
from spherecal_gui.widgets.tile import Wall
from spherecal_gui.workflow import Status, Step

if TYPE_CHECKING:  # detection is loaded by the thread that connects the cameras
    from spherecal.base.arrays import FloatArray
    from spherecal_gui.tasks.live_detection import Sight

_AFTER_IMAGES = ("testing stillness", "finding targets", "writing the images")  # ball and bars may be moved


class LivePage(Page):
    """A page with a wall of tiles."""

    wall: Wall
    wants_dots = False
    some_are_enough = False
    wants_histograms = False

    @property
    def work(self) -> Work:
        """What goes on: images are taken at this step, or already computed with, or there is other work."""
        task = self.controller.runner.task
        if task is None:
            return ""
        if self.controller.sets.taking is None:
            return "other"
        return "computing" if task.stage in _AFTER_IMAGES else "exposing"

    @property
    def is_taking(self) -> bool:
        """Whether the step's own work runs: images are taken, or lengths measured."""
        return self.step is not None and self.controller.runner.running == self.step.id

    @property
    def recorded(self) -> bool:
        """Whether the images come from a recording, in which nothing can be moved."""
        return self.project is not None and self.project.source.startswith("replay")

    def show_cameras(self) -> None:
        """One tile for every camera that is open."""
        self.wall.set_cameras(dict(self.controller.cameras.names))
        text = translate(
            "Tile", "{name}, serial {serial}, exposure {ms:g} ms. Double click to enlarge, again to go back."
        )
        for serial, tile in self.wall.tiles.items():
            exposure = self.controller.tuning.settings_of(serial).exposure_us / 1e3
            tile.setToolTip(plain(text.format(name=tile.name, serial=serial, ms=exposure)))
            tile.why_not_renamed = self.controller.tuning.why_not_renamed(serial)
        self.wall.follow_worst()

    def follow(self) -> list[TileState]:
        """Show the newest images and states; what the tiles say."""
        live, connection = self.controller.cameras.live, self.controller.cameras.connection
        if live is None or connection is None:
            return []
        statuses = connection.source.statuses()
        by_some = self.some_are_enough or (self.project is not None and self.project.by_board)
        usual = usual_light(sight for serial in self.wall.tiles if (sight := live.sight(serial)) is not None)
        states = []
        for serial, tile in self.wall.tiles.items():
            frame, sight, status = live.frame(serial), live.sight(serial), statuses.get(serial)
            bumped = live.watch.bumped.get(serial)
            state = tile_state(tile.name, status, sight, frame, bumped, usual, self.wants_dots, by_some)
            figures = figures_text(serial, status, self.controller.tuning.settings_of(serial).exposure_us)
            states.append(state := replace(state, figures=figures))
            if frame is not None and self.isVisible():
                tile.show_image(frame.image, frame.bits, frame.arrived_s)
            if not tile.isVisible():
                continue
            tile.show_state(state, sight.dots.uv if sight is not None else np.empty((0, 2)))
            tile.show_histogram(sight.histogram if sight is not None and self.wants_histograms else None)
            proposed = self.controller.recording.spots.get(tile.name, ()) if self.wants_dots else ()
            tile.show_masks(live.masks.get(serial, ()), proposed)
        self.wall.follow_worst()
        return states

    def tiles_now(self) -> tuple[dict[str, Level], dict[str, QImage]]:
        """The cameras' states and images by name, for the scene."""
        tiles = self.wall.tiles.values()
        images = {one.name: one.image for one in tiles if one.image is not None}
        return {one.name: one.state.level for one in tiles}, images

    def sights(self) -> "dict[str, Sight]":
        """The newest examined images by camera name."""
        live, connection = self.controller.cameras.live, self.controller.cameras.connection
        if live is None or connection is None:
            return {}
        found = {name: live.sight(serial) for serial, name in connection.names.items()}
        return {name: sight for name, sight in found.items() if sight is not None}


LOOK_S = 0.25  # between two looks at the ball; one takes 8 to 11 ms (6 cameras, 260 dots each)


class RigSpace:
    """A scene view that is there once it is known where the cameras are: by the ball in sight, or by a calibration."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.view = SceneView()
        self.view.hide()
        self._shown: object = None
        self._asked_for: tuple[str, ...] | None = None
        self._looked_s = 0.0

    def follow(
        self,
        sights: "Mapping[str, Sight]",
        levels: Mapping[str, Level],
        images: Mapping[str, QImage],
        bars: "tuple[FloatArray, ...]" = (),
        with_ball: bool = True,
    ) -> None:
        """Show how things stand now; `bars`: ends (2, 3) of each bar as it lies, mm in the world of `known`."""
        advice, now = self._controller.advice, time.monotonic()
        advice.survey(sights)
        self._show_rig(tuple(levels))
        data, known = self.view.data, advice.known
        if data is None or not self.view.isVisible():
            return
        if with_ball and now - self._looked_s > LOOK_S and advice.look_at_ball(sights):
            self._looked_s = now
        ghost = known.ghost if known is not None and with_ball else None
        ball = live_ball(data, ghost, advice.lying) if ghost is not None else None
        lying = tuple((in_scene(data, ends), True) for ends in bars)
        self.view.show_live(LiveParts(ball, False, lying, levels, images))

    def _show_rig(self, cameras: tuple[str, ...]) -> None:
        """Where the cameras are: what the ball in sight says, else as they stood when they were calibrated last."""
        known = self._controller.advice.known
        if known is not None and known.scene is not None and known.scene is not self._shown:
            self._shown = known.scene
            self.view.show_scene(replace(known.scene, wanted=None))
        elif known is None and cameras != self._asked_for:
            self._asked_for = cameras
            rig = rig_in_use(self._controller.profile_folder, cameras)
            self.view.show_scene(rig_scene(rig) if rig is not None else None)
        self.view.setVisible(self.view.data is not None)


_STEP_DB = 0.5
# GenICam's names; a camera that lacks one takes the nearest. More bits than eight are of use in dim light.
_FORMATS = ("Mono8", "Mono10", "Mono12", "Mono12p", "Mono16", "BayerRG8", "BayerRG12")


class LookPage(LivePage):
    """Every camera's live image with its dots, its light and its focus."""

    wants_histograms = True

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.deeds = {"accept": controller.cameras.accept_look}
        self.headline = self.summary = label("", "huge")
        self.warm_up = label("", "", level="caution", hidden=True)
        self.wall = Wall(renames=True)
        self.wall.masked.connect(self.controller.recording.mask)
        self.wall.renamed.connect(self.controller.tuning.name_camera)
        self.message = label("", "soft")
        tools = add(QHBoxLayout(), None, *self._for_all(), *self._of_masks())
        self.space = RigSpace(controller)
        row = add(QHBoxLayout(), (self.wall, 5), (self.space.view, 3))
        add(QVBoxLayout(self), self.summary, self.warm_up, self.message, tools, (row, 1))
        self._states: list[TileState] = []

    def _for_all(self) -> tuple[QWidget, ...]:
        """What is set for all cameras."""
        tip = self.tr("Each camera gets the longest exposure by which its dots are not saturated.")
        self.expose = button(self.tr("Set exposures"), "expose-all", act=self.controller.tuning.expose_all, tip=tip)
        says = self.tr("Pixel format of all cameras")
        self.format = named(QComboBox(), "pixel-format", says, says)
        self.format.addItems(_FORMATS)
        self.format.textActivated.connect(lambda name: self.controller.tuning.set_all(pixel_format=name))
        says = self.tr("Gain of all cameras")
        self.gain = number_field("gain-all", says, (-_STEP_DB, MOST_GAIN_DB), "dB", step=_STEP_DB, tip=says)
        self.gain.setSpecialValueText(self.tr("different gains"))
        self.gain.setKeyboardTracking(False)
        self.gain.valueChanged.connect(self._set_gain)
        return self.format, self.gain, self.expose

    def _set_gain(self, gain_db: float) -> None:
        if gain_db >= 0:
            self.controller.tuning.set_all(gain_db=gain_db)

    def _of_masks(self) -> tuple[QWidget, ...]:
        """Reflections and strange targets are covered with the mouse; in the order of the tiles."""
        tip = self.tr("Draw a rectangle over a reflection: nothing in it counts as a target.")
        self.draw = button(self.tr("Mask reflections"), "draw-mask", tip=tip)
        self.draw.setCheckable(True)
        self.draw.toggled.connect(self._masking)
        self.undo = button(self.tr("Undo the last mask"), "undo-mask", act=self.controller.recording.undo_mask)
        self.clear = button(self.tr("Clear all masks"), "clear-masks", act=self.controller.recording.clear_masks)
        self.fixed = button(self.tr("Fixed again"), "fixed-again", act=self.controller.cameras.accept_moved)
        self.fixed.setToolTip(self.tr("The cameras that were moved are fixed: they count as they stand now."))
        self.fixed.hide()
        self.worst = button(self.tr("Worst first"), "worst-first")
        self.worst.setCheckable(True)
        self.worst.setChecked(True)
        self.worst.toggled.connect(self.wall.worst_first)
        return self.fixed, self.worst, self.draw, self.undo, self.clear

    def _masking(self, on: bool) -> None:
        self.wall.set_masking(on)
        self._show_masks()

    def _show_masks(self) -> None:
        masks = self.project.masks if self.project is not None else ()
        text = self.tr("Draw rectangles over what is no target, then press “{button}” again.")
        text = text.format(button=self.draw.text())
        if not self.draw.isChecked():
            text = self.tr("Masks: {count}").format(count=len(masks)) if masks else ""
        say(self.message, text)
        for one in (self.format, self.gain, self.expose):  # one row has no room for all
            one.setVisible(not self.draw.isChecked() and (one is self.expose or not theme.is_far()))
        for one in (self.undo, self.clear):
            one.setVisible(self.draw.isChecked())
        self.worst.setVisible(not self.draw.isChecked())
        idle = self.controller.runner.running is None
        busy, none = self.tr("Work is running."), self.tr("There are no masks.")
        connected = self.controller.cameras.connection is not None
        for one in (self.expose, self.format, self.gain, self.draw):
            enable(one, idle and connected, busy)
        settings = self.controller.tuning.of_all()
        formats, gains = {one.pixel_format for one in settings}, {one.gain_db for one in settings}
        self.format.setCurrentIndex(self.format.findText(formats.pop()) if len(formats) == 1 else -1)
        if not self.gain.hasFocus():
            with QSignalBlocker(self.gain):
                self.gain.setValue(gains.pop() if len(gains) == 1 else self.gain.minimum())
        for one in (self.undo, self.clear):
            enable(one, idle and bool(masks), none if idle else busy)

    def leave(self) -> None:
        """Masks are drawn only while this page is seen."""
        self.draw.setChecked(False)

    def enter(self, step: Step) -> None:
        """Show the ball's first place, where nobody moves it by hand."""
        super().enter(step)
        poses = self.controller.cameras.staged_poses
        if poses:
            self.controller.staging.show_pose(poses[0])

    def show_project(self) -> None:
        """Show the cameras that are open."""
        self.show_cameras()
        self._show_masks()
        self.tick()

    def tick(self) -> None:
        """Follow the cameras."""
        self._states = self.follow()
        self.space.follow(self.sights(), *self.tiles_now())
        live, names = self.controller.cameras.live, self.controller.cameras.names
        rates = live.warm_up.unsteady() if live is not None else {}
        text = warm_up_text({names[serial]: rate for serial, rate in rates.items() if serial in names})
        say(self.warm_up, text, "caution")
        self.show_standing()
        self.fixed.setVisible("fixed-again" in self.said().also)

    def says(self) -> Said:
        """Whether the images are good."""
        state, moved = self.state, self.controller.cameras.moved()
        images = bool(self._states) and all(tile.image is not None for tile in self.wall.tiles.values())
        text: tuple[str, Level] = summary(self._states, images) if self._states else ("", "none")
        searched = bool(self._states) and not any(one.level == "none" for one in self._states)
        accepted = state is not None and state.status is Status.DONE
        if moved:
            text = moved_text(moved), "bad"
        return look_says(LookFacts(text, images, searched, accepted, bool(moved)))
