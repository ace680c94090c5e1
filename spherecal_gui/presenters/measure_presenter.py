"""Live measurement for the window: values in words, the points that can be chosen, what is wrong."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from spherecal_gui import languages
from spherecal_gui.coverage import Level
from spherecal_gui.languages import translate
from spherecal_measuring.measuring_task import Ruler, parse_point

if TYPE_CHECKING:  # imports scipy
    from spherecal.data.session import Bar
    from spherecal_measuring.measured_sets import MeasuredSet


@dataclass(frozen=True)
class ValueRow:
    """One value: its name, value and uncertainty with unit, deviation from its nominal value (empty without one)."""

    name: str
    value: str
    uncertainty: str
    deviation: str
    level: Level


def value_rows(measured: "MeasuredSet") -> list[ValueRow]:
    """The values of a set, k = 2; a deviation beyond its own expanded uncertainty is marked."""
    rows = []
    for v in measured.values:
        digits = 4 if v.unit == "deg" else 3
        unit = "°" if v.unit == "deg" else " mm"
        off, level = "", "none"
        if v.deviation is not None and v.u_deviation is not None:
            off = f"{round(v.deviation, digits) + 0.0:+.{digits}f} ± {2 * v.u_deviation:.{digits}f}{unit}"
            level = "good" if abs(v.deviation) <= 2 * v.u_deviation else "caution"
        rows.append(ValueRow(v.name, f"{v.value:.{digits}f}{unit}", f"{2 * v.u:.{digits}f}{unit}", off, level))
    return rows


def large_text(row: ValueRow) -> str:
    """The first value, large: what it is of, and how far off its nominal value it is, where it has one."""
    if not row.deviation:
        return f"{row.name}: {row.value}"
    return translate("Measure", "{name}: off by {deviation}").format(name=row.name, deviation=row.deviation)


def mark_ends(bar: "Bar") -> tuple[str, str]:
    """The names of the points of a bar's outermost marks."""
    longest = max(bar.lengths, key=lambda one: one.length_mm)
    first, last = (bar.marks[name] for name in (longest.from_mark, longest.to_mark))
    return str(first.target), str(last.target)


def point_names(measured: "MeasuredSet") -> tuple[str, ...]:
    """The points that were measured, by name."""
    return tuple(str(name) for name in measured.names)


def rulers_of(chosen: Sequence[str]) -> tuple[Ruler, ...]:
    """The distance of two chosen points, or the angle at the second of three; none for any other number."""
    if len(chosen) not in (2, 3):
        return ()
    return (Ruler(tuple(parse_point(name) for name in chosen)),)


def ruler_hint(chosen: Sequence[str]) -> str:
    """What choosing more or fewer points would give."""
    if len(chosen) < 2:
        return translate("Measure", "Choose two points for their distance, three for the angle at the second.")
    if len(chosen) > 3:
        return translate("Measure", "Choose two or three points, not more.")
    return ""


def trust_of(measured: "MeasuredSet", moved: Sequence[str]) -> tuple[str, Level]:
    """Whether cameras have moved, views contradict, or all is well."""
    if moved:
        text = translate("Measure", "Moved since the calibration: {cameras}. Check the rig before you measure on.")
        return text.format(cameras=languages.listed(moved)), "bad"
    if not measured.names:
        return translate("Measure", "No target is seen by two cameras."), "caution"
    wrong = [one for one in measured.contradictions if 2 * one.views >= one.of]
    if wrong and wrong[0].camera is not None:
        text = translate("Measure", "Target {target}: {camera} contradicts the other cameras.")
        return text.format(target=wrong[0].target, camera=wrong[0].camera), "caution"
    if wrong:
        text = translate("Measure", "Target {target}: its views contradict one another.")
        return text.format(target=wrong[0].target), "caution"
    return translate("Measure", "The cameras agree."), "good"


def pace_text(measured: "MeasuredSet", rate_hz: float | None) -> str:
    """Points, rate and latency in one line. `rate_hz` None: not known."""
    text = translate("Measure", "{points} points").format(points=len(measured.names))
    if rate_hz is not None:
        text += " · " + translate("Measure", "{rate:.1f} sets a second").format(rate=rate_hz)
    if measured.latency_s is not None:
        text += " · " + translate("Measure", "{ms:.0f} ms after the images").format(ms=1e3 * measured.latency_s)
    return text


def rate_of(times: Sequence[float]) -> float | None:
    """Sets a second over the newest ones; None for fewer than two."""
    newest = list(times)[-20:]
    span = newest[-1] - newest[0] if len(newest) > 1 else 0.0
    return (len(newest) - 1) / span if span > 0 else None
