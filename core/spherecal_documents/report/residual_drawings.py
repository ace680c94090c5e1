"""Drawings of residuals, of bars' errors and of the uncertainty of lengths."""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path

from spherecal.base.arrays import FloatArray
from spherecal.geometry.length_uncertainty import LengthMap
from spherecal_documents.report.language import label
from spherecal_documents.report.model import TEXT_MM, Block, Figure, Panels, Paragraph
from spherecal_documents.report.style import (
    ACCENT,
    BAD,
    CAUTION,
    INK,
    MARKS,
    NONE,
    RULE,
    SIZES,
    SMALL_PT,
    SOFT,
    TINY_PT,
    TO,
    PageBox,
    Sheet,
    count,
    number,
    shortened,
    significant,
    text_width,
)
from spherecal_files.verification_file import BarReport, BarRow
from spherecal_rigs.result_folder import Result
from spherecal_verify.verification import LengthStatistics

_GAP_MM = 4.0  # between panels
_ARROWS_PER_MM2 = 0.55  # beyond them nothing is seen any more
_SHADES = 16
_TYPICAL_ARROW = 0.035  # of the image's diagonal, for a residual as large as 95 % of all are


@dataclass(frozen=True)
class ArrowScale:
    """How residuals are drawn: magnification, and the size in px at which the colour is darkest."""

    factor: float
    darkest_px: float


def residual_blocks(result: Result) -> tuple[Block, ...]:
    """The histogram of all residuals, then a panel of residual vectors for each camera."""
    if not result.residuals.used.any():
        return (Paragraph(label("report-no-observation-was-used-so")),)
    # one magnification for all cameras: 1, 2 or 5 times a power of ten
    residuals = result.residuals
    sizes = np.linalg.norm(residuals.du_dv[residuals.used], axis=1)
    large = max(float(np.quantile(sizes, 0.95)), 1e-9)
    diagonal = float(np.median([np.hypot(*camera.image_size) for camera in result.rig.cameras]))
    factor = _TYPICAL_ARROW * diagonal / large
    power = 10.0 ** np.floor(np.log10(factor))
    rounded = float(max(step * power for step in (1, 2, 5) if step * power <= factor))
    scale = ArrowScale(rounded, max(float(np.quantile(sizes, 0.99)), 1e-9))
    cameras = result.rig.cameras
    columns = 2 if len(cameras) <= 4 else 3 if len(cameras) <= 9 else 4
    width = (TEXT_MM - (columns - 1) * _GAP_MM) / columns
    height = min(width * max(camera.image_size[1] / camera.image_size[0] for camera in cameras), 70.0) + 5.0
    panels = [
        Figure(camera.id, height, partial(_draw_panel, name=camera.id, result=result, scale=scale), width)
        for camera in cameras
    ]
    left_out = int((~result.residuals.used & np.isfinite(result.residuals.du_dv[:, 0])).sum())
    crosses = label("report-crosses", count=count(left_out)) if left_out else ""
    times = count(int(scale.factor)) if scale.factor >= 1 else significant(scale.factor, 1)
    return (
        Figure(label("report-distribution-of-du-and-dv"), 52.0, partial(_draw_histogram, result=result)),
        Paragraph(label("report-arrows", times=times, crosses=crosses), "note"),
        Figure(label("report-size-of-the-residual-px"), 9.0, partial(_draw_key, scale=scale)),
        Panels(tuple(panels), columns),
    )


def _draw_key(sheet: Sheet, box: PageBox, scale: ArrowScale) -> None:
    """A bar of the colours with its numbers."""
    axes = sheet.axes(PageBox(box.x + 32.0, box.y + 0.5, 60.0, 2.6))
    axes.imshow(
        np.linspace(0, 1, 128)[None],
        aspect="auto",
        cmap=SIZES,
        extent=(0, scale.darkest_px, 0, 1),
        interpolation="none",
    )
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.tick_params(axis="x", pad=1.0)
    axes.locator_params(axis="x", nbins=6)
    sheet.text(box.x, box.y + 2.8, label("report-size-of-the-residual-px"), TINY_PT)
    note = label("report-99-of-all-are-smaller", px=significant(scale.darkest_px))
    sheet.text(box.x + 96.0, box.y + 2.8, note, TINY_PT, colour=SOFT)


