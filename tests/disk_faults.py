"""A disk that refuses, or a program that is killed, at a chosen system call among those that change a disk."""

import errno
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

CALLS = ("open", "mkdir", "fsync", "replace", "rename", "rmdir", "unlink", "fchmod")


@contextmanager
def at_call(number: int, happens: Callable[[], None], after: bool = False) -> Iterator[list[str]]:
    """Something happens before (or after) the call of this number among those that change a disk."""
    made: list[str] = []
    real = {name: getattr(os, name) for name in CALLS}

    def watched(name: str) -> Callable[..., object]:
        def call(*args: object, **kwargs: object) -> object:
            if name == "open" and not (int(args[1]) & os.O_CREAT):  # type: ignore[call-overload]
                return real[name](*args, **kwargs)
            made.append(name)
            if not after and len(made) == number:
                happens()
            try:
                return real[name](*args, **kwargs)
            finally:
                if after and len(made) == number:
                    happens()

        return call

    with pytest.MonkeyPatch.context() as patch:
        for name in CALLS:
            patch.setattr(os, name, watched(name))
        yield made


def refuse() -> None:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
