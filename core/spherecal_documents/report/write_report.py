"""The report of a result folder: PDF, HTML, JSON, or a Digital Calibration Certificate."""

from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal.files.json_file import json_bytes
from spherecal_documents.report.bars_page import add_bars_pages
from spherecal_documents.report.cameras_page import add_cameras_page
from spherecal_documents.report.content import content_json, make_content
from spherecal_documents.report.detection_page import Detection, add_detection_pages, choose_detections, find_session
from spherecal_documents.report.document import Document, PageSize
from spherecal_documents.report.language import label, language_now, speaking
from spherecal_documents.report.residuals_page import add_residual_pages
from spherecal_documents.report.rig_page import add_rig_pages
from spherecal_documents.report.scene_picture import Renderer, ScenePicture
from spherecal_documents.report.sections_rig import rig_sections
from spherecal_documents.report.sheet import PAGE_SIZES_MM
from spherecal_documents.report.style import chinese_fonts, report_style
from spherecal_documents.report.tables import add_section, made_by
from spherecal_documents.report.uncertainty_page import add_uncertainty_page
from spherecal_documents.report.verdict_page import add_signature, add_verdict_page
from spherecal_rigs.result_folder import Result, read_result


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
    """Write the report of a result folder, whole or not at all; the same result gives the same bytes.

    The ending of `output` chooses the form: `.pdf`, `.html`, `.json` (the same content as data), `.xml` (a Digital
    Calibration Certificate, always in English).

    `issuer` None: there can be no certificate; `render` None: it is drawn.
    """
    forms = {
        ".html": lambda folder: html_report(folder, session_folder, render),
        ".htm": lambda folder: html_report(folder, session_folder, render),
        ".json": json_report,
        ".xml": lambda folder: certificate(folder, issuer),
        ".pdf": lambda folder: report_bytes(folder, session_folder, page, notice, note, render),
    }
    make = forms.get(output.suffix.lower())
    if make is None:
        raise InputError(Phrase("error-report-kind", {"file": output}))
    with speaking(language):
        data = make(result_folder)
    write_file_whole(output, data)


def certificate(result_folder: Path, issuer: Path | None) -> bytes:
    """A Digital Calibration Certificate, as XML.

    `issuer` None is refused.
    """
    from spherecal_documents.report.dcc import dcc_bytes, read_issuer

    if issuer is None:
        raise InputError(Phrase("error-no-issuer"))
    return dcc_bytes(read_result(result_folder), read_issuer(issuer))


def report_bytes(
    result_folder: Path,
    session_folder: Path | None = None,
    page: PageSize = "A4",
    notice: str = "",
    note: str = "",
    render: Renderer | None = None,
) -> bytes:
    """The report as the bytes of a PDF."""
    if page not in PAGE_SIZES_MM:
        raise InputError(Phrase("error-page", {"page": repr(page), "pages": list(PAGE_SIZES_MM)}))
    result = read_result(result_folder)
    if language_now() == "zh_CN" and not chinese_fonts():
        raise InputError(Phrase("error-no-chinese-font"))
    session = find_session(result, session_folder)
    detections = choose_detections(result, session)
    scene = render(result, session) if render is not None else None
    with report_style():
        return make_document(result, detections, page, notice, note, scene).pdf()


def html_report(result_folder: Path, session_folder: Path | None = None, render: Renderer | None = None) -> bytes:
    """The report as one HTML file."""
    from spherecal_documents.report.html import html_bytes

    result = read_result(result_folder)
    scene = render(result, find_session(result, session_folder)) if render is not None else None
    with report_style():
        return html_bytes(make_content(result), result, scene)


def json_report(result_folder: Path) -> bytes:
    """The report's content as the bytes of a JSON file."""
    result = read_result(result_folder)
    return json_bytes(content_json(make_content(result), result))


def make_document(
    result: Result,
    detections: list[Detection],
    page: PageSize,
    notice: str = "",
    note: str = "",
    scene: ScenePicture | None = None,
) -> Document:
    """The report's pages; to be called, and the result used, within `report_style`.

    `scene` None: it is drawn.
    """
    document = Document(page, label("report-spherecal-calibration-report"), made_by(result))
    document.notice = notice
    sections = {section.key: section for section in rig_sections(result)}
    add_verdict_page(document, result, note)
    add_cameras_page(document, result)
    if result.rig.cameras:
        add_rig_pages(document, result, scene)
        add_residual_pages(document, result)
        add_section(document, sections.get("coverage"))
        add_uncertainty_page(document, result, sections.get("uncertainty"))
    add_section(document, sections.get("exclusions"))
    add_bars_pages(document, result)
    add_section(document, sections.get("origin"))
    add_signature(document)
    add_detection_pages(document, result, detections)
    return document
