"""Charts by themselves: a profile's trend, and where to put the ball next."""

import io
from pathlib import Path
from textwrap import wrap

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig
from spherecal_documents.report import style
from spherecal_documents.report.model import svg_of
from spherecal_documents.report.pdf import sheet_pdf
from spherecal_documents.report.rig_view import OBLIQUE, TOP, Projection, choose_axes
from spherecal_files.atomic import write_file_whole
from spherecal_rigs.next_placement import Guidance
from spherecal_rigs.trend import Trend, TrendSeries

_WIDTH_MM, _MARGIN_MM = 180.0, 6.0
_PANEL_MM, _GAP_MM = 37.0, 9.0
_CAMERAS_MM = 62.0
_MOST_NAMED = 12
_ENDINGS = (".pdf", ".svg")
_TITLES = {"calibration": "trend", "check": "trend of the quick checks"}
_OF_CAMERAS = {
    "calibration": "Each camera's rays in the volume, rms shift [mm]",
    "check": "Shift of a point by each camera's own move, largest [mm]",
}


def write_trend_chart(trend: Trend, output: Path) -> None:
    """Write the chart as .pdf or .svg, whole."""
    ending = output.suffix.lower()
    if ending not in _ENDINGS:
        raise InputError(Phrase("error-chart-kind", {"file": output}))
    with style.report_style():
        rows = len(trend.series)
        height = 16.0 + rows * (_PANEL_MM + _GAP_MM) + _CAMERAS_MM + 18.0
        sheet = style.Sheet(_WIDTH_MM, height)
        width = _WIDTH_MM - 2 * _MARGIN_MM
        sheet.text(
            _MARGIN_MM,
            7.0,
            style.shortened(f"Rig {trend.profile}: {_TITLES[trend.kind]}", width, style.HEADING_PT, True),
            style.HEADING_PT,
            bold=True,
        )
        since = f"calibration {trend.ids[0]}, {trend.times[0]:%Y-%m-%d %H:%M} UTC"
        against = (
            f"Changes since {since}" if trend.kind == "calibration" else "Against the calibration in use at the time"
        )
        sheet.text(
            _MARGIN_MM,
            12.0,
            f"{against}. Dashed: control limits (median ± 3.14 median moving ranges); crosses lie outside.",
            style.SMALL_PT,
            colour=style.SOFT,
        )
        y = 16.0
        for series in trend.series:
            _panel(sheet, style.PageBox(_MARGIN_MM, y, width, _PANEL_MM + _GAP_MM), series, trend)
            y += _PANEL_MM + _GAP_MM
        _cameras(sheet, style.PageBox(_MARGIN_MM, y, width, _CAMERAS_MM + 12.0), trend)
        data = (
            sheet_pdf(sheet)
            if ending == ".pdf"
            else f"<?xml version='1.0' encoding='utf-8'?>\n{svg_of(sheet, 'path')}".encode()
        )
    write_file_whole(output, data)


