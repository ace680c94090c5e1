"""A camera's newest image with the dots found in it, as large as its row leaves room."""

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from spherecal_gui import theme
from spherecal_gui.widgets.tile import shown_image

_LEAST_PX = (44, 36)
_WIDTH_PX = 320  # of what is kept of an image
_PAST_ALPHA, _DOT_PX = 170, 1.6


class Thumbnail(QWidget):
    """An image without words; an empty frame until there is one. `clicked` when somebody clicks on it."""

    clicked = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("thumbnail")
        self.image: QImage | None = None  # what is shown
        self._shown_s: float | None = None
        self._dots = np.empty((0, 2))  # shares of width and height
        self.past = False
        self.setMinimumSize(*_LEAST_PX)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Tell that it was clicked."""
        if self.rect().contains(event.position().toPoint()):
            self.clicked.emit()

    def show_image(self, image: np.ndarray, bits: int, taken_s: float) -> None:
        """Show an image, unless it is shown already. `image`: grey values (height, width)."""
        if taken_s == self._shown_s:
            return
        self.image, self._shown_s = shown_image(image, bits, _WIDTH_PX), taken_s
        self.update()

    def show_dots(self, uv: np.ndarray, size: tuple[int, int]) -> None:
        """Show where dots were found. `uv`: where they are (n, 2), px; `size`: width and height of the image, px."""
        self._dots = (uv + 0.5) / size
        self.update()

    def show_past(self, past: bool) -> None:
        """Whether the image is an old one, of a camera that sends no more: it is darkened."""
        if past != self.past:
            self.past = past
            self.update()

    @property
    def dots(self) -> int:
        """How many dots are shown."""
        return len(self._dots)

    @property
    def has_image(self) -> bool:
        """Whether there is one."""
        return self.image is not None

    def sizeHint(self) -> QSize:
        """As a picture in a row."""
        return QSize(80, 64)

    def paintEvent(self, _: QPaintEvent) -> None:
        """The image in its proportions, in the middle."""
        size = self.image.size() if self.image is not None else QSize(5, 4)
        scale = min(self.width() / size.width(), self.height() / size.height())
        width, height = scale * size.width(), scale * size.height()
        room = QRectF((self.width() - width) / 2, (self.height() - height) / 2, width, height)
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        if self.image is None:
            painter.fillRect(room, QColor(theme.now().scene))
        else:
            painter.drawImage(room, self.image)
            if self.past:
                painter.fillRect(room, QColor(0, 0, 0, _PAST_ALPHA))
                return
            painter.setPen(QPen(QColor("#2fd27a"), _DOT_PX))
            places = self._dots * (width, height) + (room.x(), room.y())
            painter.drawPoints([QPointF(x, y) for x, y in places.tolist()])
