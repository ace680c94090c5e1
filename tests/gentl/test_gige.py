"""GigE Vision cameras on a simulated wire, by the Aravis producer, through the real Harvesters and genicam."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spherecal.base.errors import InputError, OutputError
from spherecal_app.cli import producer_command as command
from spherecal_app.cli.options import make_parser
from spherecal_cameras.camera_doctor import LinkReport, TriggerReport, _judge, examine
from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.genicam.slots import LateAnswers
from spherecal_cameras.protocol import CameraSettings, CameraState, CameraStatus, CaptureRequest, Counters
from spherecal_gentl.gige import gvcp
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.producer import build_producer as build
from tests.gige_rig import SMALL, aravis_producer, wired
from tests.producer_client import Client, end, gentl, new_client, noise, picture, shoot

# Cameras answer within the driver's time, or the next time: at load 10 on two cores one or all were late.
LOOKS = 5


@pytest.fixture(name="rig", scope="module")
def three_cameras() -> Iterator[GigeRig]:
    """Three small cameras; the tests run on the rig's computer and leave every fault healed."""
    with wired(3) as rig:
        yield rig


@pytest.fixture(name="client")
def harvesters_client(rig: GigeRig) -> Iterator[Client]:
    client = new_client(aravis_producer())
    for _ in range(LOOKS):
        if sorted(client.serials) == list(rig.serials):
            break
        client.harvester.update()
    assert sorted(client.serials) == list(rig.serials)
    yield client
    end(client)


# ---- building ----


def test_without_libaravis_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match=r"need libaravis, and pkg-config is not on this machine.*libaravis-dev"):
        build.build_producer(aravis=True)


def test_both_producers_export_the_same_functions() -> None:
    files = [aravis_producer(), build.build_producer()]
    if (nm := shutil.which("nm")) is None:
        pytest.skip("nm is not on this machine")
    found = []
    for file in files:
        lines = subprocess.run(
            [nm, "-D", "--defined-only", str(file)], capture_output=True, text=True, check=True
        ).stdout
        found.append(set(re.findall(r" T (\w+)", lines)))
    assert found[0] == found[1]
    assert {"GCInitLib", "IFOpenDevice", "DSStartAcquisition", "EventGetData"} <= found[0]


@pytest.mark.parametrize(
    ("cameras", "words"),
    [
        ([GigeCamera(f"C{i}") for i in range(13)], "1 to 12"),
        ([GigeCamera("A"), GigeCamera("A")], "same serial"),
        ([GigeCamera("A" * 16)], "1 to 15 plain"),
        ([GigeCamera("A", 8, 8)], "no sensor"),
    ],
)
def test_impossible_rigs_are_refused(cameras: list[GigeCamera], words: str) -> None:
    with pytest.raises(InputError, match=words):
        GigeRig(cameras)


# ---- cameras ----


def test_a_camera_is_listed_with_its_address_and_description(rig: GigeRig, client: Client) -> None:
    camera = client.open("GE02")
    nodes = camera.remote_device.node_map
    assert (nodes.DeviceSerialNumber.value, nodes.Width.value, nodes.PayloadSize.value) == ("GE02", 320, 320 * 240)
    about = camera.device.node_map
    assert about.GevDeviceAddress.value == rig.addresses["GE02"]
    assert about.GevDeviceMACAddress.value == "02:53:43:00:00:02"
    nodes.DeviceUserID.value = "by the door"
    assert nodes.DeviceUserID.value == "by the door"


def test_pictures_arrive_pixel_by_pixel_and_by_software_trigger(rig: GigeRig, client: Client) -> None:
    camera = client.open("GE01")
    nodes = camera.remote_device.node_map
    nodes.TriggerMode.value, nodes.TriggerSource.value = "On", "Software"
    camera.start()
    last = -1
    for seed in range(3):
        image = noise(seed)
        rig.set_image("GE01", image)
        pixels, frame, stamp = shoot(camera, 5.0)
        assert np.array_equal(pixels, image)
        assert frame > last and stamp > 0
        last = frame
    with pytest.raises(gentl.TimeoutException):
        picture(camera, 0.2)


