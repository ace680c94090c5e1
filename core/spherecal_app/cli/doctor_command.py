"""`spherecal doctor`: what this machine has and lacks: packages, system libraries, a window, cores."""

import argparse
import ctypes.util
import importlib
import importlib.metadata
import os
import platform
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from rich.markup import escape
from rich.table import Table

from spherecal import __version__
from spherecal_app.cli.cameras_source import advice_for
from spherecal_app.cli.console import answer, out
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_cameras.genicam.discovery import producer_files
from spherecal_cameras.protocol import Discovery


@dataclass(frozen=True)
class DoctorLine:
    """One line of the report: `missing` is needed for what the program does today, `optional` for parts of it."""

    name: str
    state: Literal["ok", "missing", "optional"]
    found: str


_NEEDED = ("numpy", "scipy", "cv2", "rich", "threadpoolctl", "platformdirs")
_TRIED = {"genicam": "genicam.gentl"}  # the package alone can be imported without what it needs
_DISTRIBUTION = {"cv2": "opencv-python-headless", "PySide6": "PySide6-Essentials"}
_OPTIONAL = {  # what it is for, what pip installs for it
    "PySide6": ("the window", "spherecal[gui]"),
    "pyqtgraph": ("plots in the window", "spherecal[gui]"),
    "matplotlib": ("reports and charts", "spherecal[report]"),
    "typst": ("reports as PDF", "spherecal[report]"),
    "pyvista": ("3-D views", "spherecal[gui]"),
    "genicam": ("live cameras", "spherecal[cameras]"),
    "harvesters": ("live cameras", "spherecal[cameras]"),
    "pyceres": ("benchmarks only", ""),
}
_SYSTEM_PYTHON = f"libpython{sys.version_info.major}.{sys.version_info.minor}"  # which genicam loads
_PACKAGES = {"pyvista": "the package spherecal-3d"}  # beside the .deb, which pip does not touch
_QT_LIBRARIES = ("GL", "EGL", "glib-2.0", "fontconfig", "dbus-1", "xkbcommon")


def doctor(options: argparse.Namespace) -> int:
    """`spherecal doctor`: 3 where something is missing that the program needs."""
    table, found = Table("", "what", "found", box=None), tuple(examine())
    code = NOT_VALID if any(one.state == "missing" for one in found) else DONE
    answer(options, [{"what": one.name, "state": one.state, "found": one.found} for one in found])
    for one in found:
        mark = {"ok": "[green]ok[/]", "missing": "[red]missing[/]", "optional": "[yellow]optional[/]"}[one.state]
        table.add_row(mark, one.name, escape(one.found))
    out.print(table)
    return code


def examine() -> Iterator[DoctorLine]:
    """All checks, the needed ones first."""
    yield DoctorLine("SphereCal", "ok", __version__)
    yield DoctorLine("Python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    yield DoctorLine("processors", "ok", str(os.cpu_count()))
    for name in _NEEDED:
        yield _package(name, "missing", "needed: install spherecal again")
    yield _kernels()
    for name in _OPTIONAL:
        yield _package(name, "optional", _advice(name))
    if platform.system() == "Linux":
        yield from _libraries()
        display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
        yield DoctorLine("display", "ok" if display else "optional", display or "none: only the command line works")
    yield _producers()


def _is_bundle() -> bool:
    """Whether this is the program with its own Python, as the .deb and the set-up program for Windows install it."""
    return bool(getattr(sys, "frozen", False))


def _advice(name: str) -> str:
    """What an optional package is for and how it is installed here."""
    purpose, extra = _OPTIONAL[name]
    if _is_bundle():
        extra = _PACKAGES.get(name, "") if platform.system() == "Linux" else ""
    elif name == "genicam":
        extra += f" (on Debian also: apt install {_SYSTEM_PYTHON})"
    return f"{purpose}; install {extra}" if extra else purpose


def _package(name: str, absent: Literal["missing", "optional"], purpose: str) -> DoctorLine:
    try:
        importlib.import_module(_TRIED.get(name, name))
    except Exception as error:  # a broken library raises what it likes
        gone = "not part of this package" if _is_bundle() else "not installed"
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
        from spherecal.base.kernels import AHEAD  # here, since it fails where numba is missing
        from spherecal_app.kernel_state import state

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
    if files := producer_files():
        return DoctorLine("camera drivers", "ok", ", ".join(files))
    lacking = "none (needed for live cameras: `spherecal cameras list` asks the network which are there)"
    return DoctorLine("camera drivers", "optional", " ".join(advice_for(Discovery(()), ask_network=False)) or lacking)
