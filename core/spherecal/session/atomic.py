"""Files and folders written whole or not at all."""

import ctypes
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from spherecal.errors import OutputError


@dataclass(frozen=True)
class Marker:
    """The file by which a folder written by this program is known again, and the `format` that stands in it."""

    file: str
    format: str


RESULT = Marker("rig.json", "spherecal/rig")
SESSION = Marker("session.json", "spherecal/session")


def write_file_whole(path: Path, data: bytes) -> None:
    """Write a file so that at every moment there is either the old one or the whole new one; OutputError if it fails.

    What is no regular file (a terminal, a pipe, /dev/null) is written to directly.
    """
    resolved = _resolve(path)
    with _plain_errors(path):
        if resolved.exists() and not resolved.is_file() and not resolved.is_dir():
            resolved.write_bytes(data)
            return
        partial = resolved.with_name(f".{resolved.name}.spherecal-partial")
        try:
            partial.write_bytes(data)
            _sync(partial)
            partial.replace(resolved)
            _sync(resolved.parent)
        finally:
            partial.unlink(missing_ok=True)


def write_folder_whole(folder: Path, build: Callable[[Path], None], marker: Marker) -> None:
    """Let `build` fill a new folder beside `folder`, then put it in its place.

    A missing or empty folder is filled, an older result (known by its marker) is replaced whole; OutputError, with
    nothing changed, for anything else or where the disk refuses. A crash leaves the old folder or the new one: they
    are exchanged in one step. Where the system cannot, the old one is moved aside, and moved back by the next
    `check_folder` if the crash came before the new one was there.
    """
    resolved = check_folder(folder, marker)
    partial = _partial(resolved)
    try:
        with _plain_errors(folder):
            partial.mkdir()
            build(partial)
            _sync_tree(partial)
            resolved.parent.mkdir(parents=True, exist_ok=True)
            _put_in_place(partial, resolved)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def check_folder(folder: Path, marker: Marker) -> Path:
    """Raise OutputError unless the folder may be written (see write_folder_whole); returns it with links resolved.

    To be asked before long work, so that it is not done in vain.
    """
    resolved = _resolve(folder)
    with _plain_errors(folder):
        _recover(resolved)
        if resolved.exists() and not resolved.is_dir():
            raise OutputError(f"{folder}: is a file, not a folder.", "Name another output folder.")
        if resolved.is_dir() and any(resolved.iterdir()) and not _is_older_result(resolved, marker):
            raise OutputError(
                f"{folder}: holds something else than a result of this program and is left as it is.",
                "Name a new or empty output folder.",
            )
        partial = _partial(resolved)
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        partial.rmdir()
    return resolved


def _resolve(path: Path) -> Path:
    """The path with links resolved, so that a link's goal is replaced and not the link."""
    try:
        resolved = Path(os.path.realpath(path))
    except ValueError:
        raise OutputError("A path cannot contain a null character.") from None
    if not resolved.name:
        raise OutputError(f"{path}: cannot be written to.", "Name another place.")
    return resolved


def _partial(folder: Path) -> Path:
    """Where the new folder is built: in the nearest folder that exists, hence on the same disk."""
    base = next(p for p in folder.parents if p.exists())
    return base / f".{folder.name}.spherecal-partial"


def _is_older_result(folder: Path, marker: Marker) -> bool:
    """Whether the marker's file is there and ours. A recording is never taken for an older result of something else."""
    if marker != SESSION and (folder / SESSION.file).exists():
        return False
    try:
        document = json.loads((folder / marker.file).read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(document, dict) and document.get("format") == marker.format


def _aside(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.spherecal-old")


def _recover(folder: Path) -> None:
    """Undo what a crash left: the old folder moved aside comes back, or goes if the new one is in place."""
    aside = _aside(folder)
    if not aside.is_dir():
        return
    if folder.exists():
        shutil.rmtree(aside)
    else:
        aside.rename(folder)


def _put_in_place(partial: Path, folder: Path) -> None:
    aside = _aside(folder)
    if folder.exists():
        if _exchange(partial, folder):  # the old one now has the partial one's name, and goes with it
            _sync(folder.parent)
            return
        folder.rename(aside)
    try:
        partial.rename(folder)
    except OSError:
        _recover(folder)
        raise
    _sync(folder.parent)
    shutil.rmtree(aside, ignore_errors=True)


def _exchange(a: Path, b: Path) -> bool:
    """Exchange two folders in one step, so that no moment has neither; False where the system cannot do it."""
    if sys.platform != "linux" or a.parent != b.parent:
        return False
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    at_here, exchange = -100, 2
    return rename(at_here, os.fsencode(a), at_here, os.fsencode(b), exchange) == 0


def _sync_tree(folder: Path) -> None:
    for parent, _, files in os.walk(folder):
        for name in files:
            _sync(Path(parent, name))
        _sync(Path(parent))


def _sync(path: Path) -> None:
    """Have the disk keep what was written; folders cannot be synchronised on Windows."""
    if os.name == "nt" and path.is_dir():
        return
    handle = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def _plain_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise OutputError(f"{path}: cannot be written ({reason}).", "Name another place.") from error
