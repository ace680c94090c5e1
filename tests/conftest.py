"""What all tests share: the real data, the order of the files, and the rule that no exception may get lost."""

import gc
import json
import os
import shutil
import signal
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import Any

import hypothesis
import pytest

# The tests' own modules and each of the processes that tests start are compiled once, not in every process.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

ROOT = Path(__file__).resolve().parents[1]
# Seconds of each test function, all its cases together, where it takes 0.1 s or more (renewed by --write-durations),
# and of some fixtures of modules: without these, what one test leaves out the next would have to make.
DURATIONS = Path(__file__).with_name("durations.json")
QUICK_S = 0.1
# What only `--all` (and the CI) runs: other packages' suites, matrices of faults and of hostile files, and what needs
# processes of its own. They are half of the time and a tenth of the tests.
ONLY_WITH_ALL = (
    "gentl/", "study/", "boards/test_baselines_", "cameras/test_cameras_genicam", "cameras/test_odd_cameras",
    "cameras/test_camera_identity", "cameras/test_network", "gui/test_gui_faults", "gui/test_gui_agreement",
    "gui/test_gui_end_to_end", "gui/test_gui_real_walks", "installer/test_environments", "installer/test_kernels_ahead",
    "installer/test_packaging", "installer/test_promises", "app/test_working_folder", "app/test_examples",
    "app/test_docs_commands", "method/test_valid_means_right", "method/test_trust_", "method/test_disk_faults",
    "method/test_atomic_kills", "method/test_session_fuzz", "method/test_schemas",
)  # fmt: skip

# A shell that starts the tests in the background has them ignore Ctrl-C, and so would the programs that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

hypothesis.settings.register_profile("spherecal", deadline=None, derandomize=bool(os.environ.get("CI")))
hypothesis.settings.load_profile("spherecal")


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("spherecal")
    group.addoption("--fast", action="store_true", help=f"only test functions that take less than {QUICK_S} s")
    group.addoption("--all", action="store_true", help="all tests, as the CI runs them")
    group.addoption("--write-durations", action="store_true", help=f"merge the seconds taken into {DURATIONS.name}")


def _durations() -> dict[str, float]:
    return json.loads(DURATIONS.read_text(encoding="utf-8")) if DURATIONS.is_file() else {}


def _function(nodeid: str) -> str:
    """`test_x.py::test_name`, the cases of a parametrised test under one name."""
    return nodeid.partition("[")[0].rpartition("/")[2]


def _is_slow(item: pytest.Item, durations: dict[str, float]) -> bool:
    """By its mark, its own seconds, or those of a fixture that it may share with quicker ones."""
    names = {_function(item.nodeid), *(f"{item.path.name}::{one}" for one in getattr(item, "fixturenames", ()))}
    return item.get_closest_marker("slow") is not None or not names.isdisjoint(durations)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long files first, so that no worker is left with one at the end; with --fast only the quick functions.

    Without `--all` or the name of a file, what is ONLY_WITH_ALL stays out.
    """
    durations = _durations()
    files: defaultdict[str, float] = defaultdict(float)
    for name, seconds in durations.items():
        files[name.partition("::")[0]] += seconds
    items.sort(key=lambda item: -files[item.path.name])  # stable: in a file they stay as they are
    if config.getoption("--fast"):
        slow = [item for item in items if _is_slow(item, durations)]
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if item not in set(slow)]
    elif not config.getoption("--all") and config.args_source is not pytest.Config.ArgsSource.ARGS:
        rest = [item for item in items if item.nodeid.removeprefix("tests/").startswith(ONLY_WITH_ALL)]
        config.hook.pytest_deselected(items=rest)
        items[:] = [item for item in items if item not in set(rest)]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if not config.getoption("--write-durations"):
        return
    ran: defaultdict[str, float] = defaultdict(float)
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                ran[_function(report.nodeid)] += report.duration
    old = _durations()
    if config.getoption("--fast"):  # a test that found ready what a test left out here had made is no quick one
        ran = defaultdict(float, {k: max(v, old.get(k, 0.0)) for k, v in ran.items()})
    new = {k: round(v, 1) for k, v in sorted((old | ran).items()) if v >= QUICK_S}
    DURATIONS.write_text(json.dumps(new, indent=0) + "\n", encoding="utf-8")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real recordings: SPHERECAL_DATA, else ../shared/data beside the repository."""
    named = os.environ.get("SPHERECAL_DATA")
    folder = Path(named) if named else ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder} (set SPHERECAL_DATA to its folder)")
    return folder


