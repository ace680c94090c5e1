"""A small map of each lens's field, and each camera's drift over the placements as a line."""

import numpy as np
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QColor, QPainter, QPen
from PySide6.QtWidgets import QVBoxLayout, QWidget

from spherecal_gui import languages, theme
from spherecal_gui.presenters.results_presenter import drift_text, field_text
from spherecal_gui.tasks.outcome import CameraEffect
from spherecal_gui.widgets.basic import Canvas, add, label

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


class _Picture(Canvas):
    """Something painted of all cameras."""

    effects: tuple[CameraEffect, ...] = ()


class _Maps(_Picture):
    """The darker the accent, the farther the lens is from its model there; one scale for all."""

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


class _Lines(_Picture):
    """One line for each camera, its name at the end; px over the placements."""

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
