"""Ctrl-C and SIGTERM: held back during short work, and never lost (before the command begins: base/early.py)."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_ENDING = (signal.SIGINT, signal.SIGTERM)  # Ctrl-C, and what service managers send


class _State:
    """What has happened so far."""

    came = False  # one of the signals
    committed = False  # the output is in its place: what is left to do is short


_state = _State()


def begin() -> None:
    """From now on both raise KeyboardInterrupt; once the output is in its place they only count as having come."""
    _state.came = _state.committed = False
    for number in _ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as for jobs in the background
            signal.signal(number, _interrupt)
            sys.unraisablehook = _unraisable


def finish() -> None:
    """The command is over: nothing more can be cancelled."""
    for number in _ENDING:
        signal.signal(number, signal.SIG_IGN)


def _interrupt(*_: object) -> None:
    _state.came = True
    if not _state.committed:
        raise KeyboardInterrupt


def _unraisable(lost: Any) -> None:
    """Ctrl-C within a destructor, or a callback of the import system, can only be noted: no traceback of it."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)


def came() -> bool:
    """Whether one of the signals came; whoever goes on to long work asks."""
    return _state.came


@contextmanager
def uninterrupted(commit: bool = False) -> Iterator[None]:
    """Hold both signals back until this short piece of work is done; they then act as if they had come at its end."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Python hands signals to the main thread only
        return
    held: list[int] = []
    before = {number: signal.getsignal(number) for number in _ENDING}
    if None in before.values():  # a handler that is not Python's, which could not be put back
        yield
        return
    done = False
    for number in _ENDING:
        signal.signal(number, lambda number, _: held.append(number))
    try:
        yield
        done = commit and before[signal.SIGINT] is _interrupt
    finally:
        _state.committed = _state.committed or done
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(held):
            signal.raise_signal(number)
