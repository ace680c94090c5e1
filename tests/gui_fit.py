"""What does not fit on the screen: scrolled, cut short, out of sight, or over something else."""

from PySide6.QtCore import QCoreApplication, QEvent, QPoint, QRect, Qt
from PySide6.QtGui import QFontMetrics
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractScrollArea,
    QCheckBox,
    QComboBox,
    QLabel,
    QPlainTextEdit,
    QPushButton,
    QTabBar,
    QToolButton,
    QWidget,
)

from spherecal_gui.widgets.basic import Elided


def settled(window: QWidget) -> None:
    """A layout asks for its size round after round."""
    for _ in range(6):
        QCoreApplication.processEvents()
    QCoreApplication.sendPostedEvents(None, QEvent.Type.LayoutRequest.value)  # of words that came as the last event


def scrolled(window: QWidget) -> list[tuple[str, bool, bool]]:
    """The areas that scroll in sight: name, whether sideways, whether downwards."""
    found = []
    for area in window.findChildren(QAbstractScrollArea):
        if not area.isVisible() or isinstance(area, QPlainTextEdit):
            continue
        across, down = area.horizontalScrollBar().maximum() > 0, area.verticalScrollBar().maximum() > 0
        across &= area.horizontalScrollBarPolicy() != Qt.ScrollBarPolicy.ScrollBarAlwaysOff
        down &= area.verticalScrollBarPolicy() != Qt.ScrollBarPolicy.ScrollBarAlwaysOff
        if across or down:
            found.append((f"{type(area).__name__} {area.objectName()} in {_owner(area)}", across, down))
    return found


def cut_short(window: QWidget) -> list[str]:
    """Labels and buttons that show less than their words, or of which a part is out of sight."""
    found = []
    for one in window.findChildren(QWidget):
        if not one.isVisible() or isinstance(one, Elided) or not _text(one):
            continue
        told = f"{type(one).__name__} {_text(one)[:40]!r} in {_owner(one)}"
        need = _least(one)
        if one.width() < need[0] or one.height() < need[1]:
            found.append(f"{told}: {one.width()} x {one.height()}, needs {need[0]} x {need[1]}")
        elif _out_of_sight(one):
            found.append(f"{told}: partly out of sight")
    for bar in window.findChildren(QTabBar):
        if bar.isVisible() and any(one.isVisible() for one in bar.findChildren(QToolButton)):
            found.append(f"tabs of {_owner(bar)} are scrolled")
    return found


def covered(window: QWidget) -> list[str]:
    """Labels and buttons of the page that lie over each other."""
    parts = [
        one
        for one in window.findChildren(QWidget)
        if one.isVisible() and isinstance(one, (QLabel, QAbstractButton, QComboBox)) and _text(one)
    ]
    boxes = [(one, QRect(one.mapTo(window, QPoint(0, 0)), one.size()).adjusted(1, 1, -1, -1)) for one in parts]
    return [
        f"{_text(a)[:30]!r} over {_text(b)[:30]!r}"
        for i, (a, at) in enumerate(boxes)
        for b, there in boxes[:i]
        if at.intersects(there) and not a.isAncestorOf(b) and not b.isAncestorOf(a)
    ]


def _text(one: QWidget) -> str:
    if isinstance(one, QComboBox):
        return one.currentText()
    return one.text() if isinstance(one, (QLabel, QPushButton, QCheckBox)) else ""


def _least(one: QWidget) -> tuple[int, int]:
    """The least width and height that show all its words."""
    if isinstance(one, QLabel):
        if one.textFormat() == Qt.TextFormat.RichText:
            return one.minimumSizeHint().width(), one.minimumSizeHint().height()
        metrics = QFontMetrics(one.font())
        if one.wordWrap():
            longest = max((metrics.horizontalAdvance(word) for word in one.text().split()), default=0)
            box = metrics.boundingRect(0, 0, one.width(), 10_000, int(Qt.TextFlag.TextWordWrap), one.text())
            return (longest if one.text().isascii() else 0), box.height()
        return max(metrics.horizontalAdvance(line) for line in one.text().split("\n")), metrics.height()
    if isinstance(one, QPushButton):
        return QFontMetrics(one.font()).horizontalAdvance(one.text()) + 4, QFontMetrics(one.font()).height()
    return one.minimumSizeHint().width(), QFontMetrics(one.font()).height()


def _out_of_sight(one: QWidget) -> bool:
    """Whether a part lies outside what its parents show; what a table or a list scrolls is said elsewhere."""
    parent = one.parentWidget()
    while parent is not None:
        if isinstance(parent, QAbstractItemView):
            return False
        parent = parent.parentWidget()
    return one.visibleRegion().boundingRect() != one.rect()


def _owner(one: QWidget) -> str:
    """The page it stands on."""
    parent: QWidget | None = one
    while parent is not None:
        name = type(parent).__name__
        if name.endswith(("Page", "Dialog", "Panel", "Header", "Footer", "Rail", "List", "View")) and parent is not one:
            return name
        parent = parent.parentWidget()
    return "window"
