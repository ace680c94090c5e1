"""Files of every released version open; those of a later one are refused by name and left as they are.

tests/data/released/VERSION holds what that version wrote, never changed afterwards; a release adds a folder. Profiles
of the first version lie in tests/data/profile_v1 (tests/rigs/test_profile_store.py opens them too).
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import ROOT

from spherecal.base.errors import InputError
from spherecal_cameras.camera_settings import read_profile as read_cameras
from spherecal_cameras.genicam.trust import TrustStore
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig
from spherecal_files.target_set_file import read_target_set
from spherecal_rigs.result_folder import read_result
from spherecal_rigs.store import open_profile

RELEASES = sorted(path for path in (ROOT / "tests" / "data" / "released").iterdir() if path.is_dir())
IDS = [path.name for path in RELEASES]


def read_project(folder: Path) -> object:
    pytest.importorskip("PySide6")
    from spherecal_gui.project_folder import load_project

    return load_project(folder)


# what is opened, relative to a release's folder -> the file whose version counts, and how it is opened
OPENED: dict[str, tuple[str, Callable[[Path], object]]] = {
    "session": ("session/session.json", lambda release: read_session(release / "session")),
    "targets": ("session/targets.json", lambda release: read_target_set(release / "session" / "targets.json")),
    "rig": ("result/rig.json", lambda release: read_rig(release / "result" / "rig.json")),
    "result": ("result/verification.json", lambda release: read_result(release / "result")),
    "cameras": ("cameras.json", lambda release: read_cameras(release / "cameras.json")),
    "drivers": ("drivers.json", lambda release: TrustStore(release / "drivers.json")),
    "project": ("project/wizard.json", lambda release: read_project(release / "project")),
}


@pytest.fixture(params=RELEASES, ids=IDS)
def release(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy, so that nothing can be written into the samples."""
    return Path(shutil.copytree(request.param, tmp_path / "release"))


@pytest.mark.parametrize("what", OPENED)
def test_it_opens(release: Path, what: str) -> None:
    assert OPENED[what][1](release) is not None


def test_what_is_read_is_what_was_written(release: Path) -> None:
    session = read_session(release / "session")
    assert [camera.id for camera in session.cameras] == ["C01", "C02"]
    assert session.bars[0].lengths[0].length_mm == 412.345
    assert session.observations is not None and len(session.observations) == 3
    rig = read_rig(release / "result" / "rig.json")
    document = json.loads((release / "result" / "rig.json").read_text(encoding="utf-8"))
    assert [camera.id for camera in rig.cameras] == [entry["id"] for entry in document["cameras"]]
    for camera, entry in zip(rig.cameras, document["cameras"], strict=True):
        assert camera.intrinsics[0] == entry["matrix"][0][0]
        assert camera.translation_mm.tolist() == entry["translation_mm"]
    cameras = read_cameras(release / "cameras.json")
    assert cameras.entry("50-0503343").settings.exposure_us == 8000.0
    assert cameras.producers == ("/opt/maker/lib/maker.cti",)
    assert TrustStore(release / "drivers.json").allowed() == {"/opt/maker/lib/maker.cti": "ab" * 32}


def test_the_first_version_of_a_profile_opens(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ROOT / "tests" / "data" / "profile_v1", tmp_path / "profile"))
    assert open_profile(folder) is not None


@pytest.mark.parametrize("what", OPENED)
def test_a_later_version_is_refused_and_left_alone(release: Path, what: str) -> None:
    name, opened = OPENED[what]
    document = json.loads((release / name).read_text(encoding="utf-8"))
    document["version"] = 99
    written = json.dumps(document).encode()
    (release / name).write_bytes(written)
    with pytest.raises(InputError, match=r"the file's version is 99, this program reads [12]"):
        opened(release)
    assert (release / name).read_bytes() == written


def test_downgrading_is_told_in_one_line(release: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from spherecal_app.cli.main import main

    file = release / "session" / "session.json"
    file.write_text(file.read_text(encoding="utf-8").replace('"version": 1', '"version": 7', 1), encoding="utf-8")
    assert main(["calibrate", str(release / "session"), "-o", str(release / "out")]) == 2
    said = capsys.readouterr().err
    assert "version is 7" in said and "Install the newest version" in said
    assert not (release / "out").exists()


def test_this_version_has_its_samples() -> None:
    """Whoever releases a version checks in what it writes."""
    import spherecal

    assert spherecal.__version__ in IDS
