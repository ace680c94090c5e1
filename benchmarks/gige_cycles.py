"""Start and stop of simulated GigE cameras, over and over: `python -m benchmarks.gige_cycles CTI CAMERAS CYCLES`.

Prints one line of JSON: seconds of each cycle, cycles with an image of every camera, memory, files and threads of the
process, which has Harvesters and the Aravis producer in it.
"""

import json
import logging
import os
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any

from benchmarks.studies.cameras import resident_mb
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.producer.build_producer import build_producer

# 12 cameras x 80 cycles, of buffers of 0.3 MB: one buffer kept in each start would be 300 MB.
CYCLES, CYCLES_GROWTH_MB = 100, 4.0
_SIZE, _IMAGE_S, _LIMIT_S = (640, 480), 20.0, 3600.0


@dataclass(frozen=True)
class Cycled:
    """What the cycles took, and what the process had after the first fifth of them and at the end."""

    cameras: int
    cycles: int
    whole: int
    median_s: float
    longest_s: float
    mb: tuple[float, float]
    files: tuple[int, int]
    threads: tuple[int, int]


def cycled(cameras: int, cycles: int) -> Cycled:
    """So many cameras started and stopped so often, by a program on the rig's computer."""
    producer = build_producer(aravis=True)
    with GigeRig([GigeCamera(f"GE{i + 1:02d}", *_SIZE) for i in range(cameras)]) as rig:
        words = [sys.executable, "-m", "benchmarks.gige_cycles", str(producer), str(cameras), str(cycles)]
        done = subprocess.run(rig.inside(words), stdout=subprocess.PIPE, text=True, timeout=_LIMIT_S, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    taken, held = found["seconds"], found["held"]
    first, last = held[max(cycles // 5, 1) - 1], held[-1]
    return Cycled(
        cameras,
        cycles,
        found["whole"],
        statistics.median(taken),
        max(taken),
        (first[0], last[0]),
        (first[1], last[1]),
        (first[2], last[2]),
    )


def main() -> None:
    """Open every camera, free running; start all, an image of each, stop all."""
    from harvesters.core import Harvester

    logging.getLogger("harvesters").setLevel(logging.CRITICAL)
    file, count, cycles = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    harvester = Harvester()
    harvester.add_file(file, check_existence=True, check_validity=True)
    harvester.update()
    assert len(harvester.device_info_list) == count, [about.serial_number for about in harvester.device_info_list]
    cameras = [harvester.create({"serial_number": str(about.serial_number)}) for about in harvester.device_info_list]
    for camera in cameras:
        camera.timeout_period_on_update_event_data_call = 5
        camera.remote_device.node_map.TriggerMode.value = "Off"
    seconds, held, whole = [], [], 0
    for _ in range(cycles):
        began = time.perf_counter()
        for camera in cameras:
            camera.start()
        whole += all([_image(camera) for camera in cameras])
        for camera in cameras:
            camera.stop()
        seconds.append(time.perf_counter() - began)
        held.append((resident_mb(os.getpid()), *(len(os.listdir(f"/proc/self/{kind}")) for kind in ("fd", "task"))))
    for camera in cameras:
        camera.destroy()
    harvester.reset()
    print(json.dumps({"seconds": seconds, "held": held, "whole": whole}))


def _image(camera: Any) -> bool:
    until = time.perf_counter() + _IMAGE_S
    while time.perf_counter() < until:
        buffer = camera.try_fetch(timeout=0.5)
        if buffer is not None:
            with buffer:
                return True
    return False


if __name__ == "__main__":
    main()
