"""A check as data: check.json, and its place in the profile's history."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.messages.catalogue import phrase
from spherecal_files.findings_file import FINDING
from spherecal_files.json_file import finite, plain, plain_fields, software_entry
from spherecal_rigs.check_rig import Check, CheckedCamera
from spherecal_rigs.kept_checks import keep_check
from spherecal_rigs.store import is_profile, open_profile

FORMAT = "spherecal/check"
VERSION = 1


def check_json(found: Check) -> dict[str, object]:
    """The document; lengths in mm, turns in degrees."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "tolerance_mm": finite(found.tolerance_mm),
        "cameras": [camera_entry(one) for one in found.cameras],
        "untested": list(found.untested),
        "balls": plain(found.balls),
        "lengths": [
            {
                **plain_fields(m, "bar pose"),
                "from": m.from_mark,
                "to": m.to_mark,
                **plain_fields(m, "length_mm reference_mm error_mm"),
                "u_mm": finite(m.budget.combined_mm),
            }
            for m in found.lengths
        ],
        "findings": [FINDING.entry(finding) for finding in found.findings],
        "software": software_entry(None),
    }


def camera_entry(one: CheckedCamera) -> dict[str, object]:
    """One camera as the document has it."""
    return {
        "id": one.test.id,
        "verdict": one.verdict,
        "points": one.test.points,
        "rms_px": finite(one.test.rms_px),
        "calibrated_rms_px": finite(one.before_px),
        "moved": one.test.moved,
        "move_px": finite(one.test.move_px),
        "shift_mm": finite(np.linalg.norm(one.test.shift_mm)),
        "turn_deg": finite(np.degrees(np.linalg.norm(one.test.turn_rad))),
        "point_mm": finite(one.test.point_mm),
        "probability": finite(one.test.p),
        "reason": "" if one.reason is None else phrase(one.reason),
    }


def keep(profile: Path, check: Mapping[str, object], temperature_c: float | None = None) -> bool:
    """Keep a check in the profile that it was made against; False for no profile, or none in use."""
    active = open_profile(profile).active_id if profile.is_dir() and is_profile(profile) else None
    if active is None:
        return False
    keep_check(profile, active, check, temperature_c)
    return True
