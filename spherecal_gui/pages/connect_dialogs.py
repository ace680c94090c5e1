"""On Connect: one camera with what is set at it; why no camera is found; the list of makers and their drivers."""

import numpy as np
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QDialog,
    QFormLayout,
    QHBoxLayout,
    QLineEdit,
    QVBoxLayout,
    QWidget,
)

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.presenters.connect_presenter import model_text
from spherecal_gui.presenters.drivers_presenter import DriverNote, makers_rows
from spherecal_gui.presenters.look_presenter import tile_state
from spherecal_gui.widgets.basic import add, bare, button, clear, details_button, enable, label, named, plain, spaced
from spherecal_gui.widgets.fields import number_field
from spherecal_gui.widgets.table import Table
from spherecal_gui.widgets.tile import CameraTile

_TICK_MS = 100
_MOST_EXPOSURE_MS, MOST_GAIN_DB = 10_000.0, 48.0


class CameraDialog(QDialog):
    """Which of the cameras in the rig this one is, and how it is set."""

    def __init__(self, controller: Controller, serial: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.controller, self.serial = controller, serial
        connection = controller.cameras.connection
        assert connection is not None
        info = connection.info(serial)
        self.name = connection.names[serial]
        self.setWindowTitle(f"{self.name} · {serial}")
        self.tile = CameraTile(serial, self.name)
        self.tile.setMinimumSize(520, 420)
        self.blink = button(self.tr("Let its light blink"), "blink", act=self._blink)
        enable(self.blink, controller.tuning.can_blink(), self.tr("These cameras have no light."))
        self.message = label("" if controller.tuning.can_blink() else self.tr("These cameras have no light."), "soft")
        about = label(f"{model_text(info.model) if info is not None else ''}  {serial}".strip(), "soft")
        which = label(self.tr("Hold a hand before a lens: the picture that goes dark is that camera's."))
        side = add(QVBoxLayout(), label(self.name, "huge", wrap=False), about, which, self.blink, self.message, None)
        self.apply = button(self.tr("Apply"), "apply-camera", act=self._apply)
        buttons = add(QHBoxLayout(), self.apply, button(self.tr("Close"), "close-camera", act=self.accept))
        add(QHBoxLayout(self), (self.tile, 1), add(side, self._form(), buttons))
        self._timer = QTimer(self, interval=_TICK_MS)
        self._timer.timeout.connect(self._tick)
        self._timer.start()
        self.finished.connect(self._timer.stop)
        self.resize(1000, 600)
        self._tick()

    def _form(self) -> QFormLayout:
        settings = self.controller.tuning.settings_of(self.serial)
        form = QFormLayout()
        self.name_field = QLineEdit(self.name)
        self.name_field.setObjectName("camera-name")
        why = self.controller.tuning.why_not_renamed(self.serial)
        self.name_field.setEnabled(not why)
        self.name_field.setToolTip(plain(why))
        self.why_not = label(why, "soft")
        self.exposure = number_field("", "", (0.01, _MOST_EXPOSURE_MS), "ms")
        self.exposure.setValue(settings.exposure_us / 1e3)
        self.gain = number_field("", "", (0.0, MOST_GAIN_DB), "dB")
        self.gain.setValue(settings.gain_db)
        for text, field in (
            (self.tr("Name"), self.name_field),
            (self.tr("Exposure"), self.exposure),
            (self.tr("Gain"), self.gain),
        ):
            field.setAccessibleName(text)
            form.addRow(text, field)
            if field is self.name_field and why:
                form.addRow("", self.why_not)
        form.addRow(self.tr("Trigger of all cameras"), self._trigger_field(settings.trigger))
        return form

    def _trigger_field(self, chosen: str) -> QComboBox:
        self.trigger = named(QComboBox(), "camera-trigger", self.tr("Trigger of all cameras"))
        self.trigger.addItem(self.tr("Software, one after the other"), "software")
        self.trigger.addItem(self.tr("Common clock (IEEE 1588), all at once"), "scheduled")
        self.trigger.addItem(self.tr("Trigger box, all at once"), "hardware")
        self.trigger.addItem(self.tr("None: free running"), "free")
        self.trigger.setCurrentIndex(self.trigger.findData(chosen))
        enable(self.trigger, not self.controller.tuning.why_no_trigger(), self.controller.tuning.why_no_trigger())
        self.trigger.activated.connect(lambda _: self.controller.tuning.set_all(trigger=self.trigger.currentData()))
        return self.trigger

    def _tick(self) -> None:
        """Follow the camera; the dialog goes when the camera is no longer there."""
        connection, live = self.controller.cameras.connection, self.controller.cameras.live
        if connection is None or self.serial not in connection.names:
            if self.controller.runner.running is None:
                self.close()
            return
        idle = self.controller.runner.running is None
        enable(self.apply, idle, self.tr("Work is running."))
        if live is None:
            return
        frame, sight = live.frame(self.serial), live.sight(self.serial)
        if frame is not None:
            self.tile.show_image(frame.image, frame.bits, frame.arrived_s)
        status = connection.source.statuses().get(self.serial)
        state = tile_state(self.tile.name, status, sight, newest=frame)
        self.tile.show_histogram(sight.histogram if sight is not None else None)
        self.tile.show_state(state, sight.dots.uv if sight is not None else np.empty((0, 2)))

    def _apply(self) -> None:
        name = self.name_field.text().strip() or self.name
        self.controller.tuning.set_camera(self.serial, name, 1e3 * self.exposure.value(), self.gain.value())

    def _blink(self) -> None:
        self.message.setText(self.tr("Its light blinks for some seconds."))
        self.blink.setEnabled(False)
        self.controller.tuning.blink(self.serial, self._blinked)

    def _blinked(self, has_light: bool) -> None:
        try:
            self.blink.setEnabled(has_light)
            self.message.setText("" if has_light else self.tr("This camera has no light that can be switched."))
        except RuntimeError:  # the dialog was closed meanwhile
            return


class DriversPanel(QWidget):
    """One block for each reason; `of_drivers`: the list of makers is offered too."""

    allowed = Signal(str)  # the file of a driver
    builtin = Signal()  # the built-in driver is to be used
    cured = Signal(str)  # the command that mends this computer's network

    def __init__(self, of_drivers: bool = True) -> None:
        super().__init__()
        self._notes: list[DriverNote] | None = None
        self._blocks = spaced(QVBoxLayout(), 10)
        self.makers = button(self.tr("Makers and their drivers"), "makers", act=self.show_makers)
        if not of_drivers:
            self.makers.hide()
        add(bare(QVBoxLayout(self)), self._blocks, add(QHBoxLayout(), self.makers, None))
        self.hide()

    def show_notes(self, notes: list[DriverNote]) -> None:
        """Show these; nothing where there are none."""
        if notes == self._notes:
            return
        self._notes = notes
        clear(self._blocks)
        for note in notes:
            self._blocks.addWidget(self._block(note))
        self.setVisible(bool(notes))

    def _block(self, note: DriverNote) -> QWidget:
        box = QWidget()
        column = bare(QVBoxLayout(box), 2)
        if note.title:
            column.addWidget(label(note.title, "big", level=note.level))
        for step in note.steps:
            line = label(f"• {step}")
            line.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)  # commands are copied
            line.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            column.addWidget(line)
        for offered, text, key, act, tip in (
            (note.allow, self.tr("Allow this driver"), "allow-driver", lambda: self.allowed.emit(note.allow), ""),
            (note.builtin, self.tr("Use the built-in driver"), "builtin-driver", self.builtin, ""),
            (note.cure, self.tr("Do it now"), "apply-cure", lambda: self.cured.emit(note.cure), plain(note.cure)),
        ):
            if offered:
                column.addWidget(button(text, key, act=act, tip=tip), 0, Qt.AlignmentFlag.AlignLeft)
        if note.details:
            said = label(note.details, "soft")
            column.addWidget(details_button(said), 0, Qt.AlignmentFlag.AlignLeft)
            column.addWidget(said)
        return box

    def show_makers(self) -> QDialog:
        """The list of makers."""
        dialog = MakersDialog(self)
        dialog.show()
        return dialog


class MakersDialog(QDialog):
    """Makers, the package of each one's driver, its file, where it usually lies on this system."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("Makers and their drivers"))
        message = self.tr("Install the maker's package; its driver is then found by itself. Never copy the .cti file.")
        self.table = Table(
            [self.tr("Maker"), self.tr("Package"), self.tr("Driver's file"), self.tr("Usual folder")], sortable=False
        )
        self.table.fill(makers_rows())
        self.table.setWordWrap(False)  # else rows are made for columns that are not yet as wide as their texts
        self.table.resizeRowsToContents()
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        close = button(self.tr("Close"), "close-makers", act=self.accept)
        add(QVBoxLayout(self), label(message), (self.table, 1), add(QHBoxLayout(), None, close))
        self.resize(1100, 640)
