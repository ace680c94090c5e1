"""Colours, fonts, sheets and the names beside marks of the report's drawings."""

import logging
import math
import warnings
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path
from matplotlib.typing import RcKeyType

from spherecal.base.arrays import FloatArray
from spherecal.base.resources import resource_path
from spherecal_documents.report.language import label, language_now

INK = "#1a1a1a"
SOFT = "#5f6368"  # captions, axes
RULE = "#c9ccd1"  # lines of tables

GOOD = "#005a46"  # dark bluish green
BAD = "#a63200"  # dark vermilion
CAUTION = "#8a6100"
NEUTRAL = "#41546b"
ACCENT = "#0067a5"

SEVERITY = {"error": BAD, "warning": CAUTION, "info": NEUTRAL}

# Okabe and Ito's colours, from dark to light so that neighbours differ in grey too, and marks that differ as well.
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#5b4a9e", "#56b4e9", "#e69f00", "#7a7a7a")
MARKS = ("o", "s", "^", "D", "v", "P", "X", "<")

# Small residuals are pale and large ones dark, in print without colour as well.
SIZES = LinearSegmentedColormap.from_list("sizes", ["#a8bed3", "#4f86b5", "#b0552a", "#571300"])

HEADING_PT, BODY_PT, SMALL_PT, TINY_PT = 11.0, 8.2, 7.0, 6.0

NONE = "\u2013"  # shown in a table where there is no number
TO = "\u2013"  # between two ends
_MINUS = "\u2212"
_FAMILY = "Inter"

# Of Windows, macOS and Linux; matplotlib takes the first face of a collection, which Noto calls JP.
_CHINESE_FONTS = (
    "Microsoft YaHei", "SimHei", "PingFang SC", "Hiragino Sans GB", "Heiti SC", "Arial Unicode MS", "Noto Sans SC",
    "Noto Sans CJK SC", "Noto Sans CJK JP", "Source Han Sans SC", "WenQuanYi Micro Hei", "WenQuanYi Zen Hei",
)  # fmt: skip

_CHINESE_FILES = (
    "msyh", "msyhbd", "simhei", "pingfang", "hiragino sans gb", "stheiti light", "arial unicode", "notosanssc-regular",
    "notosanssc-bold", "notosanscjk-regular", "notosanscjk-bold", "notosanscjksc-regular", "notosanscjksc-bold",
    "sourcehansanssc-regular", "sourcehansanssc-bold", "wqy-microhei", "wqy-zenhei",
)  # fmt: skip

_SETTINGS: dict[RcKeyType, Any] = {
    "font.size": SMALL_PT,
    "text.color": INK,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.labelsize": SMALL_PT,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": TINY_PT,
    "ytick.labelsize": TINY_PT,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "lines.linewidth": 0.8,
    "pdf.fonttype": 42,  # text in the file stays text
    "pdf.compression": 6,
    "path.simplify": False,
    "image.interpolation": "none",
    "savefig.dpi": "figure",
}


@cache
def chinese_fonts() -> tuple[str, ...]:
    """The first font with Chinese letters that this computer has, alone in a tuple; empty where it has none."""
    from matplotlib.font_manager import findSystemFonts, fontManager

    for known in (True, False):  # what matplotlib noted when it first ran, then what has been installed since
        if not known:
            for path in findSystemFonts():
                if Path(path).stem.lower() in _CHINESE_FILES:
                    fontManager.addfont(path)
        there = {font.name for font in fontManager.ttflist}
        if found := tuple(name for name in _CHINESE_FONTS if name in there):
            return found[:1]
    return ()


def font_families() -> list[str]:
    """The fonts of a report in its language; letter by letter the first that has it."""
    _add_own_fonts()
    return [_FAMILY, "DejaVu Sans", *(chinese_fonts() if language_now() == "zh_CN" else ())]


@cache
def _add_own_fonts() -> None:
    from matplotlib.font_manager import fontManager

    for path in sorted(resource_path("fonts").glob(f"{_FAMILY}-*.otf")):
        fontManager.addfont(path)


@contextmanager
def report_style() -> Iterator[None]:
    """Our settings on matplotlib's own, whatever its matplotlibrc says, and a quiet log; restored afterwards."""
    talkers = [logging.getLogger(name) for name in ("fontTools", "matplotlib.font_manager")]
    levels = [talker.level for talker in talkers]
    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        for talker in talkers:  # subsetting, and a font without a bold face
            talker.setLevel(logging.ERROR)
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_SETTINGS)
        matplotlib.rcParams["font.family"] = font_families()
        try:
            yield
        finally:
            for talker, level in zip(talkers, levels, strict=True):
                talker.setLevel(level)


