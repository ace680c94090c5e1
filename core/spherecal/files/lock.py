"""A lock on what is about to be written, so that two programs do not write one thing at a time."""

import getpass
import hashlib
import json
import os
import socket
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from spherecal.base.errors import OutputError, reason
from spherecal.base.filesystem import is_link
from spherecal.base.interrupts import uninterrupted
from spherecal.base.messages.values import Phrase

LOCK = ".spherecal-lock"
# Writing the largest result takes seconds; who waits longer than this has most likely met a program that hangs.
WAIT_S = 30.0
_POLL_S = 0.01
_FAR = 1 << 30  # on Windows the locked byte lies behind the text, which others can then read


class InUse(OutputError):
    """Another program holds the lock."""


@dataclass
class _Held:
    descriptor: int
    thread: int
    count: int = 1


_held: dict[str, _Held] = {}
_guard = threading.Lock()


def short_name(path: Path) -> str:
    """Sixteen characters that identify a file's or folder's name: names may be as long as a file system allows."""
    return hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]


@contextmanager
def locked(path: Path, wait_s: float = WAIT_S) -> Iterator[None]:
    """Hold the lock of a file or folder that is to be written.

    The system frees it when the process ends, however it ends, so that no stale lock remains. A thread that holds it
    may take it again. The lock is a small file beside `path`, gone when the lock is free.
    """
    file = Path(os.path.realpath(path.parent)) / f".{short_name(path)}{LOCK}"
    deadline = time.monotonic() + wait_s
    taken = False
    try:
        while True:
            with uninterrupted():
                taken = _take(file, path)
            if taken:
                break
            if time.monotonic() > deadline:
                raise InUse(Phrase("error-in-use", {"file": path, "holder": _holder(file)}))
            time.sleep(_POLL_S)
        yield
    finally:
        if taken:
            with uninterrupted():
                _release(file)


def _take(file: Path, path: Path) -> bool:
    with _guard:
        mine = _held.get(str(file))
        if mine is not None:
            mine.count += mine.thread == threading.get_ident()
            return mine.thread == threading.get_ident()
        descriptor = _try(file, path)
        if descriptor is None:
            return False
        _held[str(file)] = _Held(descriptor, threading.get_ident())
        return True


def _release(file: Path) -> None:
    with _guard:
        held = _held[str(file)]
        held.count -= 1
        if not held.count:
            del _held[str(file)]
            _free(file, held.descriptor)


def _try(file: Path, path: Path) -> int | None:
    """Take the lock if it is free: a descriptor that holds it, else None."""
    flags = os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        try:
            descriptor = os.open(file, os.O_RDWR | flags, 0o644)
        except PermissionError as refused:
            if os.name == "nt":  # its holder is just removing it
                return None
            try:  # another user's: for its lock only
                descriptor = os.open(file, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
            except FileNotFoundError:
                raise refused from None
    except OSError as error:
        what = Phrase("error-cannot-write", {"file": str(path), "why": reason(error)})
        raise OutputError(what, Phrase("error-name-place")) from error
    try:
        state = os.fstat(descriptor)
        if not stat.S_ISREG(state.st_mode) or state.st_nlink > 1:  # a planted second name of a file of the user's
            raise OutputError(Phrase("error-not-lock", {"file": file}))
        if _lock(descriptor) and _is_still(file, state):
            with suppress(OSError):
                _write_holder(descriptor)
            return descriptor
    except BaseException:
        os.close(descriptor)
        raise
    os.close(descriptor)
    return None


def _lock(descriptor: int) -> bool:
    if os.name == "nt":
        import msvcrt

        os.lseek(descriptor, _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a network drive without locks: two writers still leave one whole result
        return True
    return True


def _is_still(file: Path, state: os.stat_result) -> bool:
    """Whether the file that was locked is the one that others find: its last holder may have removed it meanwhile."""
    if os.name == "nt":
        return True
    try:
        now = file.lstat()
    except FileNotFoundError:
        return False
    return not is_link(now) and (now.st_ino, now.st_dev) == (state.st_ino, state.st_dev)


def _write_holder(descriptor: int) -> None:
    try:
        user = getpass.getuser()
    except (OSError, KeyError):
        user = "?"
    since = datetime.now().astimezone().isoformat(timespec="seconds")
    holder = {"process": os.getpid(), "user": user, "host": socket.gethostname(), "since": since}
    os.lseek(descriptor, 0, os.SEEK_SET)
    os.ftruncate(descriptor, 0)
    os.write(descriptor, json.dumps(holder).encode())


def _holder(file: Path) -> Phrase:
    try:
        with file.open("rb") as opened:
            holder = json.loads(opened.read(2000))
        names = ("process", "user", "host", "since")
        values = {name: "".join(c for c in str(holder[name])[:60] if c.isprintable()) for name in names}
    except (OSError, ValueError, KeyError, TypeError):
        return Phrase("holder-unknown")
    return Phrase("holder-process", values)


def _free(file: Path, descriptor: int) -> None:
    if os.name == "nt":
        import msvcrt

        with suppress(OSError):
            os.lseek(descriptor, _FAR, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)  # type: ignore[attr-defined]
        os.close(descriptor)
        with suppress(OSError):
            os.unlink(file)
        return
    with suppress(OSError):
        os.unlink(file)  # before the lock is freed: nobody can then lock a file that is about to go
    os.close(descriptor)
