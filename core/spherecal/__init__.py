"""SphereCal: calibration of multi-camera measuring rigs with an imperfect ball.

The names of `spherecal_app.api` are names of the package, loaded on first use: importing it alone costs milliseconds.
"""

from spherecal.base.early import end_at_once as _end_at_once
from spherecal.base.early import leave_working_folder as _leave_working_folder

_leave_working_folder()
_end_at_once()  # before all other imports, which take a quarter of a second

import importlib as _importlib  # noqa: E402
import os as _os  # noqa: E402
import sys as _sys  # noqa: E402
import tempfile as _tempfile  # noqa: E402
from pathlib import Path as _Path  # noqa: E402

__version__ = "0.1.0"


def _find_room_for_compiled_code() -> None:
    """Where neither the program's nor the user's folder can be written, numba's cache goes to the temporary files.

    numba itself would refuse to start. The folder is the user's alone, since what lies in such a cache is run.
    """
    if "NUMBA_CACHE_DIR" in _os.environ or _os.name == "nt":
        return
    cache = _Path(_os.environ.get("XDG_CACHE_HOME") or _Path(_os.path.expanduser("~")) / ".cache") / "numba"
    # os.path, since Path.exists raises where a folder on the way is another user's
    there = next(folder for folder in (cache, *cache.parents) if _os.path.exists(folder))
    kernels = _Path(__file__).parent / "adjust"
    if _os.access(there, _os.W_OK) or _os.access(kernels, _os.W_OK):
        return
    folder = _Path(_tempfile.gettempdir()) / f"spherecal-numba-{_os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        state = folder.lstat()
        if folder.is_symlink() or state.st_uid != _os.getuid() or state.st_mode & 0o077:
            folder = _Path(_tempfile.mkdtemp(prefix="spherecal-numba-"))
    except OSError:  # numba then says what is wrong, when a kernel is needed
        return
    _os.environ["NUMBA_CACHE_DIR"] = str(folder)


_find_room_for_compiled_code()

if "--multiprocessing-fork" in _sys.orig_argv:  # a child of ours; the programs call it when they begin
    from spherecal.base.working_folder import distrust as _distrust

    _distrust()


def __getattr__(name: str) -> object:
    """A name of the Python interface, found by its module's name: the method itself imports no interface."""
    interface = "spherecal_app.api"
    if name == "__path__" or (name.startswith("_") and name != "__all__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    names = _importlib.import_module(interface)
    if name != "__all__" and name not in names.__all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(names, name)


def __dir__() -> list[str]:
    return sorted((*__getattr__("__all__"), "__version__"))  # type: ignore[misc]
