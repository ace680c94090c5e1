"""A camera's live image with what matters about it, and the wall of all cameras."""

import time
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import (
    QBrush,
    QColor,
    QFontMetrics,
    QImage,
    QKeyEvent,
    QKeySequence,
    QMouseEvent,
    QPainter,
    QPen,
    QResizeEvent,
    QShortcut,
)
from PySide6.QtWidgets import QGridLayout, QLineEdit, QToolTip, QWidget

from spherecal_gui import languages, theme
from spherecal_gui.presenters.look_presenter import TileState
from spherecal_gui.project import Rectangle
from spherecal_gui.widgets.basic import MARKS, Canvas, bare, button, ink, named, plain

if TYPE_CHECKING:  # imports scipy
    from spherecal_gui.tasks.ghost import Drawn

_LEAST_MASK_PX = 6.0  # of the widget: less is a click with a trembling hand
_TWO_LINES_PT = 175  # a tile that is less high keeps its room for the image
_LONGEST_NAME = 30
_DASHES_PX = 5  # the outline of a camera that needs more is drawn within the tile's own, around its words
_LASTING_S = 3.0  # a camera that is in trouble for a moment moves no tile
_TROUBLE = {"bad": 0, "caution": 1}  # all others keep the rig's order
_WIDTH_PX = 640  # of a shown image at most: a stride of whole pixels costs a tenth of a proper scaling


