"""The rig rendered by pyvista in a process of its own; painted by Qt without it, or with SPHERECAL_3D=painted."""

import itertools
import time
from dataclasses import replace

from PySide6.QtCore import QRectF, Qt, QTimer
from PySide6.QtGui import QHideEvent, QImage, QPainter, QShowEvent

from spherecal_documents.scene.eye import Eye
from spherecal_documents.scene.model import SceneData
from spherecal_documents.scene.renderer import can_render
from spherecal_gui.tasks import scene_process
from spherecal_gui.tasks.scene_process import RequestedPicture, SceneProcess
from spherecal_gui.widgets.painted_scene import PaintedScene

_LEAVE_MS = 30_000
_REST_MS = 180  # so long after the last turn the picture is rendered with smooth edges
_numbers = itertools.count(1)


class RenderedScene(PaintedScene):
    """Asks for pictures and shows them. `first_picture_s`: from being shown to the first one, None before."""

    def __init__(self) -> None:
        super().__init__()
        self._id = next(_numbers)
        self._version = self._number = self._got = self._fine = 0
        self._process: SceneProcess | None = None
        self._image: QImage | None = None
        self._image_eye: Eye | None = None
        self._asked: dict[int, Eye] = {}
        self._broken = not can_render()
        self._shown_at: float | None = None
        self.first_picture_s: float | None = None
        self._rest = QTimer(self, singleShot=True, interval=_REST_MS)
        self._rest.timeout.connect(self._ask_fine)
        self._leave = QTimer(self, singleShot=True, interval=_LEAVE_MS)
        self._leave.timeout.connect(self.close_view)

    @property
    def rendered(self) -> bool:
        """Whether the picture of pyvista is on the screen."""
        return self._image is not None and not self._broken

    @property
    def settled(self) -> bool:
        """Whether there is nothing to wait for: the newest picture with smooth edges, or none by pyvista at all."""
        return self._broken or self.data is None or (self.rendered and self._got == self._number == self._fine)

    def scene_changed(self) -> None:
        """Render the other scene."""
        self._version += 1
        super().scene_changed()
        self.view_changed()

    def view_changed(self, settled: bool = True) -> None:
        """Render from there: at once without smooth edges, and with them once nobody turns it any more."""
        super().view_changed(settled)
        self._rest.stop()
        self._ask(fine=False)

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

    @property
    def shown_eye(self) -> Eye:
        """That of the picture on the screen, so that names turn with it."""
        there = self._image_eye if self.rendered else None
        eye = self.eye
        return there if there is not None and (there.width, there.height) == (eye.width, eye.height) else eye

    def thumbnail(self, width: int, height: int) -> QImage:
        """The middle of the picture of pyvista, where there is one. `width`, `height`: size of the picture, px."""
        if self._image is None or self._broken:
            return super().thumbnail(width, height)
        mode = Qt.AspectRatioMode.KeepAspectRatioByExpanding
        small = self._image.scaled(width, height, mode, Qt.TransformationMode.SmoothTransformation)
        return small.copy((small.width() - width) // 2, (small.height() - height) // 2, width, height)

    def paint_rig(self, painter: QPainter, data: SceneData, eye: Eye) -> None:
        """The picture that is there, names and cube where it has them; else the painted rig."""
        if self._image is None or self._broken:
            super().paint_rig(painter, data, eye)
            return
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(QRectF(self.rect()), self._image)
