"""Why no camera is found, and where makers' drivers lie."""

from dataclasses import replace
from pathlib import Path

import pytest

from spherecal.base.messages.catalogue import phrase
from spherecal_cameras.builtin_driver import BuiltinDriver, driver_advice, driver_troubles, on_wire, unlisted
from spherecal_cameras.camera_network import LocalAddress, WireCamera, answering_cameras, local_addresses, reached
from spherecal_cameras.genicam.discovery import producer_files
from spherecal_cameras.makers import MAKERS, driver_folders, driver_patterns, maker_of
from spherecal_cameras.protocol import CameraInfo, Discovery, ProducerVerdict
from spherecal_gentl.gige.gvcp import NetworkCamera

INFO = CameraInfo("S1", "m", "v", "a.cti")
LOCAL = (LocalAddress("eth0", "10.1.0.5"), LocalAddress("eth1", "192.168.7.1"))


def at(address: str, mask: str = "255.255.255.0", interface: str = "eth1", serial: str = "S9") -> NetworkCamera:
    return NetworkCamera(f"02:00:{serial}", address, mask, "Maker", "M-5", serial, "", interface)


def wired(mac: str, serial: str, address: str = "192.168.7.20") -> WireCamera:
    return WireCamera(mac, address, "255.255.255.0", "Maker", "M-5", serial, "", "eth1", True, False)


def kinds(discovery: Discovery) -> list[str]:
    return [one.kind for one in driver_troubles(discovery)]


def test_each_reason_has_its_name() -> None:
    none = ProducerVerdict("a.cti", True, "The driver works, but sees no camera.")
    assert kinds(Discovery(())) == ["no-driver"]
    assert kinds(Discovery((), (none,))) == ["no-cameras"]
    (other,) = driver_troubles(Discovery((), (none,)), [wired("02:01", "1")])
    assert (other.kind, other.makers) == ("wrong-driver", ("Maker",)), "cameras answer, and it lists none"
    elsewhere = replace(wired("02:01", "1"), subnet_ok=False)
    assert driver_troubles(Discovery((), (none,)), [elsewhere])[0].kind == "no-cameras", "no driver would reach it"
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
        (at("0.0.0.0", "0.0.0.0"), True),
        (at("192.168.8.20", "1.2.3.4"), True),
    ],
)
def test_a_camera_elsewhere_is_known_by_its_address(camera: NetworkCamera, elsewhere: bool) -> None:
    assert reached(camera, LOCAL) is not elsewhere


def test_where_the_system_chooses_the_interface_any_of_its_addresses_may_reach_the_camera() -> None:
    local = (LocalAddress("", "192.168.7.1"),)
    assert reached(at("192.168.7.20", interface=""), local) and not reached(at("192.168.8.20", interface=""), local)


def test_a_listed_camera_is_found_on_the_wire_also_among_equal_serial_numbers() -> None:
    one, other = wired("02:00:00:00:00:01", "GV01"), wired("02:00:00:00:00:02", "GV01", "192.168.7.21")
    assert on_wire(CameraInfo("GV01", "m", "v", "a.cti"), [one]) == one
    assert on_wire(CameraInfo("GV01 (x-020000000002)", "m", "v", "a.cti"), [one, other]) == other
    assert on_wire(CameraInfo("GV01", "m", "v", "a.cti", address="192.168.7.20"), [one, other]) == one
    assert on_wire(CameraInfo("GV01", "m", "v", "a.cti"), [one, other]) is None
    assert on_wire(CameraInfo("S2", "m", "v", "a.cti"), [one]) is None
    assert unlisted(Discovery((CameraInfo("GV01", "m", "v", "a.cti"),)), [one, wired("02:03", "S7")]) == (
        wired("02:03", "S7"),
    )


def test_no_driver_names_the_makers_of_who_answers() -> None:
    assert driver_troubles(Discovery(()), [wired("02:01", "1"), wired("02:02", "2")])[0].makers == ("Maker",)


def test_this_computers_addresses_are_asked_and_nobody_answers_is_no_error() -> None:
    assert all(one.address != "127.0.0.1" for one in local_addresses())
    assert answering_cameras((LocalAddress("no-such0", "10.255.255.1"),), 0.05) == ()


