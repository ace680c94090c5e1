"""The options of all commands."""

import argparse
from collections.abc import Callable
from pathlib import Path

from spherecal import __version__
from spherecal.cli import (
    about,
    ball,
    bars,
    batch,
    bundle,
    check,
    compile_kernels,
    export,
    frame,
    limits,
    measure,
    network_commands,
    profile,
    session,
    study,
)
from spherecal.cli.cameras_parser import add_parser as add_cameras
from spherecal.cli.parsing import Parser, add_common, rig_file
from spherecal.cli.search import add_path_weights, add_search

Add = Callable[[str, str], argparse.ArgumentParser]


def make_parser() -> Parser:
    """The parser of all commands."""
    parser = Parser(
        prog="spherecal",
        description="Calibrate a rig of many cameras with an imperfect ball. Without a command: the window.",
        epilog="Exit codes: 0 done; 2 bad usage or input; 3 done, but the result is not valid; 130 cancelled.",
    )
    parser.add_argument(
        "-V", "--version", action="version", version=f"spherecal {__version__}", help="print the version and end"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")

    def add(name: str, text: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=text, description=text)

    helping = add("help", "Help on a command, as its --help prints it.")
    helping.add_argument("words", nargs="*", metavar="COMMAND", help="such as `calibrate` or `profile save`")

    for add_one in (_add_demo, _add_simulate, _add_targets, _add_detect, _add_calibrate, _add_verify, _add_report):
        add_one(add)
    modules = (
        ball,
        bars,
        check,
        measure,
        bundle,
        batch,
        export,
        frame,
        limits,
        profile,
        network_commands,
        session,
        study,
        about,
        compile_kernels,
    )
    for module in modules:
        module.add_parsers(add)

    add("doctor", "What this machine has and lacks.")
    add_cameras(commands)
    add_common(parser)
    return parser


def _add_demo(add: Add) -> None:
    demo = add("demo", "Calibrate and verify a simulated rig, from end to end.")
    demo.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("spherecal-demo"),
        metavar="DIR",
        help="folder for all its files (default spherecal-demo)",
    )


def _add_simulate(add: Add) -> None:
    simulate = add("simulate", "Make a session of a simulated rig with its truth.json.")
    simulate.add_argument(
        "preset",
        help="demo, rigA, rigB, hall24, hall50, hall100, dome24, or any hallN, domeN, wideN (lens of N degrees)",
    )
    simulate.add_argument(
        "-o", "--output", type=Path, required=True, metavar="SESSION", help="the session folder to write"
    )
    simulate.add_argument("--observations-only", action="store_true", help="observations instead of images")
    simulate.add_argument("--seed", type=_seed, default=1, help="another seed, another rig and noise (default 1)")


def _add_targets(add: Add) -> None:
    targets = add("targets", "The coded targets: machine-readable, or sheets to print.")
    kinds = targets.add_subparsers(dest="kind", required=True, metavar="export|sheet")
    for kind, text in (("export", "Write targets.json."), ("sheet", "Write a PDF to print.")):
        one = kinds.add_parser(kind, help=text, description=text)
        one.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="the file to write")
        one.add_argument(
            "--count", type=int, help="how many targets (default 200; all that a dictionary of markers has)"
        )
        one.add_argument(
            "--first-id", type=int, metavar="ID", help="the first target's number (default 1; of markers 0)"
        )
        one.add_argument("--size", type=float, default=28.0, metavar="MM", help="edge of a sticker (default 28)")
        one.add_argument(
            "--polarity",
            choices=("light-on-dark", "dark-on-light"),
            help="of the dots on their ground (default light-on-dark), of markers on theirs (default dark-on-light)",
        )
        one.add_argument(
            "--measured",
            type=float,
            nargs=2,
            metavar=("H_MM", "V_MM"),
            help="what the sheet's two 100 mm rulers measure after printing (across, down)",
        )
        one.add_argument(
            "--markers",
            metavar="DICTIONARY",
            help="ArUco or AprilTag markers instead of dots, by OpenCV's name: DICT_4X4_250, DICT_APRILTAG_36h11 ...; "
            "--size is then the side of the black square, and ids begin with 0",
        )
        if kind == "sheet":
            one.add_argument(
                "--page",
                choices=("A4", "Letter", "A3", "A2", "A1", "A0"),
                default="A4",
                help="paper size (default A4); larger than A4 and Letter for boards",
            )
            one.add_argument(
                "--board",
                metavar="BOARD",
                help="print a calibration board instead: aprilgrid,rows=4,columns=5,pitch_mm=36,marker_mm=28, "
                "charuco, chessboard, circles or asymmetric-circles with the fields of the manual's page on boards",
            )


def _add_detect(add: Add) -> None:
    detect = add("detect", "Find coded targets in images.")
    detect.add_argument("images", nargs="+", metavar="IMAGE", help="PNG, TIFF, JPEG, BMP or PGM files")
    detect.add_argument(
        "--targets", type=Path, required=True, metavar="targets.json", help="the target set to look for"
    )
    detect.add_argument(
        "--csv", type=Path, required=True, metavar="FILE", help="the table to write, a row for each dot"
    )


