"""The working folder as the place of attack: canaries for modules, packages, settings, libraries and programs."""

import ctypes
import hashlib
import importlib.metadata
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.studies.hostile_commands import COMMANDS, Command
from benchmarks.studies.hostile_inputs import Ground
from spherecal_gentl.producer.build_producer import build_producer

OURS = ("spherecal", "spherecal_gui", "spherecal_documents.scene", "spherecal_sim", "spherecal_study")
# By the dependency that reads it there, or has been said to; the rest was seen by strace.
SETTINGS = {
    "numba": {".numba_config.yaml": b"disable_jit: [1\n"},
    "matplotlib": {"matplotlibrc": b"\xff\xfe", "matplotlib.style": b"\xff"},
    "Qt": {
        "qt.conf": b"[Paths]\nPlugins=.\n", "qt6.conf": b"[Paths]\nPlugins=.\n", "platforms/libqoffscreen.so": b"",
        ":/non-existent": b"x",
    },
    "pyvista, VTK": {"pyvista.conf": b"x", ".pyvista": b"x", "vtk.conf": b"x"},
    "OpenCV": {"config.py": b"raise SystemExit", "opencv.conf": b"x", "libopencv_core_parallel_tbb.so": b""},
    "fontconfig": {"fonts.conf": b"<x", ".fonts.conf": b"<x"},
    "PyYAML": {"yaml.conf": b"x"},
    "harvesters, GenICam": {"log4cpp.properties": b"x", "DefaultLogging.properties": b"x", "canary.cti": b"\x7fELF"},
    "dask": {"dask.yaml": b"x: [", ".dask/dask.yaml": b"x: ["},
    "Python": {"pyvenv.cfg": b"home = .\n", "python311._pth": b".\n", "canary.pth": b"import os; os._exit(9)\n"},
    "spherecal": dict.fromkeys(
        ("session.json", "targets.json", "limits.json", "bars.json", "rig.json", "profile.json", "wizard.json",
         "truth.json", "observations.csv", "config.toml", "frame.json", "ball.json", "drivers.json"), b"{",
    ),
    "git": {".git/config": b"[core]\n\tfsmonitor = ./git\n"},
    "X11, Mesa": {".drirc": b"<x", "drirc": b"<x", ".Xdefaults": b"x"},
}  # fmt: skip
_PROGRAMS = (
    "python", "python3", "git", "g++", "gcc", "c++", "clang++", "pkg-config", "fc-list", "uname", "ldconfig", "sh",
    "env", "unshare", "nsenter", "ip", "paplay", "aplay", "pw-play", "xdg-open", "ldd", "objdump", "ld", "lscpu",
)  # fmt: skip
_OPENED, _FOLDER = 0x20, 0x40000000  # IN_OPEN, IN_ISDIR of inotify(7)
_WINDOW_S = 20.0
_TIME = re.compile(r"\d{8}T\d+Z")  # checks of a profile are called by theirs


def make_canaries(folder: Path, sign: Path) -> int:
    """Fill a folder; what is run writes its name to `sign`. The number of canaries."""
    modules = {*sys.stdlib_module_names, *importlib.metadata.packages_distributions(), *OURS}
    modules |= {"sitecustomize", "usercustomize", "__main__", "canary"}
    run = "import os\nwith open({sign!r}, 'a') as said:\n    said.write({name!r} + '\\n')\n"
    for name in modules:
        (folder / f"{name}.py").write_text(run.format(sign=str(sign), name=name))
    groups = ("exporters", "importers", "camera_sources")
    points = "".join(f"[spherecal.{group}]\nopencv = canary:x\ncanary = canary:x\n" for group in groups)
    files = {name: data for one in SETTINGS.values() for name, data in one.items()}
    files |= {"canary-1.0.dist-info/entry_points.txt": points.encode()}
    files |= {"canary-1.0.dist-info/METADATA": b"Metadata-Version: 2.1\nName: canary\nVersion: 1.0\n"}
    files |= dict.fromkeys(_libraries(), b"no library")
    for name in _PROGRAMS:
        files[name] = f"#!/bin/sh\necho {name} >> '{sign}'\nexit 1\n".encode()
    for name, data in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    for name in _PROGRAMS:
        (folder / name).chmod(0o755)
    return len(modules) + len(files)


