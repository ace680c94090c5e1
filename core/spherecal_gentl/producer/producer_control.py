"""Steering the simulated cameras: their pictures, their faults, and what they have counted."""

import os
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from spherecal.base.errors import InputError, OutputError
from spherecal.data.session import CameraSpec
from spherecal.targets.images import read_image
from spherecal_files.read_session import read_session
from spherecal_gentl.producer import region as layout
from spherecal_gentl.producer.region import REGION_VARIABLE, SharedRegion, attach, create, default_name

# GenTL's error codes that faults are made of. genicam takes a code outside -1001..-1022 for success and goes on with
# whatever lay in its memory: a register reads as nonsense, a frame has a buffer that does not exist.
ERROR, RESOURCE_IN_USE, ACCESS_DENIED, IO_ERROR, TIMEOUT, ABORT = -1001, -1004, -1005, -1010, -1011, -1012
NOT_AVAILABLE, INVALID_VALUE, UNKNOWN_CODE = -1014, -1019, -1999


@dataclass(frozen=True)
class SimulatedCamera:
    """One simulated camera; `source_bits` says how many bits its pictures have (8: uint8, up to 16: uint16)."""

    serial: str
    width: int = 2448
    height: int = 2048
    source_bits: int = 8
    user_id: str = ""
    model: str = "Simulated 5M"


def simulated_cameras(count: int = 12) -> tuple[SimulatedCamera, ...]:
    """Five-megapixel cameras SIM01, SIM02, ..."""
    return tuple(SimulatedCamera(f"SIM{i + 1:02d}") for i in range(count))


