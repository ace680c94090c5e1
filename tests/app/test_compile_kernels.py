"""`spherecal compile-kernels`: all parts run, a stamp says so, what fails is said; the window's chip."""

import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import spherecal
from spherecal.base.context import Context
from spherecal.base.errors import Cancelled, SpherecalError
from spherecal_app import kernel_state as kernels
from spherecal_app.cli.compile_kernels import compile_all, compile_first
from spherecal_app.cli.main import main
from spherecal_app.cli.options import TABLE
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions

# Steps that note that they ran, in the file that the environment names; what `trial_that_fails` does is in its name.
TRIALS = {
    "trial_of_two_parts": "PARTS = {'one': (note, note), 'two': (note,)}",
    "trial_that_fails": "PARTS = {'one': (note,), 'two': (fail,)}",
    "trial_that_dies": "PARTS = {'one': (note,), 'two': (die,)}",
    "trial_of_a_calibration": "CALIBRATION = {'one': (note, compile_two), 'two': (note,)}; CALIBRATION_FUNCTIONS = 4",
    "trial_that_calibrates": "CALIBRATION = {'one': (nested,)}; CALIBRATION_FUNCTIONS = 4",
    "trial_that_dies_first": "CALIBRATION = {'one': (die,)}; CALIBRATION_FUNCTIONS = 4",
}
STEPS = """
import os
def note(folder):
    assert folder.is_dir()
    with open(os.environ["NOTES"], "a") as file:
        file.write(f"{os.getpid()}\\n")
def fail(folder):
    raise ValueError("no room")
def die(folder):
    os._exit(9)
def nested(folder):
    from spherecal.base.context import Context
    from spherecal_app.cli import compile_kernels
    compile_kernels.is_installed = lambda: True
    compile_kernels.compile_first(Context(), "trial_of_a_calibration")
    note(folder)
def compile_two(folder):
    from numba import njit
    njit(lambda x: x + 1)(2)
    njit(lambda x: x - 1)(2)
"""


@pytest.fixture
def notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the steps of the trials note that they ran; numba's cache and the user's are empty ones."""
    for name, parts in TRIALS.items():
        (tmp_path / f"{name}.py").write_text(STEPS + parts + "\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("NOTES", str(tmp_path / "notes"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "notes"


def test_all_steps_run_each_part_in_its_process_and_a_stamp_says_so(notes: Path) -> None:
    assert kernels.state() == "to compile"
    told: list[tuple[int, int]] = []
    compile_all(lambda done, count: told.append((done, count)), "trial_of_two_parts")
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]
    processes = notes.read_text().splitlines()
    assert len(processes) == 3 and len(set(processes)) == 2 and str(os.getpid()) not in processes
    assert kernels.state() == "compiled"


def test_the_stamp_does_not_hold_for_another_cache_or_other_sources(
    notes: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    compile_all(lambda done, count: None, "trial_of_two_parts")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "other"))
    assert kernels.state() == "to compile"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    assert kernels.state() == "compiled"


@pytest.mark.parametrize(
    ("trial", "code"), [("trial_that_fails", "error-kernels-why"), ("trial_that_dies", "error-kernels")]
)
def test_what_fails_is_said_and_leaves_no_stamp(notes: Path, trial: str, code: str) -> None:
    with pytest.raises(SpherecalError) as caught:
        compile_all(lambda done, count: None, trial)
    assert caught.value.code == code
    assert "two" in str(caught.value) and caught.value.hint.startswith("The program still works")
    assert kernels.state() == "to compile"


def test_where_they_are_compiled_the_command_ends_at_once(notes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kernels.mark_compiled(kernels.wanted())
    assert main(["compile-kernels"]) == 0
    assert capsys.readouterr().out == "The kernels are compiled.\n"
    assert main(["compile-kernels", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"done": 1, "all": 1}


def test_an_installed_wheel_compiles_before_its_first_calibration_and_counts(
    notes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before, numba compiled for minutes behind "detect ..." on one core, without a word."""
    told: list[tuple[str, float, str]] = []
    context = Context(lambda event: told.append((event.stage, event.fraction, str(event.message))))
    compile_first(context, "trial_of_a_calibration")
    assert not notes.exists(), "a checkout is left alone"
    monkeypatch.setattr("spherecal_app.cli.compile_kernels.is_installed", lambda: True)
    compile_first(context, "trial_of_a_calibration")
    assert len(set(notes.read_text().splitlines())) == 2, "each part in a process of its own"
    stages, fractions, words = zip(*told, strict=True)
    assert set(stages) == {"compiling kernels, once"} and sorted(fractions) == list(fractions)
    assert fractions[-1] == 0.5 and words[-1] == "2 functions"
    compile_first(context, "trial_of_a_calibration")
    assert len(notes.read_text().splitlines()) == 2, "once"


