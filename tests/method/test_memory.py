"""Freed memory goes back to the system."""

import subprocess
import sys

import pytest

from spherecal.base.memory import _malloc_trim, release_freed

# Arrays that glibc keeps on its heap: many, and one that lies above them and is not freed.
KEPT = """
import os
import numpy as np
from spherecal.base.memory import release_freed

def resident_mb():
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

arrays = [np.ones(12_000) for _ in range(1000)]
last = np.ones(12_000)
del arrays
before = resident_mb()
release_freed()
print(before - resident_mb())
"""


def test_freed_arrays_are_given_back() -> None:
    if _malloc_trim() is None:
        pytest.skip("the C library of this system has no malloc_trim")
    run = subprocess.run([sys.executable, "-c", KEPT], capture_output=True, text=True, check=True)
    assert float(run.stdout) > 80  # of 96


def test_other_systems_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    _malloc_trim.cache_clear()
    try:
        release_freed()
        assert _malloc_trim() is None
    finally:
        _malloc_trim.cache_clear()
