"""Line drawings of ours (resources/drawings) in the palette's colours."""

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from spherecal.base.resources import resource_path
from spherecal_gui import theme
from spherecal_gui.widgets.icons import svg_pixmap

_RATIO = 2  # width to height


class Drawing(QWidget):
    """One drawing, as large as there is room."""

    def __init__(self, name: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._text = resource_path("drawings", f"{name}.svg").read_text(encoding="utf-8")
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumHeight(40)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)

    def sizeHint(self) -> QSize:
        """As a picture in a card."""
        return QSize(240, 120)

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw it in the middle."""
        c, height = theme.now(), min(self.height(), self.width() / _RATIO)
        text = self._text
        for role, colour in (("LINE", c.soft), ("ACCENT", c.accent), ("GROUND", c.surface), ("GOOD", c.good)):
            text = text.replace(role, colour)
        ratio = self.devicePixelRatioF()
        drawn = svg_pixmap(text, QSize(round(_RATIO * height * ratio), round(height * ratio)))
        left, top = (self.width() - _RATIO * height) / 2, (self.height() - height) / 2
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawPixmap(QRectF(left, top, _RATIO * height, height), drawn, QRectF(drawn.rect()))