def test_starts_and_stops_leave_nothing_behind(client: Client) -> None:
    camera = client.open("GE01")
    camera.remote_device.node_map.TriggerMode.value = "Off"

    def cycle() -> None:
        camera.start()
        picture(camera, 5.0)
        camera.stop()

    cycle()
    before = len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd"))
    for _ in range(10):
        cycle()
    assert (len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd"))) == before


def test_lost_packets_make_incomplete_frames_that_are_counted(rig: GigeRig, client: Client) -> None:
    camera = client.open("GE03")
    camera.remote_device.node_map.TriggerMode.value = "Off"
    counts = camera.data_streams[0].node_map
    counts.StreamFrameRetentionMs.value = 50
    camera.start()
    picture(camera, 5.0)
    before = counts.StreamMissingPacketCount.value  # a busy machine loses some of itself
    rig.fault("burst", "GE03", 3, 40)
    try:
        until = time.monotonic() + 20.0
        while counts.StreamIncompleteFrameCount.value < 2 and time.monotonic() < until:
            camera.try_fetch(timeout=0.1)
    finally:
        rig.fault("burst", "GE03", 0, 1)
    camera.stop()  # counts of a stream that runs belong to different moments
    names = ("IncompleteFrame", "FailedFrame", "MissingFrame", "ReceivedPacket", "Underrun")
    counted = {name: getattr(counts, f"Stream{name}Count").value for name in names}
    assert counted["IncompleteFrame"] >= 2, counted
    # from the first packet that is missing to the end of the frame: of one frame 1, of the next 50
    missing, last = counts.StreamMissingPacketCount.value - before, counts.StreamLastIncompleteMissingPackets.value
    assert missing >= last + counted["IncompleteFrame"] - 1, (missing, last, counted)
    assert last > 0


def test_where_another_program_has_control_it_is_busy_but_can_be_read(rig: GigeRig, client: Client) -> None:
    rig.fault("seize", "GE02")
    try:
        interface = next(i for i in client.harvester._ifaces if i.id_ == "eth0")
        interface.update_device_info_list(1000)
        about = next(d for d in interface.device_info_list if d.serial_number == "GE02")
        assert about.access_status == 4
        device = about.create_device()
        with pytest.raises(gentl.AccessDeniedException, match="another program has control"):
            device.open(gentl.DEVICE_ACCESS_FLAGS_LIST.DEVICE_ACCESS_EXCLUSIVE)
        device.open(gentl.DEVICE_ACCESS_FLAGS_LIST.DEVICE_ACCESS_READONLY)
        try:
            port = device.remote_port
            assert int.from_bytes(port.read(0x100, 4)[1], "big") == SMALL[0]
            with pytest.raises(gentl.AccessDeniedException, match="reading only"):
                port.write(0x100, (16).to_bytes(4, "big"))
        finally:
            device.close()
    finally:
        rig.fault("release", "GE02")


# ---- faults through SphereCal's own source ----


@pytest.fixture(name="source")
def opened_source(rig: GigeRig, monkeypatch: pytest.MonkeyPatch) -> Iterator[GenicamSource]:
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(aravis_producer().parent))
    with GenicamSource() as source:
        source.open(source.discover().serials, dict.fromkeys(rig.serials, CameraSettings(exposure_us=1000.0)))
        source.capture_set()
        yield source


def _until(source: GenicamSource, condition: Any) -> bool:
    until = time.monotonic() + 20.0
    while time.monotonic() < until:
        taken = source.capture_set(CaptureRequest(timeout_s=0.5, retries=0))
        if condition(taken, source.statuses()):
            return True
    return False


