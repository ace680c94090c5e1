"""Takes out of a Linux bundle what SphereCal never uses, and symbols that only debuggers read.

What must stay is tried afterwards by bundle.py: doctor and the way from a session to its report.
"""

import fnmatch
import os
import re
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Iterable
from pathlib import Path

# Patterns below _internal; measured as never opened in a walk through the wizard and all commands.
UNUSED = [
    "PySide6/Qt/plugins/platformthemes/libqgtk3.so",
    "PySide6/Qt/plugins/sqldrivers/*",
    "PySide6/Qt/plugins/tls/*",
    "PySide6/Qt/plugins/egldeviceintegrations/*",
    "PySide6/Qt/plugins/networkinformation/*",
    "PySide6/Qt/plugins/platforms/libqeglfs.so",
    "PySide6/Qt/plugins/platforms/libqlinuxfb.so",
    "PySide6/Qt/plugins/platforms/libqvnc.so",
    "PySide6/Qt/plugins/platforms/libqminimalegl.so",
    "PySide6/Qt/plugins/platforms/libqvkkhrdisplay.so",
    "PySide6/Qt/plugins/imageformats/libqtiff.so",
    "PySide6/Qt/plugins/imageformats/libqwebp.so",
    "PySide6/Qt/plugins/imageformats/libqicns.so",
    "PySide6/Qt/plugins/imageformats/libqtga.so",
    "PySide6/Qt/plugins/imageformats/libqwbmp.so",
    "PySide6/Qt/lib/libQt6EglF*",
    "matplotlib/mpl-data/sample_data/*",
    "matplotlib/mpl-data/images/*",
    "matplotlib/mpl-data/fonts/afm/*",
    "numpy/*/tests/*",
    "scipy/*/tests/*",
    "numba/*.c",
    "numba/*.h",
    "*/__pycache__/*",
    "pyvista/examples/*",
]
KEPT_TRANSLATIONS = ("qtbase_de.qm", "qtbase_zh_CN.qm", "qt_de.qm", "qt_zh_CN.qm")
# The host's own libraries that PyInstaller swept in behind GTK's theme plugin, or that every desktop has of its own.
HOST = tuple(
    [
        "libgtk-3",
        "libgdk-3",
        "libgdk_pixbuf",
        "libcairo",
        "libpango",
        "libatk",
        "libatspi",
        "libepoxy",
        "libharfbuzz",
        "libthai",
        "libdatrie",
        "libfribidi",
        "libgraphite2",
        "libpixman",
        "libXcomposite",
        "libXcursor",
        "libXdamage",
        "libXfixes",
        "libXi",
        "libXinerama",
        "libXrandr",
        "libXrender",
        "libXext",
        "libX11.",
        "libX11-xcb",
        "libXau",
        "libXdmcp",
        "libwayland",
        "libgio-2",
        "libgmodule-2",
        "libgobject-2",
        "libglib-2",
        "libmount",
        "libblkid",
        "libselinux",
        "libpcre2",
        "libfontconfig",
        "libfreetype",
        "libexpat",
        "libdbus-1",
        "libsystemd",
        "libgcrypt",
        "libgpg-error",
        "libcap",
        "liblz4",
        "libzstd",
        "liblzma.so",
        "libffi.so.8",
        "libbrotli",
        "libpng16.so",
        "libjpeg",
        "libtiff",
        "libjbig",
        "libdeflate",
        "libLerc",
        "libwebp",
        "libxkbcommon",
        "libxcb",
        "libcrypto.so.3",
        "libssl.so.3",
        "libsqlite3",
        "libuuid",
        "libbsd",
        "libmd.so",
    ]
)
# Of these, Python's own modules need their own copies.
PYTHON_NEEDS = ("libffi", "liblzma.so", "libuuid", "libcrypto.so.3")
FFMPEG = ("libavcodec", "libavformat", "libavutil", "libswscale")
BEHIND_FFMPEG = ("libswresample", "libvpx", "libssl-", "libcrypto-", "libdrm-")


