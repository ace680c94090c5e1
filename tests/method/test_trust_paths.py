"""Files and folders from outside: links, names and pipes in them never lead a write or a removal elsewhere."""

import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from example_session import VALID, make_session
from export_rigs import make_rig

from spherecal.base.errors import InputError, OutputError, SpherecalError
from spherecal_app.cli.main import main
from spherecal_cameras.capture import SessionCamera, SessionFolder
from spherecal_cameras.plan import CapturePlan, PlannedSet
from spherecal_cameras.protocol import CameraSource, Frame, FrameSet
from spherecal_files.atomic import RESULT, check_folder
from spherecal_files.rig_file import rig_bytes
from spherecal_gui import project, project_folder
from spherecal_gui import recorded_sets as recorded
from spherecal_gui.coverage import DotStore
from spherecal_gui.tasks.bundle_task import bundle_files
from spherecal_rigs.save_entry import save_result
from spherecal_rigs.store import apply, create_profile, open_profile

pytestmark = pytest.mark.skipif(os.name == "nt", reason="links and pipes as POSIX has them")

ENTRY = {"id": "C01", "image_size": [8, 8], "pixel_pitch_um": 3.0, "focal_length_mm": 8.0}
SOURCE = cast(CameraSource, SimpleNamespace(kind="replay", label=""))


@pytest.fixture
def precious(tmp_path: Path) -> Path:
    """A folder of the user's; no test may change it."""
    folder = tmp_path / "precious"
    folder.mkdir()
    for name in ("thesis.tex", "secret.key", "authorized_keys", "dots.npz"):
        (folder / name).write_text(f"years of work: {name}")
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def frames(grey: int = 10) -> FrameSet:
    image = np.full((8, 8), grey, np.uint8)
    return FrameSet(1, {"S1": Frame("S1", image, 8, "Mono8", 0.0, 0.0)})


def result_folder(folder: Path) -> Path:
    folder.mkdir()
    (folder / "rig.json").write_bytes(rig_bytes(make_rig(5, 1, 3)))
    return folder


# --- 1: a stranger's project -----------------------------------------------------------------------------------------


def wizard_document(**changes: object) -> dict[str, object]:
    document = {
        "format": "spherecal/wizard", "version": 1, "source": "replay:nowhere", "step": "place", "cameras": ["S1"],
        "looked": [], "placements": ["P1"], "scale_poses": [], "check_poses": [],
    }  # fmt: skip
    return {**document, **changes}


def hostile_project(folder: Path, set_id: str) -> Path:
    """A project whose set of this id was cut short while it was taken again: opening it brings the older one back."""
    aside = folder / "removed" / "x-1"
    (aside / "images").mkdir(parents=True)
    (aside / "images" / "C01.png").write_text("the sender's")
    (aside / "retaking").touch()
    (aside / "set.json").write_text(json.dumps({"id": set_id, "taken": "t", "images": {"C01": "placements/P1/x.png"}}))
    (folder / "wizard.json").write_text(json.dumps(wizard_document(placements=[set_id])))
    captured = {"format": "spherecal/capture", "version": 1, "cameras": [{"id": "C01", "serial": "S1"}], "sets": []}
    (folder / "capture.json").write_text(json.dumps(captured))
    return folder


@pytest.mark.parametrize("name", ["{precious}", "../../precious", "../precious"])
def test_a_strangers_project_replaces_no_folder(tmp_path: Path, precious: Path, name: str) -> None:
    set_id = name.format(precious=precious)
    folder = hostile_project(tmp_path / "project", set_id)
    before = contents(precious)
    with pytest.raises(InputError, match="placements"):
        project_folder.load_project(folder)
    plan = CapturePlan((PlannedSet(set_id),), None, {})
    with pytest.raises(InputError, match="id"):  # not even if the project had let it through
        recorded.RecordedSession(folder, plan, (SessionCamera("S1", ENTRY),), SOURCE).start()
    assert contents(precious) == before


def test_the_store_of_dots_writes_nothing_outside(tmp_path: Path, precious: Path) -> None:
    before = contents(precious)
    store = DotStore(tmp_path / "project")
    (tmp_path / "project").mkdir()
    for set_id in (f"{precious}/dots", "../../precious/dots"):
        store.save(set_id, "now", {})
        assert store.load(set_id, "now") is None
    (tmp_path / "project" / "wizard").symlink_to(precious)
    store.save("dots", "now", {})
    assert contents(precious) == before


@pytest.mark.parametrize("where", ["capture.json", "verification/capture.json"])
def test_ids_in_capture_files_are_names(tmp_path: Path, where: str) -> None:
    path = tmp_path / where
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps({"sets": [{"id": "../../x", "taken": "t", "images": {"C01": "x.png"}}]}))
    with pytest.raises(InputError, match="sets"):
        project_folder.taken_in(tmp_path)


def test_a_set_of_a_removed_folder_is_only_brought_back_by_its_id(tmp_path: Path, precious: Path) -> None:
    folder = hostile_project(tmp_path / "project", "../../precious")
    before = contents(precious)
    plan = CapturePlan((PlannedSet("P1"),), None, {})
    session = recorded.RecordedSession(folder, plan, (SessionCamera("S1", ENTRY),), SOURCE)
    session.start()
    assert contents(precious) == before
    assert session.to_take == (PlannedSet("P1"),)


