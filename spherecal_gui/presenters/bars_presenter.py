"""Bars: their certificates, which poses are taken, where to lay the next one, the lengths and their errors."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import SpherecalError
from spherecal_files.json_file import read_json
from spherecal_gui.languages import Cell, figure, translate, word
from spherecal_gui.rig_scenes import RigPlanes
from spherecal_gui.standing import Level, worst

if TYPE_CHECKING:  # imports scipy
    from spherecal.data.session import Bar, Certificate
    from spherecal_files.bar_registry import RegisteredBar
    from spherecal_files.verification_file import BarReport
    from spherecal_rigs.pose_plan import PlannedPose
    from spherecal_verify.limit import Acceptance


def pose_name(pose: str, poses: Sequence[str]) -> str:
    """What a pose is called: its number, whatever the plan calls it."""
    return translate("Bars", "Pose {number} of {count}").format(number=list(poses).index(pose) + 1, count=len(poses))


def next_pose(poses: Sequence[str], taken: Mapping[str, str]) -> str | None:
    """The first pose that is not taken."""
    return next((pose for pose in poses if pose not in taken), None)


@dataclass(frozen=True, eq=False)
class Errors:
    """The errors of all measured lengths, each (n,) mm."""

    names: tuple[str, ...]
    errors: FloatArray
    allowed: FloatArray  # by their uncertainty: k u
    exceeding: tuple[bool, ...]  # those that break the rule
    permitted: FloatArray | None = None  # by the limit that somebody gave
    guard: FloatArray | None = None  # U at that limit


def errors_of(bars: "BarReport") -> Errors:
    """The errors of a verification (report.verification_file)."""
    factor = bars.coverage_factor or 2.0
    names = tuple(f"{bar.pose}\n{bar.from_mark}-{bar.to_mark}" for bar in bars.measured)
    errors = np.array([bar.error_mm for bar in bars.measured])
    allowed = np.array([factor * (bar.u_mm or 0.0) for bar in bars.measured])
    acceptance = _acceptance(bars)
    if acceptance is None:
        return Errors(names, errors, allowed, tuple(map(bars.broken, bars.measured)))
    permitted = np.array([acceptance.limit.at(bar.reference_mm) for bar in bars.measured])
    expanded = {row.key: row.expanded_uncertainty_mm for row in acceptance.lengths}
    guard = np.array([expanded.get(bar.key, 0.0) for bar in bars.measured])
    return Errors(names, errors, allowed, tuple((np.abs(errors) - guard > permitted).tolist()), permitted, guard)


def _acceptance(bars: "BarReport") -> "Acceptance | None":
    return bars.procedure.acceptance if bars.procedure is not None else None


def length_cells(bars: "BarReport") -> list[tuple[str, ...]]:
    """The table: one row for each certified length."""

    def cell(value: float | None, digits: int = 3, sign: bool = False) -> str:
        if value is None:
            return "-"
        value = round(value, digits) + 0.0  # no negative zero
        return f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"

    acceptance = _acceptance(bars)
    decided = {row.key: row for row in acceptance.lengths} if acceptance is not None else {}
    rows = []
    for row in bars.lengths:
        own = decided.get(row.key)
        limit, said = (own.limit_mm, word("decisions", own.verdict, own.verdict)) if own is not None else (None, "-")
        name = f"{row.bar} {row.from_mark}-{row.to_mark}"
        figures = (row.sd_mm, row.max_abs_error_mm, row.expanded_uncertainty_mm, limit)
        rows.append((name, str(row.n), cell(row.mean_error_mm, sign=True), *map(cell, figures), said))
    return rows


def camera_cells(bars: "BarReport") -> list[list[tuple[str, Cell, str]]]:
    """The table of cameras: views of marks, those used, how they fit, their states."""
    levels = {"verified": "good", "not seen": "caution", "rejected": "bad"}
    rows = []
    for c in bars.cameras:
        state = word("marks", c.state)
        views = [(str(count), float(count), "") for count in (c.seen, c.used)]
        rows.append([(c.id, c.id, ""), *views, figure(c.rms_px, 3), (state, state, levels[c.state])])
    return rows


def rule_text(bars: "BarReport") -> str:
    """How the plot is to be read, and by what rule it was decided."""
    acceptance = _acceptance(bars)
    grey = translate("Verify", "Grey: what the uncertainty of each error allows.")
    if acceptance is None:
        return grey
    limit = translate("Verify", "Red lines: the limit {limit}; amber: its guard band. Decided by ISO 14253-1.")
    return f"{limit.format(limit=acceptance.limit.words())} {grey}"


def budget_cells(bars: "BarReport") -> list[tuple[str, ...]]:
    """The budget of each length: its contributions, the largest first, and what would help most."""
    rows = []
    for budget in bars.procedure.budgets if bars.procedure is not None else ():
        message = translate("Verify", "all together (k = {k:.1f}: U = {u:.3f} mm)")
        name = f"{budget.bar} {budget.from_mark}-{budget.to_mark}"
        parts = sorted((one for one in budget.contributions if one.share > 0), key=lambda one: -one.share)
        remedy = word("remedies", parts[0].name, "") if parts else ""
        whole = message.format(k=budget.coverage_factor, u=budget.expanded_mm)
        rows.append((name, whole, f"{budget.combined_mm:.4f}", "100 %", remedy))
        rows += [
            ("", word("contributions", one.name, one.name), f"{one.standard_mm:.4f}", f"{100 * one.share:.0f} %", "")
            for one in parts
        ]
    return rows


# The part of a way that must be upright for "up" or "down" to say it better than a camera's name.
_UPRIGHT = 0.7


@dataclass(frozen=True)
class BarGuide:
    """One pose to lay: `text` is the one sentence, `accepted` whether the bar lies as asked."""

    pose: str
    accepted: bool
    text: str
    level: Level


def bar_guide(planes: RigPlanes, pose: "PlannedPose", ends_mm: FloatArray | None, still: bool | None) -> BarGuide:
    """What to do about a pose, first and last mark of the bar being at `ends_mm` (2, 3); None: not found."""
    from spherecal_rigs.pose_plan import ACCEPT_MM, judge_pose  # imports scipy

    answer = judge_pose(pose, ends_mm)
    level: Level = "caution"
    if ends_mm is None or not np.isfinite(ends_mm).all():
        text = lay_text(pose)
    elif answer.off_mm > ACCEPT_MM:
        way = (pose.start_mm + pose.end_mm) / 2 - ends_mm.mean(axis=0)
        text = _move_text(planes, pose.bar, way, ends_mm.mean(axis=0))
    elif not answer.accepted:
        text = translate("Bars", "Turn bar {bar} by {deg:.0f}°: from near {first} to near {last}")
        text = text.format(bar=pose.bar, deg=answer.off_deg, first=pose.near[0], last=pose.near[1])
    elif not still:
        text = translate("Bars", "It is in place. Wait until it is at rest")
    else:
        text, level = translate("Bars", "Ready: press space"), "good"
    return BarGuide(pose.id, answer.accepted, text, level)


def lay_text(pose: "PlannedPose") -> str:
    """Where the bar goes."""
    if pose.near[0] == pose.near[1]:
        text = translate("Bars", "Lay bar {bar} as in the picture, near {first}")
    else:
        text = translate("Bars", "Lay bar {bar} as in the picture: from near {first} to near {last}")
    return text.format(bar=pose.bar, first=pose.near[0], last=pose.near[1])


def _move_text(planes: RigPlanes, bar: str, way: FloatArray, place: FloatArray) -> str:
    """How far and which way, in 10 mm: up or down, or towards a camera."""
    up = float(planes.axes[2] @ way)
    size = float(np.linalg.norm(way))
    if abs(up) > _UPRIGHT * size:
        up_text = translate("Bars", "Move bar {bar} {mm:.0f} mm up")
        down_text = translate("Bars", "Move bar {bar} {mm:.0f} mm down")
        return (up_text if up > 0 else down_text).format(bar=bar, mm=round(size, -1))
    to = planes.centres - place
    towards = planes.names[int(np.argmax(to @ way / np.linalg.norm(to, axis=1)))]
    text = translate("Bars", "Move bar {bar} {mm:.0f} mm towards {camera}")
    return text.format(bar=bar, mm=round(size, -1), camera=towards)


def pose_columns(poses: Sequence[str]) -> list[list[str]]:
    """The poses by line, in their order: those of one line share what is before the dash."""
    columns: dict[str, list[str]] = {}
    for pose in poses:
        columns.setdefault(pose.rpartition("-")[0], []).append(pose)
    return list(columns.values())


# Imported inside functions: sessions and bars take 15 ms, for which the window does not wait.
_LEVELS: dict[str, Level] = {
    "no-certificate": "caution", "expired": "bad", "expires-soon": "caution", "not-yet": "caution",
    "unlimited": "none", "ok": "good",
}  # fmt: skip


def state_words(certificate: "Certificate | None", today: date) -> tuple[str, Level]:
    """The state of a certificate in a few words, and the colour of that. `certificate` None where it has none."""
    from spherecal_verify.expiry import expiry

    said = expiry(certificate, today)
    until = certificate.valid_until if certificate is not None else None
    state = said[0] if said is not None else "ok" if until is not None else "unlimited"
    begun = certificate.date if certificate is not None else None
    return word("certificates", state, date=begun if state == "not-yet" else until), _LEVELS[state]


def reminder(bars: "Iterable[Bar | RegisteredBar]", today: date) -> tuple[str, Level]:
    """One sentence about the bars whose certificate has expired or soon will, and its colour; empty where none has."""
    from spherecal_files.bar_registry import RegisteredBar
    from spherecal_verify.expiry import expiry

    names: dict[str, list[str]] = {"expired": [], "not-yet": [], "expires-soon": []}
    for bar in bars:
        said = expiry(bar.certificate, today)
        if said is not None and said[0] in names:
            words, _ = state_words(bar.certificate, today)
            name = bar.serial if isinstance(bar, RegisteredBar) else bar.serial or bar.id
            names[said[0]].append(f"{name} ({words})")
    notes: list[tuple[Level, str]] = [
        (_LEVELS[state], word("reminders", state, bars=own)) for state, own in names.items() if own
    ]
    return " ".join(text for _, text in notes), worst(level for level, _ in notes)


def bench_reminder(bench: Path, today: date) -> tuple[str, Level]:
    """Of the bars on the rig's bench; where none was described, of all bars of the library."""
    from spherecal_files.bar_registry import BAR_REGISTRY
    from spherecal_files.read_bars import read_bars
    from spherecal_rigs.ball_registry import FORMAT, VERSION

    bars: Iterable[Bar | RegisteredBar] = ()
    try:
        if bench.is_file():
            f = read_json(bench, FORMAT, VERSION).fields((), ("bars",))
            bars = read_bars(f["bars"])[0] if "bars" in f else ()
        else:
            bars = BAR_REGISTRY.read().values()
    except SpherecalError:  # it is named where the bench is used; the start page comes up all the same
        return "", "none"
    return reminder(bars, today)
