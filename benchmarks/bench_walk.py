"""Clicks and seconds of the whole walk, as the window itself counts them: `python3 dev.py bench walk`.

Three walks of the training by real clicks on a virtual screen (installer/walk.py), from the start page to the report
and back: clicks, seconds in all and in each step, the longest stall of the window, the first picture of its scene. In
training the ball moves by itself, at once: what is measured is what the program asks of somebody beside that.
"""

import argparse
import json
import os
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.figures import Figures  # noqa: E402
from installer.walk import walk  # noqa: E402

MOST_CLICKS, MOST_S = 20, 60.0


def main() -> None:
    """Walk, and print each run and the middle one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--save", action="store_true", help="write the figures into baseline.json")
    options = parser.parse_args()
    path = os.pathsep.join([str(ROOT / "core"), str(ROOT)])
    program = [
        "/usr/bin/env",
        f"PYTHONPATH={path}",
        "SPHERECAL_KERNELS=",
        sys.executable,
        "-m",
        "benchmarks.timed_window",
    ]
    runs: list[dict[str, Any]] = []
    for _ in range(options.runs):
        with tempfile.TemporaryDirectory() as folder:
            walk(program, Path(folder))
            runs.append(json.loads((Path(folder) / "times.json").read_text(encoding="utf-8")))
        print({key: value for key, value in runs[-1].items() if key != "entered, s"}, flush=True)
        entered = [*runs[-1]["entered, s"].items(), ("the end", runs[-1]["seconds"])]
        print("  " + ", ".join(f"{step} {after - at:.1f}" for (step, at), (_, after) in pairwise(entered)), flush=True)
    middle = sorted(runs, key=lambda run: run["seconds"])[len(runs) // 2]
    print(f"goals: at most {MOST_CLICKS} clicks, {MOST_S:.0f} s; the load of the machine is {os.getloadavg()[0]:.1f}")
    Figures("walk", {f"walk: {key}": value for key, value in middle.items() if key != "entered, s"}).save(options)


if __name__ == "__main__":
    main()
