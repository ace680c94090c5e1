"""`spherecal profile trend`: changes over a profile's history."""

import argparse
from math import isfinite

from spherecal_app.cli.answer import answer, plain_fields
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.output import to_output
from spherecal_rigs.store import open_profile
from spherecal_rigs.trend import Trend, TrendSeries, make_check_trend, make_trend, trend_table


def trend(options: argparse.Namespace) -> int:
    """`spherecal profile trend`."""
    trend = (make_check_trend if options.checks else make_trend)(open_profile(options.profile))
    if options.output is not None:
        from spherecal_documents.report.trend_chart import write_trend_chart  # here, since it loads matplotlib

        write_trend_chart(trend, options.output)
    if options.csv is not None:
        to_output(options.csv, trend_table(trend).encode())
    answer(options, _trend_entry(trend))
    if trend.verdicts:
        counts = ", ".join(f"{trend.verdicts.count(word)} {word}" for word in dict.fromkeys(trend.verdicts))
        say(f"{len(trend.verdicts)} checks: {counts}")
    for series in trend.series:
        last = next((value for value in reversed(series.values.tolist()) if isfinite(value)), None)
        limits = (
            "too few for limits" if series.limits is None else f"{series.limits.low:.4g} to {series.limits.high:.4g}"
        )
        beyond = f"; outside: {', '.join(trend.ids[i] for i in series.outside)}" if series.outside else ""
        shown = "-" if last is None else f"{last:.4g}"
        say(f"{series.name}: last {shown} {series.unit}, limits {limits}{beyond}")
    for camera in trend.cameras:
        if camera.outside:
            values = ", ".join(f"{trend.ids[i]} ({camera.values[i]:.3f} mm)" for i in camera.outside)
            what = "its rays are" if trend.kind == "calibration" else "its move is"
            say(f"camera {camera.name}: {what} outside the control limits in {values}")
    return DONE


def _trend_entry(trend: Trend) -> dict[str, object]:
    def entry(series: TrendSeries) -> dict[str, object]:
        outside = [trend.ids[i] for i in series.outside]
        return {**plain_fields(series), "outside": outside}

    return {
        "kind": trend.kind,
        "ids": trend.ids,
        "times": trend.times,
        "verdicts": trend.verdicts,
        "series": [entry(one) for one in trend.series],
        "cameras": [entry(one) for one in trend.cameras],
    }
