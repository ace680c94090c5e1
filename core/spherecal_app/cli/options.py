"""The parser of all commands, made of the table resources/commands.toml; light, since every command reads it."""

import argparse
import tomllib
from collections.abc import Callable, Mapping
from datetime import date, datetime
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spherecal import __version__
from spherecal.base.resources import resource_path
from spherecal_app.cli.parsing import Parser, add_common, commands_below, main_parser

if TYPE_CHECKING:
    from spherecal.initialise.camera_path import Search

TABLE = tomllib.loads(resource_path("commands.toml").read_text(encoding="utf-8"))
STUDY_NAMES = ("layouts", "path", "noise", "cameras", "compare", "rigB", "bar")


def make_parser() -> Parser:
    """The parser of all commands."""
    parser = main_parser(
        "spherecal",
        "Calibrate a rig of many cameras with an imperfect ball. Without a command, the window opens.",
        "`spherecal COMMAND --help` says more of a command. "
        "Exit codes: 0 done; 2 bad usage or input; 3 done, but the result is not valid; 130 cancelled.",
    )
    parser.add_argument(
        "-V", "--version", action="version", version=f"spherecal {__version__}", help="print the version and end"
    )
    parser.sections = TABLE["sections"]
    add = {"": commands_below(parser, "COMMAND", "command", required=False)}
    for words, about in TABLE["commands"].items():
        above, _, name = words.rpartition(" ")
        command = add[above](name, about["help"])
        if "below" in about:
            add[words] = commands_below(command, about["below"])
        # options after a `group` belong to it, `use` takes those that commands share
        to: argparse._ActionsContainer = command
        for row in about.get("options", ()):
            if "group" in row:
                to = command.add_argument_group(row["group"]) if row["group"] else command
            elif "use" in row:
                for one in TABLE["shared"][row["use"]]:
                    _add_option(to, one)
            else:
                _add_option(to, row)
        if "brief" in about:
            command.show_only(*about["brief"])
    add_common(parser)
    return parser


def words_of(options: argparse.Namespace) -> str:
    """The words of the command, as in the table."""
    return " ".join(filter(None, (options.command, getattr(options, "action", None))))


def command_of(options: argparse.Namespace) -> Callable[[argparse.Namespace], int]:
    """The function that runs the command and returns the exit code; its module is loaded now, with what it needs."""
    module, function = TABLE["commands"][words_of(options)]["run"].split(":")
    return getattr(import_module(f"spherecal_app.cli.{module}"), function)


def search_of(options: argparse.Namespace) -> "Search":
    """The search that the options `search` ask for."""
    if options.no_opt_listed:
        return "first-listed"
    return "first" if options.no_opt else "dijkstra" if options.dijkstra else "opt"


def _add_option(to: argparse._ActionsContainer, row: Mapping[str, Any]) -> None:
    """Add an option: its kind has the name of its value in the help, what else it has is argparse's."""
    given: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) and value else value for key, value in row.items()
    }
    names, limits = given.pop("name").split(), given.pop("between", None)
    if given.pop("flag", False):
        given["action"] = "store_true"
    if given.pop("again", False):
        given |= {"action": "append", "default": []}
    if "choice" in given:
        given["choices"] = given.pop("choice")
    for kind in _KINDS.keys() & given.keys():
        given["metavar"] = given.pop(kind) or None
        given["type"] = _between(_KINDS[kind], *limits) if limits else _KINDS[kind]
    to.add_argument(*names, **given)


def _between(kind: Callable[[str], Any], low: float, high: float, words: str) -> Callable[[str], Any]:
    """A number of this kind from `low` to `high`; `words` say so."""

    def converted(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            raise argparse.ArgumentTypeError(words)
        return value

    return converted


def _rig_file(text: str) -> Path:
    """A rig.json, named itself or by the folder of the result or profile that holds it."""
    given = Path(text)
    return given / "rig.json" if given.is_dir() else given


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**31 - 1:
        raise argparse.ArgumentTypeError("a seed is a whole number from 0 to 2147483646")
    return int(text)


def _date(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError("a date is written as 2026-05-31") from None


def _spacing(text: str) -> tuple[float, float]:
    length, _, u = text.partition(",")
    return float(length), float(u)


def _study(text: str) -> str:
    if text not in STUDY_NAMES:
        raise argparse.ArgumentTypeError(f"there is no study {text!r}; there are {', '.join(STUDY_NAMES)}")
    return text


_KINDS: dict[str, Callable[[str], Any]] = {
    "word": str, "path": Path, "number": float, "whole": int, "rig": _rig_file, "seed": _seed, "date": _date,
    "time": datetime.fromisoformat, "spacing": _spacing, "study": _study,
}  # fmt: skip
