"""Hostile surroundings: no network, no home to write to, other languages, odd clocks, no OpenGL, busy processors.

Each row of docs/environments.md is a test here. The programs run in processes of their own, as a user's would.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from conftest import ROOT

from spherecal_app.cli.main import main
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions

LINUX_HERE = sys.platform.startswith("linux")
LINUX = pytest.mark.skipif(not LINUX_HERE, reason="the arrangement is Linux's")
RUN = "import sys; from spherecal_app.cli.main import main; sys.exit(main(sys.argv[1:]))"
# Commands one after the other: each a list of words in the JSON of the only argument; the exit codes go to stdout.
RUN_ALL = """
import json, sys
from spherecal_app.cli.main import main
codes = [main(words) for words in json.loads(sys.argv[1])]
sys.stdout.write("\\n" + json.dumps(codes))
"""


def run(
    *arguments: object, env: Mapping[str, str] | None = None, code: str = RUN, cwd: Path | None = None
) -> subprocess.CompletedProcess[bytes]:
    """A command in a process of its own."""
    single = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "QT_QPA_PLATFORM": "offscreen"}
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env={**os.environ, **single, **(env or {})},
        cwd=cwd,
        capture_output=True,
        timeout=240,
        check=False,
    )


def run_all(*commands: Sequence[object], env: Mapping[str, str], cwd: Path | None = None) -> list[int]:
    """Commands in one process of their own, which ends without a traceback; their exit codes."""
    words = json.dumps([[str(word) for word in command] for command in commands])
    done = run(words, env=env, code=RUN_ALL, cwd=cwd)
    assert_ran(done)
    return json.loads(done.stdout.decode(errors="replace").splitlines()[-1])


def assert_ran(done: subprocess.CompletedProcess[bytes]) -> None:
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    assert b"Traceback" not in done.stderr


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "session"
    write_session(*simulate_session("demo", 1, SimulationOptions(targets=80)), folder)
    return folder


@pytest.fixture(scope="module")
def rig(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """rig.json as it comes out in friendly surroundings."""
    folder = tmp_path_factory.mktemp("friendly") / "result"
    assert main(["calibrate", str(session), "-o", str(folder)]) == 0
    return folder / "rig.json"


# --- no network ------------------------------------------------------------------------------------------------------

# Every way in which Python code can reach out; between our own processes only pipes and local sockets are used.
FORBIDDING = """
import sys
ASKING = ("socket.getaddrinfo", "socket.gethostbyname", "urllib.Request", "http.client.connect", "smtplib.connect")
REACHING = ("socket.connect", "socket.sendto", "socket.sendmsg", "socket.bind")
def audit(event, args):
    if event in ASKING or event in REACHING and not isinstance(args[1], (str, bytes)):
        raise SystemExit(f"FORBIDDEN {event} {args}")
sys.addaudithook(audit)
"""
COMMANDS = """
from spherecal_app.cli.main import main
s, o = sys.argv[1:]
LINES = f'''doctor
targets export -o {o}/targets.json
calibrate {s} -o {o}/r
verify {s} --rig {o}/r/rig.json -o {o}/r
report {o}/r -o {o}/r.pdf
export {o}/r/rig.json --to opencv -o {o}/e
licences
profile save {o}/r --to {o}/p
cameras list --source simulated'''
for line in LINES.splitlines():
    assert main(line.split()) == 0, line
