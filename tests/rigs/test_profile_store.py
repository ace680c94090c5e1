"""A profile's folder: history, what is in use, restoring, crashes, hostile files."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.studies.profiles import kill_while_writing
from spherecal.base.errors import InputError, OutputError
from spherecal.data.rig import Rig
from spherecal_files.rig_file import rig_bytes
from spherecal_rigs import entry as entry_module
from spherecal_rigs import store
from spherecal_rigs.calibration_age import ValidityLimits
from spherecal_rigs.save_entry import SaveOptions, save_result
from spherecal_rigs.store import Profile, apply, copy_is_right, create_profile, open_profile, restore
from tests.export_rigs import make_rig


def result(folder: Path, seed: int = 1, valid: bool = True) -> Path:
    """A result folder with a rig and nothing else."""
    folder.mkdir(parents=True, exist_ok=True)
    rig = make_rig(5, 3, seed)
    (folder / "rig.json").write_bytes(rig_bytes(replace(rig, quality=replace(rig.quality, valid=valid))))
    return folder


@pytest.fixture
def profile(tmp_path: Path) -> Profile:
    """Three calibrations, of which the first and then the second were put to use."""
    made = create_profile(tmp_path / "profile", "Rig 7")
    for seed in (1, 2, 3):
        save_result(made, result(tmp_path / f"r{seed}", seed))
    made = apply(open_profile(made.folder), "0001")
    return apply(made, "0002")


def rig_of(path: Path) -> bytes:
    return (path / "rig.json").read_bytes()


def test_saving_changes_nothing_in_use(profile: Profile, tmp_path: Path) -> None:
    before = rig_of(profile.folder)
    assert save_result(profile, result(tmp_path / "r4", 4)) == "0004"
    again = open_profile(profile.folder)
    assert again.active_id == "0002"
    assert list(again.entries) == ["0001", "0002", "0003", "0004"]
    assert rig_of(profile.folder) == before == rig_of(tmp_path / "r2")


def test_apply_switches_and_keeps_the_events(profile: Profile, tmp_path: Path) -> None:
    changed = apply(profile, "0003", "after the move")
    assert [event.calibration for event in changed.applied] == ["0001", "0002", "0003"]
    assert changed.applied[-1].note == "after the move"
    assert rig_of(profile.folder) == rig_of(tmp_path / "r3")
    assert changed.rig().cameras[0].intrinsics.tolist() == make_rig(5, 3, 3).cameras[0].intrinsics.tolist()


def test_restore_goes_back_to_the_last_good_one(profile: Profile, tmp_path: Path) -> None:
    assert profile.last_good_id == "0001"
    back = restore(profile)
    assert (back.active_id, back.applied[-1].note) == ("0001", "restored")
    assert rig_of(profile.folder) == rig_of(tmp_path / "r1")
    assert restore(back).active_id == "0002"  # and forth again
    assert restore(back, "0003").active_id == "0003"


def test_a_calibration_that_is_not_valid_is_not_put_to_use(profile: Profile, tmp_path: Path) -> None:
    bad = save_result(profile, result(tmp_path / "bad", 5, valid=False))
    opened = open_profile(profile.folder)
    with pytest.raises(InputError, match="marked as not valid"):
        apply(opened, bad)
    assert open_profile(profile.folder).active_id == "0002"
    forced = apply(opened, bad, despite_findings=True)
    assert forced.last_good_id == "0002"
    good = apply(forced, "0003")
    assert good.last_good_id == "0002"  # never the one that is not valid


def test_there_may_be_nothing_to_restore(tmp_path: Path) -> None:
    made = create_profile(tmp_path / "p")
    with pytest.raises(InputError, match="no calibration is in use"):
        made.rig()
    save_result(made, result(tmp_path / "r"))
    only = apply(open_profile(tmp_path / "p"), "0001")
    with pytest.raises(InputError, match="no earlier valid calibration"):
        restore(only)
    with pytest.raises(InputError, match=r'no calibration "0009".*0001'):
        apply(only, "0009")


def test_a_changed_file_is_never_used(profile: Profile) -> None:
    path = profile.path_of("0003") / "rig.json"
    path.write_bytes(path.read_bytes().replace(b'"C1"', b'"CX"'))
    with pytest.raises(InputError, match="was changed after it was saved"):
        apply(profile, "0003")
    assert open_profile(profile.folder).active_id == "0002"


def test_the_copy_is_put_right(profile: Profile, tmp_path: Path) -> None:
    (profile.folder / "rig.json").write_bytes(b"{}")
    assert open_profile(profile.folder).active_id == "0002" and not copy_is_right(profile)
    apply(profile, "0002")
    assert rig_of(profile.folder) == rig_of(tmp_path / "r2")
    (profile.folder / "rig.json").unlink()
    assert open_profile(profile.folder).active_id == "0002" and not copy_is_right(profile)
    apply(profile, "0002")
    assert rig_of(profile.folder) == rig_of(tmp_path / "r2")


def test_in_use_is_what_rig_json_has(profile: Profile, tmp_path: Path) -> None:
    """As after a kill between the two renamings: the event in profile.json alone changes nothing."""
    before = (profile.folder / "rig.json").read_bytes()
    apply(profile, "0003")
    (profile.folder / "rig.json").write_bytes(before)
    opened = open_profile(profile.folder)
    assert opened.active_id == "0002" and copy_is_right(opened)
    assert rig_bytes(opened.rig()) != rig_bytes(profile.rig("0003"))


def test_an_entry_says_what_was_known(tmp_path: Path) -> None:
    made = create_profile(tmp_path / "p")
    at = datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)
    save_result(made, result(tmp_path / "r"), SaveOptions(temperature_c=21.25, note="new lens", calibrated_at=at))
    entry = open_profile(tmp_path / "p").entries["0001"]
    assert (entry.temperature_c, entry.note, entry.calibrated_at) == (21.25, "new lens", at)
    assert (entry.scale_source, entry.input_sha256, entry.valid, entry.rms_px) == ("bar", "ab" * 32, True, 0.06)
    assert [(camera.id, camera.serial) for camera in entry.cameras][:2] == [("C1", "50-0"), ("C2", "50-1")]
    assert entry.written_by


def test_two_processes_never_take_one_number(tmp_path: Path) -> None:
    made = create_profile(tmp_path / "p")
    source = result(tmp_path / "r")
    code = (
        "import sys; from pathlib import Path\n"
        "from spherecal_rigs.save_entry import save_result\nfrom spherecal_rigs.store import open_profile\n"
        "p = open_profile(Path(sys.argv[1]))\nprint(*[save_result(p, Path(sys.argv[2])) for _ in range(6)])\n"
    )
    command = [sys.executable, "-c", code, str(made.folder), str(source)]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) for _ in range(2)]
    said = [process.communicate(timeout=60)[0].split() for process in both]
    assert sorted(said[0] + said[1]) == [f"{i:04d}" for i in range(1, 13)]
    opened = open_profile(made.folder)
    assert len(opened.entries) == 12
    assert not opened.problems


def test_killed_while_writing(tmp_path: Path) -> None:
    """Few kills here, 100 in benchmarks/studies/profiles.md."""
    kills = kill_while_writing(3, tmp_path, seed=7)
    assert kills.problems == ()
    assert kills.added > 0


def test_what_a_kill_leaves_behind_is_no_calibration_and_is_swept_later(profile: Profile, tmp_path: Path) -> None:
    left = profile.folder / "history" / ".99999.spherecal-partial"
    left.mkdir()
    (left / "rig.json").write_text("{")
    assert list(open_profile(profile.folder).entries) == ["0001", "0002", "0003"]
    save_result(profile, result(tmp_path / "r4", 4))
    assert left.exists()  # it may be someone's work
    os.utime(left, (0, 0))
    save_result(profile, result(tmp_path / "r4", 4))
    assert not left.exists()


@pytest.mark.skipif(os.name == "nt", reason="os.fork")
def test_what_a_killed_apply_left_is_removed_by_the_next(profile: Profile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("spherecal_files.filesystem.os.replace", lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL))
    if (child := os.fork()) == 0:
        apply(profile, "0003")
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    monkeypatch.undo()
    assert list(profile.folder.glob(".*.spherecal-partial"))
    apply(open_profile(profile.folder), "0003")
    assert not list(profile.folder.glob(".*.spherecal-partial"))


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root writes everywhere")
def test_a_folder_that_cannot_be_written(profile: Profile, tmp_path: Path) -> None:
    (profile.folder / "history").chmod(0o500)
    try:
        with pytest.raises(OutputError, match="cannot be written"):
            save_result(profile, result(tmp_path / "r4", 4))
    finally:
        (profile.folder / "history").chmod(0o700)
    assert list(open_profile(profile.folder).entries) == ["0001", "0002", "0003"]


def test_a_full_disk_changes_nothing(profile: Profile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import errno

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    before = {path: path.read_bytes() for path in profile.folder.rglob("*") if path.is_file()}
    monkeypatch.setattr("spherecal_files.filesystem._create", full)
    with pytest.raises(OutputError, match="no space left"):
        save_result(profile, result_made(tmp_path))
    with pytest.raises(OutputError, match="no space left"):
        apply(profile, "0003")
    monkeypatch.undo()
    assert {path: path.read_bytes() for path in profile.folder.rglob("*") if path.is_file()} == before
    assert open_profile(profile.folder).active_id == "0002"


def result_made(tmp_path: Path) -> Path:
    return tmp_path / "r3"


def test_other_folders_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    with pytest.raises(OutputError, match="something other than a profile"):
        create_profile(tmp_path / "mine")
    with pytest.raises(InputError, match="is not a rig profile"):
        open_profile(tmp_path / "mine")
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError):
        create_profile(tmp_path / "file")


# What stands in a profile that the first version wrote must be readable for ever: tests/data/profile_v1.


def test_the_first_version_is_still_read() -> None:
    opened = open_profile(ROOT / "tests" / "data" / "profile_v1")
    assert (opened.name, opened.active_id, opened.last_good_id) == ("Golden rig", "0002", "0001")
    assert opened.limits == ValidityLimits(6.0, 24.0, 1.5, 3.0)
    assert not opened.problems
    first = opened.entries["0001"]
    assert (first.temperature_c, first.note, first.scale_artefact) == (21.5, "golden", "bar B (500 mm)")
    assert first.cameras[0].settings == {
        "exposure_us": 5000.0,
        "pixel_format": "Mono8",
        "region": [0.0, 0.0, 640.0, 480.0],
    }
    assert first.volume_mm == ((-1.0, -2.0, 3.0), (4.0, 5.0, 6.0))
    assert isinstance(opened.rig(), Rig)


def test_older_versions_are_migrated_step_by_step(profile: Profile, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if two later versions had renamed a field and then added one: the files on disk stay what they are."""

    def to_2(document: dict[str, Any]) -> dict[str, Any]:
        return {**document, "title": document["name"]}

    def to_3(document: dict[str, Any]) -> dict[str, Any]:
        return {**document, "name": document["title"] + " migrated", "version": document["version"]}

    monkeypatch.setattr(store, "PROFILE", replace(store.PROFILE, version=3, migrations={1: to_2, 2: to_3}))
    before = (profile.folder / "profile.json").read_bytes()
    opened = open_profile(profile.folder)
    assert opened.name == "Rig 7 migrated"
    assert (profile.folder / "profile.json").read_bytes() == before
    apply(opened, "0003")
    assert json.loads((profile.folder / "profile.json").read_bytes())["version"] == 3
    monkeypatch.setattr(store, "PROFILE", replace(store.PROFILE, migrations={2: to_3}))
    (profile.folder / "profile.json").write_bytes(before)
    with pytest.raises(InputError, match="has version 1, which can no longer be read"):
        open_profile(profile.folder)


