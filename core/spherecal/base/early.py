"""Before the program begins: no code from the working folder, and Ctrl-C ends it without a traceback.

Imports only what Python itself has loaded by then: this is the first code of the program that runs.
"""

import _signal  # type: ignore[import-not-found]  # the module `signal` takes some milliseconds more
import os
import sys

_PROGRAMS = ("spherecal", "spherecal.exe", "spherecal-script.py")
_MODULES = ("spherecal_app.cli.main", "spherecal", "spherecal.__main__")


def is_own_program() -> bool:
    """Whether this process is the command line program, and not another one that uses the package."""
    if os.path.basename(sys.argv[0] if sys.argv else "") in _PROGRAMS:
        return True
    return _module_run() in _MODULES


def leave_working_folder() -> None:
    """`python -m` puts the working folder first on the path: off again, before anything is imported from there."""
    ours = (_module_run() or "").partition(".")[0] in ("spherecal", "spherecal_gui")
    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(__file__))))
    if ours and not sys.flags.safe_path and os.path.realpath(sys.path[0]) != root:
        del sys.path[0]


def _module_run() -> str | None:
    """The module that Python was asked to run (`python -X dev -m NAME`); the options of other programs do not count."""
    words = iter(sys.orig_argv[1:])
    for word in words:
        if word == "-m":
            return next(words, None)
        if word in ("-X", "-W"):
            next(words, None)
        elif not word.startswith("-") or word == "-c":
            return None
    return None


def end_at_once() -> None:
    """Until `interrupts.begin` Ctrl-C ends the process with 130."""
    if is_own_program() and _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
        _signal.signal(_signal.SIGINT, _end)


def _end(*_: object) -> None:
    os.write(2, b"spherecal: Cancelled.\n")
    os._exit(130)
