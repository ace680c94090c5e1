"""The options of `session` and `support-bundle`."""

from pathlib import Path

from spherecal_app.cli.parsers.shared import BALL_METHODS, choice, flag, number, output, path, repeated, session, word
from spherecal_app.cli.parsing import Add, commands_below


def _spacing(text: str) -> tuple[float, float]:
    length, _, u = text.partition(",")
    return float(length), float(u)


def add_session(add: Add) -> None:
    """`spherecal session new`."""
    action = commands_below(add("session", "Session folders: make one from images or videos that you have."))
    new = action("new", "Make a session folder from images or synchronised videos, by their names, sizes and EXIF.")
    path(new, "folder", "FOLDER", "the session folder to write")
    text = (
        "the images (cam1/0001.png, 0001/cam1.png, cam1_0001.png) or one video of each camera; they are copied unless "
        "they are in FOLDER"
    )
    path(new, "--images", "DIR", text, required=True)
    text = 'how their paths below DIR name camera and placement, such as "{camera}_{placement}.png"; * is any text'
    word(new, "--pattern", "PATTERN", text)
    text = (
        "the board that they show: chessboard,rows=6,columns=9,pitch_mm=20, with the fields of the manual's page on "
        "boards, or a JSON file with them"
    )
    word(new, "--board", "BOARD", text)
    path(new, "--targets", "targets.json", "the coded targets that they show")
    number(new, "--sphere", "MM", "the ball's nominal diameter")
    text = "what the targets' widest spacing measures on the print, and its expanded uncertainty (k = 2)"
    new.add_argument("--spacing", metavar="MM,U", type=_spacing, help=text)
    number(new, "--focal-length", "MM", "focal length of all lenses, instead of that in EXIF")
    number(new, "--pixel-pitch", "UM", "pixel pitch of all sensors, instead of that in EXIF")
    choice(new, "--lens", ("brown", "rational", "fisheye"), "the lens model (default brown)")
    number(new, "--frames", "N", "use at most this many frames of videos (default 30)", int, default=30)


def add_support_bundle(add: Add) -> None:
    """`spherecal support-bundle`."""
    bundle = add(
        "support-bundle",
        "Pack a session's observations, settings, result, logs and versions into one file, images only on request. "
        "Names of people and computers and serial numbers are replaced. `spherecal calibrate BUNDLE.zip` gives "
        "the same numbers, with --names the same rig.json byte for byte.",
    )
    session(bundle)
    output(bundle, "BUNDLE.zip", "the file to write")
    path(bundle, "--result", "RESULT", "the result to send along")
    path(bundle, "--settings", "FILE", "the cameras.json with the cameras' settings")
    repeated(bundle, "--log-file", "FILE", "a log to send along", Path)
    flag(bundle, "--images", "include the images")
    flag(bundle, "--names", "leave names of people and computers and serial numbers as they are")
    text = "the method that was used, for a session of images (default auto)"
    choice(bundle, "--method", BALL_METHODS, text, "auto")
