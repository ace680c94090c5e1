"""From a text in a file to a path, and every write, rename and removal: the one module that does them.

A folder that came from outside may hold links, pipes and names that lead elsewhere. The functions `..._below` take a
root folder that the user chose and a relative name. They walk to it without following a link: by `dir_fd` and
`O_NOFOLLOW` where the system has them, by a check of every part on Windows. What is not plain they refuse.
tests/installer/test_house.py keeps all other modules from writing or removing files on their own.
"""

import errno
import hashlib
import os
import re
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from spherecal.base.errors import InputError, OutputError, reason
from spherecal.base.file_reading import (
    LONGEST_ID,
    NO_WAIT,
    TO_READ,
    check_size,
    file_name_problem,
    id_problem,
    plain_reading,
    read_opened,
)
from spherecal.base.interrupts import uninterrupted
from spherecal.base.messages.values import Phrase

_DEEPEST = 16  # our own folders are 4 deep
_LONGEST_PATH = 500
PARTIAL = ".spherecal-partial"
_SCRATCH = re.compile(rf"\.[0-9a-f]{{12}}{re.escape(PARTIAL)}")
_LEFT_OVER_S = 3600.0  # a partial file that nobody has written to for so long is no writer's any more
_HAS_DIR_FD = os.open in os.supports_dir_fd and os.rename in os.supports_dir_fd and hasattr(os, "O_NOFOLLOW")
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
_IN_FOLDER = getattr(os, "O_DIRECTORY", 0) | _NO_LINK


# --- names -----------------------------------------------------------------------------------------------------------


def as_id(text: str, otherwise: str) -> str:
    """The text made an id: what cannot be part of one is replaced by `_`."""
    kept = "".join(c if c.isalnum() or c in "-_." else "_" for c in text).strip("._")[:LONGEST_ID]
    return kept if kept and id_problem(kept) is None else otherwise


def path_problem(text: str) -> Phrase | None:
    """Why a text cannot be a path below a folder, with "/" between its parts; None if it can."""
    if not text or len(text) > _LONGEST_PATH:
        return Phrase("problem-path-length", {"most": _LONGEST_PATH})
    if text.startswith("/") or "\\" in text or ":" in text.split("/", maxsplit=1)[0]:
        return Phrase("problem-path-relative")
    parts = text.split("/")
    if len(parts) > _DEEPEST:
        return Phrase("problem-path-deep", {"most": _DEEPEST})
    return next((problem for part in parts if (problem := file_name_problem(part))), None)


# --- walking without links -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Place:
    """A name in a folder that is held open (`folder`: its descriptor, None on Windows)."""

    root: Path
    relative: str
    folder: int | None
    parent: Path
    name: str

    @property
    def path(self) -> str:
        """What to hand to `os` functions together with `dir_fd=folder`."""
        return self.name if self.folder is not None else str(self.parent / self.name)

    def shown(self) -> str:
        return str(self.root / self.relative)

    def state(self) -> os.stat_result | None:
        """What is there, a link not followed; None where nothing is."""
        try:
            return os.stat(self.path, dir_fd=self.folder, follow_symlinks=False)
        except FileNotFoundError:
            return None

    def open(self, flags: int, mode: int = 0o666) -> int:
        return os.open(self.path, flags | _NO_LINK, mode, dir_fd=self.folder)


@contextmanager
def _place(root: Path, relative: str, make: bool = False) -> Iterator[_Place]:
    """Hold the folder of a name below `root` open; `make` makes missing folders. InputError for what is not plain."""
    if problem := path_problem(relative):
        raise InputError(Phrase("error-bad-path", {"folder": root, "path": shown_name(relative), "problem": problem}))
    *folders, name = PurePosixPath(relative).parts
    walk = _walk_held if _HAS_DIR_FD else _walk_checked
    with walk(root, folders, make) as (folder, parent):
        yield _Place(root, relative, folder, parent, name)


def shown_name(text: str) -> str:
    """A name in quotation marks, shortened and escaped, fit for a one-line message."""
    shown = text if len(text) <= 60 else text[:59] + "…"
    return '"' + "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in shown) + '"'


