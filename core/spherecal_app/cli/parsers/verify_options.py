"""The options of `verify`, `report` and `check`."""

from spherecal_app.cli.parsers.shared import PAGES, choice, flag, number, output, path, result, rig, session, word
from spherecal_app.cli.parsing import Add


def add_verify(add: Add) -> None:
    """`spherecal verify`."""
    verify = add("verify", "Measure reference bars with a calibrated rig.")
    session(verify, "the session folder with poses of check bars")
    rig(verify)
    output(verify, "RESULT", "the folder to write to, best the rig's result folder")
    text = "the limit of the length error, A in mm: 0.03+L/20000; decided by ISO 14253-1:2017"
    word(verify, "--limit", "A+L/K", text)


def add_override(add: Add) -> None:
    """`spherecal override`."""
    override = add(
        "override",
        "Use a rig all the same although its verification failed. Who does so and why is written into the "
        "verification; the profile, exports, report and certificate say it.",
    )
    result(override)
    word(override, "--by", "NAME", "who answers for it", required=True)
    word(override, "--reason", "TEXT", "why it may be used all the same", required=True)


def add_report(add: Add) -> None:
    """`spherecal report`."""
    report = add(
        "report", "Write the report of a result: PDF, HTML, JSON or a Digital Calibration Certificate, by the ending."
    )
    result(report)
    output(report, "report.pdf", "ending in .pdf, .html, .json or .xml")
    path(report, "--session", "SESSION", "the session, for pictures of its images")
    choice(report, "--page", PAGES, "paper size of a PDF (default A4)", "A4")
    path(report, "--issuer", "FILE", "for a certificate (.xml): JSON file with issuer, customer and serial number")
    choice(report, "--language", ("en", "de", "zh_CN"), "language of the report (default en)", "en")


def add_check(add: Add) -> None:
    """`spherecal check`."""
    check = add(
        "check",
        "Test from one image set of the ball or a bar whether the calibration still holds: OK, watch or recalibrate, "
        "with numbers for each camera. Nothing is calibrated. Exit code 3 if the answer is recalibrate.",
    )
    session(check, "a session with one placement or bar pose, or more")
    path(check, "--profile", "PROFILE", "profile, result folder or rig.json to check", required=True)
    word(check, "--only", "P1[,P2]", "only these placements and bar poses")
    word(check, "--limit", "A+L/K", "limit of a bar's error, A in mm, instead of its uncertainty")
    number(check, "--temperature", "C", "temperature of the rig now, for a profile's validity")
    flag(check, "--not-kept", "do not save the check in the profile (spherecal profile trend --checks)")
    path(check, "--repair", "RESULT", "recalibrate the poses of cameras that moved, with the others locked")
    output(check, "FILE", "write the check as JSON", required=False)
