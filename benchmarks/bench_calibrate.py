"""The whole computation, from observations to rig, stage by stage: `calibrate()` after warm-up, on one thread.

What it converges to stands beside the time: sigma0 over the true noise and the errors of the camera centres.
"""

import argparse
import statistics
import sys
import time
from dataclasses import replace

import numpy as np
from figures import Figures, add_options
from studies.alignment import centre_errors
from threadpoolctl import threadpool_limits

from spherecal.adjust.state import State
from spherecal.calibrate import calibrate
from spherecal.steps.settings import CalibrationSettings, Method
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions

RIGS = ("rigA", "rigB", "hall24", "hall50", "hall100")
GOAL_S: dict[Method, float] = {"free": 1.0, "auto": 1.5}  # of rigs A and B
GOAL_RIGS = ("rigA", "rigB")
SEED = 1


def measure(rig: str, method: Method, rounds: int) -> dict[str, object]:
    """Medians over `rounds` calibrations after one that does not count."""
    session, truth = simulate_session(rig, SEED, SimulationOptions(bar_poses=0))
    walls, cpus, stages = [], [], []
    settings = CalibrationSettings(method=method)
    result = calibrate(session, settings)
    for _ in range(rounds):
        begin, cpu = time.perf_counter(), time.process_time()
        result = calibrate(session, settings)
        walls.append(time.perf_counter() - begin)
        cpus.append(time.process_time() - cpu)
        stages.append(result.seconds)
    ids = [c.id for c in truth.cameras]
    placed = np.isin(ids, [c.id for c in result.rig.cameras])
    estimate = _state(result.rig.cameras)
    true = replace(_state(truth.cameras), points=np.zeros((0, 3)))
    errors = centre_errors(estimate, _select(true, placed), np.ones(len(estimate.rotation), dtype=bool))
    assert session.observations is not None
    return {
        "rig": rig,
        "method": method,
        "observations": len(session.observations),
        "cameras": f"{int(placed.sum())} of {len(ids)}",
        "wall_s": statistics.median(walls),
        "cpu_s": statistics.median(cpus),
        "stages_s": {stage: statistics.median(s[stage] for s in stages) for stage in stages[0]},
        "sigma0_over_noise": (result.rig.quality.sigma0 or float("nan")) / float(truth.sigma_px[0]),
        "centre_rms_mm": float(np.sqrt((errors**2).mean())),
        "centre_max_mm": float(errors.max()),
        "valid": result.rig.quality.valid,
    }


def _state(cameras: tuple) -> State:
    return State(
        np.array([c.rotation for c in cameras]),
        np.array([c.translation_mm for c in cameras]),
        np.array([c.intrinsics for c in cameras]),
        np.zeros((0, 3)),
    )


def _select(state: State, cameras: np.ndarray) -> State:
    return State(state.rotation[cameras], state.translation[cameras], state.intrinsics[cameras], state.points)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, RIGS, rounds=3)
    options = parser.parse_args()
    rows = []
    with threadpool_limits(1):
        for rig in options.rigs:
            for method in GOAL_S if rig in GOAL_RIGS else ("auto",):
                rows.append(measure(rig, method, options.rounds))
                _print(rows[-1])
    Figures("calibrate", {"rigs": rows}).save(options)
    return 0


def _print(row: dict) -> None:
    stages = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in row["stages_s"].items())
    goal = GOAL_S[row["method"]] if row["rig"] in GOAL_RIGS else None
    verdict = "" if goal is None else f" (goal < {goal:g} s: {'met' if row['wall_s'] < goal else 'MISSED'})"
    print(
        f"{row['rig']}, {row['method']}: {row['observations']} observations, {row['cameras']} cameras, "
        f"valid: {row['valid']}\n"
        f"  {row['wall_s']:.2f} s{verdict}, cpu {row['cpu_s']:.2f} s; {stages}\n"
        f"  sigma0 / noise {row['sigma0_over_noise']:.4f}; camera centres off by {row['centre_rms_mm']:.3f} mm rms, "
        f"{row['centre_max_mm']:.3f} mm at most (after the best similarity)",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