def _of_all_workers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The temporary folder of this run, the same for every worker."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if os.environ.get("PYTEST_XDIST_WORKER") else own


@pytest.fixture(scope="session", autouse=True)
def _shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Where `tests/networks.py` keeps the calibrations of simulated sessions for all workers."""
    folder = _of_all_workers(tmp_path_factory) / "calibrated"
    folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPHERECAL_TESTS_SHARED", str(folder))
        yield


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], None]], Path]:
    """`made_once(name, make)`: the folder that `make(folder)` fills, once for all workers; nobody may change it."""
    root = _of_all_workers(tmp_path_factory)

    def made(name: str, make: Callable[[Path], None]) -> Path:
        from spherecal_files.lock import locked

        folder = root / f"once-{name}"
        with locked(folder, 1800.0):
            if not (folder / "made").is_file():  # a worker that failed leaves it to the next
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                make(folder)
                (folder / "made").touch()
        return folder

    return made


@pytest.fixture(scope="session")
def demo_tried(made_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """A folder in which `spherecal demo -o try` was run; `printed.txt` is what it said."""

    def run(folder: Path) -> None:
        from spherecal_app.cli.main import main

        with (folder / "printed.txt").open("w", encoding="utf-8") as printed, redirect_stdout(printed):
            assert main(["demo", "-o", str(folder / "try")]) == 0

    return made_once("demo", run)


@pytest.fixture(scope="session")
def drawn_session(made_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """A session of drawn images, to be shown to simulated cameras: as little as makes a valid calibration.

    The demo rig with a ball of 100 targets at three placements, and one pose of each bar. `two.json` beside its
    session.json is a plan with the first two placements.
    """

    def draw(folder: Path) -> None:
        from dataclasses import replace

        from spherecal_app.cli.main import main
        from spherecal_sim.render_session import RENDERED

        session = folder / "session"
        words = ["cameras", "capture", "--source", "simulated", "--placements", "3", "-o", str(session)]
        with pytest.MonkeyPatch.context() as patch, (folder / "printed.txt").open("w", encoding="utf-8") as printed:
            patch.setattr("spherecal_cameras.simulated.stage.RENDERED", replace(RENDERED, targets=100))
            with redirect_stdout(printed):
                assert main([*words, "--profile", str(folder / "profile.json")]) == 0
        document = json.loads((session / "session.json").read_text(encoding="utf-8"))
        document["bar_poses"] = [pose for pose in document["bar_poses"] if pose["id"].endswith("-01")]
        (session / "session.json").write_text(json.dumps(document), encoding="utf-8")
        document["placements"] = document["placements"][:2]
        (session / "two.json").write_text(json.dumps(document), encoding="utf-8")

    return made_once("drawn", draw) / "session"


@pytest.fixture(scope="session", autouse=True)
def _nothing_of_the_user(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Allowed drivers, reference bars, cameras' settings: of the tests' own, never those of whoever runs them."""
    folder = tmp_path_factory.mktemp("user")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
        patch.setenv("SPHERECAL_DRIVERS", str(folder / "drivers.json"))
        patch.setenv("SPHERECAL_BARS", str(folder / "bars.json"))
        patch.setenv("SPHERECAL_BALLS", str(folder / "balls.json"))
        patch.setenv("SPHERECAL_LIMITS", str(folder / "limits.json"))
        patch.setenv("SPHERECAL_SETTINGS", str(folder / "settings.ini"))
        yield


@pytest.fixture(scope="session", autouse=True)
def _live_images_leave_the_processors_to_the_tests() -> None:
    """Two rounds a second where a test asks for no other rate: detection would fill a processor all the while."""
    if control := sys.modules.get("spherecal_gui.controllers.camera_controller"):
        control.CameraController.live_hz = 2.0


