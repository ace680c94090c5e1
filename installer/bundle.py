"""Makes the program for people without Python: a folder, and on Debian and Ubuntu a .deb of it.

`python3 dev.py installer` runs this; --scene-apart packs pyvista's 3-D view (275 MB) as a .deb of its own beside the
other, --with-vtk takes it into the bundle, --with-numba takes numba in instead of compiling the engine's kernels ahead
of time (190 MB more, and minutes at every first calibration), --no-package leaves out the .deb, --only-package packs
the folders that are there.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT / "core"), str(HERE)]

from scene_part import take_apart  # noqa: E402
from slim import megabytes, slim  # noqa: E402

SCENE = ROOT / "dist" / "spherecal-3d"


def kernels() -> Path | None:
    """The folder with the compiled kernels; None where they cannot be compiled, and the bundle gets numba itself."""
    from kernels import missing, ready_kernels

    return None if missing() else ready_kernels(ROOT / "build" / "kernels")


def build(with_vtk: bool, with_numba: bool) -> Path:
    """Run PyInstaller and slim what it made; the bundle's folder."""
    ahead = None if with_numba else kernels()
    environment = os.environ | {"SPHERECAL_WITH_VTK": "1" if with_vtk else "0", "SPHERECAL_AHEAD": str(ahead or "")}
    command = [sys.executable, "-m", "PyInstaller", "--noconfirm", "--log-level", "WARN", "--distpath", "dist"]
    subprocess.run(
        [*command, "--workpath", "build/pyinstaller", str(HERE / "spherecal.spec")],
        cwd=ROOT,
        env=environment,
        check=True,
    )
    bundle = ROOT / "dist" / "spherecal"
    print(f"PyInstaller's folder: {megabytes(bundle):.0f} MB", flush=True)
    if sys.platform.startswith("linux"):
        slim(bundle)
    (bundle / "_internal" / "spherecal" / "_resources" / "licences" / "Python").mkdir(exist_ok=True)
    licence = Path(sys.base_prefix) / "lib" / f"python3.{sys.version_info.minor}" / "LICENSE.txt"
    if licence.is_file():
        shutil.copy(licence, bundle / "_internal/spherecal/_resources/licences/Python/LICENSE.txt")
    print(f"Bundle: {megabytes(bundle):.0f} MB in {bundle}", flush=True)
    return bundle


def check(bundle: Path, rendered: bool) -> None:
    """The bundle starts, has what it needs, calibrates and verifies; CalledProcessError where it does not.

    `rendered`: its reports show the scene as pyvista renders it, else as lines; RuntimeError where they do not.
    """
    program = bundle / ("spherecal.exe" if os.name == "nt" else "spherecal")
    with tempfile.TemporaryDirectory() as folder:
        # nothing of this machine's Python may help: an empty environment but for what every session has
        keep = {name: os.environ[name] for name in ("SYSTEMROOT", "TEMP", "LANG", "DISPLAY") if name in os.environ}
        environment = keep | {"HOME": folder, "PATH": os.environ["PATH"] if os.name == "nt" else "/usr/bin:/bin"}
        environment["SPHERECAL_KERNELS"] = "strict"  # a kernel that was not compiled is an error, not only slow
        for arguments in (
            ["--version"],
            ["doctor"],
            ["licences"],
            ["demo", "-o", f"{folder}/demo"],
            ["simulate", "demo", "--observations-only", "-o", f"{folder}/session"],
            *(
                ["calibrate", f"{folder}/session", "-o", f"{folder}/{m}", "--method", m]
                for m in ("auto", "free", "soft", "tao2021")
            ),
            ["verify", f"{folder}/session", "--rig", f"{folder}/auto/rig.json", "-o", f"{folder}/auto"],
            ["report", f"{folder}/auto", "-o", f"{folder}/report.pdf"],
            ["report", f"{folder}/auto", "-o", f"{folder}/report.html"],
        ):
            began = time.monotonic()
            done = subprocess.run(
                [str(program), *arguments], env=environment, cwd=folder, check=False, capture_output=True, text=True
            )
            if done.returncode:
                sys.stderr.write(done.stdout[-2000:] + done.stderr[-4000:])
                done.check_returncode()
            print(f"  spherecal {arguments[0]}: {time.monotonic() - began:.1f} s", flush=True)
        page = Path(folder, "report.html").read_text(encoding="utf-8")
        if ("data:image/png" in page) != rendered:
            raise RuntimeError(f"the report's scene is {'drawn' if rendered else 'rendered'}")


def main() -> int:
    """Build, check and pack."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--with-vtk", action="store_true")
    parser.add_argument("--scene-apart", action="store_true")
    parser.add_argument("--with-numba", action="store_true")
    parser.add_argument("--no-package", action="store_true")
    parser.add_argument("--only-package", action="store_true")
    parser.add_argument("--level", type=int, default=15, help="of compression, 1 (quick) to 22 (small)")
    options = parser.parse_args()
    bundle, apart = ROOT / "dist" / "spherecal", options.scene_apart
    if not options.only_package:
        build(options.with_vtk or apart, options.with_numba)
        if apart:
            check(bundle, rendered=True)
            take_apart(bundle, SCENE)
            print(f"Bundle: {megabytes(bundle):.0f} MB, 3-D view apart: {megabytes(SCENE):.0f} MB", flush=True)
    check(bundle, rendered=options.with_vtk and not apart)
    if sys.platform.startswith("linux") and shutil.which("dpkg-deb") and not options.no_package:
        from debian import make_deb, make_scene_deb

        packages = [make_deb(bundle, ROOT / "dist", options.level)]
        packages += [make_scene_deb(SCENE, ROOT / "dist", options.level)] if apart else []
        for package in packages:
            print(f"{package.name}: {package.stat().st_size / 1e6:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
