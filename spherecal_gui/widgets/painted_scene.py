"""The rig painted by Qt alone, where pyvista (275 MB) is lacking or its first picture is not there yet; some 15 ms."""

import numpy as np
from numpy.typing import ArrayLike
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QBrush, QColor, QImage, QPainter, QPen, QPolygonF, QRadialGradient

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal_documents.scene.eye import Eye
from spherecal_documents.scene.model import SceneData
from spherecal_documents.scene.shapes import (
    ByteArray,
    SceneStyle,
    blended,
    body_of,
    map_step,
    scene_lines,
    shrunk,
    solid_balls,
)
from spherecal_gui import theme
from spherecal_gui.widgets.scene_overlay import draw_image

_SHADES = 16  # colours of points are drawn in groups, which is what takes time
_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))  # of a box
_IMAGE_PX = 160
_BEHIND = 0.03  # of the radius: a dot as far behind its ball's outline is hidden


class PaintedRig:
    """A scene that is painted as often as it is turned; what every picture needs is worked out once."""

    def __init__(self, data: SceneData, style: SceneStyle) -> None:
        self._data, self._style, self._lines = data, style, scene_lines(data, style)
        self._small: dict[str, ByteArray] = {}  # images by camera

    def paint(self, painter: QPainter, eye: Eye) -> None:
        """Back to front as far as that matters: floor, balls with their dots, cameras, lines."""
        data, layers, (floor, *lines) = self._data, self._style.layers, self._lines
        _draw_lines(painter, eye, floor.ends, floor.colours, floor.width)
        balls = [one for one in data.scene.placements if one.ball_centre is not None]
        balls = balls if solid_balls(data, layers) else []
        for one in sorted(balls, key=lambda one: float(one.ball_centre @ eye.towards)):
            _draw_ball(painter, eye, one.ball_centre, one.ball_radius)
        if "map" in layers and len(data.map_mm):
            size = max(0.6 * map_step(data.map_places) * eye.scale, 4.0)
            order = np.argsort(data.map_places @ eye.towards)
            tints = np.array(data.map_tints(theme.now().dark))[order]
            _draw_points(painter, eye.flat(data.map_places[order]), tints, size, in_order=True)
        elif "dots" in layers and len(data.points):
            there = _in_front(data, eye)
            tints = np.array(data.tints(theme.now().dark)).reshape(-1, 3)[there]
            size = float(np.clip(2 * data.dot_radius * eye.scale, 2.0, 12.0))
            _draw_points(painter, eye.flat(data.points[there]), tints, size)
        if "ellipsoids" in layers:
            _draw_ellipsoids(painter, eye, data)
        _draw_bars(painter, eye, data)
        for one in lines:
            _draw_lines(painter, eye, one.ends, one.colours, one.width)
        self._draw_cameras(painter, eye)

    def _draw_cameras(self, painter: QPainter, eye: Eye) -> None:
        c, data, style = theme.now(), self._data, self._style
        moved = {one.id for one in data.moved}
        for camera in sorted(data.scene.cameras, key=lambda one: float(one.centre @ eye.towards)):
            if "images" in style.layers and camera.id in data.images:
                if camera.id not in self._small:
                    self._small[camera.id] = shrunk(data.images[camera.id], _IMAGE_PX)
                _draw_image(painter, eye.flat(camera.corners), self._small[camera.id])
            tint = theme.rgb(c.bad if camera.id in moved else c.accent if camera.id == style.marked else c.idle)
            corners, _, size, _ = body_of(camera)
            flat, depth = eye.flat(corners), corners @ eye.towards
            painter.setPen(QPen(QColor(c.scene), 1))
            for face in sorted(_FACES, key=lambda face: float(depth[list(face)].mean()))[3:]:
                painter.setBrush(QColor(*blended(tint, (0, 0, 0), 0.12 * (face[0] % 3))))
                painter.drawPolygon(QPolygonF([QPointF(x, y) for x, y in flat[list(face)].tolist()]))
            front = eye.flat((corners[1::2].mean(axis=0))[None])[0].tolist()
            end = eye.flat(camera.centre[None])[0].tolist()
            lens_px = max(0.7 * size * eye.scale, 2.0)
            painter.setPen(QPen(QColor(c.idle), lens_px, Qt.PenStyle.SolidLine, Qt.PenCapStyle.FlatCap))
            painter.drawLine(QLineF(*front, *end))
            painter.setBrush(Qt.BrushStyle.NoBrush)


