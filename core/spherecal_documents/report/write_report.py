"""`write_report`: what a report says, as PDF, HTML, JSON or a certificate."""

from pathlib import Path
from typing import Any

from spherecal import __version__
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Session
from spherecal_documents.report import model
from spherecal_documents.report.detections import choose_detections, detection_sections, find_session
from spherecal_documents.report.html import html_bytes
from spherecal_documents.report.language import label, speaking
from spherecal_documents.report.pdf import PageSize, pdf_bytes
from spherecal_documents.report.rig_drawing import Renderer, ScenePicture
from spherecal_documents.report.sections_bars import bar_sections
from spherecal_documents.report.sections_rig import origin_section, rig_sections, source_section
from spherecal_documents.report.style import report_style
from spherecal_documents.report.verdicts import calibration_verdict, cameras_in_words, key_figures, verification_verdict
from spherecal_files.atomic import write_file_whole
from spherecal_files.findings_file import FINDING
from spherecal_files.json_file import json_bytes, software_entry
from spherecal_rigs.result_folder import Result, read_result

FORMAT = "spherecal/report"
VERSION = 1
_ELSEWHERE = ("summary", "findings", "bar-findings", "source", "assessment")  # in the data, these are no sections


def make_report(
    result: Result,
    session: Session | None = None,
    picture: ScenePicture | None = None,
    notice: str = "",
    note: str = "",
) -> model.Report:
    """All that the report says of a result; with images of its session and a picture of the rig in space, if given."""
    verified = verification_verdict(result)
    noted = [model.Paragraph(f"{label('report-note')}: {note}")] if note else []
    summary = (calibration_verdict(result), verified, *noted, key_figures(result))
    none = (model.Paragraph(label("report-none-there-is-nothing-to")),)
    found = model.finding_texts(result.rig.quality.findings) or none
    signed = model.Signature((label("report-assessed-by"), label("report-date"), label("report-signature")))
    reference, cameras = result.rig.reference_camera, cameras_in_words(len(result.rig.cameras))
    sections = (
        model.Section("summary", "", summary),
        model.Section("findings", label("report-findings"), found),
        source_section(result),
        *rig_sections(result, picture),
        *bar_sections(result, verified),
        origin_section(result),
        model.Section(
            "assessment", label("report-assessment"), (model.Paragraph(label("report-this-report-was-made-by")), signed)
        ),
        *detection_sections(result, choose_detections(result, session)),
    )
    return model.Report(
        label("report-spherecal-calibration-report"),
        label("report-calibration-report"),
        label("report-cameras-world", cameras=cameras, camera=reference) if reference else cameras,
        sections,
        label("report-made-by", version=__version__, input=result.rig.input_sha256[:16] or label("report-unknown")),
        notice,
    )


def report_json(report: model.Report, result: Result) -> dict[str, Any]:
    """The report as data: verdicts, key figures, findings, and every table with its numbers as printed."""
    verdicts = report.blocks(model.Verdict)[:2]
    return {
        "format": FORMAT,
        "version": VERSION,
        "verdicts": [{"of": v.title, "verdict": v.word, "sentence": v.sentence} for v in verdicts],
        "key_figures": [
            {"name": f.name, "value": f.value, "unit": f.unit, "note": f.note}
            for f in report.blocks(model.KeyFigures)[0].figures
        ],
        "findings": [
            {**FINDING.entry(block.finding), "message": block.message, "hint": block.hint} | of
            for key, of in (("findings", {}), ("bar-findings", {"of": "verification"}))
            for block in getattr(report.section(key), "blocks", ())
            if isinstance(block, model.FindingText)
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


def _plain(cell: model.Cell) -> str:
    return cell.text if isinstance(cell, model.Strong) else cell


def write_report(
    result_folder: Path,
    output: Path,
    session_folder: Path | None = None,
    page: PageSize = "A4",
    issuer: Path | None = None,
    language: str = "en",
    notice: str = "",
    note: str = "",
    render: Renderer | None = None,
) -> None:
    """Write the report of a result folder whole, as its ending says: .pdf, .html, .json, .xml (a DCC); same bytes."""
    ending = {".htm": ".html"}.get(output.suffix.lower(), output.suffix.lower())
    if ending not in (".pdf", ".html", ".json", ".xml"):
        raise InputError(Phrase("error-report-kind", {"file": output}))
    with speaking(language):
        if ending == ".xml":
            data = certificate(result_folder, issuer)
        else:
            data = report_bytes(ending, result_folder, session_folder, page, notice, note, render)
    write_file_whole(output, data)


def certificate(result_folder: Path, issuer: Path | None) -> bytes:
    """A Digital Calibration Certificate, as XML; `issuer`: the file that says who issues it, None is refused."""
    from spherecal_documents.report.dcc import ISSUER, dcc_bytes

    if issuer is None:
        raise InputError(Phrase("error-no-issuer"))
    return dcc_bytes(read_result(result_folder), ISSUER.read(issuer))


def report_bytes(
    form: str,
    result_folder: Path,
    session_folder: Path | None = None,
    page: PageSize = "A4",
    notice: str = "",
    note: str = "",
    render: Renderer | None = None,
) -> bytes:
    """The report as the bytes of a file of this ending, .pdf, .html or .json; the rest as of `write_report`."""
    result = read_result(result_folder)
    with report_style():
        if form == ".json":
            return json_bytes(report_json(make_report(result), result))
        session = find_session(result, session_folder)
        picture = render(result, session) if render is not None else None
        report = make_report(result, session, picture, notice, note)
        return html_bytes(report) if form == ".html" else pdf_bytes(report, page)
