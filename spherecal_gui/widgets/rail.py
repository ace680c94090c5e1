"""The rail of steps: number or mark, name, state; a click goes there."""

from dataclasses import replace

from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QAbstractButton, QFrame, QScrollArea, QSizePolicy, QVBoxLayout, QWidget

from spherecal_gui import theme
from spherecal_gui.languages import reason_text, status_word, step_title
from spherecal_gui.standing import Level, Standing, level_of, status_shown
from spherecal_gui.widgets.basic import bare, ink, plain
from spherecal_gui.widgets.icons import pixmap
from spherecal_gui.workflow import Status, StepState, WorkflowState

_MARKS = {
    Status.DONE: "check", Status.CARE: "alert-triangle", Status.STALE: "refresh", Status.FAILED: "x",
    Status.RUNNING: "dots",
}  # fmt: skip
_LEVELS = {Status.DONE: "good", Status.CARE: "caution", Status.STALE: "caution", Status.FAILED: "bad"}
_MARK_LEFT_PX = 13


def _mark_px(box: QRectF) -> float:
    """As large as the row allows; never so large that a name is cut short for it."""
    return min(box.height() - 14, theme.pt(25))


class RailItem(QAbstractButton):
    """One step."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number
        self._state: StepState | None = None
        self._current = False
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click leaves the space bar with the large button
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    @property
    def level(self) -> Level:
        """The level that it is drawn in."""
        return level_of(self._state.status) if self._state is not None else "none"

    def show_state(self, state: StepState, current: bool) -> None:
        """Show a step's state."""
        self._state, self._current = state, current
        self.setObjectName(f"rail-{state.step.id}")
        title, word, why = step_title(state.step), status_word(state.status, state.step.kind), reason_text(state.reason)
        self.setAccessibleName(f"{title}, {word}")
        self.setAccessibleDescription(why)
        self.setToolTip(plain(f"{title}: {word}. {why}".strip()))
        self.update()

    def sizeHint(self) -> QSize:
        """Tall enough for a gloved finger."""
        return QSize(int(theme.pt(200)), int(theme.pt(50)))

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw the step."""
        if self._state is None:
            return
        c, state = theme.now(), self._state
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        box = QRectF(self.rect()).adjusted(4, 2, -4, -2)
        if self._current or self.underMouse():
            ink(painter, None, fill=c.raised)
            painter.drawRoundedRect(box, 8, 8)
        if self._current:
            painter.setBrush(QColor(c.accent))
            painter.drawRoundedRect(QRectF(box.left(), box.top() + 4, 5, box.height() - 8), 2, 2)
        if self.hasFocus():
            ink(painter, c.accent, 2)
            painter.drawRoundedRect(box.adjusted(1, 1, -1, -1), 8, 8)
        self._draw_mark(painter, box)
        blocked = state.status is Status.BLOCKED
        left = box.left() + _MARK_LEFT_PX + _mark_px(box) + theme.SMALL
        room = QRectF(left, box.top() + 4, box.right() - left - 4, box.height() - 8)
        painter.setFont(theme.font(12, bold=self._current))
        painter.setPen(QColor(c.idle if blocked else c.text))
        half = room.height() / 2
        title = step_title(state.step)
        if painter.fontMetrics().horizontalAdvance(title) > room.width():  # German, from afar: bold is wider
            painter.setFont(theme.font(12))
        title = painter.fontMetrics().elidedText(title, Qt.TextElideMode.ElideRight, int(room.width()))
        painter.drawText(QRectF(room.left(), room.top(), room.width(), half + 2), Qt.AlignmentFlag.AlignVCenter, title)
        painter.setFont(theme.font(9.5))
        painter.setPen(QColor(c.of(_LEVELS.get(state.status, "none")) if not blocked else c.idle))
        room.setTop(room.top() + half)
        painter.drawText(room, Qt.AlignmentFlag.AlignVCenter, status_word(state.status, state.step.kind))

    def _draw_mark(self, painter: QPainter, box: QRectF) -> None:
        c, status = theme.now(), self._state.status if self._state else Status.BLOCKED
        size = _mark_px(box)
        circle = QRectF(box.left() + _MARK_LEFT_PX, box.center().y() - size / 2, size, size)
        tint = QColor(c.of(_LEVELS.get(status, "none")))
        if status in (Status.READY, Status.RUNNING):
            tint = QColor(c.accent)
        ink(painter, tint, 1.5, c.tint(_LEVELS[status]) if status in _LEVELS else None)
        painter.drawEllipse(circle)
        if status in _MARKS:
            px = 0.62 * size
            painter.drawPixmap(circle.center() - QPointF(px / 2, px / 2), pixmap(_MARKS[status], px, tint.name()))
            return
        painter.setFont(theme.font(theme.LEAD, bold=True))
        painter.setPen(tint)
        painter.drawText(circle, Qt.AlignmentFlag.AlignCenter, str(self._number))


class Rail(QFrame):
    """All steps, top to bottom."""

    chosen = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("rail")
        self.setAccessibleName(self.tr("Steps"))
        self._items: list[RailItem] = []
        self._ids: list[str] = []
        inner = QWidget()
        self._column = QVBoxLayout(inner)
        self._column.setContentsMargins(6, 10, 6, 10)
        self._column.setSpacing(2)
        self._column.addStretch(1)
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        scroll.setWidget(inner)
        bare(QVBoxLayout(self)).addWidget(scroll)
        self.fit()

    def fit(self) -> None:
        """As wide as the font asks for."""
        self.setFixedWidth(int(min(theme.pt(222), 252)))
        self._share_height()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """All steps stay in sight."""
        super().resizeEvent(event)
        self._share_height()

    def _share_height(self) -> None:
        shown = max(len(self._ids), 1)
        each = min(theme.pt(50), max((self.height() - 26) / shown - 2, 40))
        for item in self._items:
            item.setFixedHeight(int(each))

    def show_state(self, state: WorkflowState, standing: Standing | None = None) -> None:
        """Show all steps; the current one no better than the state of its page. `standing` None: no page is shown."""
        self._ids = [one.step.id for one in state.steps]
        while len(self._items) < len(state.steps):
            item = RailItem(len(self._items) + 1)
            item.clicked.connect(self._clicked)
            self._column.insertWidget(len(self._items), item)
            self._items.append(item)
        for item, one in zip(self._items, state.steps, strict=False):
            current = one.step.id == state.current
            shown = one
            if standing is not None and current:
                shown = replace(one, status=status_shown(one.status, standing.level))
            if one.not_begun and not current:
                shown = replace(one, status=Status.BLOCKED)
            item.show_state(shown, current)
            item.setCursor(Qt.CursorShape.PointingHandCursor if one.open else Qt.CursorShape.ForbiddenCursor)
        for number, item in enumerate(self._items):
            item.setVisible(number < len(state.steps))
        self._share_height()

    def item(self, step: str) -> RailItem:
        """The item of a step."""
        return self._items[self._ids.index(step)]

    def _clicked(self) -> None:
        item = self.sender()
        if isinstance(item, RailItem):
            self.chosen.emit(self._ids[self._items.index(item)])
