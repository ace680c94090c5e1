"""What pages with live images share: tiles that follow the cameras, and the scene with the rig and the ball in it."""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtGui import QImage

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import translate
from spherecal_gui.pages.wizard_page import Page
from spherecal_gui.presenters.look_presenter import Expected, TileState, figures_text, tile_state, usual_light
from spherecal_gui.presenters.step_states import Work
from spherecal_gui.rig_scenes import LiveParts, in_scene, live_ball, rig_in_use, rig_scene
from spherecal_gui.standing import Level
from spherecal_gui.widgets.basic import plain
from spherecal_gui.widgets.rendered_scene import RenderedScene
from spherecal_gui.widgets.tile import Wall

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
        expected = Expected(self.wants_dots, by_some, usual)
        states = []
        for serial, tile in self.wall.tiles.items():
            frame, sight = live.frame(serial), live.sight(serial)
            state = tile_state(tile.name, statuses.get(serial), sight, expected, frame, live.watch.bumped.get(serial))
            exposure_us = self.controller.tuning.settings_of(serial).exposure_us
            state = replace(state, figures=figures_text(serial, statuses.get(serial), exposure_us))
            states.append(state)
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
        self.view = RenderedScene()
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
