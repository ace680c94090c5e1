"""The rig, rendered by pyvista in a process of its own; painted by Qt without it, or with SPHERECAL_3D=painted."""

import itertools
import time
from dataclasses import replace

import numpy as np
from PySide6.QtCore import QBuffer, QPointF, QRectF, Qt, QTimer, Signal
from PySide6.QtGui import (
    QColor,
    QFocusEvent,
    QHideEvent,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPixmap,
    QResizeEvent,
    QShowEvent,
    QWheelEvent,
)

from spherecal.base.arrays import FloatArray
from spherecal_documents.scene.eye import Eye, View, fitting_view
from spherecal_documents.scene.model import SceneData
from spherecal_documents.scene.renderer import can_render
from spherecal_documents.scene.shapes import SHOWN_AT_FIRST, SceneStyle
from spherecal_gui import theme
from spherecal_gui.rig_scenes import LiveParts, SceneItem, items_of
from spherecal_gui.tasks import scene_process
from spherecal_gui.tasks.scene_process import RequestedPicture, SceneProcess
from spherecal_gui.widgets.basic import Canvas, ink
from spherecal_gui.widgets.painted_scene import PaintedRig
from spherecal_gui.widgets.scene_overlay import Overlay, paint_live

_NEAR_PX, _HOVER_PX = 28.0, 14.0
DEG_PER_PX = 0.4
_CLOSER = 1.15  # by one click of the wheel
_MARGIN_PX = 48.0
_CLICK_PX = 4
_TURN_KEY_DEG = 10.0
_LEAVE_MS = 30_000
_REST_MS = 180  # so long after the last turn the picture is rendered with smooth edges
_numbers = itertools.count(1)


