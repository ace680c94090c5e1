"""The options of `targets` and `detect`."""

import argparse

from spherecal_app.cli.parsers.shared import choice, number, output, path, word
from spherecal_app.cli.parsing import Add, commands_below

_PAGES = ("A4", "Letter", "A3", "A2", "A1", "A0")


def add_targets(add: Add) -> None:
    """`spherecal targets export|sheet`."""
    below = commands_below(add("targets", "The coded targets: machine-readable, or sheets to print."), "export|sheet")
    _add_wanted(below("export", "Write targets.json."))
    sheet = below("sheet", "Write a PDF to print.")
    _add_wanted(sheet)
    choice(sheet, "--page", _PAGES, "paper size (default A4); larger than A4 and Letter for boards", "A4")
    text = (
        "print a calibration board instead: aprilgrid,rows=4,columns=5,pitch_mm=36,marker_mm=28, charuco, chessboard, "
        "circles or asymmetric-circles with the fields of the manual's page on boards"
    )
    word(sheet, "--board", "BOARD", text)


def _add_wanted(parser: argparse.ArgumentParser) -> None:
    """Which targets."""
    output(parser, "FILE", "the file to write")
    text = "how many targets (default 200, or all markers of a dictionary)"
    number(parser, "--count", None, text, int)
    number(parser, "--first-id", "ID", "the first target's number (default 1; of markers 0)", int)
    number(parser, "--size", "MM", "edge of a sticker (default 28)", default=28.0)
    text = "polarity of dots (default light-on-dark) or of markers (default dark-on-light)"
    choice(parser, "--polarity", ("light-on-dark", "dark-on-light"), text)
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
    word(parser, "--markers", "DICTIONARY", text)


def add_detect(add: Add) -> None:
    """`spherecal detect`."""
    detect = add("detect", "Find coded targets in images.")
    detect.add_argument("images", nargs="+", metavar="IMAGE", help="PNG, TIFF, JPEG, BMP or PGM files")
    path(detect, "--targets", "targets.json", "the target set to look for", required=True)
    path(detect, "--csv", "FILE", "the table to write, a row for each dot", required=True)
