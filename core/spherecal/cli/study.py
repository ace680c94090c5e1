"""`spherecal study`: the paper's experiments repeated."""

import argparse
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.cli.progress import shown_progress
from spherecal.cli.search import add_path_weights
from spherecal.initialise.path import BASE

NAMES = ("layouts", "path", "noise", "cameras", "compare", "rigB", "bar")
_SIGMA_PX = 0.04
_LONG = ("rigB", "bar")  # on images only when asked for: big rigs, or not at all


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's options."""
    parser = add("study", "Repeat the experiments of the paper on simulated rigs; a page each.")
    parser.add_argument("names", nargs="*", type=_study, metavar="STUDY", help=f"{', '.join(NAMES)}; none: all")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("spherecal-study"),
        metavar="DIR",
        help="folder for the pages (default spherecal-study)",
    )
    parser.add_argument("--runs", type=_positive, metavar="N", help="repetitions with other seeds (each study its own)")
    parser.add_argument("--sigma", type=_noise, metavar="PX", help="image noise of simulated observations (0.04)")
    parser.add_argument("--seed", type=int, default=1, help="the first seed (default 1)")
    parser.add_argument(
        "--known", action="store_true", help="intrinsics known before, as Algorithm 1 has them, not the data sheets'"
    )
    add_path_weights(parser)
    parser.add_argument("--kept", action="store_true", help="run nothing: pages from the results that are kept")
    parser.add_argument("--rig", metavar="PRESET", help="another simulated rig than the study's own")
    parser.add_argument(
        "--images",
        action="store_true",
        help="rendered images instead of simulated observations; on the demo's small rig unless --rig names another",
    )
    parser.add_argument(
        "--session", type=Path, metavar="FOLDER", help="your own recording instead: layouts, path, cameras"
    )
    add_workers(parser)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Where many runs are computed."""
    parser.add_argument("--workers", type=_count, default=2, metavar="N", help="local processes (default 2, 0: none)")
    parser.add_argument("--cluster", metavar="ADDRESS", help="an existing Dask scheduler instead, as tcp://HOST:8786")


def study(options: argparse.Namespace) -> int:
    """Run the studies named, or all; pages and results go into a folder, from which a stopped study goes on."""
    from spherecal.cli.answer import answer
    from spherecal.cli.commands import out
    from spherecal_study.executor import workers_for

    workers = workers_for(options.workers, options.cluster)
    run = _of_session if options.session is not None else _of_rigs
    pages = {}
    for name, start in run(options):
        with shown_progress() as context:
            page = start(options.output, workers, context)
        pages[name] = page
        out.print(f"{name}: page in {page}.", markup=False)
    answer(options, pages)
    return 0


_Start = Callable[..., Path]


def _of_rigs(options: argparse.Namespace) -> Iterator[tuple[str, _Start]]:
    from spherecal_study.page import Options
    from spherecal_study.studies import STUDIES, run_study

    if options.images and options.sigma is not None:
        raise InputError(Phrase("error-study-noise"))
    if options.rig is not None:
        from spherecal_sim.rigs import rig_design

        rig_design(options.rig)  # refused now rather than in a worker
    sigma = None if options.images else options.sigma or _SIGMA_PX
    names = options.names or [name for name in NAMES if not options.images or name not in _LONG]
    for name in names:
        runs = options.runs or (1 if options.images else STUDIES[name].RUNS)
        asked = Options(runs, sigma, options.seed, options.rig, options.known, _paths(options))
        yield name, partial(run_study, name, asked, kept_only=options.kept)


def _paths(options: argparse.Namespace) -> tuple[float, float, float | None, float] | None:
    """xi1, xi2, TH_er and b; None where all are the method's own."""
    asked = (*options.path_weights, options.path_error, options.path_base)
    return None if asked == (1.0, 1.0, None, BASE) else asked


def _of_session(options: argparse.Namespace) -> Iterator[tuple[str, _Start]]:
    from spherecal_study.on_sessions import NAMES as ON_SESSIONS
    from spherecal_study.on_sessions import RUNS, SessionOptions, run_session_study

    own = options.known or options.kept or _paths(options) is not None
    if options.images or options.rig is not None or options.sigma is not None or own:
        raise InputError(Phrase("error-study-recording"))
    asked = SessionOptions(options.session, options.runs or RUNS, options.seed)
    for name in options.names or ON_SESSIONS:
        yield name, partial(run_session_study, name, asked)


def _study(text: str) -> str:
    if text not in NAMES:
        raise argparse.ArgumentTypeError(f"there is no study {text!r}; there are {', '.join(NAMES)}")
    return text


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be 1 or more")
    return value


def _count(text: str) -> int:
    value = int(text)
    if not 0 <= value <= 256:
        raise argparse.ArgumentTypeError("must be from 0 to 256")
    return value


def _noise(text: str) -> float:
    value = float(text)
    if not 1e-4 <= value <= 10:
        raise argparse.ArgumentTypeError("must be from 0.0001 to 10 px")
    return value