@pytest.mark.parametrize(
    "faults",
    [
        {"GE02": ("conflict GE02 GE01", "home GE02", "same address 192.168.77.11")},
        {
            "GE02": ("subnet GE02", "home GE02", "192.168.78.12 is not in the network of eth0"),
            "GE03": ("unplug GE03", "plug GE03", "not found"),
        },
    ],
    ids=["one address for two", "another subnet, unplugged"],
)
def test_a_fault_on_the_wire_is_named_and_recovered_from(
    rig: GigeRig, source: GenicamSource, faults: dict[str, tuple[str, str, str]]
) -> None:
    for fault, _, _ in faults.values():
        rig.fault(*fault.split())
    try:
        assert _until(
            source,
            lambda _, told: all(
                told[camera].state is CameraState.LOST and words in told[camera].cause
                for camera, (_, _, words) in faults.items()
            ),
        )
    finally:
        for _, heal, _ in faults.values():
            rig.fault(*heal.split())
    assert _until(source, lambda taken, _: taken.complete)


def test_our_own_search_finds_cameras_of_every_subnet(rig: GigeRig) -> None:
    rig.fault("subnet", "GE03")
    try:
        found = {camera.serial: camera for camera in gvcp.search("eth0")}
    finally:
        rig.fault("home", "GE03")
    assert set(found) == set(rig.serials)
    assert (found["GE03"].ip_address, found["GE03"].mask) == ("192.168.78.13", "255.255.255.0")
    assert found["GE01"].mac == "02:53:43:00:00:01"


def test_a_lost_camera_is_an_error_event_once_and_its_stream_ends_cleanly(rig: GigeRig, client: Client) -> None:
    camera = client.open("GE02")
    camera.remote_device.node_map.TriggerMode.value = "Off"
    token = camera.device.module.register_event(gentl.EVENT_TYPE_LIST.EVENT_ERROR)
    errors = gentl.EventManagerError(token)
    with pytest.raises(gentl.TimeoutException):
        errors.update_event_data(100)
    camera.start()
    picture(camera, 5.0)
    rig.fault("unplug", "GE02")
    try:
        errors.update_event_data(10000)
        assert (errors.gc_error, errors.description) == (-1010, "the camera does not answer")
        with pytest.raises(gentl.TimeoutException):
            errors.update_event_data(100)
        errors.unregister_event()
        client.close(camera)
    finally:
        rig.fault("plug", "GE02")


def test_the_first_image_of_a_stream_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """210 packets at once; the system's own receive buffer, which libaravis enlarges at the first of them, has 90."""
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(aravis_producer().parent))
    with wired(1, (640, 480)) as rig, GenicamSource() as source:
        source.open(source.discover().serials, dict.fromkeys(rig.serials, CameraSettings(exposure_us=1000.0)))
        taken = source.capture_set(CaptureRequest(timeout_s=2.0, retries=0))
        assert taken.complete, taken.missing


def test_lost_packets_are_one_finding_and_of_that_camera_only(rig: GigeRig, source: GenicamSource) -> None:
    """A slow camera, no image and incomplete sets only follow from it, and all cameras wait for late answers."""
    rig.fault("loss", "GE02", 10)
    try:
        found = examine(source, seconds=3.0, rate_hz=5.0)
    finally:
        rig.fault("loss", "GE02", 0)
    wrong = {(one.code, one.where) for one in found.findings if one.severity != "info"}
    assert ("incomplete-images", ("GE02",)) in wrong
    # a machine full of other work may lose packets of the others too, and make them slow
    assert {code for code, where in wrong if where == ("GE02",)} <= {"incomplete-images", "late-answers"}, found
    assert "missing-in-sets" not in {code for code, _ in wrong}, found


def test_a_camera_that_answers_late_is_named_and_nobody_else() -> None:
    links = (
        LinkReport("GE01", CameraState.STREAMING, Counters(12, wanted_hz=5.0, triggered=12)),
        LinkReport("GE02", CameraState.STREAMING, Counters(12, wanted_hz=5.0, triggered=12, late=3)),
        LinkReport("GE03", CameraState.STREAMING, Counters(4, wanted_hz=5.0, triggered=12)),
    )
    statuses = {link.serial: CameraStatus(link.serial, link.state) for link in links}
    sets = TriggerReport(10, 7, 0.1, 1.0, {"GE01": 3})
    found = [(one.code, one.where) for one in _judge(links, statuses, sets, 4.0)]
    assert found == [("late-answers", ("GE02",)), ("slow", ("GE03",))]
    assert [one.code for one in _judge(links[:1], statuses, sets, 4.0)] == ["slow", "missing-in-sets"]


