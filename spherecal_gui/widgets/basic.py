"""Small parts that every page uses: cards, labels with a state, buttons that say why they are disabled."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from PySide6.QtCore import QEvent, QObject, QPointF, QRectF, QSize, Qt, QUrl, Signal, SignalInstance
from PySide6.QtGui import QColor, QDesktopServices, QGuiApplication, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import (
    QBoxLayout,
    QCheckBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from spherecal_gui import languages, theme
from spherecal_gui.languages import translate
from spherecal_gui.standing import Level
from spherecal_gui.widgets.icons import give_icon, level_pixmap

Act = Callable[..., object] | SignalInstance | None
B = TypeVar("B", bound=QBoxLayout)
L = TypeVar("L", bound=QLayout)
Part = QWidget | QLayout | int | None
W = TypeVar("W", bound=QWidget)
_AS_HTML = re.compile(r"<[A-Za-z/!?]|&#?\w+;")  # a tag or an entity, as Qt.mightBeRichText sees them
_BANNER_PX = 960
_FOOTER_PX = 72.0  # the height of the large buttons' bar at the normal text size
MARKS = {"good": "✓", "caution": "!", "bad": "✕", "none": "·"}


def plain(text: str) -> str:
    """A text that Qt never takes for HTML, not in tooltips either: names come from outside, HTML would read files."""
    if not _AS_HTML.search(text):
        return text
    return text.translate({ord("<"): "\u2039", ord(">"): "\u203a", ord("&"): "\uff06"})  # what looks like them


class Words(QLabel):
    """A label whose numbers are written as the language writes them, on one line with their units."""

    def __init__(self, text: str = "") -> None:
        super().__init__()
        self.setText(text)

    def setText(self, text: str) -> None:
        """Show a text."""
        self._said = languages.by_locale(text)
        super().setText(languages.unbroken(self._said))

    def text(self) -> str:
        """What it says, with plain spaces."""
        return self._said

    def clear(self) -> None:
        """Say nothing."""
        self.setText("")


def label(text: str = "", name: str = "", wrap: bool = True, level: str = "", hidden: bool = False) -> QLabel:
    """A label in one of the style sheet's kinds, in the colour of a level where one is given."""
    made = Words(text)
    made.setObjectName(name)
    made.setWordWrap(wrap)
    made.setTextFormat(Qt.TextFormat.PlainText)
    if level:
        made.setProperty("level", level)
    if hidden:
        made.hide()
    return made


def set_level(widget: QWidget, level: str) -> None:
    """Give a label the colour of a level."""
    if widget.property("level") != level:
        widget.setProperty("level", level)
        widget.style().unpolish(widget)
        widget.style().polish(widget)


def named(made: W, name: str, says: str = "", tip: str = "") -> W:
    """A field with its name, what a screen reader says of it, and its tooltip."""
    made.setObjectName(name)
    made.setAccessibleName(says)
    return _with_tip(made, tip)


def _with_tip(made: W, tip: str) -> W:
    """The widget with a tooltip, which `enable` gives it back."""
    made.setToolTip(tip)
    made.setProperty("tip", tip)
    return made


def bare(layout: L, spacing: int | None = None) -> L:
    """The layout without margins; `spacing` None: the style's."""
    layout.setContentsMargins(0, 0, 0, 0)
    if spacing is not None:
        layout.setSpacing(spacing)
    return layout


def spaced(layout: L, px: int, rows_px: int | None = None) -> L:
    """The layout with so many px between its parts; `rows_px`: between the rows of a grid, where that differs."""
    layout.setSpacing(px)
    if rows_px is not None and isinstance(layout, QGridLayout):
        layout.setVerticalSpacing(rows_px)
    return layout


def add(layout: B, *parts: Part | tuple[Part, int | Qt.AlignmentFlag]) -> B:
    """Add parts to a row or column, with stretch or alignment; a number is px of room, None room that stretches."""
    for one in parts:
        part, how = one if isinstance(one, tuple) else (one, 0)
        if part is None:
            layout.addStretch(1)
        elif isinstance(part, int):
            layout.addSpacing(part)
        elif isinstance(part, QLayout):
            layout.addLayout(part, how)
        elif isinstance(how, Qt.AlignmentFlag):  # an int too
            layout.addWidget(part, 0, how)
        else:
            layout.addWidget(part, how)
    return layout


def say(target: QLabel, text: str, level: str = "", hides: bool = True) -> None:
    """Have a label say this in the colour of a level; one that says nothing is hidden where it `hides`."""
    target.setText(text)
    set_level(target, level or "none")
    if hides:
        target.setVisible(bool(text))


def button(text: str, name: str, kind: str = "", act: Act = None, tip: str = "", icon: str = "") -> QPushButton:
    """A button; `act`: what a click does, where that is one thing."""
    made = _with_tip(QPushButton(text), tip)
    if act is not None:
        made.clicked.connect(act)
    if icon:
        give_icon(made, icon)
    made.setObjectName(kind or name)
    made.setProperty("key", name)
    made.setAccessibleName(text)
    made.setAutoDefault(False)
    made.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click leaves the space bar with the large button
    return made


