"""The options of `profile` and `limits`."""

import argparse
from datetime import datetime
from pathlib import Path

from spherecal_app.cli.parsers.shared import flag, number, output, path, result, word
from spherecal_app.cli.parsing import Add, commands_below


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
