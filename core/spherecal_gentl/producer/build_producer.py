"""Building the GenTL producers and the simulated GigE camera: one C++ source each, kept in the user's cache folder."""

import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from spherecal.base.errors import InputError, OutputError
from spherecal_files.cache_folder import cache_folder
from spherecal_files.filesystem import create, remove_own_folder, scratch_beside, write_whole
from spherecal_files.programs import find_program

CTI_FILE = "spherecal_simulated.cti"
ARAVIS_CTI_FILE = "spherecal_aravis.cti"
DISCOVERY_VARIABLE = "GENICAM_GENTL64_PATH"

_HERE = Path(__file__).resolve().parent
_LONGEST_LITERAL = 8000  # characters; Microsoft's compiler takes 16380 bytes in one piece
_LIMIT_S = 180.0  # the build takes 3 s, and 8 s on a machine with other work for all its cores
_ARAVIS = "aravis-0.8"


@dataclass(frozen=True)
class _Product:
    """Something that is built here from C++: what it is called, its file, its sources, whether it needs libaravis."""

    name: str
    file: str
    sources: tuple[Path, ...]
    aravis: bool = False
    library: bool = True


_SHARED = tuple(_HERE / name for name in ("gentl_abi.h", "gentl_core.h", "gentl_exports.h"))
_SIMULATED = _Product(
    "The simulated cameras",
    CTI_FILE,
    (
        _HERE / "spherecal_gentl.cpp",
        *_SHARED,
        *(_HERE / name for name in ("odd.h", "pixels.h", "region.h", "device.xml")),
    ),
)
_OF_ARAVIS = _Product(
    "The producer for GigE Vision and USB3 Vision cameras",
    ARAVIS_CTI_FILE,
    (_HERE / "spherecal_aravis.cpp", _HERE / "gvcp.h", _HERE / "gvsp_filter.h", *_SHARED),
    aravis=True,
)
_FAKE_CAMERA = _Product(
    "The simulated GigE camera", "fake_camera", (_HERE.parent / "gige" / "fake_camera.cpp",), aravis=True, library=False
)


def build_producer(folder: Path | None = None, aravis: bool = False) -> Path:
    """The path of a producer's .cti, built on first use and kept by a hash of its sources in a folder of its own."""
    product = _OF_ARAVIS if aravis else _SIMULATED
    kept = _built(product)
    if folder is None:
        return kept
    _put(folder / product.file, lambda file: create(file, kept.read_bytes()))
    return folder / product.file


def build_fake_camera() -> Path:
    """The program that is one simulated GigE Vision camera in this machine, built on first use."""
    return _built(_FAKE_CAMERA)


def built_producers() -> list[Path]:
    """The producer files (.cti) that were built on this machine so far."""
    return sorted(file for name in (CTI_FILE, ARAVIS_CTI_FILE) for file in cache_folder("producer").glob(f"*/{name}"))


def compile_command(
    compiler: str, source: Path, include: Path, output: Path, library: bool = True, flags: Sequence[str] = ()
) -> list[str]:
    """The command that builds a .cti or a program. The one for Microsoft's `cl` has never been run by us."""
    if Path(compiler).stem.lower() in ("cl", "clang-cl"):
        plain = ["/nologo", "/std:c++17", "/O2", "/EHsc", "/LD", "/utf-8", f"/I{include}"]
        return [compiler, *plain, str(source), f"/Fe:{output}", f"/Fo:{include / 'producer.obj'}"]
    plain = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-pthread"]
    linker = []
    if library:
        plain += ["-shared", "-fPIC", "-fvisibility=hidden"]
        # nodelete: a consumer that unloads the file while one of our threads ends would pull the code from under it
        linker = ["-Wl,-z,nodelete", "-lrt", "-ldl"] if sys.platform == "linux" else []
    return [compiler, *plain, f"-I{include}", str(source), "-o", str(output), *linker, *flags]


