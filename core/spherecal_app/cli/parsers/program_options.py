"""The options of commands about the program itself, and of `demo`, `simulate` and `study`."""

import argparse
from pathlib import Path

from spherecal_app.cli.parsers import shared
from spherecal_app.cli.parsing import Add


def add_help(add: Add) -> None:
    """`spherecal help`."""
    helping = add("help", "Show the help of a command, as its --help does.")
    helping.add_argument("words", nargs="*", metavar="COMMAND", help="such as `calibrate` or `profile save`")


def add_licences(add: Add) -> None:
    """`spherecal licences`."""
    licences = add("licences", "List third-party parts of this program, and their licences.")
    shared.path(licences, "--texts", "FILE", "write all licence texts to this file")
    shared.path(licences, "--sbom", "FILE", "write a bill of materials (CycloneDX JSON)")


def add_manual(add: Add) -> None:
    """`spherecal manual`."""
    manual = add("manual", "Say where the manual is on this computer.")
    shared.choice(manual, "--language", ("en", "de", "zh"), "language of the manual (default en)", "en")
    shared.flag(manual, "--open", "open it in the web browser")


def add_completion(add: Add) -> None:
    """`spherecal completion`."""
    completion = add("completion", "Print a script that completes commands and options in your shell.")
    shared.choice(completion, "shell", ("bash", "zsh", "fish"), 'for example: eval "$(spherecal completion bash)"')


def add_compile_kernels(add: Add) -> None:
    """`spherecal compile-kernels`."""
    one = add("compile-kernels", "Compile the numeric kernels now, instead of during the first calibration.")
    shared.flag(one, "--idle", "only while the processor has nothing else to do")
    shared.flag(one, "--json", "print a line of JSON for every step: `done` and `all`")


def add_doctor(add: Add) -> None:
    """`spherecal doctor`."""
    add("doctor", "Say what this machine has and lacks.")


def add_demo(add: Add) -> None:
    """`spherecal demo`."""
    demo = add("demo", "Calibrate and verify a simulated rig, from end to end.")
    shared.output(demo, "DIR", "folder for all its files (default spherecal-demo)", default=Path("spherecal-demo"))


def add_simulate(add: Add) -> None:
    """`spherecal simulate`."""
    simulate = add("simulate", "Make a session of a simulated rig with its truth.json.")
    simulate.add_argument(
        "preset",
        help="demo, rigA, rigB, hall24, hall50, hall100, dome24, or any hallN, domeN, wideN (lens of N degrees)",
    )
    shared.output(simulate, "SESSION", "the session folder to write")
    shared.flag(simulate, "--observations-only", "make observations instead of images")
    shared.seed(simulate, "seed of the rig and its noise (default 1)", 1)


NAMES = ("layouts", "path", "noise", "cameras", "compare", "rigB", "bar")
_NOISE_PX = shared.between(float, 1e-4, 10, "must be from 0.0001 to 10 px")


def add_study(add: Add) -> None:
    """`spherecal study`."""
    study = add("study", "Repeat the experiments of the paper on simulated rigs; write a page for each.")
    study.add_argument("names", nargs="*", type=_study, metavar="STUDY", help=f"{', '.join(NAMES)}; none: all")
    shared.output(study, "DIR", "folder for the pages (default spherecal-study)", default=Path("spherecal-study"))
    shared.number(
        study,
        "--runs",
        "N",
        "repetitions with other seeds (the default depends on the study)",
        shared.between(int, 1, 2**31, "must be 1 or more"),
    )
    shared.number(study, "--sigma", "PX", "image noise of simulated observations (0.04)", _NOISE_PX)
    shared.seed(study, "the first seed (default 1)", 1)
    shared.flag(study, "--known", "exactly known intrinsics, as in Algorithm 1, not those of data sheets")
    shared.path_weights(study)
    shared.flag(study, "--kept", "run nothing: make pages from the saved results")
    shared.word(study, "--rig", "PRESET", "a simulated rig other than the study's own")
    text = "rendered images instead of simulated observations; on the demo's small rig unless --rig names another"
    shared.flag(study, "--images", text)
    shared.path(study, "--session", "FOLDER", "your own recording instead: layouts, path, cameras")
    shared.workers(study)


def _study(text: str) -> str:
    if text not in NAMES:
        raise argparse.ArgumentTypeError(f"there is no study {text!r}; there are {', '.join(NAMES)}")
    return text