@pytest.mark.parametrize("link", ["placements", "removed", "result", "wizard", "verification", "bars"])
def test_a_project_with_a_linked_folder_is_not_opened(tmp_path: Path, precious: Path, link: str) -> None:
    (tmp_path / "wizard.json").write_text(json.dumps(wizard_document()))
    (tmp_path / link).symlink_to(precious)
    with pytest.raises(InputError, match=link):
        project_folder.load_project(tmp_path)


@pytest.mark.parametrize("name", ["session.json", "targets.json", "capture.json", "wizard.json"])
def test_links_in_a_session_are_not_written_through(tmp_path: Path, precious: Path, name: str) -> None:
    from spherecal.targets.family import make_target_set

    before = contents(precious)
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / name).symlink_to(precious / "thesis.tex")
    plan = CapturePlan((PlannedSet("P1"),), make_target_set(3), {})
    session = recorded.RecordedSession(folder, plan, (SessionCamera("S1", ENTRY),), SOURCE)
    write = {"wizard.json": lambda: project_folder.save_project(project.Project(folder, "replay:x"))}
    with pytest.raises(InputError):
        write.get(name, session.start)()
    assert contents(precious) == before
    assert (folder / name).is_symlink()


def test_a_set_is_not_written_through_a_linked_folder(tmp_path: Path, precious: Path) -> None:
    before = contents(precious)
    folder = tmp_path / "session"
    session = SessionFolder(folder, CapturePlan((PlannedSet("P1"),), None, {}), (SessionCamera("S1", ENTRY),), SOURCE)
    session.start(take_up=False)
    (folder / "placements").symlink_to(precious)
    with pytest.raises(SpherecalError, match="link"):
        session.add(PlannedSet("P1"), frames())
    assert contents(precious) == before


# --- 2: a stranger's profile -----------------------------------------------------------------------------------------


@pytest.fixture
def profile(tmp_path: Path) -> Path:
    folder = tmp_path / "profile"
    save_result(create_profile(folder), result_folder(tmp_path / "r1"))
    return apply(open_profile(folder), "0001").folder


def test_showing_a_profile_writes_nothing(profile: Path, precious: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = contents(precious)
    (profile / "rig.json").unlink()
    (profile / "rig.json").symlink_to(precious / "authorized_keys")
    inside = contents(profile)
    for command in ("show", "list", "trend"):
        main(["profile", command, str(profile)])
    assert contents(precious) == before
    assert contents(profile) == inside
    assert "not the rig in use" in capsys.readouterr().out
    assert main(["profile", "apply", str(profile), "0001"]) == 2
    assert contents(precious) == before


def test_what_a_link_leads_to_is_not_saved_in_a_profile(tmp_path: Path, precious: Path, profile: Path) -> None:
    folder = result_folder(tmp_path / "r2")
    (folder / "bars.csv").symlink_to(precious / "secret.key")
    assert main(["profile", "save", str(folder), "--to", str(profile)]) == 2
    assert not [name for name, data in contents(profile).items() if b"years of work" in data]


def test_a_pipe_in_a_profile_stops_nobody(profile: Path) -> None:
    (profile / "rig.json").unlink()
    os.mkfifo(profile / "rig.json")
    assert main(["profile", "show", str(profile)]) == 0
    (profile / "profile.json").unlink()
    os.mkfifo(profile / "profile.json")
    assert main(["profile", "show", str(profile)]) == 2


# --- 4: the output folder --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stranger", [".git/config", "notes.txt", "images/a.png", "empty/", "link"])
def test_a_result_with_anything_else_is_not_replaced(tmp_path: Path, precious: Path, stranger: str) -> None:
    from spherecal_files.atomic import RESULT, check_folder, write_folder_whole

    folder = result_folder(tmp_path / "out")
    place = folder / stranger
    if stranger == "link":
        place.symlink_to(precious)
    elif stranger.endswith("/"):
        place.mkdir()
    else:
        place.parent.mkdir(exist_ok=True)
        place.write_text("mine")
    before = contents(folder)
    with pytest.raises(OutputError, match="did not write there"):
        check_folder(folder, RESULT)
    with pytest.raises(OutputError, match="did not write there"):
        write_folder_whole(folder, lambda new: None, RESULT)
    assert contents(folder) == before
    assert contents(precious)


def test_a_recorded_session_is_never_replaced_by_a_simulated_one(tmp_path: Path) -> None:
    from spherecal_files.atomic import SESSION, check_folder

    (tmp_path / "recorded").mkdir()
    folder = make_session(tmp_path / "recorded", VALID)
    with pytest.raises(OutputError):
        check_folder(folder, SESSION)
    (folder / "truth.json").write_text("{}")
    check_folder(folder, SESSION)


# --- folders that cannot be listed -----------------------------------------------------------------------------------


def test_a_folder_that_cannot_be_listed_stops_no_support_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, listed = result_folder(tmp_path / "result"), os.scandir
    (folder / "closed").mkdir()

    def closed(path: Path) -> object:
        if Path(path).name == "closed":
            raise PermissionError(13, "Permission denied", str(path))
        return listed(path)

    monkeypatch.setattr(os, "scandir", closed)
    found, _ = bundle_files(folder, "", "")
    assert set(found) == {"project/rig.json", "about.txt", "log.txt"}
    with pytest.raises(OutputError, match="permission denied"):  # as a folder to be replaced it is refused
        check_folder(folder, RESULT)
