"""Sources of cameras by name: GenICam, simulated, or a recorded session replayed."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.plugins import CAMERA_SOURCES, load, names
from spherecal.targets.images import read_image
from spherecal_cameras.in_process import InProcessSource, NoImage
from spherecal_cameras.protocol import CameraInfo, CameraSettings, CameraSource, Frame, GreyPixels, SourceKind
from spherecal_files.read_session import read_session

if TYPE_CHECKING:
    from spherecal_cameras.genicam.trust import Ask


_KEPT = 32  # decoded images


class ReplaySource(InProcessSource):
    """The cameras of a session folder with images; settings of exposure and gain have no effect on recorded images."""

    kind: SourceKind = "replay"

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.session = read_session(folder)
        self.label = f"REPLAY of {folder}: recorded images, no live cameras"
        self._images = {place.id: place.images for place in (*self.session.placements, *self.session.bar_poses)}
        self._images = {pose: images for pose, images in self._images.items() if images}
        if not self._images:
            raise InputError(Phrase("error-nothing-to-replay", {"folder": folder}))
        self.poses = tuple(self._images)
        self.shown = self.poses[0]
        self._ids = {camera.serial or camera.id: camera for camera in self.session.cameras}
        self._cache: dict[Path, GreyPixels] = {}

    def show(self, pose: str) -> None:
        """Show the images of another placement or bar pose, by its id."""
        if pose not in self._images:
            raise InputError(Phrase("error-no-recorded-pose", {"pose": repr(pose), "names": list(self._images)}))
        self.shown = pose

    def camera_infos(self) -> tuple[CameraInfo, ...]:
        """The session's cameras; one without a serial number goes by its id."""
        return tuple(
            CameraInfo(
                serial,
                camera.model or "",
                "",
                str(self.session.folder),
                "replay",
                camera.id,
                camera.id,
                image_size=camera.image_size,
                access="free",
            )
            for serial, camera in self._ids.items()
        )

    def take_image(self, serial: str, settings: CameraSettings, number: int, attempt: int, timeout_s: float) -> Frame:
        """The recorded image, cut to the settings' region."""
        pose = self.shown
        path = self._images[pose].get(self._ids[serial].id)
        if path is None:
            raise NoImage(f"The recording of {pose} has no image of it.", "Choose another placement.")
        image = self._cache.get(path)
        if image is None:
            image = read_image(path)
            image.flags.writeable = False
            with self._lock:
                while len(self._cache) >= _KEPT:
                    self._cache.pop(next(iter(self._cache)))
                self._cache[path] = image
        if settings.region is not None:
            r = settings.region
            image = image[r.y : r.y + r.height, r.x : r.x + r.width]
        bits = 8 if image.dtype == np.uint8 else 16
        now = time.perf_counter()
        return Frame(serial, image, bits, f"Mono{bits}", now, now, self.next_frame_id(serial), self.stamp_ns())


_OWN = ("genicam", "replay", "simulated")


def open_source(
    name: str, producers: Sequence[str] = (), faults: Sequence[str] = (), ask: "Ask | None" = None
) -> CameraSource:
    """The source of images of this name."""
    kind, _, what = name.partition(":")
    if faults and kind != "simulated":
        raise InputError(Phrase("error-faults-simulated"))
    if kind == "genicam" and not what:
        from spherecal_cameras.genicam.genicam_source import GenicamSource

        return GenicamSource(producers, ask=ask)
    if kind == "replay" and what:
        return ReplaySource(Path(what))
    if kind == "simulated":
        from spherecal_cameras.simulated.simulated_source import SimulatedSource, parse_fault

        return SimulatedSource(what or "demo", faults=[parse_fault(text) for text in faults])
    made = load(CAMERA_SOURCES, kind) if kind not in _OWN else None
    if made is not None:
        source = made(what)
        if not isinstance(source, CameraSource):
            raise InputError(Phrase("error-source-protocol", {"kind": repr(kind)}))
        return source
    others = ", ".join(one for one in names(CAMERA_SOURCES) if one not in _OWN)
    raise InputError(
        Phrase("error-no-source", {"name": repr(name)}),
        Phrase("error-sources-installed", {"others": others}) if others else Phrase("error-sources"),
    )
