"""The engine's kernels compiled ahead of time for the bundle: the same results as numba's, and a plain word without."""

import os
import shutil
import subprocess
import sys
import sysconfig
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
kernels.compile_all(folder / "found.pickle", folder / "numba", kernels.PROCESSORS[kernels.os.uname().machine][-1])
"""
# Run with the package of compiled kernels in numba's place.
USE = """
import sys, logging
import numpy as np
import numba
assert not hasattr(numba, "core"), numba.__file__
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
print(numba.version_text())
odd = image.astype(np.int64)
assert refinement._largest_value(odd) == refinement._largest_value.py_func(odd)
"""


def run(code: str, *arguments: object, path: Path | None = None, **env: str) -> subprocess.CompletedProcess[str]:
    paths = [str(one) for one in (path, INSTALLER, ROOT / "core") if one is not None]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1", **env}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=280)


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the package that stands in for numba, holding two kernels."""
    include = Path(sysconfig.get_path("include"))
    if not sys.platform.startswith("linux") or not shutil.which("g++") or not (include / "Python.h").is_file():
        pytest.skip("needs Linux, g++ and Python's headers")
    folder = tmp_path_factory.mktemp("ahead")
    shutil.copytree(INSTALLER / "ahead" / "numba", folder / "numba", ignore=shutil.ignore_patterns("__pycache__"))
    done = run(SAMPLE, folder, NUMBA_CACHE_DIR=str(folder / "cache"))
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.mark.slow
def test_kernels_compiled_ahead_give_the_same_without_numba_and_llvm(package: Path) -> None:
    done = run(USE, path=package)
    assert done.returncode == 0, done.stderr
    assert "kernels compiled ahead" in done.stdout
    assert "was not compiled for ('<i8 2 C',) and runs slowly" in done.stderr


@pytest.mark.slow
def test_kernels_compiled_ahead_leave_the_interpreter_free(package: Path) -> None:
    """Cameras, window and detection run in threads beside them."""
    if not shutil.which("nm"):
        pytest.skip("needs binutils")
    library = next((package / "numba").glob("_kernels_*"))
    taken = subprocess.run(["nm", "-D", "--undefined-only", library], capture_output=True, text=True, check=True).stdout
    assert "PyEval_SaveThread" in taken and "PyEval_RestoreThread" in taken


@pytest.mark.slow
def test_a_missing_form_is_an_error_where_that_is_asked_for(package: Path) -> None:
    done = run(USE, path=package, SPHERECAL_KERNELS="strict")
    assert done.returncode != 0 and "_largest_value was not compiled for" in done.stderr


@pytest.mark.slow
def test_a_processor_that_nothing_was_compiled_for_is_named(package: Path) -> None:
    done = run("import numba", path=package, SPHERECAL_PROCESSOR="z80")
    assert done.returncode != 0 and "no compiled kernels for this processor" in done.stderr


class Pair(NamedTuple):
    first: np.ndarray
    second: float


@pytest.mark.parametrize(
    "argument",
    [
        1, 1.5, True, None, np.float64(2.0), np.int64(3), np.zeros((2, 3)), np.zeros((2, 3)).T,
        np.zeros((4, 6))[::2, ::2], np.zeros(3, np.uint16), np.zeros((2, 2), bool), (1, 2.0),
        Pair(np.zeros(3, np.float32), 1.0), np.zeros((0, 3)), np.zeros((1, 1)), np.zeros(5)[::2],
    ],
    ids=repr,
)  # fmt: skip
def test_both_sides_name_types_alike(argument: object) -> None:
    """What is compiled under a name has to be asked for by the same name."""
    import numba

    sys.path.insert(0, str(INSTALLER))
    try:
        import kernels
    finally:
        sys.path.pop(0)
    file = INSTALLER / "ahead" / "numba" / "__init__.py"
    source = file.read_text(encoding="utf-8")  # without the part that loads what was compiled
    scope: dict[str, object] = {"__file__": str(file), "__name__": "names"}
    exec(compile(source.partition("_made = ")[0] + source[source.index("def _key_of") :], "names", "exec"), scope)
    ours = scope["_key_of"](argument)  # type: ignore[operator]
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
