"""Why no camera is found, and where makers' drivers lie."""

import pytest

from spherecal.cameras.driver_help import driver_troubles
from spherecal.cameras.gige.gvcp import NetworkCamera
from spherecal.cameras.gige.network import LocalAddress, answering_cameras, local_addresses
from spherecal.cameras.makers import MAKERS, driver_folders
from spherecal.cameras.protocol import CameraInfo, Discovery, ProducerVerdict

INFO = CameraInfo("S1", "m", "v", "a.cti")
LOCAL = (LocalAddress("eth0", "10.1.0.5"), LocalAddress("eth1", "192.168.7.1"))


def at(address: str, mask: str = "255.255.255.0", interface: str = "eth1", serial: str = "S9") -> NetworkCamera:
    return NetworkCamera(interface, address, mask, f"02:00:{serial}", "Maker", "M-5", serial, "")


def kinds(discovery: Discovery, *cameras: NetworkCamera) -> list[str]:
    return [one.kind for one in driver_troubles(discovery, cameras, LOCAL)]


def test_each_reason_has_its_name() -> None:
    none = ProducerVerdict("a.cti", True, "The driver works, but sees no camera.")
    assert kinds(Discovery(())) == ["no-driver"]
    assert kinds(Discovery((), (none,))) == ["no-cameras"]
    refused = ProducerVerdict("b.cti", False, "You did not allow this driver.", "...", refused=True)
    broken = ProducerVerdict("c.cti", False, "The file is empty.", "Install the driver again.")
    assert kinds(Discovery((), (refused, broken))) == ["not-allowed", "not-loaded"]
    assert "empty. Install" in driver_troubles(Discovery((), (broken,)))[0].said
    found = Discovery((INFO,), (ProducerVerdict("a.cti", True, "1 camera.", "", (INFO,)), none, refused))
    assert kinds(found) == ["not-allowed"], "another driver without cameras is in nobody's way"


@pytest.mark.parametrize(
    ("camera", "elsewhere"),
    [
        (at("192.168.7.20"), False),
        (at("192.168.8.20"), True),
        (at("192.168.7.20", interface="eth0"), True),
        (at("169.254.3.4", "255.255.0.0"), True),
        (at("10.1.9.9", "255.255.0.0", "eth0"), False),
        (at("192.168.8.20", serial="S1"), False),
        (at("0.0.0.0", "0.0.0.0"), False),
        (at("192.168.8.20", "1.2.3.4"), True),
    ],
)
def test_a_camera_elsewhere_is_told_with_an_address_that_reaches_it(camera: NetworkCamera, elsewhere: bool) -> None:
    found = driver_troubles(Discovery((INFO,), (ProducerVerdict("a.cti", True, "", "", (INFO,)),)), [camera], LOCAL)
    assert [one.kind for one in found] == ["other-subnet"] * elsewhere
    if elsewhere:
        assert found[0].beside.rpartition(".")[0] == camera.address.rpartition(".")[0] or "/16" in found[0].beside
        assert camera.address not in found[0].beside


def test_where_the_system_chooses_the_interface_any_of_its_addresses_may_reach_the_camera() -> None:
    local = (LocalAddress("", "192.168.7.1"),)
    assert driver_troubles(Discovery((INFO,)), [at("192.168.7.20", interface="")], local)[1:] == ()
    assert driver_troubles(Discovery((INFO,)), [at("192.168.8.20", interface="")], local)[-1].kind == "other-subnet"


def test_this_computers_addresses_are_asked_and_nobody_answers_is_no_error() -> None:
    assert all(one.address != "127.0.0.1" for one in local_addresses())
    assert answering_cameras((LocalAddress("no-such0", "10.255.255.1"),), 0.05) == ()


def test_every_maker_has_a_driver_and_a_place() -> None:
    assert len({maker.name for maker in MAKERS}) == len(MAKERS) >= 12
    for maker in MAKERS:
        assert maker.driver and all(file.endswith(".cti") for file in maker.files)
        assert maker.linux or maker.windows
        assert all(folder.startswith("/") for folder in maker.linux) and all(
            f.startswith("C:\\") for f in maker.windows
        )
    assert driver_folders("linux")[-1] == "/opt/spherecal/cti" and driver_folders("plan9") == ()
    assert {"/opt/pylon/lib/gentlproducer/gtl", "/opt/MVS/lib/64"} <= set(driver_folders("linux"))