def test_late_answers_are_said_less_and_less_often() -> None:
    late = LateAnswers()
    clock = np.random.default_rng(4)
    said = [
        (at, one)
        for at in np.arange(0.0, 240.0, 0.7)
        if clock.random() < 0.6 and (one := late.note(f"GE0{clock.integers(1, 7)}", 0.1 + clock.random(), at))
    ]
    assert len(said) <= 5 and said[0][0] < 5.0, "four minutes of six cameras on a bad line: 185 lines once"
    assert said[2][1].seconds > 0.9, "the worst since the last word"
    assert late.note("GE01", 0.5, 400.0) is not None, "a new trouble is said at once"


# ---- the rig itself ----


def test_a_fault_that_cannot_be_made_is_an_error_and_the_rig_goes_on(rig: GigeRig, client: Client) -> None:
    with pytest.raises(OutputError, match="GE99"):
        rig.fault("unplug", "GE99")
    camera, image = client.open("GE01"), noise(7)
    camera.start()
    rig.set_image("GE01", image)
    assert np.array_equal(shoot(camera, 5.0)[0], image)
    client.close(camera)


PROGRAM = """
import sys, time
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
with GigeRig([GigeCamera("K1", 64, 64)]) as rig:
    print(rig.pid, flush=True)
    time.sleep(60)
"""


def test_nothing_is_left_of_a_program_that_was_killed(rig: GigeRig) -> None:
    links = sorted(os.listdir("/sys/class/net"))
    program = subprocess.Popen([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    inside = Path("/proc", program.stdout.readline().strip())
    assert inside.exists()
    network = os.readlink(inside / "ns/net")
    program.send_signal(signal.SIGKILL)
    program.wait()
    program.stdout.close()
    until = time.monotonic() + 10.0
    while (inside.exists() or network in _networks()) and time.monotonic() < until:
        time.sleep(0.02)
    assert not inside.exists()
    assert network not in _networks()
    assert sorted(os.listdir("/sys/class/net")) == links


def _networks() -> set[str]:
    found = set()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            found.add(os.readlink(process / "ns/net"))
        except OSError:  # it has ended
            continue
    return found


def test_the_command_obeys_and_says_what_it_does_not_understand(rig: GigeRig) -> None:
    class Scenes:
        cameras, bits, names = {"GE01": None}, {"GE01": 12}, ("P1",)

        def images(self, scene: str) -> dict[str, np.ndarray]:
            return {"GE01": np.full((SMALL[1], SMALL[0]), 0x800, np.uint16)}

    said: list[str] = []
    lines = ["P1", "loss GE01 1", "loss GE01 0", "loss GE01 many", "unplug", "seize it now", "quit", "never"]
    command.follow(partial(command.obeyed_gige, rig, Scenes()), lines, said.append)  # type: ignore[arg-type]
    assert said[:3] == ["They see P1.", "done", "done"]
    assert "'many' is no number" in said[3]
    assert "unplug needs CAMERA" in said[4]
    assert "seize needs CAMERA" in said[5]
    assert len(said) == 6


def test_cameras_are_listed_by_the_program_itself(rig: GigeRig) -> None:
    words = [sys.executable, "-m", "spherecal_app.cli.main", "cameras", "list", "--json"]
    environment = os.environ | {"GENICAM_GENTL64_PATH": str(aravis_producer().parent)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert {camera["serial"]: camera["transport"] for camera in json.loads(done.stdout)["cameras"]} == {
        serial: "GEV" for serial in rig.serials
    }


def test_the_parser_knows_the_command() -> None:
    options = make_parser().parse_args(["cameras", "simulate-gige", "rigA", "--cameras", "3", "--run", "true"])
    assert (options.rig, options.cameras, options.run, options.mtu) == ("rigA", 3, "true", 1500)
