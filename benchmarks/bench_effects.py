"""What fields of lenses and motions of images cost: processor seconds and memory of `calibrate()` with and without.

Both ways in turns in one process, each case in a process of its own after a run to compile, one thread.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path

from figures import Figures, add_options
from stages import without_effects
from studies.others_run import forget_peak, peak_mb
from threadpoolctl import threadpool_limits

from spherecal.calibrate import calibrate
from spherecal.data.session import Session
from spherecal_files.read_session import read_session
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions

DOME = Path(os.environ.get("SPHERECAL_DATA", "../data")) / "dome15"
# Rig and misfit of its lenses, px; dome100 has 10^5 observations.
CASES = {"rigA": ("rigA", 0.0), "rigA-misfit": ("rigA", 0.1), "rigB": ("rigB", 0.0), "rigB-misfit": ("rigB", 0.1),
         "dome15": ("dome15", 0.0), "dome100": ("dome100", 0.0), "dome100-misfit": ("dome100", 0.1)}  # fmt: skip
# At most so many seconds more, or so many times as long.
MOST_MORE_S, MOST_TIMES = {"rigA": 2.0, "rigB": 2.0, "dome15": 4.0}, {"dome100": 2.0}
SEED = 1


def _session(rig: str, misfit_px: float) -> Session:
    if rig == "dome15":
        return read_session(DOME)
    return simulate_session(rig, SEED, SimulationOptions(bar_poses=0, misfit_px=misfit_px))[0]


def measure(name: str, rounds: int) -> dict[str, object]:
    """Medians of processor seconds and of the memory that a calibration adds at its peak, without effects and with."""
    session = _session(*CASES[name])
    small = simulate_session("demo", SEED, SimulationOptions(targets=80, bar_poses=0, misfit_px=0.1))[0]
    ways, cpu, mb, said = (without_effects, nullcontext), ([], []), ([], []), ["", ""]
    for way in ways:
        with way():
            calibrate(small)
    forget_peak()
    before = peak_mb()
    for _ in range(rounds):
        for k, way in enumerate(ways):
            forget_peak()
            with way():
                begin = time.process_time()
                done = calibrate(session)
                cpu[k].append(time.process_time() - begin)
                mb[k].append(peak_mb() - before)
            fields = sum(camera.field is not None for camera in done.rig.cameras)
            form = done.rig.form.name if done.rig.form else done.method
            said[k] = f"{form}, {fields} fields, {len(done.motions)} motions, {done.rig.quality.rms_px:.3f} px"
    assert session.observations is not None
    (plain_s, effects_s), (plain_mb, effects_mb) = (tuple(map(statistics.median, each)) for each in (cpu, mb))
    return {"case": name, "observations": len(session.observations), "plain_s": plain_s, "effects_s": effects_s,
            "plain_mb": plain_mb, "effects_mb": effects_mb, "plain": said[0], "effects": said[1]}  # fmt: skip


def _print(row: dict) -> bool:
    """Print a case's figures; whether its goal is missed."""
    more, times, rig = row["effects_s"] - row["plain_s"], row["effects_s"] / row["plain_s"], CASES[row["case"]][0]
    missed = more > MOST_MORE_S.get(rig, float("inf")) or times > MOST_TIMES.get(rig, float("inf"))
    goal = f"{MOST_MORE_S[rig]:g} s more" if rig in MOST_MORE_S else f"{MOST_TIMES[rig]:g} times"
    print(
        f"{row['case']}: {row['observations']} observations\n"
        f"  plain        {row['plain_s']:7.2f} s cpu {row['plain_mb']:7.1f} MB added   {row['plain']}\n"
        f"  with effects {row['effects_s']:7.2f} s cpu {row['effects_mb']:7.1f} MB added   {row['effects']}\n"
        f"  {more:+.2f} s, {times:.2f} times: {'MISSED' if missed else 'met'} (goal at most {goal})",
        flush=True,
    )
    return missed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, tuple(name for name in CASES if name != "dome15" or DOME.is_dir()), rounds=1)
    parser.add_argument("--one", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        with threadpool_limits(1):
            print(json.dumps(measure(options.one, options.rounds)))
        return 0
    rows, missed = [], False
    for name in options.rigs:
        command = [sys.executable, __file__, "--one", name, "--rounds", str(options.rounds)]
        done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
        missed |= _print(rows[-1])
    Figures("effects", {"cases": rows}).save(options)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
