"""Scenes for 3-D programs, rigs of other programs as files of ours, and lenses fitted where the volume is."""

import json
import os
import re
import subprocess
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import spherecal
from spherecal.base.errors import InputError
from spherecal.geometry.camera import project, undistort
from spherecal_app.cli.main import main
from spherecal_documents.export.refit import refit
from spherecal_documents.export.scene_formats import SCENES
from tests.export_rigs import make_rig


def run(*words: object) -> int:
    return main([str(word) for word in words])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo rig's session and result."""
    folder = tmp_path_factory.mktemp("demo")
    session, _ = spherecal.simulate_session(
        "demo", 1, spherecal.SimulationOptions(targets=80), folder=folder / "session"
    )
    spherecal.save_calibration(spherecal.calibrate_session(session), folder / "result")
    return folder


# --- scenes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENES)
def test_scenes_have_the_cameras_where_they_are(folder: Path, tmp_path: Path, capsys, name: str) -> None:
    assert run("export", folder / "result", "--format", name, "-o", tmp_path / "scene") == 0
    said = capsys.readouterr().out
    assert re.match(rf"{name}: 6 cameras .* largest difference (\S+) px at the corners, read back", said), said
    rig = spherecal.load_rig(folder / "result")
    done = spherecal.export_rig(rig, name, tmp_path / "again")
    assert (tmp_path / "again").read_bytes() == (tmp_path / "scene").read_bytes()
    assert done.largest_difference_px < (1e-2 if name == "gltf" else 1e-6), "glTF has four bytes a number"
    with pytest.raises(InputError, match="is always in"):
        spherecal.export_rig(rig, name, tmp_path / "again", "mm" if done.unit == "m" else "m")
    (tmp_path / "again").write_text("{}")
    with pytest.raises(InputError, match=r"no .* of a rig"):
        SCENES[name].frusta(tmp_path / "again")


def test_a_camera_of_a_scene_in_a_wrong_place_is_noticed(tmp_path: Path, monkeypatch) -> None:
    rig = make_rig(5, 3)
    for name, form in SCENES.items():
        moved = replace(rig.cameras[1], translation_mm=rig.cameras[1].translation_mm + np.array([1.0, 0, 0]))
        other = replace(rig, cameras=(rig.cameras[0], moved, rig.cameras[2]))
        text = {}
        write = form.write

        def kept(file_rig, write=write, text=text):
            text["it"] = write(file_rig)
            return text["it"]

        monkeypatch.setitem(SCENES, name, replace(form, write=kept))
        spherecal.export_rig(other, name, tmp_path / "x")
        monkeypatch.setitem(SCENES, name, replace(form, write=lambda _, text=text: text["it"]))
        assert spherecal.export_rig(rig, name, tmp_path / "x").largest_difference_px > 0.5


@pytest.mark.parametrize("name", SCENES)
def test_frusta_that_point_backwards_or_nowhere_are_noticed(tmp_path: Path, monkeypatch, name: str) -> None:
    """A point behind a camera has the same image as one before it, and of NaN there was no largest error."""
    rig, form = make_rig(5, 3), SCENES[name]
    for spoil in (lambda f: 2 * f[:, :1] - f, lambda f: np.where(np.arange(5)[:, None] == 2, np.nan, f)):

        def spoilt(path, spoil=spoil):
            return spoil(form.frusta(path))

        monkeypatch.setitem(SCENES, name, replace(form, frusta=spoilt))
        assert spherecal.export_rig(rig, name, tmp_path / "x").largest_difference_px == np.inf


