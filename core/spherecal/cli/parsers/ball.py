"""The options of `ball`."""

import argparse
from datetime import date

from spherecal.cli.parsers.shared import output, path, result, word
from spherecal.cli.parsing import Add, commands_below


def add_ball(add: Add) -> None:
    """`spherecal ball export|show`."""
    ball = add("ball", "Ball profiles: the shape of your ball, so that later calibrations need fewer placements.")
    action = commands_below(ball)
    export = action("export", "Keep the ball's shape that a calibration found (form rigid), for `calibrate --ball`.")
    result(export)
    output(export, "ball.json", "the ball profile to write")
    word(export, "--name", None, "such as the ball's serial number", default="")
    export.add_argument("--date", type=_date, metavar="YYYY-MM-DD", help="of the calibration (default: rig.json's own)")
    path(export, "--session", "SESSION", "its targets are then checked at every use")
    path(action("show", "What a ball profile holds."), "ball", "ball.json", "the ball profile, or a result folder")


def _date(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError("a date is written as 2026-05-31") from None
