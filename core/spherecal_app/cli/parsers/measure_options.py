"""The options of `measure`."""

import argparse
from pathlib import Path

from spherecal_app.cli.parsers.shared import choice, flag, number, output, path, repeated
from spherecal_app.cli.parsing import Add


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
