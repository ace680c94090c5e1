"""Twelve cameras of 5 MP on the simulated producer: triggered sets, a live stream, how late the program's timer gets.

The same through the camera process, and with Harvesters inside the program (one thread a camera), in the same run. A
timer of 16 ms stands for a window that stays smooth; its lateness with nothing else going on shows what the machine
itself adds. The simulated sensors, hardware in a real rig, get what processor time is left over
(SPHERECAL_GENTL_IDLE), in both runs.
"""

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from camera_rig import rig
from figures import Figures

from spherecal_cameras.protocol import CameraSettings, CaptureRequest
from spherecal_gentl.producer.producer_control import ProducerControl, simulated_cameras

PERIOD_S = 0.016
GOAL_P95_MS, GOAL_MAX_MS = 5.0, 20.0
TICKS_PER_S = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


def lateness(until: Callable[[], bool]) -> dict[str, float]:
    """How late a 16 ms timer of this thread comes while `until` is not fulfilled, ms."""
    late = []
    due = time.perf_counter() + PERIOD_S
    while not until():
        time.sleep(max(due - time.perf_counter(), 0.0))
        now = time.perf_counter()
        late.append(now - due)
        due = max(due + PERIOD_S, now)
    ms = np.array(late) * 1e3
    return {"p50_ms": float(np.median(ms)), "p95_ms": float(np.percentile(ms, 95)), "max_ms": float(ms.max())}


def timed(seconds: float) -> Callable[[], bool]:
    end = time.perf_counter() + seconds
    return lambda: time.perf_counter() > end


def cpu_s(pid: int) -> float:
    """Processor time of a process so far, s."""
    with suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / TICKS_PER_S
    return float("nan")


def through_service(cameras: int, sets: int, seconds: float, rate_hz: float) -> dict[str, Any]:
    """Sets, then a live stream, through the camera process."""
    with rig(list(simulated_cameras(cameras))) as made:
        source = made.source
        source.capture_set(CaptureRequest(timeout_s=5.0))
        taken: list = []
        worker = threading.Thread(target=lambda: [taken.append(source.capture_set()) for _ in range(sets)])
        worker.start()
        during_sets = lateness(lambda: not worker.is_alive())
        worker.join()
        spans = np.array([one.seconds for one in taken])

        before = sum(s.counters.delivered for s in source.statuses().values())
        source.start_live(rate_hz)
        time.sleep(0.5)
        pid = source.service_pid or 0
        cpu, began = (cpu_s(pid), cpu_s(os.getpid())), time.perf_counter()
        before = _delivered(source)
        viewer = _Viewer(source)
        during_live = lateness(timed(seconds))
        viewer.end()
        passed = time.perf_counter() - began
        statuses = source.statuses().values()
        return {
            "complete_sets": f"{sum(one.complete for one in taken)} of {sets}",
            "first_attempt": f"{sum(one.attempts == 1 for one in taken)} of {sets}",
            "set_median_ms": float(np.median(spans) * 1e3),
            "set_p95_ms": float(np.percentile(spans, 95) * 1e3),
            "late_during_sets": during_sets,
            "frames_per_s": (_delivered(source) - before) / passed,
            "wanted_per_s": cameras * rate_hz,
            "underrun": sum(s.counters.underrun for s in statuses),
            "cpu_camera_process": (cpu_s(pid) - cpu[0]) / passed,
            "cpu_program": (cpu_s(os.getpid()) - cpu[1]) / passed,
            "late_during_live": during_live,
        }


class _Viewer:
    """What a window does: takes every camera's newest image, ten times a second."""

    def __init__(self, source) -> None:
        self._source, self._stop = source, threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(0.1):
            for serial in self._source.statuses():
                self._source.latest(serial)

    def end(self) -> None:
        self._stop.set()
        self._thread.join()


def _delivered(source) -> int:
    return sum(s.counters.delivered for s in source.statuses().values())


