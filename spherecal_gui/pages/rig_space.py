"""The live scene of a page: cameras with their images, the ball as it lies now, and what else the page has in it."""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from PySide6.QtGui import QImage

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.rig_scenes import LiveParts, in_scene, live_ball, rig_in_use, rig_scene
from spherecal_gui.standing import Level
from spherecal_gui.widgets.rendered_scene import RenderedScene

if TYPE_CHECKING:  # detection is loaded by the thread that connects the cameras
    from spherecal.base.arrays import FloatArray
    from spherecal_gui.tasks.live_detection import Sight

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