def test_gltf_looks_where_the_cameras_look(tmp_path: Path) -> None:
    """By the specification alone: nodes' matrices by columns, cameras along -z with y up, fields of view in radians."""
    rig = make_rig(4, 5)
    spherecal.export_rig(rig, "gltf", tmp_path / "rig.gltf")
    document = json.loads((tmp_path / "rig.gltf").read_text())
    nodes = [node for node in document["nodes"] if "camera" in node]
    turned = np.diag([1.0, -1, -1])  # the world with y up
    for node, camera in zip(nodes, rig.cameras, strict=True):
        matrix = np.array(node["matrix"]).reshape(4, 4).T
        assert node["name"] == document["cameras"][node["camera"]]["name"] == camera.id
        np.testing.assert_allclose(1000 * turned @ matrix[:3, 3], camera.centre_mm, atol=1e-6)
        np.testing.assert_allclose(turned @ -matrix[:3, 2], camera.rotation[2], atol=1e-12)
        np.testing.assert_allclose(turned @ matrix[:3, 1], -camera.rotation[1], atol=1e-12)
        lens = document["cameras"][node["camera"]]["perspective"]
        assert np.tan(lens["yfov"] / 2) == pytest.approx(camera.image_size[1] / 2 / camera.K[1, 1])
    sizes = [view["byteLength"] for view in document["bufferViews"]]
    assert sum(sizes) == document["buffers"][0]["byteLength"] == 5 * 5 * 12 + 5 * 16 * 4


class Objects(list):
    """A collection's objects: they are linked one by one."""

    def __init__(self, placed: list) -> None:
        super().__init__(placed)
        self.placed = placed

    def link(self, thing) -> None:
        self.append(thing)
        self.placed.append(thing)


def test_blender_cameras_project_as_ours_do(tmp_path: Path, monkeypatch) -> None:
    """The script runs, with Blender's module stood in for; its cameras project by the manual's formula."""
    rig = make_rig(4, 4)
    bare = tuple(replace(c, intrinsics=np.concatenate([c.intrinsics[[0, 0, 2, 3]], np.zeros(12)])) for c in rig.cameras)
    spherecal.export_rig(replace(rig, cameras=bare), "blender", tmp_path / "rig.py")

    class Things(dict):
        """Anything with attributes, made as they are asked for."""

        def __getattr__(self, name):
            return self.setdefault(name, Things())

        __setattr__ = dict.__setitem__

    placed, linked = [], []
    bpy = Things()
    bpy.context.scene.collection.children["link"] = linked.append
    bpy.data.collections["new"] = lambda name: types.SimpleNamespace(objects=Objects(placed))
    bpy.data.cameras["new"] = lambda name: Things(name=name)
    bpy.data.objects["new"] = lambda name, data: Things(name=name, data=data)
    module = types.ModuleType("bpy")
    module.__dict__.update(bpy)
    monkeypatch.setitem(sys.modules, "bpy", module)
    mathutils = types.ModuleType("mathutils")
    mathutils.__dict__["Matrix"] = np.array
    monkeypatch.setitem(sys.modules, "mathutils", mathutils)
    scope = {"__name__": "__main__"}
    exec(compile((tmp_path / "rig.py").read_text(), "rig.py", "exec"), scope)
    assert len(placed) == 4 and len(linked) == 1
    for thing, camera in zip(placed, bare, strict=True):
        point = camera.centre_mm + 1500 * camera.rotation[2] + 120 * camera.rotation[0] - 70 * camera.rotation[1]
        x, y, z = point / 1000
        local = np.linalg.inv(thing["matrix_world"]) @ (x, z, -y, 1)
        data, (w, h) = thing["data"], camera.image_size
        u = (0.5 + data["lens"] / data["sensor_width"] * local[0] / -local[2] - data["shift_x"]) * w - 0.5
        v = (0.5 * h / w - (data["lens"] / data["sensor_width"] * local[1] / -local[2] - data["shift_y"])) * w - 0.5
        np.testing.assert_allclose((u, v), camera.project(point), atol=1e-6)


def with_blender() -> str | None:
    """A Python that has Blender's module: this one, or one named in SPHERECAL_READERS."""
    named = filter(None, os.environ.get("SPHERECAL_READERS", "").split(os.pathsep))
    for python in (sys.executable, *named):
        if subprocess.run([python, "-c", "import bpy"], capture_output=True, check=False).returncode == 0:
            return python
    return None


