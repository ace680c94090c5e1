"""The doctor's judgement of GigE lines: addresses, packets, buffers, bandwidth, and delays to share one with."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from spherecal_cameras.network_lines import (
    CameraLoad,
    NetworkLine,
    UsbCamera,
    assess,
    bus_shares,
    load_of,
    network_lines,
    stagger,
    wire_bytes,
)
from spherecal_cameras.protocol import CameraSettings, FeatureReport
from spherecal_gentl.gige.gvcp import NetworkCamera

GIGABIT = NetworkLine("eth1", "10.0.0.1", "255.255.255.0", 9000, 1000.0, 0, 33_554_432)
LOAD = CameraLoad(5_000_000, 1.0, 8992)


def camera(serial: str, address: str, mask: str = "255.255.255.0") -> NetworkCamera:
    return NetworkCamera(f"02:00:00:00:00:{serial}", address, mask, "Maker", "Model", serial, "", "eth1")


CAMERAS = [camera("01", "10.0.0.11"), camera("02", "10.0.0.12")]
LOADS = {"01": LOAD, "02": LOAD}


def changed(line: NetworkLine, **fields: object) -> NetworkLine:
    return NetworkLine(**{name: fields.get(name, getattr(line, name)) for name in line.__dataclass_fields__})  # type: ignore[arg-type]


def codes(line: NetworkLine, cameras: list[NetworkCamera], loads: dict[str, CameraLoad]) -> dict[str, tuple[str, ...]]:
    return {finding.code: finding.where for finding in assess(line, cameras, loads).findings}


def test_a_sound_line_has_no_findings_and_says_what_is_wanted() -> None:
    found = assess(GIGABIT, CAMERAS, LOADS)
    assert found.findings == ()
    # 5 MB in packets of 8956 bytes of pixels, 559 and two more, each with 74 bytes around it
    assert wire_bytes(LOAD) == 5_000_000 + (559 + 2) * 74
    assert found.wanted_bytes_s == 2 * wire_bytes(LOAD)
    assert found.carried_bytes_s == 125e6


@pytest.mark.parametrize(
    ("line", "cameras", "loads", "expected"),
    [
        (GIGABIT, [*CAMERAS, camera("03", "10.0.0.11")], LOADS, {"same-address": ("01", "03")}),
        (GIGABIT, [camera("01", "10.0.0.1")], {}, {"same-address": ("01",)}),
        (GIGABIT, [camera("01", "10.0.1.11")], {}, {"other-subnet": ("01",)}),
        (changed(GIGABIT, reverse_path_filter=2), [camera("01", "10.0.1.11")], {}, {"other-subnet": ("01",)}),
        (
            changed(GIGABIT, reverse_path_filter=1),
            [camera("01", "10.0.1.11")],
            {},
            {"other-subnet": ("01",), "reverse-path-filter": ("01",)},
        ),
        (changed(GIGABIT, mtu=1500), CAMERAS, LOADS, {"packets-too-large": ("01", "02")}),
        (changed(GIGABIT, receive_buffer_bytes=212_992), CAMERAS, LOADS, {"receive-buffer": ("01", "02")}),
        (GIGABIT, CAMERAS, dict.fromkeys(LOADS, CameraLoad(5_000_000, 11.1, 8992)), {}),
        (GIGABIT, CAMERAS, dict.fromkeys(LOADS, CameraLoad(5_000_000, 11.2, 8992)), {"line-too-thin": ("01", "02")}),
        (
            changed(GIGABIT, mtu=1500),
            CAMERAS,
            dict.fromkeys(LOADS, CameraLoad(5_000_000, 8.0)),
            {"small-packets": ("01", "02")},
        ),
        (changed(GIGABIT, mbit_s=None), CAMERAS, dict.fromkeys(LOADS, CameraLoad(5_000_000, 99.0, 8992)), {}),
    ],
)
def test_what_is_wrong_is_found_and_nothing_else(
    line: NetworkLine, cameras: list[NetworkCamera], loads: dict[str, CameraLoad], expected: dict[str, tuple[str, ...]]
) -> None:
    assert codes(line, cameras, loads) == expected


def test_every_finding_comes_with_its_command_or_what_to_change() -> None:
    line = changed(GIGABIT, reverse_path_filter=1, receive_buffer_bytes=212_992, mtu=1500)
    found = {f.code: f.hint for f in assess(line, [*CAMERAS, camera("03", "10.0.1.254")], LOADS).findings}
    assert "sudo ip address add 10.0.1.1/24 dev eth1" in found["other-subnet"]
    assert "sysctl net.ipv4.conf.all.rp_filter=2" in found["reverse-path-filter"]
    assert "sudo sysctl net.core.rmem_max=33554432" in found["receive-buffer"]
    assert "sudo ip link set eth1 mtu 8992" in found["packets-too-large"]


@pytest.mark.parametrize("count", [2, 6, 12])
@pytest.mark.parametrize("packet_size", [1500, 8992])
def test_staggered_cameras_share_a_line_without_a_queue_of_more_than_one_packet_each(
    count: int, packet_size: int
) -> None:
    loads = {f"{i}": CameraLoad(200_000, 1.0, packet_size, 125_000_000) for i in range(count)}
    line_bytes_s = 125e6
    packets = -(-200_000 // (packet_size - 36))
    wire_s = (packet_size + 38) / line_bytes_s
    arrivals = []  # at the switch; each camera has a line of the same speed
    for delay in stagger(loads, 1000.0):
        period = wire_s + delay.packet_delay / 125e6
        arrivals.append(delay.frame_delay / 125e6 + period * np.arange(packets) + wire_s)
    sent = np.sort(np.concatenate(arrivals))
    out = waited_s = 0.0
    for at in sent:
        out = max(out, at) + wire_s
        waited_s = max(waited_s, out - at)
    busy = len(sent) * wire_s / (sent[-1] + wire_s)
    assert waited_s <= (count + 0.01) * wire_s
    assert 0.8 < busy <= 0.96  # most of the line is used, and some of it left


def test_twelve_cameras_share_a_line_each_by_what_it_has() -> None:
    own = [set(), {"throughput limit"}, {"packet delay"}, {"packet delay", "frame delay", "throughput limit"}]
    loads = {f"{i}": CameraLoad(5_000_000, 1.0, 1500, controls=frozenset(own[i % 4])) for i in range(12)}
    shares = {one.serial: one for one in stagger(loads, 1000.0)}
    assert len(shares) == 9, "a camera that cannot share is left out"
    limited = [one.throughput_bytes_s for one in shares.values() if one.throughput_bytes_s]
    assert len(limited) == 3 and 12 * limited[0] == pytest.approx(0.9 * 125e6, rel=1e-6)
    assert shares["2"].packet_delay and shares["2"].frame_delay is None
    assert shares["11"].frame_delay and shares["11"].throughput_bytes_s is None, "delays alone, which are finer"
    before = CameraSettings(packet_delay=7, frame_delay=8, packet_size=9000)
    assert shares["1"].of(before) == CameraSettings(packet_size=9000, throughput_bytes_s=limited[0])


def test_usb_cameras_of_one_bus_share_it() -> None:
    limit = CameraLoad(5_000_000, 1.0, controls=frozenset({"throughput limit"}))
    loads = {"A": limit, "B": limit, "C": replace(limit, controls=frozenset()), "D": limit}
    buses = {"A": "2", "B": "2", "C": "2", "D": "4", "stranger": "4"}
    cameras = [UsbCamera("Maker", "M", serial, 5000.0, True, bus) for serial, bus in buses.items()]
    shares = {one.serial: one.throughput_bytes_s for one in bus_shares(loads, cameras)}
    assert shares == {"A": 120_000_000, "B": 120_000_000, "D": 180_000_000}
    assert bus_shares(loads, cameras[3:4]) == (), "alone on its bus"


def test_a_load_is_read_from_what_a_camera_says() -> None:
    def told(**features: str) -> list[FeatureReport]:
        return [FeatureReport(name.replace("_", " "), name, got=value) for name, value in features.items()]

    plain = load_of(told(width="2448", height="2048", pixel_format="Mono8", packet_size="8000"), 5.0)
    assert plain == CameraLoad(2448 * 2048, 5.0, 8000, controls=frozenset())
    packed = told(width="2448", height="2048", pixel_format="Mono12p", time_stamp_rate="125000000.0", packet_delay="0")
    packed += [FeatureReport("frame delay", None)]
    assert load_of(packed, 5.0) == CameraLoad(2448 * 2048 * 3 // 2, 5.0, 1500, 125_000_000, frozenset({"packet delay"}))
    assert load_of(told(height="2048"), 5.0) is None


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks Linux about its interfaces")
def test_the_lines_of_this_computer_are_read() -> None:
    for line in network_lines():
        assert line.mtu >= 576
        assert line.receive_buffer_bytes > 0
        assert line.mbit_s is None or line.mbit_s > 0
