"""Drivers exchanged while they are looked at: what was not allowed must never be loaded."""

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from spherecal_cameras.genicam.discovery import discover
from spherecal_cameras.genicam.messages import RequestedCamera
from spherecal_cameras.genicam.service import CameraService
from spherecal_cameras.genicam.trust import TrustStore, admit_again
from spherecal_cameras.protocol import CameraSettings
from spherecal_gentl.producer.build_producer import build_producer

_LOADING_S = 0.5  # in which the process that was started again would load the driver
_RESTART_S = 20.0  # a process that was killed is started again within 2 s, on a busy machine later

# Loaded, it leaves a file that says so; a GenTL producer it is not, which its verdict then says.
_SOURCE = """
#include <stdio.h>
__attribute__((constructor)) static void loaded(void) {
    FILE *f = fopen("%s", "a");
    if (f) { fputs("x", f); fclose(f); }
}
"""


@dataclass(frozen=True)
class Races:
    """How often a driver was exchanged while it was looked for, and what was loaded in spite of it."""

    tries: int
    allowed_loaded: int
    loaded_unchecked: int


def build(folder: Path, name: str) -> tuple[Path, Path]:
    """A shared library, and the file that it writes when it is loaded."""
    mark, source, library = folder / f"{name}.mark", folder / f"{name}.c", folder / f"{name}.cti"
    source.write_text(_SOURCE % mark)
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    return library, mark


def flip_drivers(tries: int, folder: Path, in_place: bool = False) -> Races:
    """Flip a link between an allowed and another driver (or exchange the file itself) while discovery looks at it."""
    good, good_mark = build(folder, "good")
    evil, evil_mark = build(folder, "evil")
    (folder / "maker").mkdir()
    path = folder / "maker" / "maker.cti"
    store = TrustStore(folder / "drivers.json")
    _put(path, good, in_place)
    store.allow(store.look(str(path)))
    if not in_place:
        store.allow(store.look(str(good)))
    over = threading.Event()
    flipper = threading.Thread(target=_flip, args=(path, (evil, good), in_place, over))
    flipper.start()
    done = 0
    try:
        while done < tries:
            done += 1
            discover([str(path)], None, TrustStore(folder / "drivers.json"), lambda driver: False)
    finally:
        over.set()
        flipper.join()
    return Races(done, _times(good_mark), _times(evil_mark))


def kill_and_swap(tries: int, folder: Path) -> Races:
    """Kill the camera process at work and exchange the driver's file before it starts again.

    The allowed driver is the simulated producer under another name and with another hash, so that it counts as a
    stranger's: `allowed_loaded` are the tries in which its camera was open before the exchange.
    """
    evil, evil_mark = build(folder, "evil")
    good = folder / "good.cti"
    good.write_bytes(build_producer().read_bytes() + b"\0")
    (folder / "maker").mkdir()
    path = folder / "maker" / "maker.cti"
    store = TrustStore(folder / "drivers.json")
    at_work = 0
    for turn in range(tries):
        _put(path, good, in_place=True)
        store.allow(store.look(str(path)))
        service = CameraService(gate=lambda file: admit_again(store, file))
        try:
            camera = discover([str(path)], None, store, lambda driver: False).cameras[0]
            wanted = [RequestedCamera(camera.serial, str(path), "", "", CameraSettings())]
            at_work += service.open(wanted)[0].image_size is not None
            first = service.pid
            _put(path, evil, in_place=True)
            if first is not None:
                os.kill(first, signal.SIGKILL)
            until = time.monotonic() + _RESTART_S
            while time.monotonic() < until and service.pid in (first, None):
                time.sleep(0.02)
            if turn % 2:  # and asked to open it once more
                service.open(wanted)
            else:
                time.sleep(_LOADING_S)
        finally:
            service.close()
    return Races(tries, at_work, _times(evil_mark))


def _times(mark: Path) -> int:
    return len(mark.read_text()) if mark.exists() else 0


def _put(path: Path, driver: Path, in_place: bool) -> None:
    new = path.with_suffix(".new")
    if in_place:
        new.write_bytes(driver.read_bytes())
        new.chmod(0o755)
    else:
        new.symlink_to(driver)
    new.replace(path)


def _flip(path: Path, drivers: tuple[Path, Path], in_place: bool, over: threading.Event) -> None:
    while not over.is_set():
        for driver in drivers:
            _put(path, driver, in_place)
            time.sleep(0.001)
    _put(path, drivers[1], in_place)


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory(dir=os.environ.get("HOSTILE_IN")) as made:
        for number, in_place in enumerate((False, True)):
            own = Path(made) / str(number)
            own.mkdir()
            print(flip_drivers(int(sys.argv[1]), own, in_place))