SOUGHT = {
    "Basler": "pylon",
    "Allied Vision Technologies": "Vimba X",
    "Point Grey Research": "Spinnaker SDK",
    "IDS Imaging Development Systems GmbH": "IDS peak",
    "Hikrobot": "MVS",
    "China Daheng Group": "Galaxy SDK",
    "Lucid Vision Labs": "Arena SDK",
    "Baumer": "Baumer GAPI SDK",
    "JAI Corporation": "JAI SDK",
    "MATRIX VISION GmbH": "Impact Acquire",
    "SVS-VISTEK GmbH": "SVCam Kit",
    "XIMEA GmbH": "XIMEA Software Package",
    "Teledyne DALSA": "Sapera LT, GigE-V Framework",
    "The Imaging Source Europe GmbH": "IC4 GenTL drivers",
    "Huaray Technology": "iCentral, MV Viewer",
}


@pytest.mark.parametrize(("said", "package"), SOUGHT.items())
def test_a_camera_names_its_makers_package(said: str, package: str) -> None:
    maker = maker_of(said)
    assert maker is not None and maker.driver == package


@pytest.mark.parametrize("said", ["", "SphereCal", "Toshiba-Teli", "Aravis", "\u76f8\u673a", "?"])
def test_of_another_maker_no_package_is_named(said: str) -> None:
    assert maker_of(said) is None


def test_every_row_says_where_it_was_read() -> None:
    assert all(len(maker.source) > 30 for maker in MAKERS)
    hikrobot = next(maker for maker in MAKERS if maker.name == "HIKROBOT")
    assert hikrobot.windows[0] == r"C:\Program Files (x86)\Common Files\MVS\Runtime\Win64_x64"


def test_variables_that_installers_set_are_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("svs/cti/a.cti", "flir/Spinnaker_GenTL.cti", "mvs/64/MvProducerGEV.cti"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).touch()
    monkeypatch.setenv("SVS_SDK_BIN_64", f"{tmp_path}/svs/")
    monkeypatch.setenv("SPINNAKER_GENTL64_CTI", f"{tmp_path}/flir/Spinnaker_GenTL.cti")
    monkeypatch.setenv("MVCAM_COMMON_RUNENV", f"{tmp_path}/mvs")
    monkeypatch.setenv("SPINNAKER_GENTL64CTI_VS140", "no path [at all")
    assert {Path(file).name for file in producer_files()} >= {"a.cti", "Spinnaker_GenTL.cti", "MvProducerGEV.cti"}
    of_windows = list(driver_patterns("win32", {"SPINNAKER_GENTL64CTI_VS140": r"C:\x\Spinnaker_GenTL_v140.cti"}))
    assert of_windows[-1] == r"C:\x\Spinnaker_GenTL_v140.cti"
    of_linux = set(driver_patterns("linux", {}))
    assert "/usr/lib/GxGVTL.cti" in of_linux and "/usr/lib/*.cti" not in of_linux


def test_who_answers_without_a_driver_is_named_with_what_to_install() -> None:
    basler = replace(wired("02:01", "S9"), maker="Basler", model="acA2440-20gm")
    usb = WireCamera("", "USB", "", "Allied Vision", "1800 U-811m", "DEV_1", "", "", True, None)
    seen = unlisted(Discovery((INFO,)), [basler, wired("02:02", "S1", "192.168.7.21"), usb])
    assert seen == (basler, usb)
    lacking = BuiltinDriver("lacking", lacks=("compiler",), install="sudo apt install g++")
    for builtin, said in ((BuiltinDriver("can-be-built"), "--aravis --use"), (lacking, "sudo apt install g++")):
        text = " ".join(map(phrase, driver_advice(seen, builtin)))
        assert "2 cameras answer" in text and "Basler acA2440-20gm (S9, 192.168.7.20)" in text
        assert "Vimba X, pylon" in text and said in text
    assert driver_advice((), lacking) == ()


def test_every_maker_has_a_driver_and_a_place() -> None:
    assert len({maker.name for maker in MAKERS}) == len(MAKERS) >= 18
    for maker in MAKERS:
        assert maker.driver and all(file.endswith(".cti") for file in maker.files)
        assert maker.linux or maker.windows
        assert all(folder.startswith("/") for folder in maker.linux) and all(
            f.startswith("C:\\") for f in maker.windows
        )
    assert driver_folders("linux")[-1] == "/opt/spherecal/cti" and driver_folders("plan9") == ()
    assert {"/opt/pylon/lib/gentlproducer/gtl", "/opt/MVS/lib/64"} <= set(driver_folders("linux"))
