"""ball.json, a ball profile: the shape of one ball as a calibration found it, for later ones (decision 0013)."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import BallProfile, BallShape, RigScale
from spherecal_files import codec
from spherecal_files.json_file import JsonValue, unique

BALL_FILE = "ball.json"
# A shape of fewer dots cannot be laid over a placement's (rigid.LEAST_SHARED).
LEAST_DOTS = 12
# A dot known to better than this, in mm, is a misprint; calibrations give 0.005 and more.
_LEAST_SD_MM = 1e-5


@dataclass(frozen=True)
class _Dot:
    """A dot of the ball with its place and covariance."""

    target: int
    point: str
    xyz_mm: FloatArray
    covariance_mm2: FloatArray


def _symmetric(upper: tuple[float, ...]) -> FloatArray:
    found = np.zeros((3, 3))
    found[np.triu_indices(3)] = upper
    return found + np.triu(found, 1).T


def _check_covariance(found: FloatArray, value: JsonValue) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        least = float(np.linalg.eigvalsh(found)[0]) if np.isfinite(found).all() else -1.0
    if not least >= _LEAST_SD_MM**2:
        raise value.error(Phrase("problem-dot-covariance", {"least": _LEAST_SD_MM}))


def _check_dots(dots: tuple[_Dot, ...], value: JsonValue) -> None:
    targets = [one.fields(["target"])["target"] for one in value.items()]
    unique(targets, [f"target {dot.target} point {dot.point}" for dot in dots], "dot")
    places = np.array([dot.xyz_mm for dot in dots])
    if np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-3) < 2:
        raise value.error(Phrase("problem-no-ball"))


def _dots(shape: BallShape) -> list[_Dot]:
    columns = (shape.target, shape.point, shape.places_mm, shape.covariance_mm2)
    return [_Dot(*row) for row in zip(*columns, strict=True)]


def _profile(shape: tuple[_Dot, ...], scale: RigScale, **about: Any) -> BallProfile:
    places, covariance = (np.array([getattr(dot, key) for dot in shape]) for key in ("xyz_mm", "covariance_mm2"))
    target = np.array([dot.target for dot in shape], dtype=np.int64)
    return BallProfile(BallShape(target, tuple(dot.point for dot in shape), places, covariance, scale), **about)


_DOT = codec.record(
    "",
    _Dot,
    codec.field("target", codec.integer("The target.")),
    codec.field("point", codec.name("The dot.")),
    codec.field("xyz_mm", codec.numbers("Its position.", 3).mapped(np.array)),
    codec.field(
        "covariance_mm2",
        codec.numbers("xx, xy, xz, yy, yz, zz.", 6)
        .mapped(_symmetric, lambda found: found[np.triu_indices(3)])
        .checked(_check_covariance),
    ),
)
_DOTS = codec.items("The dots in the ball's own frame.", _DOT, least=LEAST_DOTS).checked(_check_dots)
BALL = codec.FileFormat(
    "spherecal/ball",
    BALL_FILE,
    "The shape of one ball as a calibration found it, for later ones.",
    codec.record(
        "",
        _profile,
        codec.optional("name", codec.text("The name of the ball.")),
        codec.optional("calibrated", codec.date("When it was calibrated.")),
        codec.group(
            "targets",
            "Its targets.",
            codec.field("family", codec.name("Their family.")),
            codec.field("size_mm", codec.positive("Side of a sticker.", "mm"), "target_size_mm"),
            is_needed=False,
        ),
        codec.field(
            "scale",
            codec.record(
                "Where its scale comes from.",
                RigScale,
                codec.field("source", codec.choice("The source.", ("target_spacing", "bar", "board", "ball"))),
                codec.field("relative_uncertainty", codec.number("Relative standard uncertainty.", 0, 1)),
            ),
            "shape.scale",
        ),
        codec.optional("input_sha256", codec.text("`input_sha256` of the calibration.")),
        codec.software(),
        codec.field("dots", replace(_DOTS, entry=lambda shape: [_DOT.entry(dot) for dot in _dots(shape)]), "shape"),
    ),
    ("No dot occurs twice.", "The dots are not all on one line.", "A covariance is positive definite."),
    lines="dots",
    more="profiles.md#ball-profiles",
)


def read_ball(path: Path) -> BallProfile:
    """The profile in a file, or in a result folder."""
    return BALL.read(path / BALL_FILE if path.is_dir() else path)
