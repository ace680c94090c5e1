"""A rendered or recorded session as a rig in front of the simulated cameras: each placement and bar pose is a scene."""

from collections.abc import Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherecal.base.errors import InputError
from spherecal.data.session import CameraSpec
from spherecal.targets.images import read_image
from spherecal_files.read_session import read_session
from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera


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