def _draw_ball(painter: QPainter, eye: Eye, centre: FloatArray, radius: float) -> None:
    c = theme.now()
    x, y = eye.flat(centre[None])[0].tolist()
    r = radius * eye.scale
    shade = QRadialGradient(QPointF(x - 0.35 * r, y - 0.4 * r), 1.5 * r)
    light, dark = ("#55626f", "#20272e") if c.dark else ("#eef1f4", "#a9b3bd")
    shade.setColorAt(0, QColor(light))
    shade.setColorAt(1, QColor(dark))
    painter.setPen(QPen(QColor(c.border), 1))
    painter.setBrush(QBrush(shade))
    painter.drawEllipse(QRectF(x - r, y - r, 2 * r, 2 * r))
    painter.setBrush(Qt.BrushStyle.NoBrush)


def _draw_ellipsoids(painter: QPainter, eye: Eye, data: SceneData) -> None:
    """Outlines: the shadow of an ellipsoid is the ellipse whose covariance is the projected one."""
    if not len(data.ellipsoids):
        return
    painter.setPen(QPen(QColor(theme.now().caution), 1.2))
    flat = np.stack([eye.right, -eye.up])
    halves = data.ellipsoid_factor * eye.scale * data.ellipsoids @ flat.T
    values, vectors = np.linalg.eigh(np.einsum("nij,nik->njk", halves, halves))
    radii = np.sqrt(np.maximum(values, 0.25))
    turns = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    for (x, y), (minor, major), turn in zip(
        eye.flat(data.ellipsoid_places).tolist(), radii.tolist(), turns.tolist(), strict=True
    ):
        painter.save()
        painter.translate(x, y)
        painter.rotate(turn)
        painter.drawEllipse(QPointF(0, 0), major, minor)
        painter.restore()


def _draw_bars(painter: QPainter, eye: Eye, data: SceneData) -> None:
    c = theme.now()
    for bar in data.bars:
        tint = QColor(c.accent if bar.level == "none" else c.of(bar.level))
        (ax, ay), (bx, by) = eye.flat(np.vstack([bar.start, bar.end])).tolist()
        painter.setPen(QPen(tint, 4, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
        painter.drawLine(QLineF(ax, ay, bx, by))
        painter.setBrush(tint)
        for x, y in ((ax, ay), (bx, by)):
            painter.drawEllipse(QPointF(x, y), 4, 4)
        painter.setBrush(Qt.BrushStyle.NoBrush)


def _draw_lines(painter: QPainter, eye: Eye, ends: FloatArray, colours: ArrayLike, width: float) -> None:
    flat = eye.flat(ends.reshape(-1, 3)).reshape(-1, 4)
    for colour, own in _by_colour(colours, flat):
        painter.setPen(QPen(QColor(*colour), width))
        painter.drawLines([QLineF(*line) for line in own.tolist()])


def _draw_points(painter: QPainter, flat: FloatArray, tints: IntArray, size: float, in_order: bool = False) -> None:
    colours = tints // _SHADES * _SHADES + _SHADES // 2
    if in_order:
        for (x, y), colour in zip(flat.tolist(), colours.tolist(), strict=True):
            painter.setPen(QPen(QColor(*colour), size, Qt.PenStyle.SolidLine, Qt.PenCapStyle.SquareCap))
            painter.drawPoint(QPointF(x, y))
        return
    for colour, own in _by_colour(colours, flat):
        painter.setPen(QPen(QColor(*colour), size, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
        painter.drawPoints(QPolygonF([QPointF(x, y) for x, y in own.tolist()]))


def _by_colour(colours: ArrayLike, rows: FloatArray) -> list[tuple[tuple[int, int, int], FloatArray]]:
    key = np.asarray(colours, dtype=np.int64) @ np.array([65536, 256, 1])
    return [((one >> 16, one >> 8 & 255, one & 255), rows[key == one]) for one in np.unique(key).tolist()]


def _in_front(data: SceneData, eye: Eye) -> BoolArray:
    """Which dots no ball hides (n,)."""
    there = np.ones(len(data.points), dtype=bool)
    for one in data.scene.placements:
        if one.ball_centre is None:
            continue
        way = data.points - one.ball_centre
        depth = way @ eye.towards
        across = (way**2).sum(axis=1) - depth**2
        inside = one.ball_radius**2 - across
        there &= ~((inside > 0) & (depth < np.sqrt(np.maximum(inside, 0)) - _BEHIND * one.ball_radius))
    return there


def _draw_image(painter: QPainter, corners: FloatArray, image: ByteArray) -> None:
    h, w = image.shape
    drawn = QImage(np.ascontiguousarray(image).data, w, h, w, QImage.Format.Format_Grayscale8)
    draw_image(painter, QPolygonF([QPointF(x, y) for x, y in corners.tolist()]), drawn)
