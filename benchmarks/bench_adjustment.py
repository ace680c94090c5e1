"""The bundle adjustment against Ceres (pycolmap's, SPARSE_SCHUR and DENSE_SCHUR), on one thread.

Same observations, same start, same unknowns, same tolerance of the cost; the engines take turns, so that a busy machine
slows all of them alike. benchmarks/README.md says what the figures mean.
"""

import argparse
import json
import pickle
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from figures import Figures, add_options
from stages import STAGES, timed_stages
from starts import Start, make_start
from threadpoolctl import threadpool_limits

from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Settings

RIGS = ("rigA", "rigB", "hall24", "hall50", "hall100")
OURS, CERES = ("numba",), ("SPARSE_SCHUR", "DENSE_SCHUR")
ENGINES = OURS + CERES
SETTINGS = Settings(tolerance=1e-9, max_iterations=200)
GOALS = {"numba": 0.5}  # times the solve seconds of Ceres' faster solver
SAME_COST = 1e-6
SMALL, SMALL_ROUNDS = 20_000, 4  # below so many observations a run takes a tenth of a second: so many times the rounds


@dataclass(frozen=True)
class Run:
    """One adjustment: final cost, iterations, wall and CPU seconds of solving, wall seconds of building."""

    cost: float
    iterations: int
    solve_s: float
    solve_cpu_s: float
    build_s: float


def run_engine(engine: str, start: Start) -> Run:
    """One adjustment, built and solved."""
    begin = time.perf_counter()
    problem = start.problem()
    built = time.perf_counter()
    if engine in CERES:
        import ceres_adjustment

        done = ceres_adjustment.solve(problem, start.state, engine)
        return Run(done.cost, done.iterations, done.solve_s, done.solve_cpu_s, built - begin + done.build_s)
    cpu = time.process_time()
    ours = minimise(problem, start.state, SETTINGS)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - built
    return Run(ours.cost, ours.iterations, wall, cpu, built - begin)


def take_turns(start: Start, engines: tuple[str, ...], rounds: int) -> dict[str, list[Run]]:
    """`rounds` runs of every engine, interleaved, after one to warm up that does not count."""
    runs: dict[str, list[Run]] = {engine: [] for engine in engines}
    for turn in range(rounds + 1):
        for engine in engines:
            run = run_engine(engine, start)
            if turn:
                runs[engine].append(run)
    return runs


def summarise(start: Start, runs: dict[str, list[Run]]) -> dict:
    """Medians of the runs of one rig, and the median ratio of each round to Ceres' faster solver."""
    table = {
        engine: {
            "iterations": own[-1].iterations,
            "cost": own[-1].cost,
            **{
                key: statistics.median(getattr(run, key) for run in own)
                for key in ("solve_s", "solve_cpu_s", "build_s")
            },
        }
        for engine, own in runs.items()
    }
    costs = [run.cost for own in runs.values() for run in own]
    out = {
        "rig": start.rig,
        "observations": int(start.used.sum()),
        "points": int((start.network.views(start.used) > 0).sum()),
        "cost_spread": (max(costs) - min(costs)) / min(costs),
        "engines": table,
    }
    ceres = [engine for engine in CERES if engine in runs]
    if ceres:
        best = min(ceres, key=lambda engine: table[engine]["solve_s"])
        out["fastest_ceres"] = best
        for engine, own in runs.items():
            rounds = list(zip(own, runs[best], strict=True))
            table[engine]["ratio_solve"] = statistics.median(a.solve_s / b.solve_s for a, b in rounds)
            table[engine]["ratio_whole"] = statistics.median(
                (a.solve_s + a.build_s) / (b.solve_s + b.build_s) for a, b in rounds
            )
            table[engine]["ratio_cpu"] = statistics.median(a.solve_cpu_s / b.solve_cpu_s for a, b in rounds)
    return out


def profile(start: Start) -> dict[str, float]:
    """Share of each stage in one adjustment; `other` is what no stage accounts for."""
    problem = start.problem()
    minimise(problem, start.state, SETTINGS)
    with timed_stages() as seconds:
        begin = time.perf_counter()
        minimise(problem, start.state, SETTINGS)
        total = time.perf_counter() - begin
    return {stage: s / total for stage, s in seconds.items()} | {"other": 1 - sum(seconds.values()) / total}


def peak_memory_mb(engine: str, start: Start) -> dict[str, float]:
    """Peak resident memory of a new process that reads the start and makes one adjustment."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "start"
        path.write_bytes(pickle.dumps(start))
        command = [sys.executable, __file__, "--one", engine, str(path)]
        out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return json.loads(out.splitlines()[-1])


def adjust_once(engine: str, path: str) -> None:
    """Make one adjustment and print this process' peak memory in MB, and how much of it came after reading."""
    start = pickle.loads(Path(path).read_bytes())
    before = _peak_mb()
    run_engine(engine, start)
    print(json.dumps({"peak": _peak_mb(), "added": _peak_mb() - before}))


