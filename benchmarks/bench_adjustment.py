"""The bundle adjustment against Ceres (SPARSE_SCHUR and DENSE_SCHUR of pycolmap's), on one thread.

Same observations, same start, same unknowns, same tolerance of the cost; the engines take turns, so that a busy machine
slows all of them alike. `--help` lists the options, benchmarks/README.md says what the figures mean.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"  # before any of the libraries is loaded

import argparse
import json
import platform
import statistics
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from stages import STAGES, timed_stages
from starts import Start, make_start
from threadpoolctl import threadpool_limits

from spherecal.adjust.levenberg import Settings, minimise

RIGS = ("rigA", "rigB", "hall24", "hall50", "hall100")
OURS, CERES = ("numba", "numpy"), ("SPARSE_SCHUR", "DENSE_SCHUR")
ENGINES = OURS + CERES
TOLERANCE = 1e-9
GOALS = {"numba": 0.5, "numpy": 2.0}  # times Ceres' solve seconds
SAME_COST = 1e-6


@dataclass(frozen=True)
class Run:
    """One adjustment: final cost, iterations, wall seconds of solving and of building, CPU seconds of solving."""

    cost: float
    iterations: int
    solve_s: float
    build_s: float
    cpu_s: float


def run_engine(engine: str, start: Start) -> Run:
    """One adjustment, built and solved."""
    cpu = time.process_time()
    begin = time.perf_counter()
    problem = start.problem()
    if engine in CERES:
        import ceres_adjustment

        fill = time.perf_counter() - begin
        cpu = time.process_time()
        done = ceres_adjustment.solve(problem, start.state, engine)
        cpu = (time.process_time() - cpu) * done.solve_s / (done.solve_s + done.build_s)
        return Run(done.cost, done.iterations, done.solve_s, fill + done.build_s, cpu)
    problem.layout, problem.point_start  # noqa: B018 worked out at first use
    built, cpu = time.perf_counter(), time.process_time()
    settings = Settings(tolerance=TOLERANCE, max_iterations=200, engine="numba" if engine == "numba" else "numpy")
    done = minimise(problem, start.state, settings)
    cpu = time.process_time() - cpu
    return Run(done.cost, done.iterations, time.perf_counter() - built, built - begin, cpu)


def take_turns(start: Start, engines: tuple[str, ...], rounds: int) -> dict[str, list[Run]]:
    """`rounds` runs of every engine, interleaved, after one to warm up that does not count."""
    runs: dict[str, list[Run]] = {engine: [] for engine in engines}
    for turn in range(rounds + 1):
        for engine in engines:
            run = run_engine(engine, start)
            if turn:
                runs[engine].append(run)
    return runs


def summary(start: Start, runs: dict[str, list[Run]]) -> dict[str, object]:
    """Medians of the runs of one rig, and ratios to the faster of Ceres' two solvers."""
    table = {}
    for engine, own in runs.items():
        middle = {key: statistics.median(asdict(run)[key] for run in own) for key in asdict(own[0])}
        table[engine] = middle | {"iterations": own[-1].iterations}
    out: dict[str, object] = {
        "rig": start.rig,
        "observations": int(start.used.sum()),
        "points": int((start.network.views(start.used) > 0).sum()),
        "engines": table,
    }
    ceres = [engine for engine in CERES if engine in runs]
    if ceres:
        best = min(ceres, key=lambda engine: table[engine]["solve_s"])
        out["ceres"] = best
        out["ratios"] = {
            engine: statistics.median(a.solve_s / b.solve_s for a, b in zip(runs[engine], runs[best], strict=True))
            for engine in OURS
            if engine in runs
        }
        costs = [run.cost for own in runs.values() for run in own]
        out["cost_spread"] = (max(costs) - min(costs)) / min(costs)
    return out


def profile(start: Start, engine: str) -> dict[str, float]:
    """Seconds of each stage of one adjustment; `other` is what no stage accounts for."""
    problem = start.problem()
    settings = Settings(tolerance=TOLERANCE, max_iterations=200, engine="numba" if engine == "numba" else "numpy")
    minimise(problem, start.state, settings)
    with timed_stages() as seconds:
        begin = time.perf_counter()
        minimise(problem, start.state, settings)
        total = time.perf_counter() - begin
    return {**seconds, "other": total - sum(seconds.values()), "total": total}


