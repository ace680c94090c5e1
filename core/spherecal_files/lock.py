"""A lock on what is about to be written, so that two programs do not write one thing at a time."""

import errno
import getpass
import hashlib
import json
import os
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from spherecal.base.errors import OutputError, reason
from spherecal.base.interrupts import uninterrupted
from spherecal.base.messages.values import Phrase

LOCK = ".spherecal-lock"
# Writing the largest result takes seconds; who waits longer than this has most likely met a program that hangs.
WAIT_S = 30.0
_POLL_S = 0.01
# A network drive without locks: two writers still leave one whole result.
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}


class InUse(OutputError):
    """Another program holds the lock."""


class _NotALockError(Exception):
    """What has the lock's name is no file that this program made."""


def short_name(path: Path) -> str:
    """Sixteen characters that identify a file's or folder's name: names may be as long as a file system allows."""
    return hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]


@contextmanager
def locked(path: Path, wait_s: float = WAIT_S) -> Iterator[None]:
    """Hold the lock of what is to be written, waiting at most `wait_s`; a thread may take it again. InUse: the holder.

    A small file beside `path`, gone when it is free; the system frees it when the process ends, however it ends.
    """
    from filelock import FileLock, Timeout

    file = Path(os.path.realpath(path.parent)) / f".{short_name(path)}{LOCK}"
    # Every user may lock what another one's killed program has left: the file's text is shown, never relied on.
    lock = FileLock(file, mode=0o666, is_singleton=True, on_acquired=_sign)
    deadline = time.monotonic() + wait_s
    taken = False
    try:
        while not taken:
            try:
                with uninterrupted():
                    lock.acquire(blocking=False)
                    taken = True
            except Timeout:
                if time.monotonic() > deadline:
                    raise InUse(Phrase("error-in-use", {"file": path, "holder": _holder(file)})) from None
                time.sleep(_POLL_S)
            except _NotALockError:
                raise OutputError(Phrase("error-not-lock", {"file": file})) from None
            except OSError as error:
                if error.errno not in _NO_LOCKS:
                    what = Phrase("error-cannot-write", {"file": str(path), "why": reason(error)})
                    raise OutputError(what, Phrase("error-name-place")) from error
                break
        yield
    finally:
        if taken:
            with uninterrupted():
                if lock.lock_counter == 1:
                    with suppress(OSError):  # on Windows, which removes it when it is free
                        os.unlink(file)  # before the lock is freed: nobody can then lock a file that is about to go
                lock.release()


def _sign(descriptor: int) -> None:
    """Write who holds the lock, behind the first byte: on Windows nobody else can read that one."""
    state = os.fstat(descriptor)
    if not stat.S_ISREG(state.st_mode) or state.st_nlink > 1:  # a planted second name of a file of the user's
        raise _NotALockError
    with suppress(OSError):
        user = "?"
        with suppress(OSError, KeyError):
            user = getpass.getuser()
        since = datetime.now().astimezone().isoformat(timespec="seconds")
        holder = {"process": os.getpid(), "user": user, "host": socket.gethostname(), "since": since}
        os.ftruncate(descriptor, 0)
        os.write(descriptor, b" " + json.dumps(holder).encode())


def _holder(file: Path) -> Phrase:
    try:
        with file.open("rb", buffering=0) as opened:
            opened.seek(1)
            holder = json.loads(opened.read(2000))
        names = ("process", "user", "host", "since")
        values = {name: "".join(c for c in str(holder[name])[:60] if c.isprintable()) for name in names}
    except (OSError, ValueError, KeyError, TypeError):
        return Phrase("holder-unknown")
    return Phrase("holder-process", values)
