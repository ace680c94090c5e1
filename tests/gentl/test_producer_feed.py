"""A session folder in front of the simulated cameras, and the commands around it."""

import json
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spherecal.base.errors import InputError
from spherecal.targets.family import make_target_set
from spherecal_app.cli import producer_command as command
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.main import main
from spherecal_files.target_set_file import write_target_set
from spherecal_gentl.producer.producer_control import ProducerControl, RigFeed
from spherecal_sim.simulate_session import simulate_session, write_session
from tests.producer_client import (
    SMALL,
    built_cti,  # noqa: F401 (fixtures)
    end,
    new_client,
    noise,
    shoot,
)

SCENES = {"P1": 0, "P2": 1}


def _write_session(folder: Path, bits: int = 8) -> Path:
    (folder / "images").mkdir(parents=True)
    cameras, placements = ("C1", "C2"), []
    for scene, number in SCENES.items():
        images = {}
        for i, camera in enumerate(cameras):
            if (scene, camera) == ("P2", "C2"):
                continue  # this camera missed the second placement
            images[camera] = f"images/{scene}-{camera}.png"
            Image.fromarray(noise(10 * number + i, bits=bits)).save(folder / images[camera])
        placements.append({"id": scene, "images": images})
    prior = {"matrix": [[400, 0, 160], [0, 400, 120], [0, 0, 1]], "distortion": [0, 0, 0, 0, 0]}
    session = {
        "format": "spherecal/session",
        "version": 1,
        "cameras": [
            {"id": "C1", "serial": "4711", "image_size": SMALL, "prior": prior, "intrinsics_group": "all"},
            {"id": "C2", "image_size": SMALL, "prior": prior, "intrinsics_group": "all"},
        ],
        "placements": placements,
        "bars": [],
        "bar_poses": [],
        "sphere": {"nominal_diameter_mm": 500.0},
        "target_set": "targets.json",
    }
    write_target_set(folder / "targets.json", make_target_set(2))
    (folder / "session.json").write_text(json.dumps(session))
    return folder


@pytest.mark.parametrize(("bits", "form"), [(8, "Mono8"), (12, "Mono12p")])
def test_a_client_sees_the_session(
    cti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bits: int, form: str
) -> None:
    with RigFeed(_write_session(tmp_path / "s", bits)) as feed:
        assert (feed.scenes, feed.scene) == (("P1", "P2"), "P1")
        monkeypatch.setenv("SPHERECAL_GENTL_REGION", feed.control.name)
        client = new_client(cti)
        try:
            assert client.serials == ["4711", "C2"]
            cameras = [client.open(serial, "Software") for serial in client.serials]
            for camera in cameras:
                camera.remote_device.node_map.PixelFormat.value = form
                camera.start()
            assert [np.array_equal(shoot(c)[0], noise(i, bits=bits)) for i, c in enumerate(cameras)] == [True, True]
            feed.show("P2")
            assert np.array_equal(shoot(cameras[0])[0], noise(10, bits=bits))
            assert not shoot(cameras[1])[0].any()  # black where the session has no image
        finally:
            end(client)
        with pytest.raises(InputError, match="no scene 'P3'; there are P1, P2"):
            feed.show("P3")


def test_sessions_that_cannot_be_shown_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    folder = _write_session(tmp_path / "s")
    name = f"spherecal-feed-{os.getpid()}"
    with pytest.raises(InputError, match="no scene 'X'"):
        RigFeed(folder, name, "X")
    Image.fromarray(noise(0, (300, 200))).save(folder / "images" / "P1-C1.png")
    with pytest.raises(InputError, match=r"P1-C1\.png is 300 x 200 px as uint8; .* 320 x 240"):
        RigFeed(folder, name)
    with pytest.raises(InputError, match="no simulated cameras named"):
        ProducerControl.attached(name)
    write_session(*simulate_session("demo", 1), tmp_path / "observations only")
    with pytest.raises(InputError, match="has no images to show"):
        RigFeed(tmp_path / "observations only", name)


def test_commands_are_obeyed_until_quit(tmp_path: Path) -> None:
    said: list[str] = []
    with RigFeed(_write_session(tmp_path / "s")) as feed:
        lines = ["P2", "", "unplug 4711", "pulse", "jump high", "P9", "plug 4711", "quit"]
        command.follow(partial(command.obeyed, feed), lines, said.append)
        assert feed.scene == "P2"
    assert said[:3] == ["They see P2.", "4711 is unplugged", "pulse"]
    assert "Not understood: jump high" in said[3]
    assert "no scene 'P9'" in said[4]
    assert said[5:] == ["4711 is plugged in"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_the_command_runs_until_it_is_ended_and_others_can_change_the_scene(
    cti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPHERECAL_GENTL_REGION", f"spherecal-command-{os.getpid()}")
    folder = str(_write_session(tmp_path / "s"))
    words = [sys.executable, "-m", "spherecal_app.cli.main", "cameras", "simulate-producer", folder]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        assert "2 simulated cameras: 4711, C2" in running.stdout.readline()
        assert "They see P1" in running.stdout.readline()
        assert f"GENICAM_GENTL64_PATH={cti.parent}" in running.stdout.readline()
        assert main(["cameras", "simulate-producer", folder, "--show", "P2", "--running"]) == DONE
        control = ProducerControl.attached()
        image = control._region.slot(0, 2)[: SMALL[0] * SMALL[1]].copy()
        assert np.array_equal(image, noise(10).ravel())
        control.close()
        running.send_signal(signal.SIGTERM)
        assert running.wait(10) == DONE
    with pytest.raises(InputError, match="no simulated cameras"):
        ProducerControl.attached()


def test_as_json_it_tells_what_is_seen_and_nothing_else(
    cti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPHERECAL_GENTL_REGION", f"spherecal-json-{os.getpid()}")
    folder = str(_write_session(tmp_path / "s"))
    words = [sys.executable, "-m", "spherecal_app.cli.main", "cameras", "simulate-producer", folder, "--json"]
    done = subprocess.run(words, input="P2\nquit\n", capture_output=True, text=True, check=True, timeout=60)
    assert json.loads(done.stdout) == {
        "cameras": ["4711", "C2"], "scene": "P1", "scenes": ["P1", "P2"], "producers": str(cti.parent)
    }  # fmt: skip


def test_building_says_how_to_use_it(cti: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cameras", "build-producer", "-o", str(tmp_path)]) == DONE
    assert f"GENICAM_GENTL64_PATH={tmp_path}" in capsys.readouterr().out
    assert (tmp_path / cti.name).read_bytes() == cti.read_bytes()
    assert main(["cameras", "build-producer", "-o", str(tmp_path), "--json"]) == DONE
    assert json.loads(capsys.readouterr().out) == {"producer": str(tmp_path / cti.name)}
