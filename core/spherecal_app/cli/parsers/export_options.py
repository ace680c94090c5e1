"""The options of `export`, `import`, `import-priors` and `frame`."""

from spherecal_app.cli.parsers.shared import choice, flag, number, output, path, result, rig, word
from spherecal_app.cli.parsing import Add

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
        "mrcal, csv, maps; scenes to look at: gltf, ply, blender",
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
        "--offset",
        type=float,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X_MM", "Y_MM", "Z_MM"),
        help="where the origin's place is in the frame, before any turn",
    )
    frame.add_argument(
        "--turn",
        nargs="+",
        default=[],
        metavar="TURN",
        help="turns of the axes about themselves, one after the other: x90, x-90, y90, y-90, z90, z-90",
    )
