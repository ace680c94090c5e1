"""The rig in three dimensions, painted by Qt alone: nothing in it hides anything, so no graphics library is needed.

Stands in for pyvista where that is not installed (it is 275 MB of libraries, too much for the installer) or where
OpenGL does not work. 6000 points, 12 cameras: 9 ms a picture.
"""

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from spherecal.base.arrays import FloatArray
from spherecal_gui import theme
from spherecal_gui.presenters.scene import SceneData
from spherecal_gui.widgets.scene import DEG_PER_PX, TurnedScene

# Turn about the height axis and lift above the ground, degrees.
_SIDES = {"oblique": (-55.0, 28.0), "top": (-90.0, 90.0), "front": (-90.0, 0.0), "side": (0.0, 0.0)}
_MARGIN_PX = 45.0
_SHADES = 16  # colours of points are drawn in groups, which is what takes time
_EDGES = [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)]


class PaintedScene(TurnedScene):
    """A parallel projection: drag turns it, the wheel comes closer, a double click chooses a camera."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._turn_deg, self._lift_deg = _SIDES["oblique"]
        self._zoom = 1.0
        self._middle, self._radius = np.zeros(3), 1.0

    def show_scene(self, data: SceneData | None) -> None:
        """Show a rig."""
        super().show_scene(data)
        if data is not None:
            parts = [np.vstack([camera.centre, camera.corners]) for camera in data.scene.cameras] + [data.points]
            every = np.vstack([part for part in parts if len(part)])
            self._middle = (every.min(axis=0) + every.max(axis=0)) / 2
            self._radius = float(np.linalg.norm(every - self._middle, axis=1).max()) or 1.0
        self.look_from("oblique")

    def mark(self, camera: str | None) -> None:
        """Make one camera stand out."""
        super().mark(camera)
        self.update()

    def look_from(self, side: str) -> None:
        """Look from another side."""
        (self._turn_deg, self._lift_deg), self._zoom = _SIDES[side], 1.0
        self.update()

    def on_screen(self) -> dict[str, tuple[float, float]]:
        """Where the cameras' centres are."""
        if self.data is None:
            return {}
        return {camera.id: tuple(self._flat(camera.centre[None])[0].tolist()) for camera in self.data.scene.cameras}

    def _flat(self, places: FloatArray) -> FloatArray:
        """Places (n, 3) of the scene on the widget, (n, 2) px."""
        turn, lift = np.deg2rad([self._turn_deg, self._lift_deg])
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        towards = np.array([np.cos(turn) * np.cos(lift), np.sin(turn) * np.cos(lift), np.sin(lift)])
        up = np.cross(towards, right)
        room = max(min(self.width(), self.height()) / 2 - _MARGIN_PX, 20.0)
        xy = (
            (np.asarray(places, dtype=float) - self._middle)
            @ np.stack([right, up]).T
            * (self._zoom * room / self._radius)
        )
        return np.array([self.width() / 2, self.height() / 2]) + xy * np.array([1.0, -1.0])

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw the rig."""
        if self.data is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), QColor(theme.now().surface))
        self._draw_volume(painter, self.data)
        if self.with_map:
            self._draw_points(painter, self.data.map_places, self.data.map_tints(theme.now().dark), 14)
        else:
            self._draw_points(painter, self.data.points, self.data.tints(theme.now().dark), 4)
        self._draw_cameras(painter, self.data)

    def _draw_points(self, painter: QPainter, places: FloatArray, tints: list[tuple[int, int, int]], size: int) -> None:
        if not len(places):
            return
        flat, colours = self._flat(places), np.array(tints) // _SHADES * _SHADES + _SHADES // 2
        for colour in np.unique(colours, axis=0):
            pen = QPen(QColor(*map(int, colour)), size, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap)
            painter.setPen(pen)
            painter.drawPoints(QPolygonF([QPointF(x, y) for x, y in flat[(colours == colour).all(axis=1)].tolist()]))

    def _draw_volume(self, painter: QPainter, data: SceneData) -> None:
        c = theme.now()
        x0, x1, y0, y1, z0, z1 = data.box()
        corners = self._flat(np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]))
        painter.setPen(QPen(QColor(c.good), 2))
        painter.drawLines([QLineF(*corners[i].tolist(), *corners[j].tolist()) for i, j in _EDGES])
        painter.setPen(QPen(QColor(c.border), 1.5))
        for placement in data.scene.placements:
            if placement.ball_centre is not None:
                x, y = self._flat(placement.ball_centre[None])[0].tolist()
                room = max(min(self.width(), self.height()) / 2 - _MARGIN_PX, 20.0)
                r = placement.ball_radius * self._zoom * room / self._radius
                painter.drawEllipse(QRectF(x - r, y - r, 2 * r, 2 * r))

    def _draw_cameras(self, painter: QPainter, data: SceneData) -> None:
        c = theme.now()
        if self.with_links:
            painter.setPen(QPen(QColor(c.accent), 2.5))
            for ends in data.link_ends:
                (ax, ay), (bx, by) = self._flat(np.array(ends)).tolist()
                painter.drawLine(QLineF(ax, ay, bx, by))
        for ends, tint in data.reference_axes:
            (ax, ay), (bx, by) = self._flat(np.array(ends)).tolist()
            painter.setPen(QPen(QColor(tint), 3))
            painter.drawLine(QLineF(ax, ay, bx, by))
        painter.setFont(theme.font(11, bold=True))
        for camera in data.scene.cameras:
            chosen = camera.id == self.marked
            painter.setPen(QPen(QColor(c.accent if chosen else c.text), 3 if chosen else 1.6))
            at = [QPointF(x, y) for x, y in self._flat(np.vstack([camera.centre, camera.corners])).tolist()]
            for i in range(1, 5):
                painter.drawLine(at[0], at[i])
                painter.drawLine(at[i], at[i % 4 + 1])
            painter.drawText(at[0] + QPointF(8, -8), camera.id)

    def dress(self) -> None:
        """Take the palette's colours."""
        self.update()

    def turn(self, right_px: float, down_px: float) -> None:
        """Turn the view as the mouse was dragged."""
        self._turn_deg -= DEG_PER_PX * right_px
        self._lift_deg = float(np.clip(self._lift_deg + DEG_PER_PX * down_px, -90, 90))
        self.update()

    def come_closer(self, factor: float) -> None:
        """Come closer or step back."""
        self._zoom = float(np.clip(self._zoom * factor, 0.2, 20.0))
        self.update()