"""


SWITCH = "import locale; locale.setlocale(locale.LC_ALL, '')\nassert locale.localeconv()['decimal_point'] == ','\n"


@pytest.fixture(scope="module")
def commands_run(session: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bool]:
    """Where the commands' files are, and whether they were run with a decimal comma; the network was forbidden.

    As Qt does it: the C library itself is switched, so that native code would read and write commas.
    """
    folder, german = tmp_path_factory.mktemp("commands"), {}
    painted = {"SPHERECAL_3D": "painted"}  # the scene's process would not be watched
    if LINUX_HERE and shutil.which("localedef") and Path("/usr/share/i18n/locales/de_DE").exists():
        locale = tmp_path_factory.mktemp("locale")
        made = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(locale / "de_DE.UTF-8")]
        subprocess.run(made, check=False, capture_output=True)
        german = {"LOCPATH": str(locale), "LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8"}
    assert_ran(run(session, folder, code=FORBIDDING + (SWITCH if german else "") + COMMANDS, env=german | painted))
    return folder, bool(german)


def test_no_command_makes_a_network_connection(commands_run: tuple[Path, bool], rig: Path) -> None:
    assert (commands_run[0] / "r" / "rig.json").read_bytes() == rig.read_bytes()


def test_the_window_makes_no_network_connection(tmp_path: Path) -> None:
    pytest.importorskip("PySide6")
    script = FORBIDDING + (
        "from PySide6.QtWidgets import QApplication\nfrom PySide6.QtCore import QTimer\nfrom pathlib import Path\n"
        "from spherecal_gui import app\n"
        "a = QApplication([]); w = app.make_window(Path(sys.argv[1])); w.show()\n"
        "QTimer.singleShot(500, a.quit); a.exec(); w.close()\n"
    )
    assert_ran(run(tmp_path / "projects", code=script, env={"SPHERECAL_SETTINGS": str(tmp_path / "settings.ini")}))


def test_the_forbidding_forbids() -> None:
    done = run(code=FORBIDDING + "import socket; socket.create_connection(('127.0.0.1', 9))")
    assert b"FORBIDDEN" in done.stderr


@LINUX
def test_without_any_network_device(session: Path, rig: Path, tmp_path: Path) -> None:
    """A network namespace of its own has no device at all, not even for native code."""
    unshare = shutil.which("unshare")
    if unshare is None or subprocess.run([unshare, "-n", "true"], check=False, capture_output=True).returncode:
        pytest.skip("unshare -n is not allowed here")
    command = [unshare, "-n", sys.executable, "-c", RUN, "calibrate", str(session), "-o", str(tmp_path / "r")]
    assert subprocess.run(command, check=False, capture_output=True, timeout=240).returncode == 0
    assert (tmp_path / "r" / "rig.json").read_bytes() == rig.read_bytes()


# --- nowhere to write ------------------------------------------------------------------------------------------------

NOBODY = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups")
NOWHERE = {"HOME": "/proc/no-home", "XDG_CACHE_HOME": "", "XDG_CONFIG_HOME": "", "XDG_DATA_HOME": "",
           "SPHERECAL_DRIVERS": "", "SPHERECAL_BARS": ""}  # fmt: skip


@LINUX
def test_home_folder_that_cannot_be_written(session: Path, rig: Path, tmp_path: Path) -> None:
    calibrating, listing = ["calibrate", session, "-o", tmp_path / "r"], ["cameras", "list"]
    codes = run_all(["doctor"], calibrating, [*listing, "--source", "simulated"], listing, env=NOWHERE)
    assert codes[:3] == [0, 0, 0] and codes[3] in (0, 3), "3 where no camera is found"
    assert (tmp_path / "r" / "rig.json").read_bytes() == rig.read_bytes()


@LINUX
def test_kernels_find_room_where_program_and_home_are_read_only(tmp_path: Path) -> None:
    """The package as an installer leaves it: nothing of it can be written, nor can the home folder."""
    if os.geteuid() == 0 and not shutil.which("setpriv"):
        pytest.skip("needs setpriv to stop being root")
    package = tmp_path / "installed"
    shutil.copytree(ROOT / "core", package, ignore=shutil.ignore_patterns("__pycache__"))
    for path in (package, *package.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    for path in (tmp_path, *tmp_path.parents):
        if path != Path("/") and not path.stat().st_mode & 0o005:
            path.chmod(path.stat().st_mode | 0o005)
    script = (
        "import os, sys; sys.path.insert(0, sys.argv[1]); import spherecal, numba\n"
        "from pathlib import Path\n"
        "assert str(Path(spherecal.__file__).parent.parent) == sys.argv[1], spherecal.__file__\n"
        "folder = Path(os.environ['NUMBA_CACHE_DIR']); mode = folder.stat().st_mode & 0o777\n"
        "assert mode == 0o700 and folder.stat().st_uid == os.getuid(), oct(mode)\n"
        "import spherecal.adjust.engine\n"
    )
    inside = tmp_path / "temporary"
    inside.mkdir()
    inside.chmod(0o777)
    command = [sys.executable, "-c", script, str(package)]
    if os.geteuid() == 0:
        readable = subprocess.run(
            [*NOBODY, sys.executable, "-c", "import numba"], capture_output=True, check=False, cwd="/"
        )
        if readable.returncode:
            pytest.skip("this Python can be read by its owner only")
        command = [*NOBODY, *command]
    env = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "PYTHONPATH")}
    env |= NOWHERE | {"TMPDIR": str(inside), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, env=env, capture_output=True, check=False, timeout=120, cwd="/")
    assert done.returncode == 0, done.stderr.decode()


@LINUX
def test_caches_find_room_where_home_is_read_only(tmp_path: Path) -> None:
    """The demo's images and the like: in a folder of the user's own; never in one that somebody else has made there."""
    script = (
        "import os, sys; sys.path.insert(0, sys.argv[1]); from pathlib import Path\n"
        "from spherecal_files.cache_folder import cache_folder\n"
        "folder = cache_folder('demo-1'); mode = folder.parent.stat().st_mode & 0o777\n"
        "assert mode == 0o700 and folder.parent.stat().st_uid == os.getuid(), oct(mode)\n"
        "folder.mkdir(); print(folder.parent.name)\n"
    )
    package, inside = tmp_path / "installed" / "spherecal_files", tmp_path / "temporary"
    package.mkdir(parents=True)
    for name in ("__init__.py", "cache_folder.py"):
        shutil.copy(ROOT / "core" / "spherecal_files" / name, package / name)
    inside.mkdir()
    inside.chmod(0o777)
    for path in (tmp_path, *tmp_path.parents):
        if path != Path("/") and not path.stat().st_mode & 0o005:
            path.chmod(path.stat().st_mode | 0o005)
    command = [sys.executable, "-c", script, str(package.parent)]
    env = {**os.environ, **NOWHERE, "TMPDIR": str(inside), "NUMBA_CACHE_DIR": str(inside)}
    if os.geteuid() == 0:
        readable = [*NOBODY, sys.executable, "-c", "import platformdirs"]
        if (
            not shutil.which("setpriv")
            or subprocess.run(readable, capture_output=True, check=False, cwd="/").returncode
        ):
            pytest.skip("needs setpriv to stop being root, and a Python that others can read")
        command = [*NOBODY, *command]

    def where() -> str:
        done = subprocess.run(command, env=env, capture_output=True, check=False, timeout=60, cwd="/")
        assert done.returncode == 0, done.stderr.decode()
        return done.stdout.decode().strip()

    own = where()
    shutil.rmtree(inside / own)
    (inside / own).mkdir(mode=0o777)  # root's, or open to all
    (inside / own).chmod(0o777)
    assert where() != own


# --- languages -------------------------------------------------------------------------------------------------------


@LINUX
def test_decimal_comma(commands_run: tuple[Path, bool], rig: Path) -> None:
    folder, german = commands_run
    if not german:
        pytest.skip("no German locale can be made here (package locales)")
    assert (folder / "r" / "rig.json").read_bytes() == rig.read_bytes()
    assert json.loads((folder / "r" / "verification.json").read_text(encoding="utf-8"))["lengths"]


@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "cp1252"])
def test_letters_of_all_kinds_in_names_of_folders_and_users(
    session: Path, rig: Path, tmp_path: Path, encoding: str
) -> None:
    """Home, session and result have names that the terminal's encoding need not have."""
    home = tmp_path / "Jürgen Ångström 测量"
    recorded, result = home / "Сессия 测试", home / "Ergebnis №1"
    shutil.copytree(session, recorded)
    environment = {
        "HOME": str(home),
        "USER": "Jürgen",
        "PYTHONIOENCODING": encoding,
        "XDG_CONFIG_HOME": str(home / "ö"),
    }
    if encoding == "ascii":  # which has none of these letters; the others print what is there, which is quicker
        making = ["calibrate", recorded, "-o", result]
    else:
        shutil.copytree(rig.parent, result)
        making = ["verify", recorded, "--rig", result / "rig.json", "-o", result]
    codes = run_all(
        making,
        ["profile", "save", result, "--to", home / "Profil ß"],
        ["cameras", "set", "all", "--source", "simulated", "--exposure-us", "5000"],
        ["calibrate", home / "нет", "-o", home / "x"],
        env=environment,
        cwd=home,
    )
    assert codes == [0, 0, 0, 2]
    assert (result / "rig.json").read_bytes() == rig.read_bytes()


