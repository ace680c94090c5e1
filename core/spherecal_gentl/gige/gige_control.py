"""A rig of simulated GigE Vision cameras in this machine, steered from the program that wants it."""

import json
import mmap
import os
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherecal.base.errors import InputError, OutputError
from spherecal_files.programs import own_program
from spherecal_gentl.gige.namespaces import NetworkNamespace, isolated, why_not
from spherecal_gentl.producer.build_producer import build_fake_camera

MOST_CAMERAS = 12
_HEAD = 64  # bytes, see fake_camera.cpp
_END_S = 10.0


@dataclass(frozen=True)
class GigeCamera:
    """A camera to simulate: serial number (1 to 15 plain characters), size in px."""

    serial: str
    width: int = 2448
    height: int = 2048


class GigeRig(AbstractContextManager["GigeRig"]):
    """Simulated GigE Vision cameras in network namespaces, on one switch with a computer; ends with `close`."""

    def __init__(self, cameras: Sequence[GigeCamera], mtu: int = 1500) -> None:
        _check(cameras, mtu)
        if (reason := why_not()) is not None:
            raise InputError(
                f"Cameras in network namespaces cannot be simulated here ({reason}).",
                "It needs Linux with network namespaces, as root or where users may make namespaces.",
            )
        server = build_fake_camera()
        self._pictures = {camera.serial: _Pictures(camera) for camera in cameras}
        files = [pictures.file for pictures in self._pictures.values()]
        command = isolated(own_program("spherecal_gentl.gige.fake_rig"))
        package = str(Path(__file__).resolve().parents[2])
        path = os.pathsep.join(filter(None, (package, os.environ.get("PYTHONPATH"))))
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, pass_fds=files,
            env=os.environ | {"PYTHONPATH": path},
        )  # fmt: skip
        try:
            about = [
                {"serial": c.serial, "width": c.width, "height": c.height, "pictures": self._pictures[c.serial].file}
                for c in cameras
            ]
            answer = self._ask({"server": str(server), "mtu": mtu, "cameras": about})
        except BaseException:
            self.close()
            raise
        self.addresses: dict[str, str] = answer["addresses"]
        self.pid: int = answer["pid"]
        self._computers: dict[str, int] = {name: answer[name] for name in ("client", "second")}

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switch the rig off; its namespaces end with it."""
        if self._process.stdin is not None:
            with suppress(OSError):  # a line that was never read is still held
                self._process.stdin.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        for pictures in self._pictures.values():
            pictures.close()
        self._pictures.clear()

    @property
    def serials(self) -> tuple[str, ...]:
        """The simulated cameras' serial numbers."""
        return tuple(self._pictures)

    def inside(self, command: Sequence[str] = (), computer: str = "client") -> list[str]:
        """The command that runs `command` on a computer of the rig, in whatever process it is started."""
        user = [] if os.geteuid() == 0 else [f"--user=/proc/{self.pid}/ns/user", "--preserve-credentials"]
        return ["nsenter", *user, f"--net=/proc/{self.pid}/fd/{self._computers[computer]}", *command]

    def shell(self, command: str) -> list[str]:
        """The command that runs a shell's on the rig's computer; all of it ends when its starter ends."""
        alone = ["unshare", "--pid", "--fork", "--kill-child", "--mount-proc"]
        try:
            tried = subprocess.run(self.inside([*alone, "true"]), capture_output=True, timeout=_END_S, check=False)
        except (OSError, subprocess.TimeoutExpired):
            alone = []
        else:
            alone = alone if tried.returncode == 0 else []
        # the shell stays, to `exit`: as the first process, the command itself would not get Ctrl-C
        return self.inside(["setpriv", "--pdeathsig", "SIGKILL", *alone, "sh", "-c", f"{command}\nexit $?"])

    @contextmanager
    def entered(self, computer: str = "client") -> Iterator[None]:
        """The calling thread, and what it starts, is on the rig's computer `client` or `second` meanwhile; as root."""
        network = NetworkNamespace(
            os.open(f"/proc/{self.pid}/fd/{self._computers[computer]}", os.O_RDONLY | os.O_CLOEXEC)
        )
        try:
            with network.entered():
                yield
        finally:
            os.close(network.file)

    def set_image(self, serial: str, image: NDArray[np.uint8]) -> None:
        """Set what a simulated camera sees from the next frame on; `image`: of the camera's size, (height, width)."""
        self._pictures[serial].put(image)

    def fault(self, name: str, *words: str | float) -> None:
        """Make a fault."""
        self._ask([name, *words])

    def _ask(self, request: Any) -> dict[str, Any]:
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None and stdout is not None
        try:
            stdin.write(json.dumps(request) + "\n")
            stdin.flush()
            line = stdout.readline()
        except OSError:
            line = ""
        if not line:
            raise OutputError("The simulated GigE rig has ended.", "Its own messages are above.")
        answer = json.loads(line)
        if "error" in answer:
            raise OutputError(f"The simulated GigE rig: {answer['error']}.")
        return answer


# Faults: what the words mean. A camera is named by its serial number.
FAULTS = {
    "loss": "CAMERA PERCENT", "burst": "CAMERA LENGTH EVERY", "thin": "CAMERA|line MBIT_S",
    "latency": "CAMERA MS JITTER_MS", "unplug": "CAMERA", "plug": "CAMERA", "power_off": "CAMERA",
    "power_on": "CAMERA", "seize": "CAMERA", "release": "CAMERA", "conflict": "CAMERA OTHER", "subnet": "CAMERA",
    "home": "CAMERA",
}  # fmt: skip


class _Pictures:
    """The shared memory in which one camera finds what it sees."""

    def __init__(self, camera: GigeCamera) -> None:
        self._shape = (camera.height, camera.width)
        size = _HEAD + 2 * camera.width * camera.height
        self.file = os.memfd_create(f"spherecal-{camera.serial}")
        os.ftruncate(self.file, size)
        self._memory = mmap.mmap(self.file, size)
        self._number = 0

    def put(self, image: NDArray[np.uint8]) -> None:
        if image.shape != self._shape or image.dtype != np.uint8:
            raise InputError(f"An image of {self._shape[1]} x {self._shape[0]} px with 8 bits is needed.")
        number = self._number + 1
        start = _HEAD + (number & 1) * image.size
        self._memory[start : start + image.size] = image.tobytes()
        self._memory[:8] = number.to_bytes(8, "little")
        self._number = number

    def close(self) -> None:
        self._memory.close()
        os.close(self.file)


def _check(cameras: Sequence[GigeCamera], mtu: int) -> None:
    if not 1 <= len(cameras) <= MOST_CAMERAS:
        raise InputError(f"1 to {MOST_CAMERAS} GigE cameras can be simulated, not {len(cameras)}.")
    if len({camera.serial for camera in cameras}) < len(cameras):
        raise InputError("Two simulated cameras have the same serial number.")
    for camera in cameras:
        if not (0 < len(camera.serial) <= 15 and camera.serial.isascii() and camera.serial.isprintable()):
            raise InputError(f"{camera.serial!r} is no serial number: 1 to 15 plain characters.")
        if not (16 <= camera.width <= 8192 and 16 <= camera.height <= 8192):
            raise InputError(f"{camera.width} x {camera.height} px is no sensor's size.")
    if not 576 <= mtu <= 9216:
        raise InputError(f"{mtu} bytes is no size of a packet on Ethernet: 576 to 9216.")
