"""Set-up and the daily commands of SphereCal; needs nothing but Python 3.11 or newer.

python3 dev.py demo     run the demonstration
python3 dev.py test     linters, type checker, dependency rules, then the tests (--fast: the quick ones of both;
                        --all: the matrices of faults, cameras and studies too, as the CI does)
python3 dev.py lint     all of that but the tests
python3 dev.py bench    the benchmarks
python3 dev.py studies  the studies of accuracy, convergence, outliers and detection (--quick: minutes)
python3 dev.py docs     the manual in build/site, its links checked
python3 dev.py build    wheels and sdist in dist, the manual inside
python3 dev.py installer  the program for people without Python, in dist: a folder, and a .deb of it
python3 dev.py pictures the README's pictures; --wizard FOLDER: of every page of the window, in every language and look
python3 dev.py translations  the window's texts collected and compiled; what is not translated yet
python3 dev.py lock     renew requirements.lock from pyproject.toml
python3 dev.py setup    only prepare the environment

Each command first makes sure that the environment is ready: a virtual environment in .venv with exactly the packages
of requirements.lock, and on Linux the system libraries that the window needs. What follows the command is passed on.
"""

from __future__ import annotations  # so that an older Python gets as far as saying that it is too old

import argparse
import ctypes
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
STAMP = VENV / "spherecal-setup.txt"
RUN_STAMP = VENV / "spherecal-setup-run.txt"  # the same where only ENGINE and RUN were installed, for the demo
INSTALLED_LOCK = VENV / "spherecal-requirements.lock"  # what the environment was last made from
KERNELS = VENV / "spherecal-kernels.txt"  # which kernels were compiled last, and where from
LOCK = ROOT / "requirements.lock"
# What the kernels trial loads (tests/installer/test_house.py compares): installed first, to compile beside the rest.
ENGINE = (
    "filelock", "llvmlite", "markdown-it-py", "mdurl", "numba", "numpy", "opencv-python-headless", "pillow",
    "platformdirs", "pygments", "pyyaml", "rich", "scipy", "threadpoolctl",
)  # fmt: skip
# What running the program (spherecal[cameras,gui,report]) and installing it takes besides: all that the demo waits for.
RUN = (
    "attrs", "certifi", "charset-normalizer", "colorama", "contourpy", "cycler", "cyclopts", "docstring-parser",
    "editables", "fonttools", "genicam", "harvesters", "hatchling", "idna", "kiwisolver", "matplotlib", "packaging",
    "pathspec", "pluggy", "pooch", "pyparsing", "pyqtgraph", "pyside6-essentials", "python-dateutil", "pyvista",
    "pyvista-validation", "requests", "rich-rst", "scooby", "shiboken6", "tomlkit", "trove-classifiers",
    "typing-extensions", "typst", "tzdata", "urllib3", "vtk",
)  # fmt: skip
BIN = VENV / ("Scripts" if os.name == "nt" else "bin")
PYTHON = BIN / ("python.exe" if os.name == "nt" else "python")

# Library -> Debian package. The window (Qt) needs the first group to load at all, the others to appear on a screen.
# Measured in a bare Debian 12; Qt's own message names libxcb-cursor0 whichever of the xcb libraries is missing.
SYSTEM_LIBRARIES = {
    "libGL.so.1": "libgl1", "libEGL.so.1": "libegl1", "libglib-2.0.so.0": "libglib2.0-0",
    "libfontconfig.so.1": "libfontconfig1", "libdbus-1.so.3": "libdbus-1-3", "libxkbcommon.so.0": "libxkbcommon0",
    "libxcb-cursor.so.0": "libxcb-cursor0", "libxcb-icccm.so.4": "libxcb-icccm4",
    "libxcb-keysyms.so.1": "libxcb-keysyms1", "libxcb-image.so.0": "libxcb-image0",
    "libxcb-render-util.so.0": "libxcb-render-util0", "libxcb-randr.so.0": "libxcb-randr0",
    "libxcb-shape.so.0": "libxcb-shape0", "libxcb-xkb.so.1": "libxcb-xkb1",
    "libxkbcommon-x11.so.0": "libxkbcommon-x11-0", "libX11-xcb.so.1": "libx11-xcb1", "libxcb-glx.so.0": "libxcb-glx0",
    "libxcb-sync.so.1": "libxcb-sync1", "libxcb-xfixes.so.0": "libxcb-xfixes0",
    "libwayland-client.so.0": "libwayland-client0", "libwayland-cursor.so.0": "libwayland-cursor0",
    "libwayland-egl.so.1": "libwayland-egl1",
}  # fmt: skip

