"""Driver files are code: which are loaded, who is asked, what is remembered."""

import json
import os
import shutil
import stat
import sys
from pathlib import Path

import pytest

from benchmarks.studies.hostile_drivers import flip_drivers
from spherecal.base.errors import InputError
from spherecal_app.cli import cameras_source as drivers
from spherecal_app.cli.main import main
from spherecal_cameras.genicam import trust
from spherecal_cameras.genicam.discovery import discover
from spherecal_cameras.genicam.trust import Ask, Driver, Refusal, TrustStore, admit, hash_of
from spherecal_gentl.producer import build_producer as build


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TrustStore:
    monkeypatch.setenv("SPHERECAL_DRIVERS", str(tmp_path / "config" / "drivers.json"))
    return TrustStore()


def refusal(store: TrustStore, file: str, ask: Ask | None) -> Refusal | None:
    found = admit(store, file, ask)
    return found if isinstance(found, Refusal) else None


@pytest.fixture
def driver(tmp_path: Path) -> str:
    """A file that no loader would take; it is never loaded here unless it is allowed."""
    folder = tmp_path / "maker"
    folder.mkdir(mode=0o755)
    file = folder / "maker.cti"
    file.write_bytes(b"\x7fELF nothing")
    return str(file)


def test_the_tests_keep_away_from_the_users_list() -> None:
    from platformdirs import PlatformDirs

    assert Path(os.environ["SPHERECAL_DRIVERS"]) == TrustStore().path
    home = Path(os.path.expanduser("~")) / ".config"
    assert home not in TrustStore().path.parents
    assert os.name == "nt" or home not in PlatformDirs("spherecal", appauthor=False).user_config_path.parents


def test_a_new_driver_is_asked_about_once_and_its_hash_is_kept(store: TrustStore, driver: str) -> None:
    asked: list[Driver] = []

    def yes(one: Driver) -> bool:
        asked.append(one)
        return True

    assert store.look(driver).state == "new"
    assert refusal(store, driver, yes) is None
    assert refusal(store, driver, yes) is None
    assert refusal(TrustStore(), driver, yes) is None  # another start of the program
    assert [one.file for one in asked] == [os.path.realpath(driver)]
    kept = json.loads(store.path.read_text(encoding="utf-8"))
    assert kept["drivers"] == [{"file": asked[0].file, "sha256": asked[0].sha256}]
    assert len(asked[0].sha256) == 64


def test_no_is_no_and_is_not_kept(store: TrustStore, driver: str) -> None:
    reason = refusal(store, driver, lambda one: False)
    assert reason is not None and "spherecal cameras trust" in reason.hint
    assert TrustStore().look(driver).state == "new"


def test_changed_contents_are_asked_about_again_and_not_loaded_unasked(store: TrustStore, driver: str) -> None:
    store.allow(store.look(driver))
    Path(driver).write_bytes(b"\x7fELF something else")
    assert store.look(driver).state == "changed"
    reason = refusal(store, driver, None)
    assert reason is not None and "contents have changed" in reason.message
    assert refusal(store, driver, lambda one: one.state == "changed") is None
    assert refusal(store, driver, None) is None


def test_unattended_a_chosen_new_driver_is_loaded_kept_and_told(store: TrustStore, driver: str, caplog) -> None:
    with caplog.at_level("WARNING", "spherecal"):
        assert refusal(store, driver, None) is None
    assert driver in caplog.text
    assert TrustStore().look(driver).state == "known"


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
@pytest.mark.parametrize("what", ["file", "folder"])
def test_what_everybody_can_change_is_never_loaded(store: TrustStore, driver: str, what: str) -> None:
    path = Path(driver) if what == "file" else Path(driver).parent
    store.allow(store.look(driver))
    path.chmod(path.stat().st_mode | stat.S_IWOTH)
    reason = refusal(store, driver, lambda one: True)
    assert reason is not None and "Any user" in reason.message


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
@pytest.mark.parametrize("level", [1, 2])
@pytest.mark.parametrize("what", ["everybody", "group", "owner"])
def test_the_folders_above_a_driver_are_judged_too(
    store: TrustStore, driver: str, tmp_path: Path, what: str, level: int
) -> None:
    """Who may write any folder above a file can put another one there."""
    folder = Path(driver).parents[level - 1]
    store.allow(store.look(driver))
    if what == "owner":
        if os.getuid() != 0:
            pytest.skip("only the administrator can give a folder away")
        os.chown(folder, 12345, -1)
    elif what == "group":
        if os.getuid() != 0:
            pytest.skip("only the administrator can give a folder to any group")
        os.chown(folder, -1, 12345)
        folder.chmod(0o775)
    else:
        folder.chmod(0o777)
    try:
        reason = refusal(store, driver, lambda one: True)
        assert reason is not None and str(folder) in reason.message
    finally:
        os.chown(folder, os.getuid(), os.getgid())
        folder.chmod(0o755)
    assert refusal(store, driver, None) is None


