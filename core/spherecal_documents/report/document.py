"""Pages that fill from top to bottom: headings, paragraphs and tables flow on to the next page."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from matplotlib.backends.backend_pdf import PdfPages

from spherecal_documents.report.language import label
from spherecal_documents.report.sheet import PAGE_SIZES_MM, Align, PageBox, Sheet, leading, shortened, wrap
from spherecal_documents.report.style import BAD, BODY_PT, HEADING_PT, INK, PALE, RULE, SMALL_PT, SOFT, TINY_PT

PageSize = Literal["A4", "Letter"]

_LEFT, _RIGHT, _TOP, _FOOT = 20.0, 15.0, 20.0, 20.0  # margins in mm; the left one has room for a folder's holes


@dataclass(frozen=True)
class Column:
    """A column of a table: heading (a second line after a line end), width in mm, alignment."""

    heading: str
    width: float
    align: Align = "right"


Cell = str | tuple[str, str]  # a text, or a bold text and its colour


class Document:
    """The pages of a report; `y` is where the next thing goes on the last page, `notice` the head of every page."""

    def __init__(self, page: PageSize, title: str, footer: str) -> None:
        self.size = PAGE_SIZES_MM[page]
        self.title, self.footer = title, footer
        self.sheets: list[Sheet] = []
        self.section, self.notice = "", ""
        self.y = 0.0

    @property
    def left(self) -> float:
        """Where lines begin, mm from the left."""
        return _LEFT

    @property
    def width(self) -> float:
        """The width of the text, mm."""
        return self.size[0] - _LEFT - _RIGHT

    @property
    def bottom(self) -> float:
        """Where the text ends, mm from the top."""
        return self.size[1] - _FOOT

    @property
    def room(self) -> float:
        """The height of the text of a whole page, mm."""
        return self.bottom - _TOP

    @property
    def sheet(self) -> Sheet:
        """The last page."""
        return self.sheets[-1]

    def new_page(self) -> None:
        """Begin a page."""
        self.sheets.append(Sheet(*self.size))
        self.y = _TOP
        if len(self.sheets) > 1:
            self.sheet.text(_LEFT, 12.0, self.section, TINY_PT, colour=SOFT)
            self.sheet.text(_LEFT + self.width, 12.0, self.title, TINY_PT, colour=SOFT, align="right")
            self.sheet.rule(_LEFT, _LEFT + self.width, 13.6)
        if self.notice:
            self.sheet.text(self.size[0] / 2, 12.0, self.notice, BODY_PT, bold=True, colour=BAD, align="center")

    def need(self, height: float) -> bool:
        """Begin a page if there is less room than `height` mm on this one; whether it was begun."""
        if self.sheets and self.y + height <= self.bottom:
            return False
        self.new_page()
        return True

    def begin_section(self, name: str, needed: float = 60.0, new_page: bool = True) -> None:
        """A section with its heading, on a new page or where there is room for it and `needed` mm more."""
        self.section = name
        if new_page:
            self.new_page()
        else:
            self.y += 5.0
            self.need(needed)
        self.y += 4.0
        self.sheet.text(_LEFT, self.y, name, HEADING_PT + 2.0 * new_page, bold=True)
        self.y += 2.6
        self.sheet.rule(_LEFT, _LEFT + self.width, self.y, INK, 0.8)
        self.y += 2.0

    def paragraph(self, text: str, size_pt: float = BODY_PT, colour: str = INK, after: float = 1.5) -> None:
        """A paragraph over the width of the page.

        `after`: room below it, mm.
        """
        for line in wrap(text, self.width, size_pt):
            self.need(leading(size_pt))
            self.y += leading(size_pt)
            self.sheet.text(_LEFT, self.y, line, size_pt, colour=colour)
        self.y += after

    def caption(self, text: str) -> None:
        """A paragraph in small grey type."""
        self.paragraph(text, SMALL_PT, SOFT)

    def box(self, height: float) -> PageBox:
        """Room of this height, mm, on a page; it is taken."""
        self.need(height)
        taken = PageBox(_LEFT, self.y, self.width, height)
        self.y += height
        return taken

    def table(self, columns: Sequence[Column], rows: Sequence[Sequence[Cell]], size_pt: float = SMALL_PT) -> None:
        """A table as wide as the text, over as many pages as it takes, its head repeated; shaded every second row."""
        stretch = self.width / sum(column.width for column in columns)
        columns = [replace(column, width=column.width * stretch) for column in columns]
        height = leading(size_pt) + 0.9
        self.need(_head_height(columns) + min(3, len(rows)) * height)
        self._table_head(columns)
        for i, row in enumerate(rows):
            if self.need(height):
                self._table_head(columns)
            if i % 2:
                self.sheet.fill(PageBox(_LEFT, self.y, self.width, height), PALE)
            self._row(columns, row, self.y + height - 1.5, size_pt)
            self.y += height
        self.sheet.rule(_LEFT, _LEFT + self.width, self.y, SOFT)
        self.y += 3.0

    def _table_head(self, columns: Sequence[Column]) -> None:
        lines = [column.heading.split("\n") for column in columns]
        most = max(map(len, lines))
        for i in range(most):
            self.y += leading(TINY_PT)
            heads = [line[i - most] if i >= most - len(line) else "" for line in lines]
            self._row(columns, heads, self.y, TINY_PT, SOFT)
        self.y += 1.4
        self.sheet.rule(_LEFT, _LEFT + self.width, self.y, SOFT, 0.6)
        self.y += 0.4

    def _row(
        self, columns: Sequence[Column], cells: Sequence[Cell], y: float, size_pt: float, colour: str = INK
    ) -> None:
        x = _LEFT
        for column, cell in zip(columns, cells, strict=True):
            text, ink, bold = (cell, colour, False) if isinstance(cell, str) else (*cell, True)
            place = {"left": x + 1.0, "center": x + column.width / 2, "right": x + column.width - 1.5}[column.align]
            self.sheet.text(
                place, y, shortened(text, column.width - 2.0, size_pt, bold), size_pt, bold, ink, column.align
            )
            x += column.width

    def flow_panels(
        self,
        names: Sequence[str],
        columns: int,
        height: float,
        draw: Callable[[Sheet, PageBox, str], None],
        gap: float = 4.0,
    ) -> None:
        """One panel for each name, `columns` in a row, each `height` mm high, over as many pages as it takes."""
        for start in range(0, len(names), columns):
            row = self.box(height + gap)
            for box, name in zip(row.inset(0, bottom=gap).grid(1, columns, gap), names[start:], strict=False):
                draw(self.sheet, box, name)

    def pdf(self) -> bytes:
        """The whole as the bytes of a PDF; the same pages give the same bytes."""
        buffer = io.BytesIO()
        pages = len(self.sheets)
        metadata = {"Title": self.title, "Creator": None, "CreationDate": None}
        with PdfPages(buffer, metadata=metadata) as pdf:
            for i, sheet in enumerate(self.sheets):
                y = self.size[1] - 10.0
                sheet.rule(_LEFT, _LEFT + self.width, y - 4.0, RULE)
                sheet.text(_LEFT, y, self.footer, TINY_PT, colour=SOFT)
                sheet.text(
                    _LEFT + self.width,
                    y,
                    label("report-page-of", page=i + 1, pages=pages),
                    TINY_PT,
                    colour=SOFT,
                    align="right",
                )
                pdf.savefig(sheet.figure)
        return buffer.getvalue()


def _head_height(columns: Sequence[Column]) -> float:
    return max(column.heading.count("\n") + 1 for column in columns) * leading(TINY_PT) + 1.8