def test_older_entries_are_migrated_too(profile: Profile, monkeypatch: pytest.MonkeyPatch) -> None:
    later = replace(entry_module.ENTRY, version=2, migrations={1: lambda document: {**document, "note": "migrated"}})
    monkeypatch.setattr(entry_module, "ENTRY", later)
    assert {entry.note for entry in open_profile(profile.folder).entries.values()} == {"migrated"}


def spoilt(path: Path, **changes: object) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


HOSTILE_PROFILES: dict[str, tuple[dict[str, object], str]] = {
    "escape": ({"applied": [{"calibration": "../../0001", "at": "2026-01-01T00:00:00+00:00"}]}, "calibration's number"),
    "huge": ({"applied": [{"calibration": "0001", "at": "2026-01-01T00:00:00+00:00"}] * 10_001}, "more than 10000"),
    "type": ({"applied": {"a": 1}}, "must be a list"),
    "time": ({"applied": [{"calibration": "0001", "at": "yesterday"}]}, "must be a time"),
    "zone": ({"applied": [{"calibration": "0001", "at": "2026-01-01T00:00:00"}]}, "time zone"),
    "later": ({"version": 99}, "written by a later version"),
    "other": ({"format": "spherecal/rig"}, 'is not a "spherecal/profile" file'),
    "name": ({"name": "../x"}, "slash"),
    "limits": ({"validity": {"ageing_hours": 9, "stale_hours": 5}}, "ageing not above stale"),
    "infinite": ({"validity": {"ageing_hours": -1}}, "must be 0 or more"),
}