@contextmanager
def _walk_held(root: Path, folders: list[str], make: bool) -> Iterator[tuple[int | None, Path]]:
    held = os.open(root, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    path = root
    try:
        for name in folders:
            path = path / name
            if make:
                with suppress(FileExistsError):
                    os.mkdir(name, dir_fd=held)
            try:
                inner = os.open(name, os.O_RDONLY | _IN_FOLDER, dir_fd=held)
            except OSError as error:
                if error.errno in (errno.ELOOP, errno.ENOTDIR):
                    raise _not_plain(path) from None
                raise
            os.close(held)
            held = inner
        yield held, path
    finally:
        os.close(held)


@contextmanager
def _walk_checked(root: Path, folders: list[str], make: bool) -> Iterator[tuple[int | None, Path]]:
    path = root
    for name in folders:
        path = path / name
        if make:
            path.mkdir(exist_ok=True)
        state = path.lstat()
        if not stat.S_ISDIR(state.st_mode) or is_link(state):
            raise _not_plain(path)
    yield None, path


def is_link(state: os.stat_result) -> bool:
    """Whether this is a symbolic link, or a reparse point of Windows (junctions and mounts)."""
    reparse = getattr(stat, "FILE_ATTRIBUTE_REPARSE_POINT", 0)
    return stat.S_ISLNK(state.st_mode) or bool(getattr(state, "st_file_attributes", 0) & reparse)


def _not_plain(path: Path | str) -> InputError:
    return InputError(Phrase("error-not-plain", {"file": path}))


def is_plain_file_below(root: Path, relative: str) -> bool:
    """Whether a regular file is there, by a way without links; True where this user may not look: reading says so."""
    try:
        with _place(root, relative) as place:
            state = place.state()
            return state is not None and stat.S_ISREG(state.st_mode) and not is_link(state)
    except PermissionError:
        return True
    except (OSError, InputError):
        return False


# --- reading ---------------------------------------------------------------------------------------------------------


def read_below(root: Path, relative: str, most: int) -> bytes:
    """As `read_file`, of a file below a folder; no link on the way is followed."""
    with plain_reading(root / relative), _place(root, relative) as place:
        try:
            descriptor = place.open(os.O_RDONLY | NO_WAIT)
        except OSError as error:
            if error.errno == errno.ELOOP:
                raise _not_plain(place.shown()) from None
            raise
        return read_opened(descriptor, root / relative, most)


def file_sha256(path: Path, most: int) -> str:
    """The SHA-256 of a regular file of at most `most` bytes, in hexadecimal digits."""
    if not os.path.exists(path):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    with plain_reading(path), os.fdopen(os.open(path, TO_READ), "rb") as file:
        check_size(file, path, most)
        return hashlib.file_digest(file, "sha256").hexdigest()


# --- writing ---------------------------------------------------------------------------------------------------------


def write_new(root: Path, relative: str, data: bytes, durable: bool = False) -> None:
    """Write a file that is not there yet, making its folders below `root`."""
    with new_file(root, relative) as file:
        file.write(data)
        if durable:
            file.flush()
            os.fsync(file.fileno())


@contextmanager
def new_file(root: Path, relative: str) -> Iterator[BinaryIO]:
    """As `write_new`, open for writing, for what is too large to be held in memory."""
    with _place(root, relative, make=True) as place, os.fdopen(_create(place), "wb") as file:
        yield file


def create(path: Path, data: bytes) -> None:
    """Write a new file into a folder that this process is filling."""
    write_new(path.parent, path.name, data)


def make_folder_below(root: Path, relative: str) -> Path:
    """Make a folder and those above it, up to `root`; its path."""
    with _plain_writing(root / relative), _place(root, f"{relative}/x", make=True):
        return root / relative


def write_below(root: Path, relative: str, data: bytes, alone: bool = False) -> None:
    """Replace a file below a folder whole, keeping its mode; missing folders are made."""
    write_together(root, {relative: data}, alone)


def write_together(root: Path, contents: Mapping[str, bytes], alone: bool = False) -> None:
    """Replace files below a folder, each whole, in the order given: the last one decides, also after a kill.

    All are on the disk before any is renamed: a full disk leaves every old one. `alone`: a lock keeps others away.
    """
    with ExitStack() as held:
        places = []
        for relative, data in contents.items():
            with _plain_writing(root / relative):
                places.append((held.enter_context(_place(root, relative, make=True)), data))
        _replace(places, 0.0 if alone else _LEFT_OVER_S)


def write_whole(path: Path, data: bytes | BinaryIO) -> None:
    """Replace a file that the user named, whole, keeping its mode.

    A link is not written through. Terminals and other devices for characters, and pipes that somebody reads, are
    written to directly.
    """
    with _plain_writing(path):
        named = Path(os.path.abspath(path))
        state = _state(named)
        if state is not None and is_link(state) and _is_stream(named):
            state = os.stat(named)
            if stat.S_ISREG(state.st_mode):  # redirected into a file: it stays the file that the shell opened
                _write_directly(named, data)
                return
        if state is not None and (stat.S_ISCHR(state.st_mode) or stat.S_ISFIFO(state.st_mode)):
            _write_directly(named, data)
            return
        if not named.name:
            raise OutputError(Phrase("error-not-writable", {"file": path}))
        parent = Path(os.path.realpath(named.parent))
        held = os.open(parent, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0)) if _HAS_DIR_FD else None
        try:
            _replace([(_Place(path.parent, named.name, held, parent, named.name), data)])
        finally:
            if held is not None:
                os.close(held)


