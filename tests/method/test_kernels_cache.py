"""Numba's cache of an older version: classes that have another name since are no reason to stop."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

_KERNEL = """
from typing import NamedTuple
from spherecal.base.kernels import njit

class {name}(NamedTuple):
    width: float

@njit(cache=True)
def half(one):
    return one.width / 2
"""


@pytest.mark.parametrize("spoil", ["renamed", "cut off"])
def test_a_cache_that_cannot_be_read_is_compiled_again(tmp_path: Path, spoil: str) -> None:
    module, cache = tmp_path / "kernel_of_a_version.py", tmp_path / "cache"
    env = os.environ | {"NUMBA_CACHE_DIR": str(cache), "SPHERECAL_KERNELS": "numba"}

    def run(name: str) -> str:
        module.write_text(_KERNEL.format(name=name), encoding="utf-8")
        command = [sys.executable, "-c", f"import kernel_of_a_version as k; print(k.half(k.{name}(3.0)))"]
        done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    assert run("Book") == "1.5"
    indices = list(cache.rglob("*.nbi"))
    assert indices  # otherwise nothing is shown
    if spoil == "cut off":
        indices[0].write_bytes(indices[0].read_bytes()[:-20])
    # of another length: Python takes a file of the same size and second for the one it has compiled
    assert run("Book" if spoil == "cut off" else "Pages") == "1.5"
