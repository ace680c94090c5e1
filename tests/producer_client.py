"""A client of the simulated GenTL producer on the real Harvesters and genicam, for the tests of both."""

import logging
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera, simulated_cameras
from tests.built_producer import built_producer

pytest.importorskip("harvesters", reason="harvesters is not installed: pip install spherecal[cameras]")
gentl = pytest.importorskip("genicam.gentl", reason="genicam is not installed: pip install spherecal[cameras]")

SMALL = (320, 240)


@pytest.fixture(name="cti", scope="session")
def built_cti() -> Path:
    """The producer, or a skip where there is no compiler."""
    return built_producer()


@dataclass
class Client:
    """A Harvesters client of the simulated cameras, with the care genicam needs at the end."""

    harvester: Any
    opened: list[Any] = field(default_factory=list)

    @property
    def serials(self) -> list[str]:
        return [about.serial_number for about in self.harvester.device_info_list]

    def open(self, serial: str, trigger: str | None = None) -> Any:
        camera = self.harvester.create({"serial_number": serial})
        self.opened.append(camera)
        camera.timeout_period_on_update_event_data_call = 5
        if trigger is not None:
            nodes = camera.remote_device.node_map
            nodes.TriggerMode.value, nodes.TriggerSource.value = "On", trigger
            nodes.ExposureTime.value = 1000
        return camera

    def close(self, camera: Any) -> None:
        for _ in range(2):  # the first attempt fails where the camera is lost
            try:
                camera.destroy()
            except gentl.GenericException:
                continue
        self.opened.remove(camera)


@pytest.fixture(name="rig")
def small_rig(cti: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[ProducerControl, Client]]:
    """Four small cameras and a client."""
    with connected(cti, monkeypatch, [SimulatedCamera(s, *SMALL) for s in ("A1", "A2", "B1", "B2")]) as both:
        yield both


@pytest.fixture(name="big_rig")
def large_rig(cti: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[ProducerControl, Client]]:
    """Twelve cameras of five megapixels and a client."""
    with connected(cti, monkeypatch, simulated_cameras()) as both:
        yield both


@contextmanager
def connected(cti: Path, monkeypatch: pytest.MonkeyPatch, cameras: Any) -> Iterator[tuple[ProducerControl, Client]]:
    with ProducerControl(cameras) as rig:
        monkeypatch.setenv("SPHERECAL_GENTL_REGION", rig.name)
        client = new_client(cti)
        try:
            yield rig, client
        finally:
            end(client)
    assert not Path("/dev/shm", rig.name).exists()


def new_client(cti: Path) -> Client:
    from harvesters.core import Harvester

    logging.getLogger("harvesters").setLevel(logging.CRITICAL)  # it logs each provoked fault with a traceback
    harvester = Harvester()
    harvester.add_file(str(cti), check_existence=True, check_validity=True)
    harvester.update()
    return Client(harvester)


def end(client: Client) -> None:
    for camera in list(client.opened):
        client.close(camera)
    client.harvester.reset()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # Harvesters takes it over


def picture(camera: Any, timeout: float = 2.0) -> tuple[np.ndarray, int, int]:
    """The next frame: pixels with their padding, frame number, time stamp in ns."""
    with camera.fetch(timeout=timeout) as buffer:
        part = buffer.payload.components[0]
        pixels = part.data.reshape(part.height, -1).copy()
        return pixels, buffer._module.frame_id, buffer.timestamp_ns


def shoot(camera: Any, timeout: float = 2.0) -> tuple[np.ndarray, int, int]:
    """The frame of a software trigger."""
    camera.remote_device.node_map.TriggerSoftware.execute()
    return picture(camera, timeout)


def noise(seed: int, size: tuple[int, int] = SMALL, bits: int = 8) -> np.ndarray:
    """A picture in which no two pixels are alike but by chance."""
    kind = np.uint8 if bits == 8 else np.uint16
    return np.random.default_rng(seed).integers(0, 2**bits, (size[1], size[0]), dtype=kind)
