"""The command line of `spherecal cameras`; light, since every command reads it."""

import argparse
from pathlib import Path
from typing import Any

from spherecal.cli import producer

Subparsers = Any  # argparse's own class for this is private


def add_parser(commands: Subparsers) -> None:
    """Add `cameras` and what stands under it to the command line."""
    text = "Live cameras: find them, set them up, test them, capture sessions."
    cameras = commands.add_parser("cameras", help=text, description=text)
    kinds = cameras.add_subparsers(dest="kind", required=True, metavar="list|show|set|doctor|capture|...")
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument(
        "--source", default="genicam", metavar="SOURCE", help="genicam (default), replay:SESSION or simulated[:PRESET]"
    )
    common.add_argument(
        "--producer", action="append", default=[], metavar="FILE", help="a .cti file or folder to use as well"
    )
    common.add_argument(
        "--fault", action="append", default=[], metavar="FAULT", help="of a simulated camera, as `lose:C03@2-3`"
    )
    common.add_argument("--profile", type=Path, metavar="FILE", help="camera profile instead of the user's own")

    def add(name: str, help_text: str) -> argparse.ArgumentParser:
        return kinds.add_parser(name, help=help_text, description=help_text, parents=[common])

    add("list", "List cameras and drivers.")
    show = add("show", "Show a camera's settings, state and features.")
    show.add_argument("camera", metavar="SERIAL|NAME", help="its serial number or its name")
    _add_set(add("set", "Keep settings for a camera, and apply them if it is there."))
    doctor = add("doctor", "Test lines, rates and triggers, and say what to do.")
    doctor.add_argument("--seconds", type=_positive, default=5.0, help="how long to watch (default 5)")
    doctor.add_argument("--rate", type=_positive, default=5.0, metavar="HZ", help="images a second (default 5)")
    doctor.add_argument("--order", action="store_true", help="find out which camera is which, by covering lenses")
    doctor.add_argument(
        "--stagger", action="store_true", help="keep the delays with which GigE cameras share a line, and apply them"
    )
    _add_capture(add("capture", "Capture a session, set by set."))
    text = "Allow driver files (.cti) to be loaded, take the leave back, or list the files allowed."
    trust = kinds.add_parser("trust", help=text, description=text)
    trust.add_argument("files", nargs="*", metavar="FILE", help="driver files; without any: list")
    trust.add_argument("--forget", action="store_true", help="take the leave back")
    producer.add_parsers(lambda name, help_text: kinds.add_parser(name, help=help_text, description=help_text))


def _add_set(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("camera", metavar="SERIAL|NAME|all", help="its serial number or its name, or all cameras")
    parser.add_argument("--name", help="the name to show")
    parser.add_argument("--exposure-us", type=_positive, metavar="US", help="exposure time")
    parser.add_argument("--gain-db", type=float, metavar="DB", help="gain")
    parser.add_argument("--pixel-format", metavar="FORMAT", help="Mono8, Mono12, Mono12p, BayerRG8, ...")
    parser.add_argument("--region", type=int, nargs=4, metavar=("X", "Y", "W", "H"), help="part of the sensor")
    parser.add_argument("--full", action="store_true", help="the whole sensor")
    parser.add_argument("--trigger", choices=("software", "hardware", "free", "scheduled"), help="what starts an image")
    parser.add_argument("--trigger-source", metavar="INPUT", help="input of the hardware trigger, such as Line1")
    parser.add_argument("--frame-rate-hz", type=_positive, metavar="HZ", help="of a camera that runs free")
    parser.add_argument("--packet-size", type=int, metavar="BYTES", help="of a GigE camera's stream")
    parser.add_argument(
        "--packet-delay", type=int, metavar="TICKS", help="pause between packets, in the camera's ticks"
    )
    parser.add_argument("--frame-delay", type=int, metavar="TICKS", help="pause before an image is sent, in its ticks")
    parser.add_argument("--focal-length-mm", type=_positive, metavar="MM", help="of the lens, as its label says")
    parser.add_argument("--pixel-pitch-um", type=_positive, metavar="UM", help="of the sensor, as its data sheet says")
    parser.add_argument("--offline", action="store_true", help="only keep the settings, do not look for the camera")


def _add_capture(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="SESSION", help="the session folder to write"
    )
    parser.add_argument("--plan", type=Path, metavar="FILE", help="what to capture, in the form of session.json")
    parser.add_argument("--placements", type=int, metavar="N", help="without a plan: this many placements (default 4)")
    parser.add_argument("--targets", type=Path, metavar="targets.json", help="without a plan: the target set")
    parser.add_argument("--diameter-mm", type=_positive, metavar="MM", help="without a plan: of the ball")
    parser.add_argument("--average", type=int, default=1, metavar="N", help="images to average for each (default 1)")
    parser.add_argument("--timeout", type=_positive, default=1.0, metavar="S", help="for a set (default 1)")
    parser.add_argument("--retries", type=int, default=2, metavar="N", help="when a camera is missing (default 2)")
    parser.add_argument("--no-wait", action="store_true", help="do not ask before each set")
    parser.add_argument(
        "--before-each", metavar="COMMAND", help="run this before each set, its id in SPHERECAL_SET (a turntable, ...)"
    )
    parser.add_argument("--continue", dest="take_up", action="store_true", help="go on with an unfinished capture")


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < 1e12:
        raise argparse.ArgumentTypeError("a number above 0 is needed")
    return value
