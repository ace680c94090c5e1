"""`spherecal bars plan`: where to lay a bar to verify a rig."""

import argparse

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.files.bar_registry import find_bar
from spherecal.files.read_session import read_session
from spherecal.verify.pose_plan import LEAST_LENGTHS, LINE_NAMES, BarMarks, PosePlan, plan_poses
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_rigs.rig_source import read_source, volume_of


def plan(options: argparse.Namespace) -> int:
    """`spherecal bars plan`."""
    if (options.serial is None) == (options.session is None):
        raise InputError(Phrase("error-bar-or-session"))
    if options.session is None:
        known = [find_bar(options.serial, options.registry)]
        marks = [BarMarks.of(bar.serial, bar.lengths) for bar in known]
    else:
        marks = [BarMarks.of(bar.id, bar.lengths) for bar in read_session(options.session).bars if bar.role == "check"]
    source = read_source(options.result)
    box = volume_of(source)
    plan = plan_poses(source.rig, marks, (box.low_mm, box.high_mm))
    answer(options, plan.as_json())
    say(*_plan_text(plan))
    return DONE


def _plan_text(plan: PosePlan) -> list[str]:
    half = 2 * plan.box.half
    lines = [
        f"Volume {half[0]:.0f} x {half[1]:.0f} x {half[2]:.0f} mm, space diagonal {plan.box.diagonal_mm:.0f} mm.",
    ]
    for pose in plan.poses:
        start, end = (", ".join(f"{x:.0f}" for x in place) for place in (pose.start_mm, pose.end_mm))
        weak = "" if pose.good else "  (two cameras only at a mark)"
        lines.append(
            f"{pose.id}  bar {pose.bar} on {LINE_NAMES[pose.line]}: from near {pose.near[0]} to near {pose.near[1]}, "
            f"({start}) to ({end}) mm; {counted(len(pose.cameras), 'camera')} in sight of all of it{weak}"
        )
    short = [f"{n} ({c})" for n, c in zip(LINE_NAMES, plan.lengths_on_line, strict=True) if c < LEAST_LENGTHS]
    if short:
        lines.append(f"Fewer than {LEAST_LENGTHS} lengths on: {', '.join(short)}.")
    if plan.cameras_left_out:
        names = ", ".join(plan.cameras_left_out)
        lines.append(f"No place in the volume shows a whole bar to {names} and another camera.")
    if plan.missing:
        lines.append(f"No place seen by two cameras on: {', '.join(plan.missing)}.")
    return lines