def _axes(sheet: style.Sheet, box: style.PageBox, title: str, trend: Trend) -> Axes:
    sheet.text(box.x, box.y + 3.5, title, style.BODY_PT, bold=True)
    axes = sheet.axes(box.inset(14.0, 5.5, 2.0, 10.0), xlim=(-0.4, len(trend.ids) - 0.6))
    step = max(1, -(-len(trend.ids) // 16))
    places = list(range(0, len(trend.ids), step))
    axes.set_xticks(places, [f"{trend.ids[i]}\n{trend.times[i]:%d.%m.}" for i in places])
    return axes


def _panel(sheet: style.Sheet, box: style.PageBox, series: TrendSeries, trend: Trend) -> None:
    title = f"{series.name[0].upper()}{series.name[1:]} [{series.unit}]"
    axes = _axes(sheet, box, title, trend)
    x = np.arange(len(trend.ids))
    good = np.isfinite(series.values)
    axes.plot(x[good], series.values[good], color=style.ACCENT, marker="o", markersize=2.8, linewidth=0.8)
    outside = series.outside
    axes.plot(x[outside], series.values[outside], color=style.BAD, marker="X", markersize=6.0, linestyle="none")
    if series.limits is None:
        return
    axes.axhline(series.limits.centre, color=style.SOFT, linewidth=0.6)
    for value, text in ((series.limits.low, "lower limit"), (series.limits.high, "upper limit")):
        axes.axhline(value, color=style.BAD, linewidth=0.6, linestyle=(0, (4, 2)))
        axes.annotate(
            f"{text} {style.significant(value, 3)}", (0.005, value), xycoords=("axes fraction", "data"),
            xytext=(0, 1.5), textcoords="offset points", ha="left", fontsize=style.TINY_PT, color=style.BAD,
        )  # fmt: skip
    axes.margins(y=0.25)


def _cameras(sheet: style.Sheet, box: style.PageBox, trend: Trend) -> None:
    axes = _axes(sheet, box.inset(0.0, 0.0, 0.0, 6.0), _OF_CAMERAS[trend.kind], trend)
    # those whose rays moved most are named, the others stay grey
    known = [series for series in trend.cameras if np.isfinite(series.values).any()]
    named = sorted(known, key=lambda series: -float(np.nanmax(series.values)))[:_MOST_NAMED]
    x = np.arange(len(trend.ids))
    for series in trend.cameras:
        if series not in named:
            axes.plot(x, series.values, color=style.SOFT, linewidth=0.4)
    for i, series in enumerate(named):
        colour = style.SERIES[i % len(style.SERIES)]
        mark = style.MARKS[(i + i // len(style.SERIES)) % len(style.MARKS)]
        axes.plot(x, series.values, color=colour, marker=mark, markersize=2.5, linewidth=0.8, label=series.name)
        outside = series.outside
        axes.plot(x[outside], series.values[outside], color=style.BAD, marker="X", markersize=6.0, linestyle="none")
    if named:
        axes.legend(loc="upper left", ncols=6, fontsize=style.TINY_PT, frameon=False, labelcolor=style.INK)
        axes.set_ylim(0, 1.35 * float(np.nanmax(named[0].values)) or 1e-3)


_CAMERA, _PAST, _BEST = "#33475b", "#8a949e", "#c8500a"
_DPI = 150


def save_guidance_picture(rig: Rig, guidance: Guidance, radius_mm: float, path: Path) -> None:
    """The next placement's candidates, tilted and from above, coloured by what they give: PNG, 1800 x 840 px."""
    centres = np.array([camera.centre_mm for camera in rig.cameras])
    every = np.vstack([centres, guidance.placements_mm])
    axes = choose_axes(rig.cameras, centres, every)[0]
    middle = every.mean(axis=0)

    def flat(view: Projection, places: FloatArray) -> FloatArray:
        return view.flat((places - middle) @ axes.T)

    with style.report_style():
        figure, panels = plt.subplots(1, 2, figsize=(12, 5.6), dpi=_DPI)
        figure.subplots_adjust(left=0.02, right=0.98, bottom=0.02, top=0.84, wspace=0.05)
        shown = None
        for panel, view in zip(panels, (OBLIQUE, TOP), strict=True):
            _plot_cameras(panel, rig, flat(view, centres))
            for name, at in zip(guidance.placements, flat(view, guidance.placements_mm), strict=True):
                panel.add_patch(Circle(tuple(at), radius_mm, fill=False, ec=_PAST, lw=1.5))
                panel.annotate(name, tuple(at), ha="center", va="center", color=_PAST, fontsize=11)
            if guidance.candidates:
                shown = _candidates(panel, guidance, flat, view, radius_mm)
            panel.set_aspect("equal")
            panel.set_title(view.name, fontsize=12, color=style.INK)
            panel.autoscale_view()
            panel.set_axis_off()
        if shown is not None:
            bar = figure.colorbar(shown, ax=panels, shrink=0.7, pad=0.02)
            bar.set_label("a 500 mm length after it, k = 2, mm", fontsize=11)
        figure.suptitle("\n".join(wrap(guidance.words(), 100)), fontsize=13, color=style.INK)
        file = io.BytesIO()
        figure.savefig(file, format="png", metadata={"Software": None})
        plt.close(figure)
        write_file_whole(path, file.getvalue())


def _plot_cameras(panel: Axes, rig: Rig, at: FloatArray) -> None:
    panel.plot(at[:, 0], at[:, 1], "^", color=_CAMERA, ms=9)
    for camera, place in zip(rig.cameras, at, strict=True):
        panel.annotate(camera.id, tuple(place), xytext=(0, 8), textcoords="offset points", ha="center", fontsize=10)


def _candidates(panel: Axes, guidance: Guidance, flat, view: Projection, radius_mm: float):
    """One mark a place, coloured by its best turn; the ball at the best place with the axis it is turned about."""
    best_at: dict[tuple[float, ...], float] = {}
    for c in guidance.candidates:
        key = tuple(c.centre_mm)
        best_at[key] = min(best_at.get(key, np.inf), c.expanded_mm)
    at = flat(view, np.array(list(best_at)))
    shown = panel.scatter(at[:, 0], at[:, 1], c=list(best_at.values()), cmap="viridis_r", s=90, zorder=3)
    best = guidance.candidates[0]
    middle = flat(view, best.centre_mm[None])[0]
    panel.add_patch(Circle(tuple(middle), radius_mm, fill=False, ec=_BEST, lw=3))
    if best.axis is not None:
        tip = flat(view, (best.centre_mm + 1.3 * radius_mm * best.axis)[None])[0]
        panel.annotate("", tuple(tip), tuple(middle), arrowprops={"arrowstyle": "->", "color": _BEST, "lw": 2})
        note = f"turn {best.turn_deg:.0f} deg\nabout this axis"
        above = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5}
        panel.annotate(
            note, tuple(tip), xytext=(6, -14), textcoords="offset points", color=_BEST, fontsize=10, bbox=above
        )
    return shown
