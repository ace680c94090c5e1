"""Installs the .deb in a bare Debian 12 and tries it: seconds, sizes, doctor, a calibration, the window. Run as root.

python3 installer/try_deb.py FOLDER [--deb FILE] [--mirror URL]: FOLDER becomes the root of that system (made by
debootstrap, 800 MB). Needs debootstrap; for the window Xvfb and xdotool on this machine.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from walk import virtual_screen, walk

ROOT = Path(__file__).resolve().parents[1]
CHROOT = shutil.which("chroot") or "/usr/sbin/chroot"
NOBODY = ("setpriv", "--reuid=1000", "--regid=1000", "--clear-groups")


def inside(root: Path, *command: str, user: bool = False, processor: str = "") -> subprocess.CompletedProcess[str]:
    """Run a program in the bare system; as a user with a home that cannot be written where `user` is set.

    `processor`: with the kernels that were compiled for this one.
    """
    environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "DEBIAN_FRONTEND": "noninteractive"}
    if user:
        environment |= {"HOME": "/home/nobody-here", "XDG_RUNTIME_DIR": "/tmp", "SPHERECAL_KERNELS": "strict"}
    if processor:
        environment["SPHERECAL_PROCESSOR"] = processor
    chroot = [CHROOT, str(root), *(NOBODY if user else ()), *command]
    return subprocess.run(chroot, env=environment, capture_output=True, text=True, check=False, errors="replace")


def say(name: str, done: subprocess.CompletedProcess[str], began: float, expected: int = 0) -> bool:
    """One line of the report, with what was printed where it failed."""
    good = done.returncode == expected
    print(f"{'ok ' if good else 'BAD'} {name}: {time.monotonic() - began:.1f} s", flush=True)
    if not good:
        print((done.stdout + done.stderr)[-3000:])
    return good


def make_root(root: Path, mirror: str) -> None:
    """A minimal Debian 12 where there is none yet."""
    if not (root / "etc" / "debian_version").exists():
        root.mkdir(parents=True, exist_ok=True)
        command = ["debootstrap", "--variant=minbase", "bookworm", str(root), *([mirror] if mirror else [])]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    for name in ("proc", "dev"):
        if not any((root / name).iterdir()):
            kind = ["-t", "proc", "proc"] if name == "proc" else ["--rbind", "/dev"]
            subprocess.run(["mount", *kind, str(root / name)], check=True)


def processor_seconds(pid: int) -> float:
    """What a process has used so far: unlike seconds, the same on a busy machine."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def drop_caches() -> bool:
    """Have the system forget all files that it holds in memory; False where it may not be asked to."""
    os.sync()
    try:
        Path("/proc/sys/vm/drop_caches").write_text("3", encoding="ascii")
    except OSError:
        return False
    return True


