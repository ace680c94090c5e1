"""One camera's residuals as arrows over its image field."""

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from spherecal_gui import theme
from spherecal_gui.presenters.results import CameraResiduals

_ON_IMAGE = "#35e0ff"  # as the dots on the tiles: seen on light and on dark grey
_LONGEST = 0.03  # of the image's width: the arrow of the 95th percentile


class ResidualView(QWidget):
    """Arrows from the observed places, in the direction of the residual, magnified; red those left out."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._shown: CameraResiduals | None = None
        self._image: QImage | None = None
        self.setMinimumSize(220, 180)
        self.setObjectName("residual-view")

    def show_camera(self, residuals: CameraResiduals | None, image: QImage | None = None) -> None:
        """Show a camera's residuals over its image of one placement, or over nothing."""
        self._shown, self._image = residuals, image
        self.setAccessibleName(
            "" if residuals is None else self.tr("Residuals of {name}").format(name=residuals.camera)
        )
        self.update()

    def sizeHint(self) -> QSize:
        """As a usual image."""
        return QSize(420, 320)

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw the field, the arrows and the key."""
        c, painter = theme.now(), QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        shown = self._shown
        if shown is None or not len(shown.uv):
            painter.setPen(QColor(c.soft))
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter, self.tr("no residuals"))
            return
        foot = theme.pt(26)
        width, height = shown.image_size
        scale = min(self.width() / width, (self.height() - foot) / height)
        field = QRectF((self.width() - scale * width) / 2, 0, scale * width, scale * height)
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
            lines = [
                QLineF(*start, *end) for start, end in zip(starts[rows].tolist(), ends[rows].tolist(), strict=True)
            ]
            painter.drawLines(lines)
            painter.setPen(QPen(QColor(tint), 3 if used else 6, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
            painter.drawPoints([QPointF(x, y) for x, y in starts[rows].tolist()])
        painter.setPen(QPen(QColor(c.border), 1))
        painter.drawRect(field)
        painter.setPen(QColor(c.soft))
        painter.setFont(theme.font(10))
        told = self.tr("{name}: arrows {gain:.0f} times, 95 % shorter than {usual:.3f} px, {out} left out").format(
            name=shown.camera, gain=gain / scale, usual=usual, out=int((~shown.used).sum())
        )
        at = QRectF(0, field.bottom(), self.width(), foot)
        told = painter.fontMetrics().elidedText(told, Qt.TextElideMode.ElideRight, self.width())
        painter.drawText(at, Qt.AlignmentFlag.AlignCenter, told)