@pytest.fixture(scope="module", autouse=True)
def _next_by_hand(request: pytest.FixtureRequest) -> Iterator[None]:
    """Windows under test stay at a step that is done until somebody goes on."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name == "gui":
            with suppress(ImportError):  # without Qt these tests are skipped
                patch.setattr("spherecal_gui.wizard.frame.WindowFrame.goes_on_at_first", False)
        yield


@pytest.fixture(scope="module")
def images_at_rest() -> Iterator[None]:
    """For files about the window, not about live images: those of simulated cameras are drawn and examined once."""
    from tests.gui_still import images_at_rest

    with images_at_rest():
        yield


@pytest.fixture(scope="module")
def no_advice() -> Iterator[None]:
    """For files that say nothing of where the ball should go next: it calibrates whenever a project is opened."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("spherecal_gui.controllers.advice_controller.AdviceController.plan_next", lambda _: None)
        yield


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
    """Delete the windows of a test when it ends: Qt itself does so in an event loop only, and none runs here.

    Left alone they become hundreds of widgets, each of which is styled again with every change of the look. Windows of
    a file's fixtures go when the file ends.
    """
    yield
    widgets = sys.modules.get("PySide6.QtWidgets")
    if widgets is None or widgets.QApplication.instance() is None:
        return
    if nextitem is None or nextitem.path != item.path:
        for window in widgets.QApplication.topLevelWidgets():
            if type(window).__module__.startswith("spherecal_gui"):
                window.deleteLater()
    core = sys.modules["PySide6.QtCore"]
    core.QCoreApplication.sendPostedEvents(None, core.QEvent.Type.DeferredDelete)


@pytest.fixture(scope="session")
def qapp(qapp: Any) -> Iterator[Any]:
    """Qt's application; garbage is collected as in the program, never in the thread of a worker."""
    from spherecal_gui.tasks.task import Collector

    collector = Collector(qapp)
    collector.start()
    yield qapp
    collector.stop()


@pytest.fixture(autouse=True)
def collected(request: pytest.FixtureRequest) -> Iterator[None]:
    """A test without a window runs no event loop: there Python collects by itself."""
    by_itself = gc.isenabled()
    if "qapp" not in request.fixturenames:
        gc.enable()
    yield
    if not by_itself:
        gc.disable()
        gc.collect(1)


@pytest.fixture(autouse=True)
def _ctrl_c_stays_ours() -> Iterator[None]:
    """Harvesters takes over SIGINT where it opens a camera in the main thread, as tests of odd cameras have it do."""
    before = signal.getsignal(signal.SIGINT)
    yield
    if signal.getsignal(signal.SIGINT) is not before:
        signal.signal(signal.SIGINT, before)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for a wizard's projects, its settings, and a scene that needs no OpenGL."""
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    monkeypatch.setenv("SPHERECAL_3D", "2d")
    return tmp_path


@pytest.fixture(scope="session")
def walked(qapp: object, made_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """The folder of a project of which everything is done, saved in `training-profile` beside it; to be copied."""

    def walk(home: Path) -> None:
        from tests.gui_still import images_at_rest
        from tests.gui_walking import settle, walked_to

        with pytest.MonkeyPatch.context() as patch, images_at_rest():
            patch.setenv("SPHERECAL_SETTINGS", str(home / "settings.ini"))
            patch.setenv("SPHERECAL_3D", "2d")
            patch.setattr("spherecal_gui.controllers.advice_controller.AdviceController.plan_next", lambda _: None)
            made = walked_to(home / "projects", "save")
            assert made.profile_folder is not None
            made.saving.save_profile(made.profile_folder, True, "by the tests")
            settle(made)
            made.close_project()

    return next(path.parent for path in made_once("walked", walk).glob("projects/*/wizard.json"))


@pytest.fixture(autouse=True)
def _no_lost_exceptions(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail the test when a thread or a Qt slot raises: neither reaches the test by itself."""
    lost: list[BaseException | None] = []
    monkeypatch.setattr(sys, "excepthook", lambda _kind, value, _traceback: lost.append(value))
    monkeypatch.setattr(threading, "excepthook", lambda args: lost.append(args.exc_value))
    yield
    if lost:
        pytest.fail("lost in a thread or slot: " + "; ".join(map(repr, lost)))


def pytest_assertrepr_compare(op: str, left: object, right: object) -> list[str] | None:
    """Long bytes by where they first differ: pytest's own comparison of two files of 300 kB takes an hour."""
    if op != "==" or not isinstance(left, bytes) or not isinstance(right, bytes) or len(left) + len(right) < 2000:
        return None
    at = next(
        (k for k, pair in enumerate(zip(left, right, strict=False)) if pair[0] != pair[1]), min(len(left), len(right))
    )
    around = slice(max(0, at - 60), at + 60)
    return [
        f"{len(left)} and {len(right)} bytes that differ from byte {at} on",
        f"{left[around]!r}",
        f"{right[around]!r}",
    ]


@pytest.fixture(params=["compiled", "reference"])
def either_engine(request: pytest.FixtureRequest) -> Iterator[None]:
    """A test that asks for it runs on the compiled engine of the adjustment and on the reference."""
    if request.param == "compiled":
        yield
        return
    from tests.reference_engine import reference_instead

    with reference_instead():
        yield
