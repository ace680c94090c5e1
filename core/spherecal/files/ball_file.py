"""ball.json, a ball profile: the shape of one ball as a calibration found it, to be used in later ones."""

import datetime
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import BallShape, RigScale
from spherecal.files.json_file import JsonValue, read_json, software_entry, unique

FORMAT = "spherecal/ball"
VERSION = 1
BALL_FILE = "ball.json"
# A shape of fewer dots cannot be laid over a placement's (rigid.LEAST_SHARED).
LEAST_DOTS = 12
# A dot known to better than this, in mm, is a misprint; calibrations give 0.005 and more.
_LEAST_SD_MM = 1e-5


@dataclass(frozen=True, eq=False, repr=False)
class BallProfile(ByValue):
    """A ball's shape with its name, the day it was calibrated, its targets' family and size, and where it came from."""

    shape: BallShape
    name: str = ""
    calibrated: datetime.date | None = None
    family: str | None = None
    target_size_mm: float | None = None
    input_sha256: str = ""


def ball_bytes(profile: BallProfile) -> bytes:
    """The contents of ball.json, one dot a line; the same profile gives the same bytes and is read back unchanged."""
    shape = profile.shape
    head = {
        "format": FORMAT,
        "version": VERSION,
        "name": profile.name,
        "calibrated": None if profile.calibrated is None else profile.calibrated.isoformat(),
        "targets": None if profile.family is None else {"family": profile.family, "size_mm": profile.target_size_mm},
        "scale": {"source": shape.scale.source, "relative_uncertainty": shape.scale.relative_uncertainty},
        "input_sha256": profile.input_sha256,
        "software": software_entry(None),
    }
    upper = np.triu_indices(3)
    lines = [
        json.dumps({"target": int(t), "point": name, "xyz_mm": xyz.tolist(), "covariance_mm2": c[upper].tolist()})
        for t, name, xyz, c in zip(shape.target, shape.point, shape.places_mm, shape.covariance_mm2, strict=True)
    ]
    text = json.dumps(head, indent=1, ensure_ascii=False)[:-2]
    return (text + ',\n "dots": [\n  ' + ",\n  ".join(lines) + "\n ]\n}\n").encode()


def read_ball(path: Path) -> BallProfile:
    """The profile in a file (or in a result folder); InputError where it is not one."""
    if path.is_dir():
        path = path / BALL_FILE
    f = read_json(path, FORMAT, VERSION).fields(
        ("scale", "dots"), ("name", "calibrated", "targets", "input_sha256", "software")
    )
    scale = f["scale"].fields(("source", "relative_uncertainty"))
    source = scale["source"].choice("target_spacing", "bar", "board", "ball")
    relative = scale["relative_uncertainty"].number(0, 1)
    dots = [dot.fields(("target", "point", "xyz_mm", "covariance_mm2")) for dot in f["dots"].items(least=LEAST_DOTS)]
    target = [dot["target"].integer() for dot in dots]
    point = tuple(dot["point"].name() for dot in dots)
    names = [f"target {t} point {name}" for t, name in zip(target, point, strict=True)]
    unique([dot["target"] for dot in dots], names, "dot")
    places = np.array([dot["xyz_mm"].numbers(3) for dot in dots])
    covariance = np.array([_covariance(dot["covariance_mm2"]) for dot in dots])
    if np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-3) < 2:
        raise f["dots"].error(Phrase("problem-no-ball"))
    family, size = None, None
    if "targets" in f:
        of = f["targets"].fields(("family", "size_mm"))
        family, size = of["family"].name(), of["size_mm"].positive("mm")
    return BallProfile(
        BallShape(np.array(target, dtype=np.int64), point, places, covariance, RigScale(source, relative)),
        f["name"].text() if "name" in f else "",
        _date(f["calibrated"]) if "calibrated" in f else None,
        family,
        size,
        f["input_sha256"].text() if "input_sha256" in f else "",
    )


def _covariance(value: JsonValue) -> FloatArray:
    matrix = np.zeros((3, 3))
    matrix[np.triu_indices(3)] = value.numbers(6)
    matrix = matrix + np.triu(matrix, 1).T
    with np.errstate(over="ignore", invalid="ignore"):
        least = float(np.linalg.eigvalsh(matrix)[0]) if np.isfinite(matrix).all() else -1.0
    if not least >= _LEAST_SD_MM**2:
        raise value.error(Phrase("problem-dot-covariance", {"least": _LEAST_SD_MM}))
    return matrix


def _date(value: JsonValue) -> datetime.date:
    try:
        return datetime.date.fromisoformat(value.text())
    except ValueError:
        raise value.error(Phrase("problem-date")) from None


def check_targets(profile: BallProfile, family: str | None, size_mm: float | None, where: Path) -> None:
    """InputError where a profile's targets are of another kind than the session's (None: not known)."""
    if None in (family, size_mm, profile.family, profile.target_size_mm):
        return
    if family != profile.family or not np.isclose(size_mm or 0.0, profile.target_size_mm or 0.0, rtol=1e-6):
        raise InputError(
            Phrase(
                "error-other-targets",
                {
                    "where": where,
                    "family": profile.family,
                    "size": profile.target_size_mm,
                    "other": family,
                    "other_size": size_mm,
                },
            )
        )
