"""One camera's residuals as arrows over its image field."""

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPen

from spherecal_gui import languages, theme
from spherecal_gui.presenters.results_presenter import CameraResiduals
from spherecal_gui.widgets.basic import Canvas, plain

_ON_IMAGE = "#35e0ff"  # as the dots on the tiles: seen on light and on dark grey
_FOOT_PT, _NEAR_PX = 26.0, 10.0
_LONGEST = 0.03  # of the image's width: the arrow of the 95th percentile


class ResidualView(Canvas):
    """Residuals as arrows from the observed places, magnified; red those left out."""

    image_chosen = Signal(str)  # the placement in whose image a dot was clicked
    hint = (420, 320)

    def __init__(self) -> None:
        super().__init__()
        self._shown: CameraResiduals | None = None
        self._image: QImage | None = None
        self.setMinimumSize(220, 180)
        self.setObjectName("residual-view")
        self.setMouseTracking(True)

    def show_camera(self, residuals: CameraResiduals | None, image: QImage | None = None) -> None:
        """Show a camera's residuals over its image of one placement; over nothing where they are of all."""
        self._shown, self._image = residuals, image
        self.setAccessibleName(
            "" if residuals is None else self.tr("Residuals of {name}").format(name=residuals.camera)
        )
        self.update()

    def _field(self) -> tuple[QRectF, float]:
        """Where the image lies on the widget, and px of the widget for a px of the image."""
        assert self._shown is not None
        width, height = self._shown.image_size
        scale = min(self.width() / width, (self.height() - theme.pt(_FOOT_PT)) / height)
        return QRectF((self.width() - scale * width) / 2, 0, scale * width, scale * height), scale

    def dot_at(self, place: QPointF) -> int | None:
        """The row of the dot under the mouse."""
        if self._shown is None or not len(self._shown.uv):
            return None
        field, scale = self._field()
        at = (self._shown.uv + 0.5) * scale + np.array([field.left(), field.top()])
        off = np.linalg.norm(at - np.array([place.x(), place.y()]), axis=1)
        nearest = int(np.argmin(off))
        return nearest if off[nearest] <= _NEAR_PX else None

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Say that a dot leads to its image, and how large its residual is."""
        row, shown = self.dot_at(event.position()), self._shown
        there = row is not None and shown is not None and shown.placement is None and bool(shown.taken_at)
        self.setCursor(Qt.CursorShape.PointingHandCursor if there else Qt.CursorShape.ArrowCursor)
        text = ""
        if row is not None and shown is not None:
            text = self.tr("{px:.3f} px").format(px=float(np.linalg.norm(shown.du_dv[row])))
            text = f"{shown.taken_at[row]} · {text}" if shown.taken_at else text
        self.setToolTip(plain(languages.by_locale(text)))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Go to the image of the dot."""
        row, shown = self.dot_at(event.position()), self._shown
        if row is not None and shown is not None and shown.taken_at:
            self.image_chosen.emit(shown.taken_at[row])

    def paint(self, painter: QPainter) -> None:
        """Draw the field, the arrows and the key."""
        c = theme.now()
        shown = self._shown
        if shown is None or not len(shown.uv):
            painter.setPen(QColor(c.soft))
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter, self.tr("no residuals"))
            return
        foot, width = theme.pt(_FOOT_PT), shown.image_size[0]
        field, scale = self._field()
        painter.fillRect(field, QColor(c.window))
        if self._image is not None:
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(field, self._image)
        sizes = np.linalg.norm(shown.du_dv[shown.used], axis=1) if shown.used.any() else np.ones(1)
        usual = float(np.percentile(sizes, 95)) or 1.0
        gain = _LONGEST * width / usual * scale
        starts = (shown.uv + 0.5) * scale + np.array([field.left(), field.top()])
        ends = starts + shown.du_dv * gain
        for used, tint in ((True, _ON_IMAGE if self._image is not None else c.accent), (False, c.bad)):
            rows = np.flatnonzero(shown.used == used)
            painter.setPen(QPen(QColor(tint), 1.3 if used else 2.2))
            painter.drawLines([QLineF(*one) for one in np.hstack([starts, ends])[rows].tolist()])
            painter.setPen(QPen(QColor(tint), 3 if used else 6, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
            painter.drawPoints([QPointF(x, y) for x, y in starts[rows].tolist()])
        painter.setPen(QPen(QColor(c.border), 1))
        painter.drawRect(field)
        painter.setPen(QColor(c.soft))
        painter.setFont(theme.font(10))
        text = self.tr("Drawn {gain:.0f} times larger; most below {usual:.3f} px")
        text, out = text.format(gain=gain / scale, usual=usual), int((~shown.used).sum())
        if out:
            text += self.tr("; {out} left out").format(out=out)
        at = QRectF(0, field.bottom(), self.width(), foot)
        text, wide = languages.by_locale(text), painter.fontMetrics().horizontalAdvance(text)
        if wide > self.width():  # letters that are a little smaller say more than those that are left out
            painter.setFont(theme.font(theme.CAPTION * self.width() / wide))
        painter.drawText(at, Qt.AlignmentFlag.AlignCenter, text)
