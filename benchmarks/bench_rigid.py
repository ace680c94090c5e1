"""The rigid form of the adjustment against Ceres' rig cost (pycolmap's, SPARSE_SCHUR and DENSE_SCHUR), on one thread.

Start: the free form's cameras and placements aligned over shared dots, with the data sheets' intrinsics again, so
that there is something to do. Same observations, unknowns and tolerance; the engines take turns.
"""

import argparse
import statistics
import sys
import time
from dataclasses import dataclass, replace

import ceres_rigid
import numpy as np
from figures import Figures, add_options
from starts import SEED, make_start
from threadpoolctl import threadpool_limits

from spherecal.adjust.bundle import MIN_ANGLE_RAD
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.ball.rigid import align, share_shape
from spherecal.data.observations import find_features
from spherecal.data.session import Recording
from spherecal_sim.simulate_session import simulate_session

RIGS = ("rigA", "rigB", "hall24", "hall50")
CERES = ("SPARSE_SCHUR", "DENSE_SCHUR")
TOLERANCE = 1e-9
GOAL, SAME_COST = 0.7, 1e-6
GOAL_RIGS = ("rigA", "rigB", "hall24")


@dataclass(frozen=True)
class Run:
    """One adjustment: final cost, iterations, wall and CPU seconds of solving."""

    cost: float
    iterations: int
    solve_s: float
    cpu_s: float


def make_rigid(rig: str) -> tuple[Problem, State]:
    """The rigid problem of a simulated rig and its start."""
    start, (session, _) = make_start(rig), simulate_session(rig, SEED)
    features = find_features(Recording.of(session).observations)
    problem = start.problem()
    free = minimise(problem, start.state, Settings(tolerance=1e-4)).state
    seen = np.diff(problem.point_start) > 0
    free = replace(free, points=np.where(seen[:, None], free.points, np.nan))
    n_ball = len(session.placements)
    alignment = align(features, free.points, n_ball + len(session.bar_poses), n_ball)
    rigid, state = share_shape(start.network, features, free, alignment)
    triangulated = rigid.network.triangulated(state, start.used)
    good = triangulated.in_front & (triangulated.max_angle_rad >= MIN_ANGLE_RAD)
    used = start.used & good[rigid.network.feature]
    used &= (rigid.network.views(used) >= 2)[rigid.network.feature]
    state = replace(state, points=np.where(good[:, None], triangulated.points, 0.0), intrinsics=start.state.intrinsics)
    return rigid.network.problem(used, rigid.network.free, start.placed, weighted=True)[0], state


def run(engine: str, problem: Problem, state: State) -> Run:
    """One adjustment."""
    if engine in CERES:
        done = ceres_rigid.solve(problem, state, engine)
        return Run(done.cost, done.iterations, done.solve_s, done.solve_cpu_s)
    cpu, wall = time.process_time(), time.perf_counter()
    ours = minimise(problem, state, Settings(tolerance=TOLERANCE, max_iterations=200))
    return Run(ours.cost, ours.iterations, time.perf_counter() - wall, time.process_time() - cpu)


def bench(options: argparse.Namespace) -> int:
    rows, missed = [], False
    for rig in options.rigs:
        problem, state = make_rigid(rig)
        runs: dict[str, list[Run]] = {engine: [] for engine in ("numba", *CERES)}
        for turn in range(options.rounds + 1):  # the first warms up
            for engine, own in runs.items():
                done = run(engine, problem, state)
                if turn:
                    own.append(done)
        row = _summary(rig, problem, runs)
        rows.append(row)
        missed |= _print(row)
    Figures("rigid", {"rounds": options.rounds, "rigs": rows}).save(options)
    return 1 if missed else 0


def _summary(rig: str, problem: Problem, runs: dict[str, list[Run]]) -> dict:
    costs = [r.cost for own in runs.values() for r in own]
    best = min(CERES, key=lambda engine: statistics.median(r.cpu_s for r in runs[engine]))
    pairs = list(zip(runs["numba"], runs[best], strict=True))
    return {
        "rig": rig,
        "observations": len(problem.uv),
        "points": int((np.diff(problem.point_start) > 0).sum()),
        "placements": problem.n_placements,
        "cost_spread": (max(costs) - min(costs)) / min(costs),
        "fastest_ceres": best,
        "ratio_solve": statistics.median(a.solve_s / b.solve_s for a, b in pairs),
        "ratio_cpu": statistics.median(a.cpu_s / b.cpu_s for a, b in pairs),
        "engines": {
            engine: {
                "iterations": own[-1].iterations,
                "solve_s": statistics.median(r.solve_s for r in own),
                "cpu_s": statistics.median(r.cpu_s for r in own),
            }
            for engine, own in runs.items()
        },
    }


def _print(row: dict) -> bool:
    """Print a rig's figures; whether a goal is missed."""
    print(
        f"\n{row['rig']}: {row['observations']} observations, {row['points']} dots, {row['placements']} placements; "
        f"final costs equal to {row['cost_spread']:.1e}"
    )
    for engine, r in row["engines"].items():
        print(f"  {engine:13} {r['iterations']:4d} iterations {r['solve_s']:8.3f} s {r['cpu_s']:8.3f} s CPU")
    too_slow = row["rig"] in GOAL_RIGS and row["ratio_cpu"] > GOAL
    verdict = ("MISSED" if too_slow else "met") if row["rig"] in GOAL_RIGS else "no goal"
    print(
        f"  numba / {row['fastest_ceres']}: {row['ratio_solve']:.2f} of wall, {row['ratio_cpu']:.2f} of CPU seconds "
        f"(goal {GOAL}: {verdict})",
        flush=True,
    )
    return too_slow or row["cost_spread"] > SAME_COST


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, RIGS, rounds=5)
    with threadpool_limits(1):
        return bench(parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
