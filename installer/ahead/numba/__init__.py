"""In the place of numba in a bundle: its `njit`, for functions that were compiled when the bundle was built.

Only what SphereCal uses of numba is here. `installer/kernels.py` puts the libraries and kernels.json beside this file.
A call with types that nobody compiled for runs the Python function, slowly, and is logged; with SPHERECAL_KERNELS set
to `strict` it is an error. Compiled functions leave the interpreter free (nogil), as with numba.
"""

import importlib
import json
import logging
import os
from collections.abc import Callable
from functools import update_wrapper
from pathlib import Path
from typing import Any

import numpy as np

_log = logging.getLogger("spherecal")
_FOLDER = Path(__file__).parent
# What x86-64-v3 (2013 on) has over the first 64-bit processors, as Linux names it.
_V3 = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave"}


def _processor_flags() -> set[str]:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return set()
    lines = (line.partition(":")[2] for line in text.splitlines() if line.startswith("flags"))
    return set(next(lines, "").split())


def _library() -> Any:
    """The library for this processor; SPHERECAL_PROCESSOR names another one."""
    there = {file.name.partition(".")[0]: file for file in _FOLDER.glob("_kernels_*")}
    names = sorted(there, reverse=True)  # x86_64_v3 before x86_64
    asked = os.environ.get("SPHERECAL_PROCESSOR")
    if asked:
        names = [name for name in names if name == "_kernels_" + asked.replace("-", "_")]
    elif not _processor_flags() >= _V3:
        names = [name for name in names if not name.endswith("_v3")]
    if not names:
        raise ImportError("this program has no compiled kernels for this processor")
    return importlib.import_module(f"numba.{names[0]}")


_made = json.loads((_FOLDER / "kernels.json").read_text(encoding="utf-8"))
__version__ = _made["numba"]
_kernels = _library()
compiled_for = _kernels.__name__.partition("_kernels_")[2].replace("x86_64", "x86-64").replace("_", "-")


def _freeze(key: Any) -> Any:
    return tuple(_freeze(part) for part in key) if isinstance(key, list) else key


_table: dict[tuple[str, str], dict[Any, Callable[..., Any]]] = {}
for _module, _name, _key, _symbol in _made["kernels"]:
    _table.setdefault((_module, _name), {})[_freeze(_key)] = getattr(_kernels, _symbol)


def _key_of(one: Any, layout: str | None = None) -> Any:
    """The type of an argument as kernels.json names it; arrays of any memory layout as `layout` where that is given."""
    if isinstance(one, np.ndarray):
        flags = one.flags
        found = layout or ("C" if flags.c_contiguous else "F" if flags.f_contiguous else "A")
        return f"{one.dtype.str} {one.ndim} {found}" if flags.aligned else "unaligned"
    if isinstance(one, tuple):
        return tuple(_key_of(part, layout) for part in one)
    if isinstance(one, bool | np.bool_):
        return "bool"
    if isinstance(one, int | np.integer):
        return "int"
    if isinstance(one, float | np.floating):
        return "float"
    return "none" if one is None else type(one).__name__


class Kernel:
    """A function with its compiled forms, by the types of its arguments."""

    def __init__(self, function: Callable[..., Any], forms: dict[Any, Callable[..., Any]]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self._forms = forms

    def __call__(self, *arguments: Any) -> Any:
        """The result, by the compiled form where there is one."""
        form = self._forms.get(tuple([_key_of(one) for one in arguments]))
        if form is None:
            form = self._form_for(arguments)
        return form(*arguments)

    def _form_for(self, arguments: tuple[Any, ...]) -> Callable[..., Any]:
        exact = tuple(_key_of(one) for one in arguments)
        form = self._forms.get(tuple(_key_of(one, "A") for one in arguments))
        if form is None:
            what = f"{self.py_func.__module__}.{self.py_func.__name__} was not compiled for {exact}"
            if os.environ.get("SPHERECAL_KERNELS") == "strict":
                raise TypeError(what)
            _log.warning("%s and runs slowly; please report this.", what)
            form = self.py_func
        self._forms[exact] = form
        return form


def njit(*functions: Callable[..., Any], **_options: Any) -> Any:
    """As numba's: a decorator, with or without options."""

    def decorate(function: Callable[..., Any]) -> Kernel:
        return Kernel(function, _table.get((function.__module__, function.__name__), {}))

    return decorate(functions[0]) if functions else decorate


def version_text() -> str:
    """For `doctor`."""
    return f"kernels compiled ahead for {compiled_for} by numba {__version__}"
