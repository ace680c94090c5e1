"""A bare Harvesters client that counts frames: `python -m benchmarks.gige_client CTI SECONDS HZ [simulated]`.

Prints one line of JSON: frames, incomplete frames and missing packets of each camera, processor seconds used.
"""

import json
import logging
import sys
import time
from contextlib import suppress

_POLL_S = 0.002


def main() -> None:
    """Open every camera, free running, and count for some seconds."""
    from harvesters.core import Harvester

    logging.getLogger("harvesters").setLevel(logging.CRITICAL)
    file, seconds, rate = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
    harvester = Harvester()
    harvester.add_file(file, check_existence=True, check_validity=True)
    harvester.update()
    cameras = []
    for about in harvester.device_info_list:
        camera = harvester.create({"serial_number": str(about.serial_number)})
        camera.num_buffers, camera.timeout_period_on_update_event_data_call = 10, 0
        nodes = camera.remote_device.node_map
        nodes.TriggerMode.value = "Off"
        with suppress(AttributeError):
            nodes.AcquisitionFrameRateEnable.value = True
        nodes.AcquisitionFrameRate.value = rate
        cameras.append(camera)
    for camera in cameras:
        camera.start()
    frames = [0] * len(cameras)
    _count(cameras, frames, 1.0)  # the start does not count
    frames = [0] * len(cameras)
    cpu, began = time.process_time(), time.perf_counter()
    _count(cameras, frames, seconds)
    took, used = time.perf_counter() - began, time.process_time() - cpu
    incomplete, missing = [], []
    for camera in cameras:
        nodes = camera.data_streams[0].node_map
        with suppress(AttributeError):
            incomplete.append(nodes.StreamIncompleteFrameCount.value)
            missing.append(nodes.StreamMissingPacketCount.value)
        camera.stop()
        camera.destroy()
    harvester.reset()
    print(json.dumps({"frames": frames, "seconds": took, "incomplete": incomplete, "missing": missing, "cpu_s": used}))


def _count(cameras: list, frames: list[int], seconds: float) -> None:
    until = time.perf_counter() + seconds
    while time.perf_counter() < until:
        idle = True
        for number, camera in enumerate(cameras):
            if camera.data_streams[0].num_awaiting_delivery == 0:
                continue
            buffer = camera.try_fetch(timeout=0.05)
            if buffer is not None:
                frames[number] += 1
                buffer.queue()
            idle = False
        if idle:
            time.sleep(_POLL_S)


if __name__ == "__main__":
    main()
