"""What this machine has and lacks: packages, system libraries, a window, cores."""

import ctypes.util
import importlib
import importlib.metadata
import os
import platform
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from spherecal import __version__


@dataclass(frozen=True)
class DoctorLine:
    """One line of the report: `missing` is needed for what the program does today, `optional` for parts of it."""

    name: str
    state: Literal["ok", "missing", "optional"]
    found: str


_NEEDED = ("numpy", "scipy", "cv2", "rich", "threadpoolctl", "platformdirs")
_TRIED = {"genicam": "genicam.gentl"}  # the package alone can be imported without what it needs
_DISTRIBUTION = {"cv2": "opencv-python-headless", "PySide6": "PySide6-Essentials"}
_OPTIONAL = {
    "PySide6": "the window; install spherecal[gui]",
    "pyqtgraph": "plots in the window; install spherecal[gui]",
    "pyvista": "3-D views; install spherecal[gui]",
    "genicam": "live cameras; install spherecal[cameras] (on Debian also: apt install "
    f"libpython{sys.version_info.major}.{sys.version_info.minor})",
    "harvesters": "live cameras; install spherecal[cameras]",
    "pyceres": "benchmarks only",
}
_QT_LIBRARIES = ("GL", "EGL", "glib-2.0", "fontconfig", "dbus-1", "xkbcommon")


def examine() -> Iterator[DoctorLine]:
    """All checks, the needed ones first."""
    yield DoctorLine("SphereCal", "ok", __version__)
    yield DoctorLine("Python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    yield DoctorLine("processors", "ok", str(os.cpu_count()))
    for name in _NEEDED:
        yield _package(name, "missing", "needed: install spherecal again")
    yield _kernels()
    for name, purpose in _OPTIONAL.items():
        yield _package(name, "optional", purpose)
    if platform.system() == "Linux":
        yield from _libraries()
        display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
        yield DoctorLine("display", "ok" if display else "optional", display or "none: only the command line works")
    yield _producers()


def _package(name: str, absent: Literal["missing", "optional"], purpose: str) -> DoctorLine:
    try:
        importlib.import_module(_TRIED.get(name, name))
    except Exception as error:  # a broken library raises what it likes
        gone = "not part of this package" if getattr(sys, "frozen", False) else "not installed"
        reason = gone if isinstance(error, ModuleNotFoundError) else str(error).splitlines()[0]
        return DoctorLine(name, absent, f"{reason} ({purpose})")
    try:
        version = importlib.metadata.version(_DISTRIBUTION.get(name, name))
    except importlib.metadata.PackageNotFoundError:
        version = "found"
    return DoctorLine(name, "ok", version)


def _kernels() -> DoctorLine:
    """The numeric kernels: compiled ahead, in numba's cache, or still to be compiled by numba."""
    try:
        from spherecal.base.kernels import AHEAD, state

        found = state()
    except ImportError as error:
        return DoctorLine("numba", "missing", f"{error} (needed: install spherecal again)")
    if AHEAD is not None:
        return DoctorLine("kernels", "ok", f"compiled ahead for {AHEAD.processor} by numba {AHEAD.numba}")
    numba = _package("numba", "missing", "needed: install spherecal again")
    if numba.state == "missing":
        return numba
    known = {"compiled": "compiled", "to compile": "compiled at their first use, or now by spherecal compile-kernels"}
    return DoctorLine("kernels", "ok", f"{known[found]} (numba {numba.found})")


def _libraries() -> Iterator[DoctorLine]:
    for name in _QT_LIBRARIES:
        found = ctypes.util.find_library(name)
        yield DoctorLine(f"lib{name}", "ok" if found else "optional", found or "not found (needed by the window)")


def _producers() -> DoctorLine:
    folders = [f for f in os.environ.get("GENICAM_GENTL64_PATH", "").split(os.pathsep) if f]
    files = [entry.path for f in folders if os.path.isdir(f) for entry in os.scandir(f) if entry.name.endswith(".cti")]
    if files:
        return DoctorLine("GenTL producers", "ok", ", ".join(sorted(files)))
    return DoctorLine("GenTL producers", "optional", "none in GENICAM_GENTL64_PATH (needed for live cameras)")
