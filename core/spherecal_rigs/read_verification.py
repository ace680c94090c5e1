"""bars.csv and verification.json of a result folder, read and checked."""

from dataclasses import replace
from math import isnan
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.findings_file import with_values
from spherecal.verify.verification_file import VERIFICATION, BarReport, BarRow
from spherecal.verify.write_verification import BAR_COLUMNS
from spherecal_rigs.result_table import read_csv


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
