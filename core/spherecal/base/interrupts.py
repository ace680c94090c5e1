"""Ctrl-C: held back during short work, and never lost (before the command begins: base/early.py)."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class _State:
    """What has happened so far."""

    came = False  # somebody pressed Ctrl-C
    committed = False  # the output is in its place: what is left to do is short


_state = _State()


def begin() -> None:
    """From now on Ctrl-C raises KeyboardInterrupt; once the output is in its place it only counts as having come."""
    _state.came = _state.committed = False
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as for jobs in the background
        signal.signal(signal.SIGINT, _interrupt)
        sys.unraisablehook = _unraisable


def finish() -> None:
    """The command is over: nothing more can be cancelled."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _interrupt(*_: object) -> None:
    _state.came = True
    if not _state.committed:
        raise KeyboardInterrupt


def _unraisable(lost: Any) -> None:
    """Ctrl-C within a destructor, or a callback of the import system, can only be noted: no traceback of it."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)


def came() -> bool:
    """Whether somebody pressed Ctrl-C; whoever goes on to long work asks."""
    return _state.came


@contextmanager
def uninterrupted(commit: bool = False) -> Iterator[None]:
    """Hold Ctrl-C back until this short piece of work is done.

    It then acts as if it had come at its end; with `commit`, work that puts the output into its place, it came too
    late: whoever reads the exit code would think that nothing was written.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # Python hands signals to the main thread only
        return
    held: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    if before is None:  # a handler that is not Python's, which could not be put back
        yield
        return
    done = False
    signal.signal(signal.SIGINT, lambda number, _: held.append(number))
    try:
        yield
        done = commit and before is _interrupt
    finally:
        _state.committed = _state.committed or done
        signal.signal(signal.SIGINT, before)
        if held:
            signal.raise_signal(signal.SIGINT)
