"""The parser of the command line: whole option names only, suggestions for misspelt words, options of all commands."""

import argparse
import difflib
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NoReturn

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase

if TYPE_CHECKING:
    from spherecal.files.atomic import Marker

# Sixteen misspellings and shortenings of our commands ("verfy", "barz", "calib") score 0.71 to 0.96 against the right
# one; of 325 pairs of commands three are above 0.6.
_LIKE = 0.6
# What these print is a text by itself: help for a person, a script for a shell.
_TEXT = (("help",), ("completion",))


class Parser(argparse.ArgumentParser):
    """A parser that takes no abbreviated options and says which word may be meant; its subparsers are such too."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **{"allow_abbrev": False, **kwargs})
        self.set_defaults(leaf=self)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        choices = action.choices
        if choices is None or value in choices:
            return
        names = [str(choice) for choice in choices]
        meant = difflib.get_close_matches(str(value), names, 1, _LIKE)
        if isinstance(action, argparse._SubParsersAction):
            problem = f'there is no command "{value}"'
            rest = f'is "{meant[0]}" meant?' if meant else f"there are {', '.join(names)}"
        else:
            problem = f'must be {" or ".join(names)}, not "{value}"'
            rest = f'is "{meant[0]}" meant?' if meant else ""
        raise argparse.ArgumentError(action, "; ".join(filter(None, (problem, rest))))

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The options; words that no parser knows end the program with a message of the command they were given to."""
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            options.leaf.refuse(unknown)
        return options

    def refuse(self, unknown: Sequence[str]) -> NoReturn:
        """End with a message about words that this command does not know."""
        known = [name for action in self._actions for name in action.option_strings]
        option = next((word.split("=")[0] for word in unknown if word.startswith("-")), None)
        meant = difflib.get_close_matches(option, known, 1, _LIKE) if option is not None else []
        self.error(f"not known: {' '.join(unknown)}" + (f'; is "{meant[0]}" meant?' if meant else ""))


def parsers_below(parser: argparse.ArgumentParser) -> Iterator[tuple[tuple[str, ...], argparse.ArgumentParser]]:
    """Every parser with the words that lead to it, itself first."""
    yield (), parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                for words, found in parsers_below(inner):
                    yield (name, *words), found


def is_leaf(parser: argparse.ArgumentParser) -> bool:
    """Whether a command has no subcommands."""
    return not any(isinstance(action, argparse._SubParsersAction) for action in parser._actions)


def add_common(parser: argparse.ArgumentParser) -> None:
    """Add the options of all commands; before or after the command they mean the same."""
    for words, one in parsers_below(parser):
        kept: dict[str, Any] = {"default": argparse.SUPPRESS} if words else {}
        group = one.add_argument_group("output")
        group.add_argument("--log", type=Path, metavar="FILE", help="write a log to this file", **kept)
        voice = group.add_mutually_exclusive_group()
        voice.add_argument("-v", "--verbose", action="store_true", help="show the log on standard error", **kept)
        voice.add_argument("-q", "--quiet", action="store_true", help="print errors and JSON only", **kept)
        if is_leaf(one) and words not in _TEXT and "--json" not in one._option_string_actions:
            group.add_argument("--json", action="store_true", help="print what the command tells as JSON, nothing else")


def rig_file(text: str) -> Path:
    """A rig.json, named itself or by the folder of the result or profile that holds it."""
    path = Path(text)
    return path / "rig.json" if path.is_dir() else path


def check_output_folder(path: Path, marker: "Marker") -> None:
    """InputError for "-", as a folder cannot go to standard output; else as `check_folder`."""
    from spherecal.files.atomic import check_folder

    if is_standard_output(path):
        raise InputError(Phrase("error-folder-to-output"))
    check_folder(path, marker)


def to_output(path: Path, data: bytes) -> None:
    """Write a single file whole; "-" is standard output."""
    from spherecal.files.atomic import write_file_whole

    with output_file(path) as place:
        write_file_whole(place, data)


def is_standard_output(path: object) -> bool:
    """Whether an option names standard output."""
    return isinstance(path, Path) and str(path) == "-"


@contextmanager
def output_file(path: Path) -> Iterator[Path]:
    """Where to write a command's one file: `path`, or for "-" a temporary file that then goes to standard output."""
    if not is_standard_output(path):
        yield path
        return
    with TemporaryDirectory() as folder:
        place = Path(folder) / "output"
        yield place
        if place.is_dir():
            raise InputError(Phrase("error-folder-to-output"))
        sys.stdout.flush()
        sys.stdout.buffer.write(place.read_bytes())
        sys.stdout.buffer.flush()
