"""`spherecal study`, the paper's experiments repeated, and `spherecal batch`, a whole folder of sessions calibrated."""

import argparse
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.initialise.camera_path import BASE
from spherecal.initialise.view_graph import TH_ER_PX
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.console import answer, out, say, shown_progress
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_app.cli.options import STUDY_NAMES, search_of
from spherecal_sim.rigs import rig_design
from spherecal_study.batch_of_sessions import run_batch
from spherecal_study.executor import workers_for
from spherecal_study.on_sessions import NAMES as ON_SESSIONS
from spherecal_study.on_sessions import RUNS, SessionOptions, run_session_study
from spherecal_study.studies import STUDIES, run_study
from spherecal_study.study_page import Options

_SIGMA_PX = 0.04
_LONG = ("rigB", "bar")  # on images only when asked for: big rigs, or not at all


def study(options: argparse.Namespace) -> int:
    """`spherecal study`: pages and results go into a folder, from which a stopped study goes on."""
    workers = workers_for(options.workers, options.cluster)
    run = _of_session if options.session is not None else _of_rigs
    pages = {}
    for name, start in run(options):
        with shown_progress() as context:
            page = start(options.output, workers, context)
        pages[name] = page
        say(f"{name}: page in {page}.")
    answer(options, pages)
    return DONE


_Start = Callable[..., Path]


def _of_rigs(options: argparse.Namespace) -> Iterator[tuple[str, _Start]]:
    if options.images and options.sigma is not None:
        raise InputError(Phrase("error-study-noise"))
    if options.rig is not None:
        rig_design(options.rig)  # refused now rather than in a worker
    sigma = None if options.images else options.sigma or _SIGMA_PX
    names = options.names or [name for name in STUDY_NAMES if not options.images or name not in _LONG]
    for name in names:
        runs = options.runs or (1 if options.images else STUDIES[name].RUNS)
        asked = Options(runs, sigma, options.seed, options.rig, options.known, _paths(options))
        yield name, partial(run_study, name, asked, kept_only=options.kept)


def _paths(options: argparse.Namespace) -> tuple[float, float, float, float] | None:
    """xi1, xi2, TH_er and b; None where all are the method's own."""
    asked = (*options.path_weights, options.path_error, options.path_base)
    return None if asked == (1.0, 1.0, TH_ER_PX, BASE) else asked


def _of_session(options: argparse.Namespace) -> Iterator[tuple[str, _Start]]:
    own = options.known or options.kept or _paths(options) is not None
    if options.images or options.rig is not None or options.sigma is not None or own:
        raise InputError(Phrase("error-study-recording"))
    asked = SessionOptions(options.session, options.runs or RUNS, options.seed)
    for name in options.names or ON_SESSIONS:
        yield name, partial(run_session_study, name, asked)


def batch(options: argparse.Namespace) -> int:
    """`spherecal batch`: 3 where any session failed or is not valid. A batch that was stopped goes on where it was."""
    settings = {
        "method": options.method, "search": search_of(options), "spherical_projection": not options.no_spo,
        "th_pt": options.th_pt, "damping": options.damping, "intrinsics": options.intrinsics,
        "own_intrinsics": options.own_intrinsics, "seed": options.seed,
    }  # fmt: skip
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