class ProducerControl(AbstractContextManager["ProducerControl"]):
    """The simulated cameras' rig: makes their shared memory, and removes it, with them, when closed."""

    def __init__(self, cameras: Sequence[SimulatedCamera] = (), name: str | None = None) -> None:
        cameras = cameras or simulated_cameras()
        _check(cameras)
        slot = max(c.width * c.height * (1 if c.source_bits == 8 else 2) for c in cameras)
        slot = -(-slot // layout.PAGE) * layout.PAGE
        self._region = create(
            name or f"spherecal-gentl-{os.getpid()}-{time.monotonic_ns() % 10**6}", len(cameras), slot
        )
        for record, camera in zip(self._region.devices, cameras, strict=True):
            record["serial"], record["model"] = camera.serial.encode(), camera.model.encode()
            record["user_id"] = camera.user_id.encode()
            record["sensor_width"], record["sensor_height"] = camera.width, camera.height
            record["source_bits"], record["temperature_c"] = camera.source_bits, 41.5
        self._index = {camera.serial: i for i, camera in enumerate(cameras)}

    @classmethod
    def attached(cls, name: str | None = None) -> Self:
        """Steer the simulated cameras of another program, by default of `cameras simulate-producer`."""
        control = cls.__new__(cls)
        control._region = attach(name or default_name())
        control._index = {record["serial"].decode(): i for i, record in enumerate(control._region.devices)}
        control._owner = False
        return control

    _region: SharedRegion
    _owner = True

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switch the rig off: clients see every camera lost, and the shared memory is freed when the last closes it."""
        if self._owner:
            for serial in self.serials:
                self.unplug(serial)
        self._index = {}
        self._region.close()

    @property
    def name(self) -> str:
        """The name of the shared memory region."""
        return self._region.name

    @property
    def environment(self) -> dict[str, str]:
        """The variables that lead a program to these cameras: this region, and the folder of the built producer."""
        from spherecal_gentl.producer.build_producer import DISCOVERY_VARIABLE, build_producer

        return {REGION_VARIABLE: self.name, DISCOVERY_VARIABLE: str(build_producer().parent)}

    @property
    def serials(self) -> tuple[str, ...]:
        """The simulated cameras' serial numbers, in the order in which they are listed."""
        return tuple(self._index)

    # ---- pictures ----

    def set_image(self, serial: str, image: NDArray[Any]) -> int:
        """Set what a camera sees, (height, width), from its next exposure on; the image's number from 1."""
        record, index = self._record(serial), self._index[serial]
        shape = int(record["sensor_height"]), int(record["sensor_width"])
        kind = np.uint8 if int(record["source_bits"]) == 8 else np.uint16
        if image.shape != shape or image.dtype != kind:
            raise InputError(
                f"Camera {serial} shows images of {shape[1]} x {shape[0]} as {kind.__name__}; this one is "
                f"{' x '.join(str(n) for n in reversed(image.shape))} as {image.dtype}."
            )
        _check_room(image.nbytes)
        number = int(record["image_begun"]) + 1
        record["image_begun"] = number  # from here on a camera that still reads the older one in this slot starts over
        self._region.slot(index, number)[: image.nbytes] = np.ascontiguousarray(image).view(np.uint8).ravel()
        record["image_published"] = number
        return number

    def set_images(self, images: Mapping[str, NDArray[Any]]) -> None:
        """Set what several cameras see, by serial number; the others keep theirs."""
        for serial, image in images.items():
            self.set_image(serial, image)

    # ---- the world around the cameras ----

    def pulse(self) -> None:
        """One rising edge on the wire to Line1 of every camera."""
        header = self._region.header
        header["line_pulse_ns"] = time.monotonic_ns()
        header["line_pulses"] += 1

    def set(self, serial: str, **fields: float) -> None:
        """Set fields of a camera's record (region.h), of its world or its faults; a `_count` of -1 is for ever."""
        record = self._record(serial)
        for name, value in fields.items():
            record[name] = value

    # ---- faults ----

    def unplug(self, serial: str) -> None:
        """Pull the cable: handles that are open never work again, the camera is gone until `plug`."""
        _unplug(self._record(serial), layout.FOR_EVER)

    def plug(self, serial: str) -> None:
        """Put the cable back."""
        self._record(serial)["unplugged_until_ns"] = 0

    def power_cycle(self, serial: str, seconds: float = 1.0) -> None:
        """The camera is gone for some time and comes back with its start-up settings."""
        record = self._record(serial)
        _unplug(record, time.monotonic_ns() + round(seconds * 1e9))
        record["powered"] = 0

    def clear_faults(self, serial: str | None = None) -> None:
        """Everything works again, cables included; of all cameras if none is named."""
        for one in self.serials if serial is None else (serial,):
            record = self._record(one)
            for field in _FAULTS:
                record[field] = 0

    # ---- what happened ----

    def counters(self, serial: str) -> layout.Counters:
        """What a camera has counted since its region was made."""
        record = self._record(serial)
        return layout.Counters(*(int(record[name]) for name in layout.Counters._fields))

    def settings(self, serial: str) -> dict[str, int | float | str]:
        """The present values of a camera's registers, by name (all zero before its first opening)."""
        registers = self._record(serial)["registers"]
        values = {name: registers[name].item() for name in layout.REGISTERS.names or ()}
        return {name: v.decode() if isinstance(v, bytes) else v for name, v in values.items()}

    def open_by(self, serial: str) -> int | None:
        """The id of the process that has the camera open, None for none; one that was killed stays named."""
        return int(self._record(serial)["open_by_pid"]) or None

    def _record(self, serial: str) -> Any:
        if serial not in self._index:
            raise InputError(f"There is no simulated camera {serial}; there are {', '.join(self._index)}.")
        return self._region.devices[self._index[serial]]


_FAULTS = (
    "unplugged_until_ns", "open_error", "read_error_count", "write_error_count", "port_delay_us", "event_error_count",
    "incomplete_count", "dropped_trigger_count", "lost_frame_count", "late_count", "padding_bytes", "crash_count",
)  # fmt: skip


def _unplug(record: Any, until_ns: int) -> None:
    record["plug_generation"] += 1
    record["unplugged_until_ns"] = until_ns


def _check(cameras: Iterable[SimulatedCamera]) -> None:
    cameras = list(cameras)
    serials = [camera.serial for camera in cameras]
    if len(cameras) > layout.MOST_DEVICES:
        raise InputError(f"At most {layout.MOST_DEVICES} cameras can be simulated, not {len(cameras)}.")
    if len(set(serials)) < len(serials):
        raise InputError("Two simulated cameras have the same serial number.")
    for camera in cameras:
        if not camera.serial.isascii() or not 0 < len(camera.serial) < 32:
            raise InputError(f"The serial number {camera.serial!r} is not of 1 to 31 plain characters.")
        if len(camera.user_id.encode()) > 63 or len(camera.model.encode()) > 31:
            raise InputError(f"The name or model of camera {camera.serial} is too long.")
        if not 8 <= camera.source_bits <= 16:
            raise InputError(f"Camera {camera.serial}: pictures have 8 to 16 bits, not {camera.source_bits}.")
        if camera.width < 64 or camera.height < 64 or camera.width % 4 or camera.height % 2:
            raise InputError(
                f"Camera {camera.serial}: {camera.width} x {camera.height} is no sensor that can be simulated.",
                "Width in steps of 4, height in steps of 2, 64 at least.",
            )


def _check_room(needed: int) -> None:
    """Writing where the memory file system is full would end the process without a word."""
    if not os.path.isdir("/dev/shm"):
        return
    about = os.statvfs("/dev/shm")
    if about.f_bavail * about.f_frsize < needed:
        raise OutputError(
            "The shared memory of this machine (/dev/shm) is full.",
            "Give it more room (a container: --shm-size=1g), or simulate fewer cameras.",
        )


class SessionScenes:
    """What the cameras of a session folder see in each placement, then each bar pose, by its name."""

    def __init__(self, session_folder: Path) -> None:
        session = read_session(session_folder)
        self._images = {scene.id: scene.images for scene in (*session.placements, *session.bar_poses) if scene.images}
        if not self._images:
            raise InputError(f"{session_folder} has no images to show.", "Take or render a session with images.")
        self.names = tuple(self._images)
        self.cameras = {serial_of(camera): camera for camera in session.cameras}
        self.bits = {
            serial: _bits([images[camera.id] for images in self._images.values() if camera.id in images])
            for serial, camera in self.cameras.items()
        }

    def images(self, scene: str) -> dict[str, NDArray[Any]]:
        """What each camera sees, by serial number, (height, width); black where it has no image."""
        if scene not in self._images:
            raise InputError(f"There is no scene {scene!r}; there are {', '.join(self._images)}.")
        return {serial: self._image(scene, serial) for serial in self.cameras}

    def _image(self, scene: str, serial: str) -> NDArray[Any]:
        camera, kind = self.cameras[serial], np.uint8 if self.bits[serial] == 8 else np.uint16
        width, height = camera.image_size
        if (path := self._images[scene].get(camera.id)) is None:
            return np.zeros((height, width), kind)
        image = read_image(path)
        if image.shape != (height, width) or image.dtype != kind:
            raise InputError(
                f"{path} is {image.shape[1]} x {image.shape[0]} px as {image.dtype}; the session and the camera's "
                f"other images say {width} x {height} as {kind.__name__}."
            )
        return image


class RigFeed(AbstractContextManager["RigFeed"]):
    """One simulated camera for each of a session, by serial number or id; `control` steers them, `scenes` names all."""

    def __init__(
        self, session_folder: Path, name: str | None = None, scene: str | None = None, running: bool = False
    ) -> None:
        self._scenes = SessionScenes(session_folder)
        self.scenes, self.scene = self._scenes.names, ""
        if running:
            self.control = ProducerControl.attached(name)
        else:
            self.control = ProducerControl([self._simulated(serial) for serial in self._scenes.cameras], name)
        try:
            self.show(self.scenes[0] if scene is None else scene)
        except BaseException:
            self.close()
            raise

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switch the rig off; simulated cameras of another program stay."""
        self.control.close()

    def show(self, scene: str) -> None:
        """Let every camera see this scene from its next exposure on, all at once; black where it has none."""
        self.control.set_images(self._scenes.images(scene))
        self.scene = scene

    def _simulated(self, serial: str) -> SimulatedCamera:
        camera = self._scenes.cameras[serial]
        width, height = camera.image_size
        return SimulatedCamera(
            serial, width, height, self._scenes.bits[serial], camera.id, (camera.model or "Simulated")[:31]
        )


def serial_of(camera: CameraSpec) -> str:
    """The serial number that a camera of a session has when it is simulated: its own, else its id."""
    return camera.serial or camera.id


def _bits(paths: Iterable[Path]) -> int:
    """How many bits a camera's images have: 16-bit files are taken for 12-bit recordings as long as they fit."""
    largest = 0
    for path in paths:
        image = read_image(path)
        if image.dtype == np.uint8:
            return 8
        largest = max(largest, int(image.max()))
    return 8 if largest == 0 else 12 if largest < 4096 else 16
