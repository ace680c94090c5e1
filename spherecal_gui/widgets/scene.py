"""The rig in three dimensions: drawn by pyvista into a picture of its own, or by Qt from above where OpenGL fails.

The picture is rendered off the screen and painted like any other (34 to 45 pictures/s without a graphics card, where
an OpenGL widget gives 9 to 21, measured; and the same everywhere, whatever the window system).
"""

import logging
import os
from typing import Any

import numpy as np
from PySide6.QtCore import QPointF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPaintEvent, QPen, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QWidget

from spherecal.base.arrays import FloatArray
from spherecal_gui import theme
from spherecal_gui.presenters.scene import SceneData

log = logging.getLogger("spherecal.gui")

_BALL_RINGS = 24
_NEAR_PX = 28.0
DEG_PER_PX = 0.4
_CLOSER = 1.15  # by one click of the wheel


class SceneView(QWidget):
    """What all views of the rig have in common: they show `SceneData` and tell which camera was double-clicked."""

    camera_chosen = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setMinimumSize(260, 220)
        self.setObjectName("scene")
        self.data: SceneData | None = None
        self.marked: str | None = None
        self.with_map = False
        self.with_links = False

    def sizeHint(self) -> QSize:
        """As a picture in a page."""
        return QSize(560, 420)

    def show_scene(self, data: SceneData | None) -> None:
        """Show a rig."""
        self.data = data
        names = ", ".join(camera.id for camera in data.scene.cameras) if data else ""
        self.setAccessibleName(self.tr("The rig with its cameras {names}").format(names=names))

    def mark(self, camera: str | None) -> None:
        """Make one camera stand out."""
        self.marked = camera

    def show_layers(self, with_map: bool, with_links: bool) -> None:
        """The map of uncertainty in place of the points; the paths by which the cameras were joined."""
        self.with_map, self.with_links = with_map, with_links
        self.mark(self.marked)

    def look_from(self, side: str) -> None:
        """Look from `oblique`, `top`, `front` or `side`."""

    def close_view(self) -> None:
        """Let go of what the graphics card holds."""

    def on_screen(self) -> dict[str, tuple[float, float]]:
        """Where the cameras' centres are, in the widget's coordinates."""
        return {}

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Choose the camera that was meant."""
        at = np.array([event.position().x(), event.position().y()])
        places = self.on_screen()
        near = sorted(places, key=lambda name: float(np.hypot(*(np.array(places[name]) - at))))
        if near and np.hypot(*(np.array(places[near[0]]) - at)) < _NEAR_PX:
            self.camera_chosen.emit(near[0])


class Scene2D(SceneView):
    """The rig from above or from a side, drawn by Qt alone."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._side = "oblique"

    def show_scene(self, data: SceneData | None) -> None:
        """Show a rig."""
        super().show_scene(data)
        self.update()

    def mark(self, camera: str | None) -> None:
        """Make one camera stand out."""
        super().mark(camera)
        self.update()

    def look_from(self, side: str) -> None:
        """Look from another side."""
        self._side = side
        self.update()

    def on_screen(self) -> dict[str, tuple[float, float]]:
        """Where the cameras' centres are."""
        if self.data is None:
            return {}
        return {camera.id: self._at(camera.centre) for camera in self.data.scene.cameras}

    def _at(self, place: FloatArray) -> tuple[float, float]:
        assert self.data is not None
        low, high = self.data.extent(self._side)
        room = np.array([self.width() - 90.0, self.height() - 60.0])
        scale = float((room / np.maximum(high - low, 1e-9)).min())
        x, y = (self.data.flat(self._side, place) - (low + high) / 2) * scale
        return self.width() / 2 + x, self.height() / 2 - y

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw the rig."""
        if self.data is None:
            return
        c, painter = theme.now(), QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), QColor(c.surface))
        shown = self.data.map_places if self.with_map else self.data.points
        tints = self.data.map_tints(c.dark) if self.with_map else self.data.tints(c.dark)
        for place, tint in zip(shown, tints, strict=True):
            size = 14 if self.with_map else 4
            painter.setPen(QPen(QColor(*tint), size, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
            painter.drawPoint(QPointF(*self._at(place)))
        for start, end in self.data.link_ends if self.with_links else ():
            painter.setPen(QPen(QColor(c.accent), 2.5))
            painter.drawLine(QPointF(*self._at(start)), QPointF(*self._at(end)))
        painter.setFont(theme.font(11, bold=True))
        for camera in self.data.scene.cameras:
            tint = QColor(c.accent if camera.id == self.marked else c.text)
            painter.setPen(QPen(tint, 3 if camera.id == self.marked else 1.6))
            corners = [QPointF(*self._at(corner)) for corner in camera.corners]
            centre = QPointF(*self._at(camera.centre))
            for i in range(4):
                painter.drawLine(centre, corners[i])
                painter.drawLine(corners[i], corners[(i + 1) % 4])
            painter.drawText(centre + QPointF(8, -8), camera.id)


class TurnedScene(SceneView):
    """A view that is turned by dragging and comes closer by the wheel."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._dragged: QPointF | None = None
        self.setToolTip(self.tr("Drag to turn, wheel to come closer, double click a camera to see its residuals."))

    def turn(self, right_px: float, down_px: float) -> None:
        """Turn the view as the mouse was dragged."""

    def come_closer(self, factor: float) -> None:
        """Come closer or step back."""

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin to turn."""
        self._dragged = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Turn."""
        if self._dragged is None:
            return
        moved, self._dragged = event.position() - self._dragged, event.position()
        self.turn(moved.x(), moved.y())

    def mouseReleaseEvent(self, _: QMouseEvent) -> None:
        """End turning."""
        self._dragged = None

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Come closer or step back."""
        self.come_closer(_CLOSER if event.angleDelta().y() > 0 else 1 / _CLOSER)


class Scene3D(TurnedScene):
    """The rig by pyvista; drag turns it, the wheel comes closer."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        import pyvista

        pyvista.global_theme.multi_samples = 1
        self._pyvista: Any = pyvista
        self._plotter: Any = pyvista.Plotter(off_screen=True, window_size=[640, 480])
        self._image: QImage | None = None
        self._plotter.enable_parallel_projection()
        self._render()  # fails here and now where OpenGL does not work

    def show_scene(self, data: SceneData | None) -> None:
        """Show a rig."""
        super().show_scene(data)
        self._fill()
        self.look_from("oblique")

    def mark(self, camera: str | None) -> None:
        """Make one camera stand out."""
        super().mark(camera)
        place = self._plotter.camera_position if self.data is not None else None
        scale = self._plotter.camera.parallel_scale
        self._fill()
        if place is not None:
            self._plotter.camera_position = place
            self._plotter.camera.parallel_scale = scale
        self._render()

    def dress(self) -> None:
        """Take the palette's colours."""
        self.mark(self.marked)

    def _fill(self) -> None:
        c, plotter = theme.now(), self._plotter
        plotter.clear()
        plotter.set_background(c.surface)
        if self.data is None:
            return
        if self.with_map and len(self.data.map_mm):
            self._add_cloud(self.data.map_places, self.data.map_tints(c.dark), 16)
        else:
            self._add_cloud(self.data.points, self.data.tints(c.dark), 5)
        for ends in self.data.link_ends if self.with_links else ():
            line = self._pyvista.PolyData(np.vstack(ends), lines=[2, 0, 1])
            plotter.add_mesh(line, color=c.accent, line_width=4, lighting=False)
        for placement in self.data.scene.placements:
            if placement.ball_centre is not None:
                ball = self._pyvista.Sphere(
                    radius=placement.ball_radius, center=placement.ball_centre, theta_resolution=_BALL_RINGS,
                    phi_resolution=_BALL_RINGS // 2,
                )  # fmt: skip
                plotter.add_mesh(ball, style="wireframe", color=c.border, line_width=1, lighting=False)
        for tip, tint in self.data.reference_axes:
            axis = self._pyvista.PolyData(np.vstack(tip), lines=[2, 0, 1])
            plotter.add_mesh(axis, color=tint, line_width=3, lighting=False)
        for camera in self.data.scene.cameras:
            chosen = camera.id == self.marked
            lines = self._frustum(camera)
            plotter.add_mesh(lines, color=c.accent if chosen else c.text, line_width=4 if chosen else 2, lighting=False)
        names = [camera.id for camera in self.data.scene.cameras]
        centres = np.array([camera.centre for camera in self.data.scene.cameras])
        if names:
            plotter.add_point_labels(
                centres, names, font_size=int(theme.pt(15)), text_color=c.text, shape=None, show_points=False,
                always_visible=True, bold=True,
            )  # fmt: skip
        box = self._pyvista.Box(self.data.box())
        plotter.add_mesh(box, style="wireframe", color=c.good, line_width=2, lighting=False)

    def _add_cloud(self, places: FloatArray, tints: list[tuple[int, int, int]], size: int) -> None:
        cloud = self._pyvista.PolyData(places)
        cloud["tint"] = np.array(tints, dtype=np.uint8)
        self._plotter.add_mesh(
            cloud, scalars="tint", rgb=True, point_size=size, render_points_as_spheres=size > 8,
            show_scalar_bar=False, lighting=False,
        )  # fmt: skip

    def _frustum(self, camera: Any) -> Any:
        places = np.vstack([camera.centre, camera.corners])
        pairs = [(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1)]
        return self._pyvista.PolyData(places, lines=np.hstack([[2, i, j] for i, j in pairs]))

    def look_from(self, side: str) -> None:
        """Look from another side."""
        if self.data is None:
            return
        direction = {"oblique": (1.0, -1.4, 0.9), "top": (0, 0, 1), "front": (0, -1, 0), "side": (1, 0, 0)}[side]
        up = (0, 1, 0) if side == "top" else (0, 0, 1)
        self._plotter.view_vector(direction, up)
        self._plotter.reset_camera()
        self._plotter.camera.zoom(0.94)
        self._render()

    def _render(self) -> None:
        ratio = self.devicePixelRatioF()
        size = [max(int(self.width() * ratio), 64), max(int(self.height() * ratio), 64)]
        if list(self._plotter.window_size) != size:
            self._plotter.window_size = size
        self._plotter.render()
        pixels = np.ascontiguousarray(self._plotter.screenshot(return_img=True))
        height, width = pixels.shape[:2]
        self._image = QImage(pixels.data, width, height, 3 * width, QImage.Format.Format_RGB888).copy()
        self._image.setDevicePixelRatio(ratio)
        self.update()

    def on_screen(self) -> dict[str, tuple[float, float]]:
        """Where the cameras' centres are."""
        if self.data is None:
            return {}
        renderer, ratio, places = self._plotter.renderer, self.devicePixelRatioF(), {}
        for camera in self.data.scene.cameras:
            renderer.SetWorldPoint(*camera.centre, 1.0)
            renderer.WorldToDisplay()
            x, y, _ = renderer.GetDisplayPoint()
            places[camera.id] = (x / ratio, self.height() - y / ratio)
        return places

    def paintEvent(self, _: QPaintEvent) -> None:
        """Paint the picture."""
        if self._image is not None:
            QPainter(self).drawImage(0, 0, self._image)

    def resizeEvent(self, _: QResizeEvent) -> None:
        """Render in the new size."""
        self._render()

    def turn(self, right_px: float, down_px: float) -> None:
        """Turn the view as the mouse was dragged."""
        camera = self._plotter.camera
        camera.azimuth -= DEG_PER_PX * right_px
        camera.elevation = float(np.clip(camera.elevation + DEG_PER_PX * down_px, -85, 85))
        self._plotter.renderer.ResetCameraClippingRange()
        self._render()

    def come_closer(self, factor: float) -> None:
        """Come closer or step back."""
        self._plotter.camera.zoom(factor)
        self._render()

    def close_view(self) -> None:
        """Let go of the renderer."""
        if self._plotter is not None:
            self._plotter.close()
            self._plotter = None
        self._image = None


def make_scene_view(parent: QWidget | None = None) -> SceneView:
    """The best view that works here: pyvista's, else Qt's own; SPHERECAL_3D=painted or 2d asks for a plainer one."""
    from spherecal_gui.widgets.painted_scene import PaintedScene

    wanted = os.environ.get("SPHERECAL_3D")
    if wanted == "2d":
        return Scene2D(parent)
    if wanted != "painted":
        try:
            return Scene3D(parent)
        except Exception as error:
            log.warning("the 3-D view is painted without pyvista: %s", error)
    return PaintedScene(parent)
