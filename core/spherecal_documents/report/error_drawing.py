"""The errors of measured lengths, drawn with their uncertainties and the limit."""

import math
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from spherecal.verify.verification_file import BarReport, BarRow, LengthRow
from spherecal_documents.report.language import label
from spherecal_documents.report.model import Figure
from spherecal_documents.report.sheet import PageBox, Sheet, shortened
from spherecal_documents.report.style import ACCENT, BAD, CAUTION, INK, MARKS, RULE, TINY_PT, TO

_IN_A_PLOT = 10  # lengths side by side
_EXPANDED = 2.0  # where the decision states no coverage factor


def lengths_in_order(bars: BarReport) -> list[tuple[str, str, str]]:
    """The certified lengths that were measured, the shortest first."""
    nominal: dict[tuple[str, str, str], float] = {}
    for row in bars.measured:
        nominal.setdefault(row.key, row.reference_mm)
    return sorted(nominal, key=lambda key: (nominal[key], key))


def name_of(key: tuple[str, str, str]) -> str:
    """A certified length's name: bar and both marks."""
    bar, start, end = key
    return f"{bar} {start}{TO}{end}"


def error_figures(bars: BarReport) -> list[Figure]:
    """The measured errors by certified length, in as many drawings as it takes."""
    keys, name = lengths_in_order(bars), label("report-length-errors")
    parts = [keys[start : start + _IN_A_PLOT] for start in range(0, len(keys), _IN_A_PLOT)]
    return [Figure(name, 88.0, partial(_draw_errors, bars=bars, keys=part)) for part in parts]


def _draw_errors(sheet: Sheet, box: PageBox, bars: BarReport, keys: list[tuple[str, str, str]]) -> None:
    """Each measured length as a mark with its uncertainty, by certified length; the mean beside them."""
    k = bars.coverage_factor or _EXPANDED
    axes = sheet.axes(box.inset(15.0, 7.0, 0.0, 12.0))
    axes.axhline(0, color=INK, linewidth=0.8)
    reach = 0.0
    statistics = {length.key: length for length in bars.lengths}
    ticks = []
    slot = (box.width - 15.0) / max(len(keys), 3) - 1.0
    for i, key in enumerate(keys):
        rows = [row for row in bars.measured if row.key == key]
        if i:
            axes.axvline(i - 0.5, color=RULE, linewidth=0.5)
        reach = max(reach, _draw_length(axes, i, rows, statistics.get(key), k, bars), _draw_limit(axes, i, key, bars))
        reference = float(np.mean([row.reference_mm for row in rows]))
        ticks.append(f"{shortened(name_of(key), slot, TINY_PT)}\n{reference:.0f} mm")
    axes.set_xlim(-0.5, max(len(keys), 3) - 0.5)
    axes.set_ylim(-1.06 * reach, 1.06 * reach)
    axes.set_xticks(range(len(keys)))
    axes.set_xticklabels(ticks, parse_math=False)
    axes.tick_params(axis="x", length=0, pad=3)
    axes.grid(axis="y", color="#e3e6ea", linewidth=0.4)
    axes.set_ylabel(label("report-length-error-mm"), labelpad=2.0)
    _key(sheet, box, k)


def _draw_limit(axes: Axes, at: int, key: tuple[str, str, str], bars: BarReport) -> float:
    """The user's limit as a solid line, and inside it the guard band by U in which nothing is proven."""
    acceptance = bars.procedure.acceptance if bars.procedure is not None else None
    row = next((x for x in acceptance.lengths if x.key == key), None) if acceptance is not None else None
    if row is None:
        return 0.0
    for sign in (-1, 1):
        inner, outer = (sign * (row.limit_mm + band * row.expanded_uncertainty_mm) for band in (-1, 1))
        axes.fill_between([at - 0.46, at + 0.46], [inner] * 2, [outer] * 2, color=CAUTION, alpha=0.16, linewidth=0)
        axes.plot([at - 0.46, at + 0.46], [sign * row.limit_mm] * 2, color=CAUTION, linewidth=1.2)
    return row.limit_mm + row.expanded_uncertainty_mm


def _draw_length(axes: Axes, at: int, rows: list[BarRow], length: LengthRow | None, k: float, bars: BarReport) -> float:
    """One certified length's errors; how far they reach from zero."""
    places = at + (np.linspace(-0.38, 0.14, len(rows)) if len(rows) > 1 else np.array([-0.1]))
    reach = 0.0
    for x, row in zip(places.tolist(), rows, strict=True):
        broken = (row.pose, row.start, row.end) in bars.exceeding
        colour, mark, size = (BAD, "X", 5.0) if broken else (ACCENT, "o", 2.8)
        spread = k * (row.u_mm or 0.0)
        axes.plot([x, x], [row.error_mm - spread, row.error_mm + spread], color=colour, linewidth=0.7, alpha=0.75)
        axes.plot(x, row.error_mm, marker=mark, markersize=size, color=colour, markeredgewidth=0)
        reach = max(reach, abs(row.error_mm) + spread)
    if length is not None and length.mean_error_mm is not None:
        spread = length.expanded_mm or 0.0
        ends = [length.mean_error_mm - spread, length.mean_error_mm + spread]
        axes.plot([at + 0.33] * 2, ends, color=INK, linewidth=2.0, solid_capstyle="butt")
        axes.plot(at + 0.33, length.mean_error_mm, marker=MARKS[3], markersize=4.5, color=INK, markeredgecolor="white")
        reach = max(reach, *map(abs, ends))
    return reach if math.isfinite(reach) and reach > 0 else 1e-3


def _key(sheet: Sheet, box: PageBox, k: float) -> None:
    axes = sheet.axes(PageBox(box.x + 15.0, box.y, box.width - 15.0, 5.0), xlim=(0, box.width - 15.0), ylim=(5, 0))
    axes.set_axis_off()
    entries = (
        (ACCENT, "o", 2.8, 0.7, label("report-one-pose-u-the-limit", k=k)),
        (BAD, "X", 5.0, 0.7, label("report-beyond-the-limit")),
        (INK, MARKS[3], 4.5, 2.0, label("report-mean-of-the-poses-u")),
    )
    for x, (colour, mark, size, line, text) in zip((1.5, 66.0, 95.0), entries, strict=True):
        axes.plot([x, x], [0.8, 4.2], color=colour, linewidth=line)
        axes.plot(x, 2.5, marker=mark, markersize=size, color=colour, markeredgewidth=0)
        sheet.text(box.x + 15.0 + x + 2.5, box.y + 3.3, text, TINY_PT)
