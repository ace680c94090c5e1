"""The parser of the command line: whole option names only, suggestions for misspelt words, options of all commands."""

import argparse
import difflib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NoReturn

# Adds a command by its name and a sentence on it.
Add = Callable[[str, str], argparse.ArgumentParser]

# Sixteen misspellings and shortenings of our commands ("verfy", "barz", "calib") score 0.71 to 0.96 against the right
# one; of 325 pairs of commands three are above 0.6.
_LIKE = 0.6
# What these print is a text by itself: help for a person, a script for a shell.
_TEXT = (("help",), ("completion",))


class Parser(argparse.ArgumentParser):
    """A parser that says which word may be meant; `commands_below` makes its subparsers."""

    def _check_value(self, action: argparse.Action, value: object) -> None:
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

    def parse_args(self, args: Sequence[str] | None = None) -> argparse.Namespace:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The options; words that no parser knows end the program with a message of the command they were given to."""
        options, unknown = self.parse_known_args(args, argparse.Namespace())
        if unknown:
            options.leaf.refuse(unknown)
        return options

    def refuse(self, unknown: Sequence[str]) -> NoReturn:
        """End with a message about words that this command does not know."""
        known = [name for action in self._actions for name in action.option_strings]
        option = next((word.split("=")[0] for word in unknown if word.startswith("-")), None)
        meant = difflib.get_close_matches(option, known, 1, _LIKE) if option is not None else []
        self.error(f"not known: {' '.join(unknown)}" + (f'; is "{meant[0]}" meant?' if meant else ""))


def main_parser(program: str, description: str, epilog: str) -> Parser:
    """A parser without options yet: no option may be abbreviated."""
    parser = Parser(prog=program, description=description, epilog=epilog, allow_abbrev=False)
    parser.set_defaults(leaf=parser)
    return parser


def commands_below(
    parser: argparse.ArgumentParser,
    metavar: str = "ACTION",
    dest: str = "action",
    *,
    required: bool = True,
) -> Add:
    """The function that adds a command below this one."""
    commands = parser.add_subparsers(dest=dest, required=required, metavar=metavar)

    def add(name: str, text: str) -> argparse.ArgumentParser:
        one = commands.add_parser(name, help=text, description=text, allow_abbrev=False)
        one.set_defaults(leaf=one)
        return one

    return add


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
        path, said = (argparse.SUPPRESS, argparse.SUPPRESS) if words else (None, False)  # what they are unless given
        group = one.add_argument_group("output")
        group.add_argument("--log", type=Path, metavar="FILE", default=path, help="write a log to this file")
        voice = group.add_mutually_exclusive_group()
        voice.add_argument("-v", "--verbose", action="store_true", default=said, help="show the log on standard error")
        voice.add_argument("-q", "--quiet", action="store_true", default=said, help="print errors and JSON only")
        if is_leaf(one) and words not in _TEXT and "--json" not in one._option_string_actions:
            group.add_argument("--json", action="store_true", help="print the result as JSON and nothing else")


def is_standard_output(path: object) -> bool:
    """Whether an option names standard output."""
    return isinstance(path, Path) and str(path) == "-"
