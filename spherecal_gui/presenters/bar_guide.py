"""Where to lay the check bar and whether it lies there, in words."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal_gui.coverage import Level
from spherecal_gui.languages import translate
from spherecal_gui.rig_scenes import RigPlanes

if TYPE_CHECKING:
    from spherecal_rigs.pose_plan import PlannedPose, PoseAnswer

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
    from spherecal_rigs.pose_plan import judge_pose  # imports scipy

    answer = judge_pose(pose, ends_mm)
    text, level = _text(planes, pose, ends_mm, answer, still)
    return BarGuide(pose.id, answer.accepted, text, level)


def _text(
    planes: RigPlanes, pose: "PlannedPose", ends_mm: FloatArray | None, answer: "PoseAnswer", still: bool | None
) -> tuple[str, Level]:
    from spherecal_rigs.pose_plan import ACCEPT_MM  # imports scipy

    if ends_mm is None or not np.isfinite(ends_mm).all():
        return lay_text(pose), "caution"
    if answer.off_mm > ACCEPT_MM:
        way = (pose.start_mm + pose.end_mm) / 2 - ends_mm.mean(axis=0)
        return _move_text(planes, pose.bar, way, ends_mm.mean(axis=0)), "caution"
    if not answer.accepted:
        text = translate("Bars", "Turn bar {bar} by {deg:.0f}°: from near {first} to near {last}")
        return text.format(bar=pose.bar, deg=answer.off_deg, first=pose.near[0], last=pose.near[1]), "caution"
    if not still:
        return translate("Bars", "It is in place. Wait until it is at rest"), "caution"
    return translate("Bars", "Ready: press space"), "good"


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
