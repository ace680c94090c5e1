"""A check as it was made on another day: check.json of its project, for the page that shows it."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import SpherecalError
from spherecal.data.findings import Finding, as_written
from spherecal_files.json_file import JsonValue, read_json
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
    scale_ppm: float
    scale_sd_ppm: float


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


def read_kept_check(folder: Path) -> CheckSummary | None:
    """The check of a project; None where there is none that can be read."""
    try:
        f = read_json(folder / FILE, FORMAT, VERSION, below=folder).fields(
            ("verdict", "cameras", "untested", "balls", "findings"), ("tolerance_mm",)
        )
        return CheckSummary(
            f["verdict"].choice("ok", "watch", "recalibrate"),
            _optional(f, "tolerance_mm"),
            tuple(_camera(one) for one in f["cameras"].items()),
            tuple(one.text() for one in f["untested"].items()),
            tuple(_ball(one) for one in f["balls"].items()),
            tuple(_finding(one) for one in f["findings"].items()),
        )
    except SpherecalError:
        return None


def _camera(entry: JsonValue) -> _Camera:
    f = entry.fields(
        ("id", "verdict", "moved"), ("move_px", "point_mm", "rms_px", "shift_mm", "turn_deg", "calibrated_rms_px")
    )
    figures = _number(f, "move_px"), _number(f, "point_mm"), _number(f, "rms_px")
    sizes = np.array([_number(f, "shift_mm")]), np.radians([_number(f, "turn_deg")])
    test = _Test(f["id"].text(), f["moved"].boolean(), *figures, *sizes)
    return _Camera(test, f["verdict"].choice("ok", "watch", "recalibrate"), _optional(f, "calibrated_rms_px"))


def _ball(entry: JsonValue) -> _Ball:
    f = entry.fields((), ("scale_ppm", "scale_sd_ppm"))
    return _Ball(_number(f, "scale_ppm"), _number(f, "scale_sd_ppm"))


def _finding(entry: JsonValue) -> Finding:
    f = entry.fields(("severity", "code"), ("message", "hint", "where"))
    said = [f[key].prose() if key in f else "" for key in ("message", "hint")]
    where = tuple(one.prose() for one in f["where"].items()) if "where" in f else ()
    return as_written(f["severity"].choice("error", "warning", "info"), f["code"].prose(), said[0], said[1], where)


def _number(f: dict[str, JsonValue], key: str) -> float:
    """A figure; not a number where it was none."""
    found = _optional(f, key)
    return math.nan if found is None else found


def _optional(f: dict[str, JsonValue], key: str) -> float | None:
    return f[key].number() if key in f else None