# --- screens ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("factor", "screen"), [(1.25, (1920, 1080)), (1.5, (1920, 1080)), (2.0, (2560, 1440))])
def test_the_window_fits_a_scaled_screen(tmp_path: Path, factor: float, screen: tuple[int, int]) -> None:
    pytest.importorskip("PySide6")
    script = (
        "import sys; from pathlib import Path; from PySide6.QtWidgets import QApplication\n"
        "from spherecal_gui import app\n"
        "a = QApplication([]); w = app.make_window(Path(sys.argv[1])); w.show(); a.processEvents()\n"
        "assert abs(w.devicePixelRatioF() - float(sys.argv[2])) < 1e-6, w.devicePixelRatioF()\n"
        "least = w.minimumSizeHint().expandedTo(w.minimumSize()); print(least.width(), least.height())\n"
        "assert not w.grab().isNull(); w.close()\n"
    )
    settings = {"QT_SCALE_FACTOR": str(factor), "SPHERECAL_SETTINGS": str(tmp_path / "settings.ini")}
    done = run(tmp_path / "projects", factor, code=script, env=settings)
    assert_ran(done)
    width, height = map(int, done.stdout.split()[-2:])
    assert width * factor <= screen[0] and height * factor <= screen[1] - 80, (width, height)  # 80: task bar, title


