"""The verification: length errors with their uncertainties, statistics, budget and all measured lengths."""

import math

import numpy as np
from matplotlib.axes import Axes

from spherecal.verify.verification_file import BUDGET_PARTS, BarReport, BarRow, LengthRow
from spherecal_documents.report.document import Cell, Column, Document
from spherecal_documents.report.language import label, written
from spherecal_documents.report.sections_bars import bar_sections
from spherecal_documents.report.sheet import PageBox, Sheet, shortened
from spherecal_documents.report.style import ACCENT, BAD, CAUTION, INK, MARKS, NONE, RULE, SMALL_PT, TINY_PT, TO, number
from spherecal_documents.report.tables import add_section
from spherecal_documents.report.verdict_page import add_finding, sorted_findings, verification_verdict
from spherecal_rigs.result_folder import Result

_IN_A_PLOT = 10  # lengths side by side
_EXPANDED = 2.0  # where the decision states no coverage factor


def add_bars_pages(document: Document, result: Result) -> None:
    """The verification with reference bars; nothing where there was none."""
    bars = result.bars
    if bars is None:
        return
    document.begin_section(label("report-verification-with-reference-bars"))
    word, colour, sentence = verification_verdict(result)
    document.y += 4.5
    document.sheet.text(document.left, document.y, word, 11.0, bold=True, colour=colour)
    document.y += 1.5
    document.paragraph(sentence)
    document.caption(label("report-rule", rule=written(bars.rule)))
    if bars.measured:
        document.caption(label("report-error-measured-minus-reference-length"))
        keys = ordered_lengths(bars)
        if bars.procedure is not None and bars.procedure.acceptance is not None:
            document.caption(label("report-amber-lines-the-limit-amber"))
        for start in range(0, len(keys), _IN_A_PLOT):
            draw_errors(document.sheet, document.box(88.0), bars, keys[start : start + _IN_A_PLOT])
            document.y += 3.0
        _statistics(document, bars)
        if bars.procedure is None or not bars.procedure.budgets:
            _budget(document, bars)
    sections = {section.key: section for section in bar_sections(result)}
    for key in ("bar-cameras", "conformity", "budget", "artefacts", "temperatures", "departures"):
        add_section(document, sections.get(key))
    if bars.findings:
        document.begin_section(label("report-findings-of-the-verification"), 20.0, new_page=False)
        for finding in sorted_findings(bars.findings):
            add_finding(document, finding)
    _measured(document, bars)


def ordered_lengths(bars: BarReport) -> list[tuple[str, str, str]]:
    """The certified lengths that were measured, the shortest first."""
    nominal: dict[tuple[str, str, str], float] = {}
    for row in bars.measured:
        nominal.setdefault(row.key, row.reference_mm)
    return sorted(nominal, key=lambda key: (nominal[key], key))


def draw_errors(sheet: Sheet, box: PageBox, bars: BarReport, keys: list[tuple[str, str, str]]) -> None:
    """Each measured length as a mark with its uncertainty, by certified length; the mean beside them.

    `keys` (bar, start, end).
    """
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
        ticks.append(f"{shortened(_name(key), slot, TINY_PT)}\n{reference:.0f} mm")
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


def _statistics(document: Document, bars: BarReport) -> None:
    reference = {row.key: row.reference_mm for row in reversed(bars.measured)}
    columns = [
        Column(label("report-length"), 42.0, "left"),
        Column(label("report-reference-mm"), 24.0),
        Column("n", 12.0),
        Column(label("report-mean-error-mm"), 22.0),
        Column(label("report-sd-mm"), 20.0),
        Column(label("report-largest-error-mm"), 24.0),
        Column(label("report-u-of-the-mean-mm"), 22.0),
        Column("k", 9.0),
    ]
    rows: list[list[Cell]] = [
        [
            _name(x.key),
            number(reference.get(x.key), 3),
            str(x.n),
            number(x.mean_error_mm, 4, sign=True),
            number(x.sd_mm, 4),
            number(x.max_abs_error_mm, 4),
            number(x.expanded_mm, 4),
            number(x.coverage_factor, 2),
        ]
        for x in _by_length(bars)
    ]
    rows.append(
        [
            (label("report-all"), INK),
            "",
            str(bars.n),
            number(bars.mean_error_mm, 4, sign=True),
            number(bars.sd_mm, 4),
            number(bars.max_abs_error_mm, 4),
            "",
            "",
        ]
    )
    document.table(columns, rows)


def _by_length(bars: BarReport) -> list[LengthRow]:
    """The statistics in the order of the plot."""
    place = {key: i for i, key in enumerate(ordered_lengths(bars))}
    return sorted(bars.lengths, key=lambda x: (place.get(x.key, len(place)), x.key))


def _name(key: tuple[str, str, str]) -> str:
    bar, start, end = key
    return f"{bar} {start}{TO}{end}"


def _budget(document: Document, bars: BarReport) -> None:
    lengths = [x for x in _by_length(bars) if any(part is not None for part in x.budget_mm)]
    if not lengths:
        return
    document.begin_section(label("report-uncertainty-sources"), 30.0, new_page=False)
    document.caption(label("report-standard-uncertainties-k-1-of"))
    columns = [Column(label("report-length"), 42.0, "left"), *(Column(f"{part}\nmm", 26.0) for part in BUDGET_PARTS)]
    rows: list[list[Cell]] = []
    for x in lengths:
        largest = max((part for part in x.budget_mm if part is not None), default=None)
        cells: list[Cell] = [
            (number(part, 4), INK) if part is not None and part == largest else number(part, 4) for part in x.budget_mm
        ]
        rows.append([_name(x.key), *cells])
    document.table(columns, rows)


def _measured(document: Document, bars: BarReport) -> None:
    if not bars.measured:
        return
    document.begin_section(label("report-all-measured-lengths"), 40.0, new_page=False)
    document.caption(label("report-views-the-number-of-cameras"))
    columns = [
        Column(label("report-pose"), 26.0, "left"),
        Column(label("report-length"), 36.0, "left"),
        Column(label("report-measured-mm"), 25.0),
        Column(label("report-reference-mm"), 25.0),
        Column(label("report-error-mm"), 20.0),
        Column("u (k = 1)\nmm", 18.0),
        Column(label("report-error-u"), 14.0),
        Column(label("report-views"), 11.0),
    ]
    rows: list[list[Cell]] = []
    for row in bars.measured:
        error = number(row.error_mm, 4, sign=True)
        broken = (row.pose, row.start, row.end) in bars.exceeding
        ratio = number(row.error_mm / row.u_mm, 1, sign=True) if row.u_mm else NONE
        rows.append(
            [
                row.pose,
                _name(row.key),
                number(row.length_mm, 4),
                number(row.reference_mm, 4),
                (error, BAD) if broken else error,
                number(row.u_mm, 4),
                ratio,
                str(row.views),
            ]
        )
    document.table(columns, rows, SMALL_PT)
