"""Bar poses: which are taken, what the cameras see of the bar, the lengths and their errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from PySide6.QtCore import QCoreApplication

from spherecal.arrays import FloatArray
from spherecal_gui.presenters.coverage import Level

translate = QCoreApplication.translate

# A mark is found in space by two cameras; a third one shows when one of them is wrong.
LEAST_CAMERAS, GOOD_CAMERAS = 2, 3


@dataclass(frozen=True)
class PoseState:
    """How well the bar can be seen now: cameras that see at least two of its targets."""

    seeing: int
    text: str
    level: Level


def pose_state(targets: Mapping[str, int], taken: bool, taking: bool, name: str) -> PoseState:
    """What to do with a pose; `targets` seen now, by camera."""
    seeing = sum(count >= 2 for count in targets.values())
    if taking:
        return PoseState(seeing, translate("Bars", "Hold still: images are being taken"), "caution")
    if taken:
        return PoseState(seeing, translate("Bars", "{name} is taken").format(name=name), "good")
    if seeing < LEAST_CAMERAS:
        return PoseState(seeing, translate("Bars", "Lay the bar where two cameras or more see it"), "bad")
    if seeing < GOOD_CAMERAS:
        return PoseState(seeing, translate("Bars", "Only two cameras see the bar; three are better"), "caution")
    return PoseState(seeing, translate("Bars", "Ready: press space"), "good")


def next_pose(poses: Sequence[str], taken: Mapping[str, str]) -> str | None:
    """The first pose that is not taken."""
    return next((pose for pose in poses if pose not in taken), None)


@dataclass(frozen=True, eq=False)
class Errors:
    """The errors (n,) mm of all measured lengths with their limits (n,) = k u, names and whether they exceed."""

    names: tuple[str, ...]
    errors: FloatArray
    limits: FloatArray
    exceeding: tuple[bool, ...]


def errors_of(bars: Any) -> Errors:
    """The errors of a verification (report.verification_file)."""
    factor = bars.coverage_factor or 2.0
    return Errors(
        tuple(f"{bar.pose}\n{bar.start}-{bar.end}" for bar in bars.measured),
        np.array([bar.error_mm for bar in bars.measured]),
        np.array([factor * (bar.u_mm or 0.0) for bar in bars.measured]),
        tuple((bar.pose, bar.start, bar.end) in bars.exceeding for bar in bars.measured),
    )


def length_cells(bars: Any) -> list[tuple[str, ...]]:
    """The table: one row for each certified length."""

    def cell(value: float | None, digits: int = 3, sign: bool = False) -> str:
        return "-" if value is None else f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"

    return [
        (
            f"{row.bar} {row.start}-{row.end}", str(row.n), cell(row.mean_error_mm, sign=True), cell(row.sd_mm),
            cell(row.max_abs_error_mm), cell(row.expanded_mm),
        )
        for row in bars.lengths
    ]  # fmt: skip
