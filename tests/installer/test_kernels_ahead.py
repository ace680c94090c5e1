"""Kernels compiled ahead of time: the same results as numba's, numba or a plain word for what was not compiled."""

import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from conftest import ROOT

INSTALLER = ROOT / "installer"
# Two kernels of the program, small ones: three seconds to compile.
SAMPLE = """
import pickle, sys
from pathlib import Path
import numpy as np
import kernels
from spherecal.targets import components, refinement
image = np.random.default_rng(1).integers(0, 255, (60, 70), dtype=np.uint8)
refinement._largest_value(image)
components.tile_extremes(image)
found = {("spherecal.targets.refinement", "_largest_value"): kernels.variants(refinement._largest_value.signatures),
         ("spherecal.targets.components", "tile_extremes"): kernels.variants(components.tile_extremes.signatures)}
folder = Path(sys.argv[1])
(folder / "found.pickle").write_bytes(pickle.dumps(found))
goal = folder / "core" / "spherecal" / "_kernels"
goal.mkdir()
kernels.compile_all(folder / "found.pickle", goal, kernels.PROCESSORS[kernels.os.uname().machine][-1])
"""
# Run in a copy of the package that carries the compiled kernels; NO_NUMBA hides numba from it, as in a bundle.
NO_NUMBA = """
import sys
sys.modules["numba"] = None
"""
USE = """
import sys
import numpy as np
from spherecal.base.kernels import AHEAD
from spherecal_app.kernel_state import state
from spherecal.targets import components, refinement
assert "llvmlite" not in sys.modules
rng = np.random.default_rng(1)
image = rng.integers(0, 255, (60, 70), dtype=np.uint8)
frozen = image.copy(); frozen.setflags(write=False)
for one in (image, frozen, image[:, 3:-3], np.asfortranarray(image), image[::2, ::-1]):
    plain = refinement._largest_value.py_func(one)
    assert refinement._largest_value(one) == plain
    for a, b in zip(components.tile_extremes(one), components.tile_extremes.py_func(np.ascontiguousarray(one))):
        np.testing.assert_array_equal(a, b)
print(state(), AHEAD.processor)
odd = image.astype(np.int64)
assert refinement._largest_value(odd) == refinement._largest_value.py_func(odd)
"""


