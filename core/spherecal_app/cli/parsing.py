"""The parser of the command line: whole option names only, suggestions for misspelt words, options of all commands."""

import argparse
import difflib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

# Adds a command by its name and a sentence on it.
Add = Callable[[str, str], "Parser"]

# Sixteen misspellings and shortenings of our commands ("verfy", "barz", "calib") score 0.71 to 0.96 against the right
# one; of 325 pairs of commands three are above 0.6.
_LIKE = 0.6
_COMMON = ("--log", "--verbose", "--quiet", "--json")
# What these print is a text by itself: help for a person, a script for a shell.
_TEXT = (("help",), ("completion",))


class _HelpAll(argparse.Action):
    """`--help-all`: the help with the options that `--help` leaves out."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        assert isinstance(parser, Parser)
        print(argparse.ArgumentParser.format_help(parser), end="")
        parser.exit()


class Parser(argparse.ArgumentParser):
    """Says which word may be meant; `sections` group its commands, of `brief` options alone `--help` shows."""

    sections: Mapping[str, Sequence[str]] = {}
    brief: Collection[str] = ()

    def show_only(self, *names: str) -> None:
        """Let `--help` show these options alone, and `--help-all` the whole."""
        self.brief = names
        self.add_argument("--help-all", action=_HelpAll, nargs=0, help="show this help with all options, and end")

    def format_help(self) -> str:
        """The help that `--help` prints."""
        if not self.sections and not self.brief:
            return super().format_help()
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._shown(self._actions), self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                by_name = {one.dest: one for one in action._choices_actions}
                for heading, names in self.sections.items():
                    _add_section(formatter, heading, [by_name[name] for name in names])
        for group in self._action_groups:
            listed = [one for one in group._group_actions if not isinstance(one, argparse._SubParsersAction)]
            _add_section(formatter, group.title, self._shown(listed))
        formatter.add_text(self.epilog)
        return formatter.format_help()

    def _shown(self, actions: Sequence[argparse.Action]) -> list[argparse.Action]:
        always = ("--help", "--help-all", *_COMMON)
        return [
            one
            for one in actions
            if not (self.brief and one.option_strings) or {*one.option_strings} & {*self.brief, *always}
        ]

    def error(self, message: str) -> NoReturn:
        """End with one line: what is wrong, and where the help is."""
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                named = f"one of {', '.join(action.choices)}"
                message = message.replace(f"required: {action.metavar}", f"required: {named}")
        for word, wanted in (("float", "a number"), ("int", "a whole number")):
            message = message.replace(f"invalid {word} value:", f"{wanted} is needed, not")
        end = "" if message.endswith(("?", ".")) else "."
        self.exit(2, f"{self.prog}: error: {message}{end} Help: {self.prog} --help\n")

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


def _add_section(formatter: argparse.HelpFormatter, heading: str | None, actions: Sequence[argparse.Action]) -> None:
    formatter.start_section(heading)
    formatter.add_arguments(actions)
    formatter.end_section()


def main_parser(program: str, description: str, epilog: str) -> Parser:
    """A parser without options yet: no option may be abbreviated."""
    parser = Parser(prog=program, description=description, epilog=epilog, allow_abbrev=False)
    parser.set_defaults(leaf=parser)
    return parser


def commands_below(
    parser: argparse.ArgumentParser, metavar: str, dest: str = "action", *, required: bool = True
) -> Add:
    """The function that adds a command below this one."""
    commands = parser.add_subparsers(dest=dest, required=required, metavar=metavar, parser_class=Parser)

    def add(name: str, text: str) -> Parser:
        first = text.partition(". ")[0].rstrip(".") + "."  # in the list of commands one sentence is enough
        one = commands.add_parser(name, help=first, description=text, allow_abbrev=False)
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
