"""The calibration in use: as a result folder, to be verified without its project; and its last verification."""

import hashlib
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import get_args

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_files.codec import FileFormat, choice, field, record, text, time
from spherecal_files.filesystem import is_plain_file_below, read_below, write_below, write_together
from spherecal_gui.project import Verdict

_MOST_BYTES = 64 << 20
_OF_OTHERS = ("verification.json", "bars.csv", "targets.json")  # of the verification before; of the session


def result_of(profile: Path, result: Path) -> tuple[str, Verdict]:
    """Write a profile's calibration in use as a result folder, residuals and spheres empty; its number and verdict."""
    from spherecal_files.write_result import RESIDUAL_COLUMNS, SPHERE_COLUMNS
    from spherecal_rigs.entry import FILES, RIG_FILE  # imports scipy, as the next
    from spherecal_rigs.store import open_profile

    kept = open_profile(profile)
    number, entry = kept.active_id, kept.active
    if number is None or entry is None:
        raise InputError(Phrase("error-wizard-none-in-use", {"folder": profile}))
    kept.rig(number)  # refuses a file that was changed
    result.mkdir(parents=True, exist_ok=True)
    tables = (("residuals.csv", RESIDUAL_COLUMNS), ("spheres.csv", SPHERE_COLUMNS))
    written = {name: f"{columns}\n".encode() for name, columns in tables}
    names = [name for name in (*FILES[1:], RIG_FILE) if name in entry.files and name not in _OF_OTHERS]
    written |= {name: read_below(kept.path_of(number), name, _MOST_BYTES) for name in names}
    write_together(result, written)  # rig.json last: by it the folder is a result
    return number, "not valid" if not entry.valid else "use with care" if entry.care else "valid"


def number_of(profile: Path, result: Path) -> str | None:
    """The number of the calibration in use where it is that of a result folder; None where it is another."""
    from spherecal_rigs.entry import RIG_FILE  # imports scipy, as the next
    from spherecal_rigs.store import is_profile, open_profile

    kept = open_profile(profile) if is_profile(profile) else None
    if kept is None or kept.active is None:
        return None
    own = hashlib.sha256(read_below(result, RIG_FILE, _MOST_BYTES)).hexdigest()
    return kept.active_id if kept.active.files.get(RIG_FILE) == own else None


FILE = "last-verification.json"


@dataclass(frozen=True)
class LastVerification:
    """Which calibration of the profile was verified, when, and what came out."""

    calibration: str
    at: datetime
    verdict: Verdict


LAST_VERIFICATION = FileFormat(
    "spherecal/last-verification",
    FILE,
    "The last verification of the calibration in use, beside a profile.",
    record(
        "",
        LastVerification,
        field("calibration", text("Which calibration.")),
        field("at", time("When.")),
        field("verdict", choice("What came out.", get_args(Verdict))),
    ),
)


def keep_verification(profile: Path, calibration: str, verdict: Verdict) -> None:
    """Write it, whole, with the moment of now."""
    at = datetime.now(UTC).replace(microsecond=0)
    document = LAST_VERIFICATION.document(LastVerification(calibration, at, verdict))
    write_below(profile, FILE, (json.dumps(document, indent=1) + "\n").encode())


def last_verification(profile: Path, calibration: str | None) -> LastVerification | None:
    """The last verification, if it was of this calibration; None where there is none that can be read."""
    if calibration is None or not is_plain_file_below(profile, FILE):
        return None
    try:
        found = LAST_VERIFICATION.read(profile / FILE, below=profile)
    except InputError:
        return None
    return found if found.calibration == calibration else None