def _libraries() -> set[str]:
    """The names of this machine's shared libraries."""
    listed = subprocess.run(["/sbin/ldconfig", "-p"], capture_output=True, text=True, check=True).stdout
    return {line.split()[0] for line in listed.splitlines()[1:] if "/" not in line.split()[0] and ".so" in line}


@contextmanager
def watched(folder: Path) -> Iterator[set[str]]:
    """The names of files below a folder that any process opens meanwhile, and `.` where it is listed."""
    libc, opened = ctypes.CDLL(None, use_errno=True), set()
    queue = libc.inotify_init()
    places = {
        libc.inotify_add_watch(queue, os.fsencode(place), _OPENED): place
        for place in (folder, *(path for path in folder.rglob("*") if path.is_dir()))
    }
    ended, end = os.pipe()

    def follow() -> None:
        while True:
            data, at = os.read(queue, 1 << 16), 0
            while at < len(data):
                place, mask, _, length = struct.unpack_from("iIII", data, at)
                name = data[at + 16 : at + 16 + length].rstrip(b"\0").decode(errors="replace")
                if name == "spherecal-watch-ends":
                    os.write(end, b"x")
                    return
                path = (places[place] / name).relative_to(folder)
                opened.add(f"{path}/" if mask & _FOLDER else str(path))
                at += 16 + length

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    try:
        yield opened
    finally:
        last = folder / "spherecal-watch-ends"
        last.write_bytes(b"")
        os.read(ended, 1)
        thread.join()
        last.unlink()
        for number in (queue, ended, end):
            os.close(number)


@dataclass
class Attacked:
    """Entry points that were started among canaries: how many of each kind, canaries, and everything that was wrong."""

    canaries: int = 0
    runs: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Start:
    """An entry point: of which kind, its command, and when it is ended.

    `{given}` is where its `inputs` are copied, `{out}` where it writes; a window is ended after so many seconds.
    """

    kind: str
    command: Sequence[str]
    inputs: tuple[str, ...] = ()
    ended_after: float | None = None
    environment: dict[str, str] = field(default_factory=dict)


# Commands that hostile inputs are not given to.
_MORE = {
    "doctor": Command((), "doctor"),
    "version": Command((), "--version"),
    "help": Command((), "help calibrate"),
    "completion": Command((), "completion bash"),
    "cross-validate": Command(("session",), "cross-validate {given}/session"),
    "measure": Command(("session", "result1"), "measure {given}/session --rig {given}/result1/rig.json -o {out}"),
    "bars show": Command(("bars.json",), "bars show B7 --registry {given}/bars.json"),
    "override": Command(("result1",), "override {given}/result1 --by somebody --reason none"),
    "bars export": Command(("bars.json",), "bars export {out} --registry {given}/bars.json", ending=".csv"),
    "bars remove": Command(("bars.json",), "bars remove B7 --registry {given}/bars.json"),
    "bars plan": Command(("result1",), "bars plan {given}/result1/rig.json -o {out}"),
    "batch, two processes": Command(("session", "pictures"), "batch {given} -o {out} --workers 2 --method rigid"),
    "compile-kernels": Command((), "compile-kernels"),
    "study": Command((), "study loss --runs 2 --workers 2 -o {out}"),
    "cameras list, simulated": Command((), "cameras list --source simulated:demo"),
    "cameras capture": Command(("session",), "cameras capture -o {out} --source replay:{given}/session --no-wait"),
    "bars import": Command(("bars.json",), "bars import {given}/bars.json --registry {given}/bars.json"),
    "cameras show": Command((), "cameras show SIM01"),
    "cameras set": Command((), "cameras set SIM01"),
    "cameras trust": Command((), "cameras trust"),
    "build-producer": Command((), "cameras build-producer -o {out}"),
}


