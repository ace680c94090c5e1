"""How long the diagnosis takes against the adjustment in the same run: alone, and beside two busy processes.

Wall and processor seconds of each part of `calibrate()`, each recording in a new process after one to compile. Besides
simulated rigs a real session can be given (`--session FOLDER`), whose lenses follow no model.
"""

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from figures import Figures, add_options

from spherecal import calibrate as calibration
from spherecal.calibrate import calibrate
from spherecal.data.session import Session
from spherecal.diagnose import run_checks as checks
from spherecal.steps import ball_stages, selection
from spherecal_files.read_session import read_session
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions

RIGS = ("rigA", "rigB", "hall50", "hall100")
SEED, BUSY = 1, 2
# Goals: seconds of the diagnosis alone, and its processor time beside the busy processes over that alone.
MOST_SECONDS, MORE_BUSY = {"hall50": 10.0, "hall100": 10.0}, 1.3
# Where its parts are called, and what the table calls them.
_PARTS: dict[str, tuple[Any, str]] = {
    "local_network": (calibration, "local"),
    "grow": (ball_stages, "start"),
    "solve_free": (calibration, "adjustment"),
    "select_ball_model": (selection, "adjustment"),
    "in_millimetres": (selection, "scale"),
    "diagnose": (checks, "diagnosis"),
}
PARTS = ("local", "start", "adjustment", "scale", "diagnosis", "whole")


@contextmanager
def _timed() -> Iterator[dict[str, list[float]]]:
    """Within, every part adds its wall and processor seconds to the dictionary."""
    seconds = {part: [0.0, 0.0] for part in PARTS}

    def timed(part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            wall, cpu = time.perf_counter(), time.process_time()
            try:
                return function(*arguments, **named)
            finally:
                seconds[part][0] += time.perf_counter() - wall
                seconds[part][1] += time.process_time() - cpu

        return call

    saved = {name: getattr(place, name) for name, (place, _) in _PARTS.items()}
    for name, (place, part) in _PARTS.items():
        setattr(place, name, timed(part, saved[name]))
    try:
        yield seconds
    finally:
        for name, (place, _) in _PARTS.items():
            setattr(place, name, saved[name])


def measure(name: str) -> dict[str, Any]:
    """One calibration's seconds by part, after another one that compiles."""
    calibrate(simulate_session("demo", SEED, SimulationOptions(bar_poses=0))[0])
    session = _session(name)
    with _timed() as seconds:
        wall, cpu = time.perf_counter(), time.process_time()
        result = calibrate(session)
        seconds["whole"] = [time.perf_counter() - wall, time.process_time() - cpu]
    codes = [f.code for f in result.rig.quality.findings if f.severity != "info"]
    assert session.observations is not None
    return {"name": Path(name).name, "observations": len(session.observations), "seconds": seconds, "warnings": codes}


def _session(name: str) -> Session:
    if name not in RIGS:
        return read_session(Path(name))
    return simulate_session(name, SEED, SimulationOptions(bar_poses=0))[0]


def _spin() -> None:
    while True:
        sum(range(100_000))


@contextmanager
def _busy(count: int) -> Iterator[None]:
    """Within, so many processes keep the processor busy."""
    others = [multiprocessing.get_context("spawn").Process(target=_spin, daemon=True) for _ in range(count)]
    for other in others:
        other.start()
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.join()


def _run(name: str) -> dict[str, Any]:
    # as a user starts it: how many threads BLAS takes is left to the program
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    command = [sys.executable, __file__, "--one", name]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True, env=environment)
    return json.loads(done.stdout.splitlines()[-1])


def _print(alone: dict[str, Any], beside: dict[str, Any]) -> bool:
    """Print a recording's table; whether a goal is missed."""
    print(f"\n{alone['name']}: {alone['observations']} observations; {', '.join(alone['warnings']) or 'no warnings'}")
    print(f"  {'':12}{'alone':>9}{'cpu':>8}{'busy':>9}{'cpu':>8}")
    for part in PARTS:
        (wall, cpu), (busy_wall, busy_cpu) = alone["seconds"][part], beside["seconds"][part]
        print(f"  {part:12}{wall:9.2f}{cpu:8.2f}{busy_wall:9.2f}{busy_cpu:8.2f}")
    own, adjustment = alone["seconds"]["diagnosis"], alone["seconds"]["adjustment"]
    goals = {
        "not longer than the adjustment": own[1] <= adjustment[1],
        f"at most {MOST_SECONDS.get(alone['name'], 1.0):.0f} s": own[1] <= MOST_SECONDS.get(alone["name"], 1.0),
        f"at most {MORE_BUSY} x the processor time beside others": beside["seconds"]["diagnosis"][1]
        <= MORE_BUSY * own[1],
    }
    for goal, met in goals.items():
        print(f"  {goal}: {'met' if met else 'MISSED'}", flush=True)
    return not all(goals.values())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, RIGS, rounds=1)
    parser.add_argument("--session", action="append", default=[], help="a session folder beside the rigs")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure(options.one)))
        return 0
    rows, missed = [], False
    for name in (*options.rigs, *options.session):
        alone = _run(name)
        with _busy(max(BUSY, os.cpu_count() or BUSY)):
            beside = _run(name)
        rows.append({"alone": alone, "busy": beside})
        missed |= _print(alone, beside)
    Figures("diagnosis", {"recordings": rows}).save(options)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
