"""Driver files are code: which ones were allowed, by the hash of their contents, and who is asked about new ones.

Our own (the environment's packages, the simulated producer) need no leave. Any other file is asked about once, where
somebody can be asked; its hash is kept in `drivers.json` in the user's configuration folder. Where nobody can (in a
script) a new file that somebody chose, by name, by GENICAM_GENTL64_PATH or by installing its maker's driver, is loaded,
kept and reported; one whose contents have changed since it was allowed, or that any user of the computer could
exchange, is not.
"""

import hashlib
import json
import logging
import os
import stat
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from spherecal.errors import InputError, OutputError
from spherecal.session.atomic import write_file_whole
from spherecal.session.json_file import read_json

FORMAT = "spherecal/drivers"
VERSION = 1
_CHUNK = 1 << 20

State = Literal["own", "known", "new", "changed", "unsafe", "unreadable"]

log = logging.getLogger("spherecal")


@dataclass(frozen=True)
class Driver:
    """A driver file as it stands: its real path, the hash of its contents ("" where it cannot be read), its state."""

    file: str
    sha256: str
    state: State


Ask = Callable[[Driver], bool]


@dataclass(frozen=True)
class Refusal:
    """Why a driver is not loaded, and what to do."""

    message: str
    hint: str


class TrustStore:
    """The files that were allowed: real path -> hash, in `path`. Reading a damaged list raises InputError."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or default_trust_path()
        self._allowed = _read(self.path)

    def allowed(self) -> Mapping[str, str]:
        """The hashes by real path."""
        return dict(self._allowed)

    def look(self, file: str) -> Driver:
        """A driver file as it stands now."""
        real = os.path.realpath(file)
        if is_own(real):
            return Driver(real, "", "own")
        try:
            digest = file_hash(real)
        except OSError:
            return Driver(real, "", "unreadable")
        if anybody_may_change(real):
            return Driver(real, digest, "unsafe")
        known = self._allowed.get(real)
        return Driver(real, digest, "new" if known is None else "known" if known == digest else "changed")

    def allow(self, driver: Driver) -> None:
        """Remember this file with these contents; a list that cannot be written costs only the remembering."""
        self._allowed[driver.file] = driver.sha256
        self._write()

    def forget(self, file: str) -> bool:
        """Take a file off the list; whether it was there."""
        if self._allowed.pop(os.path.realpath(file), None) is None:
            return False
        self._write()
        return True

    def _write(self) -> None:
        entries = [{"file": file, "sha256": digest} for file, digest in sorted(self._allowed.items())]
        document = {
            "format": FORMAT, "version": VERSION, "drivers": entries,
            "written_at": datetime.now(UTC).isoformat(timespec="seconds"),
        }  # fmt: skip
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_file_whole(self.path, (json.dumps(document, indent=1) + "\n").encode())
        except (OSError, OutputError) as error:  # a home folder that is read-only
            log.warning("the list of allowed drivers cannot be kept: %s", error)


def refusal(store: TrustStore, file: str, ask: Ask | None) -> Refusal | None:
    """None where a driver may be loaded; asks about a new or changed one, and remembers the answer yes."""
    driver = store.look(file)
    if driver.state in ("own", "known", "unreadable"):  # whoever loads it says why it cannot be read
        return None
    if driver.state == "unsafe":
        return Refusal(
            "Any user of this computer can change this file, so it is not loaded.",
            f"Have it or its folder protected (chmod o-w {driver.file}), or install the driver anew.",
        )
    if ask is not None:
        if ask(driver):
            store.allow(driver)
            return None
        return Refusal("You did not allow this driver.", f"To allow it: spherecal cameras trust {driver.file}")
    if driver.state == "changed":
        return Refusal(
            "This file is not the one that was allowed: its contents have changed, so it is not loaded.",
            f"If the driver was updated: spherecal cameras trust {driver.file}",
        )
    store.allow(driver)
    log.warning("new driver loaded and remembered: %s (sha256 %s)", driver.file, driver.sha256)
    return None


def is_own(real: str) -> bool:
    """Whether a file belongs to this program: to its Python environment or bundle, or as it built it itself."""
    from spherecal.cameras.producer.build import CTI_FILE, built_producers

    folders = {os.path.realpath(sys.prefix), os.path.realpath(Path(__file__).parents[3])}
    if any(real.startswith(folder + os.sep) for folder in folders):
        return True
    if os.path.basename(real) != CTI_FILE:
        return False
    try:
        return file_hash(real) in {file_hash(str(file)) for file in built_producers()}
    except OSError:
        return False


def anybody_may_change(real: str) -> bool:
    """Whether the file or its folder may be written by everybody (Windows decides by other means: never there)."""
    if os.name == "nt":
        return False
    for path, sticky_helps in ((real, False), (os.path.dirname(real), True)):
        try:
            mode = os.stat(path).st_mode
        except OSError:
            return False
        if mode & stat.S_IWOTH and not (sticky_helps and mode & stat.S_ISVTX):
            return True
    return False


def file_hash(path: str) -> str:
    """The SHA-256 of a file; OSError where it cannot be read."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def default_trust_path() -> Path:
    """Where the list is kept: SPHERECAL_DRIVERS, else the user's configuration folder."""
    from platformdirs import user_config_path

    named = os.environ.get("SPHERECAL_DRIVERS")
    return Path(named) if named else user_config_path("spherecal", appauthor=False) / "drivers.json"


def _read(path: Path) -> dict[str, str]:
    if not path.exists():
        return {}
    try:
        entries = read_json(path, FORMAT, VERSION).fields(("drivers",))["drivers"].items()
        fields = [entry.fields(("file", "sha256")) for entry in entries]
        return {f["file"].text(): f["sha256"].text() for f in fields}
    except InputError as error:
        raise InputError(error.message, f"Delete {path}; you will be asked about the drivers again.") from error