def _add_calibrate(add: Add) -> None:
    calibrate = add("calibrate", "Calibrate the rig of a recorded session.")
    calibrate.add_argument("session", type=Path, metavar="SESSION", help="the session folder, or a support bundle")
    calibrate.add_argument(
        "-o", "--output", type=Path, required=True, metavar="RESULT", help="the result folder to write"
    )
    _add_forms(calibrate)
    add_search(calibrate)
    add_path_weights(calibrate)
    calibrate.add_argument(
        "--no-joint",
        action="store_true",
        help="with --method board or bar: cameras as they were chained, without the joint adjustment (to compare)",
    )
    _add_lenses(calibrate)
    _add_repairs(calibrate)
    calibrate.add_argument("--seed", type=_seed, default=0, help="of the random choices of triples (default 0)")
    calibrate.add_argument("--reference", metavar="CAMERA", help="the camera whose frame is the world, if it is placed")


def _add_verify(add: Add) -> None:
    verify = add("verify", "Measure reference bars with a calibrated rig.")
    verify.add_argument("session", type=Path, metavar="SESSION", help="the session folder with poses of check bars")
    verify.add_argument(
        "--rig", type=rig_file, required=True, metavar="rig.json", help="the rig, or the folder of its result"
    )
    verify.add_argument(
        "-o", "--output", type=Path, required=True, metavar="RESULT", help="the folder to write into, best the rig's"
    )
    verify.add_argument(
        "--limit", metavar="A+L/K", help="the limit of the length error, A in mm: 0.03+L/20000; decided by ISO 14253-1"
    )


def _add_report(add: Add) -> None:
    report = add(
        "report", "Write the report of a result: PDF, HTML, JSON or a Digital Calibration Certificate, by the ending."
    )
    report.add_argument("result", type=Path, metavar="RESULT", help="the result folder")
    report.add_argument(
        "-o", "--output", type=Path, required=True, metavar="report.pdf", help="ending in .pdf, .html, .json or .xml"
    )
    report.add_argument("--session", type=Path, metavar="SESSION", help="the session, for pictures of its images")
    report.add_argument("--page", choices=("A4", "Letter"), default="A4", help="paper size of a PDF (default A4)")
    report.add_argument("--issuer", type=Path, metavar="FILE", help="for a certificate (.xml): who issues it")
    report.add_argument("--language", choices=("en", "de", "zh_CN"), default="en", help="of the report (default: en)")


def _add_repairs(calibrate: argparse.ArgumentParser) -> None:
    """What `calibrate` leaves out, splits and exchanges, asked or by itself."""
    calibrate.add_argument(
        "--leave-out",
        action="append",
        default=[],
        metavar="WHAT",
        help="camera:C05, placement:P3 or the image C05@P3; may be given again",
    )
    calibrate.add_argument(
        "--split",
        action="append",
        default=[],
        metavar="C05@P3",
        help="camera C05 moved before P3: it gets a second pose from there on, which is the rig's",
    )
    calibrate.add_argument(
        "--swap",
        action="append",
        default=[],
        metavar="C05,C06[@P3]",
        help="put back the exchanged images of two cameras, everywhere or at one placement",
    )
    calibrate.add_argument(
        "--no-repair",
        action="store_true",
        help="do not leave out wrong images nor split moved cameras by itself, however certain they are",
    )


def _add_forms(calibrate: argparse.ArgumentParser) -> None:
    """How `calibrate` takes the ball."""
    calibrate.add_argument(
        "--method",
        choices=("auto", "tao2021", "free", "soft", "rigid", "board", "bar"),
        default="auto",
        help="auto: rigid where the data carry it, else soft (a ball that gives way a little) or free",
    )
    calibrate.add_argument(
        "--shape-sd",
        type=float,
        metavar="MM",
        help="with --method soft: how far dots may be off the ball's shape (standard deviation per coordinate); "
        "estimated from the data unless given",
    )
    calibrate.add_argument(
        "--ball",
        type=Path,
        metavar="ball.json",
        help="stand on this shape of the ball (`spherecal ball export`): two placements then do; a ball that has "
        "changed is reported and its profile not used",
    )


def _add_lenses(calibrate: argparse.ArgumentParser) -> None:
    """How `calibrate` takes the lenses."""
    calibrate.add_argument(
        "--intrinsics",
        choices=("free", "fixed"),
        default="free",
        help="estimate the lenses, or keep them as the session gives them (default free)",
    )
    calibrate.add_argument(
        "--lens",
        choices=("auto", "brown", "rational", "fisheye"),
        help="the lens model of all cameras instead of the session's; auto: another one where it fits better",
    )
    calibrate.add_argument(
        "--own-intrinsics", action="store_true", help="every camera for itself, whatever the session groups"
    )


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**31 - 1:
        raise argparse.ArgumentTypeError("a seed is a whole number from 0 to 2147483646")
    return int(text)