@pytest.mark.parametrize(("kind", "name"), [("blender", "rig.py"), ("gltf", "rig.gltf"), ("ply", "rig.ply")])
def test_blender_itself_reads_them(tmp_path: Path, kind: str, name: str) -> None:
    """Centred principal points and square pixels, which glTF can hold; Blender computes in single precision."""
    python = with_blender()
    if python is None:
        pytest.skip("there is no Blender (pip install bpy)")
    rig = make_rig(4, 4)
    size = np.array(rig.cameras[0].image_size)
    middle = (size - 1) / 2
    bare = tuple(
        replace(c, intrinsics=np.concatenate([c.intrinsics[[0, 0]], middle, np.zeros(12)])) for c in rig.cameras
    )
    rig = replace(rig, cameras=bare)
    spherecal.export_rig(rig, kind, tmp_path / name)
    points = {c.id: c.centre_mm + 1500 * c.rotation[2] + 120 * c.rotation[0] - 70 * c.rotation[1] for c in bare}
    given = {
        key: {"size": size.tolist(), "point": [x / 1000, z / 1000, -y / 1000]} for key, (x, y, z) in points.items()
    }
    line = [python, ROOT / "tests" / "blender_reader.py", kind, tmp_path / name, json.dumps(given)]
    done = subprocess.run([str(word) for word in line], capture_output=True, text=True, check=True, timeout=300)
    found = json.loads(next(said[6:] for said in done.stdout.splitlines() if said.startswith("found ")))
    if kind == "ply":
        (vertices,) = (np.array(own) for own in found.values())
        for camera in bare:
            assert np.linalg.norm(vertices - camera.centre_mm, axis=1).min() < 1e-3
        return
    for camera in bare:
        u, v = found[camera.id][0] * size[0] - 0.5, (1 - found[camera.id][1]) * size[1] - 0.5
        np.testing.assert_allclose((u, v), camera.project(points[camera.id]), atol=2e-3)


# --- imports ---------------------------------------------------------------------------------------------------------


def test_an_imported_rig_is_verified_checked_compared_and_repaired(folder: Path, tmp_path: Path, capsys) -> None:
    result, session = folder / "result", folder / "session"
    assert run("export", result, "--to", "kalibr", "-o", tmp_path / "camchain.yaml", "--max-loss", "1") == 0
    ids = ",".join(camera.id for camera in spherecal.import_rig(tmp_path / "camchain.yaml", "kalibr"))
    rig = tmp_path / "rig.json"
    assert run("import", tmp_path / "camchain.yaml", "--format", "kalibr", "--ids", ids, "-o", rig) == 0
    said = capsys.readouterr().out
    assert f"6 cameras ({ids.replace(',', ', ')}) in" in said and "verify the rig with a bar" in said
    assert spherecal.load_rig(rig) == spherecal.import_rig(tmp_path / "camchain.yaml", "kalibr")
    assert run("verify", session, "--rig", rig, "-o", tmp_path / "verified") in (0, 3)
    assert "error" in capsys.readouterr().out
    assert run("check", session, "--profile", rig) in (0, 3)
    assert run("profile", "compare", result, rig) == 0
    again = tmp_path / "again"
    assert run("recalibrate", session, "--rig", rig, "--only", "C02", "--estimate", "pose", "-o", again) == 0
    assert len(spherecal.load_rig(again).cameras) == 6


def test_import_to_standard_output_and_into_a_folder(tmp_path: Path, capsysbinary) -> None:
    spherecal.export_rig(make_rig(4, 3), "opencv", tmp_path / "opencv")
    assert run("import", tmp_path / "opencv", "--format", "opencv", "-o", "-") == 0
    document = json.loads(capsysbinary.readouterr().out)
    assert [camera["id"] for camera in document["cameras"]] == ["C1", "C2", "C3"]
    assert run("import", tmp_path / "opencv", "--format", "opencv", "-o", tmp_path, "--json") == 0
    assert json.loads(capsysbinary.readouterr().out)["cameras"] == ["C1", "C2", "C3"]
    assert len(spherecal.load_rig(tmp_path).cameras) == 3


