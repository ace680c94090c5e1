"""The report of a result folder: PDF, HTML, JSON, or a Digital Calibration Certificate."""

from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal.files.json_file import json_bytes
from spherecal_documents.report.content import make_report, report_json
from spherecal_documents.report.detections import find_session
from spherecal_documents.report.html import html_bytes
from spherecal_documents.report.language import speaking
from spherecal_documents.report.pdf import PageSize, pdf_bytes
from spherecal_documents.report.scene_picture import Renderer
from spherecal_documents.report.style import report_style
from spherecal_rigs.result_folder import read_result


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
    """
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
    from spherecal_documents.report.dcc import dcc_bytes, read_issuer

    if issuer is None:
        raise InputError(Phrase("error-no-issuer"))
    return dcc_bytes(read_result(result_folder), read_issuer(issuer))


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
