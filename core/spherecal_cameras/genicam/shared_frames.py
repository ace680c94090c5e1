"""The images on the program's side: one ring in shared memory and one mailbox a camera."""

from collections.abc import Iterable

from spherecal_cameras.genicam.messages import FrameMeta, UseRing
from spherecal_cameras.genicam.rings import SLOTS, Ring, shared_memory_name
from spherecal_cameras.protocol import Frame

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
            meta.serial,
            image,
            meta.bits,
            meta.pixel_format,
            meta.taken_s,
            meta.arrived_s,
            meta.frame_id,
            meta.time_stamp_ns,
            meta.round,
            meta.exposure_us,
            meta.gain_db,
            meta.temperature_c,
            common_clock=meta.common_clock,
        )

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
