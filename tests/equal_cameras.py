"""Stock fake GigE cameras of libaravis that are equal in all they say, found, opened, switched off and on again.

Run by test_camera_identity.py in a network namespace of its own, as `equal_cameras.py PRODUCER SERIAL...`; prints what
was found and how each camera stood: opened, with one without power, and with all again.
"""

import json
import os
import subprocess
import sys
import time

from spherecal_cameras.genicam.genicam_source import GenicamSource


def camera(number: int, serial: str) -> subprocess.Popen:
    words = ["arv-fake-gv-camera-0.8", "-i", f"127.0.0.{number + 2}", "-s", serial]
    return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def states(source: GenicamSource) -> dict[str, str]:
    return {serial: status.state.value for serial, status in source.statuses().items()}


def until(done, seconds: float = 40.0) -> None:
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.2)


def main(producer: str, *serials: str) -> None:
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    for number in range(len(serials)):
        subprocess.run(["ip", "address", "add", f"127.0.0.{number + 2}/8", "dev", "lo"], check=True)
    os.environ["SPHERECAL_GIGE_ADDRESSES"] = " ".join(f"127.0.0.{number + 2}" for number in range(len(serials)))
    cameras = [camera(number, serial) for number, serial in enumerate(serials)]
    time.sleep(1.0)
    try:
        with GenicamSource((producer,)) as source:
            found = source.discover().cameras
            source.open([info.serial for info in found], {})
            source.start_live(5.0)
            until(lambda: all(source.latest(info.serial) is not None for info in found))
            opened = states(source)
            cameras[1].kill()
            cameras[1].wait()
            until(lambda: {"lost", "busy"} & set(states(source).values()))
            time.sleep(1.0)
            without = states(source)
            cameras[1] = camera(1, serials[1])
            until(lambda: not {"lost", "busy", "error"} & set(states(source).values()))
            again = states(source)
        infos = {info.serial: info.address for info in found}
        print(json.dumps({"found": infos, "opened": opened, "without": without, "again": again}))
    finally:
        for one in cameras:
            one.kill()


if __name__ == "__main__":
    main(*sys.argv[1:])
