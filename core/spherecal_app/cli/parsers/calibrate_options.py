"""The options of `calibrate` and `batch`."""

from spherecal_app.cli.parsers.shared import (
    BALL_METHODS,
    OF_THE_PAPER,
    To,
    choice,
    flag,
    number,
    output,
    path,
    path_weights,
    repeated,
    search,
    seed,
    session,
    word,
    workers,
)
from spherecal_app.cli.parsing import Add


def add_calibrate(add: Add) -> None:
    """`spherecal calibrate`."""
    calibrate = add("calibrate", "Calibrate the rig of a recorded session.")
    session(calibrate, "the session folder, or a support bundle")
    output(calibrate, "RESULT", "the result folder to write")
    _add_forms(calibrate)
    of_the_paper = calibrate.add_argument_group(OF_THE_PAPER)
    search(of_the_paper)
    path_weights(of_the_paper)
    text = "with --method board or bar: keep the chained camera poses, without the joint adjustment (to compare)"
    flag(calibrate, "--no-joint", text)
    _add_lenses(calibrate)
    _add_repairs(calibrate)
    seed(calibrate, "seed of the random choices of triples (default 0)", 0)
    word(calibrate, "--reference", "CAMERA", "the camera whose frame is the world, if it is placed")
    calibrate.show_only("--output", "--method", "--ball", "--lens", "--leave-out")


def _add_forms(to: To) -> None:
    """How the ball is modelled."""
    text = "auto: rigid if the data support it, else soft (a ball that bends a little) or free"
    choice(to, "--method", ("auto", "tao2021", "free", "soft", "rigid", "board", "bar"), text, "auto")
    text = (
        "with --method soft: how far dots may be off the ball's shape (standard deviation per coordinate); "
        "estimated from the data unless given"
    )
    number(to, "--shape-sd", "MM", text)
    text = (
        "use this shape of the ball (`spherecal ball export`): two placements are then enough; if the ball has "
        "changed, this is reported and the profile is not used"
    )
    path(to, "--ball", "ball.json", text)


def _add_lenses(to: To) -> None:
    """How the lenses are modelled."""
    text = "estimate the lenses, or keep them as the session gives them (default free)"
    choice(to, "--intrinsics", ("free", "fixed"), text, "free")
    text = "the lens model of all cameras instead of the session's; auto: use another one if it fits better"
    choice(to, "--lens", ("auto", "brown", "rational", "fisheye"), text)
    flag(to, "--own-intrinsics", "estimate the intrinsics of each camera separately, even if the session groups them")


def _add_repairs(to: To) -> None:
    """What is left out, split and exchanged, requested or automatic."""
    repeated(to, "--leave-out", "WHAT", "camera:C05, placement:P3 or the image C05@P3; may be given again")
    text = "camera C05 moved before P3: it gets a second pose from there on, which the rig then has"
    repeated(to, "--split", "C05@P3", text)
    text = "put back the exchanged images of two cameras, everywhere or at one placement"
    repeated(to, "--swap", "C05,C06[@P3]", text)
    text = "do not leave out wrong images or split moved cameras automatically, even if they are certain"
    flag(to, "--no-repair", text)


def add_batch(add: Add) -> None:
    """`spherecal batch`."""
    batch = add("batch", "Calibrate every session below a folder; write a result for each and a table of all.")
    path(batch, "folder", "FOLDER", "the folder with the session folders")
    output(batch, "DIR", "folder for all results")
    choice(batch, "--method", BALL_METHODS, "as for `calibrate` (default auto)", "auto")
    search(batch.add_argument_group(OF_THE_PAPER))
    choice(batch, "--intrinsics", ("free", "fixed"), "as for `calibrate` (default free)", "free")
    flag(batch, "--own-intrinsics", "estimate the intrinsics of each camera separately")
    seed(batch, "seed of the random choices of triples (default 0)", 0)
    workers(batch)
