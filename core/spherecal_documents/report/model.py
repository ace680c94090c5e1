"""What a report says, apart from its form: sections of blocks, from which PDF, HTML and JSON are made."""

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal

import matplotlib

from spherecal.data.findings import Finding
from spherecal_documents.report.language import finding_words, label
from spherecal_documents.report.style import INK, SEVERITY, PageBox, Sheet, some_of

TEXT_MM = 175.0  # width of the text, on which drawings are as wide


@dataclass(frozen=True)
class Strong:
    """Text that stands out in a table, bold and in a colour."""

    text: str
    colour: str = INK


Cell = str | Strong


@dataclass(frozen=True)
class Paragraph:
    """A text: plain, a note in small grey type, an alarm in red, an item of a list, or what a subtitle says."""

    text: str
    style: Literal["plain", "note", "alarm", "item", "subtitle"] = "plain"


@dataclass(frozen=True)
class Table:
    """A table: headings (a second line after a line end) and rows; the first `left` columns hold words."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    left: int = 1
    title: str = ""


@dataclass(frozen=True)
class KeyValues:
    """Names and what is said of each."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Verdict:
    """A verdict: what it is on, its word, colour and sentence."""

    title: str
    word: str
    colour: str
    sentence: str


@dataclass(frozen=True)
class KeyFigure:
    """A number that matters, as printed."""

    value: str
    unit: str
    name: str
    note: str


@dataclass(frozen=True)
class KeyFigures:
    """The numbers that matter, side by side."""

    figures: tuple[KeyFigure, ...]


@dataclass(frozen=True)
class FindingText:
    """A finding in the report's language: severity with its word and colour, message, hint, whom it concerns."""

    severity: str
    word: str
    colour: str
    message: str
    hint: str
    concerns: str
    finding: Finding = field(repr=False)


@dataclass(frozen=True)
class Figure:
    """A drawing of this size in mm; `name` says what it shows. It is drawn when a renderer asks for it."""

    name: str
    height: float
    draw: Callable[[Sheet, PageBox], object]
    width: float = TEXT_MM

    def sheet(self) -> Sheet:
        """The drawing; to be called within `report_style`."""
        sheet = Sheet(self.width, self.height)
        self.draw(sheet, PageBox(0.0, 0.0, self.width, self.height))
        return sheet

    def svg(self) -> str:
        """The drawing as an svg element whose text stays text; to be called within `report_style`."""
        return svg_of(self.sheet())


def svg_of(sheet: Sheet, text_as: Literal["none", "path"] = "none") -> str:
    """A sheet as an svg element, its text as text ("none") or as outlines."""
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": text_as, "svg.hashsalt": "spherecal"}):
        sheet.figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)


@dataclass(frozen=True)
class Panels:
    """Drawings of one size side by side, `columns` in a row of a page."""

    figures: tuple[Figure, ...]
    columns: int


@dataclass(frozen=True)
class Signature:
    """Lines to sign on, with what is written under each."""

    names: tuple[str, ...]


Block = Paragraph | Table | KeyValues | Verdict | KeyFigures | FindingText | Figure | Panels | Signature


@dataclass(frozen=True)
class Section:
    """A section by its key; `new_page`: it begins one."""

    key: str
    title: str
    blocks: tuple[Block, ...]
    new_page: bool = False

    @property
    def tables(self) -> list[Table]:
        """Its tables."""
        return [block for block in self.blocks if isinstance(block, Table)]

    @property
    def texts(self) -> list[str]:
        """Its paragraphs."""
        return [block.text for block in self.blocks if isinstance(block, Paragraph)]


@dataclass(frozen=True)
class Report:
    """A report: title of the document, heading and what is beside it, sections, the line at each foot, a notice."""

    title: str
    heading: str
    beside: str
    sections: tuple[Section, ...]
    foot: str
    notice: str = ""

    def section(self, key: str) -> Section | None:
        """The section with this key, or None."""
        return next((section for section in self.sections if section.key == key), None)

    def blocks(self, kind: type) -> list[Any]:
        """All blocks of a kind, in their order."""
        return [block for section in self.sections for block in section.blocks if isinstance(block, kind)]


def finding_texts(findings: Sequence[Finding]) -> tuple[FindingText, ...]:
    """Findings in the report's language: errors first, then warnings, then the rest."""
    order = tuple(SEVERITY)
    found = []
    for finding in sorted(findings, key=lambda finding: order.index(finding.severity)):
        where = label("report-concerns", names=some_of(finding.where, 120)) if finding.where else ""
        word = label(_SEVERITIES[finding.severity])
        colour = SEVERITY[finding.severity]
        found.append(FindingText(finding.severity, word, colour, *finding_words(finding), where, finding))
    return tuple(found)


_SEVERITIES = {"error": "report-severity-error", "warning": "report-severity-warning", "info": "report-severity-info"}


def as_plain(value: Any) -> Any:
    """A model as lists, texts and objects that say their kind; drawings as svg elements, findings left out."""
    if isinstance(value, Figure):
        return {"kind": "Figure", "name": value.name, "svg": value.svg(), "width": value.width}
    if is_dataclass(value) and not isinstance(value, type):
        own = {one.name: as_plain(getattr(value, one.name)) for one in fields(value) if one.name != "finding"}
        return {"kind": type(value).__name__, **own}
    return [as_plain(one) for one in value] if isinstance(value, (tuple, list)) else value