def aravis_flags() -> list[str]:
    """What the compiler needs for libaravis."""
    if (tool := find_program("pkg-config")) is None:
        raise _no_aravis("pkg-config")
    # Debian's libaravis-dev names packages that it does not bring, so that `--cflags aravis-0.8` alone fails
    folder = _said_by([tool, "--variable=includedir", _ARAVIS])
    glib = _said_by([tool, "--cflags", "--libs", "gio-2.0"])
    if folder is None or glib is None or not (Path(folder) / _ARAVIS / "arv.h").exists():
        raise _no_aravis("libaravis-dev")
    library = _said_by([tool, "--variable=libdir", _ARAVIS])
    return [f"-I{Path(folder) / _ARAVIS}", *([f"-L{library}"] if library else []), f"-l{_ARAVIS}", *glib.split()]


def _said_by(command: list[str]) -> str | None:
    done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def _no_aravis(package: str) -> InputError:
    return InputError(
        f"Cameras without their maker's driver need libaravis, and {package} is not on this machine.",
        "Install it (Debian, Ubuntu: apt install libaravis-dev pkg-config; Linux only).",
    )


def _built(product: _Product) -> Path:
    flags = aravis_flags() if product.aravis else []
    compiler = cxx_compiler()
    digest = hashlib.sha256(compiler.encode())
    for file in (*product.sources, Path(__file__)):
        digest.update(file.read_bytes())
    kept = cache_folder("producer") / digest.hexdigest()[:16] / product.file
    if not kept.exists():
        _put(kept, lambda file: _compile(product, compiler, file, flags))
    if not product.library and not os.access(kept, os.X_OK):
        kept.chmod(0o755)
    return kept


def cxx_compiler() -> str:
    """The C++ compiler of this machine; InputError where there is none."""
    asked = os.environ.get("CXX")
    names = [asked] if asked else ["cl", "g++", "clang++"] if sys.platform == "win32" else ["g++", "clang++", "c++"]
    for name in names:
        if found := find_program(name):
            return found
    raise InputError(
        f"The simulated cameras need a C++ compiler, and {' or '.join(names)} is not on this machine.",
        "Install one (Debian, Ubuntu: apt install g++; Windows: the C++ build tools of Visual Studio, then use their "
        "command prompt), or name yours in the environment variable CXX.",
    )


def _compile(product: _Product, compiler: str, output: Path, flags: Sequence[str]) -> None:
    with tempfile.TemporaryDirectory(prefix="spherecal-build-") as scratch:
        include = Path(scratch)
        xml = (_HERE / "device.xml").read_text(encoding="utf-8")
        pieces = [xml[i : i + _LONGEST_LITERAL] for i in range(0, len(xml), _LONGEST_LITERAL)]
        literals = "\n".join(f'R"xml({piece})xml"' for piece in pieces)
        create(include / "device_xml.h", (f"#pragma once\nstatic const char device_xml[] =\n{literals};\n").encode())
        command = compile_command(compiler, product.sources[0], include, output, product.library, flags)
        try:
            done = subprocess.run(command, cwd=scratch, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"{product.name} cannot be built: {error}.", "Try another compiler: CXX.") from error
    if done.returncode != 0:
        lines = [line for line in (done.stdout + done.stderr).splitlines() if "error" in line.lower()]
        raise OutputError(
            f"{product.name} cannot be built with {compiler}: {' / '.join(lines[:3]) or 'no message'}.",
            "The compiler must know C++17.",
        )


def _put(file: Path, make: Callable[[Path], object]) -> None:
    """Let `make` write beside `file`, then move it there whole: two programs may build at once."""
    try:
        scratch = scratch_beside(file)
        try:
            make(scratch / file.name)
            with (scratch / file.name).open("rb") as made:
                write_whole(file, made)
        finally:
            remove_own_folder(scratch)
    except OSError as error:
        raise OutputError(
            f"{file}: cannot be written ({error.strerror}).", "Free it, or name another folder."
        ) from error
