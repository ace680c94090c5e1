"""What the results page shows of a result: residuals as arrows, lens fields and drifts, findings with their buttons."""

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPen
from PySide6.QtWidgets import QHBoxLayout, QScrollArea, QVBoxLayout, QWidget

from spherecal_gui import languages, theme
from spherecal_gui.presenters.results_presenter import (
    Action,
    CameraResiduals,
    FindingAdvice,
    drift_text,
    field_text,
    repair_text,
)
from spherecal_gui.tasks.outcome import CameraEffect
from spherecal_gui.widgets.basic import Canvas, add, bare, button, clear, details_button, label, plain, spaced
from spherecal_gui.widgets.icons import level_pixmap

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


_FEW, _GAP_PX = 9, 10.0  # so many maps stand three in a row, more of them five


class EffectsView(QWidget):
    """Both, each under its sentence."""

    def __init__(self) -> None:
        super().__init__()
        column = QVBoxLayout(self)
        self.field, self.drift = label(""), label("")
        self.maps, self.lines = _Maps(), _Lines()
        add(column, self.field, (self.maps, 3), self.drift, (self.lines, 2))

    def show_effects(self, effects: tuple[CameraEffect, ...]) -> None:
        """Show those of a result."""
        for words, text in ((self.field, field_text), (self.drift, drift_text)):
            words.setText(languages.by_locale(text(effects)) if effects else "")
        self.maps.setVisible(any(one.field_px is not None for one in effects))
        self.lines.setVisible(any(len(one.drift_px) > 1 for one in effects))
        for part in (self.maps, self.lines):
            part.effects = effects
            part.update()


