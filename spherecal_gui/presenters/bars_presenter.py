"""Bar poses: which are taken, what the cameras see of the bar, the lengths and their errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal_gui.coverage import Level
from spherecal_gui.languages import translate

if TYPE_CHECKING:  # imports scipy
    from spherecal_files.verification_file import BarReport
    from spherecal_verify.limit import Acceptance


def pose_name(pose: str, poses: Sequence[str]) -> str:
    """What a pose is called: its number, whatever the plan calls it."""
    return translate("Bars", "Pose {number} of {count}").format(number=list(poses).index(pose) + 1, count=len(poses))


def next_pose(poses: Sequence[str], taken: Mapping[str, str]) -> str | None:
    """The first pose that is not taken."""
    return next((pose for pose in poses if pose not in taken), None)


@dataclass(frozen=True, eq=False)
class Errors:
    """The errors (n,) mm of all measured lengths with what their uncertainty allows (n,) = k u, and their names.

    `permitted` (n,) and `guard` (n,) are the limit that somebody gave and U at it, both None without such a limit.
    `exceeding` are those that break the rule.
    """

    names: tuple[str, ...]
    errors: FloatArray
    allowed: FloatArray
    exceeding: tuple[bool, ...]
    permitted: FloatArray | None = None
    guard: FloatArray | None = None


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
        limit, word = (own.limit_mm, decision_word(own.verdict)) if own is not None else (None, "-")
        name = f"{row.bar} {row.from_mark}-{row.to_mark}"
        figures = (row.sd_mm, row.max_abs_error_mm, row.expanded_uncertainty_mm, limit)
        rows.append((name, str(row.n), cell(row.mean_error_mm, sign=True), *map(cell, figures), word))
    return rows


def camera_cells(bars: "BarReport") -> list[tuple[str, ...]]:
    """The table of cameras: views of marks, those used, how they fit."""
    words = {
        "verified": translate("Verify", "verified"),
        "not seen": translate("Verify", "saw no mark"),
        "rejected": translate("Verify", "contradicts the others"),
    }
    return [
        (c.id, str(c.seen), str(c.used), "-" if c.rms_px is None else f"{c.rms_px:.3f}", words[c.state])
        for c in bars.cameras
    ]


def camera_levels(bars: "BarReport") -> list[Level]:
    """The colours of the cameras' states."""
    levels: dict[str, Level] = {"verified": "good", "not seen": "caution", "rejected": "bad"}
    return [levels[c.state] for c in bars.cameras]


def decision_word(decision: str) -> str:
    """A decision against a limit, for people."""
    return {
        "pass": translate("Verify", "pass"),
        "fail": translate("Verify", "fail"),
        "cannot tell": translate("Verify", "cannot tell"),
    }.get(decision, decision)


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
        remedy = remedy_text(parts[0].name) if parts else ""
        whole = message.format(k=budget.coverage_factor, u=budget.expanded_mm)
        rows.append((name, whole, f"{budget.combined_mm:.4f}", "100 %", remedy))
        rows += [
            ("", contribution_name(one.name), f"{one.standard_mm:.4f}", f"{100 * one.share:.0f} %", "") for one in parts
        ]
    return rows


def contribution_name(name: str) -> str:
    """A contribution of the budget, for people."""
    return {
        "certificate": translate("Verify", "the bar's certificate"),
        "thermometer": translate("Verify", "the thermometer"),
        "expansion": translate("Verify", "the bar's expansion"),
        "calibration": translate("Verify", "the cameras' calibration"),
        "scale": translate("Verify", "the scale"),
        "centring": translate("Verify", "the marks' centres"),
        "repeatability": translate("Verify", "repeatability"),
        "resolution": translate("Verify", "the certificate's digits"),
    }.get(name, name)


def remedy_text(name: str) -> str:
    """What makes a contribution smaller."""
    marks = translate("Verify", "show the marks to more cameras, larger and sharper")
    return {
        "certificate": translate("Verify", "a bar with a better certificate"),
        "thermometer": translate("Verify", "a better thermometer, on the bar itself"),
        "expansion": translate("Verify", "measure nearer to the bar's reference temperature"),
        "calibration": translate("Verify", "more placements of the ball, spread over the volume"),
        "scale": translate("Verify", "the scale from a certified bar, in more poses"),
        "centring": marks,
        "repeatability": marks,
        "resolution": translate("Verify", "enter the certificate's lengths with all digits"),
    }.get(name, "")
