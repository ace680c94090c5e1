"""A check as it was made on another day: check.json of its project, for the page that shows it."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import SpherecalError
from spherecal.data.findings import Finding
from spherecal_files.codec import boolean, choice, field, items, number, optional, record, text
from spherecal_files.findings_file import FINDING
from spherecal_files.json_file import read_json
from spherecal_rigs.check_file import FORMAT, VERSION

FILE = "check.json"


@dataclass(frozen=True)
class _Test:
    """A camera's figures; of shift and turn only their size is kept."""

    id: str
    moved: bool
    move_px: float
    point_mm: float
    rms_px: float
    shift_mm: FloatArray
    turn_rad: FloatArray


@dataclass(frozen=True)
class _Camera:
    test: _Test
    verdict: str
    before_px: float | None


@dataclass(frozen=True)
class _Ball:
    scale_ppm: float = math.nan
    scale_sd_ppm: float = math.nan


@dataclass(frozen=True)
class CheckSummary:
    """What the page needs of a check (spherecal_rigs.check_rig.Check)."""

    verdict: str
    tolerance_mm: float | None
    cameras: tuple[_Camera, ...]
    untested: tuple[str, ...]
    balls: tuple[_Ball, ...]
    findings: tuple[Finding, ...]

    @property
    def to_repair(self) -> tuple[str, ...]:
        """The cameras that moved."""
        return tuple(camera.test.id for camera in self.cameras if camera.test.moved)


def _camera(id: str, verdict: str, moved: bool, calibrated_rms_px: float | None = None, **figures: float) -> _Camera:
    known = dict.fromkeys(_FIGURES, math.nan) | figures  # not a number where there is none
    shift, turn = np.array([known.pop("shift_mm")]), np.radians([known.pop("turn_deg")])
    return _Camera(_Test(id, moved, **known, shift_mm=shift, turn_rad=turn), verdict, calibrated_rms_px)


_FIGURES = ("move_px", "point_mm", "rms_px", "shift_mm", "turn_deg")
_VERDICT = field("verdict", choice("", ("ok", "watch", "recalibrate")))
_CAMERA = record(
    "",
    _camera,
    field("id", text("")),
    _VERDICT,
    field("moved", boolean("")),
    *(optional(key, number("")) for key in (*_FIGURES, "calibrated_rms_px")),
)
_BALL = record("", _Ball, *(optional(key, number("")) for key in ("scale_ppm", "scale_sd_ppm")))
_CHECK = record(
    "",
    CheckSummary,
    _VERDICT,
    optional("tolerance_mm", number("")),
    field("cameras", items("", _CAMERA)),
    field("untested", items("", text(""))),
    field("balls", items("", _BALL)),
    field("findings", items("", FINDING)),
)


def read_kept_check(folder: Path) -> CheckSummary | None:
    """The check of a project; None where there is none that can be read."""
    try:
        return _CHECK.read(read_json(folder / FILE, FORMAT, VERSION, below=folder))
    except SpherecalError:
        return None
