"""Compiles the engine's kernels ahead of time, for the bundle and the platform wheel: nobody waits for a compiler.

python3 installer/kernels.py FOLDER: a folder `_kernels` in FOLDER for spherecal/base/kernels.py, with kernels.json and
one library for every kind of processor. Which functions for which types is found out by calling them
(spherecal_app/cli/kernel_trial.py). Needs gcc, g++ and Python's headers.
"""

import argparse
import ast
import hashlib
import importlib
import json
import os
import pickle
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
# LLVM's names, the better first; the second runs on every 64-bit processor of Intel's and AMD's. See base/kernels.py.
PROCESSORS = {"x86_64": ("x86-64-v3", "x86-64"), "AMD64": ("x86-64-v3", "x86-64"), "aarch64": ("generic",)}

Types = tuple[Any, ...]
Found = dict[tuple[str, str], list[Types]]


def missing() -> str:
    """What is needed here and absent; empty where the kernels can be compiled."""
    if not sys.platform.startswith("linux") or os.uname().machine not in PROCESSORS:
        return "Linux on x86-64 or aarch64"
    if not (shutil.which("gcc") and shutil.which("g++")):
        return "gcc and g++"
    if not (Path(sysconfig.get_path("include")) / "Python.h").is_file():
        return "Python's headers"
    return ""


def make_kernels(folder: Path) -> Path:
    """The folder `_kernels` in a folder, compiled from this source tree; CalledProcessError where that fails."""
    package = folder / "_kernels"
    shutil.rmtree(package, ignore_errors=True)
    package.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as scratch:
        found = Path(scratch) / "found.pickle"
        began = time.monotonic()
        with ThreadPoolExecutor(os.cpu_count()) as pool:  # numba compiles in both, each part what it needs
            list(pool.map(lambda part: _child("find", f"{found}-{part}", part), range(parts())))
        _child("merge", found, *(f"{found}-{part}" for part in range(parts())))
        print(f"  kernels and their types found: {time.monotonic() - began:.0f} s", flush=True)

        def compile_for(processor: str) -> None:
            began = time.monotonic()
            # the inner functions are compiled by numba as usual: for the same processor, and not from its cache
            _child(
                "compile",
                found,
                package,
                processor,
                NUMBA_CPU_NAME=processor,
                NUMBA_CPU_FEATURES="",
                NUMBA_CACHE_DIR=f"{scratch}/{processor}",
            )
            print(f"  kernels for {processor}: {time.monotonic() - began:.0f} s", flush=True)

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(compile_for, PROCESSORS[os.uname().machine]))
    return package


def ready_kernels(folder: Path) -> Path:
    """As `make_kernels`, or what it made before from the same sources."""
    stamp, made_from = folder / "made-from.txt", _sources()
    package = folder / "_kernels"
    made = (package / "kernels.json").is_file() and stamp.is_file()
    if not made or stamp.read_text(encoding="utf-8") != made_from:
        stamp.unlink(missing_ok=True)
        make_kernels(folder)
        stamp.write_text(made_from, encoding="utf-8")
    return package


def _sources() -> str:
    """A hash of everything that the compiled kernels come from."""
    files = [path for path in sorted((ROOT / "core").rglob("*.py")) if b"njit" in path.read_bytes()]
    files += [HERE / "kernels.py", ROOT / "core" / "spherecal_app" / "cli" / "kernel_trial.py"]
    known = [sys.version, _numba_version(), *(hashlib.sha256(path.read_bytes()).hexdigest() for path in files)]
    return hashlib.sha256("\n".join(known).encode()).hexdigest()


def platform_tag(package: Path) -> str:
    """Which Linux the libraries run on: manylinux_2_N for the newest symbol version of glibc that they ask for."""
    newest = 17  # what the oldest manylinux of today has
    for library in package.glob("_kernels_*"):
        shown = subprocess.run(["objdump", "-T", library], capture_output=True, text=True, check=True).stdout
        newest = max(newest, *(int(minor) for minor in re.findall(r"GLIBC_2\.(\d+)", shown)))
    return f"manylinux_2_{newest}_{os.uname().machine}"


