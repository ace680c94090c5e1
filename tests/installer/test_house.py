"""The rules of the house: each contract turns red on a planted import, and the set-up keeps its promises."""

import ast
import contextlib
import importlib
import inspect
import io
import os
import re
import shutil
import subprocess
import sys
import tokenize
import tomllib
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from writing_calls import files_that_write

import dev
import spherecal

BIN = Path(sys.executable).parent

PACKAGES = "Packages stand on each other in one order"
ROOMS = "Within the method, dependencies run one way"
SIMULATOR = "The simulator is loaded by nobody but who simulates"
# file to plant, what it says, the contract that must break
VIOLATIONS = [
    ("core/spherecal/geometry/planted.py", "import spherecal.initialise", ROOMS),
    ("core/spherecal/adjust/planted.py", "import spherecal.initialise", ROOMS),
    ("core/spherecal/data/planted.py", "import spherecal.detect", ROOMS),
    ("core/spherecal/detect/planted.py", "import spherecal_files", PACKAGES),
    ("core/spherecal/ball/planted.py", "import spherecal.calibrate", ROOMS),
    ("core/spherecal_verify/planted.py", "import spherecal_files", PACKAGES),
    ("core/spherecal_files/planted.py", "import spherecal_sim", PACKAGES),
    ("core/spherecal/steps/planted.py", "import spherecal_boards", PACKAGES),
    ("core/spherecal/targets/planted.py", "import spherecal_gui", PACKAGES),
    ("core/spherecal_boards/planted.py", "import spherecal_sim", PACKAGES),
    ("core/spherecal_gentl/planted.py", "import spherecal_cameras", PACKAGES),
    ("core/spherecal_sim/planted.py", "import spherecal_app.cli", PACKAGES),
    ("core/spherecal_cameras/planted.py", "import spherecal_rigs", PACKAGES),
    ("core/spherecal_rigs/planted.py", "import spherecal_measuring", PACKAGES),
    ("core/spherecal_measuring/planted.py", "import spherecal_documents", PACKAGES),
    ("core/spherecal_documents/planted.py", "import spherecal_study", PACKAGES),
    ("core/spherecal_study/planted.py", "import spherecal_app", PACKAGES),
    ("core/spherecal_rigs/planted_too.py", "import spherecal_sim", SIMULATOR),
    ("core/spherecal_app/cli/planted.py", "import PySide6", "The engine knows no window"),
    ("core/spherecal_files/planted_too.py", "import pyvista", "Only the scene's renderer knows pyvista"),
    ("core/spherecal_verify/planted_too.py", "import harvesters", "Camera drivers stay inside spherecal_cameras"),
    ("spherecal_gui/planted.py", "import genicam", "Camera drivers stay inside spherecal_cameras"),
    ("spherecal_gui/controllers/planted.py", "import spherecal_gui.pages", "The controllers know no widgets"),
    (
        "spherecal_gui/tasks/planted.py",
        "import spherecal_gui.presenters",
        "Tasks and what lies below them know neither presenters nor pages",
    ),
    ("core/spherecal/adjust/planted_too.py", "import cv2", "OpenCV stays where images and two-view geometry are"),
    ("spherecal_gui/planted_too.py", "import cv2", "OpenCV stays where images and two-view geometry are"),
]


