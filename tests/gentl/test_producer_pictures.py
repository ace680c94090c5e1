"""Pictures, triggers and time of the simulated cameras, value by value."""

import time
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.errors import InputError
from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera
from tests.producer_client import (  # noqa: F401 (fixtures)
    SMALL,
    Client,
    built_cti,
    connected,
    gentl,
    large_rig,
    noise,
    picture,
    shoot,
    small_rig,
)

FORMATS = {"Mono8": 8, "BayerRG8": 8, "Mono10": 10, "Mono10p": 10, "Mono12": 12, "Mono12p": 12, "Mono12Packed": 12}


# ---- pictures ----


def test_sets_of_twelve_cameras_of_five_megapixels(big_rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = big_rig
    base = noise(1, (2448, 2048))
    seen = {serial: np.roll(base, 31 * i, axis=1) for i, serial in enumerate(simulated.serials)}
    simulated.set_images(seen)
    cameras = {serial: client.open(serial, "Software") for serial in simulated.serials}
    for camera in cameras.values():
        camera.start()
    stamps: dict[str, list[int]] = {serial: [] for serial in cameras}
    for number in range(1, 4):
        for camera in cameras.values():
            camera.remote_device.node_map.TriggerSoftware.execute()
        for serial, camera in cameras.items():
            pixels, frame, stamp = picture(camera)
            assert np.array_equal(pixels, seen[serial])
            assert frame == number
            stamps[serial].append(stamp)
    assert all(np.all(np.diff(one) > 0) for one in stamps.values())
    assert all(simulated.counters(serial).frames_delivered == 3 for serial in cameras)


@pytest.mark.parametrize("source_bits", [8, 10, 12, 16])
def test_every_pixel_format_is_exact(cti: Path, monkeypatch: pytest.MonkeyPatch, source_bits: int) -> None:
    with connected(cti, monkeypatch, [SimulatedCamera("X", *SMALL, source_bits)]) as (rig, client):
        image = noise(source_bits, bits=source_bits)
        rig.set_image("X", image)
        camera = client.open("X", "Software")
        nodes = camera.remote_device.node_map
        nodes.Width.value, nodes.Height.value, nodes.OffsetX.value, nodes.OffsetY.value = 200, 100, 36, 42
        window = image[42:142, 36:236].astype(np.uint32) << (16 - source_bits)
        for name, bits in FORMATS.items():
            nodes.PixelFormat.value = name
            camera.start()
            pixels, _, _ = shoot(camera)
            camera.stop()
            assert np.array_equal(pixels, window >> (16 - bits)), name


@pytest.mark.parametrize(("name", "padding", "columns"), [("Mono8", 5, 5), ("Mono12", 8, 4), ("Mono12p", 6, 4)])
def test_padded_lines(rig: tuple[ProducerControl, Client], name: str, padding: int, columns: int) -> None:
    simulated, client = rig
    image = noise(7)
    simulated.set_image("B1", image)
    simulated.set("B1", padding_bytes=padding)
    camera = client.open("B1", "Software")
    camera.remote_device.node_map.PixelFormat.value = name
    camera.start()
    pixels, _, _ = shoot(camera)
    assert pixels.shape == (SMALL[1], SMALL[0] + columns)
    assert np.array_equal(pixels[:, : SMALL[0]], image.astype(np.uint16) << (FORMATS[name] - 8))
    assert not pixels[:, SMALL[0] :].any()


def test_pictures_change_between_frames_never_within_one(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    camera = client.open("A1")
    nodes = camera.remote_device.node_map
    nodes.ExposureTime.value = 10
    simulated.set_image("A1", np.zeros(SMALL[::-1], np.uint8))
    camera.start()
    shown = set()
    for number in range(120):
        simulated.set_image("A1", np.full(SMALL[::-1], number, np.uint8))
        pixels, _, _ = picture(camera)
        assert pixels.min() == pixels.max()
        shown.add(int(pixels[0, 0]))
    assert len(shown) > 30


def test_exposure_and_gain_change_the_brightness_where_asked(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    simulated.set_image("A1", np.full(SMALL[::-1], 100, np.uint8))
    camera = client.open("A1", "Software")
    nodes = camera.remote_device.node_map
    camera.start()
    assert shoot(camera)[0].max() == 100
    simulated.set("A1", exposure_reference_us=2000)
    assert shoot(camera)[0].max() == 50
    nodes.Gain.value = 20
    assert shoot(camera)[0].min() == 255
    simulated.set("A1", image_published=0)
    simulated.set("A1", exposure_reference_us=0)
    assert len(np.unique(shoot(camera)[0][100:])) == 256


def test_wrong_pictures_are_refused(rig: tuple[ProducerControl, Client]) -> None:
    simulated, _ = rig
    with pytest.raises(InputError, match="320 x 240 as uint8; this one is 240 x 320 as uint8"):
        simulated.set_image("A1", np.zeros((320, 240), np.uint8))
    with pytest.raises(InputError, match="as uint16"):
        simulated.set_image("A1", np.zeros((240, 320), np.uint16))
    with pytest.raises(InputError, match="no simulated camera Z; there are A1"):
        simulated.set_image("Z", np.zeros((240, 320), np.uint8))


# ---- triggers and time ----


def test_a_pulse_on_the_line_exposes_all_at_the_same_time(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    simulated.set("B2", clock_offset_ns=100_000_000_000)
    cameras = [client.open(serial, "Line1") for serial in simulated.serials]
    for camera in cameras:
        camera.start()
    for _ in range(3):
        simulated.pulse()
        stamps = [picture(camera)[2] for camera in cameras]
        assert len(set(stamps[:3])) == 1
        assert stamps[3] - stamps[0] == 100_000_000_000
    nodes = cameras[3].remote_device.node_map
    nodes.TimestampLatch.execute()
    assert abs(nodes.TimestampLatchValue.value - time.monotonic_ns() - 100e9) < 1e9


def test_frame_numbers_and_times_of_free_running_cameras(rig: tuple[ProducerControl, Client]) -> None:
    _, client = rig
    camera = client.open("A1")
    nodes = camera.remote_device.node_map
    nodes.AcquisitionFrameRateEnable.value, nodes.AcquisitionFrameRate.value = True, 50
    for _ in range(2):
        camera.start()
        frames = [picture(camera)[1:] for _ in range(8)]
        camera.stop()
        numbers, stamps = np.transpose(frames)
        assert numbers[0] == 1
        assert np.all(np.diff(numbers) >= 1)
        periods = np.diff(stamps) / np.diff(numbers)
        assert np.all(np.diff(stamps) > 0)
        assert np.median(periods) == pytest.approx(20e6, rel=0.02)


def test_single_frame_and_triggers_that_come_too_early(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    camera = client.open("A1", "Software")
    nodes = camera.remote_device.node_map
    nodes.ExposureTime.value = 50_000
    camera.start()
    for _ in range(3):
        nodes.TriggerSoftware.execute()
    picture(camera)
    with pytest.raises(gentl.TimeoutException):
        picture(camera, 0.1)
    assert simulated.counters("A1").triggers_missed == 2
    camera.stop()
    nodes.TriggerMode.value, nodes.AcquisitionMode.value = "Off", "SingleFrame"
    camera.start()
    picture(camera)
    time.sleep(0.15)
    assert camera.data_streams[0].num_awaiting_delivery == 0
    assert simulated.counters("A1").frames_exposed == 2


def test_buffers_not_given_back_are_counted_as_underrun(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    camera = client.open("A1")
    camera.remote_device.node_map.ExposureTime.value = 1000
    camera.start()
    deadline = time.monotonic() + 2
    while simulated.counters("A1").frames_underrun == 0 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert camera.data_streams[0].num_underrun > 0
    assert camera.data_streams[0].num_awaiting_delivery == camera.num_buffers