def number(value: float | None, digits: int, sign: bool = False) -> str:
    """A number with fixed digits, a true minus, an en dash where there is none; never -0.00."""
    if value is None or not math.isfinite(value):
        return NONE
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    if not text.strip("+-0."):
        text = text.lstrip("+-")
    return text.replace("-", _MINUS)


def significant(value: float | None, digits: int = 2) -> str:
    """A number with so many significant digits, without an exponent where of everyday size; an en dash for none."""
    if value is None or not math.isfinite(value):
        return NONE
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits - 1}e}".replace("-", _MINUS) if decimals > 6 else number(value, decimals)


def count(value: int) -> str:
    """A whole number with narrow spaces between groups of three digits."""
    return f"{value:,}".replace(",", "\u202f") if abs(value) >= 10000 else str(value)


def some_of(names: tuple[str, ...] | list[str], most: int = 12) -> str:
    """The names, or the first of them and how many more there are."""
    if len(names) <= most:
        return ", ".join(names)
    return label("and-more", names=", ".join(names[:most]), more=len(names) - most)


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
        weight = "bold" if bold else "normal"
        at = x / self.width, 1 - y / self.height
        self.figure.text(*at, text, fontsize=size_pt, fontweight=weight, color=colour, ha=align, parse_math=False)

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


_DIRECTIONS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]], dtype=float)


_APART_MM = 0.3  # between names


class Labels:
    """Puts names into axes whose unit is `mm_per_unit` on paper; they avoid each other and the places given."""

    def __init__(self, axes: Axes, mm_per_unit: float, obstacles: FloatArray, bounds: FloatArray) -> None:
        self._axes, self._mm = axes, mm_per_unit
        self._obstacles = obstacles * mm_per_unit
        self._taken: list[FloatArray] = []  # left, low, right, high in mm
        self._bounds = bounds.ravel() * mm_per_unit
        self._flip = np.ones(2)
        self._ground: dict[str, Any] | None = {"facecolor": "white", "alpha": 0.65, "edgecolor": "none", "pad": 0.4}

    def over_image(self) -> None:
        """Take y as given to be the negative of the axes' y, since v goes down; no light ground behind the names."""
        self._flip = np.array([1.0, -1.0])
        self._ground = None

    def put(
        self,
        place: FloatArray,
        text: str,
        outwards: FloatArray,
        size_pt: float,
        colour: str,
        bold: bool = False,
        gap_mm: float = 1.2,
        always: bool = True,
    ) -> None:
        """A name near a place: on the side of `outwards` if there is room, otherwise where it covers least."""
        half = np.array([text_width(text, size_pt, bold), size_pt * MM_PER_PT * 0.9]) / 2
        best, best_cost = place * self._mm, np.inf
        length = float(np.linalg.norm(outwards))
        wanted = outwards / length if length > 0 else np.array([0.0, 1.0])
        reached = (np.abs(self._obstacles - best) < 2 * half + 3 * gap_mm + 1.0).all(axis=1)
        near = self._obstacles[reached]
        for reach in (1.0, 2.2):
            for direction in _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1)[:, None]:
                centre = place * self._mm + direction * (half + gap_mm * reach)
                cost = self._cost(centre, half, near) + 0.6 * (1 - float(direction @ wanted)) + 0.5 * (reach - 1)
                if cost < best_cost - 1e-9:
                    best, best_cost = centre, cost
        if not always and self._covers(best, half):
            return
        self._taken.append(np.concatenate([best - half, best + half]))
        x, y = best / self._mm * self._flip
        weight = "bold" if bold else "normal"
        self._axes.text(
            x, y, text, fontsize=size_pt, fontweight=weight, color=colour, ha="center", va="center", zorder=9,
            parse_math=False, bbox=self._ground, clip_on=True,
        )  # fmt: skip

    def _covers(self, centre: FloatArray, half: FloatArray) -> bool:
        """Whether a name there would cover another."""
        taken = np.array(self._taken).reshape(-1, 4)
        return bool(((centre + half > taken[:, :2]) & (centre - half < taken[:, 2:])).all(axis=1).any())

    def _cost(self, centre: FloatArray, half: FloatArray, obstacles: FloatArray) -> float:
        """How much a name there would cover, in areas of the name."""
        low, high = centre - half, centre + half
        cost = 0.0
        if self._taken:
            taken = np.array(self._taken)
            overlap = np.minimum(high, taken[:, 2:]) - np.maximum(low, taken[:, :2])
            areas = np.prod(np.maximum(overlap + _APART_MM, 0), axis=1)
            cost += float((areas > 0).sum()) + 4 * float(areas.sum() / np.prod(2 * half))
        if len(obstacles):
            cost += 0.35 * float(np.sqrt(((np.abs(obstacles - centre) < half + 0.4).all(axis=1)).sum()))
        outside = np.maximum(self._bounds[:2] - low, 0).sum() + np.maximum(high - self._bounds[2:], 0).sum()
        return cost + float(outside)