@pytest.mark.parametrize(
    "words",
    [
        ["calibrate", "SESSION", "-o", "out"],
        ["batch", "FOLDER", "-o", "out", "--workers", "0"],
        ["detect", "SESSION/none.png", "--targets", "SESSION/targets.json", "--csv", "out.csv"],
        ["guide", "SESSION"],
        ["cross-validate", "SESSION"],
        ["check", "SESSION", "--profile", "RIG"],
        ["recalibrate", "SESSION", "--rig", "RIG", "--only", "C01", "-o", "out"],
    ],
    ids=lambda words: words[0],
)
def test_every_command_that_computes_compiles_first_but_not_for_wrong_input(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A session that is not there is said at once, not after a minute of compiling."""
    session, targets = tmp_path / "all" / "session", SimulationOptions(targets=12, placements=2)
    write_session(*simulate_session("demo", 1, targets), session)
    K, zero = [[1200.0, 0, 640], [0, 1200, 480], [0, 0, 1]], [0.0, 0, 0]
    spherecal.save_rig(spherecal.Rig.from_opencv({"C01": (K, None, zero, zero)}, (1280, 960)), tmp_path / "rig.json")
    monkeypatch.chdir(tmp_path)

    class Compiled(Exception):
        pass

    def compile_now(context: Context) -> None:
        raise Compiled

    module = TABLE["commands"][words[0]]["run"].partition(":")[0]
    monkeypatch.setattr(f"spherecal_app.cli.{module}.compile_first", compile_now)
    places = {"SESSION": str(session), "FOLDER": str(session.parent), "RIG": str(tmp_path / "rig.json")}
    line = [re.sub("SESSION|FOLDER|RIG", lambda found: places[found[0]], word) for word in words]
    with pytest.raises(Compiled):
        main(line)
    if words[0] not in ("batch", "detect"):
        assert main([word.replace(str(session), str(tmp_path / "none")) for word in line]) == 2
        assert "none" in capsys.readouterr().err


def test_a_calibration_of_the_trial_compiles_nothing_first(notes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """ "daemonic processes are not allowed to have children": in a wheel nothing was compiled side by side."""
    monkeypatch.setattr("spherecal_app.cli.compile_kernels.is_installed", lambda: True)
    compile_first(Context(), "trial_that_calibrates")
    assert len(notes.read_text().splitlines()) == 1
    assert kernels.is_marked(f"calibration{kernels.wanted()}")


def test_a_calibration_goes_on_where_compiling_first_fails(
    notes: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("spherecal_app.cli.compile_kernels.is_installed", lambda: True)
    with caplog.at_level("WARNING", "spherecal"):
        compile_first(Context(), "trial_that_dies_first")
    assert "one" in caplog.text and "9" in caplog.text
    stopped = Context(lambda event: None, lambda: True)
    with pytest.raises(Cancelled):
        compile_first(stopped, "trial_of_a_calibration")
    assert not kernels.is_marked(f"calibration{kernels.wanted()}")


@pytest.mark.skipif(not hasattr(os, "SCHED_IDLE"), reason="Linux only")
def test_idle_is_the_lowest_priority() -> None:
    code = (
        "import os\nfrom spherecal_app.cli.compile_kernels import run_when_idle\nrun_when_idle()\n"
        "print(os.nice(0), os.sched_getscheduler(0) == os.SCHED_IDLE)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split()[0] == "19"


def test_the_window_shows_how_far_it_is_and_nothing_at_the_end() -> None:
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)
    from PySide6.QtWidgets import QApplication

    from spherecal_gui.wizard.frame import WindowFrame

    _ = QApplication.instance() or QApplication([])
    frame = WindowFrame()
    try:
        assert frame.header.compiling.isHidden()
        frame.show_compiling(40)
        assert not frame.header.compiling.isHidden() and "40 %" in frame.header.compiling.text
        frame.show_compiling(100)
        assert frame.header.compiling.isHidden()
    finally:
        frame.deleteLater()


def test_the_background_process_reports_and_ends(notes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The real child: a stand-in for the interpreter would prove nothing; what it compiles is not waited for."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)
    from PySide6.QtCore import QDeadlineTimer, QEventLoop
    from PySide6.QtWidgets import QApplication

    from spherecal_gui.app import Compiling

    application = QApplication.instance() or QApplication([])
    one, told = Compiling(), []
    one.progressed.connect(told.append)
    assert one.start(idle=False)  # idle, it would wait for ever on a busy computer
    until = QDeadlineTimer(60_000)
    while not told and not until.hasExpired():
        application.processEvents(QEventLoop.ProcessEventsFlag.WaitForMoreEvents, 100)
    one.stop()
    application.processEvents()
    assert told[0] == 0 and told[-1] == 100
    kernels.mark_compiled(kernels.wanted())
    assert not Compiling().start()


def test_python_is_told_once_that_its_first_calibration_compiles(notes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """There it was silent for minutes; a checkout, and a wheel whose kernels are there, say nothing."""
    session, _ = simulate_session("demo", 1, SimulationOptions(targets=20, placements=1))
    monkeypatch.setattr("spherecal_app.api.calibrate", lambda *given: given)  # what compiles and computes
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        spherecal.calibrate_session(session)
        monkeypatch.setattr("spherecal_app.api.is_installed", lambda: True)
        assert caught == []
        spherecal.calibrate_session(session)
        spherecal.calibrate_session(session)
    assert [str(one.message).partition(",")[0] for one in caught] == ["The first calibration compiles its kernels"]
    assert caught[0].filename == __file__
