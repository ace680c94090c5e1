"""What is painted over every scene: names, scale, legend, the cube of views; live images, the ball and the bar."""

import itertools
from collections.abc import Collection, Sequence

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, QSizeF, Qt
from PySide6.QtGui import QColor, QImage, QLinearGradient, QPainter, QPen, QPolygonF, QTransform
from PySide6.QtWidgets import QWidget

from spherecal.base.arrays import FloatArray
from spherecal_documents.scene.eye import Eye
from spherecal_documents.scene.model import AXIS_TINTS, SceneData, ramp
from spherecal_gui import languages, theme
from spherecal_gui.languages import translate, word
from spherecal_gui.rig_scenes import LiveParts, SceneItem
from spherecal_gui.widgets.basic import ink

_CUBE_PX = 30.0  # half of its side
_CORNER = 2.05  # of its middle from the corner of the view, in half sides
_BAR_PX = (120.0, 8.0)
_EDGE_PX = 12.0
# side, outward normal, the face's own right and up
_FACES = (
    ("top", (0, 0, 1), (1, 0, 0), (0, 1, 0)), ("bottom", (0, 0, -1), (1, 0, 0), (0, -1, 0)),
    ("front", (0, -1, 0), (1, 0, 0), (0, 0, 1)), ("back", (0, 1, 0), (-1, 0, 0), (0, 0, 1)),
    ("side", (1, 0, 0), (0, 1, 0), (0, 0, 1)), ("left", (-1, 0, 0), (0, -1, 0), (0, 0, 1)),
)  # fmt: skip


