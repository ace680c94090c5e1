"""BLAS on one thread: beside two busy processes the diagnosis of 15 cameras took 50 s with its own, and 1.5 s alone."""

import mmap
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import cache, wraps
from threading import Lock
from typing import ParamSpec, TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController

_BUFFERS_BYTES = 160 << 20  # measured: 64 MB with scipy 1.17 and numpy 2.4; the rest for what comes after them

P = ParamSpec("P")
R = TypeVar("R")


@cache
def _controller() -> ThreadpoolController:
    # numpy and scipy each have a BLAS of their own, and the controller knows only those that are loaded
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()


@contextmanager
def _blas_limited() -> Iterator[None]:
    with _controller().limit(limits=1, user_api="blas"):
        _reserve_buffers()
        yield


@cache
def _reserve_buffers() -> None:
    """Let both BLAS take their buffers while there is room: they would ask for ever, deaf to Ctrl-C."""
    import scipy.linalg

    try:
        mmap.mmap(-1, _BUFFERS_BYTES).close()
    except OSError:
        raise MemoryError from None
    matrix = np.eye(200)  # of more than a few rows: small products need no buffer
    scipy.linalg.cho_factor(matrix)
    np.dot(matrix, matrix)


class SharedLimit:
    """A limit of the whole process: the first block that asks for it sets it, the last one that ends lifts it.

    If two threads each set and restored it, the first to end would give the threads back to the other. The other's sums
    would then come out in another order: other bits for the same input.
    """

    def __init__(self, limited: Callable[[], AbstractContextManager[None]]) -> None:
        self._limited = limited
        self._lock = Lock()
        self._blocks = 0
        self._limit = ExitStack()

    @contextmanager
    def block(self) -> Iterator[None]:
        """A block in which the limit holds, in this thread and all others."""
        with self._lock:
            if not self._blocks:
                self._limit.enter_context(self._limited())
            self._blocks += 1
        try:
            yield
        finally:
            with self._lock:
                self._blocks -= 1
                if not self._blocks:
                    self._limit.close()


# A block in which BLAS keeps to one thread, in this thread and all others.
one_blas_thread = SharedLimit(_blas_limited).block


def on_one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function with BLAS kept to one thread while it runs."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with one_blas_thread():
            return function(*args, **kwargs)

    return limited
