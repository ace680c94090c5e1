"""The result folder of a verification: bars.csv and verification.json beside the rig that was verified."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spherecal.errors import OutputError
from spherecal.session.atomic import RESULT, check_folder, write_folder_whole
from spherecal.session.rig_file import finding_entry, finite, json_bytes, software_entry
from spherecal.session.write_result import place_cell, small_cell, write_table
from spherecal.verify.verification import LengthStatistics, MeasuredLength, Verification

FORMAT = "spherecal/verification"
VERSION = 1
BAR_COLUMNS = "bar,pose,from,to,length_mm,reference_mm,error_mm,u_mm,views"
_OURS = ("bars.csv", "verification.json")


def write_verification(
    verification: Verification, folder: Path, rig_path: Path, software: Mapping[str, Any] | None = None
) -> None:
    """Write a result folder whole: a copy of the rig's file, bars.csv and verification.json; OutputError if that fails.

    A folder that already holds the result of this very rig (the same rig.json) keeps its other files: the verification
    joins the calibration. Any other older result is replaced.
    """
    older = check_folder(folder, RESULT)
    rig = _read(rig_path)
    same_rig = (older / RESULT.file).is_file() and _read(older / RESULT.file) == rig

    def build(new: Path) -> None:
        if same_rig:
            shutil.copytree(older, new, dirs_exist_ok=True, ignore=shutil.ignore_patterns(*_OURS))
        (new / RESULT.file).write_bytes(rig)
        write_table(new / "bars.csv", BAR_COLUMNS, map(_bar_row, verification.measured))
        (new / "verification.json").write_bytes(json_bytes(_document(verification, software)))

    write_folder_whole(folder, build, RESULT)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise OutputError(f"{path}: cannot be copied into the result ({error.strerror}).") from error


def _bar_row(m: MeasuredLength) -> tuple[object, ...]:
    names = (m.bar, m.pose, m.from_mark, m.to_mark)
    lengths = map(place_cell, (m.length_mm, m.reference_mm))
    return (*names, *lengths, small_cell(m.error_mm), small_cell(m.budget.combined_mm), m.views)


def _document(verification: Verification, software: Mapping[str, Any] | None) -> dict[str, Any]:
    overall, decision = verification.overall, verification.decision
    return {
        "format": FORMAT,
        "version": VERSION,
        "lengths": [_length_entry(length) for length in verification.lengths],
        "overall": {
            "n": overall.n,
            "mean_error_mm": finite(overall.mean_error_mm),
            "sd_mm": finite(overall.sd_mm),
            "rms_error_mm": finite(overall.rms_error_mm),
            "max_abs_error_mm": finite(overall.max_abs_error_mm),
        },
        "decision": {
            "rule": decision.rule,
            "verdict": decision.verdict,
            "coverage_factor": finite(decision.coverage_factor),
            "exceeding": [{"pose": pose, "from": start, "to": end} for pose, start, end in decision.exceeding],
        },
        "findings": [finding_entry(finding) for finding in verification.findings],
        "software": software_entry(software),
    }


def _length_entry(length: LengthStatistics) -> dict[str, Any]:
    budget = length.budget
    return {
        "bar": length.bar,
        "from": length.from_mark,
        "to": length.to_mark,
        "n": length.n,
        "mean_error_mm": finite(length.mean_error_mm),
        "sd_mm": finite(length.sd_mm),
        "max_abs_error_mm": finite(length.max_abs_error_mm),
        "expanded_uncertainty_mm": finite(length.expanded_uncertainty_mm),
        "coverage_factor": finite(length.coverage_factor),
        "standard_uncertainties_mm": {
            "repeatability": finite(length.repeatability_mm),
            "calibration": finite(budget.calibration_mm),
            "scale": finite(budget.scale_mm),
            "certificate": finite(budget.certificate_mm),
            "temperature": finite(budget.temperature_mm),
        },
    }
