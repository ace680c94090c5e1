"""`spherecal batch`: a whole folder of sessions calibrated, on this machine or on a cluster."""

import argparse
from collections.abc import Callable
from pathlib import Path

from spherecal.cli.answer import answer
from spherecal.cli.progress import shown_progress
from spherecal.cli.search import add_search, search_of
from spherecal.cli.study import add_workers


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's options."""
    parser = add("batch", "Calibrate every session below a folder; a result each and a table page of all.")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="the folder with the session folders")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for all results")
    parser.add_argument(
        "--method",
        choices=("auto", "tao2021", "free", "rigid", "board", "bar"),
        default="auto",
        help="as of `calibrate` (default auto)",
    )
    add_search(parser)
    parser.add_argument(
        "--intrinsics", choices=("free", "fixed"), default="free", help="as of `calibrate` (default free)"
    )
    parser.add_argument("--own-intrinsics", action="store_true", help="every camera for itself")
    parser.add_argument("--seed", type=int, default=0, help="of the random choices of triples (default 0)")
    add_workers(parser)


def batch(options: argparse.Namespace) -> int:
    """Calibrate all; 3 where any session failed or is not valid. A batch that was stopped goes on where it was."""
    from rich.markup import escape
    from rich.table import Table

    from spherecal.cli.commands import out
    from spherecal.cli.main import DONE, NOT_VALID
    from spherecal_study.batch import run_batch
    from spherecal_study.executor import workers_for

    settings = {
        "method": options.method,
        "search": search_of(options),
        "spherical_projection": not options.no_spo,
        "intrinsics": options.intrinsics,
        "own_intrinsics": options.own_intrinsics,
        "seed": options.seed,
    }
    with shown_progress() as context:
        workers = workers_for(options.workers, options.cluster)
        done = run_batch(options.folder, options.output, settings, workers, context)
    answer(options, done.rows)
    table = Table("session", "outcome", "cameras", "rms px", "bars", "message", box=None)
    for row in done.rows:
        cameras = "-" if row["cameras"] is None else f"{row['cameras_placed']} of {row['cameras']}"
        px = "-" if row["rms_px"] is None else f"{row['rms_px']:.4f}"
        cells = (row["session"], row["outcome"], cameras, px, row["verification"] or "-", row["message"])
        table.add_row(*map(escape, cells))
    out.print(table)
    out.print(f"Table in {done.page}.", markup=False)
    return DONE if done.valid else NOT_VALID
