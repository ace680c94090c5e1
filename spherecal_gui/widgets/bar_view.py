"""The check bar as it should lie and as it lies, from above and from the front."""

from collections.abc import Callable

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, QSizeF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from spherecal.base.arrays import FloatArray
from spherecal_gui import theme
from spherecal_gui.presenters.bar_guide import BarGuide
from spherecal_gui.widgets.name_tags import place_tags

At = Callable[[FloatArray], QPointF]
_MARGIN_PX = 30.0
_CAMERA_PX = 10.0
_AROUND = 0.35  # of the volume's size is shown around it


class BarView(QWidget):
    """Two pictures side by side: volume, cameras, the pose asked for (dashed), the bar as it is seen (solid)."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._shown: BarGuide | None = None
        self.setMinimumSize(420, 220)
        self.setObjectName("bar-view")

    def show_guide(self, guide: BarGuide | None) -> None:
        """Show it, or nothing."""
        self._shown = guide
        self.setAccessibleName("" if guide is None else guide.text)
        self.update()

    def sizeHint(self) -> QSize:
        """As a picture in a page."""
        return QSize(760, 380)

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw both sides."""
        shown = self._shown
        if shown is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        half = self.width() / 2
        for side, title in ((0, self.tr("From above")), (1, self.tr("From the front"))):
            self._draw_side(painter, shown, side, title, QRectF(side * half, 0, half, self.height()))
        painter.setPen(QPen(QColor(theme.now().border), 1))
        painter.drawLine(QPointF(half, 8), QPointF(half, self.height() - 8))

    def _draw_side(self, painter: QPainter, shown: BarGuide, side: int, title: str, room: QRectF) -> None:
        c = theme.now()
        parts = [shown.box[side], shown.wanted[side]]
        if shown.lying is not None:
            parts.append(shown.lying[side])
        every = np.vstack(parts)
        around = _AROUND * np.ptp(every, axis=0).max()
        low, high = every.min(axis=0) - around, every.max(axis=0) + around
        head = theme.pt(30)
        space = np.array([room.width() - 2 * _MARGIN_PX, room.height() - head - 1.5 * _MARGIN_PX])
        scale = float((space / np.maximum(high - low, 1.0)).min())
        middle = QPointF(room.center().x(), room.center().y() + head / 2)

        def at(place: FloatArray) -> QPointF:
            x, y = (np.asarray(place) - (low + high) / 2) * scale
            return QPointF(middle.x() + x, middle.y() - y)

        painter.setPen(QColor(c.soft))
        painter.setFont(theme.font(11))
        painter.drawText(QRectF(room.left(), 2, room.width(), head), Qt.AlignmentFlag.AlignHCenter, title)
        painter.setPen(QPen(QColor(c.border), 2))
        painter.drawPolygon(QPolygonF([at(place) for place in _hull(shown.box[side])]))
        self._draw_cameras(painter, shown, side, at, room.adjusted(14, head + 16, -22, -12))
        start, end = (at(place) for place in shown.wanted[side])
        painter.setPen(QPen(QColor(c.accent), 6, Qt.PenStyle.DashLine, Qt.PenCapStyle.FlatCap))
        painter.drawLine(start, end)
        if shown.lying is not None:
            tint = QColor(c.good if shown.accepted else c.caution)
            painter.setPen(QPen(tint, 5, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
            painter.drawLine(*(at(place) for place in shown.lying[side]))

    @staticmethod
    def _draw_cameras(painter: QPainter, shown: BarGuide, side: int, at: At, room: QRectF) -> None:
        """Those outside the picture at its edge: what counts is where the bar goes, and towards whom."""
        c = theme.now()
        painter.setFont(theme.font(11, bold=True))
        metrics = painter.fontMetrics()
        places = [_inside(at(place), room) for place in shown.cameras[side]]
        order = sorted(range(len(places)), key=lambda i: shown.names[i] in shown.near)  # those in the sentence on top
        for i in order:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(c.accent if shown.names[i] in shown.near else c.soft))
            painter.drawRect(
                QRectF(places[i].x() - _CAMERA_PX / 2, places[i].y() - _CAMERA_PX / 2, _CAMERA_PX, _CAMERA_PX)
            )
        painter.setBrush(Qt.BrushStyle.NoBrush)
        sizes = [QSizeF(metrics.horizontalAdvance(name) + 2, metrics.height()) for name in shown.names]
        wide = room.adjusted(-14, -16, 22, 12)
        for name, box in place_tags(shown.names, places, sizes, wide, _CAMERA_PX, shown.near).items():
            painter.setPen(QColor(c.accent if name in shown.near else c.text))
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, name)


def _inside(place: QPointF, room: QRectF) -> QPointF:
    """The place, or the nearest one on the edge."""
    x = min(max(place.x(), room.left()), room.right())
    return QPointF(x, min(max(place.y(), room.top()), room.bottom()))


def _hull(places: FloatArray) -> FloatArray:
    """The corners of a convex outline in order, (k, 2); that of a box has four or six."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return places[ConvexHull(places).vertices]
    except QhullError:  # seen edge on
        return places
