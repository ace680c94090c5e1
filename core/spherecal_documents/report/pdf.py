"""A report as PDF: its model laid out by typst after resources/report.typ; drawings as PDF or PNG."""

import json
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

import matplotlib

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import resource_path
from spherecal_documents.report.language import label, language_now
from spherecal_documents.report.model import Report, as_plain, svg_of
from spherecal_documents.report.style import Sheet, chinese_fonts, font_families

PageSize = Literal["A4", "Letter"]


def pdf_bytes(report: Report, page: PageSize = "A4") -> bytes:
    """The PDF; the same report gives the same bytes. To be called within `report_style`."""
    if page not in get_args(PageSize):
        raise InputError(Phrase("error-page", {"page": repr(page), "pages": list(get_args(PageSize))}))
    if language_now() == "zh_CN" and not chinese_fonts():
        raise InputError(Phrase("error-no-chinese-font"))
    return _typeset(_inputs(report, page))


def page_pictures(report: Report, dpi: float) -> list[bytes]:
    """The pages as PNG files."""
    pages = _typeset(_inputs(report, "A4"), format="png", ppi=dpi)
    return pages if isinstance(pages, list) else [pages]


def sheet_pdf(sheet: Sheet) -> bytes:
    """A drawing as the one page of a PDF."""
    return _typeset({"drawing": svg_of(sheet)})


def _inputs(report: Report, page: PageSize) -> dict[str, str]:
    said = {
        "page": {"A4": "a4", "Letter": "us-letter"}[page],
        "number": label("report-page-of", page="{page}", pages="{pages}"),
        "language": language_now().split("_"),
    }
    return {"report": json.dumps(as_plain(report)), "said": json.dumps(said)}


def _typeset(inputs: dict[str, str], **form: Any) -> Any:
    import typst

    inputs = inputs | {"fonts": json.dumps(font_families())}
    source = resource_path("report.typ").read_bytes()
    fonts = _fonts(language_now() == "zh_CN")
    return typst.Compiler(source, str(resource_path()), fonts, sys_inputs=inputs).compile(**form)


@cache
def _fonts(of_the_system: bool) -> Any:
    """Our own fonts and matplotlib's, and the system's where they are needed, as for Chinese."""
    import typst

    folders = [resource_path("fonts"), Path(matplotlib.get_data_path(), "fonts", "ttf")]
    return typst.Fonts(of_the_system, False, [str(folder) for folder in folders])
