"""Look: the wall of all cameras."""

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QVBoxLayout, QWidget

from spherecal_gui import theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import moved_text
from spherecal_gui.pages.camera_dialog import MOST_GAIN_DB
from spherecal_gui.pages.live_page import LivePage, RigSpace
from spherecal_gui.presenters.look_presenter import TileState, summary, warm_up_text
from spherecal_gui.presenters.step_states import LookFacts, look_says
from spherecal_gui.standing import Level, Said
from spherecal_gui.widgets.basic import add, button, enable, label, named, say
from spherecal_gui.widgets.fields import number_field
from spherecal_gui.widgets.tile import Wall
from spherecal_gui.workflow import Status, Step

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
        images = bool(self._states) and all(tile.has_image for tile in self.wall.tiles.values())
        text: tuple[str, Level] = summary(self._states, images) if self._states else ("", "none")
        searched = bool(self._states) and not any(one.level == "none" for one in self._states)
        accepted = state is not None and state.status is Status.DONE
        if moved:
            text = moved_text(moved), "bad"
        return look_says(LookFacts(text, images, searched, accepted, bool(moved)))
