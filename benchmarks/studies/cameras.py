"""Live cameras on the real Harvesters path: every fault many times, programs killed, and a soak with memory watched."""

import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.camera_rig import FAULTS, Outcome, injected, rig
from benchmarks.studies.report import Report
from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera, simulated_cameras

RUNS = 20
SOAK_MINUTES = 15.0
RATE_HZ = 10.0  # 12 cameras: 120 images of 5 MP a second; sets of a calibration come one in 10 s
SETS_EVERY_S = 2.0
LOOK_EVERY_S = 10.0
MOST_GROWTH_MB = 30.0  # over the second half; allocators and page tables move by some MB
SEEN_S, BACK_S = 0.5, 3.0


def faults(runs: int) -> tuple[dict[str, list[Outcome]], bool]:
    """Each fault `runs` times, on the cameras in turn; whether images taken before are what they were."""
    found: dict[str, list[Outcome]] = {}
    with rig([SimulatedCamera(f"SIM{i}", 640, 480) for i in range(4)]) as made:
        kept = made.source.capture_set()
        pixels = {serial: frame.image.copy() for serial, frame in kept.frames.items()}
        for fault in FAULTS:
            for number in range(runs):
                serial = made.control.serials[number % 4]
                found.setdefault(fault.name, []).append(injected(made, fault, serial))
                made.control.clear_faults()
        untouched = all(np.array_equal(kept.frames[serial].image, image) for serial, image in pixels.items())
    return found, untouched


PROGRAM = """
import sys, time
from spherecal_cameras.genicam.genicam_source import GenicamSource

if __name__ == "__main__":
    source = GenicamSource()
    source.open(source.discover().serials, {})
    source.start_live(20.0)
    while not all(source.latest(serial) for serial in source.statuses()):
        time.sleep(0.01)
    print(source.service_pid, flush=True)
    time.sleep(60)
"""


@dataclass(frozen=True)
class Killed:
    """A program killed by SIGKILL: seconds until its camera process was gone and its shared memory freed."""

    process_s: float | None
    memory_s: float | None


