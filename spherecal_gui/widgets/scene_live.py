"""What changes in a scene while it is looked at, painted over it: images, the state of cameras, the ball, the bar."""

import itertools

import numpy as np
from PySide6.QtCore import QLineF, QPointF, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPen, QPolygonF, QTransform

from spherecal.base.arrays import FloatArray
from spherecal_documents.scene.eye import Eye
from spherecal_documents.scene.model import SceneData
from spherecal_gui import theme
from spherecal_gui.rig_scenes import LiveParts
from spherecal_gui.widgets.basic import ink

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
