"""The shared memory region of simulated cameras: its layout (in C++ too), opened and made."""

import mmap
import os
import sys
from collections import namedtuple
from contextlib import suppress
from multiprocessing import shared_memory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherecal.base.errors import InputError, OutputError

MAGIC = 0x54474353
LAYOUT_VERSION = 1  # raise it here and in region.h whenever one of them changes
MOST_DEVICES = 16
PAGE = 4096
IMAGES_AT = PAGE * (1 + MOST_DEVICES)
ANY_ADDRESS = 0xFFFFFFFF
FOR_EVER = 2**64 - 1


def _record(size: int, **fields: tuple[Any, int]) -> np.dtype[Any]:
    return np.dtype(
        {
            "names": list(fields),
            "formats": [form for form, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": size,
        }
    )


HEADER = _record(
    PAGE, magic=("u4", 0), layout_version=("u4", 4), device_count=("u4", 8), owner_pid=("u4", 12),
    slot_bytes=("u8", 16), total_bytes=("u8", 24), line_pulses=("u8", 32), line_pulse_ns=("u8", 40),
)  # fmt: skip

REGISTERS = _record(
    256, width=("u4", 0), height=("u4", 4), offset_x=("u4", 8), offset_y=("u4", 12), pixel_format=("u4", 16),
    acquisition_mode=("u4", 20), acquisition_frame_count=("u4", 24), frame_rate_enable=("u4", 28),
    frame_rate_hz=("f8", 32), exposure_us=("f8", 40), gain_db=("f8", 48), trigger_delay_us=("f8", 56),
    trigger_selector=("u4", 64), trigger_mode=("u4", 68), trigger_source=("u4", 72), packet_size=("u4", 96),
    packet_delay_ns=("u4", 100), indicator=("u4", 108), user_id=("S64", 128),
)  # fmt: skip

# What a camera counts since its region was made; `last_image` is the number of the picture last sent.
Counters = namedtuple(
    "Counters",
    "opened closed reads writes triggers triggers_dropped triggers_missed frames_exposed frames_delivered "
    "frames_incomplete frames_lost frames_late frames_underrun acquisition_starts acquisition_stops last_image",
)

DEVICE = _record(
    PAGE,
    serial=("S32", 0),
    user_id=("S64", 32),
    model=("S32", 96),
    sensor_width=("u4", 128),
    sensor_height=("u4", 132),
    source_bits=("u4", 136),
    padding_bytes=("u4", 140),
    temperature_c=("f8", 144),
    exposure_reference_us=("f8", 152),
    link_bytes_per_s=("f8", 160),
    clock_offset_ns=("i8", 168),
    image_begun=("u8", 176),
    image_published=("u8", 184),
    unplugged_until_ns=("u8", 192),
    plug_generation=("u4", 200),
    open_error=("i4", 204),
    read_error=("i4", 208),
    read_error_count=("i4", 212),
    read_error_address=("u4", 216),
    write_error=("i4", 220),
    write_error_count=("i4", 224),
    write_error_address=("u4", 228),
    port_delay_us=("u4", 232),
    event_error=("i4", 236),
    event_error_count=("i4", 240),
    incomplete_count=("i4", 244),
    dropped_trigger_count=("i4", 248),
    lost_frame_count=("i4", 252),
    late_count=("i4", 256),
    late_ms=("u4", 260),
    crash_count=("i4", 264),
    **{name: ("u8", 288 + 8 * i) for i, name in enumerate(Counters._fields)},
    acquiring=("u4", 416),
    open_by_pid=("u4", 420),
    powered=("u4", 424),
    user_set_default=("u4", 428),
    user_set_saved=("u4", 432),
    registers=(REGISTERS, 1024),
)


REGION_VARIABLE = "SPHERECAL_GENTL_REGION"


def default_name() -> str:
    """The name under which simulated cameras look: SPHERECAL_GENTL_REGION, or else one for each user."""
    asked = os.environ.get(REGION_VARIABLE, "")
    if asked not in ("", "-"):
        return asked
    return "spherecal-gentl" if sys.platform == "win32" else f"spherecal-gentl-{os.getuid()}"


class SharedRegion:
    """A mapped region: `header` and `devices` are views of its memory, `slot` an image's place."""

    def __init__(self, name: str, memory: shared_memory.SharedMemory | mmap.mmap) -> None:
        self.name = name
        self._memory = memory
        self._bytes: NDArray[np.uint8] | None = np.frombuffer(_buffer(memory), np.uint8)
        self._header = self._bytes[:PAGE].view(HEADER)
        count = int(self._header["device_count"][0])
        self._devices = self._bytes[PAGE : PAGE * (1 + count)].view(DEVICE)

    @property
    def header(self) -> NDArray[Any]:
        """The header as an array of one record."""
        return self._header

    @property
    def devices(self) -> NDArray[Any]:
        """The records of the simulated cameras, one for each."""
        return self._devices

    def slot(self, device: int, image: int) -> NDArray[np.uint8]:
        """The bytes of one image of a camera (two slots take turns)."""
        assert self._bytes is not None
        size = int(self._header["slot_bytes"][0])
        start = IMAGES_AT + (2 * device + image % 2) * size
        return self._bytes[start : start + size]

    def close(self) -> None:
        """Unmap; the maker also removes the name. No view of the memory may be in use any more."""
        if isinstance(self._memory, shared_memory.SharedMemory):
            with suppress(FileNotFoundError):
                self._memory.unlink()  # first: it must not stay behind whatever closing finds
        self._bytes, self._header, self._devices = None, np.empty(0, HEADER), np.empty(0, DEVICE)
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
    if not _alive(owner):
        with suppress(FileNotFoundError):
            leftover = shared_memory.SharedMemory(name)
            leftover.close()
            leftover.unlink()


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
