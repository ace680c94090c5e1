"""A study's document while it is made: blocks after each other, in sections of the report's model."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from spherecal_documents.report.model import Cell, Figure, Paragraph, Report, Section, Table
from spherecal_documents.report.pdf import page_pictures, pdf_bytes
from spherecal_documents.report.sheet import PageBox, Sheet


class Document:
    """Collects blocks; to be made into a PDF within `report_style`."""

    def __init__(self, title: str, heading: str, foot: str) -> None:
        self.heading = heading
        self._report = Report(title, heading, "", (), foot)
        self._sections = [Section("", "", ())]

    def begin_section(self, title: str) -> None:
        """A section with its heading."""
        self._sections.append(Section("", title, ()))

    def _add(self, block: Paragraph | Table | Figure) -> None:
        last = self._sections[-1]
        self._sections[-1] = replace(last, blocks=(*last.blocks, block))

    def paragraph(self, text: str) -> None:
        """A paragraph."""
        self._add(Paragraph(text))

    def caption(self, text: str) -> None:
        """A paragraph in small grey type."""
        self._add(Paragraph(text, "note"))

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[Cell]], left: int = 1) -> None:
        """A table whose first `left` columns hold words."""
        self._add(Table(tuple(columns), tuple(map(tuple, rows)), left))

    def figure(self, name: str, height_mm: float, draw: Callable[[Sheet, PageBox], object]) -> None:
        """A drawing as wide as the text."""
        self._add(Figure(name, height_mm, draw))

    def pdf(self) -> bytes:
        """The document as a PDF."""
        return pdf_bytes(self._whole())

    def pictures(self, dpi: float) -> list[bytes]:
        """Its pages as PNG files."""
        return page_pictures(self._whole(), dpi)

    def _whole(self) -> Report:
        return replace(self._report, sections=tuple(self._sections))
