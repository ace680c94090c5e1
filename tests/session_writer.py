"""Writes two sessions in turn into one folder without end, until it is killed: `python session_writer.py FOLDER`."""

import sys
from pathlib import Path

from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions


def write_without_end(folder: Path) -> None:
    """They differ in the number of targets: 20 and 21, bars' marks included."""
    both = [simulate_session("demo", 1, SimulationOptions(targets=n, placements=2, bar_poses=1)) for n in (12, 13)]
    write_session(*both[0], folder)
    print("ready", flush=True)
    while True:
        for session, truth in both:
            write_session(session, truth, folder)


if __name__ == "__main__":
    write_without_end(Path(sys.argv[1]))
