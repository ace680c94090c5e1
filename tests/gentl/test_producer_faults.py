"""Every fault of the simulated cameras as a client on Harvesters and genicam sees it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from spherecal.base.errors import InputError
from spherecal_gentl.producer import producer_control as control
from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera
from spherecal_gentl.producer.region import ANY_ADDRESS
from tests.producer_client import SMALL, Client, built_cti, end, gentl, new_client, noise, picture, shoot, small_rig  # noqa: F401 (fixtures)

TEMPERATURE = 0x210  # its register in device.xml


def test_unplugged_and_back_while_the_others_go_on(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    lost, other = client.open("A1", "Software"), client.open("A2", "Software")
    lost.start()
    other.start()
    shoot(lost)
    simulated.unplug("A1")
    assert lost.device.module.access_status == 3
    with pytest.raises(gentl.IoException):
        _ = lost.remote_device.node_map.DeviceTemperature.value
    shoot(other)
    simulated.plug("A1")
    assert lost.device.module.access_status == 3  # the old connection stays dead
    with pytest.raises(gentl.IoException):
        lost.stop()
    client.close(lost)
    again = client.open("A1", "Software")
    again.start()
    shoot(again)
    assert shoot(other)[1] == 2


def test_an_unplugged_camera_leaves_the_list_and_cannot_be_opened(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    simulated.unplug("A2")
    with pytest.raises(gentl.NotAvailableException):
        client.open("A2")
    interface = client.harvester._ifaces[0]
    interface.update_device_info_list(100)
    assert [one.serial_number for one in interface.device_info_list] == ["A1", "B1", "B2"]
    simulated.plug("A2")
    interface.update_device_info_list(100)
    assert [one.serial_number for one in interface.device_info_list] == ["A1", "A2", "B1", "B2"]


def test_device_reset_brings_the_camera_back_with_its_settings_gone(rig: tuple[ProducerControl, Client]) -> None:
    _, client = rig
    camera = client.open("A1", "Software")
    camera.remote_device.node_map.DeviceReset.execute()
    assert camera.device.module.access_status == 3
    client.close(camera)
    with pytest.raises(gentl.NotAvailableException):
        client.open("A1")
    time.sleep(1.05)
    assert client.open("A1").remote_device.node_map.TriggerMode.value == "Off"


@pytest.mark.parametrize(
    ("code", "kind", "status"),
    [
        (control.ACCESS_DENIED, "AccessDeniedException", 4),
        (control.RESOURCE_IN_USE, "ResourceInUseException", 4),
        (control.NOT_AVAILABLE, "NotAvailableException", 3),
    ],
)
def test_a_camera_held_by_another_program(
    rig: tuple[ProducerControl, Client], code: int, kind: str, status: int
) -> None:
    simulated, client = rig
    simulated.set("B1", open_error=code)
    (about,) = [one for one in client.harvester.device_info_list if one.serial_number == "B1"]
    assert about.access_status == status
    with pytest.raises(getattr(gentl, kind)):
        client.open("B1")
    simulated.clear_faults("B1")
    client.open("B1")


def test_register_errors_of_one_feature_or_all(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    nodes = client.open("A1").remote_device.node_map
    simulated.set("A1", read_error=control.IO_ERROR, read_error_address=TEMPERATURE, read_error_count=2)
    assert nodes.ExposureTime.value == 10000
    for _ in range(2):
        with pytest.raises(gentl.IoException):
            _ = nodes.DeviceTemperature.value
    assert nodes.DeviceTemperature.value == 41.5
    simulated.set("A1", write_error=control.ACCESS_DENIED, write_error_address=ANY_ADDRESS, write_error_count=-1)
    for _ in range(3):
        with pytest.raises(gentl.AccessDeniedException):
            nodes.Gain.value = 3
    simulated.clear_faults()
    nodes.Gain.value = 3
    assert nodes.Gain.value == 3


def test_unknown_error_codes_pass_for_success_in_genicam(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    camera = client.open("A1", "Software")
    nodes = camera.remote_device.node_map
    simulated.set("A1", read_error=control.UNKNOWN_CODE, read_error_address=TEMPERATURE, read_error_count=1)
    _ = nodes.DeviceTemperature.value  # any number at all
    assert simulated.counters("A1").reads > 0
    assert nodes.DeviceTemperature.value == 41.5
    camera.start()
    simulated.set("A1", event_error=control.UNKNOWN_CODE, event_error_count=1)
    with pytest.raises(gentl.GenericException, match="not announced"):
        picture(camera)
    shoot(camera)


def test_slow_registers(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    nodes = client.open("A1").remote_device.node_map
    simulated.set("A1", port_delay_us=200_000)
    began = time.monotonic()
    _ = nodes.DeviceTemperature.value
    assert 0.2 <= time.monotonic() - began < 0.4


@pytest.mark.parametrize(
    ("code", "kind"),
    [(-1010, "IoException"), (-1005, "AccessDeniedException"), (-1012, "AbortException"), (-1001, "ErrorException")],
)
def test_errors_of_the_stream(rig: tuple[ProducerControl, Client], code: int, kind: str) -> None:
    simulated, client = rig
    camera = client.open("A1", "Software")
    camera.start()
    simulated.set("A1", event_error=code, event_error_count=1)
    with pytest.raises(getattr(gentl, kind)):
        picture(camera)
    shoot(camera)


def test_incomplete_frames_are_seen_and_pass(rig: tuple[ProducerControl, Client]) -> None:
    from harvesters.core import Callback, ImageAcquirer

    class Count(Callback):
        seen = 0

        def emit(self, context: Any = None) -> None:
            self.seen += 1

    simulated, client = rig
    camera, spoilt = client.open("A1", "Software"), Count()
    camera.add_callback(ImageAcquirer.Events.INCOMPLETE_BUFFER, spoilt)
    camera.start()
    simulated.set("A1", incomplete_count=2)
    for _ in range(2):
        camera.remote_device.node_map.TriggerSoftware.execute()
        assert camera.try_fetch(timeout=0.2) is None
    assert shoot(camera)[1] == 3
    assert spoilt.seen == simulated.counters("A1").frames_incomplete == 2


def test_a_trigger_dropped_leaves_no_gap_and_a_frame_lost_leaves_one(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    camera = client.open("A1", "Software")
    camera.start()
    shoot(camera)
    simulated.set("A1", dropped_trigger_count=1)
    with pytest.raises(gentl.TimeoutException):
        shoot(camera, 0.1)
    assert shoot(camera)[1] == 2
    simulated.set("A1", lost_frame_count=1)
    with pytest.raises(gentl.TimeoutException):
        shoot(camera, 0.1)
    assert shoot(camera)[1] == 4
    counted = simulated.counters("A1")
    assert (counted.triggers, counted.triggers_dropped, counted.frames_lost) == (5, 1, 1)


def test_a_late_frame_comes_in_order_with_the_time_of_its_exposure(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    camera = client.open("A1", "Software")
    nodes = camera.remote_device.node_map
    camera.start()
    simulated.set("A1", late_ms=300, late_count=1)
    asked = time.monotonic_ns()
    nodes.TriggerSoftware.execute()
    with pytest.raises(gentl.TimeoutException):
        picture(camera, 0.1)
    nodes.TriggerSoftware.execute()  # of the next round
    (_, first, stamp), (_, second, _) = picture(camera), picture(camera)
    assert (first, second) == (1, 2)
    assert 0 <= stamp - asked < 50e6
    assert time.monotonic_ns() - asked >= 300e6


def test_a_slow_link_takes_its_time(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    camera = client.open("A1", "Software")
    simulated.set("A1", link_bytes_per_s=SMALL[0] * SMALL[1] / 0.1)
    camera.start()
    began = time.monotonic()
    shoot(camera)
    assert 0.1 <= time.monotonic() - began < 0.3
    assert camera.remote_device.node_map.AcquisitionResultingFrameRate.value == pytest.approx(10)


def test_closing_the_rig_is_losing_every_camera(cti: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulated = ProducerControl([SimulatedCamera("A1", *SMALL)])
    monkeypatch.setenv("SPHERECAL_GENTL_REGION", simulated.name)
    client = new_client(cti)
    try:
        camera = client.open("A1", "Software")
        camera.start()
        shoot(camera)
        simulated.close()
        with pytest.raises(gentl.IoException):
            camera.remote_device.node_map.TriggerSoftware.execute()
    finally:
        end(client)


# ---- other processes ----

_CHILD = """
import os, signal, sys, time
from pathlib import Path
import numpy as np
from harvesters.core import Harvester
from spherecal_gentl.producer.producer_control import ProducerControl
harvester = Harvester()
folder = Path(os.environ["GENICAM_GENTL64_PATH"])
(cti,) = folder.glob("*.cti")
harvester.add_file(str(cti))
harvester.update()
camera = harvester.create({"serial_number": "A1"})
camera.remote_device.node_map.TriggerMode.value = "On"
camera.start()
if "crash" in sys.argv:
    ProducerControl.attached(os.environ["SPHERECAL_GENTL_REGION"]).set("A1", crash_count=1)
