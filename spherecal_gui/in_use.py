"""The calibration in use as a result folder, so that it can be verified again without the project that it came from."""

import hashlib
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_files.filesystem import read_below, write_together
from spherecal_files.write_result import RESIDUAL_COLUMNS, SPHERE_COLUMNS
from spherecal_gui.project import Verdict
from spherecal_rigs.entry import FILES, RIG_FILE
from spherecal_rigs.store import Profile, is_profile, open_profile

_MOST_BYTES = 64 << 20
_OF_OTHERS = ("verification.json", "bars.csv", "targets.json")  # of the verification before; of the session


def result_of(profile: Path, result: Path) -> tuple[str, Verdict]:
    """Write a profile's calibration in use as a result folder, residuals and spheres empty; its number and verdict."""
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
    if not is_profile(profile):
        return None
    kept: Profile = open_profile(profile)
    if kept.active is None:
        return None
    own = hashlib.sha256(read_below(result, RIG_FILE, _MOST_BYTES)).hexdigest()
    return kept.active_id if kept.active.files.get(RIG_FILE) == own else None