@pytest.fixture(scope="module")
def import_report(tmp_path_factory) -> str:
    """What lint-imports says about a copy of the tree with all violations planted, and one file in no layer."""
    copy = tmp_path_factory.mktemp("tree")
    shutil.copy(ROOT / "pyproject.toml", copy)
    for package in ("core", "spherecal_gui"):
        shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
    for path, line, _ in VIOLATIONS:
        (copy / path).write_text(f"def late():\n    {line}\n")
    (copy / "core/spherecal/calibrate.py").touch()
    (copy / "core/spherecal/homeless.py").touch()
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(copy / "core"), str(copy)]), "COLUMNS": "300"}
    command = [BIN / "lint-imports", "--no-cache"]
    done = subprocess.run(command, cwd=copy, env=env, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize(("path", "line", "contract"), VIOLATIONS, ids=lambda value: value.split("/")[-1])
def test_dependency_rule_turns_red(import_report, path, line, contract):
    module = path.removeprefix("core/").removesuffix(".py").replace("/", ".")
    target = line.removeprefix("import ")
    broken = import_report.split("Broken contracts", 1)[1]
    section = broken.split(f"\n{contract}\n", 1)[1]
    assert re.search(rf"{re.escape(module)} -> {re.escape(target)}\b", section), broken


def test_a_module_in_no_layer_turns_red(import_report):
    assert "homeless" in import_report


@pytest.mark.parametrize("module", ["pyvista", "pyvistaqt", "harvesters", "genicam"])
def test_heavy_import_at_module_level_turns_red(module):
    command = [BIN / "ruff", "check", "--stdin-filename", "spherecal_gui/planted.py", "-"]
    top, late = f'"""Doc."""\n\nimport {module}\n\n{module}.x()\n', f'"""Doc."""\n\n\ndef _f():\n    import {module}\n'
    done = [
        subprocess.run(command, cwd=ROOT, input=text, capture_output=True, text=True, timeout=60, check=False).stdout
        for text in (top, late)
    ]
    assert "TID253" in done[0]
    assert "TID253" not in done[1]


# What else may write or remove, and what it is: nothing of it is a file whose name comes from outside.
MAY_WRITE = {
    "core/spherecal/__init__.py": {"mkdtemp"},  # temporary folders, which nobody else can enter
    "core/spherecal_documents/support/support_bundle.py": {"TemporaryDirectory"},
    "core/spherecal_cameras/genicam/child.py": {"open"},  # the log file, /dev/null
    "core/spherecal_cameras/genicam/discovery.py": {"open"},  # /dev/null
    "core/spherecal_cameras/genicam/trust.py": {"symlink_to", "chmod", "fchmod"},  # in a folder of our own
    "core/spherecal_cameras/genicam/rings.py": {"unlink"},  # shared memory
    "core/spherecal_cameras/genicam/service.py": {"unlink"},
    "core/spherecal_gentl/gige/gige_control.py": {"ftruncate"},  # memory without a name
    "core/spherecal_cameras/plan.py": {"TemporaryDirectory"},
    "core/spherecal_gentl/producer/build_producer.py": {
        "TemporaryDirectory",
        "chmod",
    },  # what was built here is a program
    "core/spherecal_gentl/producer/region.py": {"unlink"},
    "core/spherecal_app/cli/compile_kernels.py": {"TemporaryDirectory"},
    "core/spherecal_app/cli/producer_command.py": {"TemporaryDirectory"},
    "core/spherecal_app/cli/console.py": {"open", "TemporaryDirectory"},  # /dev/null, what goes to standard output
    "core/spherecal_app/cli/main.py": {"open", "FileHandler"},  # /dev/null, the log file that the user names
    "core/spherecal_files/cache_folder.py": {"mkdtemp"},
    "core/spherecal_documents/scene/renderer.py": {"unlink"},  # shared memory
    "core/spherecal_files/atomic.py": {"rmdir", "rename", "open", "chmod"},  # folders just made; to sync
    "core/spherecal_files/lock.py": {"unlink", "ftruncate"},  # lock files
    "spherecal_gui/pages/limits_dialog.py": {"save"},  # a method of ours
    "spherecal_gui/sounds.py": {"open", "NamedTemporaryFile"},  # in memory; a tone for the player
    "spherecal_gui/tasks/placement_advice.py": {"TemporaryDirectory"},
    "spherecal_gui/tasks/jobs.py": {"TemporaryDirectory"},  # a report that is drawn in a thread
    "spherecal_gui/controllers/recording_controller.py": {"save"},  # a method of ours
}


def test_only_one_module_writes_and_removes_files():
    found = {path: {name for _, name in calls} for path, calls in files_that_write(ROOT).items()}
    others = {path: names - MAY_WRITE.get(path, set()) for path, names in found.items()}
    assert not any(others.values()), others
    assert found.keys() == MAY_WRITE.keys(), "an exception that is needed no more"


def test_a_renamed_function_of_our_own_skips_no_test():
    """Only what is not ours may be absent: skipped where it cannot be imported."""
    asked = {
        name: path.name
        for path in sorted((ROOT / "tests").rglob("*.py"))
        for name in re.findall(r'importorskip\(\s*"([^"]+)"', path.read_text(encoding="utf-8"))
    }
    assert "PySide6.QtWidgets" in asked
    assert not {name: file for name, file in asked.items() if name.startswith(("spherecal", "tests"))}


def test_what_users_import_describes_its_arguments() -> None:
    import spherecal
    from spherecal_cameras.protocol import CameraSource

    functions = [one for name in spherecal.__all__ if inspect.isfunction(one := getattr(spherecal, name))]
    functions += [one for name, one in vars(CameraSource).items() if inspect.isfunction(one) and name[0] != "_"]
    assert len(functions) > 40
    lacking = []
    for function in functions:
        names = [name for name in inspect.signature(function).parameters if name != "self"]
        _, _, section = (inspect.getdoc(function) or "").partition("\nParameters\n---")
        rows = " ".join(row for row in section.splitlines() if not row.startswith(" "))
        if len(names) > 1:
            lacking += [f"{function.__qualname__}: {name}" for name in names if not re.search(rf"\b{name}\b", rows)]
    assert lacking == []


def test_the_engine_loads_no_window():
    windows = "m.startswith(('PySide6', 'spherecal_gui'))"
    code = f"import sys, spherecal_app.cli.main; sys.exit(any({windows} for m in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == 0


def test_lock_has_hashes_and_no_address():
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    assert "://" not in text
    packages = re.split(r"\n(?=\w)", text.strip())
    assert packages
    assert all("--hash=sha256:" in package for package in packages)


def test_lock_is_as_the_project_asks():
    document = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    asked = document["project"]["dependencies"] + document["dependency-groups"]["dev"] + ["PySide6-Essentials"]
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    for requirement in asked:
        name = re.match(r"[\w-]+", requirement)
        assert name
        assert re.search(rf"^{name[0].lower()}==", lock, re.MULTILINE), f"{requirement}: run python3 dev.py lock"


def test_lock_keeps_clear_of_the_qt_that_aborts():
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    version = re.search(r"^pyside6-essentials==(\d+)\.(\d+)", lock, re.MULTILINE)
    assert version
    assert (6, 8) <= (int(version[1]), int(version[2])) < (6, 12)


def test_readme_starts_with_the_two_commands():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"^ {0,4}(?:\$ )?(python3 \S.*)$", readme, re.MULTILINE)
    assert [command.split("#")[0].strip() for command in commands[:2]] == ["python3 dev.py demo", "python3 dev.py test"]