camera.remote_device.node_map.TriggerSoftware.execute()
with camera.fetch(timeout=2) as buffer:
    print(int(buffer.payload.components[0].data.sum()), flush=True)
"""


def _run_child(rig: ProducerControl, *words: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | rig.environment
    return subprocess.run(
        [sys.executable, "-c", _CHILD, *words], env=environment, capture_output=True, text=True, timeout=60, check=False
    )


def test_another_process_sees_the_same_rig(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    image = noise(3)
    simulated.set_image("A1", image)
    done = _run_child(simulated)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == int(image.sum())
    assert simulated.counters("A1").frames_delivered == 1
    assert client.open("A1").remote_device.node_map.TriggerMode.value == "On"  # as the other one left it


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_crash_of_the_producer_ends_the_client_not_the_rig(rig: tuple[ProducerControl, Client]) -> None:
    simulated, client = rig
    assert _run_child(simulated, "crash").returncode == -signal.SIGSEGV
    camera = client.open("A1", "Software")
    camera.start()
    shoot(camera)


@pytest.mark.skipif(not os.path.isdir("/dev/shm"), reason="looks into /dev/shm")
def test_a_controller_that_is_killed_leaves_no_memory_behind(cti: Path) -> None:
    program = (
        "from spherecal_gentl.producer.producer_control import ProducerControl; import time\n"
        "control = ProducerControl(); print(control.name, flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        region = Path("/dev/shm", process.stdout.readline().strip())
        assert region.exists()
        process.kill()
        process.wait()
    deadline = time.monotonic() + 5
    while region.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not region.exists()


def test_a_name_in_use_is_refused_and_one_left_behind_is_replaced() -> None:
    name = f"spherecal-test-{os.getpid()}"
    first = ProducerControl([SimulatedCamera("A1", *SMALL)], name)
    with pytest.raises(InputError, match="running already"):
        ProducerControl([SimulatedCamera("A1", *SMALL)], name)
    other = ProducerControl.attached(name)
    assert other.serials == ("A1",)
    other.close()
    done = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True)
    first._region.header["owner_pid"] = int(done.stdout)  # a process that has ended
    with ProducerControl([SimulatedCamera("B1", *SMALL)], name) as second:
        assert second.serials == ("B1",)
    first.close()
    with pytest.raises(InputError, match="no simulated cameras named"):
        ProducerControl.attached(name)