def samples(screen: Path) -> list[bytes]:
    """Some pixels of the virtual screen, from its top to its bottom."""
    with screen.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        return [os.pread(file.fileno(), 256, at) for at in range(size // 128, size, size // 64)]


def one_start(root: Path, display: str, screen: Path) -> tuple[float, float] | None:
    """Seconds, and processor seconds, from the start of `spherecal-gui` to its painted window; None: it never is."""
    blank, painted = samples(screen), False
    environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/tmp/home", "DISPLAY": display}
    command = [CHROOT, str(root), "/usr/bin/spherecal-gui"]
    began = time.monotonic()
    window = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not painted and window.poll() is None and time.monotonic() - began < 120:
        time.sleep(0.01)
        painted = sum(a != b for a, b in zip(blank, samples(screen), strict=True)) > len(blank) // 2
    seconds = time.monotonic() - began, processor_seconds(window.pid) if painted else 0.0
    if painted and shutil.which("import"):
        picture = ROOT / "build" / "window.png"
        picture.parent.mkdir(exist_ok=True)
        time.sleep(1)
        subprocess.run(["import", "-display", display, "-window", "root", str(picture)], check=False)
    window.terminate()
    window.wait(20)
    time.sleep(0.5)
    return seconds if painted else None


def time_to_window(root: Path) -> bool:
    """Say how long the window takes: with nothing of the program in memory, then as at every other start."""
    if not shutil.which("Xvfb"):
        print("    window: not tried (no Xvfb)")
        return True
    good = True
    with tempfile.TemporaryDirectory() as folder, virtual_screen(Path(folder)) as display:
        for kind, number in (("first start", 1), ("nothing in memory", 3), ("started before", 5)):
            starts = []
            for _ in range(number):
                if kind == "nothing in memory" and not drop_caches():
                    break
                starts.append(one_start(root, display, Path(folder) / "Xvfb_screen0"))
            took = sorted(one for one in starts if one is not None)
            good &= len(took) == len(starts)
            if took:
                listed = ", ".join(f"{seconds:.2f}" for seconds, _ in took)
                mark = "ok " if len(took) == len(starts) else "BAD"
                print(f"{mark} window painted, {kind}: {listed} s; {took[0][1]:.2f} s of a processor", flush=True)
            elif starts:
                print(f"BAD window, {kind}: never painted", flush=True)
    return good


def scene_package(root: Path, package: Path) -> bool:
    """Install the package with pyvista and VTK, see reports rendered, and drawn again once it is gone."""
    shutil.copy(package, root / "tmp" / "scene.deb")
    good = True
    for name, command, rendered in (
        ("3-D view installed", ("dpkg", "-i", "/tmp/scene.deb"), True),
        ("3-D view removed", ("apt-get", "purge", "-y", "spherecal-3d"), False),
    ):
        began = time.monotonic()
        good &= say(name, inside(root, *command), began)
        began = time.monotonic()
        done = inside(root, "spherecal", "report", "/tmp/try/r", "-o", "/tmp/try/r.html", user=True)
        good &= say("spherecal report", done, began)
        page = root / "tmp" / "try" / "r.html"
        as_it_should = page.is_file() and ("data:image/png" in page.read_text(encoding="utf-8")) == rendered
        print(f"{'ok ' if as_it_should else 'BAD'} its scene is {'rendered' if rendered else 'drawn'}")
        good &= as_it_should
    return good


def main() -> int:
    """Install, try, report; 1 where anything failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path)
    parser.add_argument("--deb", type=Path, default=next(iter(sorted((ROOT / "dist").glob("spherecal_*.deb"))), None))
    parser.add_argument("--scene-deb", type=Path, default=next(iter((ROOT / "dist").glob("spherecal-3d_*.deb")), None))
    parser.add_argument("--mirror", default="")
    options = parser.parse_args()
    if options.deb is None:
        print("There is no .deb in dist; run python3 dev.py installer first.", file=sys.stderr)
        return 2
    root = options.root.resolve()
    make_root(root, options.mirror)
    good = inside(root, "python3", "--version").returncode != 0
    print(f"{'ok ' if good else 'BAD'} no Python in there")
    inside(root, "apt-get", "update")
    shutil.copy(options.deb, root / "tmp" / "spherecal.deb")
    began = time.monotonic()
    install = ["apt-get", "install", "-y", "--no-install-recommends", "/tmp/spherecal.deb"]
    if not say("installed, libraries of the system included", inside(root, *install), began):
        return 1
    began = time.monotonic()
    good &= say("package alone, installed again", inside(root, "dpkg", "-i", "/tmp/spherecal.deb"), began)
    size = sum(p.lstat().st_size for p in (root / "opt/spherecal").rglob("*") if not p.is_symlink() and p.is_file())
    print(f"    package {options.deb.stat().st_size / 1e6:.0f} MB, unpacked {size / 1e6:.0f} MB")
    inside(root, "rm", "-rf", "/tmp/try")
    for line in (
        "--version",
        "doctor",
        "simulate demo --observations-only -o /tmp/try/s",
        "calibrate /tmp/try/s -o /tmp/try/r",
        "verify /tmp/try/s --rig /tmp/try/r/rig.json -o /tmp/try/r",
        "report /tmp/try/r -o /tmp/try/r.pdf",
        "demo -o /tmp/try/demo",
        "manual --language de",
        "licences --sbom /tmp/try/sbom.json",
    ):
        began = time.monotonic()
        done = inside(root, "spherecal", *line.split(), user=True)
        good &= say(f"spherecal {line.split()[0]}", done, began)
        if line == "doctor":
            print(done.stdout)
            good &= "missing" not in done.stdout
            (ROOT / "build").mkdir(exist_ok=True)
            (ROOT / "build" / "doctor.txt").write_text(done.stdout, encoding="utf-8")
    if os.uname().machine == "x86_64":
        began, line = time.monotonic(), "calibrate /tmp/try/s -o /tmp/try/old"
        done = inside(root, "spherecal", *line.split(), user=True, processor="x86-64")
        good &= say("spherecal calibrate with the kernels for old processors", done, began)
    good &= time_to_window(root)
    if shutil.which("Xvfb") and shutil.which("xdotool"):
        print("    whole walk in the window:")
        shutil.rmtree(root / "tmp" / "walk", ignore_errors=True)
        print(f"ok  whole walk: {walk(['/usr/bin/spherecal-gui'], root / 'tmp' / 'walk', root).seconds:.0f} s")
    else:
        print("    whole walk in the window: not tried (no Xvfb, xdotool)")
    if options.scene_deb is not None:
        good &= scene_package(root, options.scene_deb)
    began = time.monotonic()
    good &= say("removed", inside(root, "apt-get", "purge", "-y", "spherecal"), began)
    left = (root / "opt/spherecal").exists() or (root / "usr/bin/spherecal").exists()
    print("BAD files were left behind" if left else "ok  nothing is left behind")
    return 0 if good and not left else 1


if __name__ == "__main__":
    sys.exit(main())
