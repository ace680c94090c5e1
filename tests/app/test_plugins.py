"""Formats and camera sources of other packages: the example packages as pip installs them, and broken ones."""

import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import ROOT

import spherecal
from spherecal.base.errors import InputError
from spherecal_app.cli.main import main
from spherecal_cameras.protocol import CameraSource, CaptureRequest
from spherecal_cameras.sources import open_source
from tests.export_rigs import make_rig

EXAMPLES = ("exporter_package", "importer_package", "camera_source_package")


def install(site: Path, name: str, module: str, source: str, groups: dict[str, dict[str, str]]) -> None:
    """What pip leaves of a package of one module."""
    (site / f"{module}.py").write_text(source, encoding="utf-8")
    info = site / f"{name.replace('-', '_')}-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1\n")
    lines = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in points.items()) for group, points in groups.items()]
    (info / "entry_points.txt").write_text("\n".join(lines))


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    site = tmp_path / "site"
    site.mkdir()
    monkeypatch.syspath_prepend(site)
    yield site
    for path in site.glob("*.py"):
        sys.modules.pop(path.stem, None)


@pytest.fixture
def installed(site: Path) -> Path:
    for folder in EXAMPLES:
        project = tomllib.loads((ROOT / "examples" / folder / "pyproject.toml").read_text())
        (module,) = (ROOT / "examples" / folder).glob("*.py")
        assert project["tool"]["hatch"]["build"]["targets"]["wheel"]["include"] == [module.name]
        source = module.read_text(encoding="utf-8")
        install(site, project["project"]["name"], module.stem, source, project["project"]["entry-points"])
    return site


def test_an_installed_exporter_is_a_format_like_ours(installed: Path, tmp_path: Path, capsys) -> None:
    rig = make_rig(4, 3)
    done = spherecal.export_rig(rig, "transforms", tmp_path / "transforms.json")
    assert done.largest_difference_px < 1e-6
    frames = json.loads((tmp_path / "transforms.json").read_text())["frames"]
    for frame, camera in zip(frames, rig, strict=True):
        matrix = np.array(frame["transform_matrix"])
        np.testing.assert_allclose(1000 * matrix[:3, 3], camera.centre_mm, atol=1e-9)
        np.testing.assert_allclose(-matrix[:3, 2], camera.rotation[2], atol=1e-12)
    read = spherecal.import_rig(tmp_path / "transforms.json", "transforms")
    assert [camera.id for camera in read] == [camera.id for camera in rig]
    spherecal.save_rig(rig, tmp_path / "rig.json")
    assert main(["export", str(tmp_path / "rig.json"), "--to", "nothing", "-o", str(tmp_path / "x")]) == 2
    assert "transforms" in capsys.readouterr().err


def test_an_installed_importer_reads(installed: Path, tmp_path: Path) -> None:
    rig = make_rig(4, 4)
    lines = []
    for camera in rig:
        P = camera.P * np.random.default_rng(1).uniform(-3, 3)  # of any scale and sign
        lines.append(" ".join([camera.id, *map(str, camera.image_size), *map(repr, P.ravel().tolist())]))
    (tmp_path / "cameras.txt").write_text("\n".join(lines))
    line = ["import", str(tmp_path / "cameras.txt"), "--format", "projections", "-o", str(tmp_path / "rig.json")]
    assert main(line) == 0
    for ours, theirs in zip(spherecal.load_rig(tmp_path / "rig.json"), rig, strict=True):
        np.testing.assert_allclose(ours.centre_mm, theirs.centre_mm, atol=1e-6)
        np.testing.assert_allclose(ours.rotation, theirs.rotation, atol=1e-9)
        np.testing.assert_allclose(ours.K, theirs.K, atol=1e-6)


def test_an_installed_camera_source_takes_sets(installed: Path, tmp_path: Path, capsys) -> None:
    images = np.random.default_rng(1).integers(0, 255, (2, 90, 120), np.uint8)
    (tmp_path / "pictures").mkdir()
    for name, image in zip(("left", "right"), images, strict=True):
        cv2.imwrite(str(tmp_path / "pictures" / f"{name}.png"), image)
    with open_source(f"pictures:{tmp_path / 'pictures'}") as source:
        assert isinstance(source, CameraSource)
        serials = source.discover().serials
        source.open(serials, {})
        taken = source.capture_set(CaptureRequest())
        assert taken.complete and np.array_equal(taken.frames["right"].image, images[1])
    assert main(["cameras", "list", "--source", f"pictures:{tmp_path / 'pictures'}"]) == 0
    assert "left" in capsys.readouterr().out
    with pytest.raises(InputError, match="holds no PNG files"):
        open_source(f"pictures:{tmp_path}")
    with pytest.raises(InputError, match="no camera source") as refused:
        open_source("drawings")
    assert "installed: pictures" in refused.value.hint


def test_broken_packages_are_named_and_hurt_nobody(site: Path, tmp_path: Path) -> None:
    install(
        site, "bad-one", "bad_one", "raise RuntimeError('gone wrong')", {"spherecal.exporters": {"bad": "bad_one:X"}}
    )
    install(site, "bad-two", "bad_two", "X = 3", {"spherecal.exporters": {"three": "bad_two:X", "csv": "bad_two:X"}})
    install(site, "bad-three", "bad_three", "X = 3", {"spherecal.exporters": {"three": "bad_three:X"}})
    install(site, "bad-four", "bad_four", "X = 3", {"spherecal.importers": {"four": "bad_four:X"}})
    install(site, "bad-five", "bad_five", "X = str", {"spherecal.camera_sources": {"five": "bad_five:X"}})
    rig = make_rig(4, 2)
    for name, said in (
        ("bad", r'"bad" of bad-one cannot be loaded \(RuntimeError: gone wrong\)'),
        ("three", '"three" is given by several packages: bad-three, bad-two'),
    ):
        with pytest.raises(InputError, match=said):
            spherecal.export_rig(rig, name, tmp_path / "x")
    (tmp_path / "x").touch()
    with pytest.raises(InputError, match='"four" of bad-four is not an importer'):
        spherecal.import_rig(tmp_path / "x", "four")
    with pytest.raises(InputError, match="lacks functions of the protocol"):
        open_source("five:x")
    assert spherecal.export_rig(rig, "csv", tmp_path / "y").format is spherecal.FORMATS["csv"], "ours goes first"


def test_the_page_shows_what_the_packages_say() -> None:
    page = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
    for folder in EXAMPLES:
        assert f"examples/{folder}" in page
    for group in ("exporters", "importers", "camera_sources"):
        assert re.search(rf'project\.entry-points\."spherecal\.{group}"', page)