def peak_memory_mb(engine: str, rig: str) -> float:
    """Peak resident memory of a process that makes one adjustment of a start it reads, less that of reading it."""
    command = [sys.executable, str(Path(__file__)), "--one", engine, rig]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return float(json.loads(out)["peak_mb"])


def one(engine: str, rig: str) -> None:
    """Make one adjustment and print this process' peak memory, in MB: over all, and what the adjustment added."""
    import resource

    start = make_start(rig)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    run_engine(engine, start)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps({"peak_mb": peak / 1024, "added_mb": (peak - before) / 1024}))


def exponent(observations: list[int], seconds: list[float]) -> float:
    """The slope of log time over log observations."""
    return float(np.polyfit(np.log(observations), np.log(seconds), 1)[0])


def print_table(rows: list[dict]) -> None:
    print(f"\n{'rig':8} {'obs':>7} {'engine':13} {'iter':>4} {'solve s':>8} {'cpu s':>8} {'ms/iter':>8} "
          f"{'build s':>8} {'ratio':>6} {'with build':>10}  final cost")  # fmt: skip
    for row in rows:
        best = row["engines"][row["ceres"]] if "ceres" in row else None
        for engine, r in row["engines"].items():
            ratio = row.get("ratios", {}).get(engine)
            whole = (r["solve_s"] + r["build_s"]) / (best["solve_s"] + best["build_s"]) if best else None
            print(f"{row['rig']:8} {row['observations']:7d} {engine:13} {r['iterations']:4d} {r['solve_s']:8.3f} "
                  f"{r['cpu_s']:8.3f} {1e3 * r['solve_s'] / r['iterations']:8.1f} {r['build_s']:8.3f} "
                  f"{'' if ratio is None else f'{ratio:.2f}':>6} "
                  f"{'' if whole is None else f'{whole:.2f}':>10}  {r['cost']:.9g}")  # fmt: skip


def print_profile(rig: str, engine: str, seconds: dict[str, float]) -> None:
    total = seconds["total"]
    parts = ", ".join(f"{s} {100 * seconds[s] / total:.0f} %" for s in (*STAGES, "other") if seconds[s] > 0.005 * total)
    print(f"{rig} {engine} {total:.3f} s: {parts}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", nargs="+", default=RIGS, metavar="RIG")
    parser.add_argument("--engines", nargs="+", default=ENGINES, choices=ENGINES)
    parser.add_argument("--rounds", type=int, default=5, help="runs of each engine that count (default 5)")
    parser.add_argument("--no-memory", action="store_true", help="leave out the peak memory")
    parser.add_argument("--json", type=Path, help="write the figures to a file")
    parser.add_argument("--one", nargs=2, metavar=("ENGINE", "RIG"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    with threadpool_limits(1):
        if options.one:
            one(*options.one)
            return 0
        return bench(options)


def bench(options: argparse.Namespace) -> int:
    rows, profiles = [], {}
    for rig in options.rigs:
        start = make_start(rig)
        rows.append(summary(start, take_turns(start, tuple(options.engines), options.rounds)))
        for engine in OURS:
            if engine in options.engines:
                profiles[f"{rig} {engine}"] = profile(start, engine)
        print(f"{rig} done", file=sys.stderr, flush=True)
    print_table(rows)
    print("\nWhere the time goes:")
    for key, seconds in profiles.items():
        print_profile(*key.split(), seconds)
    if not options.no_memory:
        print("\nPeak memory of a process that makes the start and one adjustment, MB:")
        for row in rows:
            row["peak_mb"] = {engine: peak_memory_mb(engine, row["rig"]) for engine in options.engines}
            print(f"{row['rig']:8} " + "  ".join(f"{engine} {mb:.0f}" for engine, mb in row["peak_mb"].items()))
    if options.json:
        figures = {"python": platform.python_version(), "rigs": rows, "profiles": profiles}
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