def test_ci_runs_the_readme_command():
    script = ROOT / ".ci" / "run"
    assert "python3 dev.py test" in script.read_text(encoding="utf-8")
    assert os.name == "nt" or os.access(script, os.X_OK)


def test_version_is_the_installed_one():
    from importlib.metadata import version

    assert version("spherecal") == spherecal.__version__


# --- dev.py ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def no_apt(monkeypatch):
    """A machine where nothing can be installed by us."""
    monkeypatch.setattr(dev, "apt_install", lambda packages: False)


def test_missing_system_libraries_are_named_with_the_apt_line(monkeypatch, capsys, no_apt):
    monkeypatch.setattr(dev.sys, "platform", "linux")
    monkeypatch.setattr(dev.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(dev, "loads", lambda library: library not in ("libGL.so.1", "libxcb-cursor.so.0"))
    dev.ensure_system_libraries()
    said = capsys.readouterr().out
    assert "sudo apt-get install --no-install-recommends libgl1 libxcb-cursor0\n" in said
    assert "works without them" in said


def test_missing_venv_module_is_a_plain_error(monkeypatch, no_apt):
    monkeypatch.setattr(dev, "can_make_venv", lambda: False)
    with pytest.raises(dev.SetupError, match=r"apt-get install --no-install-recommends python3\.\d+-venv"):
        dev.ensure_venv_module()


def test_stamp_follows_the_lock_and_the_requirements_only(monkeypatch, tmp_path):
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    lock = Path(shutil.copy(ROOT / "requirements.lock", tmp_path))
    monkeypatch.setattr(dev, "ROOT", tmp_path)
    monkeypatch.setattr(dev, "LOCK", lock)
    before = dev.wanted_stamp()
    with (tmp_path / "pyproject.toml").open("a") as file:
        file.write("\n[tool.something]\nelse = 1\n")
    assert dev.wanted_stamp() == before
    lock.write_text("numpy==1.0\n")
    assert dev.wanted_stamp() != before


class Pip:
    """Stands for pip: notes what it is asked for, and fails where it is told to."""

    def __init__(self, monkeypatch, venv: Path, fails: int = 0):
        self.asked: list[list[str]] = []
        self.fails, self.venv = fails, venv
        for name, value in {
            "VENV": venv,
            "STAMP": venv / "spherecal-setup.txt",
            "INSTALLED_LOCK": venv / "old.lock",
            "PYTHON": venv / "python",
            "pip_install": self.install,
            "run_job": self.run,
            "ensure_venv_module": list,
            "kernels_compiled": lambda beside: contextlib.nullcontext(),
        }.items():
            monkeypatch.setattr(dev, name, value)

    def install(self, arguments, python=None):
        self.asked.append([str(one) for one in arguments])
        if self.fails and str(dev.LOCK) in self.asked[-1]:
            self.fails -= 1
            raise dev.SetupError("no network")
        return ["Successfully installed numpy-2 scipy-3"]

    def run(self, command, env=None):
        self.asked.append([str(one) for one in command])
        if "venv" in self.asked[-1]:
            self.venv.mkdir(exist_ok=True)
            (self.venv / "pyvenv.cfg").touch()
            (self.venv / "python").touch()
        return 0, []


def ready_environment(pip: Pip) -> None:
    dev.ensure_venv()
    assert dev.is_ready()
    (pip.venv / "by-hand.txt").touch()
    pip.asked.clear()


def test_a_changed_lock_changes_the_environment_in_place(monkeypatch, tmp_path, capsys):
    pip = Pip(monkeypatch, tmp_path / ".venv")
    ready_environment(pip)
    dev.INSTALLED_LOCK.write_text("gone==1 \\\n    --hash=sha256:0\nnumpy==1\n", encoding="utf-8")
    dev.STAMP.write_text("older\n" + dev.wanted_stamp().partition("\n")[2], encoding="utf-8")
    dev.ensure_venv()
    assert dev.is_ready() and (pip.venv / "by-hand.txt").exists()
    assert ["--require-hashes", "-r", str(dev.LOCK)] in pip.asked
    assert [one[-1] for one in pip.asked if "uninstall" in one] == ["gone"]  # numpy is in the new lock file
    assert not any("venv" in one for one in pip.asked)
    assert "2 packages changed" in capsys.readouterr().out


def test_where_that_fails_the_environment_is_made_anew_and_the_old_one_kept_until_then(monkeypatch, tmp_path):
    pip = Pip(monkeypatch, tmp_path / ".venv", fails=2)
    pip.fails = 0
    ready_environment(pip)
    dev.STAMP.write_text("older\n" + dev.wanted_stamp().partition("\n")[2], encoding="utf-8")
    pip.fails = 2  # in place, and again: the network is gone
    with pytest.raises(dev.SetupError, match="no network"):
        dev.ensure_venv()
    assert (pip.venv / "by-hand.txt").exists() and not dev.is_ready()
    pip.fails = 1  # in place only
    dev.ensure_venv()
    assert dev.is_ready() and not (pip.venv / "by-hand.txt").exists()
    assert [path.name for path in tmp_path.iterdir()] == [".venv"]


def test_another_python_makes_the_environment_anew(monkeypatch, tmp_path):
    pip = Pip(monkeypatch, tmp_path / ".venv")
    ready_environment(pip)
    dev.STAMP.write_text(dev.wanted_stamp().replace(dev.sys.version, "3.10"), encoding="utf-8")
    dev.ensure_venv()
    assert dev.is_ready() and not (pip.venv / "by-hand.txt").exists()


def test_the_line_of_progress_is_of_what_happens_now():
    said = ["Installing collected packages: a, b, c", "  Attempting uninstall: setuptools",
            "    Found existing installation: setuptools 65.5.0", "    Uninstalling setuptools-65.5.0:",
            "      Successfully uninstalled setuptools-65.5.0", "WARNING: Location 'x' is ignored"]  # fmt: skip
    assert [dev.shortened(line) for line in said] == ["Installing 3 packages", "", "", "", "", ""]


def test_a_folder_that_is_no_environment_is_left_alone(monkeypatch, tmp_path):
    (tmp_path / "precious.txt").touch()
    monkeypatch.setattr(dev, "VENV", tmp_path)
    with pytest.raises(dev.SetupError, match="is no virtual environment"):
        dev.make_venv()
    assert (tmp_path / "precious.txt").exists()


def test_download_size_is_read_from_pip():
    lines = ["  Downloading a-1.whl (16.5 MB)", "Collecting b", "Downloading b-1.whl (500 kB)", "Using cached c (9 MB)"]
    assert dev.downloaded_megabytes(lines) == pytest.approx(17.0)


def test_kernels_are_compiled_again_when_one_changed(monkeypatch, tmp_path):
    file = tmp_path / "core" / "kernel.py"
    file.parent.mkdir()
    file.write_text("@njit\n")
    (file.parent / "plain.py").write_text("")
    monkeypatch.setattr(dev, "ROOT", tmp_path)
    before = dev.kernels_wanted()
    assert "kernel.py" in before and "plain.py" not in before
    (file.parent / "plain.py").write_text("x = 1\n")
    assert dev.kernels_wanted() == before
    file.write_text("@njit(cache=True)\n")
    assert dev.kernels_wanted() != before


@pytest.mark.parametrize("fails", [False, True])
def test_kernels_that_cannot_be_compiled_stop_no_test(monkeypatch, tmp_path, capsys, fails):
    """And what was compiled is not compiled again."""
    package = tmp_path / "core" / "spherecal_app" / "cli"
    package.mkdir(parents=True)
    for folder in (package, package.parent):
        (folder / "__init__.py").touch()
    trial = "raise SystemExit('no compiler')" if fails else "open('ran', 'a').write('x')"
    (package / "main.py").write_text(f"import sys\nassert sys.argv[1:] == ['compile-kernels']\n{trial}\n")
    monkeypatch.setattr(dev, "ROOT", tmp_path)
    monkeypatch.setattr(dev, "PYTHON", sys.executable)
    monkeypatch.setattr(dev, "KERNELS", tmp_path / "kernels.txt")
    stale = tmp_path / "core" / "kernel.f-1.py311.nbi"
    stale.write_bytes(b"of another state of the sources")
    for _ in range(2):
        with dev.kernels_compiled("the checks"):
            assert not stale.exists()
    said = capsys.readouterr().out
    assert ("no compiler" in said) == fails
    assert dev.KERNELS.exists() != fails
    assert fails or (tmp_path / "ran").read_text() == "x"


def test_what_the_kernels_need_is_installed_first():
    """All of it, with its hashes, for the packages that the trial loads; nothing that takes long besides."""
    from importlib.metadata import requires

    from packaging.requirements import Requirement

    pinned = dev.lock_of(dev.ENGINE)
    assert {line.partition("==")[0] for line in pinned.splitlines() if "==" in line} == set(dev.ENGINE)
    assert pinned.count("--hash=") >= len(dev.ENGINE)
    for name in dev.ENGINE:
        for text in requires(name) or ():
            need = Requirement(text)
            if need.marker is None or need.marker.evaluate({"extra": ""}):
                assert need.name.lower() in dev.ENGINE, f"{name} needs {need.name}"


def test_wrong_command_is_a_plain_error():
    command = [sys.executable, ROOT / "dev.py", "dance"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "invalid choice" in done.stderr
    assert "Traceback" not in done.stderr


def kernels() -> dict[str, object]:
    """All functions that numba compiles, by module and name."""
    from numba.extending import is_jitted

    found = {}
    for file in sorted((ROOT / "core").rglob("*.py")):
        if "njit" in file.read_text(encoding="utf-8"):
            module = importlib.import_module(".".join(file.relative_to(ROOT / "core").with_suffix("").parts))
            found |= {f"{module.__name__}.{k}": v for k, v in vars(module).items() if is_jitted(v)}
    return found


def cached_parts_with_fast_sums(found: dict[str, Any]) -> list[str]:
    """Kernels that others call and whose rounding depends on where their compiled form comes from."""
    called = {
        id(function)
        for kernel in found.values()
        for name in kernel.py_func.__code__.co_names
        if (function := kernel.py_func.__globals__.get(name)) is not None
    }
    return [
        name
        for name, kernel in found.items()
        if id(kernel) in called
        and kernel.targetoptions.get("fastmath")
        and not (kernel.targetoptions.get("forceinline") and type(kernel._cache).__name__ == "NullCache")
    ]


def test_the_first_run_and_the_next_round_the_same():
    """Whether kernels are compiled or read from numba's cache: see adjust/kernel.py."""
    found = kernels()
    assert len(found) > 100
    assert cached_parts_with_fast_sums(found) == []


def test_the_demo_installs_what_the_program_and_its_installation_need():
    """All of spherecal[cameras,gui,report] and of the build backend, from the lock file; nothing else."""
    from importlib.metadata import PackageNotFoundError, requires

    from packaging.requirements import Requirement

    needed: dict[str, set[str]] = {}
    todo = [Requirement(text) for text in ("spherecal[cameras,gui,report]", "hatchling", "editables")]
    while todo:
        one = todo.pop()
        name, extras = one.name.lower().replace("_", "-").replace(".", "-"), one.extras | {""}
        if extras <= needed.get(name, set()):
            continue
        try:
            texts = requires(name) or []
        except PackageNotFoundError:  # not for this Python or platform
            continue
        needed[name] = needed.get(name, set()) | extras
        wants = [Requirement(text) for text in texts]
        todo += [w for w in wants if w.marker is None or any(w.marker.evaluate({"extra": e}) for e in extras)]
    assert needed.keys() - {"spherecal"} <= {*dev.ENGINE, *dev.RUN}
    assert {*dev.ENGINE, *dev.RUN} <= dev.locked_names(dev.LOCK)


def test_packages_do_not_grow_by_themselves() -> None:
    allowed = tomllib.loads((ROOT / "tests" / "lines_of_code.toml").read_text(encoding="utf-8"))
    found = {package: sum(map(lines_of_code, (ROOT / package).rglob("*.py"))) for package in allowed}
    grown = [f'"{name}" = {n}, not {allowed[name]}' for name, n in found.items() if n > allowed[name]]
    assert not grown, "more lines than tests/lines_of_code.toml says; edit it, and say why in the commit"
    packages = [*(f"core/{path.name}" for path in (ROOT / "core").glob("spherecal*")), "spherecal_gui"]
    assert sorted(allowed) == sorted(packages)


def lines_of_code(path: Path) -> int:
    """Lines with code: no docstrings, comments and blank lines."""
    source = path.read_text(encoding="utf-8")
    passed_over = {
        tokenize.COMMENT,
        tokenize.NL,
        tokenize.NEWLINE,
        tokenize.INDENT,
        tokenize.DEDENT,
        tokenize.ENDMARKER,
    }
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in passed_over:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and ast.get_docstring(
            node
        ):
            first = node.body[0]
            lines -= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return len(lines)


def test_docstrings_and_comments_are_no_code(tmp_path: Path) -> None:
    (tmp_path / "m.py").write_text(
        '"""Doc.\n\nMore.\n"""\n\n# why\nx = (\n    1,\n)\n\n\ndef f():\n    """D."""\n    return x\n'
    )
    assert lines_of_code(tmp_path / "m.py") == 5