def shown_image(image: np.ndarray, bits: int, width: int) -> QImage:
    """A grey image (height, width) as Qt draws it, thinned out to about this width; the memory is its own."""
    step = max(1, image.shape[1] // max(width, 1))
    small = image[::step, ::step]
    if small.dtype != np.uint8:
        small = (small >> max(bits - 8, 0)).astype(np.uint8)
    small = np.ascontiguousarray(small)
    height, columns = small.shape
    return QImage(small.data, columns, height, columns, QImage.Format.Format_Grayscale8).copy()


def _fitting(message: str, metrics: QFontMetrics, width: float) -> str:
    """As many of the figures of a line as have room: a number that is cut short would be another one."""
    shown = languages.by_locale(message)
    while " · " in shown and metrics.horizontalAdvance(shown) > width:
        shown = shown.rpartition(" · ")[0]
    return metrics.elidedText(shown, Qt.TextElideMode.ElideRight, int(width))


class CameraTile(Canvas):
    """One camera: image, dots found in it, name, counter, what is wrong with it; the border is the state's colour."""

    opened = Signal(str)
    renamed = Signal(str, str)  # serial; the new name
    masked = Signal(str, object)  # serial; left, top, width, height in px of the image
    hint = (320, 260)

    def __init__(self, serial: str, name: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.serial, self.name = serial, name
        self.image: QImage | None = None  # that is shown
        self._size = (1, 1)
        self.state = TileState(name)
        self._dots = np.empty((0, 2))
        self._shown: float | None = None
        self.masking = False
        self._histogram: np.ndarray | None = None
        self._ghost: Drawn | None = None
        self._near = False
        self._covered: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
        self.need = ""  # what the camera needs, in words
        self._masks: tuple[Rectangle, ...] = ()
        self._proposed: tuple[Rectangle, ...] = ()
        self._drag: tuple[QPointF, QPointF] | None = None
        self._doubled = False
        self.can_rename = False  # a click on the name edits it
        self.why_not_renamed = ""  # why the name cannot be changed here
        self._editor: QLineEdit | None = None
        self.setObjectName(f"tile-{name}")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMinimumSize(150, 120)

    def show_image(self, image: np.ndarray, bits: int, taken_s: float) -> None:
        """Show a newer image. `image`: grey values (height, width)."""
        if taken_s == self._shown:
            return
        self._shown = taken_s
        self._size = (image.shape[1], image.shape[0])
        wanted = int(self.width() * self.devicePixelRatioF())
        self.image = shown_image(image, bits, min(max(wanted, 200), 3 * _WIDTH_PX))
        self.update()

    def show_state(self, state: TileState, dots: np.ndarray) -> None:
        """Show the state and the dots. `dots`: where the dots are (n, 2), px of the image."""
        if state != self.state or len(dots) != len(self._dots):
            self.setAccessibleName(f"{state.name}: {state.word} {state.since}".strip())
            if state.details != self.state.details:
                self.setToolTip(plain(state.details))
            self.update()
        self.state, self._dots = state, dots

    def show_histogram(self, counts: np.ndarray | None) -> None:
        """Show how many pixels have each grey value, dark to bright (n,); None: not."""
        self._histogram = counts  # drawn with the next image

    def show_masks(self, masks: tuple[Rectangle, ...], proposed: tuple[Rectangle, ...] = ()) -> None:
        """Show the parts of the image that do not count, and those that are proposed as such."""
        if (masks, proposed) != (self._masks, self._proposed):
            self._masks, self._proposed = masks, proposed
            self.update()

    def show_ghost(self, drawn: "Drawn | None", near: bool) -> None:
        """Show where the ball should go and where it is. `drawn` None: neither."""
        if drawn is not self._ghost or near != self._near:
            self._ghost, self._near = drawn, near
            self.update()

    def show_coverage(self, before: np.ndarray | None, now: np.ndarray | None, need: str = "") -> None:
        """Lay the covered cells (10, 10) over the image, of the placements taken and of this one; None: not shown."""
        same = need == self.need and all(
            one is other or (one is not None and other is not None and np.array_equal(one, other))
            for one, other in ((before, self._covered[0]), (now, self._covered[1]))
        )
        if not same:
            self._covered, self.need = (before, now), need
            self.setToolTip(plain(need or self.state.word))
            self.update()

    @property
    def _has_two_lines(self) -> bool:
        """Whether the figures have a line of their own below the word."""
        return bool(self.state.figures) and self.height() >= theme.pt(_TWO_LINES_PT)

    @property
    def _foot(self) -> float:
        return theme.pt(40 if self._has_two_lines else 22) + (_DASHES_PX if self.need else 0)

    def _room(self) -> QRectF:
        box = QRectF(self.rect()).adjusted(2, 2, -2, -2)
        head, foot = theme.pt(34), self._foot
        return QRectF(box.left() + 4, box.top() + head, box.width() - 8, max(box.height() - head - foot, 1))

    def _field(self) -> tuple[QRectF, float]:
        """Where the image is, and how many of the widget's pixels one of its pixels takes."""
        room = self._room()
        scale = min(room.width() / self._size[0], room.height() / self._size[1])
        width, height = self._size[0] * scale, self._size[1] * scale
        return QRectF(room.center().x() - width / 2, room.center().y() - height / 2, width, height), scale

    def paint(self, painter: QPainter) -> None:
        """Draw header, image, dots and border."""
        c = theme.now()
        tint = QColor(c.of(self.state.level))
        box = QRectF(self.rect()).adjusted(2, 2, -2, -2)
        ink(painter, None, fill=c.surface)
        painter.drawRoundedRect(box, 6, 6)
        self._draw_image(painter, self._room())
        self._draw_masks(painter)
        self._draw_ghost(painter)
        self._draw_words(painter, box, theme.pt(34), self._foot, tint)
        ink(painter, tint, 5 if self.hasFocus() else 3)
        painter.drawRoundedRect(box, 6, 6)
        if self.need:
            painter.setPen(QPen(theme.colour("accent"), 3, Qt.PenStyle.DashLine))
            painter.drawRoundedRect(box.adjusted(4, 4, -4, -4), 5, 5)

    def _draw_coverage(self, painter: QPainter, at: QRectF) -> None:
        """The cells that are covered, thin enough for the image to stay in sight."""
        for cells, colour in zip(self._covered, ("#2fd27a", "#4aa8ff"), strict=True):
            if cells is None:
                continue
            tint = QColor(colour)
            tint.setAlpha(46)
            wide, high = at.width() / cells.shape[1], at.height() / cells.shape[0]
            for row, column in np.argwhere(cells > 0).tolist():
                painter.fillRect(QRectF(at.left() + column * wide, at.top() + row * high, wide, high), tint)

    def _draw_ghost(self, painter: QPainter) -> None:
        """The ball where it should go, dashed, and where it is, each with the direction of its top."""
        if self._ghost is None or self.image is None or self.state.lost:
            return
        at, scale = self._field()
        painter.save()
        painter.setClipRect(at)
        offset = np.array([at.left(), at.top()])
        wanted = QColor("#3be37f" if self._near else "#ffb02e")
        for outline, pole, pen in (
            (self._ghost.lying, self._ghost.lying_pole, QPen(QColor("#35e0ff"), 2)),
            (self._ghost.wanted, self._ghost.wanted_pole, QPen(wanted, 3, Qt.PenStyle.DashLine)),
        ):
            painter.setPen(pen)
            painter.setBrush(Qt.BrushStyle.NoBrush)
            if len(outline):
                painter.drawPolygon([QPointF(x, y) for x, y in ((outline + 0.5) * scale + offset).tolist()])
            if len(pole) == 2:
                self._draw_pole(painter, pen.color(), (pole + 0.5) * scale + offset)
        painter.restore()

    @staticmethod
    def _draw_pole(painter: QPainter, tint: QColor, pole: np.ndarray) -> None:
        """An arrow from the ball's middle to its top."""
        start, end = (QPointF(x, y) for x, y in pole.tolist())
        painter.setPen(QPen(tint, 3, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
        painter.drawLine(start, end)
        way = pole[1] - pole[0]
        angle, size = float(np.arctan2(way[1], way[0])), min(12.0, 0.4 * float(np.hypot(*way)))
        for side in (2.6, -2.6):
            painter.drawLine(end, end + QPointF(size * np.cos(angle + side), size * np.sin(angle + side)))
        painter.setBrush(tint)
        painter.drawEllipse(start, 3, 3)

    def _draw_image(self, painter: QPainter, room: QRectF) -> None:
        c = theme.now()
        painter.fillRect(room, QColor(c.scene))  # around an image its own black would look like more of it
        if self.image is None:
            painter.setPen(QColor(c.soft))
            painter.setFont(theme.font(11))
            painter.drawText(room, Qt.AlignmentFlag.AlignCenter, self.tr("no image yet"))
            return
        at, scale = self._field()
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        if self.state.lost:
            self._draw_last(painter, at, self.image)
            return
        painter.drawImage(at, self.image)
        self._draw_coverage(painter, at)
        if len(self._dots):
            painter.setPen(QPen(QColor("#35e0ff"), 2.2, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
            places = (self._dots + 0.5) * scale + np.array([at.left(), at.top()])
            painter.drawPoints([QPointF(x, y) for x, y in places.tolist()])
        if self._histogram is not None:
            self._draw_histogram(painter, at, self._histogram)

    @staticmethod
    def _draw_histogram(painter: QPainter, at: QRectF, counts: np.ndarray) -> None:
        """In the image's corner; heights are roots, so that few bright pixels are seen, and what clips is red."""
        box = QRectF(0, 0, min(theme.pt(96), 0.4 * at.width()), min(theme.pt(36), 0.3 * at.height()))
        box.moveBottomRight(at.bottomRight() - QPointF(4, 4))
        painter.fillRect(box, QColor(0, 0, 0, 150))
        heights = np.sqrt(counts / max(counts.max(), 1)) * (box.height() - 4)
        wide = box.width() / len(counts)
        for number, height in enumerate(heights.tolist()):
            tint = QColor("#ff5a4f" if number == len(counts) - 1 else "#e8edf2")
            painter.fillRect(QRectF(box.left() + number * wide, box.bottom() - height, wide, height), tint)

    def _draw_last(self, painter: QPainter, at: QRectF, image: QImage) -> None:
        """The last image of a camera that sends none, faint; over it what to do, in full; its dots are of the past."""
        painter.setOpacity(0.3)
        painter.drawImage(at, image)
        painter.setOpacity(1.0)
        painter.setFont(theme.font(theme.CAPTION, bold=True))
        since, word = self.state.since, self.state.word  # a small tile has no room for both
        flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap
        room = QRectF(12, at.top() + 4, self.width() - 24, at.height() - 8)
        words, box = "", QRectF()
        for words in filter(None, (f"{since}\n{word}".strip(), word, since)):
            box = painter.fontMetrics().boundingRect(room.toRect(), flags, words).toRectF()
            if box.height() <= room.height():
                break
        box.adjust(-8, -4, 8, 4)
        painter.fillRect(box, QColor(theme.now().surface))
        painter.setPen(QColor(theme.now().text))
        painter.drawText(box, flags, words)

    def _draw_masks(self, painter: QPainter) -> None:
        """Hatched, so that the image stays to be seen; outlined where they are only proposed."""
        at, scale = self._field()
        hatched = QBrush(QColor("#ff5fd2"), Qt.BrushStyle.BDiagPattern)
        for left, top, width, height in (*self._proposed, *self._masks):
            proposed = (left, top, width, height) in self._proposed
            painter.setPen(QPen(QColor("#ff5fd2"), 3 if proposed else 2))
            painter.setBrush(Qt.BrushStyle.NoBrush if proposed else hatched)
            painter.drawRect(
                QRectF(at.left() + (left + 0.5) * scale, at.top() + (top + 0.5) * scale, width * scale, height * scale)
            )
        if self._drag is not None:
            painter.setPen(QPen(QColor("#ff5fd2"), 2))
            painter.setBrush(hatched)
            painter.drawRect(QRectF(*self._drag).normalized())

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin a mask, where one is to be drawn; a click on the name edits it."""
        if self.can_rename and not self.masking and self._name_box().contains(event.position()):
            self.edit_name()
            return
        if self.masking and self.image is not None and event.button() == Qt.MouseButton.LeftButton:
            self._drag = (event.position(), event.position())
        else:
            super().mousePressEvent(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Draw it."""
        if self._drag is not None:
            self._drag = (self._drag[0], event.position())
            self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """It is drawn: tell its place in the image; a mere click draws none."""
        drag, self._drag = self._drag, None
        if drag is None:
            self._clicked(event)
            return
        self.update()
        at, scale = self._field()
        drawn = QRectF(*drag).normalized().intersected(at)
        if drawn.width() < _LEAST_MASK_PX or drawn.height() < _LEAST_MASK_PX:
            return
        left, top = (drawn.left() - at.left()) / scale - 0.5, (drawn.top() - at.top()) / scale - 0.5
        rectangle = tuple(round(one, 1) for one in (left, top, drawn.width() / scale, drawn.height() / scale))
        self.masked.emit(self.serial, rectangle)

    def _draw_words(self, painter: QPainter, box: QRectF, head: float, foot: float, tint: QColor) -> None:
        c, state = theme.now(), self.state
        top = QRectF(box.left() + 10, box.top() + 2, box.width() - 20, head - 2)
        painter.setFont(theme.font(14, bold=True))
        painter.setPen(QColor(c.text))
        painter.drawText(top, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, state.name)
        painter.setPen(tint)
        mark, metrics = MARKS[state.level], painter.fontMetrics()
        counted = self.tr("{count} dots").format(count=state.dots)
        count = mark if state.dots is None else f"{counted} {mark}"
        if metrics.horizontalAdvance(f"{state.name}  {count}") > top.width():
            count = f"{state.dots} {mark}"
        painter.drawText(top, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignRight, count)
        line = theme.pt(19 if self._has_two_lines else 22)
        bottom = QRectF(box.left() + 10, box.bottom() - foot - 1, box.width() - 20, line)
        painter.setFont(theme.font(theme.CAPTION, bold=state.level != "good"))
        painter.setPen(tint if state.level != "good" else QColor(c.soft))
        said = self.need if self.need and state.level in ("good", "none") else state.word
        if state.lost and self.image is not None:  # it stands over the image, in full
            said = ""
        if not self._has_two_lines and state.figures and state.level == "good":
            said = f"{said} · {state.figures}"
        text = _fitting(said, painter.fontMetrics(), bottom.width())
        painter.drawText(bottom, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, text)
        if self._has_two_lines:
            bottom.moveTop(bottom.bottom())
            painter.setFont(theme.font(theme.CAPTION))
            painter.setPen(QColor(c.soft))
            text = _fitting(state.figures, painter.fontMetrics(), bottom.width())
            painter.drawText(bottom, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, text)

    def _name_box(self) -> QRectF:
        return QRectF(8, 2, self.width() / 2, theme.pt(34))

    def edit_name(self) -> None:
        """Edit the name where it is; where it cannot be changed, say why."""
        if self.why_not_renamed:
            below = self.mapToGlobal(self._name_box().bottomLeft().toPoint())
            QToolTip.showText(below, plain(self.why_not_renamed), self)
            return
        editor = QLineEdit(self.name, self, maxLength=_LONGEST_NAME)
        named(editor, f"rename-{self.name}", self.tr("Name of the camera"))
        editor.setGeometry(self._name_box().toRect())
        editor.installEventFilter(self)
        editor.editingFinished.connect(self._named)
        self._editor = editor
        editor.show()
        editor.selectAll()
        editor.setFocus()

    def _named(self, keep: bool = True) -> None:
        """Enter, or another place was clicked: keep the name that was typed."""
        editor, self._editor = self._editor, None
        if editor is None:
            return
        name = editor.text().strip()
        editor.hide()
        editor.deleteLater()
        self.setFocus()
        if keep and name and name != self.name:
            self.renamed.emit(self.serial, name)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Escape leaves the name as it was; no key that is typed there means anything to the page."""
        pressed = isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress and watched is self._editor
        ends = (Qt.Key.Key_Escape, Qt.Key.Key_Return, Qt.Key.Key_Enter)
        if pressed and isinstance(event, QKeyEvent) and event.key() in ends:
            self._named(keep=event.key() != Qt.Key.Key_Escape)
            return True
        return super().eventFilter(watched, event)

    def _clicked(self, event: QMouseEvent) -> None:
        """Enlarge, unless a mask is being drawn or the name is edited; of a double click only the first one counts."""
        doubled, self._doubled = self._doubled, False
        inside = self.rect().contains(event.position().toPoint())
        naming = self.can_rename and self._name_box().contains(event.position())
        if event.button() == Qt.MouseButton.LeftButton and inside and not (self.masking or naming or doubled):
            self.opened.emit(self.serial)

    def mouseDoubleClickEvent(self, _: QMouseEvent) -> None:
        """Its first click has enlarged already."""
        self._doubled = True

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Return enlarges, as a double click does."""
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.opened.emit(self.serial)
        elif event.key() == Qt.Key.Key_F2 and self.can_rename:
            self.edit_name()
        else:
            super().keyPressEvent(event)


class Wall(QWidget):
    """The tiles of all cameras in a grid; one of them alone after a click, with the way back on it and on Esc."""

    masked = Signal(str, object)
    renamed = Signal(str, str)

    def __init__(self, renames: bool = False) -> None:
        """`renames`: a click on a camera's name edits it."""
        super().__init__()
        self.tiles: dict[str, CameraTile] = {}
        self._renames = renames
        self._follows, self._since_s = True, 0.0
        self._rank: tuple[str, ...] = ()  # the order that is waited for
        self.alone: str | None = None  # the serial of the camera that is shown alone
        self._order: list[str] = []
        self._masking = False
        self._grid = bare(QGridLayout(self), 8)
        self.all_again = button(self.tr("All cameras  (Esc)"), "all-cameras", act=lambda: self.show_alone(None))
        self.all_again.setParent(self)
        self.all_again.hide()
        self._escape = QShortcut(QKeySequence(Qt.Key.Key_Escape), self)
        self._escape.setEnabled(False)
        self._escape.activated.connect(lambda: self.show_alone(None))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """The way back stays in its corner."""
        super().resizeEvent(event)
        self._place_way_back()

    def _place_way_back(self) -> None:
        self.all_again.adjustSize()
        self.all_again.move(self.width() - self.all_again.width() - 12, int(theme.pt(40)))
        self.all_again.raise_()

    def set_cameras(self, names: dict[str, str]) -> None:
        """Show these cameras, by serial with their names, in this order."""
        if list(names.items()) == [(tile.serial, tile.name) for tile in self.tiles.values()]:
            return
        for tile in self.tiles.values():
            tile.setParent(None)
            tile.deleteLater()
        self.tiles, self._order, self._rank = {}, [], ()
        for serial, name in names.items():
            tile = CameraTile(serial, name, self)
            tile.opened.connect(self.zoom)
            tile.masked.connect(self.masked)
            tile.renamed.connect(self.renamed)
            tile.can_rename = self._renames
            tile.masking = self._masking
            self.tiles[serial] = tile
        self.alone = None
        self._arrange()

    def set_masking(self, on: bool) -> None:
        """Whether dragging draws masks."""
        self._masking = on
        for tile in self.tiles.values():
            tile.masking = on
            tile.setCursor(Qt.CursorShape.CrossCursor if on else Qt.CursorShape.ArrowCursor)

    def zoom(self, serial: str) -> None:
        """Show one camera alone, or all again."""
        self.show_alone(None if self.alone == serial else serial)

    def show_alone(self, serial: str | None) -> None:
        """Show this camera alone, or all."""
        self.alone = serial if serial in self.tiles else None
        self._arrange()

    def worst_first(self, on: bool) -> None:
        """Cameras in trouble first, from now on and always, or all in the rig's order."""
        self._follows = on
        self._rank = ()
        self._order = self._by_trouble() if on else []
        self._arrange()

    def _by_trouble(self) -> list[str]:
        """Cameras that need somebody first, each group in the rig's order."""
        return sorted(self.tiles, key=lambda serial: _TROUBLE.get(self.tiles[serial].state.level, 2))

    def follow_worst(self, now_s: float | None = None) -> None:
        """Move cameras in trouble to the front once the trouble has lasted; not under somebody's pointer."""
        if not self._follows or self.alone is not None:
            return
        now = time.monotonic() if now_s is None else now_s
        wanted = tuple(self._by_trouble())
        if wanted == tuple(self._order or self.tiles):
            self._rank = ()
        elif wanted != self._rank:
            self._rank, self._since_s = wanted, now
        elif now - self._since_s >= _LASTING_S and not self.underMouse() and not self._masking:
            self._order, self._rank = list(wanted), ()
            self._arrange()

    def _arrange(self) -> None:
        columns = self._columns(len(self.tiles))
        order = self._order if set(self._order) == set(self.tiles) else list(self.tiles)
        for tile in self.tiles.values():
            self._grid.removeWidget(tile)
        for index, serial in enumerate(order):
            tile = self.tiles[serial]
            tile.setVisible(self.alone in (None, serial))
            if self.alone is None:
                self._grid.addWidget(tile, index // columns, index % columns)
            elif self.alone == serial:
                self._grid.addWidget(tile, 0, 0)
        self.all_again.setVisible(self.alone is not None)
        self._escape.setEnabled(self.alone is not None)
        self._place_way_back()

    @staticmethod
    def _columns(count: int) -> int:
        """Columns for a wall on a wide screen: 6 cameras 3 x 2, 12 4 x 3, 16 4 x 4."""
        return next((columns for columns in range(1, 9) if columns * columns * 0.8 >= count), 8)
