"""The options of `recalibrate`, `guide` and `cross-validate`: what follows a calibration, or leads to it."""

from spherecal_app.cli.parsers.shared import choice, output, path, rig, session, word
from spherecal_app.cli.parsing import Add


def add_recalibrate(add: Add) -> None:
    """`spherecal recalibrate`."""
    again = add("recalibrate", "Calibrate some cameras of a rig again, the others locked.")
    session(again, "a session folder of the rig's cameras")
    rig(again)
    word(again, "--only", "C05[,C06]", "the cameras to calibrate", required=True)
    choice(again, "--estimate", ("all", "pose", "intrinsics"), "what to estimate for them (default all)", "all")
    output(again, "RESULT", "the result folder to write")


def add_guide(add: Add) -> None:
    """`spherecal guide`."""
    guide = add("guide", "Say where to put the ball next, and how good the result would be without it.")
    session(guide, "the session folder so far")
    path(guide, "--picture", "FILE.png", "write a picture, seen from above and tilted")


def add_cross_validate(add: Add) -> None:
    """`spherecal cross-validate`."""
    without = add("cross-validate", "Leave out one placement after the other, and see how the rest predicts it.")
    session(without, "a session folder of three placements or more")
