"""Whether the kernels are compiled: ahead, or in numba's cache, where a stamp says what they were compiled from."""

import hashlib
import importlib.metadata
import os
import sys
from pathlib import Path
from typing import Literal

from spherecal.base.kernels import AHEAD
from spherecal_files.cache_folder import cache_folder
from spherecal_files.filesystem import write_whole


def state() -> Literal["ahead", "compiled", "to compile"]:
    """Whether the first calibration finds its kernels: compiled ahead, in numba's cache, or not at all."""
    if AHEAD is not None:
        return "ahead"
    return "compiled" if is_marked(wanted()) else "to compile"


def wanted() -> str:
    """What numba's cache depends on, as a SHA-256: the files with kernels as they are now, numba, Python."""
    root = Path(__file__).resolve().parents[1]
    known = [sys.version, importlib.metadata.version("numba"), os.environ.get("NUMBA_CACHE_DIR", "")]
    for path in sorted(root.glob("spherecal*/**/*.py")):
        if b"njit" in path.read_bytes():
            known.append(f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}")
    return hashlib.sha256("\n".join(known).encode()).hexdigest()


def is_marked(made_from: str) -> bool:
    """Whether `mark_compiled` was called with this."""
    return _stamp(made_from).exists()


def mark_compiled(made_from: str) -> None:
    """Remember that all kernels are in numba's cache, compiled from what `wanted` was then."""
    stamp = _stamp(made_from)
    stamp.parent.mkdir(parents=True, exist_ok=True)
    write_whole(stamp, b"")


def _stamp(made_from: str) -> Path:
    return cache_folder(f"kernels-{made_from[:16]}")