def run(code: str, *arguments: object, path: Path | None = None, **env: str) -> subprocess.CompletedProcess[str]:
    paths = [str(INSTALLER), str(ROOT / "core" if path is None else path / "core")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1", **env}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=280)


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a copy of the package that carries two compiled kernels."""
    include = Path(sysconfig.get_path("include"))
    if not sys.platform.startswith("linux") or not shutil.which("g++") or not (include / "Python.h").is_file():
        pytest.skip("needs Linux, g++ and Python's headers")
    folder = tmp_path_factory.mktemp("ahead")
    for name in [path.name for path in (ROOT / "core").glob("spherecal*")]:
        leave = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "core" / name, folder / "core" / name, ignore=leave)
    done = run(SAMPLE, folder, NUMBA_CACHE_DIR=str(folder / "cache"))
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.mark.slow
def test_kernels_compiled_ahead_give_the_same_without_numba_and_llvm(package: Path) -> None:
    done = run(NO_NUMBA + USE, path=package)
    assert done.returncode == 0, done.stderr
    assert "ahead x86-64" in done.stdout or "ahead generic" in done.stdout
    assert "was not compiled for ('<i8 2 C',) and runs slowly" in done.stderr


# `_of_kernel` calls another kernel: numba has to know that one as its own when it compiles the first.
BY_NUMBA = """
import sys, math
import numpy as np
from spherecal.base.kernels import njit
from spherecal.targets import refinement
assert "numba" not in sys.modules
largest = refinement._largest_value
@njit(nogil=True, cache=False)
def _of_kernel(image):
    return largest(image)
image = np.random.default_rng(1).integers(0, 255, (60, 70))
known = largest.py_func(image)
assert "numba" not in sys.modules
assert np.array_equal(largest(image), known) and "numba" in sys.modules
assert np.array_equal(_of_kernel(image), known)
assert _of_kernel._by_numba.signatures and largest._by_numba.signatures
"""


@pytest.mark.slow
def test_what_was_not_compiled_ahead_numba_compiles_where_it_is(package: Path) -> None:
    done = run(BY_NUMBA, path=package, NUMBA_CACHE_DIR=str(package / "cache"))
    assert done.returncode == 0, done.stderr
    assert "slowly" not in done.stderr


@pytest.mark.slow
def test_a_checkout_and_whoever_asks_for_numba_have_none_of_them(package: Path) -> None:
    code = "from spherecal.base.kernels import AHEAD; print(AHEAD is None)"
    assert run(code).stdout.strip() == "True"
    assert run(code, path=package, SPHERECAL_KERNELS="numba").stdout.strip() == "True"
    assert run(code, path=package).stdout.strip() == "False"


@pytest.mark.slow
def test_kernels_compiled_ahead_leave_the_interpreter_free(package: Path) -> None:
    """Cameras, window and detection run in threads beside them."""
    if not shutil.which("nm"):
        pytest.skip("needs binutils")
    library = next((package / "core" / "spherecal" / "_kernels").glob("_kernels_*"))
    taken = subprocess.run(["nm", "-D", "--undefined-only", library], capture_output=True, text=True, check=True).stdout
    assert "PyEval_SaveThread" in taken and "PyEval_RestoreThread" in taken


@pytest.mark.slow
def test_a_missing_form_is_an_error_where_that_is_asked_for(package: Path) -> None:
    done = run(USE, path=package, SPHERECAL_KERNELS="strict")
    assert done.returncode != 0 and "_largest_value was not compiled for" in done.stderr


@pytest.mark.slow
def test_a_processor_that_nothing_was_compiled_for_is_named(package: Path) -> None:
    done = run(NO_NUMBA + "import spherecal.base.kernels", path=package, SPHERECAL_PROCESSOR="z80")
    assert done.returncode != 0 and "no compiled kernels for this processor" in done.stderr


class Pair(NamedTuple):
    first: np.ndarray
    second: float


@pytest.mark.parametrize(
    "argument",
    [
        1,
        1.5,
        True,
        None,
        np.float64(2.0),
        np.int64(3),
        np.zeros((2, 3)),
        np.zeros((2, 3)).T,
        np.zeros((4, 6))[::2, ::2],
        np.zeros(3, np.uint16),
        np.zeros((2, 2), bool),
        (1, 2.0),
        Pair(np.zeros(3, np.float32), 1.0),
        np.zeros((0, 3)),
        np.zeros((1, 1)),
        np.zeros(5)[::2],
    ],
    ids=repr,
)
def test_both_sides_name_types_alike(argument: object) -> None:
    """What is compiled under a name has to be asked for by the same name."""
    import numba

    from spherecal.base.kernels import key_of

    sys.path.insert(0, str(INSTALLER))
    try:
        import kernels
    finally:
        sys.path.pop(0)
    ours = key_of(argument)
    theirs = kernels.key_of(numba.typeof(argument))
    assert ours == (tuple(theirs) if isinstance(theirs, list) else theirs)


def test_the_trial_of_the_build_reaches_every_kernel_that_the_program_calls() -> None:
    """By name; that the types are right as well is tried by the build, with SPHERECAL_KERNELS=strict."""
    sys.path.insert(0, str(INSTALLER))
    try:
        import kernels
    finally:
        sys.path.pop(0)
    found = kernels.entries()
    assert ("spherecal.adjust.engine", "_linearise") in found
    assert ("spherecal_sim.radiance", "trace_band") in found
    assert ("spherecal_sim.shading", "light") not in found  # only other kernels call it


@pytest.mark.slow
def test_a_wheel_of_this_platform_carries_them(package: Path, tmp_path: Path) -> None:
    """As `python3 dev.py build` makes it, here with two kernels: its tag says on which Python and Linux it runs."""
    command = [Path(sys.executable).parent / "hatchling", "build", "-t", "wheel", "-d", tmp_path]
    environment = os.environ | {"SPHERECAL_WHEEL_KERNELS": str(package / "core" / "spherecal" / "_kernels")}
    subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    tag = re.fullmatch(rf"spherecal-[\d.]+-{python}-{python}-manylinux_2_(\d+)_{os.uname().machine}\.whl", wheel.name)
    assert tag is not None, wheel.name
    libc = [int(part) for part in platform.libc_ver()[1].split(".")]
    assert libc[0] == 2 and 17 <= int(tag[1]) <= libc[1], "what was built here runs here"
    with zipfile.ZipFile(wheel) as packed:
        about = packed.read(next(name for name in packed.namelist() if name.endswith("/WHEEL"))).decode()
        assert "Root-Is-Purelib: false" in about
        packed.extractall(tmp_path / "core")
    done = run("from spherecal_app.kernel_state import state; print(state())", path=tmp_path)
    assert done.stdout.strip() == "ahead", done.stderr