def details_button(inner: QWidget) -> QPushButton:
    """The button “Details”, which shows and hides what is for the person at the desk; hidden at first."""
    made = button(translate("Details", "Details"), "details", "link")
    made.setCheckable(True)
    made.toggled.connect(inner.setVisible)
    inner.hide()
    return made


def option(text: str) -> QCheckBox:
    """A checkbox; a click leaves the space bar with the large button."""
    made = QCheckBox(text)
    made.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    return made


def enable(target: QWidget, on: bool, why: str = "") -> None:
    """Enable a button or field, or say in its tooltip why not."""
    target.setEnabled(on)
    target.setToolTip(str(target.property("tip") or "") if on else plain(why))
    target.setAccessibleDescription("" if on else why)


def ink(painter: QPainter, line: QColor | str | None, width: float = 1.0, fill: QColor | str | None = None) -> None:
    """Draw with this line and filling from now on; None: none."""
    painter.setPen(Qt.PenStyle.NoPen if line is None else QPen(QColor(line), width))
    painter.setBrush(Qt.BrushStyle.NoBrush if fill is None else QColor(fill))


def open_file(path: Path) -> bool:
    """Open a file or folder with the system's own program; whether there is one. Without a screen there is none."""
    if QGuiApplication.platformName() in ("offscreen", "minimal"):
        return False
    return QDesktopServices.openUrl(QUrl.fromLocalFile(str(path)))


class _Once(QObject):
    """Swallows the second press of a double click."""

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Whether the event goes no further."""
        return event.type() == QEvent.Type.MouseButtonDblClick


def once(target: QPushButton) -> QPushButton:
    """The same button, for which a double click is one click: else two quick taps on "Next" pass over a step."""
    target.installEventFilter(_Once(target))
    return target


def clear(layout: QLayout) -> None:
    """Take everything out of a layout, and out of sight at once."""
    while (item := layout.takeAt(0)) is not None:
        widget = item.widget()
        if widget is not None:
            widget.hide()
            widget.deleteLater()


class Elided(QLabel):
    """One line that is cut short where there is no room: what is beside it stays on the screen."""

    def __init__(self, text: str, name: str, parent: QWidget | None = None) -> None:
        super().__init__(text, parent)
        self.setObjectName(name)
        self.setTextFormat(Qt.TextFormat.PlainText)

    def minimumSizeHint(self) -> QSize:
        """A few letters."""
        return QSize(self.fontMetrics().horizontalAdvance("mmmm"), super().minimumSizeHint().height())

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw what fits; the tooltip has all of it."""
        painter, metrics = QPainter(self), self.fontMetrics()
        shown = metrics.elidedText(self.text(), Qt.TextElideMode.ElideMiddle, self.width())
        self.setToolTip(plain(self.text() if shown != self.text() else ""))
        own = "soft" if self.objectName() == "soft" else "text"
        level = str(self.property("level") or "none")
        tint = theme.colour(own) if level == "none" else QColor(theme.now().of(level))
        painter.setPen(tint if self.isEnabled() else theme.colour("idle"))
        painter.drawText(self.rect(), Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, shown)


class Downwards(QScrollArea):
    """Scrolls downwards only: it is as wide as what is in it."""

    def __init__(self, inner: QWidget) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setWidget(inner)

    def minimumSizeHint(self) -> QSize:
        """Room for the contents and the bar that scrolls them."""
        least, inner = super().minimumSizeHint(), self.widget()
        if inner is None:
            return least
        wide = inner.minimumSizeHint().width() + self.verticalScrollBar().sizeHint().width()
        return QSize(max(wide, least.width()), least.height())

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The contents ask for another size."""
        if event.type() == QEvent.Type.LayoutRequest:
            self.updateGeometry()
        return super().eventFilter(watched, event)


class Card(QFrame):
    """A panel with an optional heading; `body` takes the contents."""

    def __init__(self, title: str = "", horizontal: bool = False) -> None:
        super().__init__()
        self.setObjectName("card")
        outer = QVBoxLayout(self)
        outer.setContentsMargins(theme.PAD, theme.GAP, theme.PAD, theme.GAP)
        outer.setSpacing(theme.SMALL)
        self.heading = label(title, "big", wrap=False)
        self.heading.setVisible(bool(title))
        outer.addWidget(self.heading)
        self.body: QBoxLayout = QHBoxLayout() if horizontal else QVBoxLayout()
        self.body.setSpacing(theme.SMALL)
        outer.addLayout(self.body, 1)


class Canvas(QWidget):
    """A widget that paints itself, with smooth edges; `hint` is the size that it would like, px."""

    hint = (0, 0)

    def sizeHint(self) -> QSize:
        """As its class says."""
        return QSize(*self.hint)

    def paintEvent(self, _: QPaintEvent) -> None:
        """Paint it."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self.paint(painter)

    def paint(self, painter: QPainter) -> None:
        """The picture itself."""


