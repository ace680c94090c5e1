"""The options of `targets`, `detect`, `session`, `support-bundle` and `cameras`."""

import argparse
from pathlib import Path

from spherecal_app.cli.parsers import shared
from spherecal_app.cli.parsing import Add, commands_below

_PAGES = ("A4", "Letter", "A3", "A2", "A1", "A0")


def add_targets(add: Add) -> None:
    """`spherecal targets export|sheet`."""
    below = commands_below(add("targets", "The coded targets: machine-readable, or sheets to print."), "export|sheet")
    _add_target_set(below("export", "Write targets.json."))
    sheet = below("sheet", "Write a PDF to print.")
    _add_target_set(sheet)
    shared.choice(sheet, "--page", _PAGES, "paper size (default A4); larger than A4 and Letter for boards", "A4")
    text = (
        "print a calibration board instead: aprilgrid,rows=4,columns=5,pitch_mm=36,marker_mm=28, charuco, chessboard, "
        "circles or asymmetric-circles with the fields of the manual's page on boards"
    )
    shared.word(sheet, "--board", "BOARD", text)


def _add_target_set(parser: argparse.ArgumentParser) -> None:
    """Which targets."""
    shared.output(parser, "FILE", "the file to write")
    text = "how many targets (default 200, or all markers of a dictionary)"
    shared.number(parser, "--count", None, text, int)
    shared.number(parser, "--first-id", "ID", "the first target's number (default 1; of markers 0)", int)
    shared.number(parser, "--size", "MM", "edge of a sticker (default 28)", default=28.0)
    text = "polarity of dots (default light-on-dark) or of markers (default dark-on-light)"
    shared.choice(parser, "--polarity", ("light-on-dark", "dark-on-light"), text)
    parser.add_argument(
        "--measured",
        type=float,
        nargs=2,
        metavar=("H_MM", "V_MM"),
        help="what the sheet's two 100 mm rulers measure after printing (across, down)",
    )
    text = (
        "ArUco or AprilTag markers instead of dots, by OpenCV's name: DICT_4X4_250, DICT_APRILTAG_36h11 ...; "
        "--size is then the side of the black square, and ids start at 0"
    )
    shared.word(parser, "--markers", "DICTIONARY", text)


def add_detect(add: Add) -> None:
    """`spherecal detect`."""
    detect = add("detect", "Find coded targets in images.")
    detect.add_argument("images", nargs="+", metavar="IMAGE", help="PNG, TIFF, JPEG, BMP or PGM files")
    shared.path(detect, "--targets", "targets.json", "the target set to look for", required=True)
    shared.path(detect, "--csv", "FILE", "the table to write, a row for each dot", required=True)


def _spacing(text: str) -> tuple[float, float]:
    length, _, u = text.partition(",")
    return float(length), float(u)


def add_session(add: Add) -> None:
    """`spherecal session new`."""
    action = commands_below(add("session", "Session folders: make one from images or videos that you have."))
    new = action("new", "Make a session folder from images or synchronised videos, by their names, sizes and EXIF.")
    shared.path(new, "folder", "FOLDER", "the session folder to write")
    text = (
        "the images (cam1/0001.png, 0001/cam1.png, cam1_0001.png) or one video of each camera; they are copied unless "
        "they are in FOLDER"
    )
    shared.path(new, "--images", "DIR", text, required=True)
    text = 'how their paths below DIR name camera and placement, such as "{camera}_{placement}.png"; * is any text'
    shared.word(new, "--pattern", "PATTERN", text)
    text = (
        "the board that they show: chessboard,rows=6,columns=9,pitch_mm=20, with the fields of the manual's page on "
        "boards, or a JSON file with them"
    )
    shared.word(new, "--board", "BOARD", text)
    shared.path(new, "--targets", "targets.json", "the coded targets that they show")
    shared.number(new, "--sphere", "MM", "the ball's nominal diameter")
    text = "what the targets' widest spacing measures on the print, and its expanded uncertainty (k = 2)"
    new.add_argument("--spacing", metavar="MM,U", type=_spacing, help=text)
    shared.number(new, "--focal-length", "MM", "focal length of all lenses, instead of that in EXIF")
    shared.number(new, "--pixel-pitch", "UM", "pixel pitch of all sensors, instead of that in EXIF")
    shared.choice(new, "--lens", ("brown", "rational", "fisheye"), "the lens model (default brown)")
    shared.number(new, "--frames", "N", "use at most this many frames of videos (default 30)", int, default=30)


