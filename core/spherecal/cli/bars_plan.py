"""`spherecal bars plan`: where to lay a bar to verify a rig."""

import argparse

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.cli.answer import answer
from spherecal.cli.console import say
from spherecal.cli.exit_codes import DONE
from spherecal.files.bar_registry import find_bar
from spherecal.files.read_session import read_session
from spherecal.profile.source import read_source, volume_of
from spherecal.verify.pose_plan import BarMarks, plan_poses, plan_words


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
    say(*plan_words(plan))
    return DONE
