"""The result folder of a verification: bars.csv, verification.json and findings.json beside the verified rig."""

from pathlib import Path

from spherecal.base.errors import InputError, OutputError
from spherecal.base.file_reading import read_file
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal_files.atomic import RESULT, check_folder, write_folder_whole
from spherecal_files.filesystem import create, read_below
from spherecal_files.findings_file import FINDINGS_FILE, findings_document, read_findings
from spherecal_files.json_file import json_bytes
from spherecal_files.verification_file import VERIFICATION
from spherecal_files.write_result import place_cell, small_cell, write_table
from spherecal_verify.verification import MeasuredLength, Verification

BAR_COLUMNS = "bar,pose,from,to,length_mm,reference_mm,error_mm,u_mm,views"
_OURS = ("bars.csv", "verification.json", FINDINGS_FILE)
_MOST_BYTES = 1 << 30


def write_verification(verification: Verification, folder: Path, rig_path: Path) -> None:
    """Write a result folder whole: rig's file, verification, findings of both; this very rig's other files stay."""
    older = check_folder(folder, RESULT)
    rig = _read(rig_path)
    findings = (*_findings_beside(rig_path), *verification.findings)
    same_rig = (older / RESULT.file).is_file() and _read(older / RESULT.file) == rig

    def build(new: Path) -> None:
        for name in sorted(RESULT.names - {*_OURS, RESULT.file}) if same_rig else ():
            if (older / name).exists():
                create(new / name, read_below(older, name, _MOST_BYTES))
        create(new / RESULT.file, rig)
        write_table(new / "bars.csv", BAR_COLUMNS, map(_bar_row, verification.measured))
        create(new / "verification.json", VERIFICATION.bytes(verification))
        if (values := findings_document(findings)) is not None:
            create(new / FINDINGS_FILE, json_bytes(values))

    write_folder_whole(folder, build, RESULT)


def _read(path: Path) -> bytes:
    try:
        return read_file(path, _MOST_BYTES)
    except InputError as error:
        raise OutputError(Phrase("error-not-copied", {"file": path, "why": error.parts[0]})) from error


def _findings_beside(rig_path: Path) -> tuple[Finding, ...]:
    try:
        return read_findings(rig_path.parent)
    except InputError as error:
        raise OutputError(Phrase("error-not-copied", {"file": rig_path.parent, "why": error.parts[0]})) from error


def _bar_row(m: MeasuredLength) -> tuple[object, ...]:
    names = (m.bar, m.pose, m.from_mark, m.to_mark)
    lengths = map(place_cell, (m.length_mm, m.reference_mm))
    return (*names, *lengths, small_cell(m.error_mm), small_cell(m.budget.combined_mm), m.views)
