"""The trend as a page of vector graphics: a control chart a quantity, then the cameras."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal_documents.report.model import svg_of
from spherecal_documents.report.pdf import sheet_pdf
from spherecal_documents.report.sheet import PageBox, Sheet, shortened
from spherecal_documents.report.style import (
    ACCENT,
    BAD,
    BODY_PT,
    HEADING_PT,
    INK,
    MARKS,
    SERIES,
    SMALL_PT,
    SOFT,
    TINY_PT,
    report_style,
    significant,
)
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
    with report_style():
        sheet = _draw(trend)
        data = (
            sheet_pdf(sheet)
            if ending == ".pdf"
            else f"<?xml version='1.0' encoding='utf-8'?>\n{svg_of(sheet, 'path')}".encode()
        )
    write_file_whole(output, data)


def _draw(trend: Trend) -> Sheet:
    rows = len(trend.series)
    height = 16.0 + rows * (_PANEL_MM + _GAP_MM) + _CAMERAS_MM + 18.0
    sheet = Sheet(_WIDTH_MM, height)
    width = _WIDTH_MM - 2 * _MARGIN_MM
    sheet.text(
        _MARGIN_MM,
        7.0,
        shortened(f"Rig {trend.profile}: {_TITLES[trend.kind]}", width, HEADING_PT, True),
        HEADING_PT,
        bold=True,
    )
    since = f"calibration {trend.ids[0]}, {trend.times[0]:%Y-%m-%d %H:%M} UTC"
    against = f"Changes since {since}" if trend.kind == "calibration" else "Against the calibration in use at the time"
    sheet.text(
        _MARGIN_MM,
        12.0,
        f"{against}. Dashed: control limits (median ± 3.14 median moving ranges); crosses lie outside.",
        SMALL_PT,
        colour=SOFT,
    )
    y = 16.0
    for series in trend.series:
        _panel(sheet, PageBox(_MARGIN_MM, y, width, _PANEL_MM + _GAP_MM), series, trend)
        y += _PANEL_MM + _GAP_MM
    _cameras(sheet, PageBox(_MARGIN_MM, y, width, _CAMERAS_MM + 12.0), trend)
    return sheet


def _axes(sheet: Sheet, box: PageBox, title: str, trend: Trend) -> Axes:
    sheet.text(box.x, box.y + 3.5, title, BODY_PT, bold=True)
    axes = sheet.axes(box.inset(14.0, 5.5, 2.0, 10.0), xlim=(-0.4, len(trend.ids) - 0.6))
    step = max(1, -(-len(trend.ids) // 16))
    places = list(range(0, len(trend.ids), step))
    axes.set_xticks(places, [f"{trend.ids[i]}\n{trend.times[i]:%d.%m.}" for i in places])
    return axes


def _panel(sheet: Sheet, box: PageBox, series: TrendSeries, trend: Trend) -> None:
    title = f"{series.name[0].upper()}{series.name[1:]} [{series.unit}]"
    axes = _axes(sheet, box, title, trend)
    x = np.arange(len(trend.ids))
    good = np.isfinite(series.values)
    axes.plot(x[good], series.values[good], color=ACCENT, marker="o", markersize=2.8, linewidth=0.8)
    outside = series.outside
    axes.plot(x[outside], series.values[outside], color=BAD, marker="X", markersize=6.0, linestyle="none")
    if series.limits is None:
        return
    axes.axhline(series.limits.centre, color=SOFT, linewidth=0.6)
    for value, text in ((series.limits.low, "lower limit"), (series.limits.high, "upper limit")):
        axes.axhline(value, color=BAD, linewidth=0.6, linestyle=(0, (4, 2)))
        axes.annotate(
            f"{text} {significant(value, 3)}",
            (0.005, value),
            xycoords=("axes fraction", "data"),
            xytext=(0, 1.5),
            textcoords="offset points",
            ha="left",
            fontsize=TINY_PT,
            color=BAD,
        )
    axes.margins(y=0.25)


def _cameras(sheet: Sheet, box: PageBox, trend: Trend) -> None:
    axes = _axes(sheet, box.inset(0.0, 0.0, 0.0, 6.0), _OF_CAMERAS[trend.kind], trend)
    # those whose rays moved most are named, the others stay grey
    known = [series for series in trend.cameras if np.isfinite(series.values).any()]
    named = sorted(known, key=lambda series: -float(np.nanmax(series.values)))[:_MOST_NAMED]
    x = np.arange(len(trend.ids))
    for series in trend.cameras:
        if series not in named:
            axes.plot(x, series.values, color=SOFT, linewidth=0.4)
    for i, series in enumerate(named):
        colour = SERIES[i % len(SERIES)]
        mark = MARKS[(i + i // len(SERIES)) % len(MARKS)]
        axes.plot(x, series.values, color=colour, marker=mark, markersize=2.5, linewidth=0.8, label=series.name)
        outside = series.outside
        axes.plot(x[outside], series.values[outside], color=BAD, marker="X", markersize=6.0, linestyle="none")
    if named:
        axes.legend(loc="upper left", ncols=6, fontsize=TINY_PT, frameon=False, labelcolor=INK)
        axes.set_ylim(0, 1.35 * float(np.nanmax(named[0].values)) or 1e-3)
