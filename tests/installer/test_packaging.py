"""Wheel, sdist and what the installers are made of; the .deb itself is tried by installer/try_deb.py."""

import configparser
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import ROOT

import spherecal
from installer.debian import make_scene_deb
from installer.scene_part import take_apart
from spherecal_app.cli.documents_command import manual_page
from spherecal_documents.support.licences import bill_of_materials, licence_text, parts

BIN = "Scripts" if os.name == "nt" else "bin"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel and the sdist of this tree."""
    folder = tmp_path_factory.mktemp("dist")
    command = [Path(sys.executable).parent / "hatchling", "build", "-t", "wheel", "-t", "sdist", "-d", folder]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return folder


def test_the_wheel_holds_the_program_and_its_files(built: Path) -> None:
    with zipfile.ZipFile(next(built.glob("*.whl"))) as wheel:
        names = set(wheel.namelist())
        entries = wheel.read(next(n for n in names if n.endswith("entry_points.txt"))).decode()
        metadata = wheel.read(next(n for n in names if n.endswith("METADATA"))).decode()
    resources = {
        "spherecal/_resources/" + str(path.relative_to(ROOT / "resources").as_posix())
        for path in (ROOT / "resources").rglob("*")
        if path.is_file() and path.suffix != ".ts"
    }
    assert resources <= names
    assert not [n for n in names if n.endswith((".ts", ".map"))]
    assert {"spherecal/py.typed", "spherecal/__init__.pyi", "spherecal_gui/app.py"} <= names
    assert {
        f"spherecal_gentl/producer/{n}"
        for n in ("device.xml", "region.h", "spherecal_gentl.cpp", "spherecal_aravis.cpp", "gvcp.h", "gvsp_filter.h")
    } <= names
    assert "spherecal_gentl/gige/fake_camera.cpp" in names
    assert not [n for n in names if n.endswith((".nbi", ".nbc", ".pyc")) or n.startswith(("tests", "docs"))]
    scripts = configparser.ConfigParser()
    scripts.read_string(entries)
    assert scripts["console_scripts"]["spherecal"] == "spherecal_app.cli.main:entry"
    assert scripts["gui_scripts"]["spherecal-gui"] == "spherecal_gui.__main__:main"
    for extra in ("gui", "cameras"):
        assert f"Provides-Extra: {extra}" in metadata


def test_the_sdist_builds_a_wheel_with_the_same_files(built: Path, tmp_path: Path) -> None:
    with tarfile.open(next(built.glob("*.tar.gz"))) as sdist:
        sdist.extractall(tmp_path, filter="data")
    source = next(tmp_path.iterdir())
    read_by_tests = ("SECURITY.md", "CODE_OF_CONDUCT.md", ".ci/run", ".github/workflows/release.yml")
    assert [name for name in read_by_tests if not (source / name).is_file()] == []
    command = [Path(sys.executable).parent / "hatchling", "build", "-t", "wheel", "-d", tmp_path / "again"]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    again = zipfile.ZipFile(next((tmp_path / "again").glob("*.whl")))
    first = zipfile.ZipFile(next(built.glob("*.whl")))
    # names only: while people work on the tree, a file may change between the two builds
    assert set(again.namelist()) == set(first.namelist())


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="takes POSIX paths")
def test_the_engine_alone_in_a_fresh_environment(built: Path, tmp_path: Path) -> None:
    """The wheel with nothing but the engine's requirements: no Qt, no pyvista, no camera drivers, no matplotlib.

    The packages are those installed here (a .pth leads to copies by link), since a test may not need a network; which
    ones is what the wheel itself says.
    """
    home = tmp_path / "fresh"
    venv.create(home, symlinks=True, with_pip=False)
    site = next((home / "lib").glob("python*")) / "site-packages"
    with zipfile.ZipFile(next(built.glob("*.whl"))) as wheel:
        wheel.extractall(site)
    take_kernels_along(site)
    for name in [one.name for one in parts(()) if one.name != "Python"]:
        link_distribution(name, site)
    program = home / BIN / "spherecal"
    program.write_text(
        f"#!{home / BIN / 'python'}\nimport sys\nfrom spherecal_app.cli.main import main\nsys.exit(main())\n"
    )
    program.chmod(0o755)
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}

    def run(*command: object) -> str:
        done = subprocess.run(
            [str(word) for word in command], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert run(program, "--version").strip() == f"spherecal {spherecal.__version__}"
    # a process takes a second to load the engine: the other commands in one
    said = json.loads(run(home / BIN / "python", "-c", ALL_COMMANDS).splitlines()[-1])
    assert [code for code, _ in said] == [0, 0, 0, 0, 0, 2]
    assert "install spherecal[gui]" in said[0][1]
    assert said[3][1].startswith("VALID")
    assert said[4][1].startswith("CONSISTENT")
    assert "needs matplotlib" in said[5][1]


# The exit code and the words of each command, as JSON in the last line.
ALL_COMMANDS = """
import contextlib, io, json
from spherecal_app.cli.main import main
said = []
for line in ("doctor", "simulate demo --observations-only -o s", "targets export -o targets.json",
             "calibrate s -o r", "verify s --rig r/rig.json -o r", "report r -o r.pdf"):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = main(line.split())
    said.append((code, err.getvalue() if code else out.getvalue()))
