"""A check as it was made on another day: check.json of its project, for the page that shows it."""

import math
from functools import partial
from pathlib import Path

import numpy as np

from spherecal.base.errors import SpherecalError
from spherecal_files.codec import boolean, choice, field, items, number, optional, record, text
from spherecal_files.findings_file import FINDING
from spherecal_files.json_file import read_json
from spherecal_rigs.check_rig import FORMAT, VERSION, BallCheck, Check, CheckedCamera, Verdict
from spherecal_verify.consistency import CameraTest

FILE = "check.json"
_FIGURES = ("move_px", "point_mm", "rms_px", "shift_mm", "turn_deg")


def _camera(
    id: str, verdict: Verdict, moved: bool, calibrated_rms_px: float | None = None, **figures: float
) -> CheckedCamera:
    """A camera with its figures, of shift and turn only their size; not a number where the file has none."""
    known = dict.fromkeys(_FIGURES, math.nan) | figures
    shift, turn = np.array([known.pop("shift_mm")]), np.radians([known.pop("turn_deg")])
    test = CameraTest(id=id, points=0, p=math.nan, moved=moved, shift_mm=shift, turn_rad=turn, **known)
    return CheckedCamera(test, verdict, calibrated_rms_px)


def _ball(scale_ppm: float = math.nan, scale_sd_ppm: float = math.nan) -> BallCheck:
    return BallCheck("", 0, scale_ppm, scale_sd_ppm, math.nan, 0)


_VERDICT = field("verdict", choice("", ("ok", "watch", "recalibrate")))
_CAMERA = record(
    "",
    _camera,
    field("id", text("")),
    _VERDICT,
    field("moved", boolean("")),
    *(optional(key, number("")) for key in (*_FIGURES, "calibrated_rms_px")),
)
_BALL = record("", _ball, *(optional(key, number("")) for key in ("scale_ppm", "scale_sd_ppm")))
_CHECK = record(
    "",
    partial(Check, lengths=()),
    _VERDICT,
    optional("tolerance_mm", number("")),
    field("cameras", items("", _CAMERA)),
    field("untested", items("", text(""))),
    field("balls", items("", _BALL)),
    field("findings", items("", FINDING)),
)


def read_kept_check(folder: Path) -> Check | None:
    """The check of a project; None where there is none that can be read."""
    try:
        return _CHECK.read(read_json(folder / FILE, FORMAT, VERSION, below=folder))
    except SpherecalError:
        return None