def _peak_mb() -> float:
    """Peak resident memory of this process; Linux only (getrusage would count what the parent had before, too)."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return float("nan")
    return int(next(line.split()[1] for line in lines if line.startswith("VmHWM"))) / 1024


def exponent(rows: list[dict], engine: str) -> tuple[float, float]:
    """Slopes of log seconds over log observations: of the whole solution, and of one iteration."""
    n = np.log([row["observations"] for row in rows])
    solve = np.array([row["engines"][engine]["solve_s"] for row in rows])
    iterations = np.array([row["engines"][engine]["iterations"] for row in rows])
    return float(np.polyfit(n, np.log(solve), 1)[0]), float(np.polyfit(n, np.log(solve / iterations), 1)[0])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, RIGS, rounds=5)
    parser.add_argument("--engines", nargs="+", default=ENGINES, choices=ENGINES)
    parser.add_argument("--no-memory", action="store_true", help="leave out the peak memory")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    with threadpool_limits(1):
        if options.one:
            adjust_once(*options.one)
            return 0
        return bench(options)


def bench(options: argparse.Namespace) -> int:
    rows = []
    for rig in options.rigs:
        start = make_start(rig)
        rounds = options.rounds * (SMALL_ROUNDS if start.used.sum() < SMALL else 1)
        rows.append(summarise(start, take_turns(start, tuple(options.engines), rounds)))
        print_rig(rows[-1])
        rows[-1]["shares"] = {engine: profile(start) for engine in OURS if engine in options.engines}
        print_shares(rows[-1]["shares"])
        if not options.no_memory:
            rows[-1]["memory_mb"] = {engine: peak_memory_mb(engine, start) for engine in options.engines}
            print_memory(rows[-1]["memory_mb"])
    exponents = {engine: exponent(rows, engine) for engine in options.engines} if len(rows) > 1 else {}
    if exponents:
        print("\nExponent of seconds over observations, whole solution / one iteration:")
        print("  " + ", ".join(f"{engine} {whole:.2f} / {one:.2f}" for engine, (whole, one) in exponents.items()))
    Figures("adjustment", {"rounds": options.rounds, "rigs": rows, "exponents": exponents}).save(options)
    return print_goals(rows)


def print_rig(row: dict) -> None:
    print(
        f"\n{row['rig']}: {row['observations']} observations, {row['points']} points; final costs equal to "
        f"{row['cost_spread']:.1e}"
    )
    print(
        f"  {'engine':13} {'iterations':>10} {'solve s':>9} {'ms/iter':>8} {'cpu s':>8} {'build s':>8} "
        f"{'ratio':>6} {'of cpu':>7} {'with build':>10}   cost"
    )
    for engine, r in row["engines"].items():
        ratios = [f"{r[key]:.2f}" if key in r else "" for key in ("ratio_solve", "ratio_cpu", "ratio_whole")]
        print(
            f"  {engine:13} {r['iterations']:10d} {r['solve_s']:9.3f} {1e3 * r['solve_s'] / r['iterations']:8.1f} "
            f"{r['solve_cpu_s']:8.3f} {r['build_s']:8.3f} {ratios[0]:>6} {ratios[1]:>7} {ratios[2]:>10}   "
            f"{r['cost']:.9g}",
            flush=True,
        )


def print_shares(shares: dict[str, dict[str, float]]) -> None:
    for engine, share in shares.items():
        parts = [f"{stage} {100 * share[stage]:.0f} %" for stage in (*STAGES, "other") if share[stage] > 0.005]
        print(f"  {engine}: {', '.join(parts)}", flush=True)


def print_memory(memory: dict[str, dict[str, float]]) -> None:
    parts = [f"{engine} {mb['peak']:.0f} (+{mb['added']:.0f})" for engine, mb in memory.items()]
    print(f"  peak memory MB (of it by the adjustment): {', '.join(parts)}", flush=True)


def print_goals(rows: list[dict]) -> int:
    """Say which goals are met; 1 if one is not."""
    print()
    missed = False
    for row in rows:
        if "fastest_ceres" not in row:
            continue
        for engine, goal in GOALS.items():
            if engine in row["engines"]:
                ratio = row["engines"][engine]["ratio_solve"]
                missed |= ratio > goal
                print(f"{row['rig']}: {engine} <= {goal:g} x Ceres: {ratio:.2f} {'met' if ratio <= goal else 'MISSED'}")
        same = row["cost_spread"] <= SAME_COST
        missed |= not same
        print(f"{row['rig']}: same minimum to {SAME_COST:g}: {row['cost_spread']:.1e} {'met' if same else 'MISSED'}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