@pytest.mark.parametrize("name", HOSTILE_PROFILES)
def test_hostile_profiles_are_refused(profile: Profile, name: str) -> None:
    changes, expected = HOSTILE_PROFILES[name]
    spoilt(profile.folder / "profile.json", **changes)
    with pytest.raises(InputError, match=expected):
        open_profile(profile.folder)


@pytest.mark.parametrize(
    ("text", "expected"),
    [("[" * 100_000, "nested too deeply"), ("{", "not valid JSON"), ("\x00", "not UTF-8 text"), ("{}", "is not a"),
     ('{"format": "spherecal/profile", "version": ' + "9" * 5000 + "}", "too many digits")],
)  # fmt: skip
def test_broken_profiles_are_refused(profile: Profile, text: str, expected: str) -> None:
    (profile.folder / "profile.json").write_text(text)
    with pytest.raises(InputError, match=expected):
        open_profile(profile.folder)


HOSTILE_ENTRIES: dict[str, tuple[dict[str, object], str]] = {
    "types": ({"quality": {"valid": "yes"}}, "true or false"),
    "cold": ({"temperature_c": -300}, "-100 to 200"),
    "cameras": ({"cameras": [{"id": "C1"}] * 1001}, "more than 1000"),
    "settings": ({"cameras": [{"id": "C1", "settings": {str(i): 1 for i in range(1001)}}]}, "more than 1000 settings"),
    "nested": ({"cameras": [{"id": "C1", "settings": {"a": {"b": 1}}}]}, "must be a number"),
    "volume": ({"volume_mm": [[1, 1, 1], [0, 0, 0]]}, "low corner first"),
    "files": ({"files_sha256": {"../../etc/passwd": "x"}}, 'lacks "rig.json"'),
    "later": ({"version": 7}, "later version"),
}


