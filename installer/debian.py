"""Makes the .deb of a finished bundle: dist/spherecal_VERSION_ARCHITECTURE.deb."""

import gzip
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

import spherecal
from spherecal.base.errors import InputError
from spherecal_gentl.producer.build_producer import build_producer

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
HOME = Path("opt/spherecal")
METAINFO = HERE / "linux/org.spherecal.SphereCal.metainfo.xml"
SCREENSHOTS = (
    ("results.png", "Result of a calibration"),
    ("placement.png", "A placement of the ball, with every camera's live image"),
    ("verify.png", "Verification with a reference bar"),
)

# What Qt and OpenCV link to and a desktop has anyhow; names as in Debian 12 and, after the bar, in Ubuntu 24.04.
DEPENDS = (
    "libc6 (>= 2.34)", "libstdc++6", "zlib1g", "libgl1", "libegl1", "libglib2.0-0 | libglib2.0-0t64", "libfontconfig1",
    "libfreetype6", "libdbus-1-3", "libxkbcommon0", "libxkbcommon-x11-0", "libx11-6", "libx11-xcb1", "libxcb1",
    "libxcb-cursor0", "libxcb-icccm4", "libxcb-image0", "libxcb-keysyms1", "libxcb-randr0", "libxcb-render-util0",
    "libxcb-shape0", "libxcb-sync1", "libxcb-xfixes0", "libxcb-xkb1", "libxcb-glx0", "libwayland-client0",
    "libwayland-cursor0", "libwayland-egl1", "fontconfig", "fonts-dejavu-core",
)  # fmt: skip
# libaravis: for the producer of cameras without their maker's driver, which is found and linked at run time only
RECOMMENDS = ("libaravis-0.8-0", "fonts-noto-cjk", "shared-mime-info", "desktop-file-utils", "xdg-utils")


def make_deb(bundle: Path, output: Path, level: int = 15) -> Path:
    """Pack the bundle with menu entry, icon, file types, licences and the opt-in camera settings.

    `level` is zstd's, 1 to 22; dpkg reads zstd since Debian 12 and Ubuntu 18.04.
    """
    with tempfile.TemporaryDirectory(dir=made(output)) as scratch:
        tree = put_home(Path(scratch), bundle)
        (tree / "usr/bin").mkdir(parents=True)
        for name in ("spherecal", "spherecal-gui"):
            (tree / "usr/bin" / name).symlink_to(f"/{HOME}/{name}")
        put_producer(tree / HOME / "cti")
        put_shared_files(tree, bundle)
        fields = {
            "Depends": ", ".join(DEPENDS),
            "Recommends": ", ".join(RECOMMENDS),
            "Suggests": "spherecal-3d",
            "Description": "calibration of multi-camera measuring rigs with an imperfect ball\n"
            " Finds position, orientation and lens of every camera of a rig from pictures of\n"
            " a ball with coded targets, with uncertainties, and verifies the rig with\n"
            " reference bars. Nothing is sent anywhere; the program needs no network.",
        }
        return pack(tree, "spherecal", fields, output, level)


def make_scene_deb(scene: Path, output: Path, level: int = 15) -> Path:
    """Pack what scene_part.py took out of the bundle; it is of use only beside the package of the same version."""
    with tempfile.TemporaryDirectory(dir=made(output)) as scratch:
        tree = put_home(Path(scratch), scene)
        documents = tree / "usr/share/doc/spherecal-3d"
        documents.mkdir(parents=True)
        licences = sorted(path for path in scene.rglob("*.dist-info/**/*") if path.name.lower().startswith("licen"))
        texts = (
            f"{path.relative_to(scene)}\n\n{path.read_text(encoding='utf-8')}" for path in licences if path.is_file()
        )
        (documents / "copyright").write_text("\n\n".join(texts), encoding="utf-8")
        fields = {
            "Depends": f"spherecal (= {spherecal.__version__})",
            "Description": "rendered 3-D view for SphereCal\n"
            " pyvista and VTK: the rig in the window and in reports is rendered with light,\n"
            " images and surfaces. Without this package SphereCal paints it with lines.",
        }
        return pack(tree, "spherecal-3d", fields, output, level)


