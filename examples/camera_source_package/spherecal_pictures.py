"""`spherecal cameras list --source pictures:FOLDER`: every picture of a folder as a camera that shows it.

A source of real cameras does the same: it lists its cameras and takes an image when asked. `InProcessSource` does the
rest (live view, sets, states); what needs a process of its own implements `spherecal_cameras.protocol.CameraSource`.
"""

import time
from pathlib import Path

import spherecal
from spherecal.targets.images import read_image
from spherecal_cameras.in_process import InProcessSource
from spherecal_cameras.protocol import CameraInfo, CameraSettings, Frame, SourceKind


class PictureSource(InProcessSource):
    """The pictures of a folder, in the order of their names."""

    kind: SourceKind = "replay"  # nothing of it is live

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.label = f"PICTURES of {folder}"
        self._files = {path.stem: path for path in sorted(folder.glob("*.png"))}
        if not self._files:
            raise spherecal.InputError(f"{folder}: holds no PNG files.", "Write --source pictures:FOLDER.")

    def camera_infos(self) -> tuple[CameraInfo, ...]:
        """One for each picture, its name as serial number."""
        return tuple(CameraInfo(name, "picture", "", str(path), access="free") for name, path in self._files.items())

    def take_image(self, serial: str, settings: CameraSettings, number: int, attempt: int, timeout_s: float) -> Frame:
        """The picture; exposure and gain have no effect."""
        image, now = read_image(self._files[serial]), time.perf_counter()
        bits = 8 * image.itemsize
        return Frame(serial, image, bits, f"Mono{bits}", now, now, self.next_frame_id(serial), self.stamp_ns())


def open_pictures(what: str) -> PictureSource:
    """The source for what stands behind the colon of `--source pictures:FOLDER`."""
    return PictureSource(Path(what))
