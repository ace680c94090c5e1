"""`spherecal batch`: a whole folder of sessions calibrated, on this machine or on a cluster."""

import argparse

from rich.markup import escape
from rich.table import Table

from spherecal_app.cli.answer import answer
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.console import out, say
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_app.cli.parsers.shared import search_of
from spherecal_app.cli.progress import shown_progress
from spherecal_study.batch_of_sessions import run_batch
from spherecal_study.executor import workers_for


def batch(options: argparse.Namespace) -> int:
    """`spherecal batch`: 3 where any session failed or is not valid. A batch that was stopped goes on where it was."""
    settings = {
        "method": options.method,
        "search": search_of(options),
        "spherical_projection": not options.no_spo,
        "th_pt": options.th_pt,
        "damping": options.damping,
        "intrinsics": options.intrinsics,
        "own_intrinsics": options.own_intrinsics,
        "seed": options.seed,
    }
    with shown_progress() as context:
        compile_first(context)
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
    say(f"Table in {done.page}.")
    return DONE if done.valid else NOT_VALID