print(json.dumps(said))
"""


def take_kernels_along(site: Path) -> None:
    """Kernels that were compiled for this tree, for the same files of the wheel: not compiled once more."""
    for source in (ROOT / "core").rglob("*.py"):
        copy = site / source.relative_to(ROOT / "core")
        if copy.is_file() and copy.read_bytes() == source.read_bytes():
            shutil.copystat(source, copy)  # numba knows a file by its time and size
            for kernel in source.parent.glob(f"__pycache__/{source.stem}.*.nb?"):
                (copy.parent / "__pycache__").mkdir(exist_ok=True)
                shutil.copy(kernel, copy.parent / "__pycache__")


def link_distribution(name: str, site: Path) -> None:
    """Links to all top-level files of an installed distribution."""
    from importlib.metadata import distribution

    one = distribution(name)
    tops = {
        Path(str(file)).parts[0] for file in one.files or () if Path(str(file)).parts[0] not in ("..", "__pycache__")
    }
    for top in tops:
        source = Path(str(one.locate_file(top)))
        if source.exists() and not (site / top).exists():
            (site / top).symlink_to(source)


def test_the_manual_has_what_a_user_reads_and_no_more(tmp_path: Path) -> None:
    """Made as `dev.py docs` makes it: the pages of its contents, the pictures in them, every link followed."""
    zensical = Path(sys.executable).parent / "zensical"
    if not zensical.is_file():
        pytest.skip("no zensical here (group docs)")
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    shutil.copy(ROOT / "mkdocs.yml", tmp_path)
    site = tmp_path / "build" / "site"
    scripts = ([ROOT / "docs" / name, site] for name in ("make_offline.py", "check_links.py"))
    for command in ([zensical, "build", "--strict"], *([sys.executable, *script] for script in scripts)):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    files = {path.relative_to(site).as_posix() for path in site.rglob("*") if path.is_file()}
    contents = re.findall(r": (\S+)\.md$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert {name for name in files if name.endswith(".html")} == {f"{page}.html" for page in contents}
    assert not {page.split("/")[0] for page in contents} & {"developers", "design", "decisions", "command-line"}
    text = "".join((site / name).read_text(encoding="utf-8") for name in files if name.endswith(".html"))
    assert not [name for name in files if name.endswith(".png") and "pictures" in name and Path(name).name not in text]
    assert not [name for name in files if name.endswith((".map", ".pdf", ".xml", ".gz", "search.json"))]


# --- licences --------------------------------------------------------------------------------------------------------


def test_every_part_has_a_licence_and_the_libraries_qt_is_under_have_theirs() -> None:
    known = {part.name.lower().replace("_", "-"): part for part in parts()}
    assert {"python", "numpy", "scipy", "numba", "llvmlite", "opencv-python-headless"} <= set(known)
    assert known["numpy"].version == version("numpy")
    assert not [part.name for part in known.values() if not part.licence]
    assert "pytest" not in known and "ruff" not in known
    without_text = [part.name for part in known.values() if not part.texts]
    assert {name.lower() for name in without_text} <= {"pyside6_essentials", "shiboken6", "python", "scooby"}
    text = licence_text()
    if "pyside6-essentials" in known:
        assert "GNU LESSER GENERAL PUBLIC LICENSE" in text and "GNU GENERAL PUBLIC LICENSE" in text
        assert "replace them by your own builds" in text
    for part in known.values():
        assert f"  {part.name} {part.version}: " in text


def test_bill_of_materials() -> None:
    document = json.loads(bill_of_materials())
    assert (document["bomFormat"], document["specVersion"]) == ("CycloneDX", "1.5")
    assert re.fullmatch(r"urn:uuid:[0-9a-f-]{36}", document["serialNumber"])
    references = [component["bom-ref"] for component in document["components"]]
    assert len(references) == len(set(references)) == len(parts())
    assert f"pkg:pypi/numpy@{version('numpy')}" in references
    by_reference = {entry["ref"]: entry["dependsOn"] for entry in document["dependencies"]}
    assert f"pkg:pypi/llvmlite@{version('llvmlite')}" in by_reference[f"pkg:pypi/numba@{version('numba')}"]
    assert set().union(*by_reference.values()) <= set(references)
    for component in document["components"]:
        for licence in component["licenses"]:
            assert "expression" in licence or licence["license"].keys() <= {"id", "name"}
    assert bill_of_materials() == bill_of_materials()


def test_the_engine_alone_has_fewer_parts() -> None:
    names = {one.name.lower() for one in parts(())}
    assert "numpy" in names and "pyside6-essentials" not in names


def test_the_manual_is_found_in_each_language_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from spherecal.base import resources

    monkeypatch.setattr(resources, "_IN_WHEEL", tmp_path)
    monkeypatch.setattr(resources, "_IN_SOURCE_TREE", tmp_path / "tree" / "resources")
    assert manual_page() is None
    for page in ("index.html", "guide/de/index.html", "guide/zh/index.html"):
        (tmp_path / "manual" / page).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "manual" / page).touch()
    pages = [manual_page(language) for language in ("en", "de", "zh")]
    assert len(set(pages)) == 3 and None not in pages


# --- what the installers are made of ---------------------------------------------------------------------------------


def test_menu_entry_and_file_types() -> None:
    folder = ROOT / "installer" / "linux"
    entry = configparser.ConfigParser(interpolation=None, delimiters=("=",))
    entry.optionxform = str  # type: ignore[assignment,method-assign]
    entry.read(folder / "org.spherecal.SphereCal.desktop", encoding="utf-8")
    desktop = entry["Desktop Entry"]
    assert desktop["Exec"] == "spherecal-gui %f" and desktop["Icon"] == "spherecal"
    space = "{http://www.freedesktop.org/standards/shared-mime-info}"
    types = ElementTree.parse(folder / "spherecal-mime.xml").getroot().findall(f"{space}mime-type")
    named = {one.attrib["type"]: one for one in types}
    assert set(desktop["MimeType"].strip(";").split(";")) <= set(named)
    formats = {match.attrib["value"] for one in types for match in one.iter(f"{space}match")}
    written = "".join(p.read_text(encoding="utf-8") for p in ROOT.glob("core/**/*.py"))
    written += (ROOT / "spherecal_gui" / "project_folder.py").read_text(encoding="utf-8")
    assert all(f'"{name}"' in written for name in formats)
    ElementTree.parse(folder / "org.spherecal.SphereCal.metainfo.xml")


@pytest.mark.parametrize("name", ["enable.sh", "disable.sh"])
def test_camera_settings_are_opt_in_and_valid_shell(name: str) -> None:
    script = ROOT / "installer" / "linux" / "cameras" / name
    if shutil.which("sh"):
        subprocess.run(["sh", "-n", str(script)], check=True)
    packing = (ROOT / "installer" / "debian.py").read_text(encoding="utf-8")
    assert 'share / "spherecal/cameras"' in packing and "postinst" not in packing


def test_double_clicked_files_open(tmp_path: Path) -> None:
    sys.path.insert(0, str(ROOT / "installer"))
    try:
        from entry import opened
    finally:
        sys.path.pop(0)
    session, project = tmp_path / "session.json", tmp_path / "wizard.json"
    session.write_text('{"format": "spherecal/session", "version": 1}', encoding="utf-8")
    project.write_text('{"format": "spherecal/wizard", "version": 1}', encoding="utf-8")
    assert opened([str(session)]) == ["--source", f"replay:{tmp_path}"]
    assert opened([str(project)]) == ["--open", str(tmp_path)]
    assert opened(["--projects", "x"]) == ["--projects", "x"]
    assert opened([]) == []


def test_doctor_in_the_bundle_finds_everything(tmp_path: Path) -> None:
    """The finished program, with nothing of this machine's Python around it; `dev.py installer` makes it."""
    named = os.environ.get("SPHERECAL_BUNDLE")
    program = Path(named or ROOT / "dist" / "spherecal") / ("spherecal.exe" if os.name == "nt" else "spherecal")
    if not program.is_file():
        pytest.skip(
            f"no bundle at {program.parent}: run python3 dev.py installer, or set SPHERECAL_BUNDLE to its folder"
        )
    environment = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"} if os.name != "nt" else dict(os.environ)
    done = subprocess.run(
        [program, "doctor"], env=environment, capture_output=True, text=True, check=False, timeout=200
    )
    assert done.returncode == 0, done.stderr
    assert "missing" not in done.stdout
    assert f"SphereCal        {spherecal.__version__}" in done.stdout
    if sys.platform.startswith("linux"):
        assert "compiled ahead for" in done.stdout
        size = sum(p.lstat().st_size for p in program.parent.rglob("*") if p.is_file() and not p.is_symlink())
        assert size <= 400e6, f"{size / 1e6:.0f} MB"


