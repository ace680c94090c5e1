"""Other programs, and ours in processes of their own: nothing of the working folder is run (docs/security.md)."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from spherecal.base.working_folder import BY_FOLDER


def own_program(module: str, *arguments: str) -> list[str]:
    """The command that runs a module of ours in a process of its own; the working folder is not on its path."""
    # the bundle's program is no interpreter: it takes `-m` itself (installer/entry.py)
    safe = [] if getattr(sys, "frozen", False) else ["-P"]
    return [sys.executable, *safe, "-m", module, *arguments]


def find_program(name: str, path: str | None = None) -> str | None:
    """The absolute path of another program, found on `path` (PATH); never in the working folder, except by a path."""
    if os.path.dirname(name):
        return os.path.abspath(name) if os.access(name, os.X_OK) else None
    return next((file for file in _candidates(name, path) if os.path.isfile(file) and os.access(file, os.X_OK)), None)


def _candidates(name: str, path: str | None) -> Iterator[str]:
    # not shutil.which, which begins in the working folder on Windows
    endings = ["", *os.environ.get("PATHEXT", "").split(os.pathsep)] if sys.platform == "win32" else [""]
    for folder in (path or os.environ.get("PATH", os.defpath)).split(os.pathsep):
        if os.path.isabs(folder):
            yield from (os.path.join(folder, name + ending) for ending in endings)


def process_runs(number: int) -> bool:
    """Whether there is a process of this number."""
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        pass
    return True


def users_environment() -> dict[str, str]:
    """The environment of commands that the user gives, which may name programs in the working folder."""
    return {name: value for name, value in os.environ.items() if name.upper() != BY_FOLDER.upper()}


@contextmanager
def elsewhere() -> Iterator[None]:
    """A block in the program's own folder, while no other thread reads files by relative paths; on Linux."""
    if sys.platform != "linux":
        yield
        return
    home = os.open(".", os.O_PATH | os.O_CLOEXEC)
    try:
        os.chdir(os.path.dirname(__file__))
        yield
    finally:
        os.fchdir(home)
        os.close(home)