def test_what_cannot_be_read_is_not_loaded(store: TrustStore, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.cti")
    for name in ("pipe.cti", "missing.cti"):
        reason = refusal(store, str(tmp_path / name), lambda one: True)
        assert reason is not None and "cannot be read" in reason.message


def test_what_was_looked_at_is_what_is_loaded(store: TrustStore, driver: str, monkeypatch) -> None:
    """The path may lead elsewhere a moment later; a bare name is never left to the loader's own path."""
    (Path(driver).parent / "neighbour.so").write_text("beside it")
    monkeypatch.chdir(Path(driver).parent)
    admitted = trust.admit(store, "maker.cti", lambda one: True)
    assert isinstance(admitted, trust.Admitted) and os.path.isabs(admitted.load)
    Path(driver).write_bytes(b"\x7fELF exchanged")
    assert Path(admitted.load).read_bytes() == b"\x7fELF nothing"
    assert hash_of(admitted.load) == admitted.sha256
    assert (Path(admitted.load).parent / "neighbour.so").read_text() == "beside it"
    assert isinstance(trust.admit_again(store, driver), trust.Refusal)  # as at a restart of the camera process


def test_a_file_exchanged_between_the_look_and_the_copy_is_not_loaded(store: TrustStore, driver: str) -> None:
    def exchange(one: Driver) -> bool:
        Path(one.file).write_bytes(b"\x7fELF exchanged while somebody thinks about it")
        return True

    found = trust.admit(store, driver, exchange)
    assert isinstance(found, trust.Refusal) and "changed while" in found.message


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc to make a driver with")
def test_no_flip_of_a_link_gets_a_driver_loaded_unchecked(store: TrustStore, tmp_path: Path) -> None:
    """Few flips here, 200 in benchmarks/studies/hostile.md."""
    races = flip_drivers(3, tmp_path)
    assert races.loaded_unchecked == 0 and races.tries == 3


def test_our_own_need_no_leave(store: TrustStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = tmp_path / "cache"
    monkeypatch.setattr(build, "cache_folder", lambda name: cache)
    copy, forged = tmp_path / "copy" / build.CTI_FILE, tmp_path / "forged" / build.CTI_FILE
    for file, contents in ((cache / "abc" / build.CTI_FILE, b"ours"), (copy, b"ours"), (forged, b"theirs")):
        file.parent.mkdir(parents=True)
        file.write_bytes(contents)
    assert store.look(str(copy)).state == "own"
    assert store.look(str(forged)).state == "new"
    inside = Path(sys.prefix) / "lib" / "x.cti"
    assert trust.is_own(os.path.realpath(inside))


def test_a_driver_that_was_not_allowed_is_not_touched_by_discovery(store: TrustStore, driver: str) -> None:
    found = discover([driver], None, store, lambda one: False)
    assert [(v.usable, v.message) for v in found.producers] == [(False, "You did not allow this driver.")]
    allowed = discover([driver], None, store, lambda one: True)
    assert "cannot be loaded" in allowed.producers[0].message  # it was tried


def test_a_home_that_is_read_only_costs_only_the_remembering(driver: str, monkeypatch, caplog) -> None:
    monkeypatch.setenv("SPHERECAL_DRIVERS", "/proc/nowhere/drivers.json")
    with caplog.at_level("WARNING", "spherecal"):
        assert refusal(TrustStore(), driver, lambda one: True) is None
    assert "cannot be kept" in caplog.text


def test_a_damaged_list_is_named(store: TrustStore) -> None:
    store.path.parent.mkdir(parents=True)
    store.path.write_text("{", encoding="utf-8")
    with pytest.raises(InputError, match=r"drivers\.json.*Delete"):
        TrustStore()


def test_the_command_allows_lists_and_forgets(store: TrustStore, driver: str, capsys) -> None:
    assert main(["cameras", "trust", driver]) == 0
    assert main(["cameras", "trust"]) == 0
    assert os.path.realpath(driver) in capsys.readouterr().out
    assert main(["cameras", "trust", "--forget", driver]) == 0
    assert TrustStore().allowed() == {}
    assert main(["cameras", "trust", driver + "x"]) == 2


def test_the_terminal_is_asked_before_anything_is_loaded(store: TrustStore, driver: str, monkeypatch, capsys) -> None:
    import io

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdin", Terminal("y\n"))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.delenv("GENICAM_GENTL64_PATH", raising=False)
    ask = drivers.asked_before([driver])
    assert ask is not None
    assert ask(store.look(driver))
    assert "Load it" in capsys.readouterr().err
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert drivers.asked_before([driver]) is None
