"""Building the simulated GenTL producer: one C++ source into one .cti, kept in the user's cache folder."""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from spherecal.errors import InputError, OutputError
from spherecal.files import create, remove_own_folder, scratch_beside, write_whole
from spherecal.resources import cache_folder

CTI_FILE = "spherecal_simulated.cti"
DISCOVERY_VARIABLE = "GENICAM_GENTL64_PATH"

_HERE = Path(__file__).resolve().parent
_SOURCE = "spherecal_gentl.cpp"
_SOURCES = (_SOURCE, "gentl_abi.h", "gentl_core.h", "gentl_exports.h", "pixels.h", "region.h", "device.xml")
_LONGEST_LITERAL = 8000  # characters; Microsoft's compiler takes 16380 bytes in one piece
_LIMIT_S = 180.0  # the build takes 3 s, and 8 s on a machine with other work for all its cores


def build_producer(folder: Path | None = None) -> Path:
    """The path of the simulated producer's .cti, built on first use.

    It is kept in the user's cache folder under a hash of its sources and the compiler's name, alone in its folder, so
    that this folder can stand in GENICAM_GENTL64_PATH. With `folder`, a copy is put there. InputError where there is
    no C++ compiler, OutputError where building fails or the folder cannot be written.
    """
    compiler = _compiler()
    kept = _cache_folder() / _source_hash(compiler) / CTI_FILE
    if not kept.exists():
        _put(kept, lambda file: _compile(compiler, file))
    if folder is None:
        return kept
    _put(folder / CTI_FILE, lambda file: create(file, kept.read_bytes()))
    return folder / CTI_FILE


def built_producers() -> list[Path]:
    """The files that were built on this machine so far."""
    return sorted(_cache_folder().glob(f"*/{CTI_FILE}"))


def compile_command(compiler: str, source: Path, include: Path, output: Path) -> list[str]:
    """The command that builds the .cti. The one for Microsoft's `cl` has never been run by us."""
    if Path(compiler).stem.lower() in ("cl", "clang-cl"):
        flags = ["/nologo", "/std:c++17", "/O2", "/EHsc", "/LD", "/utf-8", f"/I{include}"]
        return [compiler, *flags, str(source), f"/Fe:{output}", f"/Fo:{include / 'producer.obj'}"]
    flags = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-shared", "-fPIC", "-fvisibility=hidden", "-pthread"]
    # nodelete: a consumer that unloads the file while one of our threads ends would pull the code from under it
    linker = ["-Wl,-z,nodelete", "-lrt", "-ldl"] if sys.platform == "linux" else []
    return [compiler, *flags, f"-I{include}", str(source), "-o", str(output), *linker]


def _cache_folder() -> Path:
    return cache_folder("producer")


def _compiler() -> str:
    asked = os.environ.get("CXX")
    names = [asked] if asked else ["cl", "g++", "clang++"] if sys.platform == "win32" else ["g++", "clang++", "c++"]
    for name in names:
        if found := shutil.which(name):
            return found
    raise InputError(
        f"The simulated cameras need a C++ compiler, and {' or '.join(names)} is not on this machine.",
        "Install one (Debian, Ubuntu: apt install g++; Windows: the C++ build tools of Visual Studio, then use their "
        "command prompt), or name yours in the environment variable CXX.",
    )


def _source_hash(compiler: str) -> str:
    digest = hashlib.sha256(compiler.encode())
    for name in (*_SOURCES, Path(__file__).name):
        digest.update((_HERE / name).read_bytes())
    return digest.hexdigest()[:16]


def _compile(compiler: str, output: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="spherecal-build-") as scratch:
        include = Path(scratch)
        create(include / "device_xml.h", _as_header((_HERE / "device.xml").read_text(encoding="utf-8")).encode())
        command = compile_command(compiler, _HERE / _SOURCE, include, output)
        try:
            done = subprocess.run(command, cwd=scratch, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(
                f"The simulated cameras cannot be built: {error}.", "Try another compiler: CXX."
            ) from error
    if done.returncode != 0:
        lines = [line for line in (done.stdout + done.stderr).splitlines() if "error" in line.lower()]
        raise OutputError(
            f"The simulated cameras cannot be built with {compiler}: {' / '.join(lines[:3]) or 'no message'}.",
            "The compiler must know C++17.",
        )


def _as_header(xml: str) -> str:
    pieces = [xml[i : i + _LONGEST_LITERAL] for i in range(0, len(xml), _LONGEST_LITERAL)]
    literals = "\n".join(f'R"xml({piece})xml"' for piece in pieces)
    return f"#pragma once\nstatic const char device_xml[] =\n{literals};\n"


def _put(file: Path, make: Callable[[Path], object]) -> None:
    """Let `make` write beside `file`, then move it there whole: two programs may build at once."""
    try:
        scratch = scratch_beside(file)
    except OSError as error:
        raise OutputError(
            f"{file}: cannot be written ({error.strerror}).", "Free it, or name another folder."
        ) from error
    try:
        make(scratch / file.name)
        with (scratch / file.name).open("rb") as made:
            write_whole(file, made)
    except OSError as error:
        raise OutputError(
            f"{file}: cannot be written ({error.strerror}).", "Free it, or name another folder."
        ) from error
    finally:
        remove_own_folder(scratch)
