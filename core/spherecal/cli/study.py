"""`spherecal study`: the paper's experiments repeated."""

import argparse
from collections.abc import Callable
from pathlib import Path

from spherecal.cli.progress import shown_progress

NAMES = ("layouts", "path", "noise", "cameras", "compare", "rigB")


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's options."""
    parser = add("study", "Repeat the experiments of the paper on simulated rigs; a page each.")
    parser.add_argument("names", nargs="*", type=_study, metavar="STUDY", help=f"{', '.join(NAMES)}; none: all")
    parser.add_argument("-o", "--output", type=Path, default=Path("spherecal-study"), metavar="DIR")
    parser.add_argument("--runs", type=_positive, metavar="N", help="repetitions with other seeds (each study its own)")
    parser.add_argument("--sigma", type=_noise, default=0.04, metavar="PX", help="image noise (default 0.04)")
    parser.add_argument("--seed", type=int, default=1, help="the first seed (default 1)")
    parser.add_argument("--workers", type=_count, default=2, metavar="N", help="local processes (default 2, 0: none)")
    parser.add_argument("--cluster", metavar="ADDRESS", help="an existing Dask scheduler instead, as tcp://HOST:8786")


def study(options: argparse.Namespace) -> int:
    """Run the studies named, or all; pages and results go into a folder, from which a stopped study goes on."""
    from spherecal.cli.commands import out
    from spherecal.study.executor import workers_for
    from spherecal.study.page import Options
    from spherecal.study.studies import STUDIES, run_study

    workers = workers_for(options.workers, options.cluster)
    for name in options.names or NAMES:
        asked = Options(options.runs or STUDIES[name].RUNS, options.sigma, options.seed)
        with shown_progress() as context:
            page = run_study(name, asked, options.output, workers, context)
        out.print(f"{name}: page in {page}.", markup=False)
    return 0


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