class Overlay:
    """Paints onto one view."""

    def __init__(self, view: QWidget) -> None:
        self._view = view

    def paint(
        self,
        painter: QPainter,
        data: SceneData,
        eye: Eye,
        layers: frozenset[str],
        marked: str | None,
        hovered: SceneItem | None,
    ) -> None:
        """Everything, over the picture of the rig. `marked` None: none does; `hovered` None: nothing."""
        self._names(painter, data, eye, marked)
        self._scale(painter, data, eye)
        self._legend(painter, data, layers)
        self._cube(painter, eye)
        if hovered is not None:
            self._figures(painter, hovered, eye)

    # --- names -------------------------------------------------------------------------------------------------------

    def _names(self, painter: QPainter, data: SceneData, eye: Eye, marked: str | None) -> None:
        c = theme.now()
        names, places, kinds = _named(data)
        painter.setFont(theme.font(theme.BODY, bold=True))
        metrics = painter.fontMetrics()
        at = [QPointF(x, y) for x, y in eye.flat(np.array(places)).tolist()] if places else []
        sizes = [QSizeF(metrics.horizontalAdvance(name) + 2, metrics.height()) for name in names]
        taken = [self._cube_box()]
        first = {name for name, kind in zip(names, kinds, strict=True) if kind == "camera"}
        boxes = place_tags(names, at, sizes, QRectF(self._view.rect()), 22.0, first, taken)
        for name, kind in zip(names, kinds, strict=True):
            if (box := boxes.get(name)) is None:
                continue
            tint = c.accent if name == marked else c.soft if kind == "ball" else c.text
            _outlined(painter, box, name, QColor(tint))
        axes = data.reference_axes if len(data.reference_axes) == len(AXIS_TINTS) else ()
        for ((_, tip), tint), letter in zip(axes, "XYZ", strict=False):
            x, y = eye.flat(np.asarray(tip)[None])[0].tolist()
            _outlined(painter, QRectF(x - 12, y - 12, 24, 24), letter, QColor(tint))

    def _scale(self, painter: QPainter, data: SceneData, eye: Eye) -> None:
        """How long a side of the floor's grid is."""
        step = data.floor.step
        text = f"{step / 1000:g} m" if step >= 1000 else f"{step:.0f} mm"
        length = min(step * eye.scale, 0.4 * self._view.width())
        if length < step * eye.scale:
            text = f"{length / eye.scale:.0f} mm"
        low, left = self._view.height() - _EDGE_PX, _EDGE_PX
        painter.setPen(QPen(theme.colour("soft"), 2))
        painter.drawLine(QLineF(left, low, left + length, low))
        painter.drawLines([QLineF(x, low - 4, x, low + 1) for x in (left, left + length)])
        painter.setFont(theme.font(theme.CAPTION))
        painter.drawText(QPointF(left, low - 8), text)

    # --- legend ------------------------------------------------------------------------------------------------------

    def _legend(self, painter: QPainter, data: SceneData, layers: frozenset[str]) -> None:
        """Colour bar and what is drawn larger than it is, at the lower right."""
        lines = []
        if "ellipsoids" in layers and len(data.ellipsoids):
            text = translate("Scene", "Ellipsoids: 1 σ × {factor}")
            lines.append(text.format(factor=f"{data.ellipsoid_factor:g}"))
        if data.moved:
            text = translate("Scene", "Yellow: before, way × {factor}")
            lines.append(text.format(factor=f"{data.shift_factor:g}"))
        if data.bars:
            lines.append(translate("Scene", "Bars: green within their uncertainty, red beyond"))
        painter.setFont(theme.font(theme.CAPTION))
        metrics = painter.fontMetrics()
        low, right = self._view.height() - _EDGE_PX, self._view.width() - _EDGE_PX
        if (title := self._bar_title(data, layers)) is not None:
            words, least, most = title
            box = QRectF(right - _BAR_PX[0], low - _BAR_PX[1], *_BAR_PX)
            fill = QLinearGradient(box.topLeft(), box.topRight())
            tints = ramp(np.linspace(0, 1, 5), theme.now().dark)
            for i, tint in enumerate(tints):
                fill.setColorAt(i / 4, QColor(*tint))
            painter.fillRect(box, fill)
            above = QRectF(box.left(), box.top() - metrics.height() - 2, box.width(), metrics.height())
            _outlined(painter, above, least, theme.colour("soft"), Qt.AlignmentFlag.AlignLeft)
            _outlined(painter, above, most, theme.colour("soft"), Qt.AlignmentFlag.AlignRight)
            low = above.top() - 2
            lines.append(words)
        for text in reversed(lines):
            low -= metrics.height()
            box = QRectF(0, low, right, metrics.height())
            _outlined(painter, box, text, theme.colour("soft"), Qt.AlignmentFlag.AlignRight)

    @staticmethod
    def _bar_title(data: SceneData, layers: frozenset[str]) -> tuple[str, str, str] | None:
        """What the colours mean, and what the bar's ends stand for."""
        if "map" in layers and len(data.map_mm):
            text = translate("Scene", "Uncertainty of {length:.0f} mm, mm (95 %)")
            low, high = data.map_range
            ends = languages.by_locale(f"{low:.3f}"), languages.by_locale(f"{high:.3f}")
            return text.format(length=data.map_length_mm), *ends
        if "dots" in layers and len(data.points) and data.most_px > 0:
            return translate("Scene", "Residuals of the dots, px"), "0", languages.by_locale(f"{data.most_px:.3f}")
        return None

    # --- the cube ----------------------------------------------------------------------------------------------------

    @property
    def _cube_px(self) -> float:
        """Half the cube's side: smaller in a small view."""
        return min(_CUBE_PX, 0.07 * min(self._view.width(), self._view.height()))

    def _cube_box(self) -> QRectF:
        side = 2 * _CORNER * self._cube_px
        return QRectF(self._view.width() - side, 0, side, side)

    def _cube(self, painter: QPainter, eye: Eye) -> None:
        c = theme.now()
        faces = sorted(self._faces(eye), key=lambda face: face[2])
        points = (
            14.0 if all(len(word("sides", face[0])) == 1 for face in faces) else 7.0
        )  # Chinese has one sign for each
        painter.setFont(theme.font(points * self._cube_px / _CUBE_PX, bold=True))
        for side, corners, depth, (right, up, middle) in faces:
            if depth <= 0.02:
                continue
            ink(painter, c.border, 1.2, theme.mixed(c.raised, c.text, 0.1 * depth))
            painter.drawPolygon(corners)
            painter.save()
            painter.setTransform(
                QTransform(right.x(), right.y(), -up.x(), -up.y(), middle.x(), middle.y()), combine=True
            )
            painter.setPen(QColor(c.text if depth > 0.5 else c.soft))
            painter.drawText(QRectF(-30, -10, 60, 20), Qt.AlignmentFlag.AlignCenter, word("sides", side))
            painter.restore()

    def _faces(self, eye: Eye) -> list[tuple[str, QPolygonF, float, tuple[QPointF, QPointF, QPointF]]]:
        """Each face's name, its corners on the view, how far it looks to us, its own axes and middle there."""
        half = self._cube_px
        middle = self._cube_box().center()
        flat = np.stack([eye.right, -eye.up])

        def at(place: FloatArray) -> QPointF:
            x, y = (flat @ place).tolist()
            return QPointF(x, y)

        found = []
        for side, normal, right, up in _FACES:
            n, r, u = (np.array(one, dtype=float) for one in (normal, right, up))
            corners = [middle + at(half * (n + a * r + b * u)) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            axes = (at(r), at(u), middle + at(half * n))
            found.append((side, QPolygonF(corners), float(n @ eye.towards), axes))
        return found

    def side_at(self, place: QPointF, eye: Eye) -> str | None:
        """The side of the cube under the mouse; None: the mouse is beside it."""
        faces = [face for face in self._faces(eye) if face[2] > 0.02]
        inside = [face for face in faces if face[1].containsPoint(place, Qt.FillRule.OddEvenFill)]
        return max(inside, key=lambda face: face[2])[0] if inside else None

    # --- figures -----------------------------------------------------------------------------------------------------

    def _figures(self, painter: QPainter, item: SceneItem, eye: Eye) -> None:
        """A card beside what is under the mouse."""
        c, lines = theme.now(), [languages.by_locale(line) for line in item.lines()]
        x, y = eye.flat(np.asarray(item.place)[None])[0].tolist()
        fonts = [theme.font(theme.BODY, bold=True), *[theme.font(theme.CAPTION)] * (len(lines) - 1)]
        sizes = []
        for font, line in zip(fonts, lines, strict=True):
            painter.setFont(font)
            sizes.append(QSizeF(painter.fontMetrics().horizontalAdvance(line), painter.fontMetrics().height()))
        width = max(size.width() for size in sizes) + 2 * theme.GAP
        height = sum(size.height() for size in sizes) + 2 * theme.SMALL
        left = min(max(x + 14, 4.0), self._view.width() - width - 4)
        top = min(max(y + 10, 4.0), self._view.height() - height - 4)
        ink(painter, c.border, 1, c.raised)
        painter.drawRoundedRect(QRectF(left, top, width, height), 6, 6)
        low = top + theme.SMALL
        for k, (font, line, size) in enumerate(zip(fonts, lines, sizes, strict=True)):
            painter.setFont(font)
            painter.setPen(QColor(c.soft if k else c.text))
            painter.drawText(QRectF(left + theme.GAP, low, size.width() + 4, size.height()), 0, line)
            low += size.height()


def _named(data: SceneData) -> tuple[list[str], list[FloatArray], list[str]]:
    """Cameras by their bodies, balls by their names, bars by theirs."""
    found: list[tuple[str, FloatArray, str]] = [(one.id, one.centre, "camera") for one in data.scene.cameras]
    for placement in data.scene.placements:
        if placement.ball_centre is not None:
            found.append((placement.name, placement.ball_centre + np.array([0, 0, placement.ball_radius]), "ball"))
    found += [
        (f"{bar.error_mm:+.3f} mm" if bar.error_mm is not None else bar.name, (bar.start + bar.end) / 2, "bar")
        for bar in data.bars
    ]
    names, places, kinds = (list(column) for column in zip(*found, strict=True)) if found else ([], [], [])
    return names, places, kinds


def _outlined(
    painter: QPainter, box: QRectF, text: str, tint: QColor, where: Qt.AlignmentFlag = Qt.AlignmentFlag.AlignCenter
) -> None:
    """Letters with an edge in the ground's colour, to be read over anything."""
    edge = QColor(theme.now().scene)
    edge.setAlpha(200)
    text = languages.by_locale(text)
    painter.setPen(edge)
    for dx, dy in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        painter.drawText(box.translated(dx, dy), where, text)
    painter.setPen(tint)
    painter.drawText(box, where, text)


_GAP_PX = 4.0


def place_tags(
    names: Sequence[str],
    places: Sequence[QPointF],
    sizes: Sequence[QSizeF],
    room: QRectF,
    mark_px: float,
    first: Collection[str] = (),
    taken: Sequence[QRectF] = (),
) -> dict[str, QRectF]:
    """The boxes of the names that have room, by name; one that would cover another name or a mark is left out."""
    marks = [QRectF(place.x() - mark_px / 2, place.y() - mark_px / 2, mark_px, mark_px) for place in places]
    used, found = list(taken), {}
    order = sorted(range(len(names)), key=lambda i: names[i] not in first)
    for i in order:
        boxes = [box for box in _beside(marks[i], sizes[i]) if room.contains(box)]
        others = [*used, *(mark for j, mark in enumerate(marks) if j != i and mark != marks[i])]
        free = next((box for box in boxes if not any(box.intersects(one) for one in others)), None)
        if free is None and names[i] in first:
            free = boxes[0] if boxes else _beside(marks[i], sizes[i])[0]
        if free is not None:
            used.append(free)
            found[names[i]] = free
    return found


def _beside(mark: QRectF, size: QSizeF) -> list[QRectF]:
    """To the right, above, to the left, below, then the corners."""
    right, left = mark.right() + _GAP_PX, mark.left() - _GAP_PX - size.width()
    above, below = mark.top() - size.height(), mark.bottom()
    middle_x, middle_y = mark.center().x() - size.width() / 2, mark.center().y() - size.height() / 2
    corners = [(x, y) for x in (right, left) for y in (above, below)]
    places = [(right, middle_y), (middle_x, above), (left, middle_y), (middle_x, below), *corners]
    return [QRectF(QPointF(x, y), size) for x, y in places]


_EDGES = tuple((i, i ^ bit) for i in range(8) for bit in (1, 2, 4) if not i & bit)  # of a box, corners by x, y, z
LYING, WANTED, THERE = "#35e0ff", "#ffb02e", "#3be37f"  # as in the images


def paint_live(painter: QPainter, data: SceneData, eye: Eye, live: LiveParts) -> None:
    """Paint it."""
    for camera in data.scene.cameras:
        corners = QPolygonF(_points(eye, camera.corners))
        if (image := live.images.get(camera.id)) is not None:
            draw_image(painter, corners, image)
        if (level := live.levels.get(camera.id, "none")) != "none":
            ink(painter, theme.now().of(level), 2.5)
            painter.drawPolygon(corners)
    if live.box is not None:
        painter.setPen(QPen(theme.colour("soft"), 1, Qt.PenStyle.DotLine))
        corners = _points(eye, live.box)
        painter.drawLines([QLineF(corners[i], corners[j]) for i, j in _EDGES])
    for ends, lying in live.bars:
        tint = QColor(THERE if live.near else LYING if lying else WANTED)
        _drop(painter, eye, data, ends)
        start, end = _points(eye, ends)
        painter.setPen(QPen(tint, 4, Qt.PenStyle.SolidLine if lying else Qt.PenStyle.DashLine))
        painter.drawLine(QLineF(start, end))
    painter.setFont(theme.font(theme.CAPTION))
    for name, place in live.points:
        (at,) = _points(eye, place[None])
        painter.setPen(QPen(QColor(LYING), 7, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
        painter.drawPoint(at)
        painter.setPen(theme.colour("text"))
        painter.drawText(at + QPointF(6, -4), name)
    if live.ball is not None:
        _drop(painter, eye, data, live.ball[0][None])
        _draw_ball(painter, eye, *live.ball, near=live.near)


def _drop(painter: QPainter, eye: Eye, data: SceneData, places: FloatArray) -> None:
    """Where places lie over the floor: without it nothing in a picture says how high they are."""
    below = places.copy()
    below[:, 2] = data.floor.z
    feet = _points(eye, below)
    painter.setPen(QPen(theme.colour("soft"), 1, Qt.PenStyle.DotLine))
    painter.drawLines([QLineF(a, b) for a, b in zip(_points(eye, places), feet, strict=True)])
    painter.drawLines([QLineF(a, b) for a, b in itertools.pairwise(feet)])
    for foot in feet:
        painter.drawEllipse(foot, 3, 2)


def _draw_ball(
    painter: QPainter, eye: Eye, centre: FloatArray, top: FloatArray, radius_mm: float, *, near: bool
) -> None:
    """The ball, thin enough for the ghost to stay in sight, with the way to its top."""
    tint = QColor(THERE if near else LYING)
    middle, pole = _points(eye, np.stack([centre, top]))
    reach = radius_mm * eye.scale
    fill = QColor(tint)
    fill.setAlpha(46)
    ink(painter, tint, 2.5, fill)
    painter.drawEllipse(middle, reach, reach)
    painter.drawLine(QLineF(middle, pole))
    painter.setBrush(tint)
    painter.drawEllipse(pole, 3, 3)
    painter.setBrush(Qt.BrushStyle.NoBrush)


def draw_image(painter: QPainter, corners: QPolygonF, image: QImage) -> None:
    """A camera's image on the end of its frustum."""
    w, h = image.width(), image.height()
    there = QTransform()
    own = QPolygonF([QPointF(0, 0), QPointF(w, 0), QPointF(w, h), QPointF(0, h)])
    if QTransform.quadToQuad(own, corners, there):
        painter.save()
        painter.setTransform(there, combine=True)
        painter.drawImage(0, 0, image)
        painter.restore()


def _points(eye: Eye, places: FloatArray) -> list[QPointF]:
    return [QPointF(x, y) for x, y in eye.flat(places).tolist()]
