"""body.json: a rigid body by named points in a frame of its own; read strictly, written whole."""

from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal.files.json_file import JsonValue, json_bytes, read_json, unique
from spherecal.measuring.task import CENTRE, Body, BodyPoint, PointName

FORMAT = "spherecal/body"
VERSION = 1
LEAST_POINTS = 3
_MOST_POINTS = 1000
_MOST_MM = 1e6
# Points nearer to one line than this leave the turn about it undefined: at 1 mm beside 100 mm, 0.01 mm of a point is
# 0.6 degrees.
_LEAST_WIDTH_MM = 1.0


def read_body(path: Path) -> Body:
    """The body in a file; InputError names the place that is not as docs/formats.md says."""
    f = read_json(path, FORMAT, VERSION).fields(("name", "points"))
    values = f["points"].items(least=LEAST_POINTS, most=_MOST_POINTS)
    points = [_read_point(value) for value in values]
    unique(values, [str(point.name) for point in points], "point")
    body = Body(f["name"].id(), tuple(points))
    check_body(body, str(path))
    return body


def check_body(body: Body, where: str) -> None:
    """InputError where a body's points do not define its pose."""
    if len(body.points) < LEAST_POINTS:
        raise InputError(
            Phrase("error-body-points", {"where": where, "least": LEAST_POINTS, "found": len(body.points)})
        )
    places = body.places_mm
    width = line_width(places)
    if width < _LEAST_WIDTH_MM:
        raise InputError(Phrase("error-body-line", {"where": where, "body": body.name, "width": width}))


def line_width(places: np.ndarray) -> float:
    """How far (rms, mm) points (n, 3) lie from their best line."""
    spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return float(np.hypot(spread[1], spread[2] if len(spread) > 2 else 0.0) / np.sqrt(len(places)))


def _read_point(value: JsonValue) -> BodyPoint:
    f = value.fields(("target", "xyz_mm"), ("point", "sigma_mm"))
    x, y, z = (item.number(-_MOST_MM, _MOST_MM, "mm") for item in f["xyz_mm"].items(3))
    name = PointName(f["target"].integer(0, 2**31), f["point"].name() if "point" in f else CENTRE)
    return BodyPoint(name, (x, y, z), f["sigma_mm"].number(0, _MOST_MM, "mm") if "sigma_mm" in f else 0.0)


def write_body(body: Body, path: Path) -> None:
    """Write body.json, whole or not at all; InputError for a body that could not be read again."""
    check_body(body, str(path))
    points = [
        {"target": p.name.target, "point": p.name.point, "xyz_mm": list(p.place_mm), "sigma_mm": p.sigma_mm}
        for p in body.points
    ]
    write_file_whole(path, json_bytes({"format": FORMAT, "version": VERSION, "name": body.name, "points": points}))
