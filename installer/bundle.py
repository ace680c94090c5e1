"""Makes the program for people without Python: a folder, and on Debian and Ubuntu a .deb of it.

`python3 dev.py installer` runs this; --with-vtk takes pyvista's 3-D view in (275 MB more), --no-package leaves out the
.deb, --only-package packs the folder that is there.
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

from slim import megabytes, slim  # noqa: E402


def build(with_vtk: bool) -> Path:
    """Run PyInstaller and slim what it made; the bundle's folder."""
    environment = os.environ | {"SPHERECAL_WITH_VTK": "1" if with_vtk else "0"}
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


def check(bundle: Path) -> None:
    """The bundle starts, has what it needs, calibrates and verifies; CalledProcessError where it does not."""
    program = bundle / ("spherecal.exe" if os.name == "nt" else "spherecal")
    with tempfile.TemporaryDirectory() as folder:
        # nothing of this machine's Python may help: an empty environment but for what every session has
        keep = {name: os.environ[name] for name in ("SYSTEMROOT", "TEMP", "LANG", "DISPLAY") if name in os.environ}
        environment = keep | {"HOME": folder, "PATH": os.environ["PATH"] if os.name == "nt" else "/usr/bin:/bin"}
        for arguments in (
            ["--version"], ["doctor"], ["licences"],
            ["simulate", "demo", "--observations-only", "-o", f"{folder}/session"],
            ["calibrate", f"{folder}/session", "-o", f"{folder}/result"],
            ["verify", f"{folder}/session", "--rig", f"{folder}/result/rig.json", "-o", f"{folder}/result"],
            ["report", f"{folder}/result", "-o", f"{folder}/report.pdf"],
        ):  # fmt: skip
            began = time.monotonic()
            subprocess.run(
                [str(program), *arguments], env=environment, cwd=folder, check=True, stdout=subprocess.DEVNULL
            )
            print(f"  spherecal {arguments[0]}: {time.monotonic() - began:.1f} s", flush=True)


def main() -> int:
    """Build, check and pack."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--with-vtk", action="store_true")
    parser.add_argument("--no-package", action="store_true")
    parser.add_argument("--only-package", action="store_true")
    parser.add_argument("--level", type=int, default=15, help="of compression, 1 (quick) to 22 (small)")
    options = parser.parse_args()
    bundle = ROOT / "dist" / "spherecal" if options.only_package else build(options.with_vtk)
    check(bundle)
    if sys.platform.startswith("linux") and shutil.which("dpkg-deb") and not options.no_package:
        from debian import make_deb

        package = make_deb(bundle, ROOT / "dist", options.level)
        print(f"{package.name}: {package.stat().st_size / 1e6:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