def slim(bundle: Path) -> None:
    """Make the folder small, in place."""
    inside = bundle / "_internal"
    second = bundle / "spherecal-gui"
    if second.is_file() and not second.is_symlink():
        second.unlink()
        second.symlink_to("spherecal")
    for path in list(inside.rglob("*")):
        if any(fnmatch.fnmatch(str(path.relative_to(inside)), pattern) for pattern in UNUSED):
            remove(path)
    for path in (inside / "PySide6" / "Qt" / "translations").glob("*.qm"):
        if path.name not in KEPT_TRANSLATIONS:
            remove(path)
    without_host_libraries(inside)
    if shutil.which("gcc"):
        without_video(inside)
        with_one_openblas(inside)
        with_little_icu(inside)
    drop_dangling(inside)
    strip_symbols(inside)
    forget_the_builder(inside)


def remove(path: Path) -> None:
    """Remove a file, link or folder."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def without_host_libraries(inside: Path) -> None:
    """Leave out libraries that the package's dependencies install, unless Python's own modules link to them."""
    for path in inside.glob("lib*.so*"):
        if path.name.startswith(HOST) and not path.name.startswith(PYTHON_NEEDS):
            remove(path)


def forget_the_builder(inside: Path) -> None:
    """Take the building machine's folder of Python out of libpython's list of places to look for libraries."""
    built_in = str(sysconfig.get_config_var("LIBDIR")).encode() + b"\0"
    for path in inside.glob("libpython*.so*"):
        data = path.read_bytes()
        if not path.is_symlink() and built_in in data:
            path.write_bytes(data.replace(built_in, bytes(len(built_in))))


def drop_dangling(inside: Path) -> None:
    """Links whose goal was removed."""
    for path in inside.rglob("*"):
        if path.is_symlink() and not path.exists():
            path.unlink()


def strip_symbols(inside: Path) -> None:
    """Strip what survives it; wheels whose libraries were patched after linking (scipy, numpy, Pillow) do not."""
    spared = ("scipy", "numpy", "scipy.libs", "numpy.libs", "pillow.libs", "opencv_python_headless.libs", "PIL")
    for path in inside.rglob("*"):
        if path.is_symlink() or not path.is_file() or ".so" not in path.name:
            continue
        if path.relative_to(inside).parts[0] not in spared:
            subprocess.run(["strip", "--strip-unneeded", str(path)], check=False, capture_output=True)


# --- stand-ins for libraries that are linked to and never called -----------------------------------------------------


def without_video(inside: Path) -> None:
    """OpenCV links to FFmpeg for video files, which SphereCal never opens: functions of the same names that only abort.

    That takes 32 MB out, and with them an old libcrypto and all in OpenCV that could open a network connection.
    """
    folder, user = inside / "opencv_python_headless.libs", inside / "cv2" / "cv2.abi3.so"
    if not user.is_file():
        return
    needed = undefined(user)
    for name in FFMPEG:
        for library in folder.glob(f"{name}-*"):
            there = defined(library)
            own = {symbol: version for symbol, version in needed.items() if symbol in there}
            body = "".join(f"void {symbol}(void) {{ abort(); }}\n" for symbol in own)
            compile_stand_in(library, "void abort(void);\n" + body, own)
    for name in BEHIND_FFMPEG:
        for library in folder.glob(f"{name}*"):
            remove(library)


def with_one_openblas(inside: Path) -> None:
    """OpenCV's matrix functions by SciPy's OpenBLAS instead of a second one of 38 MB: nineteen jumps."""
    folder, user = inside / "opencv_python_headless.libs", inside / "cv2" / "cv2.abi3.so"
    other = next((inside / "scipy.libs").glob("libscipy_openblas-*.so"), None)
    if not user.is_file() or other is None:
        return
    theirs = defined(other)
    for library in folder.glob("libopenblas*"):
        wanted = sorted(undefined(user).keys() & defined(library).keys())
        if any(f"scipy_{symbol}" not in theirs for symbol in wanted) or not wanted:
            return
        jumps = "".join(f'__asm__(".globl {s}\\n.type {s},@function\\n{s}: jmp scipy_{s}@PLT\\n");\n' for s in wanted)
        compile_stand_in(library, jumps, {}, [str(other), "-Wl,-rpath,$ORIGIN/../scipy.libs"])
        for left in (*folder.glob("libgfortran*"), *folder.glob("libquadmath*")):
            remove(left)


def with_little_icu(inside: Path) -> None:
    """ICU's tables of languages (32 MB), which Qt asks for sorting and time zones: an empty table of contents instead.

    Qt then sorts by code point and takes time zones from the system. Its layout is ICU's own for a build without data.
    """
    for library in (inside / "PySide6" / "Qt" / "lib").glob("libicudata.so.*"):
        symbol = next((name for name in defined(library) if re.fullmatch(r"icudt\d+_dat", name)), None)
        if symbol is None or library.is_symlink():
            continue
        table = (
            "#include <stdint.h>\n__attribute__((aligned(16))) const struct {"
            " uint16_t header; uint8_t magic1, magic2; uint16_t size, zero; uint8_t big, family, wide, none;"
            " uint8_t format[4], version[4], data[4]; char padding[8]; uint32_t count, more; int32_t rest[4]; }"
            f" {symbol} = {{32, 0xda, 0x27, 20, 0, 0, 0, 2, 0, {{0x54, 0x6f, 0x43, 0x50}}, {{1}}, {{0}}, {{0}}, 0}};\n"
        )
        compile_stand_in(library, table, {})


def undefined(library: Path) -> dict[str, str]:
    """The symbols that a library takes from others, with their versions ("" for none)."""
    return _symbols(library, "--undefined-only")


def defined(library: Path) -> dict[str, str]:
    """The symbols that a library offers."""
    return _symbols(library, "--defined-only")


def _symbols(library: Path, which: str) -> dict[str, str]:
    done = subprocess.run(["nm", "-D", which, str(library)], capture_output=True, text=True, check=True)
    names = [line.split()[-1] for line in done.stdout.splitlines() if line.split()]
    return {name.partition("@")[0]: name.partition("@")[2].lstrip("@") for name in names}


def compile_stand_in(library: Path, code: str, versions: dict[str, str], more: Iterable[str] = ()) -> None:
    """Put a small library of the same file name, soname and symbol versions in the place of a large one."""
    said = subprocess.run(["readelf", "-d", str(library)], capture_output=True, text=True, check=True).stdout
    soname = re.search(r"SONAME.*\[(.+)\]", said)
    with tempfile.TemporaryDirectory() as scratch:
        source, script, output = (Path(scratch) / name for name in ("x.c", "x.map", "x.so"))
        source.write_text(code, encoding="utf-8")
        nodes: dict[str, list[str]] = {}
        for symbol, version in versions.items():
            nodes.setdefault(version, []).append(symbol)
        named = {version: symbols for version, symbols in nodes.items() if version}
        script.write_text("".join(f"{v} {{ global: {'; '.join(s)}; }};\n" for v, s in named.items()), encoding="utf-8")
        command = ["gcc", "-shared", "-fPIC", "-O1", "-w", str(source), "-o", str(output), *more]
        command += [f"-Wl,-soname,{soname[1] if soname else library.name}", "-Wl,-z,noexecstack"]
        command += [f"-Wl,--version-script,{script}"] if named else []
        subprocess.run(command, check=True)
        os.chmod(output, 0o755)
        shutil.copyfile(output, library)


def megabytes(folder: Path) -> float:
    """What a folder takes on the disk, links not counted, in MB (10^6 bytes)."""
    return sum(p.lstat().st_size for p in folder.rglob("*") if p.is_file() and not p.is_symlink()) / 1e6
