"""`njit` for the engine's kernels: the compiled forms that the package carries, else numba's.

A platform wheel and the bundle hold the kernels compiled when they were built (installer/kernels.py): `_kernels` with
kernels.json and one library for every kind of processor. A pure wheel and a checkout have no such folder, and numba
compiles at the first call. A call with types that nobody compiled for goes to numba, or where numba is absent runs the
Python function, slowly; with SPHERECAL_KERNELS set to `strict` it is an error. With SPHERECAL_KERNELS set to `numba`
the folder is not used. Compiled functions leave the interpreter free (nogil).
"""

import importlib
import importlib.util
import json
import logging
import os
import pickle
from collections.abc import Callable
from functools import cached_property, update_wrapper
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from typing import Any

import numpy as np

_log = logging.getLogger("spherecal")
_FOLDER = Path(__file__).resolve().parents[1] / "_kernels"
# What x86-64-v3 (2013 on) has over the first 64-bit processors, as Linux names it.
_V3 = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave"}

Forms = dict[Any, Callable[..., Any]]

# As most kernels are compiled: released from Python's global lock, and cached on disk after the first call. "numpy":
# dividing by zero gives infinity, as in numpy, and no exception.
KERNEL: dict[str, Any] = {"nogil": True, "cache": True, "error_model": "numpy"}
# The same of kernels that make no array, without numba's run time: see spherecal/adjust/kernel.py.
BARE: dict[str, Any] = KERNEL | {"_nrt": False}


def _processor_flags() -> set[str]:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return set()
    lines = (line.partition(":")[2] for line in text.splitlines() if line.startswith("flags"))
    return set(next(lines, "").split())


def _library(folder: Path) -> Any:
    """The library for this processor; SPHERECAL_PROCESSOR names another one."""
    there = {file.name.partition(".")[0]: file for file in folder.glob("_kernels_*")}
    names = sorted(there, reverse=True)  # x86_64_v3 before x86_64
    asked = os.environ.get("SPHERECAL_PROCESSOR")
    if asked:
        names = [name for name in names if name == "_kernels_" + asked.replace("-", "_")]
    elif not _processor_flags() >= _V3:
        names = [name for name in names if not name.endswith("_v3")]
    if not names:
        raise ImportError("this program has no compiled kernels for this processor")
    loader = ExtensionFileLoader(names[0], str(there[names[0]]))
    spec = importlib.util.spec_from_file_location(names[0], there[names[0]], loader=loader)
    assert spec is not None
    library = importlib.util.module_from_spec(spec)
    loader.exec_module(library)
    return library


def _freeze(key: Any) -> Any:
    return tuple(_freeze(part) for part in key) if isinstance(key, list) else key


class Ahead:
    """The kernels compiled ahead: forms by module and name, and what they were compiled by and for."""

    def __init__(self, folder: Path) -> None:
        made, library = json.loads((folder / "kernels.json").read_text(encoding="utf-8")), _library(folder)
        self.numba = str(made["numba"])
        self.processor = library.__name__.partition("_kernels_")[2].replace("x86_64", "x86-64").replace("_", "-")
        self.forms: dict[tuple[str, str], Forms] = {}
        for module, name, key, symbol in made["kernels"]:
            self.forms.setdefault((module, name), {})[_freeze(key)] = getattr(library, symbol)


def _ahead() -> Ahead | None:
    if os.environ.get("SPHERECAL_KERNELS") == "numba" or not (_FOLDER / "kernels.json").is_file():
        return None
    try:
        return Ahead(_FOLDER)
    except ImportError as error:
        if importlib.util.find_spec("numba") is None:
            raise
        _log.warning("The kernels compiled ahead cannot be used (%s); numba compiles them.", error)
        return None


def key_of(one: Any, layout: str | None = None) -> Any:
    """The type of an argument as kernels.json names it; `layout` None for each array's own, C, F or A."""
    if isinstance(one, np.ndarray):
        flags = one.flags
        found = layout or ("C" if flags.c_contiguous else "F" if flags.f_contiguous else "A")
        return f"{one.dtype.str} {one.ndim} {found}" if flags.aligned else "unaligned"
    if isinstance(one, tuple):
        return tuple(key_of(part, layout) for part in one)
    if isinstance(one, bool | np.bool_):
        return "bool"
    if isinstance(one, int | np.integer):
        return "int"
    if isinstance(one, float | np.floating):
        return "float"
    return "none" if one is None else type(one).__name__


class Kernel:
    """A function with its forms compiled ahead, by the types of its arguments."""

    def __init__(self, function: Callable[..., Any], forms: Forms, options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self._forms, self._options = forms, options

    def __call__(self, *arguments: Any) -> Any:
        """The result, by the compiled form where there is one."""
        form = self._forms.get(tuple([key_of(one) for one in arguments]))
        if form is None:
            form = self._form_for(arguments)
        return form(*arguments)

    def _form_for(self, arguments: tuple[Any, ...]) -> Callable[..., Any]:
        exact = tuple(key_of(one) for one in arguments)
        form = self._forms.get(tuple(key_of(one, "A") for one in arguments))
        if form is None:
            what = f"{self.py_func.__module__}.{self.py_func.__name__} was not compiled for {exact}"
            if os.environ.get("SPHERECAL_KERNELS") == "strict":
                raise TypeError(what)
            try:
                form = self._by_numba
                _log.info("%s; numba compiles it.", what)
            except ImportError:
                form = self.py_func
                _log.warning("%s and runs slowly; please report this.", what)
        self._forms[exact] = form
        return form

    @cached_property
    def _by_numba(self) -> Any:
        return _by_numba(self.py_func, self._options)

    @cached_property
    def _numba_type_(self) -> Any:
        """How numba sees this kernel inside another one that it compiles: as its own."""
        return importlib.import_module("numba.core.types").Dispatcher(self._by_numba)


def _by_numba(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """The function compiled by numba, from its cache where that can be read.

    An index in the cache names classes of the version that wrote it. Where one of them has another name since, numba
    raises AttributeError before it looks whether the index is out of date; such an index counts as empty.
    """
    dispatcher = importlib.import_module("numba").njit(**options)(function)
    cache_file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if cache_file is not None:
        load = cache_file._load_index

        def load_index() -> dict[Any, str]:
            try:
                return load()
            except (AttributeError, ImportError, pickle.UnpicklingError, EOFError) as error:
                _log.info("Numba's cache of %s cannot be read (%s); it is compiled again.", function.__name__, error)
                return {}

        cache_file._load_index = load_index
    return dispatcher


AHEAD = _ahead()


def njit(*functions: Callable[..., Any], **options: Any) -> Any:
    """As numba's: a decorator, with or without options."""
    forms = None if AHEAD is None else AHEAD.forms

    def decorate(function: Callable[..., Any]) -> Any:
        if forms is None:
            return _by_numba(function, options)
        return Kernel(function, forms.get((function.__module__, function.__name__), {}), options)

    return decorate(functions[0]) if functions else decorate
