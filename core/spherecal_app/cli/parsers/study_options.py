"""The options of `study`."""

import argparse
from pathlib import Path

from spherecal_app.cli.parsers.shared import between, flag, number, output, path, path_weights, seed, word, workers
from spherecal_app.cli.parsing import Add

NAMES = ("layouts", "path", "noise", "cameras", "compare", "rigB", "bar")
_NOISE_PX = between(float, 1e-4, 10, "must be from 0.0001 to 10 px")


def add_study(add: Add) -> None:
    """`spherecal study`."""
    study = add("study", "Repeat the experiments of the paper on simulated rigs; write a page for each.")
    study.add_argument("names", nargs="*", type=_study, metavar="STUDY", help=f"{', '.join(NAMES)}; none: all")
    output(study, "DIR", "folder for the pages (default spherecal-study)", default=Path("spherecal-study"))
    number(
        study,
        "--runs",
        "N",
        "repetitions with other seeds (the default depends on the study)",
        between(int, 1, 2**31, "must be 1 or more"),
    )
    number(study, "--sigma", "PX", "image noise of simulated observations (0.04)", _NOISE_PX)
    seed(study, "the first seed (default 1)", 1)
    flag(study, "--known", "exactly known intrinsics, as in Algorithm 1, not those of data sheets")
    path_weights(study)
    flag(study, "--kept", "run nothing: make pages from the saved results")
    word(study, "--rig", "PRESET", "a simulated rig other than the study's own")
    text = "rendered images instead of simulated observations; on the demo's small rig unless --rig names another"
    flag(study, "--images", text)
    path(study, "--session", "FOLDER", "your own recording instead: layouts, path, cameras")
    workers(study)


def _study(text: str) -> str:
    if text not in NAMES:
        raise argparse.ArgumentTypeError(f"there is no study {text!r}; there are {', '.join(NAMES)}")
    return text
