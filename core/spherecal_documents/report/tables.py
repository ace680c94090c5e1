"""Sections of the report: paragraphs and tables of texts."""

from dataclasses import dataclass
from datetime import UTC

from spherecal import __version__
from spherecal_documents.report.document import Column, Document
from spherecal_documents.report.language import label, word
from spherecal_rigs.result_folder import Result

_DETAILS = {"method": "report-method", "seed": "report-seed"}


def images_taken(result: Result) -> str:
    """When the images of the ball were taken, in words."""
    at = result.rig.recorded_at
    return label("report-not-noted-with-the-recording") if at is None else f"{at.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def calibrated_with(result: Result) -> str:
    """The program that made the result, its version, and the method and seed where they were noted."""
    software = result.software
    details = [f"{word(_DETAILS, key)} {value}" for key, value in software.details]
    return "; ".join((f"{software.name} {software.version}", *details))


@dataclass(frozen=True)
class ReportTable:
    """A table: its title, headings (a second line after a line end), widths in mm, rows of texts as printed."""

    title: str
    columns: tuple[str, ...]
    widths: tuple[float, ...]
    rows: tuple[tuple[str, ...], ...]
    left: int = 1  # so many columns hold words and are aligned left


@dataclass(frozen=True)
class Section:
    """A section by its key, with paragraphs before its tables."""

    key: str
    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[ReportTable, ...] = ()


def made_by(result: Result) -> str:
    """The foot of a page: the program and the input."""
    return label("report-made-by", version=__version__, input=result.rig.input_sha256[:16] or label("report-unknown"))


def add_section(document: Document, section: Section | None, needed: float = 35.0) -> None:
    """Print a section; nothing for None.

    `needed`: room below its heading, mm, without which a page is begun.
    """
    if section is None:
        return
    document.begin_section(section.title, needed, new_page=False)
    for text in section.paragraphs:
        document.caption(text)
    for table in section.tables:
        if table.title:
            document.need(min(len(table.rows), 10) * 3.8 + 18.0)  # a title alone at the foot of a page says nothing
            document.paragraph(table.title, after=0.8)
        columns = [
            Column(name, width, "left" if i < table.left else "right")
            for i, (name, width) in enumerate(zip(table.columns, table.widths, strict=True))
        ]
        document.table(columns, table.rows)