def in_process(cameras: int, seconds: float, rate_hz: float) -> dict[str, Any]:
    """The plain way: Harvesters in this process, one fetching thread a camera, default time-outs."""
    from harvesters.core import Harvester

    from spherecal_cameras.genicam.features import NodeFeatures
    from spherecal_cameras.genicam.setup import set_up
    from spherecal_gentl.producer.build_producer import build_producer

    harvester, stop, counts = Harvester(), threading.Event(), [0] * cameras
    harvester.add_file(str(build_producer()))
    harvester.update()
    acquirers = []
    settings = CameraSettings(exposure_us=1000.0, trigger="free", frame_rate_hz=rate_hz)
    for number in range(cameras):
        acquirer = harvester.create(number)
        set_up(str(number), NodeFeatures(acquirer.remote_device.node_map), settings)
        acquirer.start()
        acquirers.append(acquirer)

    def fetch(number: int) -> None:
        while not stop.is_set():
            buffer = acquirers[number].try_fetch(timeout=1.0)
            if buffer is not None:
                with buffer:
                    buffer.payload.components[0].data.copy()
                counts[number] += 1

    threads = [threading.Thread(target=fetch, args=(n,), daemon=True) for n in range(cameras)]
    for thread in threads:
        thread.start()
    time.sleep(0.5)
    before, cpu, began = sum(counts), cpu_s(os.getpid()), time.perf_counter()
    late = lateness(timed(seconds))
    passed = time.perf_counter() - began
    result = {
        "frames_per_s": (sum(counts) - before) / passed,
        "wanted_per_s": cameras * rate_hz,
        "cpu_program": (cpu_s(os.getpid()) - cpu) / passed,
        "late_during_live": late,
    }
    print(json.dumps(result), flush=True)
    os._exit(0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, default=12)
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rate", type=float, default=10.0, metavar="HZ", help="of each camera in the live stream")
    parser.add_argument("--save", action="store_true", help="write the figures into baseline.json")
    parser.add_argument("--in-process", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.in_process:
        in_process(options.cameras, options.seconds, options.rate)
    os.environ["SPHERECAL_GENTL_IDLE"] = "1"
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    idle = lateness(timed(5.0))
    service = through_service(options.cameras, options.sets, options.seconds, options.rate)
    with ProducerControl(simulated_cameras(options.cameras)) as steering:
        arguments = ["--cameras", str(options.cameras), "--seconds", str(options.seconds), "--rate", str(options.rate)]
        done = subprocess.run(
            [sys.executable, __file__, "--in-process", *arguments],
            env=os.environ | steering.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            check=True,
        )
    plain = json.loads(done.stdout)
    idle_again = lateness(timed(5.0))
    values = {
        "load_at_start": load, "timer_alone": idle, "timer_alone_after": idle_again, "camera_process": service,
        "in_process": plain,
    }  # fmt: skip
    print(json.dumps(values, indent=1))
    print(f"\n{'':24} {'sets ms (median, p95)':>24} {'frames/s':>9} {'timer late p95, max ms':>24}")
    spans = f"{service['set_median_ms']:.0f}, {service['set_p95_ms']:.0f}"
    for name, row, text in (("camera process", service, spans), ("in process", plain, "-")):
        late = row["late_during_live"]
        print(f"{name:24} {text:>24} {row['frames_per_s']:9.0f} {late['p95_ms']:15.1f}, {late['max_ms']:6.1f}")
    print(f"{'timer alone':24} {'-':>24} {'-':>9} {idle['p95_ms']:15.1f}, {idle['max_ms']:6.1f}")
    met = service["late_during_live"]["p95_ms"] <= GOAL_P95_MS and service["late_during_live"]["max_ms"] <= GOAL_MAX_MS
    print(f"Goal (p95 <= {GOAL_P95_MS:.0f} ms, max <= {GOAL_MAX_MS:.0f} ms): {'met' if met else 'MISSED'}")
    Figures("cameras", values).save(options)
    return 0


if __name__ == "__main__":
    sys.exit(main())
