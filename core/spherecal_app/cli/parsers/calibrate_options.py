"""The options of `calibrate`, `batch`, `verify`, `report`, `check`, `recalibrate`, `guide` and `cross-validate`."""

from spherecal_app.cli.parsers import shared
from spherecal_app.cli.parsing import Add


def add_calibrate(add: Add) -> None:
    """`spherecal calibrate`."""
    calibrate = add("calibrate", "Calibrate the rig of a recorded session.")
    shared.session(calibrate, "the session folder, or a support bundle")
    shared.output(calibrate, "RESULT", "the result folder to write")
    _add_forms(calibrate)
    of_the_paper = calibrate.add_argument_group(shared.OF_THE_PAPER)
    shared.search(of_the_paper)
    shared.path_weights(of_the_paper)
    text = "with --method board or bar: keep the chained camera poses, without the joint adjustment (to compare)"
    shared.flag(calibrate, "--no-joint", text)
    _add_lenses(calibrate)
    _add_repairs(calibrate)
    shared.seed(calibrate, "seed of the random choices of triples (default 0)", 0)
    shared.word(calibrate, "--reference", "CAMERA", "the camera whose frame is the world, if it is placed")
    calibrate.show_only("--output", "--method", "--ball", "--lens", "--leave-out")


def _add_forms(to: shared.To) -> None:
    """How the ball is modelled."""
    text = "auto: rigid if the data support it, else soft (a ball that bends a little) or free"
    shared.choice(to, "--method", ("auto", "tao2021", "free", "soft", "rigid", "board", "bar"), text, "auto")
    text = (
        "with --method soft: how far dots may be off the ball's shape (standard deviation per coordinate); "
        "estimated from the data unless given"
    )
    shared.number(to, "--shape-sd", "MM", text)
    text = (
        "use this shape of the ball (`spherecal ball export`): two placements are then enough; if the ball has "
        "changed, this is reported and the profile is not used"
    )
    shared.path(to, "--ball", "ball.json", text)


def _add_lenses(to: shared.To) -> None:
    """How the lenses are modelled."""
    text = "estimate the lenses, or keep them as the session gives them (default free)"
    shared.choice(to, "--intrinsics", ("free", "fixed"), text, "free")
    text = "the lens model of all cameras instead of the session's; auto: use another one if it fits better"
    shared.choice(to, "--lens", ("auto", "brown", "rational", "fisheye"), text)
    shared.flag(
        to, "--own-intrinsics", "estimate the intrinsics of each camera separately, even if the session groups them"
    )


def _add_repairs(to: shared.To) -> None:
    """What is left out, split and exchanged, requested or automatic."""
    shared.repeated(to, "--leave-out", "WHAT", "camera:C05, placement:P3 or the image C05@P3; may be given again")
    text = "camera C05 moved before P3: it gets a second pose from there on, which the rig then has"
    shared.repeated(to, "--split", "C05@P3", text)
    text = "put back the exchanged images of two cameras, everywhere or at one placement"
    shared.repeated(to, "--swap", "C05,C06[@P3]", text)
    text = "do not leave out wrong images or split moved cameras automatically, even if they are certain"
    shared.flag(to, "--no-repair", text)


def add_batch(add: Add) -> None:
    """`spherecal batch`."""
    batch = add("batch", "Calibrate every session below a folder; write a result for each and a table of all.")
    shared.path(batch, "folder", "FOLDER", "the folder with the session folders")
    shared.output(batch, "DIR", "folder for all results")
    shared.choice(batch, "--method", shared.BALL_METHODS, "as for `calibrate` (default auto)", "auto")
    shared.search(batch.add_argument_group(shared.OF_THE_PAPER))
    shared.choice(batch, "--intrinsics", ("free", "fixed"), "as for `calibrate` (default free)", "free")
    shared.flag(batch, "--own-intrinsics", "estimate the intrinsics of each camera separately")
    shared.seed(batch, "seed of the random choices of triples (default 0)", 0)
    shared.workers(batch)


def add_verify(add: Add) -> None:
    """`spherecal verify`."""
    verify = add("verify", "Measure reference bars with a calibrated rig.")
    shared.session(verify, "the session folder with poses of check bars")
    shared.rig(verify)
    shared.output(verify, "RESULT", "the folder to write to, best the rig's result folder")
    text = "the limit of the length error, A in mm: 0.03+L/20000; decided by ISO 14253-1:2017"
    shared.word(verify, "--limit", "A+L/K", text)


def add_override(add: Add) -> None:
    """`spherecal override`."""
    override = add(
        "override",
        "Use a rig all the same although its verification failed. Who does so and why is written into the "
        "verification; the profile, exports, report and certificate say it.",
    )
    shared.result(override)
    shared.word(override, "--by", "NAME", "who answers for it", required=True)
    shared.word(override, "--reason", "TEXT", "why it may be used all the same", required=True)


def add_report(add: Add) -> None:
    """`spherecal report`."""
    report = add(
        "report", "Write the report of a result: PDF, HTML, JSON or a Digital Calibration Certificate, by the ending."
    )
    shared.result(report)
    shared.output(report, "report.pdf", "ending in .pdf, .html, .json or .xml")
    shared.path(report, "--session", "SESSION", "the session, for pictures of its images")
    shared.choice(report, "--page", shared.PAGES, "paper size of a PDF (default A4)", "A4")
    shared.path(
        report, "--issuer", "FILE", "for a certificate (.xml): JSON file with issuer, customer and serial number"
    )
    shared.choice(report, "--language", ("en", "de", "zh_CN"), "language of the report (default en)", "en")


def add_check(add: Add) -> None:
    """`spherecal check`."""
    check = add(
        "check",
        "Test from one image set of the ball or a bar whether the calibration still holds: OK, watch or recalibrate, "
        "with numbers for each camera. Nothing is calibrated. Exit code 3 if the answer is recalibrate.",
    )
    shared.session(check, "a session with one placement or bar pose, or more")
    shared.path(check, "--profile", "PROFILE", "profile, result folder or rig.json to check", required=True)
    shared.word(check, "--only", "P1[,P2]", "only these placements and bar poses")
    shared.word(check, "--limit", "A+L/K", "limit of a bar's error, A in mm, instead of its uncertainty")
    shared.number(check, "--temperature", "C", "temperature of the rig now, for a profile's validity")
    shared.flag(check, "--not-kept", "do not save the check in the profile (spherecal profile trend --checks)")
    shared.path(check, "--repair", "RESULT", "recalibrate the poses of cameras that moved, with the others locked")
    shared.output(check, "FILE", "write the check as JSON", required=False)


def add_recalibrate(add: Add) -> None:
    """`spherecal recalibrate`."""
    again = add("recalibrate", "Calibrate some cameras of a rig again, the others locked.")
    shared.session(again, "a session folder of the rig's cameras")
    shared.rig(again)
    shared.word(again, "--only", "C05[,C06]", "the cameras to calibrate", required=True)
    shared.choice(again, "--estimate", ("all", "pose", "intrinsics"), "what to estimate for them (default all)", "all")
    shared.output(again, "RESULT", "the result folder to write")


def add_guide(add: Add) -> None:
    """`spherecal guide`."""
    guide = add("guide", "Say where to put the ball next, and how good the result would be without it.")
    shared.session(guide, "the session folder so far")
    shared.path(guide, "--picture", "FILE.png", "write a picture, seen from above and tilted")


def add_cross_validate(add: Add) -> None:
    """`spherecal cross-validate`."""
    without = add("cross-validate", "Leave out one placement after the other, and see how the rest predicts it.")
    shared.session(without, "a session folder of three placements or more")