class SceneView(Canvas):
    """A rig that is turned by dragging, moved with the right button and enlarged by the wheel."""

    camera_chosen = Signal(str)  # it was double-clicked
    hint = (560, 420)

    def __init__(self) -> None:
        super().__init__()
        self.setMinimumSize(260, 200)
        self.setObjectName("scene")
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.data: SceneData | None = None
        self.marked: str | None = None
        self.live = LiveParts()
        self.layers: frozenset[str] = SHOWN_AT_FIRST
        self._view = View(np.zeros(3), 0.0, 0.0)
        self._side = "oblique"
        self._untouched = True  # a view that nobody has turned keeps everything in sight when the window grows
        self._ringed = False
        self._dragged: QPointF | None = None
        self._pressed: QPointF | None = None
        self._overlay = Overlay(self)
        self._items: list[SceneItem] = []
        self._hovered: SceneItem | None = None
        self._painted: PaintedRig | None = None
        self._id = next(_numbers)
        self._version = self._number = self._got = self._fine = 0
        self._process: SceneProcess | None = None
        self._image: QImage | None = None
        self._image_eye: Eye | None = None
        self._asked: dict[int, Eye] = {}
        self._broken = not can_render()
        self._shown_at: float | None = None
        self.first_picture_s: float | None = None  # from being shown to the first rendered picture
        self._rest = QTimer(self, singleShot=True, interval=_REST_MS)
        self._rest.timeout.connect(self._ask_fine)
        self._leave = QTimer(self, singleShot=True, interval=_LEAVE_MS)
        self._leave.timeout.connect(self.close_view)

    # --- what is shown -----------------------------------------------------------------------------------------------

    def show_scene(self, data: SceneData | None) -> None:
        """Show a rig."""
        fresh = self.data is None or data is None or data.scene is not self.data.scene
        self.data, self.live = data, LiveParts()
        names = ", ".join(camera.id for camera in data.scene.cameras) if data else ""
        self.setAccessibleName(self.tr("The rig with its cameras {names}").format(names=names))
        self._hovered = None
        self._list_items()
        if fresh:
            self.look_from("oblique")
        self.scene_changed()

    def show_live(self, parts: LiveParts) -> None:
        """Show what changes while the scene is looked at: painted over it, so that no scene is rendered again."""
        self.live = parts
        self.update()

    def mark(self, camera: str | None) -> None:
        """Make one camera stand out."""
        self.marked = camera
        self.scene_changed()

    def set_layers(self, layers: frozenset[str]) -> None:
        """Show these of scene_shapes.LAYERS."""
        self.layers = frozenset(layers)
        self._list_items()
        self.scene_changed()

    def _list_items(self) -> None:
        self._items = [] if self.data is None else items_of(self.data, self.layers)

    def style_of_now(self) -> SceneStyle:
        """The palette's colours, as the scene takes them."""
        c = theme.now()
        scene, border, text, accent = map(theme.rgb, (c.scene, c.border, c.text, c.accent))
        good, caution, bad = map(theme.rgb, (c.good, c.caution, c.bad))
        return SceneStyle(c.dark, scene, border, text, accent, good, caution, bad, self.layers, self.marked)

    def scene_changed(self) -> None:
        """The scene, its layers or its colours are others."""
        self._painted = None
        self._version += 1
        self.view_changed()

    def view_changed(self) -> None:
        """It is looked at from elsewhere: rendered without smooth edges, with them once nobody turns it any more."""
        self.update()
        self._rest.stop()
        self._ask(fine=False)

    # --- rendered ----------------------------------------------------------------------------------------------------

    @property
    def rendered(self) -> bool:
        """Whether the picture of pyvista is on the screen."""
        return self._image is not None and not self._broken

    @property
    def settled(self) -> bool:
        """Whether there is nothing to wait for: the newest picture with smooth edges, or none by pyvista at all."""
        return self._broken or self.data is None or (self.rendered and self._got == self._number == self._fine)

    def showEvent(self, event: QShowEvent) -> None:
        """Begin to render."""
        super().showEvent(event)
        self._leave.stop()
        if self._process is None and not self._broken:
            self._shown_at = time.monotonic()
            self._process = scene_process.take()
            self._process.rendered.connect(self._rendered)
            self._process.failed.connect(self._failed)
        self.view_changed()

    def hideEvent(self, event: QHideEvent) -> None:
        """Nobody sees it: after a while what renders is let go of, as it holds some hundred MB."""
        self._rest.stop()
        if self._process is not None:
            self._leave.start()
        super().hideEvent(event)

    def close_view(self) -> None:
        """Let go of the process."""
        self._rest.stop()
        self._leave.stop()
        if self._process is not None:
            self._process.rendered.disconnect(self._rendered)
            self._process.failed.disconnect(self._failed)
            self._process = None
            scene_process.give_back()

    def _ask(self, fine: bool) -> bool:
        if self._process is None or self.data is None or not self.isVisible() or self._broken:
            return False
        self._number += 1
        eye, ratio = self.eye, self.devicePixelRatioF()
        self._asked[self._number] = eye
        eye = replace(eye, scale=eye.scale * ratio, width=round(eye.width * ratio), height=round(eye.height * ratio))
        self._process.want(
            RequestedPicture(self._id, self._version, self.data, self.style_of_now(), eye, fine, self._number)
        )
        return True

    def _ask_fine(self) -> None:
        if self._ask(fine=True):
            self._fine = self._number

    def _rendered(self, view: int, number: int, image: QImage) -> None:
        if view != self._id or number < self._got:
            return
        if self.first_picture_s is None and self._shown_at is not None:
            self.first_picture_s = time.monotonic() - self._shown_at
        self._got, self._image, self._image_eye = number, image, self._asked.get(number)
        self._asked = {n: eye for n, eye in self._asked.items() if n >= number}
        if number == self._number != self._fine:  # nothing newer is under way, and this one is not smooth
            self._rest.start()
        self.update()

    def _failed(self, _: str) -> None:
        self._broken = True
        self._image = None
        self.update()

    # --- from where --------------------------------------------------------------------------------------------------

    @property
    def eye(self) -> Eye:
        """The projection onto this widget."""
        return self._view.eye(self.width(), self.height())

    @property
    def shown_eye(self) -> Eye:
        """The projection of the picture on the screen, so that names turn with it."""
        there, eye = self._image_eye if self.rendered else None, self.eye
        return there if there is not None and (there.width, there.height) == (eye.width, eye.height) else eye

    def look_from(self, side: str) -> None:
        """Look from one of scene_eye.SIDES, everything in sight."""
        self._side, self._untouched = side, True
        if self.data is None:
            return
        room = [max(length - 2 * _MARGIN_PX, 40.0) for length in (self.width(), self.height())]
        self._view = fitting_view(self.data.every_place(), side, *room)
        self.view_changed()

    def turn(self, right_px: float, down_px: float) -> None:
        """Turn the view as the mouse was dragged."""
        self._set(self._view.turned(-DEG_PER_PX * right_px, DEG_PER_PX * down_px))

    def come_closer(self, factor: float, at: QPointF | None = None) -> None:
        """Come closer or step back; the place under the mouse keeps its place. `at` None: the middle."""
        off = QPointF(0, 0) if at is None else at - QPointF(self.width() / 2, self.height() / 2)
        self._set(self._view.closer(factor, off.x(), off.y()))

    def _set(self, view: View) -> None:
        self._view, self._untouched = view, False
        self.view_changed()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Everything stays in sight where nobody has turned the view."""
        super().resizeEvent(event)
        if self._untouched:
            self.look_from(self._side)
        else:
            self.view_changed()

    def on_screen(self) -> dict[str, tuple[float, float]]:
        """Where the cameras' centres are, in the widget's coordinates."""
        if self.data is None:
            return {}
        eye = self.eye
        return {one.id: tuple(eye.flat(one.centre[None])[0].tolist()) for one in self.data.scene.cameras}

    # --- mouse and keys ----------------------------------------------------------------------------------------------

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin to turn or move."""
        self._dragged = self._pressed = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Turn or move; without a button say what is under the mouse."""
        if self._dragged is None:
            if (found := self.item_at(event.position())) is not self._hovered:
                self._hovered = found
                self.update()
            return
        moved, self._dragged = event.position() - self._dragged, event.position()
        shifted = event.modifiers() & Qt.KeyboardModifier.ShiftModifier
        if not event.buttons() or (event.buttons() & Qt.MouseButton.LeftButton and not shifted):
            self.turn(moved.x(), moved.y())
        else:
            self._set(self._view.moved(moved.x(), moved.y()))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """End turning; a click on the cube looks from there."""
        pressed, self._dragged, self._pressed = self._pressed, None, None
        if pressed is None:
            return
        if (event.position() - pressed).manhattanLength() <= _CLICK_PX:
            side = self._overlay.side_at(event.position(), self.eye)
            if side is not None:
                self.look_from(side)
                return
        self.view_changed()

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Choose the camera that was meant."""
        at = np.array([event.position().x(), event.position().y()])
        places = self.on_screen()
        near = sorted(places, key=lambda name: float(np.hypot(*(np.array(places[name]) - at))))
        if near and np.hypot(*(np.array(places[near[0]]) - at)) < _NEAR_PX:
            self.camera_chosen.emit(near[0])

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Come closer or step back."""
        self.come_closer(_CLOSER if event.angleDelta().y() > 0 else 1 / _CLOSER, event.position())

    def focusInEvent(self, event: QFocusEvent) -> None:
        """Reached by the Tab key: the edge says so."""
        self._ringed = event.reason() in (Qt.FocusReason.TabFocusReason, Qt.FocusReason.BacktabFocusReason)
        super().focusInEvent(event)
        self.update()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Another widget has the keys."""
        self._ringed = False
        super().focusOutEvent(event)
        self.update()

    def leaveEvent(self, _: object) -> None:
        """Nothing is under the mouse."""
        if self._hovered is not None:
            self._hovered = None
            self.update()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Arrows turn, plus and minus enlarge, Home shows everything."""
        turns = {Qt.Key.Key_Left: (-1, 0), Qt.Key.Key_Right: (1, 0), Qt.Key.Key_Up: (0, 1), Qt.Key.Key_Down: (0, -1)}
        key = Qt.Key(event.key())
        if key in turns:
            right, up = turns[key]
            self._set(self._view.turned(_TURN_KEY_DEG * right, _TURN_KEY_DEG * up))
        elif key in (Qt.Key.Key_Plus, Qt.Key.Key_Minus):
            self.come_closer(_CLOSER if key is Qt.Key.Key_Plus else 1 / _CLOSER)
        elif key == Qt.Key.Key_Home:
            self.look_from("oblique")
        else:
            super().keyPressEvent(event)

    def item_at(self, at: QPointF) -> SceneItem | None:
        """What is nearest to a place on the widget; of things that lie behind one another, the one in front."""
        if not self._items:
            return None
        eye = self.eye
        places = np.array([item.place for item in self._items])
        off = np.linalg.norm(eye.flat(places) - np.array([at.x(), at.y()]), axis=1)
        reach = np.array([max(item.radius_mm * eye.scale, _HOVER_PX) for item in self._items])
        near = np.flatnonzero(off <= reach)
        if not len(near):
            return None
        depth = places @ eye.towards + np.array([item.radius_mm for item in self._items])
        small = np.array([item.rank for item in self._items])
        # a dot on the far side of its ball is behind the ball
        order = sorted(near.tolist(), key=lambda i: (small[i], -depth[i], off[i]))
        for i in order:
            hiding = [
                k for k in near.tolist() if self._items[k].kind == "ball" and depth[k] > depth[i] + 1e-6 and k != i
            ]
            if self._items[i].kind == "camera" or not self._hidden(i, hiding, places, eye):
                return self._items[i]
        return self._items[order[0]]

    def _hidden(self, i: int, balls: list[int], places: FloatArray, eye: Eye) -> bool:
        for k in balls:
            way = places[i] - places[k]
            across = way - (way @ eye.towards) * eye.towards
            half = self._items[k].radius_mm ** 2 - float(across @ across)
            if half > 0 and float(way @ eye.towards) < np.sqrt(half) - 0.05 * self._items[k].radius_mm:
                return True
        return False

    # --- painting ----------------------------------------------------------------------------------------------------

    def paint(self, painter: QPainter) -> None:
        """The picture, and over it names, legend and cube."""
        painter.fillRect(self.rect(), QColor(theme.now().scene))
        if self.data is None:
            return
        eye = self.shown_eye
        self.paint_rig(painter, self.data, eye)
        paint_live(painter, self.data, eye, self.live)
        self._overlay.paint(painter, self.data, eye, self.layers, self.marked, self._hovered)
        if self._ringed:
            ink(painter, theme.now().accent)
            painter.drawRect(self.rect().adjusted(0, 0, -1, -1))

    def paint_rig(self, painter: QPainter, data: SceneData, eye: Eye) -> None:
        """The rig itself: the picture of pyvista that is there, else painted."""
        if self._image is not None and self.rendered:
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(QRectF(self.rect()), self._image)
            return
        self._painted = self._painted or PaintedRig(data, self.style_of_now())
        self._painted.paint(painter, eye)

    def thumbnail(self, width: int, height: int) -> QImage:
        """The rig without names and legend, for a picture (px) too small to read them: the middle of what there is."""
        if self._image is not None and self.rendered:
            mode = Qt.AspectRatioMode.KeepAspectRatioByExpanding
            small = self._image.scaled(width, height, mode, Qt.TransformationMode.SmoothTransformation)
            return small.copy((small.width() - width) // 2, (small.height() - height) // 2, width, height)
        image = QImage(width, height, QImage.Format.Format_RGB32)
        image.fill(QColor(theme.now().scene))
        if self.data is not None:
            painter = QPainter(image)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            view = fitting_view(self.data.every_place(), "oblique", 0.92 * width, 0.92 * height)
            self.paint_rig(painter, self.data, view.eye(width, height))
            painter.end()
        return image


def png_of(image: QPixmap) -> bytes:
    """An image as a PNG file's contents."""
    memory = QBuffer()
    memory.open(QBuffer.OpenModeFlag.WriteOnly)
    image.save(memory, "PNG")
    return bytes(memory.data().data())
