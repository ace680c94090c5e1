"""The shared memory region of simulated cameras: its layout (that of region.h), opened and made."""

import mmap
import os
import re
import sys
from collections import namedtuple
from contextlib import suppress
from multiprocessing import shared_memory
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherecal.base.errors import InputError, OutputError
from spherecal_files.programs import process_runs

_SOURCE = re.sub("//.*", "", Path(__file__).with_name("region.h").read_text(encoding="utf-8"))
_CONSTANTS = {name: int(value, 0) for name, value in re.findall(r"constexpr \w+ (\w+) = (\w+);", _SOURCE)}
MAGIC, LAYOUT_VERSION, MOST_DEVICES = (_CONSTANTS[name] for name in ("magic", "layout_version", "most_devices"))
PAGE, ANY_ADDRESS = _CONSTANTS["page"], _CONSTANTS["any_address"]
IMAGES_AT = PAGE * (1 + MOST_DEVICES)
FOR_EVER = 2**64 - 1


def _structures() -> dict[str, np.dtype[Any]]:
    """The structures of region.h by name, laid out as C++ does it."""
    plain = {"uint32_t": "u4", "uint64_t": "u8", "int64_t": "i8", "double": "f8", "I32": "i4", "U32": "u4"}
    known: dict[str, Any] = plain | {"I64": "i8", "U64": "u8"}
    for name, body in re.findall(r"struct (\w+) \{(.*?)\n\};", _SOURCE, re.DOTALL):
        fields = [
            (one, f"S{length}" if kind == "char" else known[kind])
            for kind, names in re.findall(r"(\w+) ([^;]+);", body)
            for one, length in re.findall(r"(\w+)(?:\[(\d+)\])?", names)
        ]
        known[name] = np.dtype(fields, align=True)
    return known


_KNOWN = _structures()
HEADER, REGISTERS, DEVICE = (_KNOWN[name] for name in ("Header", "Registers", "Device"))

# What a camera counts since its region was made; `last_image` is the number of the picture last sent.
Counters = namedtuple(
    "Counters",
    "opened closed reads writes triggers triggers_dropped triggers_missed frames_exposed frames_delivered "
    "frames_incomplete frames_lost frames_late frames_underrun acquisition_starts acquisition_stops last_image",
)

REGION_VARIABLE = "SPHERECAL_GENTL_REGION"


def default_name() -> str:
    """The name under which simulated cameras look: SPHERECAL_GENTL_REGION, or else one for each user."""
    asked = os.environ.get(REGION_VARIABLE, "")
    if asked not in ("", "-"):
        return asked
    return "spherecal-gentl" if sys.platform == "win32" else f"spherecal-gentl-{os.getuid()}"


class SharedRegion:
    """A mapped region: `header` (1,) and `devices` (n,) are its records, `slot` an image's place."""

    def __init__(self, name: str, memory: shared_memory.SharedMemory | mmap.mmap) -> None:
        self.name = name
        self._memory = memory
        self._bytes: NDArray[np.uint8] | None = np.frombuffer(_buffer(memory), np.uint8)
        self.header: NDArray[Any] = self._bytes[:PAGE].view(HEADER)
        count = int(self.header["device_count"][0])
        self.devices: NDArray[Any] = self._bytes[PAGE : PAGE * (1 + count)].view(DEVICE)

    def slot(self, device: int, image: int) -> NDArray[np.uint8]:
        """The bytes of one image of a camera (two slots take turns)."""
        assert self._bytes is not None
        size = int(self.header["slot_bytes"][0])
        start = IMAGES_AT + (2 * device + image % 2) * size
        return self._bytes[start : start + size]

    def close(self) -> None:
        """Unmap; the maker also removes the name. No view of the memory may be in use any more."""
        if isinstance(self._memory, shared_memory.SharedMemory):
            with suppress(FileNotFoundError):
                self._memory.unlink()  # first: it must not stay behind whatever closing finds
        self._bytes, self.header, self.devices = None, np.empty(0, HEADER), np.empty(0, DEVICE)
        self._memory.close()


def create(name: str, device_count: int, slot_bytes: int) -> SharedRegion:
    """A new region of zeroes with its header filled. One left over by a program that ended is replaced."""
    total = IMAGES_AT + 2 * device_count * slot_bytes
    _clear_leftover(name)
    try:
        memory = shared_memory.SharedMemory(name, create=True, size=total)
    except FileExistsError as error:
        raise InputError(f"Simulated cameras named {name} are running already.", "End them first.") from error
    except OSError as error:
        raise OutputError(f"No shared memory for the simulated cameras ({error.strerror}).") from error
    header = np.frombuffer(_buffer(memory), HEADER, 1)
    header["device_count"], header["owner_pid"] = device_count, os.getpid()
    header["slot_bytes"], header["total_bytes"] = slot_bytes, total
    header["layout_version"] = LAYOUT_VERSION
    header["magic"] = MAGIC
    return SharedRegion(name, memory)


def attach(name: str) -> SharedRegion:
    """The region that a running controller made."""
    try:
        memory = _open(name)
    except (OSError, ValueError) as error:
        raise InputError(f"There are no simulated cameras named {name}.", "Start them first.") from error
    header = np.frombuffer(_buffer(memory), HEADER, 1)
    known = int(header["magic"][0]) == MAGIC and int(header["layout_version"][0]) == LAYOUT_VERSION
    del header
    if not known:
        memory.close()
        raise InputError(f"The simulated cameras named {name} belong to another version of this program.")
    return SharedRegion(name, memory)


def _open(name: str) -> shared_memory.SharedMemory | mmap.mmap:
    if sys.platform == "win32":
        return shared_memory.SharedMemory(name)
    # SharedMemory would hand the name to the resource tracker, which takes it away when this process ends (before
    # Python 3.13 there is no way to ask it not to), though it belongs to another one.
    import _posixshmem  # pyright: ignore[reportMissingImports]

    file = _posixshmem.shm_open(f"/{name}", os.O_RDWR, mode=0o600)
    try:
        if os.fstat(file).st_uid != os.getuid():  # pictures and settings of somebody else
            raise PermissionError("it belongs to another user")
        return mmap.mmap(file, 0)
    finally:
        os.close(file)


def _buffer(memory: shared_memory.SharedMemory | mmap.mmap) -> memoryview | mmap.mmap:
    if isinstance(memory, mmap.mmap):
        return memory
    assert memory.buf is not None
    return memory.buf


def _clear_leftover(name: str) -> None:
    try:
        left = attach(name)
    except InputError:
        return
    owner = int(left.header["owner_pid"][0])
    left.close()
    if not process_runs(owner):
        with suppress(FileNotFoundError):
            leftover = shared_memory.SharedMemory(name)
            leftover.close()
            leftover.unlink()
