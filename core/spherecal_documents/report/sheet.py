"""A page to draw on: all places in millimetres from the top left corner, x right, y down."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.text import Text
from matplotlib.textpath import text_to_path

from spherecal_documents.report.style import BODY_PT, INK

MM_PER_PT = 25.4 / 72
_MM_PER_INCH = 25.4

Align = Literal["left", "center", "right"]


def text_width(text: str, size_pt: float, bold: bool = False) -> float:
    """The width of a line of text in millimetres."""
    prop = FontProperties(size=size_pt, weight="bold" if bold else "normal")
    return text_to_path.get_text_width_height_descent(text, prop, ismath=False)[0] * MM_PER_PT if text else 0.0


def shortened(text: str, width_mm: float, size_pt: float, bold: bool = False) -> str:
    """The text, or its beginning and an ellipsis, within this width."""
    if text_width(text, size_pt, bold) <= width_mm:
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
        """A smaller box inside this one."""
        return PageBox(self.x + left, self.y + top, self.width - left - right, self.height - top - bottom)

    def grid(self, rows: int, columns: int, gap: float = 4.0) -> list["PageBox"]:
        """Equal boxes row by row with gaps between them."""
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
        """A line of text with its base line at y; dollars are dollars."""
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

    def lines(self, x: float, y: float, lines: Sequence[str], size_pt: float = BODY_PT, colour: str = INK) -> None:
        """Lines of text below each other, the first with its base line at y."""
        for i, line in enumerate(lines):
            self.text(x, y + i * size_pt * 1.38 * MM_PER_PT, line, size_pt, colour=colour)

    def axes(self, box: PageBox, **settings: Any) -> Axes:
        """Axes whose data area fills the box."""
        place = (
            box.x / self.width, 1 - (box.y + box.height) / self.height,
            box.width / self.width, box.height / self.height,
        )  # fmt: skip
        return self.figure.add_axes(place, **settings)
