"""The options of `demo` and `simulate`."""

from pathlib import Path

from spherecal_app.cli.parsers.shared import flag, output, seed
from spherecal_app.cli.parsing import Add


def add_demo(add: Add) -> None:
    """`spherecal demo`."""
    demo = add("demo", "Calibrate and verify a simulated rig, from end to end.")
    output(demo, "DIR", "folder for all its files (default spherecal-demo)", default=Path("spherecal-demo"))


def add_simulate(add: Add) -> None:
    """`spherecal simulate`."""
    simulate = add("simulate", "Make a session of a simulated rig with its truth.json.")
    simulate.add_argument(
        "preset",
        help="demo, rigA, rigB, hall24, hall50, hall100, dome24, or any hallN, domeN, wideN (lens of N degrees)",
    )
    output(simulate, "SESSION", "the session folder to write")
    flag(simulate, "--observations-only", "make observations instead of images")
    seed(simulate, "seed of the rig and its noise (default 1)", 1)
