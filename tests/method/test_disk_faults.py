"""The disk refuses, or the program is killed, at every system call of a writing: what is left, and what is said."""

import errno
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks.studies.full_disk import as_anybody, small_disk
from spherecal.base.errors import OutputError
from spherecal_app.cli.main import main
from spherecal_files.atomic import RESULT, write_folder_whole
from spherecal_files.filesystem import create, write_below, write_together
from spherecal_files.rig_file import rig_bytes
from spherecal_rigs.save_entry import save_result
from spherecal_rigs.store import apply, copy_is_right, create_profile, open_profile, set_limits
from tests.disk_faults import at_call, die, refuse
from tests.export_rigs import make_rig

MOST_CALLS = 200
pytestmark = pytest.mark.skipif(os.name == "nt", reason="a process that is forked, and descriptors of folders")


def killed(action: Callable[[], object], number: int, after: bool) -> bool:
    """Whether a process of its own was killed at this call of an action."""
    child = os.fork()
    if child == 0:
        try:
            with at_call(number, die, after):
                action()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


@pytest.fixture
def used(tmp_path: Path) -> SimpleNamespace:
    """A profile of two calibrations, of which 0001 is in use; `fresh` gives a copy of it."""
    made = create_profile(tmp_path / "before")
    for seed in (1, 2):
        result = tmp_path / f"r{seed}"
        result.mkdir()
        (result / "rig.json").write_bytes(rig_bytes(make_rig(5, 3, seed)))
        save_result(made, result)
    apply(open_profile(made.folder), "0001")

    def fresh() -> Path:
        shutil.rmtree(tmp_path / "now", ignore_errors=True)
        shutil.copytree(made.folder, tmp_path / "now")
        return tmp_path / "now"

    return SimpleNamespace(fresh=fresh)


def test_a_refused_apply_says_what_is_in_use(used: SimpleNamespace) -> None:
    seen = set()
    for number in range(1, MOST_CALLS):
        folder = used.fresh()
        said = ""
        with at_call(number, refuse) as made:
            try:
                apply(open_profile(folder), "0002")
            except OutputError as error:
                said = str(error)
        opened = open_profile(folder)
        assert copy_is_right(opened) and opened.active_id in ("0001", "0002")
        assert not list(folder.glob("*.spherecal-partial"))
        assert opened.active_id == "0002" if not said else f"in use now: {opened.active_id}" in said
        seen.add((opened.active_id, bool(said)))
        if len(made) < number:
            break
    assert seen == {("0001", True), ("0002", True), ("0002", False)}


@pytest.mark.parametrize("after", [False, True])
def test_a_kill_in_apply_leaves_one_calibration_in_use(used: SimpleNamespace, after: bool) -> None:
    seen = []
    for number in range(1, MOST_CALLS):
        folder = used.fresh()
        was_killed = killed(lambda folder=folder: apply(open_profile(folder), "0002"), number, after)
        opened = open_profile(folder)
        assert copy_is_right(opened)
        seen.append(opened.active_id)
        set_limits(folder, stale_hours=99.0)  # the next writing keeps that state
        assert open_profile(folder).active_id == seen[-1] and copy_is_right(open_profile(folder))
        if not was_killed:
            break
    assert seen == sorted(seen) and set(seen) == {"0001", "0002"}


def test_a_refused_result_is_the_old_one_or_said_to_be_new(tmp_path: Path) -> None:
    """What `calibrate` and `verify` write."""
    result, seen = tmp_path / "result", set()

    def build(text: str) -> Callable[[Path], None]:
        def write(new: Path) -> None:
            create(new / "rig.json", b'{"format": "spherecal/rig"}')
            create(new / "bars.csv", text.encode())

        return write

    for number in range(1, MOST_CALLS):
        write_folder_whole(result, build("old"), RESULT)
        said = ""
        with at_call(number, refuse) as made:
            try:
                write_folder_whole(result, build("new"), RESULT)
            except OutputError as error:
                said = str(error)
        text = (result / "bars.csv").read_text()
        assert sorted(path.name for path in result.iterdir()) == ["bars.csv", "rig.json"]
        assert (text == "new") == ("in its place" in said or not said)
        seen.add((text, bool(said)))
        if len(made) < number:
            break
    assert seen == {("old", True), ("new", True), ("new", False)}


