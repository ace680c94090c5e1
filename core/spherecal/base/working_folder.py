"""What lies in the working folder is neither run nor read for settings: it may have come on a stranger's stick.

A technician starts the program in the folder of a session. Python, numba, matplotlib and OpenCV would take code or
settings from there (docs/security.md has the list); programs of ours call `distrust` before they load any of them.
Settings are shut out without changing the folder: other threads may read files by relative paths meanwhile, and numba
looks again at every compilation.
"""

import os
import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from types import CodeType, ModuleType
from typing import Any

BY_FOLDER = "NoDefaultCurrentDirectoryInExePath"  # Windows then looks for programs on PATH only


def distrust() -> None:
    """From now on nothing is run or read from the working folder unless the user names it."""
    if sys.platform == "win32":
        os.environ[BY_FOLDER] = "1"
    if not any(isinstance(finder, _Guards) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Guards())
    if "multiprocessing.util" in sys.modules:
        _start_children_safely(sys.modules["multiprocessing.util"])


class _Guards:
    """Finds modules as the other finders do, and changes how those in `_LOADED` are loaded."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name not in _LOADED:
            return None
        found = (finder.find_spec(name, path, target) for finder in sys.meta_path if finder is not self)
        spec = next((one for one in found if one is not None), None)
        if spec is not None and spec.loader is not None:
            _LOADED[name](spec, spec.loader)
        return spec


def _without_numbas_file(spec: ModuleSpec, loader: Any) -> None:
    # numba takes no other file's settings: `isfile` of the null device is false
    _exchange(loader, ".numba_config.yaml", os.devnull)


def _without_matplotlibs_file(spec: ModuleSpec, loader: Any) -> None:
    # its own defaults come first, so that documents look the same everywhere
    _exchange(loader, "matplotlibrc", os.path.join(os.path.dirname(spec.origin or ""), "mpl-data", "matplotlibrc"))


def _exchange(loader: Any, name: str, instead: str) -> None:
    """Let a module look for another file: `instead` of `name`, in all its functions."""
    compiled = loader.get_code

    def get_code(module: str) -> CodeType:
        code = compiled(module)
        changed = _with_constant(code, name, instead)
        if changed == code and os.path.lexists(name):  # a version that looks for it in a way that we do not know
            raise ImportError(f"{module} would read {os.path.abspath(name)}: move that file away")
        return changed

    loader.get_code = get_code


def _with_constant(code: CodeType, old: str, new: str) -> CodeType:
    constants = (
        _with_constant(one, old, new) if isinstance(one, CodeType) else new if one == old else one
        for one in code.co_consts
    )
    return code.replace(co_consts=tuple(constants))


def _keeping_the_library_path(spec: ModuleSpec, loader: Any) -> None:
    """OpenCV appends an empty folder to LD_LIBRARY_PATH: children would load libraries from the working folder."""
    run = loader.exec_module

    def exec_module(module: ModuleType) -> None:
        before = os.environ.get("LD_LIBRARY_PATH")
        try:
            run(module)
        finally:
            if before is not None:
                os.environ["LD_LIBRARY_PATH"] = before
            else:
                os.environ.pop("LD_LIBRARY_PATH", None)

    loader.exec_module = exec_module


def _with_safe_children(spec: ModuleSpec, loader: Any) -> None:
    run = loader.exec_module

    def exec_module(module: ModuleType) -> None:
        run(module)
        _start_children_safely(module)

    loader.exec_module = exec_module


def _start_children_safely(util: Any) -> None:
    """Children and the resource tracker are `python -c`, which has the working folder first on its path without -P."""
    flags = util._args_from_interpreter_flags
    if getattr(sys, "frozen", False) or "-P" in flags():  # a bundle has a path of its own
        return
    util._args_from_interpreter_flags = lambda: [*flags(), "-P"]


_LOADED: dict[str, Callable[[ModuleSpec, Any], None]] = {
    "numba.core.config": _without_numbas_file,
    "matplotlib": _without_matplotlibs_file,
    "cv2": _keeping_the_library_path,
    "multiprocessing.util": _with_safe_children,
}
