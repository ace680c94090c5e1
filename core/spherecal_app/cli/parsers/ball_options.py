"""The options of `ball`."""

import argparse
from datetime import date

from spherecal_app.cli.parsers.shared import output, path, result, word
from spherecal_app.cli.parsing import Add, commands_below


def add_ball(add: Add) -> None:
    """`spherecal ball export|show`."""
    ball = add("ball", "Ball profiles: the shape of your ball, so that later calibrations need fewer placements.")
    action = commands_below(ball)
    export = action("export", "Save the ball's shape from a calibration (form rigid), for `calibrate --ball`.")
    result(export)
    output(export, "ball.json", "the ball profile to write")
    word(export, "--name", None, "name of the ball, such as its serial number", default="")
    text = "date of the calibration (default: that of rig.json)"
    export.add_argument("--date", type=_date, metavar="YYYY-MM-DD", help=text)
    path(export, "--session", "SESSION", "store the family and size of its targets, to be checked at every use")
    show = action("show", "Show the contents of a ball profile.")
    path(show, "ball", "ball.json", "the ball profile, or a result folder")


def _date(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError("a date is written as 2026-05-31") from None
