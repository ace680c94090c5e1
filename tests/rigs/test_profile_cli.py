"""`spherecal profile` from a session to the comparison, as a user runs it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.context import Context
from spherecal.calibrate import calibrate
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli.main import main
from spherecal_cameras.camera_settings import CameraDescription, CameraProfile, write_profile
from spherecal_cameras.protocol import CameraSettings
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import rig_bytes
from spherecal_files.write_result import write_result
from spherecal_rigs.store import create_profile, open_profile
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from tests.export_rigs import make_rig


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A session folder and its result folder."""
    folder = tmp_path_factory.mktemp("recorded")
    session, truth = simulate_session("rigA", 2, SimulationOptions(targets=60, bar_poses=2))
    cameras = tuple(replace(camera, serial=f"50-{i}") for i, camera in enumerate(session.cameras, 1))
    write_session(replace(session, cameras=cameras), truth, folder / "session")
    write_result(calibrate(read_session(folder / "session"), CalibrationSettings(), Context()), folder / "result")
    return folder / "session", folder / "result"


def run(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 0) -> str:
    assert main(["profile", *map(str, arguments)]) == code
    said = capsys.readouterr()
    if code:
        assert said.err.count("\n") == 1
    return said.err if code else said.out


def test_a_whole_story(recorded: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, result = recorded
    profile, cameras = tmp_path / "rig7", tmp_path / "cameras.json"
    serial = "50-1"
    write_profile(
        cameras, CameraProfile({serial: CameraDescription(serial, "left", CameraSettings(exposure_us=5000.0))})
    )
    said = run(capsys, "save", result, "--to", profile, "--session", session, "--settings", cameras, "--note", "first")
    assert "Saved as calibration 0001" in said
    assert "None is in use yet" in said
    assert "rig7: NONE (no calibration is in use)" in run(capsys, "show", profile)
    assert "Calibration 0001 is in use" in run(capsys, "apply", profile)
    assert (profile / "rig.json").read_bytes() == (result / "rig.json").read_bytes()

    entry = open_profile(profile).entries["0001"]
    spec = read_session(session).cameras[0]
    first = entry.cameras[0]
    assert (first.focal_length_mm, first.pixel_pitch_um) == (spec.focal_length_mm, spec.pixel_pitch_um)
    assert first.serial == spec.serial == serial
    assert first.settings is not None and first.settings["exposure_us"] == 5000.0
    assert entry.sphere_diameter_mm == read_session(session).sphere_diameter_mm
    assert entry.scale_artefact is not None and "of a target" in entry.scale_artefact
    measured = [pose.temperature_c for pose in read_session(session).bar_poses if pose.temperature_c is not None]
    assert entry.temperature_c is not None
    assert entry.temperature_c == pytest.approx(np.mean(measured))
    assert entry.volume_mm is not None
    assert (profile / "history" / "0001" / "targets.json").read_bytes() == (session / "targets.json").read_bytes()

    warm = run(capsys, "show", profile, "--temperature", entry.temperature_c + 1.5)
    assert re.search(r"rig7: AGEING \(the temperature has changed by \+1\.5 K\)", warm)
    state = json.loads(run(capsys, "show", profile, "--json"))
    assert (state["state"], state["active"], state["calibrations"][0]["note"]) == ("fresh", "0001", "first")
    assert "rig7: FRESH" in run(capsys, "list", tmp_path)
    (listed,) = json.loads(run(capsys, "list", tmp_path, "--json"))
    assert (listed["name"], listed["state"]) == ("rig7", "fresh") and len(listed["calibrations"]) > 0

    said = run(capsys, "save", result, "--to", profile, "--apply", "--stale-kelvin", 4, "--ageing-kelvin", 3)
    assert "Calibration 0002 is in use" in said
    assert open_profile(profile).limits.stale_kelvin == 4
    assert "Calibration 0001 is in use again" in run(capsys, "restore", profile)


def test_compare_says_which_camera_and_how_much(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from tests.rigs.test_profile_compare import elsewhere, moved

    rig = make_rig(5, 8)
    after = elsewhere(moved(rig, "C3", (0.05, 0, 0), (0.8, 0, 0)))
    for name, one in (("a", rig), ("b", after)):
        (tmp_path / f"{name}.json").write_bytes(rig_bytes(one))
    said = run(capsys, "compare", tmp_path / "a.json", tmp_path / "b.json")
    assert re.search(
        r"camera C3 moved by 0\.80\d mm and 0\.0500 deg: up to [\d.]+ mm \([\d.]+ px\) in the volume", said
    )
    assert said.count("moved by") == 2  # with and without a change of scale
    found = json.loads(run(capsys, "compare", tmp_path / "a.json", tmp_path / "b.json", "--json"))
    assert [camera["id"] for camera in found["similarity"]["cameras"] if camera["moved"]] == ["C3"]
    assert set(found) == {"similarity", "metric"}


def test_trend_writes_figures_and_a_chart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed in range(4):
        rig = make_rig(5, 4)
        (tmp_path / "r").mkdir(exist_ok=True)
        scaled = tuple(replace(c, translation_mm=c.translation_mm * (1 + seed * 1e-5)) for c in rig.cameras)
        (tmp_path / "r" / "rig.json").write_bytes(rig_bytes(replace(rig, cameras=scaled)))
        run(capsys, "save", tmp_path / "r", "--to", tmp_path / "p")
    said = run(capsys, "trend", tmp_path / "p", "-o", tmp_path / "t.pdf")
    assert "scale: last 30 ppm" in said
    assert (tmp_path / "t.pdf").read_bytes().startswith(b"%PDF")


def test_bad_use_is_one_message_and_code_2(
    recorded: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session, result = recorded
    assert "is not a rig profile" in run(capsys, "show", tmp_path, code=2)
    assert "no such file" in run(capsys, "save", tmp_path / "none", "--to", tmp_path / "p", code=2)
    assert not (tmp_path / "p").exists()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "rig.json").write_bytes(rig_bytes(make_rig(5, 3)))
    message = run(capsys, "save", tmp_path / "other", "--to", tmp_path / "p", "--session", session, code=2)
    assert "is not the session that this rig was calibrated from" in message
    missing = run(capsys, "save", result, "--to", tmp_path / "p", "--settings", tmp_path / "none.json", code=2)
    assert "no such file" in missing
    assert not (tmp_path / "p").exists()  # nothing is made for what cannot be saved
    create_profile(tmp_path / "p")
    assert "contains no calibration" in run(capsys, "apply", tmp_path / "p", code=2)
    assert "at least two" in run(capsys, "trend", tmp_path / "p", code=2)
    assert "no such folder" in run(capsys, "list", tmp_path / "nowhere", code=2)
    bad = replace(make_rig(5, 3), quality=replace(make_rig(5, 3).quality, valid=False))
    (tmp_path / "other" / "rig.json").write_bytes(rig_bytes(bad))
    run(capsys, "save", tmp_path / "other", "--to", tmp_path / "p")
    assert "marked as not valid" in run(capsys, "apply", tmp_path / "p", code=2)
    assert "is in use" in run(capsys, "apply", tmp_path / "p", "--anyway")
    run(capsys, "save", result, "--to", tmp_path / "p", "--stale-hours", 1, code=2)


def test_one_broken_profile_does_not_hide_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / "rig.json").write_bytes(rig_bytes(make_rig(5, 3)))
    for name in ("good", "worse"):
        run(capsys, "save", tmp_path / "r", "--to", tmp_path / name, "--apply")
    (tmp_path / "worse" / "profile.json").write_text("{")
    said = run(capsys, "list", tmp_path)
    assert "good: FRESH" in said
    assert "worse: cannot be read" in said
    (tmp_path / "good" / "history" / "0001" / "entry.json").write_text("{")
    said = run(capsys, "show", tmp_path / "good")
    assert "good: NONE (calibration 0001, which is in use, cannot be read)" in said
    assert "Cannot be read:" in said
