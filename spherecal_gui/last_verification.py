"""The last verification of the calibration in use, kept beside the rig's profile: it rules the chip before age does."""

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import get_args

from spherecal.base.errors import InputError
from spherecal_files.codec import FileFormat, choice, field, record, text, time
from spherecal_files.filesystem import is_plain_file_below, write_below
from spherecal_gui.project import Verdict

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


def keep_verification(profile: Path, calibration: str, verdict: Verdict, now: datetime | None = None) -> None:
    """Write it, whole. `now` None: at this moment."""
    at = (now or datetime.now(UTC)).astimezone(UTC).replace(microsecond=0)
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
