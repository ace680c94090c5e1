"""Cameras that are equal in what they say of themselves, or in the name that people gave them."""

import json
import os
import shutil
import subprocess
import sys

import pytest
from conftest import ROOT

from spherecal.targets.family import make_target_set
from spherecal_app.cli.main import main
from spherecal_cameras.genicam.discovery import together
from spherecal_cameras.protocol import CameraInfo, ProducerVerdict
from spherecal_files.read_session import read_session
from spherecal_files.target_set_file import write_target_set
from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera
from tests.built_producer import built_producer
from tests.gige_rig import aravis_producer

pytest.importorskip("harvesters", reason="harvesters is not installed: pip install spherecal[cameras]")
pytest.importorskip("genicam.gentl", reason="genicam is not installed: pip install spherecal[cameras]")

SIZE = (320, 240)


# --- MAC, serial number and model equal ------------------------------------------------------------------------------


@pytest.mark.skipif(shutil.which("arv-fake-gv-camera-0.8") is None, reason="no arv-fake-gv-camera-0.8: aravis-tools")
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root makes a network namespace")
@pytest.mark.parametrize("serials", [("GV01", "GV02", "GV03"), ("GV01", "GV01", "GV03")])
def test_equal_cameras_are_all_open_and_come_back_after_a_power_cycle(serials):
    producer, script = aravis_producer(), ROOT / "tests" / "equal_cameras.py"
    done = subprocess.run(
        ["unshare", "-n", sys.executable, str(script), str(producer), *serials],
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout.splitlines()[-1])
    addresses = [f"127.0.0.{number + 2}" for number in range(3)]
    assert sorted(seen["found"].values()) == addresses
    first, second, third = sorted(seen["found"], key=seen["found"].__getitem__)
    if serials[0] == serials[1]:
        assert (first, second) == ("GV01 (127.0.0.2)", "GV01 (127.0.0.3)")
    else:
        assert (first, second, third) == serials
    sends = {"streaming", "incomplete frames"}  # the latter where the machine has other work
    assert set(seen["opened"].values()) <= sends
    assert {name for name, state in seen["without"].items() if state in sends} == {first, third}
    assert set(seen["again"].values()) <= sends


def camera(serial: str, producer: str, address: str = "", model: str = "M") -> CameraInfo:
    return CameraInfo(serial, model, "V", producer, address=address)


def test_two_drivers_with_one_serial_number_at_two_addresses_have_two_cameras():
    def verdict(*cameras: CameraInfo) -> ProducerVerdict:
        return ProducerVerdict(cameras[0].producer, True, "", cameras=cameras)

    apart = together([verdict(camera("7", "a", "10.0.0.1")), verdict(camera("7", "b", "10.0.0.2"))])
    assert apart.serials == ("7", "7 (10.0.0.2)") and not apart.doubles
    same = together([verdict(camera("7", "a", "10.0.0.1")), verdict(camera("7", "b", "10.0.0.1"))])
    assert same.serials == ("7",) and len(same.doubles) == 1


# --- one name for two cameras ----------------------------------------------------------------------------------------


@pytest.fixture
def rig(monkeypatch):
    """Three cameras on our simulated producer, of which two are called Center, and the options that reach them."""
    cameras = [SimulatedCamera(f"S{i}", *SIZE, user_id=name) for i, name in enumerate(("Center", "Center", "Left"))]
    with ProducerControl(cameras) as control:
        monkeypatch.setenv("SPHERECAL_GENTL_REGION", control.name)
        yield control


@pytest.fixture
def common(rig, tmp_path) -> list[str]:
    return ["--producer", str(built_producer()), "--profile", str(tmp_path / "cameras.json")]


def test_a_name_of_two_cameras_is_refused_and_both_are_listed(common, capsys):
    for command in (["show", "Center"], ["set", "Center", "--exposure-us", "500"]):
        assert main(["cameras", command[0], command[1], *common, *command[2:]]) == 2
        said = capsys.readouterr().err
        assert "Several cameras have the name 'Center'" in said and "S0" in said and "S1" in said
    assert main(["cameras", "list", *common]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "2 cameras are called Center: S0, S1. Give each its own: spherecal cameras set 'S0' --name NAME." in said
    assert main(["cameras", "set", "S2", *common, "--name", "Center"]) == 2
    assert "already has the name" in capsys.readouterr().err
    assert main(["cameras", "set", "S1", *common, "--name", "Right"]) == 0
    assert main(["cameras", "set", "Center", *common, "--exposure-us", "500"]) == 0
    capsys.readouterr()
    assert main(["cameras", "list", *common]) == 0
    assert "are called" not in capsys.readouterr().out


# --- going on with a capture -----------------------------------------------------------------------------------------


def test_a_capture_goes_on_with_its_own_plan_and_names_incomplete_sets(rig, common, tmp_path, capsys):
    for serial, name in (("S0", "A"), ("S1", "B"), ("S2", "C")):
        lens = ["--focal-length-mm", "8", "--pixel-pitch-um", "3.45"]
        assert main(["cameras", "set", serial, *common, "--name", name, *lens]) == 0
    write_target_set(tmp_path / "targets.json", make_target_set(20))
    session = tmp_path / "session"
    line = ["cameras", "capture", *common, "-o", str(session), "--retries", "0", "--timeout", "8"]
    begin = [*line, "--targets", str(tmp_path / "targets.json"), "--placements", "3", "--diameter-mm", "400"]
    rig.set("S1", lost_frame_count=1)
    assert main([*begin, "--before-each", 'test "$SPHERECAL_SET" != P2']) == 2
    capsys.readouterr()
    assert main([*line, "--continue", "--before-each", "true"]) == 3
    said = capsys.readouterr().out
    assert "P1 has no image of B." in said and "3 sets of 3 cameras" in said
    whole = read_session(session)
    assert [len(placement.images) for placement in whole.placements] == [2, 3, 3]
    assert whole.target_set is not None and whole.sphere_diameter_mm == 400
    assert main([*line, "--continue", "--before-each", "true", "--json"]) == 3
    answer = json.loads(capsys.readouterr().out.strip())
    assert answer["incomplete"] == {"P1": ["B"]}
    assert main([*line, "--continue", "--placements", "4", "--before-each", "true"]) == 3
    assert len(read_session(session).placements) == 4
    shutil.rmtree(session)
    assert main([*line, "--continue"]) == 2, "there is nothing to go on with"


def test_a_set_of_which_no_camera_sent_an_image_is_taken_again(rig, common, tmp_path):
    write_target_set(tmp_path / "targets.json", make_target_set(20))
    for serial in ("S0", "S1", "S2"):
        assert main(["cameras", "set", serial, *common, "--focal-length-mm", "8", "--pixel-pitch-um", "3.45"]) == 0
        rig.set(serial, lost_frame_count=1)
    line = ["cameras", "capture", *common, "-o", str(tmp_path / "s"), "--retries", "0", "--before-each", "true"]
    assert main([*line, "--targets", str(tmp_path / "targets.json"), "--placements", "2"]) == 3
    assert [one.id for one in read_session(tmp_path / "s").placements] == ["P2"]
    assert main([*line, "--continue"]) == 0
    assert [(one.id, len(one.images)) for one in read_session(tmp_path / "s").placements] == [("P1", 3), ("P2", 3)]
