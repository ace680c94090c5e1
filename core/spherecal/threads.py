"""BLAS on one thread: its matrices are small here, and threads that wait for each other cost more than they bring.

Beside two busy processes the diagnosis of 15 cameras took 50 s with BLAS's own threads, and 1.5 s alone.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


@cache
def _threads() -> ThreadpoolController:
    # numpy and scipy each have a BLAS of their own, and the controller knows only those that are loaded
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()


def one_blas_thread() -> AbstractContextManager[object]:
    """A block in which BLAS keeps to one thread."""
    return _threads().limit(limits=1, user_api="blas")


def on_one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function with BLAS kept to one thread while it runs."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with one_blas_thread():
            return function(*args, **kwargs)

    return limited
