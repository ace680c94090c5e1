"""The simulated GenTL producer: built here, found and opened through the real Harvesters and genicam."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.errors import InputError, OutputError
from spherecal_gentl.producer import build_producer as build
from spherecal_gentl.producer.build_producer import build_producer, compile_command
from spherecal_gentl.producer.producer_control import (
    ProducerControl,
    SimulatedCamera,
    simulated_cameras,
)
from spherecal_gentl.producer.region import attach
from tests.producer_client import SMALL, Client, built_cti, end, new_client, picture, shoot, small_rig  # noqa: F401 (fixtures)

# ---- building ----


def test_is_built_once_alone_in_its_folder_and_copied_on_demand(cti: Path, tmp_path: Path) -> None:
    assert [file.name for file in cti.parent.iterdir()] == [cti.name]
    before = cti.stat().st_mtime_ns
    copy = build_producer(tmp_path / "here")
    assert copy.read_bytes() == cti.read_bytes()
    assert cti.stat().st_mtime_ns == before


def test_without_a_compiler_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CXX", raising=False)
    with pytest.raises(InputError, match=r"g\+\+ or clang\+\+ or c\+\+ is not on this machine.*Install one"):
        build_producer()


def test_a_compiler_that_fails_is_named_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CXX", "false")
    monkeypatch.setattr(build, "cache_folder", lambda name: tmp_path)
    with pytest.raises(OutputError, match=r"cannot be built with .*false"):
        build_producer()
    assert not [file for file in tmp_path.rglob("*") if file.is_file()]


def test_the_command_for_visual_studio_makes_a_library(tmp_path: Path) -> None:
    command = compile_command("C:/VS/cl.exe", Path("p.cpp"), tmp_path, Path("p.cti"))
    assert "/LD" in command
    assert "/std:c++17" in command
    assert not any(word.startswith("-") for word in command)


# ---- finding and opening ----


def test_without_a_region_there_are_twelve_cameras_with_a_moving_pattern(
    cti: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPHERECAL_GENTL_REGION", "-")
    client = new_client(cti)
    try:
        assert client.serials == [f"SIM{i:02d}" for i in range(1, 13)]
        camera = client.open("SIM12")
        camera.start()
        for _ in range(3):
            pixels, frame, _ = picture(camera)
            bits = sum(1 << i for i in range(32) if pixels[4, 8 * i + 4] == 255)
            assert bits == frame
            ramp = np.add.outer(np.arange(pixels.shape[0]), np.arange(pixels.shape[1])) + 4 * frame
            assert np.array_equal(pixels[100:], ramp[100:] % 256)
    finally:
        end(client)


def test_an_unknown_region_shows_no_cameras(cti: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPHERECAL_GENTL_REGION", "spherecal-not-there")
    client = new_client(cti)
    assert client.serials == []
    end(client)


@pytest.mark.skipif(not hasattr(os, "chown") or os.geteuid() != 0, reason="only the administrator gives files away")
def test_a_region_of_another_user_is_left_alone(cti: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with ProducerControl([SimulatedCamera("A1", *SMALL)]) as simulated:
        monkeypatch.setenv("SPHERECAL_GENTL_REGION", simulated.name)
        client = new_client(cti)
        assert client.serials == ["A1"]
        end(client)
        region = Path("/dev/shm", simulated.name)
        os.chown(region, 12345, -1)
        try:
            client = new_client(cti)
            assert client.serials == []
            end(client)
            with pytest.raises(InputError, match="no simulated cameras"):
                attach(simulated.name)
        finally:
            os.chown(region, os.getuid(), -1)


def test_every_register_of_the_description_answers(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    nodes = client.open("A2").remote_device.node_map
    simulated.set("A2", temperature_c=47.25)
    told = {n: getattr(nodes, n).value for n in dir(nodes) if n[0].isupper() and hasattr(getattr(nodes, n), "value")}
    assert told["DeviceSerialNumber"] == "A2"
    assert (told["SensorWidth"], told["SensorHeight"], told["PayloadSize"]) == (*SMALL, SMALL[0] * SMALL[1])
    assert told["DeviceTemperature"] == 47.25
    assert told["AcquisitionResultingFrameRate"] == 100.0  # 10 ms of exposure
    assert len(told) > 35
    nodes.DeviceUserID.value = "left of the door"
    nodes.Gain.value, nodes.ExposureTime.value = 6.5, 2500
    assert simulated.settings("A2")["user_id"] == "left of the door"
    assert (simulated.settings("A2")["gain_db"], simulated.settings("A2")["exposure_us"]) == (6.5, 2500)
    assert simulated.open_by("A2") == os.getpid()


def test_settings_outlast_closing_but_not_a_power_cycle(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    camera = client.open("A1", "Software")
    client.close(camera)
    camera = client.open("A1")
    assert camera.remote_device.node_map.TriggerMode.value == "On"
    simulated.power_cycle("A1", 0.05)
    time.sleep(0.06)
    client.close(camera)
    camera = client.open("A1")
    nodes = camera.remote_device.node_map
    assert nodes.TriggerMode.value == "Off"
    nodes.ExposureTime.value, nodes.UserSetSelector.value = 777, "UserSet1"
    nodes.UserSetSave.execute()
    nodes.UserSetDefault.value = "UserSet1"
    simulated.power_cycle("A1", 0)
    client.close(camera)
    nodes = client.open("A1").remote_device.node_map
    assert nodes.ExposureTime.value == 777
    nodes.UserSetSelector.value = "Default"
    nodes.UserSetLoad.execute()
    assert nodes.ExposureTime.value == 10000


def test_values_out_of_range_and_formats_while_streaming_are_refused(rig: tuple[ProducerControl, Client]) -> None:
    from genicam import genapi

    _, client = rig
    camera = client.open("A1", "Software")
    nodes = camera.remote_device.node_map
    with pytest.raises(genapi.GenericException):
        nodes.Width.value = SMALL[0] + 4
    with pytest.raises(genapi.GenericException):
        nodes.ExposureTime.value = 1
    camera.start()
    with pytest.raises(genapi.AccessException):
        nodes.PixelFormat.value = "Mono12"


# ---- endurance and limits ----


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks into /proc")
def test_memory_stays_flat_over_fifty_starts(rig: tuple[ProducerControl, Client]) -> None:
    _, client = rig
    camera = client.open("A1", "Software")

    def cycle() -> None:
        camera.start()
        shoot(camera)
        camera.stop()

    for _ in range(10):
        cycle()
    before, threads = _resident_kib(), set(os.listdir("/proc/self/task"))
    for _ in range(50):
        cycle()
    assert _resident_kib() - before < 4096  # measured: 0 to 300 KiB
    # none more: of the threads before, those that earlier tests left may have ended
    assert set(os.listdir("/proc/self/task")) <= threads


def _resident_kib() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


@pytest.mark.parametrize(
    ("cameras", "words"),
    [
        (simulated_cameras(17), "At most 16"),
        ([SimulatedCamera("A"), SimulatedCamera("A")], "same serial"),
        ([SimulatedCamera("A" * 32)], "1 to 31 plain characters"),
        ([SimulatedCamera("A", 321, 240)], "321 x 240 is no sensor"),
        ([SimulatedCamera("A", source_bits=7)], "8 to 16 bits"),
        ([SimulatedCamera("A", model="x" * 40)], "too long"),
    ],
)
def test_impossible_rigs_are_refused(cameras: list[SimulatedCamera], words: str) -> None:
    with pytest.raises(InputError, match=words):
        ProducerControl(cameras)
