"""Freed memory goes back to the system."""

import subprocess
import sys

import pytest

from spherecal.memory import LARGE, _glibc, arrays_apart, release_freed

# Arrays that glibc keeps on its heap: many, and one that lies above them and is not freed.
KEPT = """
import os
import numpy as np
from spherecal.memory import release_freed

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
    if _glibc() is None:
        pytest.skip("the C library of this system is not glibc")
    run = subprocess.run([sys.executable, "-c", KEPT], capture_output=True, text=True, check=True)
    assert float(run.stdout) > 80  # of 96


# Arrays that are kept while smaller ones lie above them.
SCATTERED = """
import os
import sys
import numpy as np
from spherecal.memory import arrays_apart

def resident_mb():
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

np.ones(4_000_000)  # a freed array of 32 MB, after which glibc keeps those below
with arrays_apart(int(sys.argv[1])):
    before = resident_mb()
    arrays, above = [], []
    for _ in range(20):
        arrays.append(np.ones(500_000))
        above.append(np.ones(1_000))
    del arrays
    print(resident_mb() - before)
"""


def test_freed_arrays_of_large_recordings_are_given_back_at_once() -> None:
    if _glibc() is None:
        pytest.skip("the C library of this system is not glibc")
    kept = [
        float(subprocess.run([sys.executable, "-c", SCATTERED, count], capture_output=True, check=True).stdout)
        for count in ("0", str(LARGE + 1))
    ]
    assert kept[0] > 60  # of 76 MB
    assert kept[1] < 10


def test_other_systems_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    _glibc.cache_clear()
    try:
        release_freed()
        with arrays_apart(LARGE + 1):
            assert _glibc() is None
    finally:
        _glibc.cache_clear()
