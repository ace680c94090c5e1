"""GigE Vision cameras in network namespaces: the Aravis producer's times and rates, and faults on the wire.

`python -m benchmarks.studies.gige PART ... [--runs N]` measures only these parts and leaves the others on the page.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.gige_cycles import CYCLES, CYCLES_GROWTH_MB, cycled
from benchmarks.gige_faults import FAULTS, WireOutcome, injected, wire
from benchmarks.gige_fuzz import MINUTES, fuzzed
from benchmarks.studies.cameras import resident_mb
from benchmarks.studies.report import Report
from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.protocol import CameraSettings
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.producer.build_producer import build_producer
from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera

RUNS = 20
SIZE = (1224, 1024)  # cameras and client share this machine's processors: 12 x 5 MP would measure those
SETS, LIVE_S, LIVE_HZ = 100, 20.0, 5.0
SOAK_MINUTES, MOST_GROWTH_MB = 15.0, 30.0
COMPARED_S = 8.0
COMPARED = ((1, 25.0), (4, 5.0), (12, 2.0), (4, 30.0))  # cameras and Hz; the last is more than two processors can send
LEAST_SHARE = 0.95


@dataclass(frozen=True)
class Figures:
    """What a rig of so many cameras took; seconds unless named otherwise."""

    kind: str
    cameras: int
    list_s: float
    open_s: float
    cycle_s: float
    set_s: float
    set_95_s: float
    whole: str
    live_per_s: float
    processor: float


@contextmanager
def _gige(count: int) -> Iterator[None]:
    producer = build_producer(aravis=True)
    with GigeRig([GigeCamera(f"GE{i + 1:02d}", *SIZE) for i in range(count)]) as rig, rig.entered():
        os.environ["GENICAM_GENTL64_PATH"] = str(producer.parent)
        yield


@contextmanager
def _simulated(count: int) -> Iterator[None]:
    with ProducerControl([SimulatedCamera(f"SIM{i + 1:02d}", *SIZE) for i in range(count)]) as steering:
        os.environ.update(steering.environment)
        os.environ["GENICAM_GENTL64_PATH"] = str(build_producer().parent)
        yield


def figures(kind: str, count: int, runs: int) -> tuple[Figures, list[float]]:
    """A rig listed, opened, started and stopped, shot and watched live; and its memory in MB over the soak."""
    share = min(1.0, runs / RUNS)
    with (_gige if kind == "GigE" else _simulated)(count), GenicamSource() as source:
        listed, serials = _timed(lambda: source.discover().serials)
        opened, _ = _timed(lambda: source.open(serials, dict.fromkeys(serials, CameraSettings(exposure_us=1000.0))))
        source.capture_set()
        cycles = []
        for _ in range(max(int(CYCLES * share), 3)):
            cycles.append(_timed(lambda: _cycle(source, serials))[0])
        taken = [_timed(source.capture_set) for _ in range(max(int(SETS * share), 10))]
        times = sorted(seconds for seconds, _ in taken)
        whole = sum(one.complete for _, one in taken)
        live, processor = _live(source, LIVE_S * share)
        memory = list(_memory(source, SOAK_MINUTES * share)) if count == 12 and kind == "GigE" else []
    row = Figures(
        kind,
        count,
        listed,
        opened,
        statistics.median(cycles),
        statistics.median(times),
        times[int(0.95 * (len(times) - 1))],
        f"{whole} of {len(taken)}",
        live,
        processor,
    )
    return row, memory


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    began = time.perf_counter()
    got = call()
    return time.perf_counter() - began, got


def _cycle(source: GenicamSource, serials: tuple[str, ...]) -> None:
    """Start, a new image of every camera, stop."""
    before = {serial: source.statuses()[serial].counters.delivered for serial in serials}
    until = time.perf_counter() + 10.0
    source.start_live(LIVE_HZ)
    while time.perf_counter() < until:
        if all(status.counters.delivered != before[serial] for serial, status in source.statuses().items()):
            break
        time.sleep(0.005)
    source.stop_live()


def _live(source: GenicamSource, seconds: float) -> tuple[float, float]:
    """Images a second of all cameras, and processors used by the camera process."""
    source.start_live(LIVE_HZ)
    time.sleep(1.0)
    before, cpu, began = _delivered(source), _processor_s(source.service_pid or 0), time.perf_counter()
    time.sleep(max(seconds, 3.0))
    passed = time.perf_counter() - began
    got = (_delivered(source) - before) / passed, (_processor_s(source.service_pid or 0) - cpu) / passed
    source.stop_live()
    return got


def _delivered(source: GenicamSource) -> int:
    return sum(status.counters.delivered for status in source.statuses().values())


def _processor_s(pid: int) -> float:
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _memory(source: GenicamSource, minutes: float) -> Iterator[float]:
    source.start_live(LIVE_HZ)
    until = time.perf_counter() + minutes * 60
    while time.perf_counter() < until:
        source.capture_set()
        yield resident_mb(source.service_pid or 0)
        time.sleep(2.0)
    source.stop_live()


# --- beside libaravis' own client -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Compared:
    """Frames a second of all cameras, and frames that came incomplete, by one client."""

    per_s: float
    incomplete: int


def aravis_client(rig: GigeRig, rate_hz: float) -> Compared:
    """libaravis' own test program on every camera at once."""
    programs = [
        subprocess.Popen(
            rig.inside(
                [
                    "arv-camera-test-0.8",
                    "-n",
                    address,
                    "-f",
                    str(rate_hz),
                    "-w",
                    str(SIZE[0]),
                    "-h",
                    str(SIZE[1]),
                    "-a",
                    "--duration",
                    str(int(COMPARED_S) + 1),
                ]
            ),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        for address in rig.addresses.values()
    ]
    per_s, incomplete = 0.0, 0
    for program in programs:
        lines = program.communicate(timeout=60)[0].splitlines()
        seconds = [int(line.split()[0]) for line in lines if "frames/s" in line]
        per_s += statistics.mean(seconds[1:]) if len(seconds) > 1 else 0.0  # the start does not count
        incomplete += sum(int(line.split("=")[1]) for line in lines if line.startswith("n_failures"))
    return Compared(per_s, incomplete)


def our_client(rig: GigeRig, rate_hz: float) -> Compared:
    """Harvesters with the Aravis producer on all cameras."""
    words = [
        sys.executable,
        "-m",
        "benchmarks.gige_client",
        str(build_producer(aravis=True)),
        str(COMPARED_S),
        str(rate_hz),
    ]
    done = subprocess.run(rig.inside(words), capture_output=True, text=True, timeout=120, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    return Compared(sum(found["frames"]) / found["seconds"], sum(found["incomplete"]))


# --- page -------------------------------------------------------------------------------------------------------------


def report(runs: int | None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    page = Report("GigE Vision on the wire", f"python3 dev.py studies gige --runs {runs}")
    page.text(
        "Cameras are libaravis' fake camera, each in a network namespace of its own on one bridge; the producer is",
        "`spherecal_aravis.cti` behind the real Harvesters and genicam. Cameras and client share the machine.",
    )
    for part, title in PARTS.values():
        page.heading(title)
        _loaded(page, runs)
        part(page, runs)
    return page


def _loaded(page: Report, runs: int) -> None:
    page.text(
        f"`--runs {runs}`; load of the machine at the start {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors."
    )


def again(parts: Sequence[str], runs: int, file: Path) -> bool:
    """Measure some parts and put them into the page in place of what it has of them; whether all goals are met."""
    text, met = file.read_text(encoding="utf-8"), True
    for name in parts:
        part, title = PARTS[name]
        page = Report("", "")
        _loaded(page, runs)
        part(page, runs)
        met = met and all(good for _, good in page.verdicts)
        body = page.page().split("\n", 4)[4].strip()
        before, _, after = text.partition(f"## {title}\n")
        _, mark, others = after.partition("\n## ")
        text = f"{before.rstrip()}\n\n## {title}\n\n{body}\n" + (f"\n## {others}" if mark else "")
        file.write_text(text, encoding="utf-8")
    return met


def _figures_table(page: Report, runs: int) -> None:
    before = dict(os.environ)
    rows, memory = [], []
    for count in (6, 12):
        for kind in ("GigE", "simulated"):
            row, used = figures(kind, count, runs)
            rows.append(row)
            memory += used
            os.environ.clear()
            os.environ.update(before)
    header = ("producer", "cameras", "list s", "open s", "start to stop s (median)", "set s (median)",
              "95th percentile", "whole sets", f"images/s ({LIVE_HZ:g} Hz wanted)", "processors")  # fmt: skip
    page.table(header, [tuple(getattr(row, name) for name in Figures.__dataclass_fields__) for row in rows])
    page.text(
        "The fake camera looks for a software trigger once in a frame period (40 ms), which a set's time has in it."
    )
    half = memory[len(memory) // 2 :]
    growth = half[-1] - half[0]
    minutes = SOAK_MINUTES * min(1.0, runs / RUNS)
    value = f"{growth:+.1f} MB in the second half of {minutes:g} minutes"
    page.verdict("memory of the camera process is flat", growth < MOST_GROWTH_MB, value)
    page.text("")


def _cycles_table(page: Report, runs: int) -> None:
    found = [cycled(count, max(int(CYCLES * min(1.0, runs / RUNS)), 10)) for count in (6, 12)]
    rows = [
        (
            one.cameras,
            one.cycles,
            one.whole,
            one.median_s,
            one.longest_s,
            *(f"{pair[0]:.4g}, {pair[1]:.4g}" for pair in (one.mb, one.files, one.threads)),
        )
        for one in found
    ]
    flat = max(one.mb[1] - one.mb[0] for one in found)
    kept = all(one.files[0] == one.files[1] and one.threads[0] == one.threads[1] for one in found)
    whole = all(one.whole == one.cycles for one in found)
    page.table(
        ("cameras", "cycles", "with an image of each", "s (median)", "max", "MB after the first fifth, at the end",
         "files", "threads"), rows,
    )  # fmt: skip
    page.text(
        "Harvesters and this producer in one process: every camera started, an image of each, every camera stopped."
    )
    page.verdict("every cycle ends, with an image of every camera", whole, "see above")
    page.verdict("no file or thread is left", kept, "numbers of the process")
    page.verdict("memory is flat", flat < CYCLES_GROWTH_MB, f"{flat:+.1f} MB at most")
    page.text("")


def _fuzz_table(page: Report, runs: int) -> None:
    found = fuzzed(MINUTES * min(1.0, runs / RUNS))
    page.table(("malformed packets", "sent"), sorted(found.sent.items()))
    page.text(
        f"{found.minutes:.1f} minutes in {found.spells} bursts, sent under the addresses of three cameras to a client",
        f"under address and undefined sanitizers; {found.frames_fuzzed} whole images came during the bursts.",
    )
    page.verdict("no crash", not found.crashes, "; ".join(found.crashes) or "none")
    good = found.spells - found.spells_without
    page.verdict(
        "the next whole image comes",
        found.spells_without == 0,
        f"{good} of {found.spells} times, after {max(found.next_s):.1f} s at most",
    )
    page.text("")


def _compared_table(page: Report, runs: int) -> None:
    pairs = max(runs // 4, 1)
    rows, shares = [], []
    for count, rate_hz in COMPARED:
        with GigeRig([GigeCamera(f"GE{i + 1:02d}", *SIZE) for i in range(count)]) as rig:
            for number in range(pairs):
                clients = (aravis_client, our_client) if number % 2 else (our_client, aravis_client)
                found = {client: client(rig, rate_hz) for client in clients}
                theirs, ours = found[aravis_client], found[our_client]
                share = ours.per_s / theirs.per_s
                rows.append((count, rate_hz, theirs.per_s, theirs.incomplete, ours.per_s, ours.incomplete, share))
                if theirs.per_s > 0.9 * count * rate_hz:  # else the machine is what is measured
                    shares.append(share)
    page.table(
        ("cameras", "Hz wanted", "theirs, frames/s", "incomplete", "ours, frames/s", "incomplete", "ours / theirs"),
        rows,
    )
    page.text("Where the machine cannot send what is wanted, sender and both clients share its processors: not judged.")
    middle = statistics.median(shares) if shares else float("nan")
    page.verdict(f"at least {LEAST_SHARE} of its frames", middle >= LEAST_SHARE, f"{middle:.3f} (median)")
    page.text("")


def _fault_table(page: Report, runs: int) -> None:
    page.text(f"Each {runs} times; four cameras of 640 x 480, sets by software trigger all the while.")
    found: dict[str, list[WireOutcome]] = {}
    with wire([GigeCamera(f"GE{i + 1:02d}", 640, 480) for i in range(4)]) as made:
        kept = made.source.capture_set()
        pixels = {serial: frame.image.copy() for serial, frame in kept.frames.items()}
        for fault in FAULTS:
            for number in range(runs):
                serial, other = made.rig.serials[number % 4], made.rig.serials[(number + 1) % 4]
                found.setdefault(fault.name, []).append(injected(made, fault, serial, other))
        untouched = all((kept.frames[serial].image == image).all() for serial, image in pixels.items())
        inside = made.rig.pid
    rows = [
        (name, *(cell for part in ("seen_s", "named_s", "recovered_s") for cell in _column(outcomes, part)))
        for name, outcomes in found.items()
    ]
    page.table(
        ("fault", "seen", "s (median)", "max", "right cause", "s (median)", "max", "recovered", "s (median)", "max"),
        rows,
    )
    page.text("Recovered: from the moment the fault is taken away to a whole set with every camera usable.")
    every = [one for outcomes in found.values() for one in outcomes]
    well = sum(None not in (o.seen_s, o.named_s, o.recovered_s) for o in every)
    page.verdict(
        "every fault is seen, named by its cause and recovered from", well == len(every), f"{well} of {len(every)}"
    )
    page.verdict("sets taken before are untouched", untouched, "compared pixel by pixel")
    gone = not os.path.exists(f"/proc/{inside}")
    page.verdict("no process and with it no namespace is left", gone, "looked for by its number")


def _column(outcomes: list[WireOutcome], part: str) -> tuple[int, float, float]:
    values = [value for one in outcomes if (value := getattr(one, part)) is not None]
    nothing = float("nan")
    return len(values), statistics.median(values) if values else nothing, max(values, default=nothing)


PARTS: dict[str, tuple[Callable[[Report, int], None], str]] = {
    "figures": (
        _figures_table,
        f"6 and 12 cameras of {SIZE[0]} x {SIZE[1]}, beside the simulated producer in the same run",
    ),
    "cycles": (_cycles_table, "Cameras started and stopped"),
    "compared": (_compared_table, f"Beside libaravis' own client, the same cameras, in turn, {COMPARED_S:g} s each"),
    "faults": (_fault_table, "Faults on the wire"),
    "fuzz": (_fuzz_table, "Malformed packets"),
}


def main() -> int:
    """Measure some parts again; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.studies.gige", description=__doc__)
    parser.add_argument("parts", nargs="+", choices=tuple(PARTS))
    parser.add_argument("--runs", type=int, default=RUNS)
    options = parser.parse_args()
    return 0 if again(options.parts, options.runs, Path(__file__).with_suffix(".md")) else 1


if __name__ == "__main__":
    sys.exit(main())