def _is_stream(path: Path) -> bool:
    """Whether this names an open file of this process. Not all of /dev: users put files into /dev/shm."""
    return str(path) in ("/dev/stdout", "/dev/stderr") or str(path.parent) in ("/dev/fd", "/proc/self/fd")


def _state(path: Path) -> os.stat_result | None:
    try:
        return path.lstat()
    except FileNotFoundError:
        return None


def _write_directly(path: Path, data: bytes | BinaryIO) -> None:
    descriptor = os.open(path, os.O_WRONLY | NO_WAIT)  # a pipe that nobody reads: an error instead of waiting
    if NO_WAIT:
        os.set_blocking(descriptor, True)
    with os.fdopen(descriptor, "wb") as file:
        _fill(file, data)


def _fill(file: BinaryIO, data: bytes | BinaryIO) -> None:
    if isinstance(data, bytes):
        file.write(data)
    else:
        shutil.copyfileobj(data, file, 1 << 20)


def _create(place: _Place) -> int:
    return place.open(os.O_WRONLY | os.O_CREAT | os.O_EXCL)


def _replace(contents: Sequence[tuple[_Place, bytes | BinaryIO]], left_over_s: float = _LEFT_OVER_S) -> None:
    staged: list[tuple[_Place, _Place]] = []
    with uninterrupted(commit=True):  # files are small work; nothing half written may stay behind
        try:
            for place, data in contents:
                partial = _Place(place.root, place.relative, place.folder, place.parent, scratch_name())
                staged.append((partial, place))
                with _plain_writing(Path(place.shown())):
                    _stage(partial, place, data)
            for number, (partial, place) in enumerate(staged, 1):
                with _plain_writing(Path(place.shown())):
                    os.replace(partial.path, place.path, src_dir_fd=place.folder, dst_dir_fd=place.folder)
                    if number < len(staged):
                        _sync_held(place)  # it must not reach the disk after the one that decides
            for _, place in staged:
                _remove_left_over(place, left_over_s)
        except BaseException:
            for partial, _ in staged:
                with suppress(OSError):
                    os.unlink(partial.path, dir_fd=partial.folder)
            raise
    with confirming(Path(contents[-1][0].shown())):
        _sync_held(contents[-1][0])


def _stage(partial: _Place, place: _Place, data: bytes | BinaryIO) -> None:
    """Have the disk keep the new contents under a name of their own, with the mode of the file that is there."""
    before = place.state()
    if before is not None and (is_link(before) or not stat.S_ISREG(before.st_mode)):
        if stat.S_ISDIR(before.st_mode):
            raise IsADirectoryError(errno.EISDIR, "is a directory")
        raise _not_plain(place.shown())
    with os.fdopen(_create(partial), "wb") as file:
        _fill(file, data)
        file.flush()
        if before is not None and os.name != "nt":
            os.fchmod(file.fileno(), stat.S_IMODE(before.st_mode))
        os.fsync(file.fileno())


def _remove_left_over(written: _Place, older_s: float) -> None:
    """Remove partial files that killed writers left beside a file just written; ages by the file system's clock."""
    with suppress(OSError):
        state = written.state()
        for name in os.listdir(written.parent if written.folder is None else written.folder):
            if state is None or not _SCRATCH.fullmatch(name):
                continue
            other = _Place(written.root, written.relative, written.folder, written.parent, name)
            left = other.state()
            if left is not None and stat.S_ISREG(left.st_mode) and state.st_mtime - left.st_mtime >= older_s:
                os.unlink(other.path, dir_fd=other.folder)


def sync(path: Path) -> None:
    """Have the disk keep a file, or a folder's list of names, which Windows and some file systems cannot do."""
    folder = path.is_dir()
    if folder and os.name == "nt":
        return
    handle = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        _fsync_folder(handle) if folder else os.fsync(handle)
    finally:
        os.close(handle)


def _sync_held(place: _Place) -> None:
    if place.folder is not None:
        _fsync_folder(place.folder)


def _fsync_folder(descriptor: int) -> None:
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # what file systems say that have no such call for folders
            raise


@contextmanager
def confirming(path: Path) -> Iterator[None]:
    """A block after the last renaming: what the disk refuses now is said, with the word that `path` is the new one."""
    try:
        yield
    except OSError as error:
        raise OutputError(Phrase("error-not-confirmed", {"file": str(path), "why": reason(error)})) from error


