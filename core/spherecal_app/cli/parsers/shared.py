"""How options are declared, and those that several commands share; light, since every command reads all parsers."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from spherecal.initialise.camera_path import Search

To = argparse._ActionsContainer  # of a parser and of a group
Number = TypeVar("Number", int, float)
BALL_METHODS = ("auto", "tao2021", "free", "rigid", "board", "bar")
PAGES = ("A4", "Letter")
PATH_BASE = 1.1  # spherecal.initialise.camera_path.BASE, which would load scipy
TH_ER_PX = 250.0  # spherecal.initialise.view_graph.TH_ER_PX
OF_THE_PAPER = "the paper's method, --method tao2021, alone"


# --- kinds of options ------------------------------------------------------------------------------------------------


def flag(to: To, name: str, text: str) -> None:
    """Add an option without a value."""
    to.add_argument(name, action="store_true", help=text)


def word(
    to: To, name: str, metavar: str | None, text: str, *, required: bool = False, default: str | None = None
) -> None:
    """Add an option that takes a word."""
    to.add_argument(name, metavar=metavar, default=default, help=text).required = required


def number(
    to: To,
    name: str,
    metavar: str | None,
    text: str,
    kind: Callable[[str], float] = float,
    *,
    default: float | None = None,
) -> None:
    """Add an option that takes a number."""
    to.add_argument(name, type=kind, metavar=metavar, default=default, help=text)


def path(
    to: To, name: str, metavar: str, text: str, kind: Callable[[str], Path] = Path, *, required: bool = False
) -> None:
    """Add an argument or an option that names a file or folder."""
    action = to.add_argument(name, type=kind, metavar=metavar, help=text)
    action.required = required or not action.option_strings


def repeated(to: To, name: str, metavar: str, text: str, kind: Callable[[str], object] = str) -> None:
    """Add an option that may be given again; its values are a list."""
    to.add_argument(name, action="append", default=[], type=kind, metavar=metavar, help=text)


def choice(to: To, name: str, among: Sequence[str], text: str, default: str | None = None) -> None:
    """Add an option that takes one of some words."""
    to.add_argument(name, choices=tuple(among), default=default, help=text)


# --- options of several commands -------------------------------------------------------------------------------------


def output(to: To, metavar: str, text: str, *, required: bool = True, default: Path | None = None) -> None:
    """Add `-o`, `--output`: what a command writes."""
    action = to.add_argument("-o", "--output", type=Path, metavar=metavar, default=default, help=text)
    action.required = required and default is None


def session(to: To, text: str = "the session folder") -> None:
    """Add the argument SESSION."""
    path(to, "session", "SESSION", text)


def result(to: To, text: str = "the result folder") -> None:
    """Add the argument RESULT."""
    path(to, "result", "RESULT", text)


def rig_file(text: str) -> Path:
    """A rig.json, named itself or by the folder of the result or profile that holds it."""
    given = Path(text)
    return given / "rig.json" if given.is_dir() else given


def rig(to: To, name: str = "--rig") -> None:
    """Add the rig.json that a command works with."""
    path(to, name, "rig.json", "the rig, or the folder of its result", rig_file, required=name.startswith("-"))


def search(to: To) -> None:
    """Add the variants that the paper's method is compared with: none-OPT in two orders, Dijkstra, none-SPO."""
    flag(to, "--no-opt", "none-OPT: use the first path that reaches a camera")
    flag(to, "--no-opt-listed", "none-OPT in the literal order of Algorithm 3: triples by number")
    flag(to, "--dijkstra", "use shortest paths instead of A*")
    flag(to, "--no-spo", "none-SPO: no spherical projection")
    text = "TH_pt: points that a group of three cameras needs in common (default 12)"
    number(to, "--th-pt", "N", text, between(int, 8, 1_000_000, "must be 8 or more"), default=12)
    text = "damping of the adjustment: of the diagonal (Marquardt) or by the identity (Levenberg)"
    choice(to, "--damping", ("diagonal", "identity"), text, "diagonal")


def search_of(options: argparse.Namespace) -> "Search":
    """The search that was asked for."""
    if options.no_opt_listed:
        return "first-listed"
    return "first" if options.no_opt else "dijkstra" if options.dijkstra else "opt"


def path_weights(to: To) -> None:
    """Add xi1, xi2, TH_er and b of [Tao21] (10)-(14), of --method tao2021 alone."""
    to.add_argument(
        "--path-weights",
        "--xi",
        type=float,
        nargs=2,
        default=(1.0, 1.0),
        metavar=("XI1", "XI2"),
        help="xi1, xi2: weights of the reprojection error and of 1/(common features) of an edge (default 1 1)",
    )
    text = f"TH_er: the mean reprojection error in a triple above which an edge is refused (default {TH_ER_PX:g})"
    to.add_argument("--path-error", "--th-er", type=float, metavar="PX", help=text, default=TH_ER_PX)
    text = f"b: the factor in the cost of a path for each further camera (default {PATH_BASE})"
    to.add_argument("--path-base", "--b", type=float, metavar="B", help=text, default=PATH_BASE)


def seed(to: To, text: str, default: int) -> None:
    """Add the seed of random choices: 0 to 2147483646."""
    number(to, "--seed", None, text, _seed, default=default)


def workers(to: To) -> None:
    """Add where many runs are computed."""
    number(to, "--workers", "N", "local processes (default 2, 0: none)", _COUNT, default=2)
    word(to, "--cluster", "ADDRESS", "an existing Dask scheduler instead, such as tcp://HOST:8786")


# --- values ----------------------------------------------------------------------------------------------------------


def between(kind: Callable[[str], Number], low: float, high: float, words: str) -> Callable[[str], Number]:
    """The kind of a `number` from `low` to `high`."""

    def converted(text: str) -> Number:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            raise argparse.ArgumentTypeError(words)
        return value

    return converted


_COUNT = between(int, 0, 256, "must be from 0 to 256")


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**31 - 1:
        raise argparse.ArgumentTypeError("a seed is a whole number from 0 to 2147483646")
    return int(text)
