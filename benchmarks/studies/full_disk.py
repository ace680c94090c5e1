"""A full disk and a folder that may only be read, by the operating system itself: what is said, what is left."""

import hashlib
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from spherecal.base.errors import SpherecalError
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import rig_bytes
from spherecal_rigs.kept_checks import keep_check
from spherecal_rigs.save_entry import save_result
from spherecal_rigs.store import apply, create_profile, open_profile
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from tests.export_rigs import make_rig

_NOBODY = 65534
_DISK = "2m"


@dataclass(frozen=True)
class Refusal:
    """One writing that the system refused: what, why, what was said, and whether all that stood there still stands."""

    action: str
    cause: str
    said: str
    intact: bool

    @property
    def clear(self) -> bool:
        """Whether it was said in words, with the folder or file and the cause."""
        return bool(re.search(r"no space left|permission denied|read-only|file too large", self.said.lower()))


def refusals(folder: Path) -> list[Refusal]:
    """A profile saved to and applied, a check kept, a session written: on a full disk and in a read-only folder."""
    found = []
    with small_disk(folder / "disk") as disk:
        if disk is not None:
            found += _on(disk, "full disk", _fill)
    (folder / "closed").mkdir()
    found += _on(folder / "closed", "read-only folder", _close)
    return found


@contextmanager
def small_disk(folder: Path) -> Iterator[Path | None]:
    """A file system of 2 MB of its own; None where the system does not let us mount one."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={_DISK}", "tmpfs", str(folder)]
    able = os.name != "nt" and shutil.which("mount") is not None
    mounted = able and subprocess.run(mount, check=False, capture_output=True).returncode == 0
    try:
        yield folder if mounted else None
    finally:
        if mounted:
            subprocess.run(["umount", str(folder)], check=True)


def _on(place: Path, cause: str, break_it: Callable[[Path], None]) -> list[Refusal]:
    """What stands there before the disk is full or closed must stand there after every refused writing."""
    options = SimulationOptions(targets=12, placements=2, bar_poses=1)
    session, truth = simulate_session("demo", 1, options)
    results = [place / f"r{i}" for i in (1, 2)]
    for i, result in enumerate(results):
        result.mkdir()
        (result / "rig.json").write_bytes(rig_bytes(make_rig(5, 40, i)))
    profile = place / "profile"
    create_profile(profile)
    save_result(open_profile(profile), results[0])
    saved = save_result(open_profile(profile), results[1])
    apply(open_profile(profile), "0001")
    write_session(session, truth, place / "session")
    check = {"verdict": "ok", "sentence": "", "tolerance_mm": None, "cameras": [], "balls": [], "lengths": []}
    break_it(place)
    actions: dict[str, Callable[[], object]] = {
        "profile save": lambda: save_result(open_profile(profile), results[0]),
        "profile apply": lambda: apply(open_profile(profile), saved),
        "check kept": lambda: keep_check(profile, "0001", check, None),
        "session written again": lambda: write_session(session, truth, place / "session"),
        "new session": lambda: write_session(session, truth, place / "another"),
    }
    try:
        return [_refused(name, cause, place, action) for name, action in actions.items()]
    finally:
        _open_again(place)


def _refused(name: str, cause: str, place: Path, action: Callable[[], object]) -> Refusal:
    before = _contents(place)
    said = as_anybody(action)
    after = _contents(place)
    opened = open_profile(place / "profile")
    whole = opened.active_id == "0001" and not opened.problems and read_session(place / "session").observations
    return Refusal(name, cause, said, before == after and bool(whole))


def as_anybody(action: Callable[[], object]) -> str:
    """What an action says when it is refused, done by a process without the administrator's rights; "" where it works.

    An error that is no plain message comes as its type.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            if os.geteuid() == 0:
                os.setgid(_NOBODY)
                os.setuid(_NOBODY)
            try:
                action()
                said = ""
            except SpherecalError as error:
                said = str(error)
            except BaseException as error:
                said = f"TRACEBACK {type(error).__name__}: {error}"
            os.write(writing, said.encode()[:4000])
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        said = pipe.read().decode()
    os.waitpid(child, 0)
    return said


def _fill(place: Path) -> None:
    """Not a byte is left; whoever works there may."""
    for path in (place, *place.rglob("*")):
        path.chmod(0o777 if path.is_dir() else 0o666)
    blocks = b"\0" * 4096
    with (place / "filler").open("wb", buffering=0) as file:
        try:
            while True:
                file.write(blocks)
        except OSError:
            return


def _close(place: Path) -> None:
    for path in (place, *place.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)


def _open_again(place: Path) -> None:
    for path in (place, *place.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)


def _contents(place: Path) -> dict[str, str]:
    """Every file's hash."""
    files = (path for path in sorted(place.rglob("*")) if path.is_file())
    return {str(path.relative_to(place)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
