"""How the report looks: colours that colour-blind readers and grey printers keep apart, type sizes, numbers."""

import logging
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.typing import RcKeyType

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
    """Our settings on top of matplotlib's own, whatever the user's matplotlibrc says; all is restored afterwards.

    Letters that the font lacks become boxes without a warning, and the fonts' subsetting stays out of the log.
    """
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
    """A number with this many significant digits, without an exponent where it is of an everyday size.

    An en dash where there is none.
    """
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
