"""body.json: a rigid body by named points in a frame of its own; read strictly, written whole."""

from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal.files.codec import FileFormat, field, identifier, integer, items, name, number, optional, record
from spherecal_measuring.measuring_task import CENTRE, Body, BodyPoint, PointName

LEAST_POINTS = 3
_MOST_POINTS = 1000
_MOST_MM = 1e6
# Points nearer to one line than this leave the turn about it undefined: at 1 mm beside 100 mm, 0.01 mm of a point is
# 0.6 degrees.
_LEAST_WIDTH_MM = 1.0


def _point(target: int, place_mm: tuple[float, float, float], point: str = CENTRE, sigma_mm: float = 0.0) -> BodyPoint:
    return BodyPoint(PointName(target, point), place_mm, sigma_mm)


_POINT = record(
    "",
    _point,
    field("target", integer("The target.", 0, 2**31), "name.target"),
    optional("point", name("The point of the target; `centre` where absent."), "name.point"),
    field("xyz_mm", items("Its position.", number("", -_MOST_MM, _MOST_MM, "mm"), length=3), "place_mm"),
    optional("sigma_mm", number("Standard deviation of its position; 0 where absent.", 0, _MOST_MM, "mm")),
)
BODY = FileFormat(
    "spherecal/body",
    "body.json",
    "A rigid body by named points in a frame of its own.",
    record(
        "",
        Body,
        field("name", identifier("Its name.")),
        field("points", items("Its points.", _POINT, LEAST_POINTS, _MOST_POINTS, differ="name", what="point")),
    ),
    ("No point occurs twice.", "The points are not all on one line."),
    more="measuring.md#bodies",
)


def read_body(path: Path) -> Body:
    """The body in a file."""
    body = BODY.read(path)
    check_body(body, str(path))
    return body


def check_body(body: Body, where: str) -> None:
    """Check that a body's points define its pose: three or more, and not within 1 mm (rms) of one line."""
    if len(body.points) < LEAST_POINTS:
        raise InputError(
            Phrase("error-body-points", {"where": where, "least": LEAST_POINTS, "found": len(body.points)})
        )
    places = body.places_mm
    width = line_width(places)
    if width < _LEAST_WIDTH_MM:
        raise InputError(Phrase("error-body-line", {"where": where, "body": body.name, "width": width}))


def line_width(places: np.ndarray) -> float:
    """How far (rms, mm) points (n, 3) are from their best line."""
    spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return float(np.hypot(spread[1], spread[2] if len(spread) > 2 else 0.0) / np.sqrt(len(places)))


def write_body(body: Body, path: Path) -> None:
    """Write body.json, whole or not at all."""
    check_body(body, str(path))
    write_file_whole(path, BODY.bytes(body))
