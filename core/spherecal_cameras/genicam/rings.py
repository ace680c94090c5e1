"""Rings of images in shared memory: the camera process writes, the program reads, neither waits for the other."""

import os
import secrets
from contextlib import suppress
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spherecal.base.errors import OutputError, reason
from spherecal.base.filesystem import remove_below
from spherecal.base.messages.values import Phrase
from spherecal_cameras.protocol import CameraError, GreyPixels

# 4 images: 0.27 s of 15 frames/s to fetch one before it is overwritten.
SLOTS = 4
_HEADER = 64  # two numbers: the image being written, the image that is there
_PREFIX = "spherecal"
_FOLDER = Path("/dev/shm")


def shared_memory_name() -> str:
    """A new name that says which process made it: namespace of process ids, process id, random part."""
    return f"{_PREFIX}-{_namespace()}-{os.getpid()}-{secrets.token_hex(4)}"


def _namespace() -> int:
    try:
        return Path("/proc/self/ns/pid").stat().st_ino
    except OSError:
        return 0


def remove_orphans() -> list[str]:
    """Remove the shared memory of programs that were killed together with Python's own cleaner; the names removed.

    Only on systems that list it in /dev/shm.
    """
    removed = []
    if not _FOLDER.is_dir():  # Windows frees it by itself, macOS does not list it
        return removed
    for file in _FOLDER.glob(f"{_PREFIX}-{_namespace()}-*-*"):
        pid = file.name.split("-")[2]
        if pid.isdecimal() and not Path(f"/proc/{pid}").exists():
            with suppress(OutputError):
                remove_below(_FOLDER, file.name)
                removed.append(file.name)
    return removed


class Ring:
    """Shared memory for the last `slots` images of a camera; the program makes it, the camera process attaches."""

    def __init__(self, name: str, slots: int, slot_bytes: int, create: bool) -> None:
        self.name, self.slots, self.slot_bytes = name, slots, slot_bytes
        size = slots * (_HEADER + slot_bytes)
        self._memory = SharedMemory(name, create=create, size=size if create else 0)
        try:
            if create:
                _reserve(self._memory, size)
        except OSError as error:
            self._memory.close()
            self._memory.unlink()
            raise CameraError(Phrase("error-shared-memory", {"megabytes": size / 1e6, "why": reason(error)})) from error
        stride = _HEADER + slot_bytes
        whole = np.frombuffer(_buffer(self._memory), np.uint8)
        self._heads = [whole[i * stride : i * stride + 16].view(np.int64) for i in range(slots)]
        self._bodies = [whole[i * stride + _HEADER : (i + 1) * stride] for i in range(slots)]
        self._sequence = 0

    def write(self, image: NDArray[np.uint8] | NDArray[np.uint16]) -> tuple[int, int]:
        """Copy an image (h, w), whatever its strides, into the next slot; the slot and the image's number."""
        self._sequence += 1
        slot = self._sequence % self.slots
        head = self._heads[slot]
        head[0] = self._sequence
        body = self._bodies[slot][: image.nbytes].view(image.dtype).reshape(image.shape)
        np.copyto(body, image)
        head[1] = self._sequence
        return slot, self._sequence

    def continue_after(self, sequence: int) -> None:
        """Number images on from this number, so that those of an earlier process are not taken for new ones."""
        self._sequence = sequence

    def last(self) -> int:
        """The highest image number in the ring."""
        return max(int(head[0]) for head in self._heads)

    def read(self, slot: int, sequence: int, height: int, width: int, deep: bool) -> GreyPixels | None:
        """A copy of an image (h, w); None if it has been overwritten meanwhile, or cannot be in the ring."""
        heads, bodies = self._heads, self._bodies
        if not bodies:  # closed meanwhile
            return None
        fits = height > 0 and width > 0 and height * width * (2 if deep else 1) <= self.slot_bytes
        if not (0 <= slot < self.slots and fits):  # the camera process may be wrong about it
            return None
        head = heads[slot]
        if head[1] != sequence or head[0] != sequence:
            return None
        data = bodies[slot][: height * width * (2 if deep else 1)]
        whole: GreyPixels = data.view(np.uint16) if deep else data
        image = whole.reshape(height, width).copy()
        return image if head[0] == sequence else None

    def close(self) -> None:
        """Release the memory in this process."""
        self._heads, self._bodies = [], []
        with suppress(BufferError):  # a reader still copies: freed with its array
            self._memory.close()

    def unlink(self) -> None:
        """Remove the memory; processes that are attached keep theirs until they close it."""
        self.close()
        with suppress(FileNotFoundError):
            self._memory.unlink()


def _buffer(memory: SharedMemory) -> memoryview:
    buffer = memory.buf
    assert buffer is not None  # only after close
    return buffer


def _reserve(memory: SharedMemory, size: int) -> None:
    """Have the system really set the memory aside: else a full /dev/shm ends the process at a later write."""
    handle = getattr(memory, "_fd", -1)
    if handle >= 0 and hasattr(os, "posix_fallocate"):
        os.posix_fallocate(handle, 0, size)


_CONTROL_BYTES = 64


class TouchMark:
    """A note in shared memory of what the camera process is about to do, readable after it has crashed."""

    def __init__(self, name: str, create: bool) -> None:
        self.name = name
        self._memory = SharedMemory(name, create=create, size=_CONTROL_BYTES if create else 0)
        self._cells = np.frombuffer(_buffer(self._memory), np.int32)

    def set(self, camera: int, action: int) -> None:
        """Note what is about to be done."""
        self._cells[0], self._cells[1] = camera + 1, action

    def get(self) -> tuple[int, int]:
        """The camera's number, -1 for none, and the action."""
        return int(self._cells[0]) - 1, int(self._cells[1])

    def close(self) -> None:
        """Release the memory in this process."""
        self._cells = np.empty(0, np.int32)
        with suppress(BufferError):
            self._memory.close()

    def unlink(self) -> None:
        """Remove the memory."""
        self.close()
        with suppress(FileNotFoundError):
            self._memory.unlink()
