"""The options of what is kept or used of a rig: `measure`, `export`, `import`, `profile`, `limits`, `bars`, `ball`."""

import argparse
from datetime import date, datetime
from pathlib import Path

from spherecal_app.cli.parsers.shared import choice, flag, number, output, path, repeated, result, rig, word
from spherecal_app.cli.parsing import Add, commands_below


def add_measure(add: Add) -> None:
    """`spherecal measure`."""
    measure = add(
        "measure",
        "Measure coded targets with a calibrated rig: positions with uncertainties, distances, angles, reference bars, "
        "poses of bodies. From a recorded session, or live until Ctrl-C. Exit code 3 where a camera has moved since "
        "the calibration, or the rig is not valid.",
    )
    measure.add_argument("session", type=Path, nargs="?", metavar="SESSION", help="a recorded session")
    measure.add_argument(
        "--cameras",
        nargs="?",
        const="genicam",
        metavar="SOURCE",
        help="live cameras instead: genicam (default), replay:SESSION or simulated[:PRESET]",
    )
    path(measure, "--rig", "rig.json", "the rig: rig.json, result folder or profile", required=True)
    output(measure, "SERIES", "the folder to record the series in", required=False)
    choice(measure, "--table", ("csv", "parquet"), "kind of its tables (default csv; parquet needs pyarrow)", "csv")
    _add_wanted(measure)
    _add_live(measure)
    number(measure, "--stream", "PORT", "send every set as JSON lines to 127.0.0.1:PORT", int)
    flag(measure, "--not-kept", "do not save the rig's health in the profile")
    flag(measure, "--json", "print every set as a line of JSON")


def _add_wanted(measure: argparse.ArgumentParser) -> None:
    """What is measured."""
    wanted = measure.add_argument_group("what to measure, besides all targets; each may be given again")
    repeated(wanted, "--point", "12/A", "dot A of target 12")
    repeated(wanted, "--distance", "12,14[=MM]", "distance between two points")
    repeated(wanted, "--angle", "12,13,14[=DEG]", "angle at the second point")
    repeated(wanted, "--bar", "SERIAL", "a bar of `spherecal bars`")
    repeated(wanted, "--body", "body.json", "pose of a body", Path)
    number(wanted, "--temperature", "C", "temperature of the bars")


def _add_live(measure: argparse.ArgumentParser) -> None:
    """How live cameras are used, and what is known about their times of exposure."""
    live = measure.add_argument_group("live cameras")
    path(live, "--targets", "targets.json", "the target set (default: the program's own targets)")
    number(live, "--rate", "HZ", "sets a second at most (default 10)", default=10.0)
    number(live, "--sets", "N", "end after this many sets", int)
    number(live, "--seconds", "S", "end after this many seconds")
    repeated(live, "--producer", "FILE", "a .cti file or folder to use as well")
    repeated(live, "--fault", "FAULT", "fault of a simulated camera")
    path(live, "--camera-profile", "FILE", "camera settings instead of the user's own")
    text = (
        "standard uncertainty of a camera's time of exposure (default: 0 if all cameras are triggered by "
        "hardware, else the scatter of their times)"
    )
    number(live, "--skew-ms", "MS", text)
    text = "the cameras' exposure times are exact (PTP): with them, moving targets are computed for one moment"
    flag(live, "--exact-times", text)


_UNITS = ("mm", "m")


def add_export(add: Add) -> None:
    """`spherecal export`."""
    export = add("export", "Write a calibrated rig in the format of another program.")
    rig(export, "rig")
    export.add_argument(
        "--to",
        "--format",
        required=True,
        metavar="FORMAT",
        dest="to",
        help="opencv, ros, kalibr, colmap, metashape, anipose (also for Pose2Sim), caliscope, mc-calib, multical, "
        "mrcal, mrcal-splined, csv, maps; scenes to look at: gltf, ply, blender",
    )
    output(export, "PATH", "the file or folder to write")
    choice(export, "--unit", _UNITS, "unit of lengths, where the format leaves it open")
    text = "how much a lens may change to fit the format's smaller lens model (default 0.1 px)"
    number(export, "--max-loss", "PX", text)
    path(export, "--frame", "frame.json", "give all poses in this user's frame (spherecal frame)")


