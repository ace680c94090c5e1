"""What the bundle starts: the window, a command, or a child process of ours."""

import multiprocessing
import os
import sys
from pathlib import Path


def main() -> int:
    """As `spherecal` and `spherecal-gui` of the wheel; the exit code."""
    multiprocessing.freeze_support()  # children of PyInstaller's bundles arrive here and never return
    _have_streams()
    from spherecal_files.cache_folder import cache_folder

    os.environ.setdefault("MPLCONFIGDIR", str(cache_folder("matplotlib")))  # its list of fonts; see spherecal.spec
    arguments = sys.argv[1:]
    if arguments[:2] == ["-m", "spherecal_gui"]:  # what the command line runs with sys.executable
        arguments = arguments[2:]
    elif arguments and not Path(sys.argv[0]).stem.endswith("-gui"):
        from spherecal_app.cli.main import entry as command

        return command()
    sys.argv = [sys.argv[0], *opened(arguments)]
    from spherecal_gui.__main__ import main as window

    return window()


def opened(arguments: list[str]) -> list[str]:
    """The window's arguments where a file was double-clicked: a session is replayed, a project gone on with."""
    if len(arguments) != 1 or arguments[0].startswith("-") or not Path(arguments[0]).is_file():
        return arguments
    file = Path(arguments[0]).absolute()
    with file.open("rb") as stream:
        start = stream.read(200)
    if b"spherecal/session" in start:
        return ["--source", f"replay:{file.parent}"]
    return ["--open", str(file.parent)]


def _have_streams() -> None:
    """A Windows program without a console has none, and whoever prints would fail."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 (open until the end)


if __name__ == "__main__":
    sys.exit(main())