# Program -> Debian package: for tests in a real window, on a simulated network and with compiled drivers, and fonts for
# the pictures of the window in Chinese. Without them those tests are skipped and say so.
TEST_PROGRAMS = {
    "Xvfb": "xvfb", "xdotool": "xdotool", "nft": "nftables", "tc": "iproute2", "pkg-config": "pkg-config", "g++": "g++",
}  # fmt: skip
TEST_HEADERS = {"/usr/include/aravis-0.8/arv.h": "libaravis-dev"}
CJK_FONTS = "fonts-noto-cjk"


class SetupError(Exception):
    """Something that the person at the keyboard has to know; its text is all they see."""


def say(text: str) -> None:
    """Print a line at once, so that it stands before what a child process prints."""
    print(text, flush=True)


# --- running other programs ------------------------------------------------------------------------------------------


def run(command: list[str | Path], env: dict[str, str] | None = None) -> int:
    """Run a program with our terminal and return its exit code; Ctrl-C is left to the program."""
    process = subprocess.Popen([str(part) for part in command], cwd=ROOT, env=env)
    while True:
        try:
            code = process.wait()
        except KeyboardInterrupt:
            continue
        return code if code >= 0 else 128 - code


class Ticker:
    """Shows the latest line of a long job and the seconds: in place on a terminal, else a line every few seconds."""

    def __init__(self) -> None:
        self.text = ""
        self._start = time.monotonic()
        self._terminal = sys.stdout.isatty()
        self._width = min(shutil.get_terminal_size().columns, 100) - 1
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Ticker:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._done.wait(0.2 if self._terminal else 5.0):
            line = f"  {time.monotonic() - self._start:4.0f} s  {self.text}"[: self._width]
            print(
                "\r" + line.ljust(self._width) if self._terminal else line,
                end="" if self._terminal else "\n",
                flush=True,
            )
        if self._terminal:
            print("\r" + " " * self._width + "\r", end="", flush=True)