def add_import(add: Add) -> None:
    """`spherecal import`."""
    bring = add("import", "Make a rig.json from a rig with poses that another program calibrated.")
    path(bring, "file", "FILE", "the other program's file, or folder of files")
    text = "opencv, ros, kalibr, colmap, metashape, anipose, caliscope, mc-calib, multical, mrcal, csv, maps, matlab"
    word(bring, "--format", "FORMAT", text, required=True)
    output(bring, "rig.json", "the file to write, - for standard output")
    choice(bring, "--unit", _UNITS, "unit of the file's lengths, where the format leaves it open")
    text = "names for its cameras in the file's order, such as those of your session"
    word(bring, "--ids", "ID,ID,...", text)


def add_import_priors(add: Add) -> None:
    """`spherecal import-priors`."""
    priors = add("import-priors", "Copy a session and give its cameras the lenses of a file of another program.")
    path(priors, "file", "FILE", "OpenCV YAML (a file or a folder of them), Kalibr camchain, COLMAP text")
    path(priors, "--session", "SESSION", "the session to copy", required=True)
    output(priors, "NEW_SESSION", "the session folder to write")
    flag(priors, "--by-order", "match cameras by order instead of by name")


def add_frame(add: Add) -> None:
    """`spherecal frame`."""
    frame = add("frame", "Define the user's frame of a result: origin, +X and the XY plane by three places.")
    result(frame)
    output(frame, "frame.json", "the file to write")
    place = "a placement (the ball's centre there), POSE/MARK of a verified bar, or PLACEMENT/TARGET/POINT"
    for option, what in (("origin", "the origin"), ("x", "a place on the +X axis"), ("xy", "in the XY plane, +Y side")):
        word(frame, f"--{option}", "PLACE", f"{what}: {place}")
    frame.add_argument(
        "--offset", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X_MM", "Y_MM", "Z_MM"),
        help="where the origin's place is in the frame, before any turn",
    )  # fmt: skip
    frame.add_argument(
        "--turn",
        nargs="+",
        default=[],
        metavar="TURN",
        help="turns of the axes about themselves, one after the other: x90, x-90, y90, y-90, z90, z-90",
    )


def add_profile(add: Add) -> None:
    """`spherecal profile save|list|show|apply|restore|compare|trend`."""
    action = commands_below(
        add("profile", "A rig's calibrations over time: which is in use, whether it is still good, what has changed.")
    )
    _add_save(action("save", "Add a result to a profile's history; the calibration in use stays in use."))

    listing = action("list", "List the profiles in a folder with their state.")
    listing.add_argument(
        "folder", type=Path, nargs="?", default=Path("."), metavar="FOLDER", help="where to look (default: here)"
    )
    show = action("show", "Show a profile's state and history.")
    for one in (listing, show):
        number(one, "--temperature", "C", "temperature of the rig now")
    _add_folder(show)

    apply = action("apply", "Put a calibration of the history to use.")
    _add_chosen(apply, "the newest")
    _add_anyway(apply)
    restore = action("restore", "Put the last good calibration, or the one named, back to use.")
    _add_chosen(restore, "the last good one")
    for one in (apply, restore):
        word(one, "--note", "TEXT", "the reason, for the history", default="")

    compare = action("compare", "Show what has changed from calibration A to B, in millimetres in the volume.")
    for name in ("a", "b"):
        path(compare, name, name.upper(), "profile, result, history folder or rig.json")
    trend = action("trend", "Show changes over a profile's history, with control limits.")
    flag(trend, "--checks", "show the quick checks instead of the calibrations")
    _add_folder(trend)
    output(trend, "CHART", "a chart, .pdf or .svg", required=False)
    path(trend, "--csv", "FILE", "a table of the figures")


def _add_save(save: argparse.ArgumentParser) -> None:
    result(save)
    path(save, "--to", "PROFILE", "the profile's folder; created if it is missing", required=True)
    path(save, "--session", "SESSION", "the session, for camera models, ball, targets, scale")
    path(save, "--settings", "FILE", "the cameras.json with the cameras' settings")
    number(save, "--temperature", "C", "temperature of the rig (default: the mean of the bar poses)")
    save.add_argument(
        "--calibrated-at",
        type=datetime.fromisoformat,
        metavar="TIME",
        help="when it was calibrated (default: when the images were taken)",
    )
    word(save, "--note", "TEXT", "a note on this calibration", default="")
    word(save, "--name", None, "name of a new profile (default: the folder's name)")
    flag(save, "--apply", "put it to use at once")
    _add_anyway(save)
    for name in ("ageing-hours", "stale-hours", "ageing-kelvin", "stale-kelvin"):
        number(save, f"--{name}", "N", f"limit from which a calibration is {name.split('-')[0]}, in this profile")


