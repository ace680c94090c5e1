"""Which driver files (.cti) may be loaded, and the private copies that they are loaded from."""

import atexit
import hashlib
import json
import logging
import os
import re
import secrets
import stat
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Literal

from spherecal.base.errors import InputError, OutputError
from spherecal.base.messages.values import Phrase
from spherecal_files.atomic import write_file_whole
from spherecal_files.cache_folder import cache_folder
from spherecal_files.codec import FileFormat, field, items, only, record, text, unread
from spherecal_files.filesystem import PARTIAL, new_file, remove_own_folder
from spherecal_files.programs import process_runs
from spherecal_files.registry import settings_path

_CHUNK = 1 << 20
_MOST_BYTES = 1 << 30
_MOST_NEIGHBOURS = 20_000  # of one folder
_NAME = re.compile(rf"\.(\d+)-[0-9a-f]+{re.escape(PARTIAL)}")
_made: dict[tuple[str, str], str] = {}


class NotTheSame(Exception):
    """The file is not the one that was looked at."""


def hash_of(path: str) -> str:
    """The SHA-256 of a regular file."""
    digest = hashlib.sha256()
    with open(_opened(path), "rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def _opened(path: str) -> int:
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(path, os.O_RDONLY | flags)
    state = os.fstat(descriptor)
    if not stat.S_ISREG(state.st_mode) or state.st_size > _MOST_BYTES:
        os.close(descriptor)
        raise OSError("it is no regular file, or far too large")
    return descriptor


def private_copy(real: str, sha256: str) -> str:
    """The path of a copy of a driver file, with links to its neighbours; on Windows its own, which `hold` keeps."""
    if os.name == "nt":
        return real
    made = _made.get((real, sha256))
    if made is not None:
        with suppress(OSError):
            if hash_of(made) == sha256:
                return made
    tree = _new_tree()
    relative = Path(*Path(real).parts[1:])
    digest = hashlib.sha256()
    with open(_opened(real), "rb") as source, new_file(tree, relative.as_posix()) as copy:
        while chunk := source.read(_CHUNK):
            digest.update(chunk)
            copy.write(chunk)
        os.fchmod(copy.fileno(), 0o500)
    if digest.hexdigest() != sha256:
        remove_own_folder(tree)
        raise NotTheSame(real)
    # beside the copy, and beside each folder above it, links to the original files and folders there
    for above in (relative, *relative.parents[:-1]):
        with suppress(OSError), os.scandir(Path("/") / above.parent) as scan:
            for number, entry in enumerate(scan):
                if number == _MOST_NEIGHBOURS:
                    break
                if entry.name != above.name:
                    with suppress(OSError):
                        (tree / above.parent / entry.name).symlink_to(entry.path)
    if not _made:
        atexit.register(_remove_copies)
    _made[real, sha256] = str(tree / relative)
    return _made[real, sha256]


def _new_tree() -> Path:
    """An empty folder that only we can enter; what programs that have ended left there goes."""
    base = cache_folder("drivers")
    base.mkdir(mode=0o700, parents=True, exist_ok=True)
    state = base.lstat()
    if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.getuid():
        raise OSError(f"{base} is not ours")
    base.chmod(0o700)
    for old in base.iterdir():
        owner = _NAME.fullmatch(old.name)
        if owner and not process_runs(int(owner[1])):
            remove_own_folder(old)
    tree = base / f".{os.getpid()}-{secrets.token_hex(6)}{PARTIAL}"
    tree.mkdir(mode=0o700)
    return tree


def _remove_copies() -> None:
    with suppress(OSError):
        for tree in cache_folder("drivers").glob(f".{os.getpid()}-*{PARTIAL}"):
            remove_own_folder(tree)


def hold(path: str) -> None:
    """On Windows, keep a file from being written, renamed or removed for as long as this process lives."""
    if os.name != "nt":
        return
    import ctypes

    read, share_read, open_existing = 0x80000000, 0x1, 3
    handle = ctypes.windll.kernel32.CreateFileW(path, read, share_read, None, open_existing, 0, None)  # type: ignore[attr-defined]
    if handle in (-1, 0xFFFFFFFF):
        raise OSError(f"{path} is being changed")


State = Literal["own", "known", "new", "changed", "unsafe", "unreadable"]

log = logging.getLogger("spherecal")


@dataclass(frozen=True)
class Driver:
    """A driver file as it is now: its real path, the hash of its contents ("" where it cannot be read), its state."""

    file: str
    sha256: str
    state: State


Ask = Callable[[Driver], bool]


@dataclass(frozen=True)
class Refusal:
    """Why a driver is not loaded, and what to do; `allowable`: somebody only has to allow it."""

    message: str
    hint: str
    allowable: bool = False


_DRIVER = record(
    "",
    partial(Driver, state="known"),
    field("file", text("Its real path.")),
    field("sha256", text("SHA-256 of its contents.")),
)
DRIVERS = FileFormat(
    "spherecal/drivers",
    "drivers.json",
    "Camera drivers that were allowed, in the user's settings.",
    only(
        "drivers",
        items("The driver files.", _DRIVER),
        unread("written_at", "When the file was written.", lambda _: datetime.now(UTC).isoformat(timespec="seconds")),
    ),
    more="cameras.md",
)


class TrustStore:
    """The files that were allowed: real path -> hash."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or settings_path("SPHERECAL_DRIVERS", DRIVERS.file)
        self._allowed = _read(self.path)

    def allowed(self) -> Mapping[str, str]:
        """The hashes by real path."""
        return dict(self._allowed)

    def look(self, file: str) -> Driver:
        """A driver file as it is now, with its state."""
        real = os.path.realpath(file)
        if is_own(real):
            return Driver(real, "", "own")
        try:
            digest = hash_of(real)
        except OSError:
            return Driver(real, "", "unreadable")
        if _is_built(real, digest):
            return Driver(real, digest, "own")
        if who_may_change(real):
            return Driver(real, digest, "unsafe")
        known = self._allowed.get(real)
        return Driver(real, digest, "new" if known is None else "known" if known == digest else "changed")

    def allow(self, driver: Driver) -> None:
        """Remember this file with these contents; a list that cannot be written is logged and raises nothing."""
        self._allowed[driver.file] = driver.sha256
        self._write()

    def forget(self, file: str) -> bool:
        """Take a file off the list; whether it was there."""
        if self._allowed.pop(os.path.realpath(file), None) is None:
            return False
        self._write()
        return True

    def _write(self) -> None:
        document = DRIVERS.document([Driver(file, own, "known") for file, own in sorted(self._allowed.items())])
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_file_whole(self.path, (json.dumps(document, indent=1) + "\n").encode())
        except (OSError, OutputError) as error:  # a home folder that is read-only
            log.warning("the list of allowed drivers cannot be kept: %s", error)


@dataclass(frozen=True)
class Admitted:
    """A driver that may be loaded: the file it is known by, what to load, and its hash ("" for our own files)."""

    file: str
    load: str
    sha256: str


def admit(store: TrustStore, file: str, ask: Ask | None) -> Admitted | Refusal:
    """A private copy of an allowed driver file, else why not; `ask` None: a new one is allowed and remembered."""
    driver = store.look(file)
    if (reason := _refusal(store, driver, ask)) is not None:
        return reason
    if not driver.sha256:
        return Admitted(file, driver.file, "")
    try:
        return Admitted(file, private_copy(driver.file, driver.sha256), driver.sha256)
    except NotTheSame:
        return Refusal("This file changed while it was looked at, so it is not loaded.", "Look for cameras again.")
    except (OSError, InputError) as error:
        return Refusal(f"This file cannot be copied to be loaded ({error}).", "Free the disk, look for cameras again.")


def admit_again(store: TrustStore, file: str) -> Admitted | Refusal:
    """As `admit`, where nobody is asked: only what was allowed before, with the same contents, is loaded."""
    if store.look(file).state in ("own", "known"):
        return admit(store, file, lambda _: False)
    return Refusal("This driver is not the one that was allowed, so it is not loaded.", "Look for cameras again.")


def _refusal(store: TrustStore, driver: Driver, ask: Ask | None) -> Refusal | None:
    if driver.state in ("own", "known"):
        return None
    if driver.state == "unreadable":
        return Refusal("This file cannot be read, so it cannot be judged and is not loaded.", "Check its permissions.")
    if driver.state == "unsafe":
        return Refusal(
            f"{who_may_change(driver.file)}, so it is not loaded.",
            f"Have it protected (chmod go-w, chown root, of {driver.file} and the folders above it), or install the "
            "driver again.",
        )
    if ask is not None and not ask(driver):
        return Refusal("You did not allow this driver.", f"To allow it: spherecal cameras trust {driver.file}", True)
    if ask is None and driver.state == "changed":
        return Refusal(
            "This file is not the one that was allowed: its contents have changed, so it is not loaded.",
            f"If the driver was updated: spherecal cameras trust {driver.file}",
            allowable=True,
        )
    store.allow(driver)
    if ask is None:
        log.warning("new driver loaded and remembered: %s (sha256 %s)", driver.file, driver.sha256)
    return None


def is_own(real: str) -> bool:
    """Whether a file belongs to this program: to its Python environment or bundle."""
    folders = {os.path.realpath(sys.prefix), os.path.realpath(Path(__file__).parents[2])}
    return any(real.startswith(folder + os.sep) for folder in folders)


def _is_built(real: str, digest: str) -> bool:
    """Whether it has the contents of a simulated producer that this program has built."""
    from spherecal_gentl.producer.build_producer import CTI_FILE, built_producers

    if os.path.basename(real) != CTI_FILE:
        return False
    try:
        return digest in {hash_of(str(file)) for file in built_producers()}
    except OSError:
        return False


def who_may_change(real: str) -> str:
    """Who else may exchange a file, by it and every folder above it, in words; empty: nobody, or Windows."""
    if os.name == "nt":
        return ""
    trusted = {0, os.getuid()}
    for path in (real, *map(str, Path(real).parents)):
        try:
            state = os.lstat(path)
        except OSError:
            return f"{path} cannot be looked at"
        if state.st_uid not in trusted:
            return f"{path} belongs to another user ({_user_name(state.st_uid)})"
        sticky = path != real and state.st_mode & stat.S_ISVTX  # there only its owner renames a file
        if state.st_mode & stat.S_IWOTH and not sticky:
            return f"Any user of this computer can change {path}"
        if state.st_mode & stat.S_IWGRP and not sticky and not _is_own_group(state.st_gid):
            return f"The group {state.st_gid} can change {path}"
    return ""


def _user_name(number: int) -> str:
    import pwd

    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


def _is_own_group(number: int) -> bool:
    """Whether a group has no members but the user and the administrator, as many systems make one for each user."""
    import grp
    import pwd

    try:
        users = [user for user in pwd.getpwall() if user.pw_gid == number]
        members = {pwd.getpwnam(name).pw_uid for name in grp.getgrgid(number).gr_mem}
    except KeyError:
        return False
    return {user.pw_uid for user in users} | members <= {0, os.getuid()}


def _read(path: Path) -> dict[str, str]:
    if not path.exists():
        return {}
    try:
        return {one.file: one.sha256 for one in DRIVERS.read(path)}
    except InputError as error:
        raise InputError(error.parts[0], Phrase("error-delete-trust", {"file": path})) from error