@contextmanager
def _plain_writing(path: Path) -> Iterator[None]:
    try:
        yield
    except ValueError:
        raise OutputError(Phrase("error-null-in-path")) from None
    except OSError as error:
        what = Phrase("error-cannot-write", {"file": str(path), "why": reason(error)})
        raise OutputError(what, Phrase("error-name-place")) from error


# --- removing and moving ---------------------------------------------------------------------------------------------


def remove_below(root: Path, relative: str) -> None:
    """Remove a file, if it is there; of a link the link itself."""
    with _plain_writing(root / relative), suppress(FileNotFoundError), _place(root, relative) as place:
        os.unlink(place.path, dir_fd=place.folder)


def move_below(root: Path, relative: str, to: str) -> None:
    """Rename a file or folder below `root`; missing folders of the new name are made."""
    with _plain_writing(root / relative), _place(root, relative) as source, _place(root, to, make=True) as goal:
        state = source.state()
        if state is None:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        if is_link(state) or not (stat.S_ISREG(state.st_mode) or stat.S_ISDIR(state.st_mode)):
            raise _not_plain(source.shown())
        if goal.state() is not None:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        os.rename(source.path, goal.path, src_dir_fd=source.folder, dst_dir_fd=goal.folder)


Known = Callable[[str], bool]


def plain_files(folder: Path, most: int) -> list[str]:
    """The first `most` regular files below a folder, with "/" between parts; no links, no unreadable folders."""
    found = (
        relative
        for relative, state in _entries(folder, "", readable_only=True)
        if stat.S_ISREG(state.st_mode) and not is_link(state) and path_problem(relative) is None
    )
    return list(islice(found, most))


def strangers(folder: Path, known: Known) -> list[str]:
    """The first three files below a folder that `known` does not name; links, pipes and empty folders too."""

    def is_plain(relative: str, state: os.stat_result) -> bool:
        return stat.S_ISREG(state.st_mode) or (relative.endswith("/") and stat.S_ISDIR(state.st_mode))

    entries = _entries(folder, "")
    return list(islice((r for r, s in entries if is_link(s) or not is_plain(r, s) or not known(r)), 3))


def _entries(
    folder: Path, prefix: str, depth: int = 0, readable_only: bool = False
) -> Iterator[tuple[str, os.stat_result]]:
    if depth > _DEEPEST:
        raise InputError(Phrase("error-nested-folders", {"folder": folder}))
    listed: list[tuple[os.DirEntry[str], os.stat_result]] = []
    try:
        with os.scandir(folder) as scan:
            for entry in sorted(scan, key=lambda one: one.name):
                listed.append((entry, entry.stat(follow_symlinks=False)))
    except OSError:
        if not readable_only:
            raise
    for entry, state in listed:
        if stat.S_ISDIR(state.st_mode) and not is_link(state):
            inner = list(_entries(Path(entry.path), f"{prefix}{entry.name}/", depth + 1, readable_only))
            yield from inner or [(f"{prefix}{entry.name}/", state)]
        else:
            yield prefix + entry.name, state


def remove_folder_below(root: Path, relative: str, known: Known) -> bool:
    """Remove what `known` names from a folder below `root`, and the folder where it is empty then; whether it went."""
    with _plain_writing(root / relative):
        try:
            with _place(root, f"{relative}/x"):  # refuses a link on the way
                pass
        except FileNotFoundError:
            return True
        inside = [name for name, _ in _entries(root / relative, "")]
        for name in inside:
            if known(name) and not name.endswith("/"):
                remove_below(root, f"{relative}/{name}")
        folders = {str(parent) for name in inside for parent in PurePosixPath(f"{name}x").parents} - {"."}
        gone = True
        for name in (*sorted(folders, key=lambda one: -one.count("/")), ""):
            gone &= _remove_empty(root, f"{relative}/{name}".rstrip("/"))
        return gone


def _remove_empty(root: Path, relative: str) -> bool:
    with _place(root, relative) as place:
        try:
            os.rmdir(place.path, dir_fd=place.folder)
        except OSError as error:
            if error.errno in (errno.ENOTEMPTY, errno.EEXIST):
                return False
            raise
    return True


def scratch_name() -> str:
    """A name for a folder that is filled and then renamed; nobody else has it."""
    return f".{secrets.token_hex(6)}{PARTIAL}"


def scratch_beside(folder: Path) -> Path:
    """A new empty folder beside one that is to be made, to be filled, renamed or removed (`remove_own_folder`)."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    scratch = folder.with_name(scratch_name())
    scratch.mkdir()
    return scratch


def remove_own_folder(folder: Path) -> None:
    """Remove a scratch folder of this process (named as `PARTIAL`) with all that is in it; links are not followed."""
    if folder.name.endswith(PARTIAL):
        shutil.rmtree(folder, ignore_errors=True)
