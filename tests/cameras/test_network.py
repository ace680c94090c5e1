"""Cameras on the wire and on the bus without any driver: found, given addresses, their packets tested."""

import subprocess
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from spherecal_cameras import builtin_driver
from spherecal_cameras import camera_network as network
from spherecal_cameras.camera_network import WireCamera, found_on_wire, give_address, largest_packet, proposed_address
from spherecal_cameras.genicam.discovery import producer_files
from spherecal_cameras.genicam.trust import TrustStore
from spherecal_cameras.network_lines import usb_cameras
from spherecal_cameras.protocol import CameraError
from spherecal_gentl.gige.gige_control import GigeRig
from spherecal_gentl.gige.gvcp import CONTROL_REGISTER, Gvcp
from spherecal_gentl.producer.build_producer import ARAVIS_CTI_FILE
from tests.gige_rig import aravis_producer, wired

MASK = "255.255.255.0"


@pytest.fixture(name="rig", scope="module")
def three_cameras() -> Iterator[GigeRig]:
    with wired(3) as rig:
        yield rig


def on_wire() -> dict[str, WireCamera]:
    return {camera.serial: camera for camera in found_on_wire(0.3)}


def test_everybody_on_the_wire_is_named_with_subnet_and_holder(rig: GigeRig) -> None:
    rig.fault("subnet", "GE01")
    rig.fault("seize", "GE03")
    try:
        found = on_wire()
        assert {s: (c.subnet_ok, c.controlled_by_other) for s, c in found.items()} == {
            "GE01": (False, None),
            "GE02": (True, False),
            "GE03": (True, True),
        }
        assert (found["GE02"].maker, found["GE02"].model) == ("SphereCal", "Simulated GigE")
        assert found["GE02"].mac == "02:53:43:00:00:02" and found["GE02"].interface == "eth0"
        with pytest.raises(CameraError, match="another program holds it"):
            largest_packet(found["GE03"].ip_address, 1500)
    finally:
        rig.fault("release", "GE03")
        rig.fault("home", "GE01")
    assert all(c.subnet_ok and c.controlled_by_other is False for c in on_wire().values())


def test_a_camera_of_another_subnet_gets_an_address_and_keeps_it_without_power(rig: GigeRig) -> None:
    rig.fault("subnet", "GE01")
    found = on_wire()
    offer = proposed_address(found["GE01"], found.values())
    assert offer is not None and offer.ip not in {c.ip_address for c in found.values()}
    given = give_address(found["GE01"].mac, offer.ip, offer.mask, persistent=True)
    assert (given.ip_address, given.subnet_ok, given.controlled_by_other) == (offer.ip, True, False)
    rig.fault("power_off", "GE01")
    assert "GE01" not in on_wire()
    rig.fault("power_on", "GE01")
    assert on_wire()["GE01"].ip_address == offer.ip


def test_an_address_that_is_not_kept_ends_with_the_power(rig: GigeRig) -> None:
    rig.fault("home", "GE02")
    before = on_wire()["GE02"]
    given = give_address(before.mac, "192.168.77.99", MASK, persistent=False)
    assert given.ip_address == "192.168.77.99"
    rig.fault("home", "GE02")
    assert on_wire()["GE02"].ip_address == before.ip_address


@pytest.mark.parametrize(
    ("ip", "mask", "gateway", "said"),
    [
        ("10.0.0.3", MASK, "0.0.0.0", "not in the network"),
        ("192.168.77.255", MASK, "0.0.0.0", "no address for a camera"),
        ("192.168.77.13", MASK, "0.0.0.0", "another device"),
        ("192.168.77.1", MASK, "0.0.0.0", "another device"),
        ("192.168.77.2", MASK, "0.0.0.0", "another device"),  # no camera: the rig's second computer
        ("192.168.77.20", "255.0.255.0", "0.0.0.0", "no address for a camera"),
        ("192.168.77.20", MASK, "nowhere", "no address for a camera"),
        ("", "", "", "no address for a camera"),
    ],
)
def test_an_address_that_would_lose_the_camera_is_refused(
    rig: GigeRig, ip: str, mask: str, gateway: str, said: str
) -> None:
    before = on_wire()["GE02"]
    with pytest.raises(CameraError, match=said):
        give_address(before.mac, ip, mask, gateway)
    assert on_wire()["GE02"] == before


def test_a_camera_that_does_not_take_an_address_is_told(rig: GigeRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "_SETTLE_S", 1.0)
    rig.fault("seize", "GE02")
    try:
        with pytest.raises(CameraError, match="did not take the address"):
            give_address("02:53:43:00:00:02", "192.168.77.98", MASK)
    finally:
        rig.fault("release", "GE02")
    with pytest.raises(CameraError, match="02:53:43:00:00:77"):
        give_address("02:53:43:00:00:77", "192.168.77.98", MASK)


def test_packets_are_tried_by_the_cameras_own(rig: GigeRig) -> None:
    address = on_wire()["GE02"].ip_address
    assert largest_packet(address, 1500).largest == 1500
    jumbo = largest_packet(address, 9000)
    assert jumbo.largest == 1500 and jumbo.tried[:2] == (9000, 576) and len(jumbo.tried) < 16
    assert on_wire()["GE02"].controlled_by_other is False, "the camera is let go of"
    rig.fault("unplug", "GE02")
    try:
        with pytest.raises(CameraError, match="does not answer"):
            largest_packet(address, 1500)
    finally:
        rig.fault("plug", "GE02")


