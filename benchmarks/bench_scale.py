"""How large a rig may be: 100 cameras in a hall and in a dome, up to a million observations, each in a new process.

Time and peak memory of `calibrate()` from observations to the rig, on one thread; what it converges to beside it.
"""

import argparse
import json
import resource
import subprocess
import sys
import time

import numpy as np
from figures import Figures, add_options
from studies.alignment import centre_errors
from threadpoolctl import threadpool_limits

from spherecal.adjust.state import State
from spherecal.calibrate import calibrate
from spherecal.steps.settings import CalibrationSettings, Method
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions

# Rig, placements (None: the rig's own) and method; a dome of 100 cameras has 28,000 image points at each placement.
CASES: dict[str, tuple[str, int | None, Method]] = {
    "dome100": ("dome100", None, "auto"),
    "hall100": ("hall100", None, "auto"),
    "dome100x12": ("dome100", 12, "auto"),
    "million": ("dome100", 36, "auto"),
    "million-free": ("dome100", 36, "free"),
}
MOST_MB, MOST_SECONDS = 1024, 600
SEED = 1


def measure(name: str) -> dict[str, object]:
    """One calibration; numba's kernels are compiled before, which is not counted."""
    rig, placements, method = CASES[name]
    calibrate(simulate_session("hall24", SEED, SimulationOptions(bar_poses=0))[0])
    session, truth = simulate_session(rig, SEED, SimulationOptions(bar_poses=0, placements=placements))
    assert session.observations is not None
    before = _peak_mb()
    begin, cpu = time.perf_counter(), time.process_time()
    result = calibrate(session, CalibrationSettings(method=method))
    wall_s, cpu_s = time.perf_counter() - begin, time.process_time() - cpu
    ids = [c.id for c in truth.cameras]
    placed = np.isin(ids, [c.id for c in result.rig.cameras])
    errors = centre_errors(
        _state(result.rig.cameras),
        _state(tuple(np.array(truth.cameras, dtype=object)[placed])),
        np.ones(int(placed.sum()), dtype=bool),
    )
    return {
        "case": name,
        "observations": len(session.observations),
        "cameras": f"{int(placed.sum())} of {len(ids)}",
        "placements": len(session.placements),
        "form": "" if result.rig.form is None else result.rig.form.name,
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "stages_s": result.seconds,
        "peak_mb": _peak_mb(),
        "before_mb": before,
        "sigma0_over_noise": (result.rig.quality.sigma0 or float("nan")) / float(truth.sigma_px[0]),
        "centre_rms_mm": float(np.sqrt((errors**2).mean())),
        "valid": result.rig.quality.valid,
    }


def _peak_mb() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)


def _state(cameras: tuple) -> State:
    return State(
        np.array([c.rotation for c in cameras]),
        np.array([c.translation_mm for c in cameras]),
        np.array([c.intrinsics for c in cameras]),
        np.zeros((0, 3)),
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, tuple(CASES), rounds=1)
    parser.add_argument("--one", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        with threadpool_limits(1):
            print(json.dumps(measure(options.one)))
        return 0
    rows, missed = [], False
    for name in options.rigs:
        done = subprocess.run([sys.executable, __file__, "--one", name], stdout=subprocess.PIPE, check=True, text=True)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
        missed |= _print(rows[-1])
    Figures("scale", {"cases": rows}).save(options)
    return 1 if missed else 0


def _print(row: dict) -> bool:
    """Print a case's figures; whether it takes too much time or memory."""
    stages = ", ".join(f"{stage} {seconds:.1f}" for stage, seconds in row["stages_s"].items())
    missed = row["peak_mb"] > MOST_MB or row["cpu_s"] > MOST_SECONDS
    print(
        f"{row['case']}: {row['observations']} observations, {row['cameras']} cameras, {row['placements']} placements, "
        f"{row['form']}, valid: {row['valid']}\n"
        f"  {row['wall_s']:.0f} s, cpu {row['cpu_s']:.0f} s ({stages})\n"
        f"  peak {row['peak_mb']:.0f} MB (before {row['before_mb']:.0f}): {'MISSED' if missed else 'met'} "
        f"(goal {MOST_SECONDS} s of one core, {MOST_MB} MB)\n"
        f"  sigma0 / noise {row['sigma0_over_noise']:.4f}; camera centres off by {row['centre_rms_mm']:.3f} mm rms",
        flush=True,
    )
    return missed


if __name__ == "__main__":
    sys.exit(main())