def test_a_file_of_the_users_is_the_old_one_or_said_to_be_new(tmp_path: Path) -> None:
    seen = set()
    for number in range(1, MOST_CALLS):
        (tmp_path / "a").write_text("old")
        said = ""
        with at_call(number, refuse) as made:
            try:
                write_below(tmp_path, "a", b"new")
            except OutputError as error:
                said = str(error)
        text = (tmp_path / "a").read_text()
        assert (text == "new") == ("in its place" in said or not said)
        seen.add((text, bool(said)))
        if len(made) < number:
            break
    assert seen == {("old", True), ("new", True), ("new", False)}


def test_file_systems_that_cannot_keep_folders_are_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As drives of Windows hosts and some network drives answer."""
    real = os.fsync

    def files_only(descriptor: int) -> None:
        if os.path.isdir(f"/proc/self/fd/{descriptor}"):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", files_only)
    write_together(tmp_path, {"a": b"a", "b": b"b"})
    assert (tmp_path / "a").read_bytes() + (tmp_path / "b").read_bytes() == b"ab"


def test_a_full_disk_leaves_the_calibration_in_use(used: SimpleNamespace, tmp_path: Path, capsys) -> None:
    """A real one: from no byte free to enough for all, a block at a time."""
    with small_disk(tmp_path / "disk") as disk:
        if disk is None:
            pytest.skip("this user may not mount a file system")
        codes = set()
        for free in range(0, 14):
            profile = disk / "profile"
            shutil.rmtree(profile, ignore_errors=True)
            shutil.copytree(used.fresh(), profile)
            with (disk / "filler").open("wb", buffering=0) as filler:
                with suppress(OSError):
                    while True:
                        filler.write(b"\0" * 4096)
                filler.truncate(filler.tell() - 4096 * free)
                code = main(["profile", "apply", str(profile), "0002"])
                filler.truncate(0)
            said = capsys.readouterr().err
            opened = open_profile(profile)
            assert copy_is_right(opened)
            assert opened.active_id == ("0001" if code else "0002")
            assert not code or "Calibration in use now: 0001." in said
            codes.add(code)
        assert codes == {0, 2}


def test_another_user_is_told_that_he_may_not(used: SimpleNamespace, tmp_path: Path) -> None:
    """What may be read is read; what may not be is not taken for something else."""
    if os.geteuid() != 0:
        pytest.skip("only the administrator can act as another user")
    shared = Path(tempfile.mkdtemp(dir="/tmp"))  # the tests' own folders are closed to others
    shared.chmod(0o755)
    try:
        folder = shared / "profile"
        shutil.copytree(used.fresh(), folder)
        assert as_anybody(lambda: open_profile(folder).rig()) == ""
        said = as_anybody(lambda: apply(open_profile(folder), "0002"))
        assert "permission denied" in said and "in use now: 0001" in said
        folder.chmod(0o700)
        assert "ermission denied" in as_anybody(lambda: open_profile(folder))
        assert "ermission denied" in as_anybody(lambda: create_profile(folder))
    finally:
        shutil.rmtree(shared)


def test_a_clock_put_back_leaves_nothing_behind(used: SimpleNamespace, tmp_path: Path) -> None:
    folder = used.fresh()
    left = folder / "history" / ".0123456789ab.spherecal-partial"
    left.mkdir()
    ahead = time.time() + 400 * 86400
    os.utime(left, (ahead, ahead))
    profile = folder / "profile.json"
    profile.write_text(profile.read_text().replace('"at": "20', '"at": "21'))  # the event before lies ahead
    save_result(open_profile(folder), tmp_path / "r1")
    assert apply(open_profile(folder), "0002").active_id == "0002"
    assert not left.exists()