def run_job(command: list[str | Path], env: dict[str, str] | None = None) -> tuple[int, list[str]]:
    """Run a talkative program, show its progress in one place; its exit code and all it printed."""
    with Ticker() as ticker:
        process = subprocess.Popen(
            [str(part) for part in command],
            cwd=ROOT,
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        assert process.stdout is not None
        lines: list[str] = []
        for line in process.stdout:
            lines.append(line.rstrip())
            ticker.text = shortened(line) or ticker.text
        return process.wait(), lines


# pip says these while it makes room for a newer version, then is silent until all packages are installed; its warnings
# are about the machine's own settings, and say nothing of how far it is.
_ASIDE = ("Attempting uninstall", "Found existing", "Uninstalling ", "Successfully uninstalled", "WARNING:")


def shortened(line: str) -> str:
    """What matters of a line of pip's or apt's; "" where the line before still says it better."""
    if line.strip().startswith(_ASIDE):
        return ""
    if line.startswith("Installing collected packages:"):
        return f"Installing {line.count(',') + 1} packages"
    return line.partition(" (from ")[0].strip()


def last_words(lines: list[str]) -> str:
    """What a failed program said last, indented; the errors only, where they are marked as such."""
    starts = ("error", "e:", "could not fetch")
    # pip names what it means in indented lines below an error
    errors = [
        line
        for before, line in zip(["", *lines], lines, strict=False)
        if line.lower().startswith(starts) or (line.startswith("    ") and before.lower().startswith((*starts, "    ")))
    ]
    return "\n".join(f"    {line}" for line in (errors or [line for line in lines if line.strip()])[-8:])


# --- system packages -------------------------------------------------------------------------------------------------


def apt_install(packages: list[str]) -> bool:
    """Install Debian packages if we are root and there is apt-get; whether it was done."""
    apt = shutil.which("apt-get")
    if apt is None or not hasattr(os, "geteuid") or os.geteuid() != 0:
        return False
    say(f"Installing system packages with apt-get: {' '.join(packages)}")
    env = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    install: list[str | Path] = [apt, "install", "-y", "--no-install-recommends", *packages]
    code, lines = run_job(install, env)
    if code != 0:  # no or old package lists
        run_job([apt, "update"], env)
        code, lines = run_job(install, env)
    if code != 0:
        say("apt-get could not install them:\n" + last_words(lines))
    return code == 0


def apt_line(packages: list[str]) -> str:
    """The command for somebody to type."""
    return "sudo apt-get install --no-install-recommends " + " ".join(packages)


def loads(library: str) -> bool:
    """Whether the dynamic loader finds a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def ensure_system_libraries() -> None:
    """Install the shared libraries that the window needs, or say how; without them all but the window works."""
    if not sys.platform.startswith("linux"):
        return
    missing = [library for library in SYSTEM_LIBRARIES if not loads(library)]
    if not missing:
        return
    packages = [SYSTEM_LIBRARIES[library] for library in missing]
    if apt_install(packages):
        return
    if shutil.which("apt-get"):
        say(f"The window needs system libraries that are missing; install them with:\n\n    {apt_line(packages)}\n")
    else:
        say(f"The window needs system libraries that are missing here: {' '.join(missing)}")
    say("Everything but the window works without them.")


# --- the virtual environment -----------------------------------------------------------------------------------------


def wanted_stamp() -> str:
    """What the environment was made from and for; another answer means to make it again."""
    import tomllib  # not there before Python 3.11

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    made_from = LOCK.read_bytes() + json.dumps(project, sort_keys=True).encode()
    return f"{hashlib.sha256(made_from).hexdigest()}\n{sys.version}\n{sys.base_prefix}\n{VENV}\n"


def stamps() -> list[str]:
    """What .venv was made from: of everything, of the packages that run the program, or of both in turn."""
    there = [path for path in (STAMP, RUN_STAMP) if PYTHON.exists() and path.exists()]
    return [path.read_text(encoding="utf-8") for path in there]


def is_ready(whole: bool = True) -> bool:
    """Whether .venv is made from the present lock file by this Python: complete, or able to run the program."""
    return wanted_stamp() in stamps() and (not whole or STAMP.exists())


def can_be_updated() -> bool:
    """Whether .venv was finished once, by this very Python and in this place: only packages can differ."""
    return wanted_stamp().partition("\n")[2] in [stamp.partition("\n")[2] for stamp in stamps()]


def make_venv() -> None:
    """Create .venv, in place of an older one."""
    if VENV.exists():
        if not (VENV / "pyvenv.cfg").exists() and any(VENV.iterdir()):
            raise SetupError(f"{VENV} is no virtual environment; move it away and try again.")
        shutil.rmtree(VENV)
    ensure_venv_module()
    say(f"Making the virtual environment {VENV.name} with Python {sys.version.split()[0]}")
    code, lines = run_job([sys.executable, "-m", "venv", VENV])
    if code != 0:
        raise SetupError("The virtual environment could not be made:\n" + last_words(lines))


def ensure_venv_module() -> None:
    """See that this Python can make environments; Debian and Ubuntu keep the modules in a package of their own."""
    if not can_make_venv():
        packages = [f"python{sys.version_info.major}.{sys.version_info.minor}-venv"]
        if not apt_install(packages) or not can_make_venv():
            raise SetupError(
                f"This Python cannot make virtual environments (its modules venv and ensurepip are missing).\n"
                f"On Debian and Ubuntu install them with:\n\n    {apt_line(packages)}\n\nand try again."
            )


def can_make_venv() -> bool:
    """Whether the modules are there; asked in a new process, since they may just have been installed."""
    probe = [sys.executable, "-c", "import ensurepip, venv"]
    return subprocess.run(probe, capture_output=True, check=False).returncode == 0


def pip_install(arguments: list[str | Path], python: Path = PYTHON) -> list[str]:
    """Run pip in the environment; what it printed."""
    options: list[str | Path] = ["--disable-pip-version-check", "--no-input", "--progress-bar", "off"]
    code, lines = run_job([python, "-m", "pip", "install", *options, *arguments])
    if code != 0:
        raise SetupError(
            "pip could not install the packages:\n" + last_words(lines) + "\n"
            "Check the network (and a proxy or package mirror in pip's configuration), then try again."
        )
    return lines


def downloaded_megabytes(lines: list[str]) -> float:
    """The sum of the sizes pip names in its lines 'Downloading NAME (1.2 MB)'; cached files are not counted."""
    units = {"bytes": 1e-6, "kB": 1e-3, "MB": 1.0, "GB": 1e3}
    total = 0.0
    for line in lines:
        words = line.split("(")[-1].rstrip(")").split()
        if line.strip().startswith("Downloading") and len(words) == 2 and words[1] in units:
            total += float(words[0]) * units[words[1]]
    return total


def locked_names(lock: Path) -> set[str]:
    """The packages that a lock file names; none where there is no such file."""
    lines = lock.read_text(encoding="utf-8").splitlines() if lock.exists() else []
    return {line.partition("==")[0].strip() for line in lines if "==" in line and not line.startswith((" ", "#"))}


def lock_of(names: Sequence[str]) -> str:
    """The part of the lock file about these packages, hashes included."""
    entries = re.split(r"\n(?=[a-z0-9])", LOCK.read_text(encoding="utf-8"))
    return "\n".join(entry for entry in entries if re.split(r"[=\[ ;]", entry, maxsplit=1)[0] in names) + "\n"


def install_packages(whole: bool = True) -> list[str]:
    """Bring .venv to the lock file, whatever is in it, the kernels compiled beside it; what pip printed.

    Not `whole`: only what running the program takes. The program compiles what it needs then.
    """
    if not whole:
        lines = install_some((*ENGINE, *RUN)) + install_the_program()
        RUN_STAMP.write_text(wanted_stamp(), encoding="utf-8")
        return lines
    lines = install_some(ENGINE)
    with kernels_compiled("the installation"):
        lines += pip_install(["--require-hashes", "-r", LOCK]) + install_the_program()
        STAMP.write_text(wanted_stamp(), encoding="utf-8")
        return lines


def install_some(names: Sequence[str]) -> list[str]:
    """Packages of the lock file; what pip printed. Python compiles the modules that are imported, pip would all."""
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder) / "some.txt"
        part.write_text(lock_of(names), encoding="utf-8")
        return pip_install(["--no-compile", "--require-hashes", "-r", part])


def install_the_program() -> list[str]:
    """SphereCal itself, and nothing that an earlier lock file brought; what pip printed."""
    # what was installed by hand stays; only what an earlier lock file brought and this one does not name goes
    gone = sorted(locked_names(INSTALLED_LOCK) - locked_names(LOCK))
    if gone:
        run_job([PYTHON, "-m", "pip", "uninstall", "--disable-pip-version-check", "-y", *gone])
    lines = pip_install(["--no-deps", "--no-build-isolation", "-e", ROOT])
    shutil.copyfile(LOCK, INSTALLED_LOCK)
    return lines


def updated_in_place(whole: bool) -> bool:
    """Install what changed since .venv was made, under whoever is using it; False where that did not work."""
    say(f"Installing what changed in {LOCK.name} and pyproject.toml")
    try:
        start, lines = time.monotonic(), install_packages(whole)
    except SetupError as error:
        say(f"{VENV.name} could not be brought up to date as it is; it is made again.\n{error}")
        return False
    changed = next((line for line in reversed(lines) if line.startswith("Successfully installed")), "")
    say(f"The environment is ready: {time.monotonic() - start:.0f} s, {len(changed.split()[2:])} packages changed")
    return True


def ensure_venv(whole: bool = True) -> None:
    """Make .venv as the lock file says, if it is not so already: by its changes where possible, else again.

    Not `whole`: at least what running the program takes.
    """
    whole = whole or STAMP.exists()
    if is_ready(whole) or (can_be_updated() and updated_in_place(whole)):
        return
    start, old = time.monotonic(), VENV.with_name(VENV.name + ".old")
    if stamps():  # one that worked: kept until the new one does
        shutil.rmtree(old, ignore_errors=True)
        VENV.rename(old)
    try:
        make_venv()
        say(f"Installing packages of {LOCK.name} (some {600 if whole else 400} MB to download the first time)")
        lines = install_packages(whole)
    except (SetupError, OSError, KeyboardInterrupt):
        if old.exists():
            shutil.rmtree(VENV, ignore_errors=True)
            old.rename(VENV)
        raise
    shutil.rmtree(old, ignore_errors=True)
    seconds, megabytes = time.monotonic() - start, downloaded_megabytes(lines)
    say(f"The environment is ready: {seconds:.0f} s, {megabytes:.0f} MB downloaded")


def ensure_setup(whole: bool = True) -> None:
    """Everything that the commands below need; not `whole`: that the program runs."""
    ensure_system_libraries()
    ensure_venv(whole)


# --- commands --------------------------------------------------------------------------------------------------------


def tool_env() -> dict[str, str]:
    """For tests and benchmarks: no window on the screen, one thread for each process's linear algebra."""
    single = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    return single | {"QT_QPA_PLATFORM": "offscreen", "PYTHONFAULTHANDLER": "1"} | os.environ


def demo(arguments: list[str]) -> int:
    """The wizard on the simulated rig where there is a screen, else (or with arguments) `spherecal demo`."""
    if not arguments and has_screen():
        say("The wizard opens on a simulated rig. Without a window: python3 dev.py demo -o FOLDER")
        return run([PYTHON, "-m", "spherecal_gui", "--source", "simulated:demo", "--projects", "spherecal-demo"])
    return run([BIN / "spherecal", "demo", *arguments])


def has_screen() -> bool:
    """Whether a window can be opened here."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def checks(fast: bool = False) -> dict[str, list[str | Path]]:
    """The checks that need no test, by name; the quick ones only, if asked for."""
    quick: dict[str, list[str | Path]] = {
        "ruff check": [BIN / "ruff", "check", "--quiet"],
        "ruff format": [BIN / "ruff", "format", "--check", "--quiet"],
    }
    if fast:
        return quick
    return quick | {
        "types": [BIN / "basedpyright", "--pythonpath", PYTHON, "--warnings"],
        "dependency rules": [BIN / "lint-imports", "--no-logo"],
    }


def lint(_: list[str], fast: bool = False) -> int:
    """Run the checks that need no test; all of them, whichever fails."""
    failed = []
    for name, command in checks(fast).items():
        say(f"== {name}: {shlex.join(['NAME', *map(str, command[1:])]).replace('NAME', Path(command[0]).name, 1)}")
        if run(command, tool_env()) != 0:
            failed.append(name)
    if failed:
        say(f"FAILED: {', '.join(failed)}")
    return 1 if failed else 0


def _tool_path() -> str:
    """Where programs are looked for; those of the administrator are not in everybody's PATH."""
    return os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin", "/sbin"))


def ensure_test_programs() -> None:
    """Install what only tests need, where that is possible; say how where it is not."""
    missing = [
        package for program, package in TEST_PROGRAMS.items() if shutil.which(program, path=_tool_path()) is None
    ]
    missing += [package for header, package in TEST_HEADERS.items() if not Path(header).exists()]
    if not sys.platform.startswith("linux") or not missing or apt_install(missing):
        return
    if shutil.which("apt-get"):
        say(f"Some tests are skipped (windows, networks, compiled drivers); they need:\n\n    {apt_line(missing)}\n")


def kernels_wanted() -> str:
    """What numba's cache of compiled kernels depends on: each file with kernels as it lies there, and this Python."""
    files = [path for path in sorted((ROOT / "core").rglob("*.py")) if b"njit" in path.read_bytes()]
    known = [f"{path.relative_to(ROOT)} {path.stat().st_mtime_ns} {path.stat().st_size}" for path in files]
    return "\n".join([*known, STAMP.read_text(encoding="utf-8") if STAMP.exists() else sys.version])


def drop_kernels() -> None:
    """Delete numba's cache: it notices a change of a kernel's own file, but none of the files whose code is in it."""
    for path in (ROOT / "core").rglob("*.nb[ic]"):
        path.unlink(missing_ok=True)


@contextmanager
def kernels_compiled(beside: str) -> Iterator[None]:
    """Compile the engine's kernels on all cores beside what the body does; after it they are there, for all processes.

    Otherwise the first calibration would wait for them, and every worker of the tests would compile them for itself.
    """
    wanted = kernels_wanted()
    if KERNELS.exists() and KERNELS.read_text(encoding="utf-8") == wanted:
        yield
        return
    drop_kernels()
    say(f"Compiling the kernels beside {beside}")
    paths = os.pathsep.join([str(ROOT / "core"), str(ROOT)])
    command: list[str | Path] = [PYTHON, "-m", "spherecal_app.cli.main", "compile-kernels"]
    with tempfile.TemporaryFile("w+") as printed:
        process = subprocess.Popen(
            [str(part) for part in command],
            cwd=ROOT,
            env=tool_env() | {"PYTHONPATH": paths},
            stdout=printed,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            yield
            start = time.monotonic()
            with Ticker() as ticker:
                ticker.text = "Compiling the kernels"
                code = process.wait()
            if code == 0:
                KERNELS.write_text(kernels_wanted(), encoding="utf-8")
                say(f"The kernels are compiled, {time.monotonic() - start:.0f} s after {beside}")
            else:  # whoever needs one compiles it, and says what is wrong
                printed.seek(0)
                say("The kernels could not all be compiled beforehand:\n" + last_words(printed.read().splitlines()))
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()


def test(arguments: list[str]) -> int:
    """Run the checks, then the tests; pytest's closing line comes last."""
    fast = "--fast" in arguments
    if not fast:
        ensure_test_programs()
    whole = not any((ROOT / argument.partition("::")[0]).exists() for argument in arguments)
    with kernels_compiled("the checks") if whole else nullcontext():
        lint_code = lint([], fast)
    say("== tests: pytest")
    # each file by one worker, so that what its tests share is made once; the order is that of tests/conftest.py; one
    # worker more than there are processors, since tests of cameras and windows wait most of their time
    spread = ["-n", str(min(1 + (os.cpu_count() or 2), 8)), "--dist", "loadfile", "--no-loadscope-reorder"]
    code = run([PYTHON, "-m", "pytest", *spread, *arguments], tool_env())
    if code == 0 and lint_code != 0:
        say("The tests passed, but the checks before them FAILED (see above).")
    return code or lint_code


def bench(arguments: list[str]) -> int:
    """Run the benchmarks named, `benchmarks/NAME.py`, with the arguments after the name; all of them without a name."""
    known = sorted(path.stem for path in (ROOT / "benchmarks").glob("bench_*.py"))
    if arguments and not arguments[0].startswith("-"):
        name = arguments[0] if arguments[0] in known else f"bench_{arguments[0]}"
        if name not in known:
            raise SetupError(f"There is no benchmark {arguments[0]!r}; there are: {', '.join(known)}.")
        known, arguments = [name], arguments[1:]
    code = 0
    for name in known:
        say(f"== {name}")
        code = run([PYTHON, ROOT / "benchmarks" / f"{name}.py", *arguments], tool_env()) or code
    return code


def studies(arguments: list[str]) -> int:
    """Run `benchmarks.studies`, which writes its pages into benchmarks/studies."""
    return run([PYTHON, "-m", "benchmarks.studies", *arguments], tool_env())


def pictures(arguments: list[str]) -> int:
    """The pictures of the README, made again from the demo; `--wizard FOLDER`: of the wizard's pages instead."""
    if arguments[:1] == ["--wizard"] and sys.platform.startswith("linux") and shutil.which("fc-list"):
        fonts = subprocess.run(["fc-list", ":lang=zh-cn"], capture_output=True, text=True, check=False).stdout
        if not fonts.strip() and not apt_install([CJK_FONTS]):
            say(f"Chinese letters will show as boxes; install: {apt_line([CJK_FONTS])}")
    return run([PYTHON, ROOT / "docs" / "make_pictures.py", *arguments], tool_env())


def docs(arguments: list[str]) -> int:
    """The manual as a website for reading offline, `--strict`; `--pictures` takes its screenshots again first."""
    if "--pictures" in arguments:
        arguments = [argument for argument in arguments if argument != "--pictures"]
        if code := run([PYTHON, ROOT / "docs" / "make_guide_pictures.py"], tool_env()):
            return code
    site = ROOT / "build" / "site"
    shutil.rmtree(site, ignore_errors=True)
    if code := run([BIN / "zensical", "build", "--strict", "--clean", *arguments], tool_env()):
        return code
    return run([PYTHON, ROOT / "docs" / "make_offline.py", site]) or run(
        [PYTHON, ROOT / "docs" / "check_links.py", site]
    )


def build(arguments: list[str]) -> int:
    """Wheel and sdist in `dist` (or after `-d`), the manual inside; where gcc is, a wheel with compiled kernels too."""
    if code := docs([]):
        return code
    goal = [] if "-d" in arguments else ["-d", "dist"]
    hatchling: list[str | Path] = [BIN / "hatchling", "build", *goal, *arguments, "-t", "wheel"]
    if code := run([*hatchling, "-t", "sdist"], tool_env()):
        return code
    folder = ROOT / "build" / "kernels"
    make = "import sys, pathlib, kernels; lacks = kernels.missing(); "
    make += "sys.exit(f'No wheel with compiled kernels: that needs {lacks}.') if lacks else "
    make += "kernels.ready_kernels(pathlib.Path(sys.argv[1]))"
    say("== kernels: compiled for the wheel of this platform")
    if run([PYTHON, "-c", make, folder], tool_env() | {"PYTHONPATH": str(ROOT / "installer")}):
        return 0  # the pure wheel works everywhere
    return run(hatchling, tool_env() | {"SPHERECAL_WHEEL_KERNELS": str(folder / "_kernels")})


def installer(arguments: list[str]) -> int:
    """The one-folder bundle and, on Debian and Ubuntu, the .deb (installer/bundle.py)."""
    return docs([]) or run([PYTHON, ROOT / "installer" / "bundle.py", *arguments], tool_env())


def translations(arguments: list[str]) -> int:
    """Collect the window's texts into resources/translations, compile what is translated; 1 where something is not."""
    return run([PYTHON, ROOT / "docs" / "make_translations.py", *arguments])


def lock(arguments: list[str]) -> int:
    """Resolve all extras and groups of pyproject.toml; with `--upgrade` to the newest versions."""
    ensure_venv_module()
    with tempfile.TemporaryDirectory() as folder:  # .venv may be what the lock is needed for
        say("Fetching uv, the resolver")
        run_job([sys.executable, "-m", "venv", folder])
        python = Path(folder) / PYTHON.relative_to(VENV)
        pip_install(["uv"], python)
        command = "pip compile --universal --python-version 3.11 --generate-hashes --no-header --no-annotate"
        command += " --no-emit-index-url --no-emit-find-links --quiet --extra all"
        command += " --group dev --group docs --group installer --group bench"
        command += " pyproject.toml --output-file requirements.lock"
        code = run([python.parent / "uv", *command.split(), *arguments])
    if code == 0 and "://" in LOCK.read_text(encoding="utf-8"):
        raise SetupError("The new requirements.lock holds a web address; do not commit it.")
    return code


def setup(_: list[str]) -> int:
    """Nothing more to do."""
    say("Ready.")
    return 0


COMMANDS: dict[str, Callable[[list[str]], int]] = {
    command.__name__: command
    for command in (
        demo, test, lint, bench, pictures, translations, studies, docs, build, installer, lock, setup,
    )
}  # fmt: skip


def main() -> int:
    """Prepare the environment and run one command; its exit code."""
    parser = argparse.ArgumentParser(
        prog="dev.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help=" | ".join(COMMANDS))
    parser.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...", help="passed on")
    options = parser.parse_args()
    try:
        if options.command != "lock":
            ensure_setup(whole=options.command != "demo")
        return COMMANDS[options.command](options.arguments)
    except SetupError as error:
        print(f"dev.py: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"dev.py: {error.strerror}: {error.filename}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nStopped.", file=sys.stderr)
        return 130


if __name__ == "__main__":
    if sys.version_info < (3, 11):  # noqa: UP036
        sys.exit("dev.py: SphereCal needs Python 3.11 or newer; this is Python {}.{}.".format(*sys.version_info[:2]))
    sys.exit(main())