def test_an_import_into_a_folder_replaces_no_rig(tmp_path: Path, capsys) -> None:
    """A rig.json that was not named is kept."""
    spherecal.export_rig(make_rig(4, 3), "opencv", tmp_path / "opencv")
    (tmp_path / "rig.json").write_text("the user's")
    assert run("import", tmp_path / "opencv", "--format", "opencv", "-o", tmp_path) == 2
    assert "already has a rig.json" in capsys.readouterr().err
    assert (tmp_path / "rig.json").read_text() == "the user's"
    assert run("import", tmp_path / "opencv", "--format", "opencv", "-o", tmp_path / "rig.json") == 0


def test_what_cannot_be_imported(tmp_path: Path, capsys) -> None:
    for words, said in (
        (("none.yaml", "--format", "kalibr"), "no such file"),
        (("none.yaml", "--format", "gltf"), 'no format "gltf" to import'),
        (("none.yaml", "--format", "nonsense"), "Formats: opencv, ros"),
    ):
        assert run("import", *words, "-o", tmp_path / "rig.json") == 2
        assert said in capsys.readouterr().err
    assert not (tmp_path / "rig.json").exists()


# --- lenses over the volume ------------------------------------------------------------------------------------------


def test_a_lens_is_fitted_where_the_camera_sees_the_volume() -> None:
    camera = make_rig(12).cameras[2]
    box = np.full(3, -250.0), np.full(3, 250.0)
    middle = camera.rotation.T @ (np.array([0, 0, 900.0]) - camera.translation_mm)
    box = box[0] + middle, box[1] + middle
    whole = refit(camera.intrinsics, camera.image_size, 4)[2]
    small, turn, loss = refit(camera.intrinsics, camera.image_size, 4, (camera, box))
    assert loss.image_px is not None and loss.max_px < 0.5 * whole.max_px < whole.max_px < loss.image_px
    random = np.random.default_rng(1)  # the loss is that of points in the box
    points = box[0] + random.uniform(0, 1, (4000, 3)) * (box[1] - box[0])
    x = points @ camera.rotation.T + camera.translation_mm
    uv = project(x, camera.intrinsics)
    seen = ((uv > -0.5) & (uv < np.array(camera.image_size) - 0.5)).all(axis=1)
    off = np.linalg.norm(project(x @ turn.T, small) - uv, axis=1)[seen]
    assert seen.sum() > 1000 and off.max() < 1.05 * loss.max_px
    beside = box[0] + 1e5, box[1] + 1e5  # not in view: fitted over the image
    assert refit(camera.intrinsics, camera.image_size, 4, (camera, beside))[2] == whole
    xy, _ = undistort(uv[seen][:5], camera.intrinsics)
    assert np.isfinite(xy).all()


def test_kalibrs_export_of_the_demo_rig_works(folder: Path, tmp_path: Path, capsys) -> None:
    rig = spherecal.load_rig(folder / "result")
    with pytest.raises(InputError, match="off by up to"):
        spherecal.export_rig(rig, "kalibr", tmp_path / "camchain.yaml")
    assert run("export", folder / "result", "--to", "kalibr", "-o", tmp_path / "camchain.yaml") == 0
    said = capsys.readouterr().out
    found = re.search(r" (\S+) px \(rms \S+ px\) over the calibrated volume \(up to (\S+) px elsewhere", said)
    assert found and float(found[1]) <= 0.1 < float(found[2]), said
    done = spherecal.export_rig(folder / "result", "kalibr", tmp_path / "again.yaml")
    assert (tmp_path / "again.yaml").read_bytes() == (tmp_path / "camchain.yaml").read_bytes()
    assert max(loss.max_px for loss in done.losses.values()) <= 0.1
    points = np.genfromtxt(folder / "result" / "points.csv", delimiter=",", skip_header=1, usecols=(3, 4, 5))
    points = points[np.isfinite(points).all(axis=1)]
    read = spherecal.import_rig(tmp_path / "camchain.yaml", "kalibr")
    for camera in rig:
        uv = camera.project(points)
        inside = ((uv > -0.5) & (uv < np.array(camera.image_size) - 0.5)).all(axis=1)
        assert np.abs(read[camera.id].project(points) - uv)[inside].max() < 0.1, camera.id
