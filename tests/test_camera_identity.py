"""Cameras that are equal in what they say of themselves, or in the name that people gave them."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from spherecal.cameras.gentl.discovery import together
from spherecal.cameras.producer.control import ProducerControl, SimulatedCamera
from spherecal.cameras.protocol import CameraInfo, Discovery, ProducerVerdict
from spherecal.cli.main import main
from spherecal.files.read_session import read_session
from spherecal.files.target_set_file import write_target_set
from spherecal.targets.family import make_target_set
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
    producer, script = aravis_producer(), Path(__file__).with_name("equal_cameras.py")
    done = subprocess.run(
        ["unshare", "-n", sys.executable, str(script), str(producer), *serials], capture_output=True, text=True, timeout=300
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
    assert set(seen["opened"].values()) == {"streaming"}
    assert {name for name, state in seen["without"].items() if state == "streaming"} == {first, third}
    assert set(seen["again"].values()) == {"streaming"}