def made(folder: Path) -> Path:
    """The folder, made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def put_home(tree: Path, bundle: Path) -> Path:
    """The tree with the bundle at its place."""
    tree.chmod(0o755)
    (tree / HOME).parent.mkdir(parents=True)
    shutil.copytree(bundle, tree / HOME, symlinks=True)
    return tree


def pack(tree: Path, name: str, fields: Mapping[str, str], output: Path, level: int) -> Path:
    """The package of a tree, with `fields` in its control file."""
    architecture = subprocess.run(
        ["dpkg", "--print-architecture"], capture_output=True, text=True, check=True
    ).stdout.strip()
    put_control(tree, name, architecture, fields)
    package = output / f"{name}_{spherecal.__version__}_{architecture}.deb"
    command = ["dpkg-deb", "--root-owner-group", "-Zzstd", f"-z{level}", "--build", str(tree), str(package)]
    subprocess.run(command, check=True)
    return package


def put_producer(folder: Path) -> None:
    """The producer for GigE Vision and USB3 Vision cameras, where the machine that packs has libaravis-dev."""
    try:
        build_producer(folder, aravis=True)
    except InputError as error:
        print(f"Packed without the producer for cameras without a driver: {error}")


def metainfo(environment: Mapping[str, str]) -> str:
    """The AppStream description; with addresses and screenshots if the repository's workflow packs it."""
    text = METAINFO.read_text(encoding="utf-8")
    server, name = environment.get("GITHUB_SERVER_URL"), environment.get("GITHUB_REPOSITORY")
    if not server or not name:
        return text
    home = f"{server}/{name}"
    pictures = f"{home}/raw/v{spherecal.__version__}/docs/guide/pictures"
    shots = "".join(
        f"    <screenshot{kind}><caption>{caption}</caption>"
        f'<image type="source" width="1280" height="800">{pictures}/{file}</image></screenshot>\n'
        for (file, caption), kind in zip(SCREENSHOTS, (' type="default"', "", ""), strict=True)
    )
    made = (
        f'  <url type="homepage">{home}</url>\n  <url type="bugtracker">{home}/issues</url>\n'
        f"  <screenshots>\n{shots}  </screenshots>\n"
    )
    return text.replace("  <releases>\n", f"{made}  <releases>\n")


def put_shared_files(tree: Path, bundle: Path) -> None:
    """What the desktop looks for; licences and bill of materials as the bundle itself tells them."""
    share = tree / "usr/share"
    described = share / "metainfo" / METAINFO.name
    described.parent.mkdir(parents=True)
    described.write_text(metainfo(os.environ), encoding="utf-8", newline="\n")
    files = {
        HERE / "linux/org.spherecal.SphereCal.desktop": "applications",
        ROOT / "resources/icons/spherecal.svg": "icons/hicolor/scalable/apps",
    }
    for source, folder in files.items():
        copy(source, share / folder / source.name)
    copy(HERE / "linux/spherecal-mime.xml", share / "mime/packages/spherecal.xml")
    for source in sorted((HERE / "linux/cameras").iterdir()):
        copy(source, share / "spherecal/cameras" / source.name)
    documents = share / "doc/spherecal"
    documents.mkdir(parents=True)
    lists = ["--texts", str(documents / "copyright"), "--sbom", str(documents / "sbom.cdx.json")]
    subprocess.run([str(bundle / "spherecal"), "licences", *lists], check=True, stdout=subprocess.DEVNULL)
    log = (ROOT / "CHANGELOG.md").read_bytes()
    (documents / "changelog.gz").write_bytes(gzip.compress(log, mtime=0))


def copy(source: Path, goal: Path) -> None:
    """Copy a file with rights that suit a package."""
    goal.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, goal)
    goal.chmod(0o755 if os.access(source, os.X_OK) else 0o644)


def put_control(tree: Path, name: str, architecture: str, fields: Mapping[str, str]) -> None:
    """DEBIAN/control and md5sums; no script runs at installation."""
    files = [path for path in sorted(tree.rglob("*")) if path.is_file() and not path.is_symlink()]
    kilobytes = sum(path.stat().st_size for path in files) // 1024
    lines = {
        "Package": name,
        "Version": spherecal.__version__,
        "Architecture": architecture,
        "Section": "science",
        "Priority": "optional",
        "Maintainer": "SphereCal authors <spherecal@localhost>",
        "Installed-Size": str(kilobytes),
        **fields,
    }
    control = tree / "DEBIAN"
    control.mkdir()
    (control / "control").write_text("".join(f"{k}: {v}\n" for k, v in lines.items()), encoding="utf-8")
    sums = (f"{hashlib.md5(path.read_bytes()).hexdigest()}  {path.relative_to(tree)}\n" for path in files)
    (control / "md5sums").write_text("".join(sums), encoding="utf-8")
