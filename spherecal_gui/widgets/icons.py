"""The icons, one open set (Tabler), and line drawings of ours, in the colours of the palette."""

from functools import cache

from PySide6.QtCore import QBuffer, QByteArray, QRectF, QSize, Qt
from PySide6.QtGui import QIcon, QImageReader, QPainter, QPaintEvent, QPixmap
from PySide6.QtWidgets import QAbstractButton, QSizePolicy, QWidget

from spherecal.base.resources import resource_path
from spherecal_gui import theme

ICON_PX = 20
_AFTER_ICON_PX = 4.0
# The mark of each level: colour is never alone.
LEVEL_ICONS = {"good": "check", "caution": "alert-triangle", "bad": "x", "info": "info-circle", "none": "info-circle"}


def pixmap(name: str, px: float, colour: str, ratio: float = 2.0) -> QPixmap:
    """An icon in this colour. `ratio`: pixels of the screen per px on which it is sharp."""
    made = QPixmap(_drawn(name, max(round(px * ratio), 1), colour))
    made.setDevicePixelRatio(ratio)
    return made


@cache
def _drawn(name: str, size: int, colour: str) -> QPixmap:
    text = resource_path("icons", "tabler", f"{name}.svg").read_text(encoding="utf-8").replace("currentColor", colour)
    return svg_pixmap(text, QSize(size, size))


def svg_pixmap(text: str, size: QSize) -> QPixmap:
    """A drawing given as SVG text, in this size (px of the device); empty where Qt cannot read SVG."""
    data = QByteArray(text.encode())
    buffer = QBuffer(data)
    reader = QImageReader(buffer, QByteArray(b"svg"))
    reader.setScaledSize(size)
    return QPixmap.fromImage(reader.read())


def give_icon(target: QAbstractButton, name: str) -> None:
    """Give a button an icon; `dress_icons` keeps it in the palette's colours."""
    target.setProperty("icon-name", name)
    _dress(target)


def dress_icons(root: QWidget) -> None:
    """The icons of all buttons below in the colours of now."""
    for one in root.findChildren(QAbstractButton):
        if one.property("icon-name"):
            _dress(one)


def _dress(target: QAbstractButton) -> None:
    name, c, size = str(target.property("icon-name")), theme.now(), theme.pt(ICON_PX)
    room = _AFTER_ICON_PX if target.text() else 0.0
    icon = QIcon(_with_room(pixmap(name, size, c.text), room))
    icon.addPixmap(_with_room(pixmap(name, size, c.idle), room), QIcon.Mode.Disabled)
    target.setIcon(icon)
    target.setIconSize(QSize(round(size + room), round(size)))


def _with_room(drawn: QPixmap, room: float) -> QPixmap:
    """The same with room at its right, as Qt writes a button's text close to its icon."""
    ratio = drawn.devicePixelRatio()
    wider = QPixmap(drawn.width() + round(room * ratio), drawn.height())
    wider.setDevicePixelRatio(ratio)
    wider.fill(Qt.GlobalColor.transparent)
    painter = QPainter(wider)
    painter.drawPixmap(0, 0, drawn)
    painter.end()
    return wider


def menu_icon(name: str) -> QIcon:
    """An icon for a menu's line."""
    return QIcon(pixmap(name, ICON_PX, theme.now().text))


def level_pixmap(level: str, px: float, colour: str | None = None) -> QPixmap:
    """The mark of a level. `colour` None: the level's."""
    return pixmap(LEVEL_ICONS.get(level, "info-circle"), px, colour or theme.now().of(level))


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
