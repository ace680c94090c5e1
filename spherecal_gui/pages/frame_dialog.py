"""Origin and axes: in which frame exports are given."""

from collections.abc import Callable
from functools import partial
from typing import get_args

from PySide6.QtCore import QLineF, QPointF, QSignalBlocker, Qt
from PySide6.QtGui import QColor, QPainter, QPen
from PySide6.QtWidgets import QComboBox, QDialog, QGridLayout, QHBoxLayout, QVBoxLayout, QWidget

from spherecal_documents.scene.eye import Eye
from spherecal_documents.scene.model import AXIS_TINTS, SceneData
from spherecal_gui import theme
from spherecal_gui.presenters.frame_presenter import FrameChoice, Role, turn_word
from spherecal_gui.widgets.basic import add, button, enable, ink, label, named, say
from spherecal_gui.widgets.fields import number_field
from spherecal_gui.widgets.scene_view import SceneView
from spherecal_rigs.user_frame import TURNS

_MOST_MM = 100_000.0
_ROLES: tuple[Role, ...] = get_args(Role)


class FrameScene(SceneView):
    """The rig with the user's axes and the places that define them."""

    def __init__(self, choice: FrameChoice) -> None:
        super().__init__()
        self._choice = choice
        self.show_scene(choice.scene)

    def paint_rig(self, painter: QPainter, data: SceneData, eye: Eye) -> None:
        """Draw the rig and the axes over it."""
        super().paint_rig(painter, data, eye)
        painter.setFont(theme.font(theme.LEAD, bold=True))
        ink(painter, theme.now().text, 2)
        for name, place in self._choice.marked:
            at = QPointF(*eye.flat(place[None])[0].tolist())
            painter.drawEllipse(at, 7, 7)
            painter.drawText(at + QPointF(10, 18), name)
        for (start, end), tint, letter in zip(self._choice.axes, AXIS_TINTS, "XYZ", strict=False):
            (ax, ay), (bx, by) = eye.flat(start[None])[0].tolist(), eye.flat(end[None])[0].tolist()
            painter.setPen(QPen(QColor(tint), 6, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
            painter.drawLine(QLineF(ax, ay, bx, by))
            painter.drawText(QPointF(bx + 6, by - 4), letter)


class FrameDialog(QDialog):
    """Origin, X and plane by places, an offset, turns by 90 degrees; the picture follows at once."""

    def __init__(self, choice: FrameChoice, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.choice = choice
        self.setWindowTitle(self.tr("Origin and axes"))
        self.scene = FrameScene(choice)
        self.scene.setMinimumWidth(480)
        self.undo = button(self.tr("Undo"), "frame-undo", act=partial(self._do, choice.undo))
        self.reset = button(self.tr("No offset, no turns"), "frame-reset", act=partial(self._do, choice.reset))
        changes = add(QHBoxLayout(), (self.undo, 1), (self.reset, 2))
        side = add(QVBoxLayout(), self._places(), label(self.tr("Turn the axes by 90 degrees:")), self._turns())
        add(side, label(self.tr("The origin's place lies at:")), self._offset(), changes, None)
        self.sentence = label("")
        self.sentence.setMinimumHeight(3 * self.sentence.fontMetrics().lineSpacing())
        row = add(QHBoxLayout(), (self.scene, 1), side)
        add(QVBoxLayout(self), (row, 1), self.sentence, self._buttons())
        self.resize(1080, 700)
        self._show()

    def done(self, result: int) -> None:
        """Let go of what renders."""
        self.scene.close_view()
        super().done(result)

    def _places(self) -> QGridLayout:
        grid, self.place = QGridLayout(), {}
        titles = (self.tr("Origin"), self.tr("X axis to"), self.tr("XY plane with"))
        for row, (role, title) in enumerate(zip(_ROLES, titles, strict=True)):
            box = named(QComboBox(), f"frame-{role}", title)
            box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
            box.setMinimumContentsLength(14)
            box.addItem(self.tr("the reference camera") if role == "origin" else "-", None)
            for name, text in self.choice.options:
                box.addItem(text, name)
            box.currentIndexChanged.connect(partial(self._chosen, role))
            self.place[role] = box
            grid.addWidget(label(title, wrap=False), row, 0)
            grid.addWidget(box, row, 1)
        grid.setColumnStretch(1, 1)
        return grid

    def _offset(self) -> QVBoxLayout:
        column, self.shift = QVBoxLayout(), []
        for axis in "XYZ":
            says = self.tr("Offset along {axis}, mm").format(axis=axis)
            box = number_field(f"frame-offset-{axis.lower()}", says, (-_MOST_MM, _MOST_MM), "mm", step=10.0)
            box.setPrefix(f" {axis}  ")
            box.valueChanged.connect(self._shifted)
            self.shift.append(box)
            column.addWidget(box)
        return column

    def _turns(self) -> QGridLayout:
        grid = QGridLayout()
        for i, turn in enumerate(TURNS):
            one = button(turn_word(turn), f"turn-{turn}")
            spoken = self.tr("Turn the axes about {axis} by {angle} degrees")
            one.setAccessibleName(spoken.format(axis=turn[0].upper(), angle=turn[1:]))
            one.setMinimumHeight(round(theme.pt(40)))
            one.clicked.connect(partial(self._do, partial(self.choice.turn, turn)))
            grid.addWidget(one, i % 2, i // 2)
        return grid

    def _buttons(self) -> QHBoxLayout:
        back = partial(self._do, self.choice.back_to_camera)
        self.camera = button(self.tr("Back to the reference camera"), "frame-camera", act=back)
        cancel = button(self.tr("Cancel"), "frame-cancel", act=self.reject)
        self.ok = button(self.tr("OK"), "frame-ok", "primary", act=self.accept)
        return add(QHBoxLayout(), self.camera, None, cancel, self.ok)

    def _chosen(self, role: Role, _: int) -> None:
        self.choice.choose(role, self.place[role].currentData())
        self._show()

    def _shifted(self, _: float) -> None:
        x, y, z = (box.value() for box in self.shift)
        self.choice.let_lie_at((x, y, z))
        self._show()

    def _do(self, act: Callable[[], None], _: bool = False) -> None:
        act()
        self._show()

    def _show(self) -> None:
        """Everything as the choice is now."""
        definition = self.choice.definition
        for role, box in self.place.items():
            with QSignalBlocker(box):
                box.setCurrentIndex(max(box.findData(getattr(definition, role)), 0))
            box.setEnabled(role == "origin" or definition.origin is not None)
        for box, value in zip(self.shift, self.choice.lies_at_mm, strict=True):
            if box.value() != value:  # else the cursor leaves the place where somebody types
                with QSignalBlocker(box):
                    box.setValue(value)
        text, level = self.choice.sentence
        say(self.sentence, text, level)
        enable(self.ok, self.choice.frame is not None, text)
        enable(self.undo, self.choice.can_undo, self.tr("Nothing was changed yet."))
        enable(self.camera, not self.choice.is_plain, self.tr("It is chosen already."))
        self.scene.update()
