"""bars.csv and verification.json of a result folder, read and checked; what a failed verification forbids."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from math import isnan
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.filesystem import read_file, write_below
from spherecal.base.messages.values import Phrase
from spherecal.files.findings_file import with_values
from spherecal.files.json_file import JsonValue, json_bytes
from spherecal.verify.verification_file import VERIFICATION, BarReport, BarRow, Override
from spherecal.verify.write_verification import BAR_COLUMNS
from spherecal_rigs.result_table import read_csv

_MOST_BYTES = 1 << 30


def read_bar_report(folder: Path) -> BarReport | None:
    """The verification in a result folder; None where there is none."""
    table, document = folder / "bars.csv", folder / "verification.json"
    if not table.exists() and not document.exists():
        return None
    for path, other in ((table, document), (document, table)):
        if not path.exists():
            raise InputError(Phrase("error-verification-part", {"file": path, "other": other.name}))
    found = VERIFICATION.read(document)
    return replace(found, measured=_read_rows(table), findings=with_values(found.findings, folder))


def _read_rows(path: Path) -> tuple[BarRow, ...]:
    table = read_csv(path, BAR_COLUMNS)
    u = table.lengths("u_mm", may_be_empty=True)
    return tuple(
        BarRow(bar, pose, start, end, length, reference, error, None if isnan(sigma) else sigma, views)
        for bar, pose, start, end, length, reference, error, sigma, views in zip(
            *(table.names(name) for name in ("bar", "pose", "from", "to")),
            *(table.numbers(name).tolist() for name in ("length_mm", "reference_mm", "error_mm")),
            u.tolist(),
            table.whole_numbers("views").tolist(),
            strict=True,
        )
    )


def refuse_failed(folder: Path) -> Override | None:
    """Refuse the rig of a folder whose verification failed, unless somebody answers for it: then the override."""
    path = folder / VERIFICATION.file
    if not path.is_file():
        return None
    found = VERIFICATION.read(path)
    if found.failed and found.override is None:
        raise InputError(Phrase("error-verification-failed", {"file": path, "folder": folder}))
    return found.override if found.failed else None


def answer_for(folder: Path, by: str, reason: str) -> None:
    """Write into a failed verification who uses its rig all the same, and why; every later headline says so."""
    path = folder / VERIFICATION.file
    if not path.is_file() or not VERIFICATION.read(path).failed:
        raise InputError(Phrase("error-nothing-to-override", {"file": path}))
    by, reason = " ".join(by.split()), " ".join(reason.split())
    if not by or not reason:
        raise InputError(Phrase("error-override-needs-name"))
    at = datetime.now(UTC).replace(microsecond=0).isoformat()
    document = json.loads(read_file(path, _MOST_BYTES)) | {"override": {"by": by, "reason": reason, "at": at}}
    VERIFICATION.kind.read(JsonValue(document, path))  # a control character would make the file unreadable
    write_below(folder, VERIFICATION.file, json_bytes(document))