def _child(*arguments: object, **environment: str) -> None:
    paths = os.pathsep.join([str(ROOT / "core"), str(ROOT), str(HERE)])
    single = {"OMP_NUM_THREADS": "1", "PYTHONPATH": paths, "QT_QPA_PLATFORM": "offscreen", "SPHERECAL_KERNELS": "numba"}
    command = [sys.executable, str(HERE / "kernels.py"), "--child", *map(str, arguments)]
    done = subprocess.run(command, env=os.environ | single | environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.stderr.write(done.stderr[-4000:])
        done.check_returncode()


# --- which functions, for which types --------------------------------------------------------------------------------


def entries() -> set[tuple[str, str]]:
    """Module and name of all kernels that something else than a kernel calls."""
    trees: dict[str, ast.Module] = {}
    for file in sorted((ROOT / "core").rglob("*.py")):
        name = ".".join(file.relative_to(ROOT / "core").with_suffix("").parts)
        trees[name] = ast.parse(file.read_text(encoding="utf-8"))
    kernels = {(m, f.name) for m, tree in trees.items() for f in ast.walk(tree) if _is_kernel(f)}
    found: set[tuple[str, str]] = set()
    for module, tree in trees.items():
        imported = {
            alias.asname or alias.name: (node.module, alias.name)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module
            for alias in node.names
        }
        for owner, name in _named(tree):
            if owner is None:
                found |= {(module, name), imported.get(name, ("", ""))}
            elif owner in imported:
                found.add((".".join(imported[owner]), name))
    return found & kernels


def _is_kernel(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(one) for one in node.decorator_list)


def _named(node: ast.AST) -> Iterator[tuple[str | None, str]]:
    """The names below a node, as (None, name), or (owner, name) for `owner.name`; but not those inside kernels."""
    if _is_kernel(node):
        return
    if isinstance(node, ast.Name):
        yield None, node.id
    elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        yield node.value.id, node.attr
    for child in ast.iter_child_nodes(node):
        yield from _named(child)


def parts() -> int:
    """How many parts the trial has that may run side by side (kernel_trial.PARTS, counted without loading it)."""
    tree = ast.parse((ROOT / "core" / "spherecal_app" / "cli" / "kernel_trial.py").read_text(encoding="utf-8"))
    table = next(n.value for n in tree.body if isinstance(n, ast.AnnAssign) and ast.unparse(n.target) == "PARTS")
    assert isinstance(table, ast.Dict)
    return len(table.keys)


def find(output: Path, part: int) -> None:
    """Run a part of the trial; the types that each kernel was called with."""
    from spherecal_app.cli.kernel_trial import PARTS

    with tempfile.TemporaryDirectory() as folder:
        for step in list(PARTS.values())[part]:
            step(Path(folder))
    found: Found = {}
    for module, name in sorted(entries()):
        kernel = getattr(importlib.import_module(module), name)
        found[module, name] = variants(kernel.signatures)
    output.write_bytes(pickle.dumps(found))


def merge(output: Path, files: list[Path]) -> None:
    """What all parts found, in their order; RuntimeError for a kernel that none of them calls."""
    found: Found = {}
    for one in (pickle.loads(file.read_bytes()) for file in files):
        for entry, types in one.items():
            found[entry] = list(dict.fromkeys([*found.get(entry, []), *types]))
    never = [".".join(entry) for entry, types in found.items() if not types]
    if never:
        raise RuntimeError(f"kernel_trial.py never calls {', '.join(never)}")
    output.write_bytes(pickle.dumps(found))


def variants(signatures: list[Types]) -> list[Types]:
    """The types seen, arrays taken as writable; and each with arrays of any memory layout, for what was not seen.

    Types of calls from other kernels only (literals, left out arguments) are left out.
    """
    seen: dict[Types, None] = {}
    for types in signatures:
        if all(key_of(one) for one in types):
            seen[tuple(_writable(one) for one in types)] = None
    for types in list(seen):
        seen[tuple(_writable(one, "A") for one in types)] = None
    return list(seen)


def _writable(one: Any, layout: str | None = None) -> Any:
    from numba.core import types

    if isinstance(one, types.Array):
        return types.Array(one.dtype, one.ndim, layout or one.layout)
    if isinstance(one, types.BaseTuple):
        parts = [_writable(part, layout) for part in one.types]
        return types.BaseTuple.from_types(parts, getattr(one, "instance_class", None))
    if isinstance(one, types.Integer | types.Float):  # as Python's own numbers arrive
        return types.int64 if isinstance(one, types.Integer) else types.float64
    return one


def key_of(one: Any) -> Any:
    """What `base.kernels.key_of` calls this type: the same for the argument itself. None: it has no name."""
    from numba.core import types
    from numba.np.numpy_support import as_dtype

    if isinstance(one, types.Array):
        return f"{as_dtype(one.dtype).str} {one.ndim} {one.layout}"
    if isinstance(one, types.BaseTuple):
        parts = [key_of(part) for part in one.types]
        return parts if all(parts) else None
    names = {types.Boolean: "bool", types.Integer: "int", types.Float: "float", types.NoneType: "none"}
    for kind, name in names.items():
        if isinstance(one, kind) and not isinstance(one, types.Literal):
            return name
    return None


# --- compiling -------------------------------------------------------------------------------------------------------


def compile_all(found_file: Path, package: Path, processor: str) -> None:
    """One library, `_kernels_PROCESSOR`, and the list of what is in it."""
    from numba.core import typing
    from numba.pycc import compiler as pycc

    name = "_kernels_" + processor.replace("-", "_")
    found: Found = pickle.loads(found_file.read_bytes())
    exported, table = [], []
    for (module, function), signatures in found.items():
        dispatcher = getattr(importlib.import_module(module), function)
        for number, types in enumerate(signatures):
            symbol = f"{module.replace('.', '_')}_{function}_{number}"
            exported.append(pycc.ExportEntry(symbol, typing.signature(None, *types), dispatcher))
            table.append([module, function, [key_of(one) for one in types], symbol])
    pycc.compile_extra = _as_declared(pycc.compile_extra)
    module_compiler = pycc.ModuleCompiler(exported, name, use_nrt=True, cpu_name=processor)
    module_compiler.external_init_function = "pycc_init_" + name
    with tempfile.TemporaryDirectory() as scratch:
        object_file = Path(scratch) / "kernels.o"
        module_compiler.write_native_object(str(object_file), wrap=True)
        _link(name, object_file, package / (name + sysconfig.get_config_var("EXT_SUFFIX")))
    (package / "kernels.json").write_text(json.dumps({"numba": _numba_version(), "kernels": table}), encoding="utf-8")


def _as_declared(compile_extra: Any) -> Any:
    """pycc compiles functions as if they had been given no options; ours shall keep those of their `njit(...)`."""

    def compile_it(typing_context: Any, context: Any, dispatcher: Any, args: Any, result: Any, flags: Any, **more: Any):
        flags = flags.copy()  # one object for all functions
        options = {k: v for k, v in dispatcher.targetoptions.items() if k != "cache"}
        dispatcher.targetdescr.options.parse_as_flags(flags, options)
        flags.no_cfunc_wrapper = True
        return compile_extra(typing_context, context, dispatcher.py_func, args, result, flags, **more)

    return compile_it


def _link(name: str, object_file: Path, library: Path) -> None:
    """The object file with numba's run-time support, which is C."""
    import numba
    import numpy as np

    source = Path(numba.__file__).parent
    include = [f"-I{sysconfig.get_path('include')}", f"-I{np.get_include()}"]
    define = [f"-DPYCC_MODULE_NAME={name}", "-DPYCC_USE_NRT=1", "-DNUMBA_LAPACK_BUILD_ILP64=0", "-DNDEBUG"]
    extensions = sorted((source / "cext").glob("*.c"))
    parts = []
    for file in (source / "pycc" / "modulemixin.c", *extensions, source / "core" / "runtime" / "nrt.cpp"):
        parts.append(object_file.with_name(file.stem + ".o"))
        compiler = "g++" if file.suffix == ".cpp" else "gcc"
        subprocess.run(
            [compiler, "-c", "-O2", "-w", "-fPIC", *define, *include, str(file), "-o", str(parts[-1])], check=True
        )
    subprocess.run(
        [
            "g++",
            "-shared",
            str(object_file),
            *map(str, parts),
            "-o",
            str(library),
            "-pthread",
            "-lm",
            "-s",
            "-Wl,--gc-sections",
            "-static-libgcc",
        ],
        check=True,
    )


def _numba_version() -> str:
    import numba

    return numba.__version__


def main() -> int:
    """Make the package, or be one of the processes that do."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--child", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        step, *rest = options.child
        if step == "find":
            find(Path(rest[0]), int(rest[1]))
        elif step == "merge":
            merge(Path(rest[0]), [Path(file) for file in rest[1:]])
        else:
            compile_all(Path(rest[0]), Path(rest[1]), rest[2])
    elif options.folder:
        print(make_kernels(options.folder))
    else:
        parser.error("name a folder")
    return 0


if __name__ == "__main__":
    sys.exit(main())