def add_support_bundle(add: Add) -> None:
    """`spherecal support-bundle`."""
    bundle = add(
        "support-bundle",
        "Pack a session's observations, settings, result, logs and versions into one file, images only on request. "
        "Names of people and computers and serial numbers are replaced. `spherecal calibrate BUNDLE.zip` gives "
        "the same numbers, with --names the same rig.json byte for byte.",
    )
    shared.session(bundle)
    shared.output(bundle, "BUNDLE.zip", "the file to write")
    shared.path(bundle, "--result", "RESULT", "the result to send along")
    shared.path(bundle, "--settings", "FILE", "the cameras.json with the cameras' settings")
    shared.repeated(bundle, "--log-file", "FILE", "a log to send along", Path)
    shared.flag(bundle, "--images", "include the images")
    shared.flag(bundle, "--names", "leave names of people and computers and serial numbers as they are")
    text = "the method that was used, for a session of images (default auto)"
    shared.choice(bundle, "--method", shared.BALL_METHODS, text, "auto")


_ABOVE_ZERO = shared.between(float, 1e-12, 1e12, "a number above 0 is needed")


def add_cameras(add: Add) -> None:
    """`spherecal cameras` and what is below it."""
    cameras = add("cameras", "Live cameras: find them, set them up, test them, capture sessions.")
    below = commands_below(cameras, "list|show|set|doctor|capture|...")

    def action(name: str, text: str) -> argparse.ArgumentParser:
        one = below(name, text)
        shared.word(
            one, "--source", "SOURCE", "genicam (default), replay:SESSION or simulated[:PRESET]", default="genicam"
        )
        shared.repeated(one, "--producer", "FILE", "a .cti file or folder to use as well")
        shared.repeated(one, "--fault", "FAULT", "fault of a simulated camera, such as `lose:C03@2-3`")
        shared.path(one, "--profile", "FILE", "camera settings instead of the user's own")
        return one

    action("list", "List cameras and drivers.")
    show = action("show", "Show a camera's settings, state and features.")
    show.add_argument("camera", metavar="SERIAL|NAME", help="its serial number or its name")
    _add_set(action("set", "Save settings of a camera, and apply them if it is connected."))
    doctor = action("doctor", "Test lines, rates and triggers, and say what to do.")
    shared.number(doctor, "--seconds", None, "how long to watch (default 5)", _ABOVE_ZERO, default=5.0)
    shared.number(doctor, "--rate", "HZ", "images a second (default 5)", _ABOVE_ZERO, default=5.0)
    shared.flag(doctor, "--order", "find out which camera is which, by covering lenses")
    shared.flag(doctor, "--stagger", "save the delays or limits with which cameras share a line, and apply them")
    _add_capture(action("capture", "Capture a session, set by set."))
    trust = below("trust", "Allow driver files (.cti) to be loaded, revoke this, or list the allowed files.")
    trust.add_argument("files", nargs="*", metavar="FILE", help="driver files; without any, list the allowed ones")
    shared.flag(trust, "--forget", "no longer allow these files")
    _add_producers(below)
    add_simulate_gige(below)