def killed_programs(runs: int) -> list[Killed]:
    """Programs with live cameras, killed."""
    found = []
    with ProducerControl([SimulatedCamera(f"SIM{i}", 640, 480) for i in range(4)]) as steering:
        for _ in range(runs):
            program = subprocess.Popen(
                [sys.executable, "-c", PROGRAM],
                env=os.environ | steering.environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            assert program.stdout is not None
            child = int(program.stdout.readline())
            began = time.perf_counter()
            program.send_signal(signal.SIGKILL)
            program.wait()
            program.stdout.close()
            gone = _until(lambda child=child: not Path(f"/proc/{child}").exists(), began)
            free = _until(lambda program=program: not _memory_of(program.pid), began)
            found.append(Killed(gone, free))
    return found


def _memory_of(pid: int) -> list[Path]:
    return list(Path("/dev/shm").glob(f"spherecal-*-{pid}-*"))


def _until(condition, began: float) -> float | None:
    while time.perf_counter() - began < 10.0:
        if condition():
            return time.perf_counter() - began
        time.sleep(0.005)
    return None


@dataclass(frozen=True)
class Look:
    """The state at a moment of the soak."""

    minute: float
    program_mb: float
    process_mb: float
    delivered: int
    exposed: int
    incomplete: int
    underrun: int
    sets: int
    incomplete_sets: int


def soak(minutes: float) -> Iterator[Look]:
    """Twelve cameras of 5 MP: live at RATE_HZ, a set every other second."""
    with rig(list(simulated_cameras(12))) as made:
        source, sets, poor = made.source, 0, 0
        source.start_live(RATE_HZ)
        began = time.perf_counter()
        next_set = next_look = began
        while (now := time.perf_counter()) - began < minutes * 60:
            if now >= next_set:
                next_set = now + SETS_EVERY_S
                sets += 1
                poor += not source.capture_set().complete
            if now >= next_look:
                next_look = now + LOOK_EVERY_S
                counters = [status.counters for status in source.statuses().values()]
                exposed = sum(made.control.counters(serial).frames_exposed for serial in made.control.serials)
                yield Look(
                    (now - began) / 60,
                    resident_mb(os.getpid()),
                    resident_mb(source.service_pid or 0),
                    sum(c.delivered for c in counters),
                    exposed,
                    sum(c.incomplete for c in counters),
                    sum(c.underrun for c in counters),
                    sets,
                    poor,
                )
            for serial in made.control.serials:
                source.latest(serial)
            time.sleep(0.1)


def resident_mb(pid: int) -> float:
    """Memory of a process that is its own, shared memory left out, MB."""
    try:
        fields = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
    except OSError:
        return float("nan")
    return (int(fields[1]) - int(fields[2])) * os.sysconf("SC_PAGE_SIZE") / 1e6


def report(runs: int | None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    minutes = SOAK_MINUTES * min(1.0, runs / RUNS)
    page = Report("Live cameras: faults and endurance", f"python3 dev.py studies cameras --runs {runs}")
    page.text(
        "Simulated GenTL producer behind the real Harvesters and genicam; the cameras live in a process of their own.",
        f"Load of the machine at the start: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors.",
    )
    _fault_table(page, *faults(runs), runs)
    _killed_table(page, killed_programs(runs))
    _soak_table(page, list(soak(minutes)), minutes)
    return page


def _fault_table(page: Report, found: dict[str, list[Outcome]], untouched: bool, runs: int) -> None:
    page.heading(f"Faults, each injected {runs} times, four cameras, sets by software trigger all the while")
    rows = []
    for name, outcomes in found.items():
        seen = [o.seen_s for o in outcomes if o.seen_s is not None]
        back = [o.recovered_s for o in outcomes if o.recovered_s is not None]
        rows.append(
            (
                name,
                len(seen),
                sum(o.named for o in outcomes),
                len(back),
                _middle(seen),
                max(seen, default=float("nan")),
                _middle(back),
                max(back, default=float("nan")),
                sum(o.others_lost for o in outcomes),
            )
        )
    header = ("fault", "seen", "named", "recovered", "seen s (median)", "max", "recovered s (median)", "max",
              "other cameras late as well")  # fmt: skip
    page.table(header, rows)
    page.text("Recovered: from the moment the fault is taken away (or seen, if it passes by itself) to a complete set.")
    every = [o for outcomes in found.values() for o in outcomes]
    whole = sum(o.seen_s is not None and o.named and o.recovered_s is not None for o in every)
    page.verdict("every fault is seen, named and recovered from", whole == len(every), f"{whole} of {len(every)}")
    crashes = [o for name in found if "SIGSEGV" in name or "SIGKILL" in name for o in found[name]]
    seen_s = max((o.seen_s or 99.0) for o in crashes)
    back_s = max((o.recovered_s or 99.0) for o in crashes)
    page.verdict(f"a crash of the camera process is seen in {SEEN_S} s", seen_s < SEEN_S, f"{seen_s:.3f} s at most")
    page.verdict(f"all cameras deliver again within {BACK_S:.0f} s", back_s < BACK_S, f"{back_s:.2f} s at most")
    page.verdict("images taken before are untouched", untouched, "compared pixel by pixel")
    page.text("")


def _middle(values: list[float]) -> float:
    return statistics.median(values) if values else float("nan")


def _killed_table(page: Report, found: list[Killed]) -> None:
    page.heading("The program killed by SIGKILL")
    gone = [k.process_s for k in found if k.process_s is not None]
    free = [k.memory_s for k in found if k.memory_s is not None]
    well = len(gone) == len(free) == len(found)
    longest = max([*gone, *free], default=float("nan"))
    page.verdict(
        "no process and no shared memory is left",
        well,
        f"{len(gone)} and {len(free)} of {len(found)}, {longest:.2f} s at most",
    )
    page.text("")


def _soak_table(page: Report, looks: list[Look], minutes: float) -> None:
    had = looks[-1].delivered / max(looks[-1].minute * 60, 1.0)
    page.heading(f"Soak: 12 cameras of 5 MP, {minutes:g} minutes, {12 * RATE_HZ:.0f} images/s wanted, {had:.0f} had")
    step = max(len(looks) // 10, 1)
    shown = looks[::step] + ([looks[-1]] if (len(looks) - 1) % step else [])
    header = ("minute", "program MB", "camera process MB", "delivered", "exposed", "incomplete", "underrun", "sets",
              "incomplete sets")  # fmt: skip
    page.table(header, [tuple(getattr(look, name) for name in Look.__dataclass_fields__) for look in shown])
    half = looks[len(looks) // 2 :]
    for what in ("program_mb", "process_mb"):
        values = [getattr(look, what) for look in half]
        growth = values[-1] - values[0]
        goal = f"memory of the {'program' if what == 'program_mb' else 'camera process'} is flat"
        page.verdict(goal, growth < MOST_GROWTH_MB, f"{growth:+.1f} MB in the second half")
    last = looks[-1]
    lost = last.exposed - last.delivered
    # what is on its way when the counters are read, and images dropped where the driver had no buffer
    page.verdict(
        "no drift of counters: exposed images are delivered or counted as lost",
        lost <= last.incomplete + last.underrun + 24,
        f"{lost} of {last.exposed} not (yet) delivered",
    )
    page.verdict("every set is complete", last.incomplete_sets == 0, f"{last.incomplete_sets} of {last.sets} not")