def test_two_monitors_and_one_that_is_unplugged(tmp_path: Path) -> None:
    """The window comes back where it was; where that monitor is gone, it comes whole on the one that is left."""
    pytest.importorskip("PySide6")
    script = (
        "import sys; from pathlib import Path; from PySide6.QtWidgets import QApplication\n"
        "from spherecal_gui import app\n"
        "a = QApplication([]); w = app.make_window(Path(sys.argv[1])); w.show(); a.processEvents()\n"
        "print(len(a.screens()), w.screen().name())\n"
        "assert w.screen().geometry().contains(w.geometry()), (w.screen().geometry(), w.geometry())\n"
        "if len(sys.argv) > 2:\n"
        "    w.showNormal(); w.move(a.screens()[1].geometry().topLeft()); a.processEvents(); print(w.screen().name())\n"
        "assert not w.grab().isNull(); w.close()\n"
    )
    both = [screen("left", 0, 1920, 1080, 1.0), screen("right", 1920, 2560, 1440, 1.5)]
    said = []
    for monitors, arguments in ((both, ["move"]), (both, []), (both[:1], [])):
        (tmp_path / "screens.json").write_text(json.dumps({"screens": monitors}), encoding="utf-8")
        environment = {
            "QT_QPA_PLATFORM": f"offscreen:configfile={tmp_path / 'screens.json'}",
            "SPHERECAL_SETTINGS": str(tmp_path / "settings.ini"),
        }
        done = run(tmp_path / "projects", *arguments, code=script, env=environment)
        assert_ran(done)
        said.append(done.stdout.decode().split())
    assert said == [["2", "left", "right"], ["2", "right"], ["1", "left"]]


def screen(name: str, x: int, width: int, height: int, ratio: float) -> dict[str, object]:
    """A monitor as Qt's offscreen platform reads it."""
    return {
        "name": name, "x": x, "y": 0, "width": width, "height": height, "logicalDpi": 96, "logicalBaseDpi": 96,
        "dpr": ratio,
    }  # fmt: skip


def test_without_opengl_the_rig_is_painted(tmp_path: Path) -> None:
    pytest.importorskip("PySide6")
    (tmp_path / "pyvista.py").write_text("raise RuntimeError('no OpenGL context can be made')\n")
    script = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from PySide6.QtWidgets import QApplication; from spherecal_gui.tasks import scene_process\n"
        "a = QApplication([]); one = scene_process.take(); said = []\n"
        "one.failed.connect(lambda reason: (said.append(reason), a.quit())); a.exec()\n"
        "print(said[0]); one.close(); print(one.wait(10))\n"
    )
    done = run(code=script)
    assert_ran(done)
    assert done.stdout.split(b"\n")[:2] == [b"RuntimeError: no OpenGL context can be made", b"True"]


# --- clocks and processors -------------------------------------------------------------------------------------------


def test_a_clock_that_is_set_back_loses_no_calibration(
    session: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The order of a profile is that of saving, whatever the clock said; and validity stays a word, not a crash."""
    from spherecal_rigs import save_entry as saving
    from spherecal_rigs.store import open_profile

    class Clock(datetime):
        shift = timedelta()

        @classmethod
        def now(cls, tz=None):
            return datetime.now(tz) + cls.shift

    monkeypatch.setattr(saving, "datetime", Clock)
    for shift in (timedelta(days=1), timedelta(days=-400), timedelta()):
        Clock.shift = shift
        assert main(["profile", "save", str(rig.parent), "--to", str(tmp_path / "p"), "--apply"]) == 0
        assert main(["profile", "show", str(tmp_path / "p")]) in (0, 3)
    profile = open_profile(tmp_path / "p")
    assert [path.name for path in sorted((tmp_path / "p" / "history").iterdir())] == ["0001", "0002", "0003"]
    assert profile is not None
    assert datetime.now(UTC).year >= 2026


def test_busy_processors_change_time_and_nothing_else(session: Path, rig: Path, tmp_path: Path) -> None:
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        began = time.monotonic()
        assert main(["calibrate", str(session), "-o", str(tmp_path / "r")]) == 0
        assert time.monotonic() - began < 200
    finally:
        for process in busy:
            process.kill()
            process.wait()
    assert (tmp_path / "r" / "rig.json").read_bytes() == rig.read_bytes()