def test_stand_ins_have_the_names_of_what_they_stand_for(tmp_path: Path) -> None:
    """A program that links to a library with versioned symbols starts with the stand-in, which aborts when called."""
    if not all(shutil.which(name) for name in ("gcc", "nm", "readelf")):
        pytest.skip("needs gcc and binutils")
    sys.path.insert(0, str(ROOT / "installer"))
    try:
        import slim
    finally:
        sys.path.pop(0)
    code, script = tmp_path / "big.c", tmp_path / "big.map"
    code.write_text("int used(void) { return 7; } int other(void) { return 8; }\n")
    script.write_text("BIG_1 { global: used; other; };\n")
    library, program = tmp_path / "libbig.so", tmp_path / "program"
    link = [
        "gcc",
        "-shared",
        "-fPIC",
        str(code),
        "-o",
        str(library),
        f"-Wl,--version-script,{script}",
        "-Wl,-soname,libbig.so",
    ]
    subprocess.run(link, check=True)
    (tmp_path / "main.c").write_text("int used(void); int main(int n, char **a) { return n > 1 ? used() : 0; }\n")
    subprocess.run(
        ["gcc", str(tmp_path / "main.c"), str(library), "-o", str(program), f"-Wl,-rpath,{tmp_path}"], check=True
    )
    needed = slim.undefined(program)
    assert needed["used"] == "BIG_1"
    slim.compile_stand_in(library, "void abort(void); void used(void) { abort(); }\n", {"used": "BIG_1"})
    assert "other" not in slim.defined(library)
    assert subprocess.run([str(program)], check=False).returncode == 0
    assert subprocess.run([str(program), "x"], check=False, capture_output=True).returncode == -6


