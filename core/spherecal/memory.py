"""Freed memory given back to the system, where the C library does not do it by itself.

glibc keeps freed arrays of up to 32 MB for later ones (mallopt(3), M_MMAP_THRESHOLD), and scatters these over all that
it keeps: of a million observations 397 MB were kept beside 277 MB in use.
"""

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

# From this number of observations on, single arrays have a mapping of their own.
LARGE = 200_000
_APART_BYTES, _USUAL_BYTES = 1_000_000, 32 * 2**20
_M_MMAP_THRESHOLD = -3  # of malloc.h


def release_freed() -> None:
    """Give freed memory back at the end of a stage: 1 to 30 ms with glibc, nothing elsewhere. malloc_trim(3)."""
    glibc = _glibc()
    if glibc is not None:
        glibc.malloc_trim(0)


@contextmanager
def arrays_apart(count: int) -> Iterator[None]:
    """A block in which freed arrays of 1 MB and more go back at once where `count` observations are many.

    With glibc alone, for the whole process; afterwards arrays of up to 32 MB are kept, as glibc comes to do by itself.
    """
    glibc = _glibc() if count > LARGE else None
    if glibc is not None:
        glibc.mallopt(_M_MMAP_THRESHOLD, _APART_BYTES)
    try:
        yield
    finally:
        if glibc is not None:
            glibc.mallopt(_M_MMAP_THRESHOLD, _USUAL_BYTES)


@cache
def _glibc() -> ctypes.CDLL | None:
    """The C library where it is glibc."""
    if sys.platform != "linux":
        return None
    library = ctypes.CDLL(None)
    if not hasattr(library, "gnu_get_libc_version"):
        return None
    library.malloc_trim.argtypes, library.mallopt.argtypes = [ctypes.c_size_t], [ctypes.c_int, ctypes.c_int]
    return library
