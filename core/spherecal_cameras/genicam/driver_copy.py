"""The file that was looked at is the file that is loaded: a driver's private copy, with its neighbours beside it.

A driver is found by a path, and the file there may be exchanged between looking and loading. So its contents are copied
into a folder of the program's own while they are hashed, and the copy is loaded. Drivers need their neighbours
(genicam's harvesters, issue 200), often by `$ORIGIN/../..`. Therefore the copy has the same place in a tree in which
everything else is a link to the original.
"""

import atexit
import hashlib
import os
import re
import secrets
import stat
from contextlib import suppress
from pathlib import Path

from spherecal.base.filesystem import PARTIAL, new_file, remove_own_folder
from spherecal.base.resources import cache_folder

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
    """The path of a copy of a driver file, with links to its neighbours; on Windows the file's own path.

    On Windows a file that is held open (`hold`) cannot be exchanged.
    """
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
    _link_neighbours(tree, relative)
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
        if owner and not _runs(int(owner[1])):
            remove_own_folder(old)
    tree = base / f".{os.getpid()}-{secrets.token_hex(6)}{PARTIAL}"
    tree.mkdir(mode=0o700)
    return tree


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True


def _link_neighbours(tree: Path, relative: Path) -> None:
    """Beside the copy, and beside each folder above it, links to the original files and folders there."""
    for above in (relative, *relative.parents[:-1]):
        with suppress(OSError), os.scandir(Path("/") / above.parent) as scan:
            for number, entry in enumerate(scan):
                if number == _MOST_NEIGHBOURS:
                    break
                if entry.name != above.name:
                    with suppress(OSError):
                        (tree / above.parent / entry.name).symlink_to(entry.path)


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
