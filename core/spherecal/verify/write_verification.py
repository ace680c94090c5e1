"""The result folder of a verification: bars.csv, verification.json and findings.json beside the verified rig."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spherecal.base.errors import InputError, OutputError
from spherecal.base.filesystem import create, read_below, read_file
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase, as_json
from spherecal.data.findings import Finding
from spherecal.data.session import Bar
from spherecal.files.atomic import RESULT, check_folder, write_folder_whole
from spherecal.files.bar_registry import CERTIFICATE, LENGTHS
from spherecal.files.findings_file import FINDINGS_FILE, findings_document, read_findings
from spherecal.files.json_file import finite, json_bytes, software_entry
from spherecal.files.rig_file import finding_entry
from spherecal.files.write_result import place_cell, small_cell, write_table
from spherecal.files.written_phrase import sentence_entry
from spherecal.verify.budget import Budget
from spherecal.verify.limit import RULE, Acceptance
from spherecal.verify.verification import LengthStatistics, MeasuredLength, Verification

FORMAT = "spherecal/verification"
VERSION = 1
BAR_COLUMNS = "bar,pose,from,to,length_mm,reference_mm,error_mm,u_mm,views"
_OURS = ("bars.csv", "verification.json", FINDINGS_FILE)
_MOST_BYTES = 1 << 30


def write_verification(
    verification: Verification, folder: Path, rig_path: Path, software: Mapping[str, Any] | None = None
) -> None:
    """Write a result folder whole: a copy of the rig's file and the verification's; OutputError if that fails.

    A folder that already holds the result of this very rig (the same rig.json) keeps its other files: the verification
    joins the calibration. Any other older result is replaced.
    """
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
        create(new / "verification.json", json_bytes(_document(verification, software)))
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
            **sentence_entry("rule", decision.rule),
            "verdict": decision.verdict,
            "coverage_factor": finite(decision.coverage_factor),
            "exceeding": [{"pose": pose, "from": start, "to": end} for pose, start, end in decision.exceeding],
            "cameras": list(decision.cameras),
        },
        "cameras": [
            {"id": c.id, "views": c.seen, "used": c.used, "rms_px": finite(c.rms_px), "state": c.state}
            for c in verification.cameras
        ],
        "findings": [finding_entry(finding) for finding in verification.findings],
        **({} if verification.procedure is None else {"procedure": procedure_entry(verification)}),
        "software": software_entry(software),
    }


def procedure_entry(verification: Verification) -> dict[str, Any]:
    """Title, departures, bars with their certificates, temperatures, limit and decision, budgets."""
    procedure = verification.procedure
    assert procedure is not None
    volume = procedure.volume_mm
    return {
        "title": procedure.title,
        "departures": [phrase(one) for one in procedure.departures],
        "departure_phrases": [as_json(one) for one in procedure.departures],
        "volume_mm": None if volume is None else {"sides": finite(volume[0]), "diagonal": finite(volume[1])},
        "bars": [_bar_entry(bar) for bar in procedure.bars],
        "poses": _pose_entries(verification.measured),
        "acceptance": None if procedure.acceptance is None else _acceptance_entry(procedure.acceptance),
        "budgets": [_budget_entry(budget) for budget in procedure.budgets],
        "cameras_moved": [] if verification.consistency is None else [c.id for c in verification.consistency.moved],
    }


def _bar_entry(bar: Bar) -> dict[str, Any]:
    return {
        "id": bar.id,
        "serial": bar.serial,
        "certificate": None if bar.certificate is None else CERTIFICATE.entry(bar.certificate),
        "expansion_per_kelvin": bar.expansion_per_kelvin,
        "reference_temperature_c": bar.reference_temperature_c,
        "assumed": list(bar.assumed),
        "lengths": LENGTHS.entry(bar.lengths),
    }


def _pose_entries(measured: tuple[MeasuredLength, ...]) -> list[dict[str, Any]]:
    """Each pose with its temperature and the longest length's ends in the rig's world."""
    poses: dict[str, MeasuredLength] = {}
    for m in measured:
        if m.pose not in poses or m.reference_mm > poses[m.pose].reference_mm:
            poses[m.pose] = m
    return [
        {
            "id": m.pose,
            "bar": m.bar,
            "temperature_c": finite(m.temperature_c),
            "from": m.from_mark,
            "to": m.to_mark,
            "ends_mm": None if m.ends_mm is None else finite(m.ends_mm.round(3)),
        }
        for m in poses.values()
    ]


def _acceptance_entry(acceptance: Acceptance) -> dict[str, Any]:
    limit = acceptance.limit
    return {
        "rule": RULE,
        "limit": {"words": limit.words(), "constant_mm": limit.constant_mm, "divisor": limit.divisor},
        "verdict": acceptance.verdict,
        "doubts": list(acceptance.doubts),
        "lengths": [
            {
                "bar": x.bar,
                "from": x.from_mark,
                "to": x.to_mark,
                "worst_pose": x.worst_pose,
                "worst_error_mm": x.worst_error_mm,
                "limit_mm": x.limit_mm,
                "expanded_uncertainty_mm": finite(x.expanded_uncertainty_mm),
                "verdict": x.verdict,
            }
            for x in acceptance.lengths
        ],
    }


def _budget_entry(budget: Budget) -> dict[str, Any]:
    shares = dict(budget.shares())
    return {
        "bar": budget.bar,
        "from": budget.from_mark,
        "to": budget.to_mark,
        "combined_mm": finite(budget.combined_mm),
        "effective_degrees_of_freedom": finite(budget.freedom),
        "coverage_factor": finite(budget.coverage_factor),
        "expanded_uncertainty_mm": finite(budget.expanded_mm),
        **sentence_entry("remedy", budget.remedy()),
        "contributions": [
            {
                "name": c.name,
                "evaluation": c.evaluation,
                "distribution": c.distribution,
                "standard_uncertainty_mm": finite(c.standard_mm),
                "degrees_of_freedom": finite(c.freedom),
                "share": finite(shares.get(c.name, 0.0)),
                "contained_in_repeatability_mm": finite(c.contained_mm),
            }
            for c in budget.contributions
        ],
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