class Chip(Canvas):
    """A word with the mark of its level on a thinned ground, such as the source or the validity of the calibration."""

    clicked = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.text = ""
        self.level: Level = "none"
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)

    def show_state(self, text: str, level: Level, details: str = "") -> None:
        """Show a word in the colour of a level."""
        self.text, self.level = languages.by_locale(text), level
        self.setToolTip(plain(details))
        self.setAccessibleName(text)
        self.updateGeometry()
        self.update()

    def sizeHint(self) -> QSize:
        """As wide as its word."""
        return self._size_of(self.text)

    def _size_of(self, text: str) -> QSize:
        metrics = self.fontMetrics()
        mark = 0 if self.level == "none" else self._mark_px() + theme.TIGHT
        return QSize(metrics.horizontalAdvance(text) + int(mark) + 2 * theme.GAP + 4, metrics.height() + 10)

    def _mark_px(self) -> float:
        return 0.8 * self.fontMetrics().height()

    def minimumSizeHint(self) -> QSize:
        """A word is never squeezed; the last of three or more, such as the age, is left out where there is no room."""
        return self._size_of(self._shorter)

    @property
    def _shorter(self) -> str:
        return " · ".join(self.text.split(" · ")[:2])

    @property
    def _shown(self) -> str:
        return self.text if self.width() >= self.sizeHint().width() else self._shorter

    def paint(self, painter: QPainter) -> None:
        """Draw it."""
        c, box = theme.now(), QRectF(self.rect()).adjusted(1, 1, -1, -1)
        tint = c.soft if self.level == "none" else c.of(self.level)
        ink(painter, theme.mixed(c.surface, tint, 0.45), 1, c.raised if self.level == "none" else c.tint(self.level))
        painter.drawRoundedRect(box, box.height() / 2, box.height() / 2)
        words = box.adjusted(theme.GAP, 0, -theme.GAP, 0)
        if self.level != "none":
            px = self._mark_px()
            painter.drawPixmap(QPointF(words.left(), box.center().y() - px / 2), level_pixmap(self.level, px, tint))
            words.setLeft(words.left() + px + theme.TIGHT)
        painter.setPen(QColor(tint))
        painter.drawText(words, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, self._shown)

    def mouseReleaseEvent(self, _: object) -> None:
        """Tell that it was clicked."""
        self.clicked.emit()


class Banner(QFrame):
    """What happened and what to do, in the colour of its kind, over its parent's lower edge: all keeps its place."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("banner")
        self._kind = ""
        row = QHBoxLayout(self)
        row.setContentsMargins(theme.PAD, theme.SMALL, theme.SMALL, theme.SMALL)
        row.setSpacing(theme.GAP)
        self._mark = label("", "", wrap=False)
        self._what = label("", "big")
        self._hint = label("", "soft")
        words = spaced(QVBoxLayout(), 2)
        add(words, self._what, self._hint)
        close = button("", "close-banner", act=self.hide, icon="x")
        close.setAccessibleName(self.tr("Close this message"))
        add(row, self._mark, (words, 1), (close, Qt.AlignmentFlag.AlignTop))
        if parent is not None:
            parent.installEventFilter(self)
        self.hide()

    @property
    def text(self) -> str:
        """What it says."""
        return f"{self._what.text()} {self._hint.text()}".strip()

    @property
    def alarms(self) -> bool:
        """Whether a red message is shown."""
        return not self.isHidden() and self._kind == "bad"

    def dress(self) -> None:
        """The mark is a picture in the colours of now."""
        tint = theme.now().text if self._kind == "info" else None
        self._mark.setPixmap(level_pixmap(self._kind, theme.pt(22), tint))

    def tell(self, kind: str, text: str, hint: str = "") -> None:
        """Show a message."""
        self._kind = kind
        set_level(self, kind)
        self.dress()
        say(self._what, text, kind)
        say(self._hint, hint)
        self.show()
        self.place()
        self.raise_()

    def place(self) -> None:
        """Over the page, above the large buttons, never wider than a line that can be read."""
        over = self.parentWidget()
        if over is None:
            return
        width = min(over.width() - 2 * theme.WIDE, _BANNER_PX)
        height = max(self.heightForWidth(width), self.minimumSizeHint().height())
        low = over.height() - int(theme.pt(_FOOTER_PX)) - theme.GAP
        self.setGeometry((over.width() - width) // 2, max(low - height, 0), width, height)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The window has another size."""
        if event.type() == QEvent.Type.Resize and not self.isHidden():
            self.place()
        return super().eventFilter(watched, event)


class WheelGuard(QObject):
    """Keeps the mouse wheel from changing combo boxes while a page is scrolled."""

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Swallow wheel events of widgets without focus."""
        return event.type() == QEvent.Type.Wheel and isinstance(watched, QWidget) and not watched.hasFocus()
