"""The rig from above: cameras, where the ball was, where it goes next."""

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from spherecal_gui import theme
from spherecal_gui.presenters.guidance import Guidance


class TopView(QWidget):
    """Draws one piece of guidance."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._shown: Guidance | None = None
        self.setMinimumSize(240, 200)

    def show_guidance(self, guidance: Guidance | None) -> None:
        """Show it, or nothing."""
        self._shown = guidance
        self.setAccessibleName("" if guidance is None else guidance.sentence)
        self.update()

    def sizeHint(self) -> QSize:
        """As a picture in a page."""
        return QSize(420, 340)

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw the picture."""
        shown = self._shown
        if shown is None:
            return
        c, painter = theme.now(), QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        places = np.vstack([shown.cameras.reshape(-1, 2), shown.taken.reshape(-1, 2), shown.place.reshape(1, 2)])
        low, high = places.min(axis=0) - 1.2 * shown.radius_mm, places.max(axis=0) + 1.2 * shown.radius_mm
        scale = min(self.width() / (high[0] - low[0]), self.height() / (high[1] - low[1]))
        middle = (low + high) / 2

        def at(place: np.ndarray) -> QPointF:
            x, y = (np.asarray(place) - middle) * scale
            return QPointF(self.width() / 2 + x, self.height() / 2 - y)

        radius = shown.radius_mm * scale
        painter.setFont(theme.font(11, bold=True))
        for number, place in enumerate(shown.taken.reshape(-1, 2), start=1):
            painter.setPen(QPen(QColor(c.good), 3))
            painter.drawEllipse(at(place), radius, radius)
            box = QRectF(at(place).x() - radius, at(place).y() - radius, 2 * radius, 2 * radius)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, f"{number} ✓")
        painter.setPen(QPen(QColor(c.accent), 5, Qt.PenStyle.DashLine))
        painter.drawEllipse(at(shown.place), radius, radius)
        if shown.turn_deg:
            box = QRectF(at(shown.place).x() - radius / 2, at(shown.place).y() - radius / 2, radius, radius)
            painter.setPen(QPen(QColor(c.accent), 4))
            painter.drawArc(box, 0, int(16 * shown.turn_deg))
        for name, camera in zip(shown.names, shown.cameras.reshape(-1, 2), strict=True):
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(c.soft))
            painter.drawRect(QRectF(at(camera).x() - 6, at(camera).y() - 6, 12, 12))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.setPen(QColor(c.text))
            painter.drawText(at(camera) + QPointF(10, 5), name)