def _draw_panel(sheet: Sheet, box: PageBox, name: str, result: Result, scale: ArrowScale) -> None:
    """One camera's residual vectors in its image; left out ones are crosses, of very many some are drawn."""
    camera = result.rig.camera(name)
    assert camera is not None
    width, height = camera.image_size
    inner = box.inset(0.2, 5.0, 0.2, 0.2)
    drawn_width = min(inner.width, inner.height * width / height)
    inner = PageBox(inner.x, inner.y, drawn_width, drawn_width * height / width)
    mark = " *" if name == result.rig.reference_camera else ""
    title = shortened(name, 0.5 * inner.width, SMALL_PT, bold=True) + mark
    sheet.text(box.x, box.y + 3.2, title, SMALL_PT, bold=True)
    axes = sheet.axes(inner, xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(visible=True, color=RULE, linewidth=0.6)
    residuals = result.residuals
    facts = f"{number(camera.rms_px, 3)} px, n = {count(camera.observations)}"
    own = residuals.rows_of.get(name, np.empty(0, dtype=np.int64))
    own = own[np.isfinite(residuals.predicted[own, 0])]
    rows = own[residuals.used[own]]
    most = int(_ARROWS_PER_MM2 * inner.width * inner.height)
    if len(rows) > most:
        rows = rows[np.linspace(0, len(rows) - 1, most).astype(int)]
    room = inner.width - text_width(title, SMALL_PT, bold=True) - 2.0
    sheet.text(inner.x + inner.width, box.y + 3.2, shortened(facts, room, TINY_PT), TINY_PT, colour=SOFT, align="right")
    _arrows(axes, residuals.predicted[rows], residuals.du_dv[rows], scale, width / inner.width)
    left_out = own[~residuals.used[own] & np.isfinite(residuals.du_dv[own, 0])]
    places = (residuals.predicted - residuals.du_dv)[left_out]
    axes.plot(*places.T, linestyle="none", marker="x", markersize=2.8, markeredgewidth=0.6, color=INK)


def _arrows(axes: Axes, start: FloatArray, du_dv: FloatArray, scale: ArrowScale, px_per_mm: float) -> None:
    """Lines with heads of a fixed size on paper, large ones on top; one path for all of a shade keeps files small."""
    size = np.linalg.norm(du_dv, axis=1, keepdims=True)
    along = du_dv / np.maximum(size, 1e-12)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    tip = start + scale.factor * du_dv
    head = np.minimum(0.75 * px_per_mm, 0.6 * scale.factor * size)
    foot = tip - head * along
    corners = np.stack([tip, foot + 0.38 * head * across, foot - 0.38 * head * across, tip], axis=1)
    shade = np.minimum(size[:, 0] / scale.darkest_px * _SHADES, _SHADES - 1).astype(int)
    for i in np.unique(shade).tolist():
        own, colour = shade == i, SIZES((i + 0.5) / _SHADES)
        for places, codes, width in (
            (np.stack([start, foot], axis=1), [Path.MOVETO, Path.LINETO], 0.4),
            (corners, [Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], 0.0),
        ):
            path = Path(places[own].reshape(-1, 2), np.tile(codes, int(own.sum())))
            axes.add_artist(
                PathPatch(
                    path, fill=width == 0, facecolor=colour, edgecolor=colour if width else "none", linewidth=width
                )
            )


def _draw_histogram(sheet: Sheet, box: PageBox, result: Result) -> None:
    """How du and dv are distributed, beside the normal distribution of the same spread."""
    sheet.text(box.x, box.y + 3.4, label("report-distribution-of-du-and-dv"), SMALL_PT, bold=True)
    values = result.residuals.du_dv[result.residuals.used]
    sd = max(float(np.sqrt((values**2).mean())), 1e-12)
    reach = 4.0 * sd
    edges = np.linspace(-reach, reach, 65)
    middles = (edges[1:] + edges[:-1]) / 2
    axes = sheet.axes(box.inset(14.0, 6.0, 62.0, 9.0))
    for column, colour, line in ((0, ACCENT, "-"), (1, BAD, "--")):
        heights, _ = np.histogram(values[:, column], edges)
        axes.stairs(heights, edges, color=colour, linestyle=line, linewidth=0.9)
    curve = np.exp(-0.5 * (middles / sd) ** 2) / (sd * np.sqrt(2 * np.pi)) * len(values) * (edges[1] - edges[0])
    axes.plot(middles, curve, color=SOFT, linewidth=0.8, linestyle=":")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(0, None)
    axes.set_xlabel(label("report-residual-predicted-minus-observed-px"), labelpad=2.0)
    axes.set_ylabel(label("report-observations"), labelpad=2.0)
    axes.locator_params(nbins=6)
    _histogram_numbers(sheet, PageBox(box.x + box.width - 58.0, box.y + 6.0, 58.0, box.height), values, sd, reach)


def _histogram_numbers(sheet: Sheet, box: PageBox, values: FloatArray, sd: float, reach: float) -> None:
    entries = ((ACCENT, "-", "du", values[:, 0]), (BAD, "--", "dv", values[:, 1]))
    axes = sheet.axes(PageBox(box.x, box.y, 8.0, 15.5), xlim=(0, 1), ylim=(15.5, 0))
    axes.set_axis_off()
    for i, (colour, line, name, column) in enumerate(entries):
        axes.plot([0, 1], [2.2 + 5 * i] * 2, color=colour, linestyle=line, linewidth=1.1)
        mean, sd_own = (number(float(f(column)), 4) for f in (np.mean, np.std))
        numbers = label("report-mean-sd", name=name, mean=mean, sd=sd_own)
        sheet.text(box.x + 10.0, box.y + 3.1 + 5 * i, numbers, TINY_PT)
    axes.plot([0, 1], [12.2] * 2, color=SOFT, linestyle=":", linewidth=1.1)
    sheet.text(box.x + 10.0, box.y + 13.1, label("report-normal-sd-px", sd=number(sd, 4)), TINY_PT)
    sizes = np.linalg.norm(values, axis=1)
    beyond = int((np.abs(values) > reach).any(axis=1).sum())
    facts = [
        label("report-observations-used", count=count(len(values))),
        label("report-half-are-smaller-than-px", px=significant(float(np.median(sizes)))),
        label("report-95-are-smaller-than-px", px=significant(float(np.quantile(sizes, 0.95)))),
        label("report-largest-px", px=significant(float(sizes.max()), 3)),
        label("report-beyond-px-not-drawn", beyond=count(beyond), reach=significant(reach)),
    ]
    sheet.lines(box.x, box.y + 20.5, facts, TINY_PT, SOFT)


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


def _draw_length(
    axes: Axes, at: int, rows: list[BarRow], length: LengthStatistics | None, k: float, bars: BarReport
) -> float:
    """One certified length's errors; how far they reach from zero."""
    places = at + (np.linspace(-0.38, 0.14, len(rows)) if len(rows) > 1 else np.array([-0.1]))
    reach = 0.0
    for x, row in zip(places.tolist(), rows, strict=True):
        colour, mark, size = (BAD, "X", 5.0) if bars.broken(row) else (ACCENT, "o", 2.8)
        spread = k * (row.u_mm or 0.0)
        axes.plot([x, x], [row.error_mm - spread, row.error_mm + spread], color=colour, linewidth=0.7, alpha=0.75)
        axes.plot(x, row.error_mm, marker=mark, markersize=size, color=colour, markeredgewidth=0)
        reach = max(reach, abs(row.error_mm) + spread)
    if length is not None and length.mean_error_mm is not None:
        spread = length.expanded_uncertainty_mm or 0.0
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


_LAYER_GAP_MM = 3.0  # between layers


def length_map_figure(found: LengthMap) -> Figure | None:
    """The map as a drawing; None where its places are no cube."""
    worst = _layers(found)
    if worst is None:
        return None
    height = (TEXT_MM - _LAYER_GAP_MM * (len(worst) - 1)) / len(worst) + 7.0
    return Figure(label("report-uncertainty-in-the-volume"), height, partial(_draw_layers, worst=worst, found=found))


def _layers(found: LengthMap) -> FloatArray | None:
    """The worst over the directions at each place, (n, n, n) by the map's axes; None for no cube of places."""
    side = round(len(found.places_mm) ** (1 / 3))
    if side**3 != len(found.places_mm) or side < 2:
        return None
    seen = np.isfinite(found.expanded_mm)
    worst = np.where(seen.any(axis=1), np.where(seen, found.expanded_mm, -np.inf).max(axis=1), np.nan)
    return worst.reshape(side, side, side)


def _draw_layers(sheet: Sheet, box: PageBox, worst: FloatArray, found: LengthMap) -> None:
    """The layers side by side, numbers in the squares; `worst` (n, n, n) mm."""
    side = len(worst)
    low, high = (float(f(worst[np.isfinite(worst)])) if np.isfinite(worst).any() else 1.0 for f in (np.min, np.max))
    height = (
        (found.places_mm - found.places_mm.mean(axis=0)) @ found.directions[2] if len(found.directions) > 2 else None
    )
    for k, panel in enumerate(box.inset(0, 5.0, 0, 2.0).grid(1, side, _LAYER_GAP_MM)):
        name = label("report-layer", number=k + 1)
        if height is not None:
            name = f"Z {number(float(height.reshape(worst.shape)[0, 0, k]), 0, sign=True)} mm"
        sheet.text(panel.x, box.y + 3.2, name, TINY_PT, colour=SOFT)
        size = min(panel.width, panel.height)
        axes = sheet.axes(PageBox(panel.x, panel.y, size, size), xlim=(0, side), ylim=(side, 0), xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set(visible=True, color=RULE, linewidth=0.5)
        for i in range(side):
            for j in range(side):
                value = float(worst[i, j, k])
                if not np.isfinite(value):
                    axes.text(i + 0.5, j + 0.6, NONE, fontsize=TINY_PT, ha="center", va="center", color=SOFT)
                    continue
                shade = (value - low) / (high - low) if high > low else 0.0
                axes.add_patch(Rectangle((i, j), 1, 1, facecolor=SIZES(shade), linewidth=0))
                ink = "white" if shade > 0.3 else INK
                text = f"{value:.3f}".lstrip("0") if value < 10 else f"{value:.0f}"
                axes.text(
                    i + 0.5, j + 0.55, text, fontsize=min(SMALL_PT - 2.4, 4.6), ha="center", va="center", color=ink
                )