def _add_folder(to: argparse.ArgumentParser) -> None:
    path(to, "profile", "PROFILE", "the profile's folder")


def _add_chosen(to: argparse.ArgumentParser, default: str) -> None:
    """A calibration of a profile's history."""
    _add_folder(to)
    to.add_argument("calibration", nargs="?", metavar="ID", help=f"default: {default}")


def _add_anyway(to: argparse.ArgumentParser) -> None:
    flag(to, "--anyway", "put it to use even if it is marked as not valid")


def add_limits(add: Add) -> None:
    """`spherecal limits show`."""
    action = commands_below(add("limits", "Limits that the responsible person has set in the window (Menu, Limits)."))
    show = action("show", "Show the limits of this machine.")
    path(show, "--file", "FILE", "the limits, instead of your own (or $SPHERECAL_LIMITS)")


def add_bars(add: Add) -> None:
    """`spherecal bars list|show|remove|plan|import|export|add`."""
    bars = add("bars", "Your reference bars by serial number, with their certificates; where to lay one to verify.")
    below = commands_below(bars)

    def action(name: str, text: str) -> argparse.ArgumentParser:
        one = below(name, text)
        path(one, "--registry", "FILE", "the registry, instead of your own (or $SPHERECAL_BARS)")
        return one

    action("list", "List all bars with their longest length and the state of their certificates.")
    for name, text in (
        ("show", "Show one bar with its marks and certified lengths."),
        ("remove", "Remove a bar from the registry."),
    ):
        action(name, text).add_argument("serial", metavar="SERIAL", help="its serial number")
    plan = action("plan", "Plan poses of a bar to verify a rig: seven lines over its volume (VDI/VDE 2634-1, reduced).")
    result(plan, "result or profile folder, or rig.json")
    plan.add_argument("serial", metavar="SERIAL", nargs="?", help="a bar of the registry")
    path(plan, "--session", "SESSION", "use the check bars of this session instead")
    table = action("import", "Enter the bars of a table (CSV): one certified length a line, columns by their headings.")
    path(table, "table", "FILE", "CSV as a spreadsheet writes it; `bars export` writes an example")
    flag(table, "--replace", "replace bars that the registry has with other figures")
    export = action("export", "Write all bars as a table (CSV).")
    path(export, "table", "FILE", "the file to write, - for standard output")
    _add_add(action("add", "Enter a bar, or with --replace new figures of one, from its certificate."))


def _add_add(add: argparse.ArgumentParser) -> None:
    add.add_argument("serial", metavar="SERIAL", help="the bar's serial number")
    path(add, "--from-session", "SESSION", "take marks and lengths from a bar of this session")
    word(add, "--bar", "ID", "the bar's id in the session (needed if there are several)")
    text = "a mark and its target's number; the point is 'centre' unless given; may be given again"
    repeated(add, "--mark", "NAME=TARGET[:POINT]", text)
    text = "certified length between two marks, its expanded uncertainty in mm and k (2); may be given again"
    repeated(add, "--length", "A,B,MM,U[,K]", text)
    text = "nominal length between two marks, such as A1,A2,500; certified lengths that differ by over 1 %% are refused"
    repeated(add, "--nominal", "A,B,MM", text)
    number(add, "--expansion", "PER_KELVIN", "coefficient of expansion, such as 1.15e-5 for steel")
    number(add, "--reference-temperature", "C", "temperature of the certified lengths in degrees Celsius (default 20)")
    word(add, "--certificate", "NUMBER", "the certificate's number")
    word(add, "--laboratory", "NAME", "the laboratory that issued it")
    word(add, "--date", "YYYY-MM-DD", "date of the certificate")
    word(add, "--valid-until", "YYYY-MM-DD", "when the bar must be calibrated again")
    word(add, "--description", "TEXT", "a description of the bar", default="")
    flag(add, "--replace", "replace a bar with this serial number")


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