@pytest.mark.skipif(shutil.which("makensis") is None, reason="no makensis here (apt install nsis)")
def test_the_set_up_program_for_windows_compiles(tmp_path: Path) -> None:
    bundle = tmp_path / "bundle" / "_internal"
    bundle.mkdir(parents=True)
    for name in ("spherecal.exe", "spherecal-gui.exe", "_internal/x.dll"):
        (tmp_path / "bundle" / name).write_bytes(b"MZ")
    copy = Path(shutil.copytree(ROOT / "installer", tmp_path / "tree" / "installer"))
    shutil.copy(ROOT / "LICENSE", tmp_path / "tree")
    (tmp_path / "tree" / "dist").mkdir()
    command = ["makensis", "-V2", f"-DBUNDLE={tmp_path / 'bundle'}", "spherecal.nsi"]
    text = (copy / "windows" / "spherecal.nsi").read_text(encoding="utf-8").replace("${BUNDLE}\\*.*", "${BUNDLE}/*.*")
    (copy / "windows" / "spherecal.nsi").write_text(text.replace("..\\..\\", "../../"), encoding="utf-8")
    done = subprocess.run(command, cwd=copy / "windows", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert next((tmp_path / "tree" / "dist").glob("*.exe")).read_bytes()[:2] == b"MZ"


def test_documents_say_plainly_what_was_never_run() -> None:
    for page in ("docs/install.md", "docs/environments.md", "installer/windows/README.md", "installer/macos/README.md"):
        assert re.search("never run (there )?by us", (ROOT / page).read_text(encoding="utf-8"), re.IGNORECASE), page


def bundle_with_vtk(folder: Path) -> Path:
    for name in ("pyvista/core.py", "vtkmodules/vtkCommonCore.so", "numpy/core.py", "vtk-9.5.dist-info/LICENSE"):
        (folder / "_internal" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "_internal" / name).write_text(name)
    return folder


def test_pyvista_and_vtk_are_taken_out_of_a_bundle(tmp_path: Path) -> None:
    bundle, scene = bundle_with_vtk(tmp_path / "bundle"), tmp_path / "scene"
    take_apart(bundle, scene)
    assert [path.name for path in (bundle / "_internal").iterdir()] == ["numpy"]
    assert sorted(path.name for path in (scene / "_internal").iterdir()) == [
        "pyvista",
        "vtk-9.5.dist-info",
        "vtkmodules",
    ]
    with pytest.raises(FileNotFoundError):
        take_apart(bundle, scene)


@pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="no dpkg here")
def test_the_3d_view_is_a_package_beside_the_program(tmp_path: Path) -> None:
    scene = tmp_path / "scene"
    take_apart(bundle_with_vtk(tmp_path / "bundle"), scene)
    package = make_scene_deb(scene, tmp_path / "dist", level=1)
    control = subprocess.run(["dpkg-deb", "-f", package], check=True, capture_output=True, text=True).stdout
    assert "Package: spherecal-3d" in control and f"Depends: spherecal (= {spherecal.__version__})" in control
    subprocess.run(["dpkg-deb", "-x", package, tmp_path / "root"], check=True)
    assert (tmp_path / "root/opt/spherecal/_internal/pyvista/core.py").is_file()
    assert "LICENSE" in (tmp_path / "root/usr/share/doc/spherecal-3d/copyright").read_text()