class _Maps(Canvas):
    """The darker the accent, the farther the lens is from its model there; one scale for all."""

    effects: tuple[CameraEffect, ...] = ()

    def paint(self, painter: QPainter) -> None:
        """Maps in rows, the camera's name and figure above each."""
        if not self.effects:
            return
        painter.setFont(theme.font(theme.CAPTION))
        fields = [one.field_px for one in self.effects if one.field_px is not None]
        most = max(float(one.max()) for one in fields) or 1.0
        columns = 3 if len(self.effects) <= _FEW else 5
        rows, line = -(-len(self.effects) // columns), painter.fontMetrics().height()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)  # else the cells have seams
        width, height = (self.width() + _GAP_PX) / columns - _GAP_PX, (self.height() + _GAP_PX) / rows - _GAP_PX
        for number, one in enumerate(self.effects):
            left = number % columns * (width + _GAP_PX)
            top = number // columns * (height + _GAP_PX)
            painter.setPen(theme.colour("text"))
            words = f"{one.camera} · {one.field_rms_px:.3f} px" if one.field_px is not None else one.camera
            painter.drawText(QPointF(left, top + 0.8 * line), languages.by_locale(words))
            if one.field_px is None:
                continue
            down, across = one.field_px.shape
            cell = min(width / across, (height - line) / down)
            for (v, u), value in np.ndenumerate(one.field_px / most):
                tint = QColor(theme.now().accent)
                tint.setAlphaF(0.08 + 0.92 * float(value))
                painter.fillRect(QRectF(left + u * cell, top + line + v * cell, cell + 0.5, cell + 0.5), tint)


class _Lines(Canvas):
    """One line for each camera, its name at the end; px over the placements."""

    effects: tuple[CameraEffect, ...] = ()

    def paint(self, painter: QPainter) -> None:
        """The lines, the worst in the colour of caution."""
        drifts = [one for one in self.effects if len(one.drift_px) > 1]
        if not drifts:
            return
        painter.setFont(theme.font(theme.CAPTION))
        most = max(float(one.drift_px.max()) for one in drifts) or 1.0
        metrics = painter.fontMetrics()
        left, right = metrics.horizontalAdvance("0.00 px "), metrics.horizontalAdvance(" C0000")
        top, bottom = metrics.height(), self.height() - metrics.height()
        painter.setPen(theme.colour("soft"))
        painter.drawText(QPointF(0, top), languages.by_locale(f"{most:.2f} px"))
        painter.drawText(QPointF(0, bottom), "0")
        painter.drawLine(QPointF(left, bottom), QPointF(self.width() - right, bottom))
        for one in sorted(drifts, key=lambda one: float(one.drift_px.max())):
            worst = one is max(drifts, key=lambda one: float(one.drift_px.max()))
            painter.setPen(QPen(QColor(theme.now().caution if worst else theme.now().accent), 2.5 if worst else 1.2))
            x = np.linspace(left, self.width() - right, len(one.drift_px))
            places = [QPointF(a, bottom - (bottom - top) * b / most) for a, b in zip(x, one.drift_px, strict=True)]
            painter.drawPolyline(places)
            if worst:
                painter.drawText(places[-1] + QPointF(4, 4), one.camera)


class FindingsList(QScrollArea):
    """All findings, errors first; `asked` (kind, target) when a button is pressed, `taken_back` for a repair."""

    asked = Signal(str, str)
    taken_back = Signal(str, str)

    def __init__(self) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        self._inner = QWidget()
        self._column = QVBoxLayout(self._inner)
        self._column.setSpacing(theme.SMALL)
        self.setWidget(self._inner)
        self.shown: list[FindingAdvice] = []
        self.repairs: tuple[tuple[str, str], ...] = ()
        self._worn: tuple[theme.Colours, float] | None = None

    def show_advice(self, advice: list[FindingAdvice], repairs: tuple[tuple[str, str], ...] = ()) -> None:
        """Show these findings, and the repairs that were asked for."""
        look = theme.now(), theme.pt(1.0)  # marks are pictures in the colours and the size of the look
        if (advice, repairs, look) == (self.shown, self.repairs, self._worn) and self._column.count():
            return
        self.shown, self.repairs, self._worn = advice, repairs, look
        clear(self._column)
        for option, value in repairs:
            self._column.addWidget(self._repair(option, value))
        if not repairs and all(one.level == "none" for one in advice):
            self._column.addWidget(label(self.tr("Nothing to complain about."), "big", level="good"))
        for one in advice:
            self._column.addWidget(self._row(one))
        self._column.addStretch(1)

    def _row(self, one: FindingAdvice) -> QWidget:
        box = QWidget()
        mark = label("", "", wrap=False)
        tint = theme.now().soft if one.level == "none" else None
        mark.setPixmap(level_pixmap(one.level, theme.pt(20), tint))
        words, folded = spaced(QVBoxLayout(), 2), QWidget()
        more = bare(QVBoxLayout(folded), 2)
        named = self.tr("{title}: {where}").format(title=one.title, where=one.where) if one.where else one.title
        first = add(QHBoxLayout(), (label(named, "big" if one.level != "none" else "", level=one.level), 1))
        words.addLayout(first)
        todo = more if one.level == "none" else words  # what asks for nothing stays one line
        if one.hint:
            todo.addWidget(label(one.hint))
        if one.actions:
            todo.addLayout(add(QHBoxLayout(), *map(self._button, one.actions), None))
        if one.message:
            more.addWidget(label(one.message, "soft"))
        if more.count():
            add(first, (details_button(folded), Qt.AlignmentFlag.AlignTop))
        words.addWidget(folded)
        add(bare(QHBoxLayout(box)), (mark, Qt.AlignmentFlag.AlignTop), theme.SMALL, (words, 1))
        return box

    def _button(self, action: Action) -> QWidget:
        done = (action.kind, action.target) in self.repairs
        do = button(action.text, f"finding-{action.kind.lstrip('-')}")
        do.clicked.connect(lambda: self.asked.emit(action.kind, action.target))
        do.setEnabled(not done)
        do.setToolTip(self.tr("It is already requested: calibrate again.") if done else "")
        return do

    def _repair(self, option: str, value: str) -> QWidget:
        box = QWidget()
        message = self.tr("Asked for: {repair}").format(repair=repair_text(option, value))
        back = button(self.tr("Take back"), "take-back", act=lambda: self.taken_back.emit(option, value))
        add(bare(QHBoxLayout(box)), (label(message, "big", level="caution"), 1), back)
        return box
