"""The report of a result folder as one PDF."""

from pathlib import Path

from spherecal import __version__
from spherecal.errors import InputError
from spherecal.report.bars_page import add_bars_pages
from spherecal.report.cameras_page import add_cameras_page
from spherecal.report.detection_page import Detection, add_detection_pages, choose_detections, find_session
from spherecal.report.document import Document, PageSize
from spherecal.report.residuals_page import add_residual_pages
from spherecal.report.result_folder import Result, read_result
from spherecal.report.rig_page import add_rig_pages
from spherecal.report.sheet import PAGE_SIZES_MM
from spherecal.report.style import report_style
from spherecal.report.verdict_page import add_verdict_page
from spherecal.session.atomic import write_file_whole


def write_report(result_folder: Path, output: Path, session_folder: Path | None = None, page: PageSize = "A4") -> None:
    """Write the report of a result folder as a PDF, whole or not at all; the same result gives the same bytes.

    Pictures of detections need the session's images: of `session_folder`, or of a folder `session` beside the result
    (or the one around it) if it is the result's own. InputError for a folder or file that cannot be used as it is,
    OutputError where the PDF cannot be written.
    """
    write_file_whole(output, report_bytes(result_folder, session_folder, page))


def report_bytes(result_folder: Path, session_folder: Path | None = None, page: PageSize = "A4") -> bytes:
    """The report as the bytes of a PDF."""
    if page not in PAGE_SIZES_MM:
        raise InputError(f"Page {page!r} is not known.", f"Use one of {', '.join(PAGE_SIZES_MM)}.")
    result = read_result(result_folder)
    detections = choose_detections(result, find_session(result, session_folder))
    with report_style():
        return make_document(result, detections, page).pdf()


def make_document(result: Result, detections: list[Detection], page: PageSize) -> Document:
    """The report's pages; to be called, and the result used, within `report_style`."""
    footer = f"Report by SphereCal {__version__}  ·  input {result.rig.input_sha256[:16] or 'unknown'}"
    document = Document(page, "SphereCal calibration report", footer)
    add_verdict_page(document, result)
    add_cameras_page(document, result)
    if result.rig.cameras:
        add_rig_pages(document, result)
        add_residual_pages(document, result)
    add_bars_pages(document, result)
    add_detection_pages(document, result, detections)
    return document