def _add_set(to: argparse.ArgumentParser) -> None:
    to.add_argument("camera", metavar="SERIAL|NAME|all", help="its serial number or its name, or all cameras")
    shared.word(to, "--name", None, "the camera's name")
    shared.number(to, "--exposure-us", "US", "exposure time", _ABOVE_ZERO)
    shared.number(to, "--gain-db", "DB", "gain")
    shared.word(to, "--pixel-format", "FORMAT", "Mono8, Mono12, Mono12p, BayerRG8, ...")
    to.add_argument("--region", type=int, nargs=4, metavar=("X", "Y", "W", "H"), help="part of the sensor")
    shared.flag(to, "--full", "the whole sensor")
    shared.choice(to, "--trigger", ("software", "hardware", "free", "scheduled"), "what starts an image")
    shared.word(to, "--trigger-source", "INPUT", "input of the hardware trigger, such as Line1")
    shared.number(to, "--frame-rate-hz", "HZ", "frame rate of a camera that runs freely", _ABOVE_ZERO)
    shared.number(to, "--packet-size", "BYTES", "packet size of a GigE camera's stream", int)
    shared.number(to, "--packet-delay", "TICKS", "pause between packets, in the camera's ticks", int)
    shared.number(to, "--frame-delay", "TICKS", "pause before an image is sent, in its ticks", int)
    shared.number(to, "--throughput-bytes-s", "BYTES", "the most that the camera sends, bytes a second", int)
    shared.number(to, "--focal-length-mm", "MM", "focal length of the lens, from its label", _ABOVE_ZERO)
    shared.number(to, "--pixel-pitch-um", "UM", "pixel pitch of the sensor, from its data sheet", _ABOVE_ZERO)
    shared.choice(to, "--in-rig", ("yes", "no"), "whether it belongs to the rig; `no`: it is never opened")
    shared.flag(to, "--offline", "only save the settings, do not look for the camera")


def _add_capture(to: argparse.ArgumentParser) -> None:
    shared.output(to, "SESSION", "the session folder to write")
    shared.path(to, "--plan", "FILE", "what to capture, in the form of session.json")
    shared.number(to, "--placements", "N", "without a plan: this many placements (default 4)", int)
    shared.path(to, "--targets", "targets.json", "without a plan: the target set")
    shared.number(to, "--diameter-mm", "MM", "without a plan: the ball's diameter", _ABOVE_ZERO)
    shared.number(to, "--average", "N", "images to average for each image of a set (default 1)", int, default=1)
    shared.number(to, "--timeout", "S", "time to wait for a set, in seconds (default 1)", _ABOVE_ZERO, default=1.0)
    shared.number(to, "--retries", "N", "repetitions when a camera is missing (default 2)", int, default=2)
    shared.flag(to, "--no-wait", "do not ask before each set")
    shared.word(
        to, "--before-each", "COMMAND", "run this before each set, its id in SPHERECAL_SET (for a turntable, ...)"
    )
    to.add_argument("--continue", dest="take_up", action="store_true", help="continue an unfinished capture")


def _add_producers(add: Add) -> None:
    """`spherecal cameras build-producer` and `simulate-producer`."""
    build = add(
        "build-producer",
        "Build a GenTL producer (.cti) for simulated cameras, or with --aravis for GigE Vision and USB3 Vision cameras "
        "of any maker; needs a C++ compiler.",
    )
    shared.flag(build, "--aravis", "for real cameras, by libaravis (Linux; libaravis-dev)")
    shared.flag(build, "--use", "with --aravis: use it from now on, as the built-in driver")
    shared.output(build, "FOLDER", "also put a copy into this folder", required=False)

    simulate = add(
        "simulate-producer",
        "Let any GenICam program see the cameras of a session through the simulated producer, until Ctrl-C. Commands "
        "read from standard input: the name of a placement or bar pose, unplug SERIAL, plug SERIAL, pulse, quit.",
    )
    simulate.add_argument("session", nargs="?", type=Path, metavar="SESSION", help="default: the demo's session")
    shared.word(simulate, "--show", "SCENE", "placement or bar pose to begin with (default: the first)")
    shared.flag(simulate, "--running", "change the scene of cameras that are already running, and return")


def add_simulate_gige(add: Add) -> None:
    """`spherecal cameras simulate-gige`."""
    simulate = add(
        "simulate-gige",
        "Simulate the GigE Vision cameras of a rig on this machine (Linux, root or user namespaces), until Ctrl-C. "
        "Commands read from standard input: the name of a placement or bar pose, a fault, quit.",
    )
    text = "a preset of `spherecal simulate` or a folder; default: demo"
    simulate.add_argument("rig", nargs="?", metavar="PRESET|SESSION", help=text)
    shared.number(simulate, "--cameras", "N", "only the first N (default: all, at most 12)", int)
    shared.word(simulate, "--show", "SCENE", "placement or bar pose to begin with (default: the first)")
    shared.number(simulate, "--mtu", "BYTES", "largest packet (default 1500)", int, default=1500)
    shared.word(simulate, "--run", "COMMAND", "run this on the rig's computer, and end with its exit code")
