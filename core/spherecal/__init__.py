"""SphereCal: calibration of multi-camera measuring rigs with an imperfect ball.

The names of `spherecal_app.api` are names of the package, loaded on first use: importing it alone costs milliseconds.
"""

from spherecal.base.early import end_at_once as _end_at_once
from spherecal.base.early import leave_working_folder as _leave_working_folder

_leave_working_folder()
_end_at_once()  # before all other imports

import os as _os  # noqa: E402
import sys as _sys  # noqa: E402

__version__ = "0.1.0"


def _find_room_for_compiled_code() -> None:
    """Where neither the program's nor the user's folder can be written, numba's cache goes to the temporary files.

    numba itself would refuse to start. The folder is the user's alone, since what lies in such a cache is run.
    """
    if "NUMBA_CACHE_DIR" in _os.environ or _os.name == "nt":
        return
    join, parent = _os.path.join, _os.path.dirname
    cache = join(_os.environ.get("XDG_CACHE_HOME") or join(_os.path.expanduser("~"), ".cache"), "numba")
    there = cache
    while not _os.path.exists(there) and there != parent(there):
        there = parent(there)
    kernels = join(parent(__file__), "adjust")
    if _os.access(there or ".", _os.W_OK) or _os.access(kernels, _os.W_OK):
        return
    import tempfile  # here: with what it loads it takes longer than all else of the package

    folder = join(tempfile.gettempdir(), f"spherecal-numba-{_os.getuid()}")
    try:
        if not _os.path.lexists(folder):
            _os.mkdir(folder, 0o700)
        state = _os.lstat(folder)
        ours = state.st_uid == _os.getuid() and not state.st_mode & 0o077
        if not ours or not _os.path.isdir(folder) or _os.path.islink(folder):
            folder = tempfile.mkdtemp(prefix="spherecal-numba-")
    except OSError:  # numba then says what is wrong, when a kernel is needed
        return
    _os.environ["NUMBA_CACHE_DIR"] = folder


_find_room_for_compiled_code()

if "--multiprocessing-fork" in _sys.orig_argv:  # a child of ours; the programs call it when they begin
    from spherecal.base.working_folder import distrust as _distrust

    _distrust()


class _Package(type(_sys)):
    """The package as a module without its inner modules that read as verbs: `spherecal.calibrate` is no name of it."""

    def __setattr__(self, name: str, value: object) -> None:
        # Python binds each module that it loads to its package; `from spherecal.calibrate import ...` works without
        if name not in ("calibrate", "cross_validate", "detect", "verify"):
            super().__setattr__(name, value)


def __getattr__(name: str) -> object:
    """A name of the Python interface, found by its module's name: the method itself imports no interface."""
    import importlib

    if name == "__path__" or (name.startswith("_") and name != "__all__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    names = importlib.import_module("spherecal_app.api")
    if name != "__all__" and name not in names.__all__:
        import difflib

        like = difflib.get_close_matches(name, names.__all__, 3)
        meant = [one for one in names.__all__ if one.startswith(f"{name}_")] or like
        also = f"; is {' or '.join(meant)} meant?" if meant else "; dir(spherecal) lists its names"
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{also}")
    return getattr(names, name)


def __dir__() -> list[str]:
    return sorted((*__getattr__("__all__"), "__version__"))  # type: ignore[misc]


_sys.modules[__name__].__class__ = _Package
