"""The working folder is a stranger's: nothing in it is run, no library takes settings from it, no result changes."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

from benchmarks.studies.hostile_folder import SETTINGS, attack, make_canaries, starts
from benchmarks.studies.hostile_inputs import Ground
from spherecal_app.cli.options import TABLE
from spherecal_boards.pattern_entry import recorded_board
from spherecal_files.programs import find_program, own_program, users_environment
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions

BIN = Path(sys.executable).parent
linux = pytest.mark.skipif(sys.platform != "linux", reason="inotify and ldconfig are Linux's")
DISTRUST = "from spherecal.base.working_folder import distrust\ndistrust()\n"
SPAWNING = """
from spherecal.base.working_folder import distrust
{distrust}()
import multiprocessing
from multiprocessing.shared_memory import SharedMemory
memory = SharedMemory(create=True, size=8)  # starts the resource tracker
memory.close()
memory.unlink()
child = multiprocessing.get_context("spawn").Process(target=print, args=("child",))
child.start()
child.join()
"""


def run(folder: Path, *command: str, **variables: str) -> subprocess.CompletedProcess[str]:
    # without what OpenCV has put into the environment of this process
    environment = {name: value for name, value in users_environment().items() if name != "LD_LIBRARY_PATH"} | variables
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=300
    )


@pytest.fixture
def canaries(tmp_path: Path) -> Path:
    folder = tmp_path / "canaries"
    folder.mkdir()
    make_canaries(folder, tmp_path / "run.txt")
    return folder


@linux
@pytest.mark.parametrize(
    "kind", ["spherecal calibrate", "spherecal report html", "camera process", "spherecal, the window"]
)
def test_nothing_of_the_working_folder_is_run_or_opened(tmp_path: Path, made_once: Any, kind: str) -> None:
    valid = made_once("hostile-valid", _valid)
    (tmp_path / "valid").symlink_to(valid)
    found = attack(Ground(tmp_path), [kind])
    assert found.runs == {kind: 1}
    assert found.problems == []


def _valid(folder: Path) -> None:
    from benchmarks.studies.hostile_inputs import make_ground

    ground = make_ground(folder / "ground")
    for path in ground.valid.iterdir():
        shutil.move(path, folder)


def test_every_command_is_attacked(tmp_path: Path) -> None:
    """Those that need a person, a network of their own or a keyboard are left out, and named here."""
    words = {" ".join(word for word in start.command[1:] if word[0] not in "-{") for start in starts(Ground(tmp_path))}
    run = {name for name, about in TABLE["commands"].items() if "run" in about}
    left = {name for name in run if not any(one == name or one.startswith(f"{name} ") for one in words)}
    assert left <= {"cameras simulate-gige", "cameras simulate-producer", "limits reset-pin", "manual"}, left


@linux
@pytest.mark.parametrize("name", ["distrust", "print"])
def test_children_and_their_tracker_do_not_look_there(canaries: Path, tmp_path: Path, name: str) -> None:
    """`print` instead of `distrust` is the program as it was: the canaries do run then."""
    code = SPAWNING.format(distrust=name)
    script = tmp_path / "bin" / "spherecal"
    script.parent.mkdir()
    script.write_text(f"if __name__ == '__main__':\n{''.join('    ' + line + chr(10) for line in code.splitlines())}")
    run(canaries, sys.executable, str(script))
    assert (tmp_path / "run.txt").exists() == (name == "print")


def test_the_library_path_stays_as_it_was(tmp_path: Path) -> None:
    """OpenCV appends an empty folder to LD_LIBRARY_PATH, by which children load libraries from the working folder."""
    code = f"{DISTRUST}import os, cv2\nprint(os.environ.get('LD_LIBRARY_PATH'))"
    done = run(tmp_path, sys.executable, "-c", code)
    assert done.stdout == "None\n"
    done = run(tmp_path, sys.executable, "-c", code, LD_LIBRARY_PATH="/x")
    assert done.stdout == "/x\n"


@pytest.mark.parametrize("dependency", ["numba", "matplotlib"])
def test_settings_in_the_working_folder_are_not_taken(tmp_path: Path, dependency: str) -> None:
    for name, data in SETTINGS[dependency].items():
        (tmp_path / name).write_bytes(data)
    code = f"{DISTRUST}import {dependency}\nprint({dependency}.__name__)"
    done = run(tmp_path, sys.executable, "-c", code)
    assert done.stdout == f"{dependency}\n", done.stderr
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\n")
    (tmp_path / "matplotlibrc").write_text("lines.linewidth: 77\n")
    shown = {"numba": "numba.core.config.reload_config()\nprint(numba.config.DISABLE_JIT)",
             "matplotlib": "print(matplotlib.rcParams['lines.linewidth'])"}  # fmt: skip
    done = run(tmp_path, sys.executable, "-c", f"{code}\n{shown[dependency]}")
    assert done.stdout.split()[1:] == [{"numba": "0", "matplotlib": "1.5"}[dependency]], done.stderr


def test_a_version_that_looks_in_another_way_is_not_loaded_beside_such_a_file(tmp_path: Path) -> None:
    package = tmp_path / "site" / "matplotlib"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("NAME = 'matplotlib' + str(len('x')) + 'rc'\n")
    code = f"{DISTRUST}import matplotlib"
    path = f"{package.parent}:{os.environ.get('PYTHONPATH', ROOT / 'core')}"
    assert run(tmp_path, sys.executable, "-c", code, PYTHONPATH=path).returncode == 0
    (tmp_path / "matplotlibrc").write_text("")
    assert "move that file away" in run(tmp_path, sys.executable, "-c", code, PYTHONPATH=path).stderr


def test_a_session_in_memory_takes_no_board_from_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = {"format": "spherecal/session", "version": 1, "cameras": [], "board": {"kind": "chessboard"}}
    (tmp_path / "session.json").write_text(json.dumps(document))
    monkeypatch.chdir(tmp_path)
    session, _ = simulate_session("demo", 1, SimulationOptions(targets=9, placements=1, bar_poses=1))
    assert recorded_board(session) is None
    assert recorded_board(replace(session, folder=tmp_path)) == document["board"]


def test_a_module_run_by_its_name_leaves_the_working_folder_off(tmp_path: Path) -> None:
    (tmp_path / "pathlib.py").write_text("raise SystemExit('canary')")
    (tmp_path / "numpy.py").write_text("raise SystemExit('canary')")
    done = run(tmp_path, sys.executable, "-m", "spherecal", "--version")
    assert (done.returncode, done.stderr) == (0, "")


def test_our_own_interpreter_is_started_safely(monkeypatch: pytest.MonkeyPatch) -> None:
    assert own_program("spherecal", "doctor") == [sys.executable, "-P", "-m", "spherecal", "doctor"]
    monkeypatch.setattr(sys, "frozen", True, raising=False)  # the bundle's program takes no options of Python
    assert own_program("spherecal_gui") == [sys.executable, "-m", "spherecal_gui"]


def test_programs_are_found_on_the_path_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
    for program in (tmp_path / "here" / "tool", tmp_path / "there" / "tool"):
        program.write_text("")
        program.chmod(0o755)
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("PATH", ":.:")
    assert find_program("tool") is None
    monkeypatch.setenv("PATH", f":.:{tmp_path / 'there'}")
    assert find_program("tool") == str(tmp_path / "there" / "tool")
    assert find_program("./tool") == str(tmp_path / "here" / "tool")  # named by its path
    assert find_program("./none") is None


@pytest.mark.parametrize("line", ["subprocess.call([sys.executable])", "shutil.which('g++')"])
@pytest.mark.parametrize("path", ["core/spherecal_app/cli/x.py", "spherecal_gui/x.py"])
def test_another_way_to_start_programs_turns_red(path: str, line: str) -> None:
    text = f"import {'sys, subprocess' if 'sys' in line else 'shutil'}\n\n{line}\n"
    command = [BIN / "ruff", "check", "--select", "TID251", "--stdin-filename", path, "-"]
    done = subprocess.run(command, cwd=ROOT, input=text, capture_output=True, text=True, timeout=60, check=False)
    assert "TID251" in done.stdout
