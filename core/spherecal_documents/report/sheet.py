"""A page to draw on: all places in millimetres from the top left corner, x right, y down."""

import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from matplotlib.textpath import text_to_path

from spherecal_documents.report.style import BODY_PT, INK, RULE

PAGE_SIZES_MM = {"A4": (210.0, 297.0), "Letter": (215.9, 279.4)}
MM_PER_PT = 25.4 / 72
_MM_PER_INCH = 25.4

Align = Literal["left", "center", "right"]


def text_width(text: str, size_pt: float, bold: bool = False) -> float:
    """The width of a line of text in millimetres."""
    prop = FontProperties(size=size_pt, weight="bold" if bold else "normal")
    return text_to_path.get_text_width_height_descent(text, prop, ismath=False)[0] * MM_PER_PT if text else 0.0


# Letters that are set one after the other, each with an advance of its own, whatever is beside it.
_ONE_BY_ONE = re.compile(r"[ -~\xa0-\u02ff\u0370-\u058f\u2010-\u2027\u2030-\u22ff\u2e80-\u9fff\uff00-\uffef]*")


def fits(text: str, width_mm: float, size_pt: float, bold: bool = False) -> bool:
    """Whether the width of a line of text is at most `width_mm`; to lay it out takes longest, most need not be."""
    if _ONE_BY_ONE.fullmatch(text) and widest(text, size_pt, bold) <= width_mm:
        return True
    return text_width(text, size_pt, bold) <= width_mm


def widest(text: str, size_pt: float, bold: bool = False) -> float:
    """A bound of the width of a line of such letters, mm: their advances, and room for kerning and for what overhangs."""
    fonts = (*rcParams["font.family"], *rcParams["font.sans-serif"])
    return size_pt * (1.05 * sum(_advance(letter, bold, fonts) for letter in text) + 0.3 * MM_PER_PT)


@lru_cache(maxsize=4096)
def _advance(letter: str, bold: bool, _fonts: tuple[str, ...]) -> float:
    """The advance of a letter, mm for a type of 1 pt."""
    return text_width(f"|{letter}|", 1.0, bold) - text_width("||", 1.0, bold)


# A Chinese character is a word of its own; marks that end a phrase (commas, stops, closing brackets) stay with it,
# those that begin one go with the next.
_CHINESE, _BEGINS = r"\u2e80-\u9fff\uff00-\uffef", r"\uff08\u300a\u201c"
_ENDS = r"\uff0c\u3002\uff1b\uff1a\u3001\uff09\u300b\u201d\uff01\uff1f"
_WORD = re.compile(rf"[{_BEGINS}]*[{_CHINESE}][{_ENDS}]*|(?:(?![{_CHINESE}{_BEGINS}])\S)+[{_ENDS}]*|[{_BEGINS}]|\s+")


def wrap(text: str, width_mm: float, size_pt: float, bold: bool = False) -> list[str]:
    """The text in lines of at most this width; a word too long for a line is cut."""
    lines: list[str] = []
    line, gap = "", ""
    for word in _WORD.findall(text):
        if word.isspace():
            gap = " "
            continue
        longer = f"{line}{gap}{word}" if line else word
        gap = ""
        if fits(longer, width_mm, size_pt, bold):
            line = longer
            continue
        if line:
            lines.append(line)
        *full, line = _cut(word, width_mm, size_pt, bold)
        lines += full
    return [one for one in (*lines, line) if one]


def _cut(word: str, width_mm: float, size_pt: float, bold: bool) -> list[str]:
    pieces = [""]
    for letter in word:
        if pieces[-1] and not fits(pieces[-1] + letter, width_mm, size_pt, bold):
            pieces.append("")
        pieces[-1] += letter
    return pieces


def shortened(text: str, width_mm: float, size_pt: float, bold: bool = False) -> str:
    """The text, or its beginning and an ellipsis, within this width."""
    if fits(text, width_mm, size_pt, bold):
        return text
    most = bisect_right(range(len(text)), width_mm, key=lambda n: text_width(text[:n] + "…", size_pt, bold)) - 1
    return text[: max(most, 0)].rstrip() + "…"


@dataclass(frozen=True)
class PageBox:
    """A rectangle on a page in millimetres: left, top, width, height."""

    x: float
    y: float
    width: float
    height: float

    def inset(self, left: float, top: float = 0.0, right: float = 0.0, bottom: float = 0.0) -> "PageBox":
        """A smaller box inside this one.

        `left`, `top`, `right`, `bottom`: room between their sides, mm.
        """
        return PageBox(self.x + left, self.y + top, self.width - left - right, self.height - top - bottom)

    def grid(self, rows: int, columns: int, gap: float = 4.0) -> list["PageBox"]:
        """Equal boxes row by row with gaps between them.

        `gap`: between them, mm.
        """
        width = (self.width - gap * (columns - 1)) / columns
        height = (self.height - gap * (rows - 1)) / rows
        return [
            PageBox(self.x + column * (width + gap), self.y + row * (height + gap), width, height)
            for row in range(rows)
            for column in range(columns)
        ]


class Sheet:
    """A figure of a given size with drawing in millimetres."""

    def __init__(self, width_mm: float, height_mm: float) -> None:
        self.width, self.height = width_mm, height_mm
        self.figure = Figure(figsize=(width_mm / _MM_PER_INCH, height_mm / _MM_PER_INCH))

    def text(
        self,
        x: float,
        y: float,
        text: str,
        size_pt: float = BODY_PT,
        bold: bool = False,
        colour: str = INK,
        align: Align = "left",
    ) -> None:
        """A line of text with its base line at y; dollars are dollars.

        `x`, `y`: where it begins, mm.
        """
        self.figure.add_artist(
            Text(
                x / self.width,
                1 - y / self.height,
                text,
                fontsize=size_pt,
                fontweight="bold" if bold else "normal",
                color=colour,
                horizontalalignment=align,
                verticalalignment="baseline",
                parse_math=False,
                transform=self.figure.transFigure,
            )
        )

    def lines(self, x: float, y: float, lines: Sequence[str], size_pt: float = BODY_PT, colour: str = INK) -> float:
        """Lines of text below each other, the first with its base line at y; where the next base line would be.

        `x`, `y`: where the first line begins, mm.
        """
        for line in lines:
            self.text(x, y, line, size_pt, colour=colour)
            y += leading(size_pt)
        return y

    def rule(self, x0: float, x1: float, y: float, colour: str = RULE, width_pt: float = 0.5) -> None:
        """A horizontal line.

        `x0`, `x1`: its ends, mm; `y`: its height on the page, mm from the top.
        """
        place = ([x0 / self.width, x1 / self.width], [1 - y / self.height] * 2)
        self.figure.add_artist(Line2D(*place, color=colour, linewidth=width_pt, transform=self.figure.transFigure))

    def fill(self, box: PageBox, colour: str) -> None:
        """A filled rectangle."""
        left_foot = (box.x / self.width, 1 - (box.y + box.height) / self.height)
        size = (box.width / self.width, box.height / self.height)
        self.figure.add_artist(
            Rectangle(left_foot, *size, facecolor=colour, edgecolor="none", transform=self.figure.transFigure)
        )

    def axes(self, box: PageBox, **settings: Any) -> Axes:
        """Axes whose data area fills the box."""
        place = (
            box.x / self.width, 1 - (box.y + box.height) / self.height,
            box.width / self.width, box.height / self.height,
        )  # fmt: skip
        return self.figure.add_axes(place, **settings)


def leading(size_pt: float) -> float:
    """The distance of base lines of this size of type, mm."""
    return size_pt * 1.38 * MM_PER_PT
