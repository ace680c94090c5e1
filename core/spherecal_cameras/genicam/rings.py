"""Rings of frames in shared memory between the camera process and the program, and frames that are views of them."""

import os
import secrets
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spherecal.base.errors import OutputError, reason
from spherecal.base.messages.values import Phrase
from spherecal_cameras.genicam.messages import FrameMeta, UseRing
from spherecal_cameras.protocol import CameraError, Frame, GreyPixels
from spherecal_files.filesystem import remove_below

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
    """Remove the shared memory of killed programs, where /dev/shm lists it; the names removed."""
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
                handle = getattr(self._memory, "_fd", -1)
                if handle >= 0 and hasattr(os, "posix_fallocate"):  # else a full /dev/shm ends us at a later write
                    os.posix_fallocate(handle, 0, size)
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


_TRIES = 3  # an image may be overwritten while it is copied; the next one is newer anyway


class FrameStore:
    """All rings of images, which survive the camera process. Reading does not wait for anything."""

    def __init__(self) -> None:
        self._rings: dict[str, Ring] = {}
        self._newest: dict[str, FrameMeta] = {}
        self._mailbox: dict[str, tuple[FrameMeta, Frame]] = {}

    def ring_for(self, serial: str, image_bytes: int) -> UseRing:
        """A ring that the camera's images fit into, made where there is none."""
        ring = self._rings.get(serial)
        if ring is None or ring.slot_bytes < image_bytes:
            made = Ring(shared_memory_name(), SLOTS, max(image_bytes, 1), create=True)
            if ring is not None:
                ring.unlink()  # the camera process has it until it uses the new one
            self._rings[serial] = ring = made
        return UseRing(serial, ring.name, ring.slots, ring.slot_bytes)

    def in_use(self) -> list[UseRing]:
        """All rings, for a new camera process."""
        return [UseRing(serial, ring.name, ring.slots, ring.slot_bytes) for serial, ring in self._rings.items()]

    def keep_only(self, serials: Iterable[str]) -> None:
        """Free the rings and images of all other cameras."""
        kept = set(serials)
        for serial in [s for s in self._rings if s not in kept]:
            self._rings.pop(serial).unlink()
            self._newest.pop(serial, None)
            self._mailbox.pop(serial, None)

    def announce(self, meta: FrameMeta) -> None:
        """Note the newest image of a camera; its pixels are in its ring."""
        self._newest[meta.serial] = meta

    def read(self, meta: FrameMeta) -> Frame | None:
        """A copy of an image as the camera process announced it, None if it has been overwritten."""
        ring = self._rings.get(meta.serial)
        if ring is None or ring.name != meta.ring:
            return None
        image = ring.read(meta.slot, meta.sequence, meta.height, meta.width, meta.deep)
        if image is None:
            return None
        image.flags.writeable = False
        return Frame(
            meta.serial, image, meta.bits, meta.pixel_format, meta.taken_s, meta.arrived_s, meta.frame_id,
            meta.time_stamp_ns, meta.round, meta.exposure_us, meta.gain_db, meta.temperature_c,
            common_clock=meta.common_clock,
        )  # fmt: skip

    def latest(self, serial: str) -> Frame | None:
        """The newest image of a camera, copied once however often it is requested; None if there was none yet."""
        for _ in range(_TRIES):
            meta = self._newest.get(serial)
            kept = self._mailbox.get(serial)
            if meta is None or (kept is not None and kept[0] is meta):
                return kept[1] if kept else None
            frame = self.read(meta)
            if frame is not None:
                self._mailbox[serial] = (meta, frame)
                return frame
        kept = self._mailbox.get(serial)
        return kept[1] if kept else None

    def close(self) -> None:
        """Free all shared memory."""
        for ring in self._rings.values():
            ring.unlink()
        self._rings, self._newest, self._mailbox = {}, {}, {}
