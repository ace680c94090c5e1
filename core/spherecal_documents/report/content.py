"""The report of a result: its model, built once, and the same as data."""

from typing import Any

from spherecal import __version__
from spherecal.data.session import Session
from spherecal.files.findings_file import FINDING
from spherecal.files.json_file import software_entry
from spherecal_documents.report.detections import choose_detections, detection_sections
from spherecal_documents.report.language import label
from spherecal_documents.report.model import (
    Cell,
    FindingText,
    KeyFigures,
    Paragraph,
    Report,
    Section,
    Signature,
    Strong,
    Verdict,
    finding_texts,
)
from spherecal_documents.report.scene_picture import ScenePicture
from spherecal_documents.report.sections_bars import bar_sections
from spherecal_documents.report.sections_rig import origin_section, rig_sections, source_section
from spherecal_documents.report.verdicts import calibration_verdict, cameras_in_words, key_figures, verification_verdict
from spherecal_rigs.result_folder import Result

FORMAT = "spherecal/report"
VERSION = 1
_ELSEWHERE = ("summary", "findings", "bar-findings", "source", "assessment")  # in the data, these are no sections


def make_report(
    result: Result,
    session: Session | None = None,
    picture: ScenePicture | None = None,
    notice: str = "",
    note: str = "",
) -> Report:
    """All that the report says of a result; with images of its session and a picture of the rig in space, if given."""
    verified = verification_verdict(result)
    noted = [Paragraph(f"{label('report-note')}: {note}")] if note else []
    summary = (calibration_verdict(result), verified, *noted, key_figures(result))
    none = (Paragraph(label("report-none-there-is-nothing-to")),)
    found = finding_texts(result.rig.quality.findings) or none
    signed = Signature((label("report-assessed-by"), label("report-date"), label("report-signature")))
    reference, cameras = result.rig.reference_camera, cameras_in_words(len(result.rig.cameras))
    sections = (
        Section("summary", "", summary),
        Section("findings", label("report-findings"), found),
        source_section(result),
        *rig_sections(result, picture),
        *bar_sections(result, verified),
        origin_section(result),
        Section("assessment", label("report-assessment"), (Paragraph(label("report-this-report-was-made-by")), signed)),
        *detection_sections(result, choose_detections(result, session)),
    )
    return Report(
        label("report-spherecal-calibration-report"),
        label("report-calibration-report"),
        label("report-cameras-world", cameras=cameras, camera=reference) if reference else cameras,
        sections,
        label("report-made-by", version=__version__, input=result.rig.input_sha256[:16] or label("report-unknown")),
        notice,
    )


def report_json(report: Report, result: Result) -> dict[str, Any]:
    """The report as data: verdicts, key figures, findings, and every table with its numbers as printed."""
    verdicts = report.blocks(Verdict)[:2]
    return {
        "format": FORMAT,
        "version": VERSION,
        "verdicts": [{"of": v.title, "verdict": v.word, "sentence": v.sentence} for v in verdicts],
        "key_figures": [
            {"name": f.name, "value": f.value, "unit": f.unit, "note": f.note}
            for f in report.blocks(KeyFigures)[0].figures
        ],
        "findings": [
            {**FINDING.entry(block.finding), "message": block.message, "hint": block.hint} | of
            for key, of in (("findings", {}), ("bar-findings", {"of": "verification"}))
            for block in getattr(report.section(key), "blocks", ())
            if isinstance(block, FindingText)
        ],
        "sections": [
            {
                "key": section.key,
                "title": section.title,
                "paragraphs": section.texts,
                "tables": [
                    {
                        "title": table.title,
                        "columns": [head.replace("\n", " ") for head in table.columns],
                        "rows": [list(map(_plain, row)) for row in table.rows],
                    }
                    for table in section.tables
                ],
            }
            for section in report.sections
            if section.key not in _ELSEWHERE
        ],
        "input_sha256": result.rig.input_sha256,
        "software": software_entry(None),
    }


def _plain(cell: Cell) -> str:
    return cell.text if isinstance(cell, Strong) else cell