@pytest.mark.parametrize("name", HOSTILE_ENTRIES)
def test_one_broken_entry_does_not_hide_the_others(profile: Profile, name: str) -> None:
    changes, expected = HOSTILE_ENTRIES[name]
    spoilt(profile.path_of("0001") / "entry.json", **changes)
    opened = open_profile(profile.folder)
    assert list(opened.entries) == ["0002", "0003"]
    assert len(opened.problems) == 1
    assert expected in opened.problems[0]
    assert opened.active_id == "0002"


@pytest.mark.skipif(os.name == "nt", reason="links need rights on Windows")
def test_a_link_out_of_the_profile_is_refused(profile: Profile, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (profile.folder / "history" / "0009").symlink_to(tmp_path / "elsewhere")
    opened = open_profile(profile.folder)
    assert "0009" not in opened.entries
    assert "is not a folder of this profile" in opened.problems[0]


def test_a_result_that_cannot_be_used(profile: Profile, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        save_result(profile, tmp_path / "none")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "rig.json").write_text("{}")
    with pytest.raises(InputError, match="spherecal/rig"):
        save_result(profile, tmp_path / "bad")
    assert list(open_profile(profile.folder).entries) == ["0001", "0002", "0003"]


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


def places(value: object, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all values in a document."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, item in inner for place in places(item, (*path, key)))]


@given(st.sampled_from(["profile.json", "history/0001/entry.json"]), st.data())
def test_any_value_in_any_place_is_read_or_refused(tmp_path_factory, name: str, data: st.DataObject) -> None:
    folder = tmp_path_factory.getbasetemp() / "fuzzed-profile"
    if not folder.exists():
        shutil.copytree(ROOT / "tests" / "data" / "profile_v1", folder)
    source = (ROOT / "tests" / "data" / "profile_v1" / name).read_text()
    document = json.loads(source)
    path = data.draw(st.sampled_from(places(document)[1:]))
    value = document
    for key in path[:-1]:
        value = value[key]
    value[path[-1]] = data.draw(values)
    (folder / name).write_text(json.dumps(document))
    refused = None
    try:
        opened = open_profile(folder)
        refused = opened.problems[0] if opened.problems else None
    except InputError as error:
        refused = str(error)
    finally:
        (folder / name).write_text(source)
    assert refused is None or str(folder) in refused