def starts(ground: Ground) -> list[Start]:
    """Every command by its program, and the other entry points with the processes that they start."""
    program, window = (str(Path(sys.executable).with_name(name)) for name in ("spherecal", "spherecal-gui"))
    found = [
        Start(f"spherecal {name}", [program, *one.words.replace("{out}", f"{{out}}{one.ending}").split()], one.inputs)
        for name, one in (COMMANDS | _MORE).items()
        if one.words
    ]
    safe = [sys.executable, "-P", "-m"]
    producer = {"GENICAM_GENTL64_PATH": str(ground.root / "producer")}
    projects = ["--projects", "{out}"]
    return [
        *found,
        Start("camera process", [program, "cameras", "doctor"], environment=producer),
        Start("camera process, images", [program, "cameras", "list"], environment=producer),
        Start("demo", [program, "demo", "-o", "{out}"]),
        Start("python -P -m spherecal", [*safe, "spherecal", "doctor"]),
        Start("python -P -m spherecal_app.cli.main", [*safe, "spherecal_app.cli.main", "doctor"]),
        Start("spherecal, the window", [program], ended_after=_WINDOW_S),
        Start("spherecal-gui", [window, "--source", "simulated:demo", *projects], ended_after=_WINDOW_S),
        Start("spherecal-gui, GenICam", [window, "--source", "genicam", *projects], (), _WINDOW_S, producer),
        Start("python -P -m spherecal_gui", [*safe, "spherecal_gui", *projects], ended_after=_WINDOW_S),
    ]


def attack(ground: Ground, names: Sequence[str] = ()) -> Attacked:
    """Start the entry points (those of `names`, or all) in a folder of canaries and in an empty one, and compare."""
    found, sign = Attacked(), ground.root / "run.txt"
    canaries, empty = ground.root / "canaries", ground.root / "empty"
    canaries.mkdir()
    empty.mkdir()
    found.canaries = make_canaries(canaries, sign)
    build_producer(ground.root / "producer")
    for start in starts(ground):
        if names and start.kind not in names:
            continue
        expected = _outcome(start, empty, ground)
        with watched(canaries) as opened:
            given = _outcome(start, canaries, ground)
        found.runs[start.kind] = found.runs.get(start.kind, 0) + 1
        said = sign.read_text().split() if sign.exists() else []
        sign.unlink(missing_ok=True)
        for what, wrong in (("run", said), ("opened", sorted(opened)), ("changed", _changes(expected, given))):
            if wrong:
                found.problems.append(f"{start.kind}: {what}: {' '.join(map(str, wrong[:20]))}")
    return found


def _changes(expected: dict[str, str], given: dict[str, str]) -> list[str]:
    return sorted(name for name in expected.keys() | given.keys() if expected.get(name) != given.get(name))


def _outcome(start: Start, folder: Path, ground: Ground) -> dict[str, str]:
    """What comes of it: the exit code, the files that are written, and what must be the same in each of them."""
    for place in (ground.given, ground.out):
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
    for one in start.inputs:
        source = ground.valid / one
        (shutil.copytree if source.is_dir() else shutil.copy)(source, ground.given / one)
    home = ground.root / "home"
    environment = os.environ | {"HOME": str(home), "XDG_CONFIG_HOME": str(home / "config")} | start.environment
    environment.pop("LD_LIBRARY_PATH", None)  # OpenCV has put it into this process's
    environment |= {"QT_QPA_PLATFORM": "offscreen", "SPHERECAL_LIMITS": str(home / "limits.json")}
    command = [word.format(given=ground.given, valid=ground.valid, out=ground.out / "o") for word in start.command]
    process = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
    )
    try:
        said = process.communicate(timeout=start.ended_after or 600.0)[0].decode(errors="replace")
        result = {"exit code": str(process.returncode)}
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        said = process.communicate()[0].decode(errors="replace")
        result = {"exit code": "killed"}
    result |= {said[said.index("Traceback") :][-300:]: "traceback"} if "Traceback" in said else {}
    if start.ended_after is not None:
        return result
    return result | _written(ground.given, ground.out)


def _written(*places: Path) -> dict[str, str]:
    # documents have the time of day in them, and locks of our own a random name
    files = [path for place in places for path in place.rglob("*") if path.is_file() and path.name[0] != "."]
    same = {"rig.json", "points.csv", "residuals.csv", "covariance.npy"}
    return {
        _TIME.sub("TIME", str(path)): hashlib.sha256(path.read_bytes()).hexdigest() if path.name in same else "written"
        for path in files
    }
