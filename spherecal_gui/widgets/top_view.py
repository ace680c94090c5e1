"""The rig from above: cameras, where the ball was, where it goes next."""

from collections.abc import Callable

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, QSizeF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from spherecal.base.arrays import FloatArray
from spherecal_gui import theme
from spherecal_gui.placement_view import GuidanceView
from spherecal_gui.presenters.guidance_presenter import move_text
from spherecal_gui.widgets.name_tags import place_tags

At = Callable[[FloatArray], QPointF]
_CAMERA_PX = 12.0
_GRID_PX = 40.0  # between two lines of the floor at least
_METRE = 1000.0
_NAMES_PX = 24.0  # room for the cameras' names at the sides


class TopView(QWidget):
    """Draws one piece of guidance."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._shown: GuidanceView | None = None
        self.setMinimumSize(200, 40)

    def show_guidance(self, guidance: GuidanceView | None) -> None:
        """Show it, or nothing."""
        self._shown = guidance
        self.setAccessibleName("" if guidance is None else move_text(guidance))
        self.update()

    def sizeHint(self) -> QSize:
        """As a picture in a page."""
        return QSize(420, 340)

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw the picture."""
        shown = self._shown
        if shown is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        at, scale = self._map(shown)
        radius = shown.radius_mm * scale
        self._draw_floor(painter, at, scale)
        self._draw_cameras(painter, shown, at)
        self._draw_taken(painter, shown, at, radius)
        self._draw_next(painter, shown, at, radius)

    def _map(self, shown: GuidanceView) -> tuple[At, float]:
        """From places in mm to the widget, and pixels per mm."""
        places = np.vstack([shown.cameras.reshape(-1, 2), shown.taken.reshape(-1, 2), shown.place.reshape(1, 2)])
        low, high = places.min(axis=0) - 1.3 * shown.radius_mm, places.max(axis=0) + 1.3 * shown.radius_mm
        scale = min((self.width() - 2 * _NAMES_PX) / (high[0] - low[0]), self.height() / (high[1] - low[1]))
        middle = (low + high) / 2

        def at(place: FloatArray) -> QPointF:
            x, y = (np.asarray(place) - middle) * scale
            return QPointF(self.width() / 2 + x, self.height() / 2 - y)

        return at, scale

    def _draw_floor(self, painter: QPainter, at: At, scale: float) -> None:
        """A grid whose lines are as far apart as the bar in its corner says."""
        each = next((one for one in (100.0, 250.0, 500.0, 1000.0, 2000.0) if one * scale >= _GRID_PX), 5000.0)
        origin = at(np.zeros(2))
        tint = theme.colour("border")
        painter.setPen(QPen(tint, 1))
        step = each * scale
        for x in np.arange(origin.x() % step, self.width(), step):
            painter.drawLine(QPointF(x, 0), QPointF(x, self.height()))
        for y in np.arange(origin.y() % step, self.height(), step):
            painter.drawLine(QPointF(0, y), QPointF(self.width(), y))
        painter.setPen(QPen(theme.colour("soft"), 2))
        left, low = 8.0, self.height() - 8.0
        painter.drawLine(QPointF(left, low), QPointF(left + step, low))
        for end in (left, left + step):
            painter.drawLine(QPointF(end, low - 4), QPointF(end, low + 4))
        painter.setFont(theme.font(10))
        text = f"{each / 1000:g} m" if each >= _METRE else f"{each:.0f} mm"
        painter.drawText(QPointF(left + 4, low - 6), text)

    def _draw_views(self, painter: QPainter, shown: GuidanceView, places: list[QPointF]) -> None:
        """Which way each camera looks."""
        painter.setPen(QPen(theme.colour("soft"), 2))
        for place, view in zip(places, shown.views, strict=False):
            painter.drawLine(place, place + QPointF(view[0], -view[1]) * (2.2 * _CAMERA_PX))

    def _draw_cameras(self, painter: QPainter, shown: GuidanceView, at: At) -> None:
        c = theme.now()
        painter.setFont(theme.font(11, bold=True))
        metrics, message = painter.fontMetrics(), (shown.towards, shown.tip_towards)
        places = [at(camera) for camera in shown.cameras.reshape(-1, 2)]
        self._draw_views(painter, shown, places)
        painter.setPen(Qt.PenStyle.NoPen)
        for i in sorted(range(len(places)), key=lambda i: shown.names[i] in message):  # those in the sentence on top
            painter.setBrush(QColor(c.accent if shown.names[i] in message else c.soft))
            painter.drawRect(
                QRectF(places[i].x() - _CAMERA_PX / 2, places[i].y() - _CAMERA_PX / 2, _CAMERA_PX, _CAMERA_PX)
            )
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(QColor(c.text))
        sizes = [QSizeF(metrics.horizontalAdvance(name) + 2, metrics.height()) for name in shown.names]
        boxes = place_tags(shown.names, places, sizes, QRectF(self.rect()), _CAMERA_PX, message)
        for name, box in boxes.items():
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, name)

    def _draw_taken(self, painter: QPainter, shown: GuidanceView, at: At, radius: float) -> None:
        painter.setFont(theme.font(11, bold=True))
        painter.setPen(QPen(QColor(theme.now().good), 2))
        for name, place in zip(shown.taken_names, shown.taken.reshape(-1, 2), strict=True):
            painter.drawEllipse(at(place), radius, radius)
            painter.drawText(at(place) + QPointF(-radius * 0.7, -radius * 0.55), name)

    def _draw_next(self, painter: QPainter, shown: GuidanceView, at: At, radius: float) -> None:
        c, middle = theme.now(), at(shown.place)
        tint = QColor(c.accent)
        filled = QColor(c.accent)
        filled.setAlpha(36)
        painter.setPen(QPen(tint, 4, Qt.PenStyle.DashLine))
        painter.setBrush(filled)
        painter.drawEllipse(middle, radius, radius)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        if len(shown.taken) and not shown.same_place:
            start = at(shown.taken[-1])
            way = middle - start
            painter.setPen(QPen(tint, 3))
            painter.drawLine(start, middle)
            self._draw_head(painter, middle, float(np.arctan2(way.y(), way.x())), 0.8 * radius)
        painter.setPen(QPen(tint, 2))
        if shown.tip is not None:
            # a small symbol at the rim: in the middle it would pass for the way that the ball goes
            way = QPointF(shown.tip[0], -shown.tip[1]) * radius
            painter.drawLine(middle + way * 0.75, middle + way * 1.25)
            self._draw_head(painter, middle + way * 1.25, float(np.arctan2(way.y(), way.x())), 0.7 * radius)
        elif shown.turn_deg:
            box = QRectF(middle.x() - 0.6 * radius, middle.y() - 0.6 * radius, 1.2 * radius, 1.2 * radius)
            begin = -90.0  # from the front, where people stand
            painter.drawArc(box, int(16 * begin), int(16 * 3 * shown.turn_deg))
            end = np.deg2rad(begin + 3 * shown.turn_deg)
            tip = middle + QPointF(0.6 * radius * np.cos(end), -0.6 * radius * np.sin(end))
            way = -end - np.sign(shown.turn_deg) * np.pi / 2
            self._draw_head(painter, tip, float(way), radius)

    @staticmethod
    def _draw_head(painter: QPainter, tip: QPointF, way: float, radius: float) -> None:
        """An arrow's head that points along `way` (rad, clockwise from the right, as the screen's y runs down)."""
        for side in (-2.6, 2.6):
            end = QPointF(np.cos(way + side), np.sin(way + side)) * (0.3 * radius)
            painter.drawLine(tip, tip + end)