def test_a_switch_that_cuts_packets_is_found(rig: GigeRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """The card is said to take 9000 bytes, one camera sends so many, the switch takes 1500."""
    lines = [replace(line, mtu=9000) for line in network.network_lines()]
    monkeypatch.setattr(network, "network_lines", lambda: lines)
    assert network.cut_packets(found_on_wire()) == ()
    registers = Gvcp(on_wire()["GE02"].ip_address)
    try:
        assert registers.write(CONTROL_REGISTER, 2, 1.0) and registers.write(0x0D04, 8000, 1.0)
        registers.write(CONTROL_REGISTER, 0, 1.0)
        (found,) = network.cut_packets(found_on_wire())
        assert (found.code, found.where, found.values["largest"]) == ("packets-cut", ("GE02",), 1500)
        assert "8000 bytes" in found.message and "1500" in found.hint
    finally:
        registers.write(CONTROL_REGISTER, 2, 1.0)
        registers.write(0x0D04, 1500, 1.0)
        registers.write(CONTROL_REGISTER, 0, 1.0)
        registers.close()


def test_the_computers_part_is_told_and_cured(rig: GigeRig) -> None:
    def run(*command: str) -> None:
        subprocess.run(command, check=True)

    facts = {fact.name: fact for fact in network.interface_facts(found_on_wire())}
    assert not any(fact.finding for fact in facts.values()) and facts["mtu"].value == "1500 bytes"
    run("ip", "link", "set", "eth0", "mtu", "1400")
    try:
        wrong = next(fact for fact in network.interface_facts(found_on_wire()) if fact.name == "mtu")
        assert wrong.finding is not None and wrong.finding.code == "packets-too-large"
        assert wrong.cure == "sudo ip link set eth0 mtu 1500" and network.can_apply(wrong.cure)
        network.apply_cure(wrong.cure)
        assert next(f for f in network.interface_facts(found_on_wire()) if f.name == "mtu").finding is None
    finally:
        run("ip", "link", "set", "eth0", "mtu", "1500")
    with pytest.raises(CameraError, match="nonsense0"):
        network.apply_cure("sudo ip link set nonsense0 mtu 9000")
    assert not network.can_apply("")


def test_usb3_vision_cameras_are_seen_on_the_bus(tmp_path: Path) -> None:
    def device(name: str, interfaces: list[tuple[str, str]], **said: str) -> None:
        (tmp_path / "sys" / name).mkdir(parents=True)
        for key, text in said.items():
            (tmp_path / "sys" / name / key).write_text(text + "\n")
        for number, (kind, below) in enumerate(interfaces):
            folder = tmp_path / "sys" / f"{name}:1.{number}"
            folder.mkdir()
            (folder / "bInterfaceClass").write_text(kind + "\n")
            (folder / "bInterfaceSubClass").write_text(below + "\n")

    about = {"idVendor": "2676", "idProduct": "ba02", "manufacturer": "Maker", "product": "M-5", "busnum": "2"}
    device("2-1.4", [("ef", "05"), ("ef", "05")], serial="77", speed="5000", devnum="7", **about)
    device("2-2", [("ef", "05")], serial="78", speed="480", devnum="12", **about)
    device("2-3", [("ef", "02")], serial="webcam", speed="480", devnum="3", **about)
    device("2-4", [("ef", "05")])  # one that says nothing of itself
    (tmp_path / "dev" / "002").mkdir(parents=True)
    (tmp_path / "dev" / "002" / "007").write_text("")
    silent, fast, slow = usb_cameras(tmp_path / "sys", tmp_path / "dev")
    assert (silent.serial, silent.mbit_s, silent.slow, silent.allowed) == ("", None, False, False)
    assert (fast.serial, fast.model, fast.slow, fast.allowed) == ("77", "M-5", False, True)
    assert (slow.serial, slow.slow, slow.allowed) == ("78", True, False)
    assert usb_cameras(tmp_path / "nowhere") == ()


def test_the_built_in_driver_is_prepared_and_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    aravis_producer()
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setenv("SPHERECAL_DRIVERS", str(tmp_path / "drivers.json"))
    monkeypatch.delenv("GENICAM_GENTL64_PATH", raising=False)
    if builtin_driver.state().kind == "installed":
        pytest.skip("the driver has come with a package here")
    assert builtin_driver.state().kind == "can-be-built"
    file = builtin_driver.prepare()
    assert file == tmp_path / "spherecal" / "cti" / ARAVIS_CTI_FILE
    assert builtin_driver.state() == builtin_driver.BuiltinDriver("installed", file)
    assert str(file) in producer_files()
    began = time.perf_counter()
    assert builtin_driver.prepare() == file and time.perf_counter() - began < 2.0
    assert TrustStore().look(str(file)).state in ("known", "unsafe")  # the tests' own folder may be anybody's


def test_what_the_built_in_driver_lacks_has_its_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    found = builtin_driver.state()
    if found.kind == "installed":
        pytest.skip("the driver has come with a package here")
    assert found.kind == "lacking" and {"libaravis-dev", "compiler"} <= set(found.lacks)
    assert found.install.startswith("sudo apt install ") and "g++" in found.install
    with pytest.raises(Exception, match=r"built-in camera driver.*g\+\+"):
        builtin_driver.prepare()
