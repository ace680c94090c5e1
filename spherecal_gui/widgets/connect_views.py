"""What Connect shows: a camera's newest image with its dots, and the bench drawn to one scale."""

import math
from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPaintEvent, QPen, QRadialGradient
from PySide6.QtWidgets import QSizePolicy, QWidget

from spherecal_gui import theme
from spherecal_gui.presenters.connect_presenter import DrawnBench
from spherecal_gui.widgets.basic import Canvas, ink
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


_LEAST_DRAWN_PX = 90.0
_MARGIN_PX = 12.0
_MARK_PX = 5.0
_STICKER_PX = 84.0
_TURN = math.pi * (3.0 - math.sqrt(5.0))  # the golden angle spreads points evenly over a ball


class BenchView(Canvas):
    """The drawing; nothing where nothing is known, or where there is no room for it."""

    hint = (240, 0)  # as high as the page leaves

    def __init__(self) -> None:
        super().__init__()
        self._shown = DrawnBench()
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)

    def show_bench(self, shown: DrawnBench) -> None:
        """Draw this bench."""
        self._shown = shown
        self.update()

    def paint(self, painter: QPainter) -> None:
        """Ball and bars, as large as there is room for both at one scale: below each other, or beside each other."""
        shown, line = self._shown, 2.4 * self.fontMetrics().height()
        ball, bar = shown.diameter_mm or 0.0, max((max(marks) for _, marks in shown.bars), default=0.0)
        width, height = self.width() - 2 * _MARGIN_PX, self.height() - 2 * _MARGIN_PX
        if max(ball, bar) <= 0:
            return
        lines = line * len(shown.bars)
        below = min(width / max(ball, bar), (height - lines) / (ball or bar))
        beside = min((width - 2 * _MARGIN_PX) / (ball + bar), height / ball) if ball and height > lines else 0.0
        scale = max(below, beside)
        if scale * max(ball, bar) < _LEAST_DRAWN_PX:
            return
        middle = QPointF(self.width() / 2, _MARGIN_PX + scale * ball / 2)
        at = QPointF(middle.x(), _MARGIN_PX + scale * ball)
        if beside > below:
            middle = QPointF(_MARGIN_PX + scale * ball / 2, self.height() / 2)
            at = QPointF(self.width() - _MARGIN_PX - scale * bar / 2, (self.height() - lines) / 2)
        if ball:
            self._draw_ball(painter, middle, scale * ball / 2)
        for name, marks in shown.bars:
            at += QPointF(0, line)
            self._draw_bar(painter, name, marks, scale, at)
        if shown.sticker:
            self._draw_sticker(painter, QRectF(self.width() - _STICKER_PX - 4, 4, _STICKER_PX, _STICKER_PX))

    def _draw_sticker(self, painter: QPainter, box: QRectF) -> None:
        """One sticker larger than life, with the two dots whose distance gives the scale."""
        c, shown = theme.now(), self._shown
        reach = max(max(abs(x), abs(y)) for _, x, y in shown.sticker) * 1.35 or 1.0
        places = {name: box.center() + QPointF(x, y) * (box.width() / 2 / reach) for name, x, y in shown.sticker}
        ink(painter, c.border, 1, "#1c1c1c")
        painter.drawRect(box)
        ink(painter, None, fill="#f4f4f2")
        for place in places.values():
            painter.drawEllipse(place, 4, 4)
        ends = [places[name] for name in shown.between if name in places]
        painter.setPen(QPen(QColor("#ff9b2e"), 2))
        if len(ends) == len(shown.between):
            painter.drawLine(*ends)
        for name, end in zip(shown.between, ends, strict=False):
            painter.drawText(end + QPointF(5, -4), name)

    def _draw_ball(self, painter: QPainter, centre: QPointF, radius: float) -> None:
        c = theme.now()
        light = QRadialGradient(centre - QPointF(0.35, 0.4) * radius, 1.5 * radius)
        light.setColorAt(0.0, QColor(c.raised).lighter(115))
        light.setColorAt(1.0, QColor(c.border))
        painter.setPen(QPen(QColor(c.soft), 1.5))
        painter.setBrush(light)
        painter.drawEllipse(centre, radius, radius)
        ink(painter, None, fill=c.soft)
        for i in range(self._shown.targets):
            height = 1.0 - (2 * i + 1) / self._shown.targets
            out = math.sqrt(1.0 - height * height)
            depth = out * math.sin(i * _TURN)
            if depth > 0.15:  # on the side that is seen
                at = centre + QPointF(out * math.cos(i * _TURN), -height) * radius
                painter.drawEllipse(at, 0.018 * radius * (0.4 + depth), 0.018 * radius)

    def _draw_bar(self, painter: QPainter, name: str, marks: Sequence[float], scale: float, at: QPointF) -> None:
        c = theme.now()
        half = scale * max(marks) / 2
        painter.setPen(QPen(QColor(c.soft), 3.0))
        painter.drawLine(at - QPointF(half, 0), at + QPointF(half, 0))
        ink(painter, None, fill=c.accent)
        for one in marks:
            painter.drawEllipse(at + QPointF(scale * one - half, 0), _MARK_PX, _MARK_PX)
        painter.setPen(QColor(c.text))
        height = self.fontMetrics().height()
        box = QRectF(at.x() - half, at.y() - _MARK_PX - height - 2, 2 * half, height)
        painter.drawText(box, Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextDontClip, name)
