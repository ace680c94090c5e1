"""The scene of a rig: its shapes, from where it is seen, what is said of it, as glTF, and rendered by pyvista."""

import json
import os
import struct
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QPoint, QPointF, Qt
from pytestqt.qtbot import QtBot

from spherecal.geometry.rotation import exp_rotation
from spherecal_documents.report.rig_view import CameraShape, DrawnPlacement, DrawnRig
from spherecal_documents.scene.eye import SIDES, View, fitting_view
from spherecal_documents.scene.model import (
    CameraFigures,
    SceneBar,
    SceneData,
    round_factor,
    with_images,
    with_moved,
)
from spherecal_documents.scene.picture import named_places, paper_style
from spherecal_documents.scene.renderer import PictureProcess, can_render
from spherecal_documents.scene.shapes import LAYERS, SHOWN_AT_FIRST, SceneStyle, blended, scene_shapes, shrunk
from spherecal_gui.presenters.gltf import scene_glb
from spherecal_gui.rig_scenes import items_of
from spherecal_gui.widgets.scene_overlay import Overlay
from spherecal_gui.widgets.scene_panel import ScenePanel
from spherecal_gui.widgets.scene_view import SceneView

STYLE = SceneStyle(
    True, (18, 23, 28), (55, 66, 77), (232, 237, 242), (116, 180, 230), (99, 207, 152), (238, 180, 87), (255, 140, 130)
)
RADIUS = 200.0


def camera(name: str, centre: tuple[float, float, float]) -> CameraShape:
    """One that looks at the origin."""
    place = np.array(centre)
    ahead = -place / np.linalg.norm(place)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.vstack([right, np.cross(ahead, right), ahead])
    corners = place + np.array([(-90, -70, 200), (90, -70, 200), (90, 70, 200), (-90, 70, 200)], float) @ axes
    return CameraShape(name, place, corners, axes)


@pytest.fixture
def data() -> SceneData:
    cameras = (camera("C01", (900, 0, 600)), camera("C02", (-500, 800, 650)), camera("C03", (-500, -800, 700)))
    turn, lift = np.meshgrid(np.linspace(0, 2 * np.pi, 30, endpoint=False), np.linspace(0.1, 1.3, 10))
    out = np.stack([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)], -1).reshape(-1, 3)
    ball = DrawnPlacement("P1", RADIUS * out, np.zeros(3), RADIUS)
    rig = DrawnRig(np.eye(3), "up", cameras, (ball,), 200.0, "C01")
    grid = np.stack(np.meshgrid(*[np.linspace(-300, 300, 4)] * 3), -1).reshape(-1, 3)
    return SceneData(
        rig,
        RADIUS * out,
        np.linspace(0, 1, len(out)),
        map_places=grid,
        map_mm=np.linspace(0.01, 0.09, len(grid)),
        map_length_mm=500.0,
        links=(("C01", "C02"),),
        normals=out,
        most_px=0.04,
        names=tuple(("P1", i, "A") for i in range(len(out))),
        ellipsoid_places=np.array([one.centre for one in cameras]),
        ellipsoids=np.tile(np.diag([0.01, 0.02, 0.04]), (3, 1, 1)),
        figures={"C01": CameraFigures("SN-1", (2448, 2048), 0.031, 0.012)},
        images={one.id: np.full((100, 120), 90, np.uint8) for one in cameras},
    )


# --- shapes ----------------------------------------------------------------------------------------------------------


def test_a_factor_is_one_two_or_five_times_a_power_of_ten() -> None:
    assert [round_factor(wanted, 1.0) for wanted in (0.5, 1.0, 1.9, 2.0, 4.9, 7.0, 10.0, 99.0, 250.0)] == [
        1.0, 1.0, 1.0, 2.0, 2.0, 5.0, 10.0, 50.0, 200.0,
    ]  # fmt: skip
    assert round_factor(3.0, 0.0) == 1.0


def test_every_layer_adds_its_shapes_and_faces_point_to_vertices(data: SceneData) -> None:
    def names(*layers: str) -> set[str]:
        shapes = scene_shapes(data, replace(STYLE, layers=frozenset(layers)))
        for mesh in shapes.meshes:
            assert mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices) == len(mesh.colours)
            assert np.isfinite(mesh.vertices).all()
        images = {"images"} if shapes.picture is not None else set()
        return {one.name for one in (*shapes.meshes, *shapes.lines)} | images

    plain = names()
    assert {"cameras", "lenses", "balls", "floor", "frusta", "volume", "axes"} == plain
    assert names("dots") - plain == {"dots"}
    assert names("images") - plain == {"images"}
    assert names("links") - plain == {"paths"}
    assert names("ellipsoids") - plain == {"uncertainty ellipsoids"}
    assert names("map") - plain == {"length uncertainty"}
    assert set(LAYERS) == {"dots", "images", "links", "ellipsoids", "map"}


def test_dots_lie_on_their_ball_and_look_outward(data: SceneData) -> None:
    dots = next(one for one in scene_shapes(data, STYLE).meshes if one.name == "dots")
    radius = np.linalg.norm(dots.vertices, axis=1)
    assert radius.min() > RADIUS and radius.max() < 1.02 * RADIUS
    a, b, c = (dots.vertices[dots.faces[:, i]] for i in range(3))
    assert len(np.unique(dots.colours, axis=0)) > 50 and dots.plain
    flat = np.cross(b - a, c - a)
    along = np.abs((flat * a).sum(axis=1)) / np.linalg.norm(flat, axis=1) / np.linalg.norm(a, axis=1)
    assert along.min() > 0.99


def test_bars_and_the_map_are_not_hidden_in_balls(data: SceneData) -> None:
    bar = SceneBar("L1 A-B", np.array([-100.0, 0, 0]), np.array([100.0, 0, 50]), 0.02, 0.01, "bad")
    shown = replace(data, bars=(bar,))
    meshes = scene_shapes(shown, STYLE).meshes
    assert "balls" not in {one.name for one in meshes}
    drawn = next(one for one in meshes if one.name == "bars")
    assert {tuple(colour) for colour in drawn.colours.tolist()} == {STYLE.bad}
    assert "balls" in {one.name for one in scene_shapes(shown, STYLE).lines}


def test_a_moved_camera_is_shown_where_it_was(data: SceneData) -> None:
    shift, turn = np.array([2.0, -1.0, 0.5]), np.array([0.1, 0.3, -0.2])
    now = data.scene.cameras[1]
    moved = with_moved(data, [("C02", shift, turn), ("C09", shift, turn)])
    (one,) = moved.moved
    assert np.allclose(one.centre, now.centre - shift)
    before_axes = exp_rotation(-np.deg2rad(turn)) @ now.axes
    assert np.allclose((one.corners - one.centre) @ before_axes.T, (now.corners - now.centre) @ now.axes.T)
    assert (one.shift_mm, one.turn_deg) == (pytest.approx(np.linalg.norm(shift)), pytest.approx(np.linalg.norm(turn)))
    assert moved.shift_factor > 1
    assert "before" in {lines.name for lines in scene_shapes(moved, STYLE).lines}


def test_ellipsoids_are_drawn_at_the_stated_magnification(data: SceneData) -> None:
    style = replace(STYLE, layers=frozenset({"ellipsoids"}))
    mesh = next(one for one in scene_shapes(data, style).meshes if one.name == "uncertainty ellipsoids")
    each = mesh.vertices.reshape(3, -1, 3) - data.ellipsoid_places[:, None]
    assert np.allclose(np.abs(each).max(axis=1), data.ellipsoid_factor * np.array([0.01, 0.02, 0.04]), rtol=0.05)
    assert 0.02 * data.radius < 0.04 * data.ellipsoid_factor <= 0.05 * data.radius


def test_the_floor_lies_under_everything_and_holds_it(data: SceneData) -> None:
    floor, every = data.floor, data.every_place()
    assert floor.z < every[:, 2].min()
    assert floor.x0 <= every[:, 0].min() and every[:, 0].max() <= floor.x1
    assert floor.step in (100.0, 200.0)
    assert len(floor.lines()) < 40


def test_an_image_is_made_smaller_by_averaging() -> None:
    image = np.arange(24, dtype=np.uint8).reshape(4, 6)
    assert shrunk(image, 3).tolist() == [[4, 6, 8], [16, 18, 20]]  # means of 2 x 2, halves to the even number
    assert shrunk(image, 6).tolist() == image.tolist()
    assert blended((0, 0, 0), (10, 20, 30), 0.5) == (5, 10, 15)


# --- from where ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", SIDES)
def test_from_every_side_everything_is_in_sight(data: SceneData, side: str) -> None:
    eye = fitting_view(data.every_place(), side, 500, 400).eye(640, 480)
    flat = eye.flat(data.every_place())
    assert flat[:, 0].min() > 65 and flat[:, 0].max() < 575
    assert flat[:, 1].min() > 35 and flat[:, 1].max() < 445


def test_the_place_under_the_mouse_stays_there(data: SceneData) -> None:
    view = fitting_view(data.every_place(), "oblique", 500, 400)
    place = data.scene.cameras[0].centre[None]
    x, y = view.eye(640, 480).flat(place)[0]
    closer = view.closer(2.0, x - 320, y - 240)
    assert np.allclose(closer.eye(640, 480).flat(place)[0], (x, y), atol=1e-6)
    assert closer.eye(640, 480).scale == pytest.approx(2 * view.eye(640, 480).scale)
    assert np.allclose(view.moved(30, -20).eye(640, 480).flat(place)[0], (x + 30, y - 20), atol=1e-6)


def test_the_view_never_turns_past_the_poles() -> None:
    view = View(np.zeros(3), 10.0, 80.0).turned(5.0, 40.0)
    assert (view.turn_deg, view.lift_deg) == (15.0, 90.0)


# --- what is said ----------------------------------------------------------------------------------------------------


def test_what_is_said_of_a_camera_a_dot_and_a_place_of_the_map(data: SceneData) -> None:
    said = {one.kind: one.lines() for one in items_of(data, frozenset({"dots"}))[:4]}
    assert said["camera"] == ["C03"]
    first = items_of(data, frozenset({"dots"}))
    assert first[0].lines() == [
        "C01",
        "Serial number SN-1",
        "Sensor 2448 × 2048 px",
        "Residuals 0.031 px rms",
        "Place ± 0.012 mm",
    ]
    dot = next(one for one in reversed(first) if one.kind == "dot")
    assert dot.lines() == ["P1, target 299, dot A", "Residual 0.040 px rms"]
    place = items_of(data, frozenset({"map"}))[-1]
    assert place.lines() == ["500 mm at this place", "Uncertainty 0.090 mm (95 %)"]


def test_the_mouse_finds_what_is_in_front(qtbot: QtBot, plain: SceneView, data: SceneData) -> None:
    view = shown(qtbot, plain, data)
    for name, (x, y) in view.on_screen().items():
        assert view.item_at(QPointF(x, y)).name == name
    view.look_from("top")
    x, y = view.eye.flat(np.zeros((1, 3)))[0]
    assert view.item_at(QPointF(x, y)).kind in ("dot", "ball")
    view.look_from("bottom")
    assert view.item_at(QPointF(*view.eye.flat(np.array([[0.0, 0, -RADIUS]]))[0])).kind == "ball", "dots are behind"
    assert view.item_at(QPointF(2, 2)) is None


@pytest.fixture
def plain(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> SceneView:
    """A view that is painted: no process renders for it."""
    monkeypatch.setenv("SPHERECAL_3D", "painted")
    return SceneView()


def shown(qtbot: QtBot, view: SceneView, data: SceneData) -> SceneView:
    qtbot.addWidget(view)
    view.resize(640, 480)
    view.show_scene(data)
    view.show()
    return view


def test_a_click_on_the_cube_looks_from_there(qtbot: QtBot, plain: SceneView, data: SceneData) -> None:
    view = shown(qtbot, plain, data)
    before = view.on_screen()
    view.look_from("top")
    from_above = view.on_screen()
    view.look_from("oblique")
    assert view.on_screen() == before
    faces = {side: middle for side, _, depth, (_, _, middle) in view._overlay._faces(view.eye) if depth > 0}
    assert set(faces) == {"top", "front", "side"}
    at = faces["top"]
    qtbot.mouseClick(view, Qt.MouseButton.LeftButton, pos=QPoint(round(at.x()), round(at.y())))
    assert view.on_screen() == from_above


def test_names_legend_and_layers_change_the_picture(qtbot: QtBot, plain: SceneView, data: SceneData) -> None:
    view = shown(qtbot, plain, data)
    pictures = [view.grab().toImage()]
    for layer in ("map", "ellipsoids", "links"):
        view.set_layers(SHOWN_AT_FIRST | {layer})
        pictures.append(view.grab().toImage())
    view.set_layers(frozenset())
    pictures.append(view.grab().toImage())
    assert all(a != b for i, a in enumerate(pictures) for b in pictures[i + 1 :])


def test_a_scene_without_residuals_has_no_legend_of_them(data: SceneData) -> None:
    assert Overlay._bar_title(data, frozenset({"dots"})) is not None
    assert Overlay._bar_title(replace(data, most_px=0.0), frozenset({"dots"})) is None


def test_keys_turn_and_show_everything_again(qtbot: QtBot, plain: SceneView, data: SceneData) -> None:
    view = shown(qtbot, plain, data)
    before = view.on_screen()
    for key in (Qt.Key.Key_Left, Qt.Key.Key_Up, Qt.Key.Key_Plus):
        qtbot.keyClick(view, key)
    assert view.on_screen() != before
    qtbot.keyClick(view, Qt.Key.Key_Home)
    assert view.on_screen() == before


# --- files -----------------------------------------------------------------------------------------------------------


def parts(glb: bytes) -> tuple[dict[str, Any], bytes]:
    magic, version, length = struct.unpack_from("<4sII", glb)
    assert (magic, version, length) == (b"glTF", 2, len(glb))
    size, kind = struct.unpack_from("<I4s", glb, 12)
    assert kind == b"JSON" and size % 4 == 0
    size_of_data, kind = struct.unpack_from("<I4s", glb, 20 + size)
    assert kind == b"BIN\0"
    data = glb[28 + size :]
    assert len(data) == size_of_data
    return json.loads(glb[20 : 20 + size]), data


def test_a_gltf_file_holds_the_scene_in_metres_with_y_up(data: SceneData) -> None:
    style = replace(STYLE, layers=frozenset(LAYERS))
    glb = scene_glb(data, style)
    assert glb == scene_glb(data, style)
    tree, blob = parts(glb)
    for view in tree["bufferViews"]:
        assert view["byteOffset"] % 4 == 0 and view["byteOffset"] + view["byteLength"] <= len(blob)
    nodes = {one["name"]: one for one in tree["nodes"]}
    assert {"cameras", "length uncertainty", "images", "C01"} <= set(nodes)
    x, y, z = data.scene.cameras[0].centre / 1000
    assert np.allclose(nodes["C01"]["translation"], (x, z, -y))
    frusta = tree["meshes"][nodes["frusta"]["mesh"]]["primitives"][0]
    assert frusta["mode"] == 1
    accessor = tree["accessors"][frusta["attributes"]["POSITION"]]
    start = tree["bufferViews"][accessor["bufferView"]]["byteOffset"]
    places = np.frombuffer(blob, "<f4", 3 * accessor["count"], start).reshape(-1, 3)
    assert np.allclose(places.min(axis=0), accessor["min"]) and np.allclose(places.max(axis=0), accessor["max"])
    assert np.abs(places).max() < 2.0


def test_vtk_reads_the_gltf_file(data: SceneData, tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed")
    path = tmp_path / "rig.glb"
    path.write_bytes(scene_glb(data, STYLE))
    read = pyvista.read(path)
    x0, x1, y0, y1, _, _ = read.bounds
    every = data.every_place() / 1000
    assert x0 <= every[:, 0].min() and x1 >= every[:, 0].max()
    assert y0 <= every[:, 2].min() + 0.01 and y1 >= every[:, 2].max() - 0.15


def test_the_panel_saves_pictures_and_models_and_says_so(qtbot: QtBot, data: SceneData, tmp_path: Path) -> None:
    panel = ScenePanel()
    qtbot.addWidget(panel)
    panel.resize(500, 400)
    panel.show_scene(data)
    said: list[tuple[str, str, str]] = []
    panel.said.connect(lambda *words: said.append(words))
    panel.save_as(tmp_path / "rig.png")
    panel.save_as(tmp_path / "rig.glb")
    panel.save_as(tmp_path / "nowhere" / "rig.png")
    panel.save_as(tmp_path / "nowhere" / "rig.glb")
    assert (tmp_path / "rig.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "rig.glb").read_bytes()[:4] == b"glTF"
    assert [words[0] for words in said] == ["info", "info", "bad", "bad"]
    panel.layers["map"].setChecked(True)
    assert "map" in panel.view.layers
    panel.show_scene(replace(data, map_places=np.empty((0, 3)), map_mm=np.empty(0)))
    assert "map" not in panel.view.layers and not panel.layers["map"].isEnabled()


# --- rendered --------------------------------------------------------------------------------------------------------


def test_pyvista_renders_what_is_painted(qtbot: QtBot, data: SceneData, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a process of its own; the picture arrives, and another one after the view was turned."""
    pytest.importorskip("pyvista", reason="pyvista is not installed")
    monkeypatch.delenv("SPHERECAL_3D", raising=False)
    view = SceneView()
    shown(qtbot, view, data)
    assert not view.rendered, "painted until the first picture is there"
    qtbot.waitUntil(lambda: view.rendered or view._broken, timeout=120_000)
    if view._broken:
        pytest.skip("OpenGL does not work here")
    first = view._image
    ground = view.style_of_now().ground
    corner = first.pixelColor(5, 5)
    assert (corner.red(), corner.green(), corner.blue()) == ground
    x, y = (round(one) for one in view.shown_eye.flat(np.array([[0.0, 0, 0.9 * RADIUS]]))[0])
    assert first.pixelColor(x, y) != corner
    number = view._got
    view.turn(200, 0)
    qtbot.waitUntil(lambda: view._got > number + 1 and view.shown_eye.right[0] == view.eye.right[0], timeout=60_000)
    assert view._image != first
    process = view._process
    view.close_view()
    assert process.wait(10)


def test_one_picture_for_the_report(data: SceneData, monkeypatch: pytest.MonkeyPatch) -> None:
    """On white, with what the rig shows where the names say."""
    monkeypatch.setenv("SPHERECAL_3D", "2d")
    assert not can_render()
    pytest.importorskip("pyvista", reason="pyvista is not installed")
    monkeypatch.delenv("SPHERECAL_3D")
    eye = fitting_view(data.every_place(), "oblique", 300, 180).eye(320, 200)
    with PictureProcess() as process:
        if process.trouble():
            pytest.skip("OpenGL does not work here")
        picture = process.picture(data, paper_style(), eye)
    assert picture.shape == (200, 320, 3)
    assert picture[2, 2].tolist() == [255, 255, 255]
    names, places = named_places(data)
    assert names == ("C01", "C02", "C03", "P1", "x", "y", "z")
    x, y = (round(one) for one in eye.flat(places[3:4])[0])
    assert picture[y, x].tolist() != [255, 255, 255], "the ball is there"


def test_images_of_any_type_become_bytes(data: SceneData) -> None:
    made = with_images(data, {"C01": np.ones((4, 4))})
    assert made.images["C01"].dtype == np.uint8


def test_a_scene_without_axes_or_reference_is_shown(qtbot: QtBot, plain: SceneView) -> None:
    one = camera("C01", (500.0, 0.0, 300.0))
    rig = SimpleNamespace(cameras=(SimpleNamespace(id="C01", centre=one.centre, corners=one.corners),), placements=())
    view = shown(qtbot, plain, SceneData(rig, np.empty((0, 3)), np.empty(0)))
    assert not view.grab().toImage().isNull()


def test_a_scene_is_sent_while_the_window_works_out_its_floor(data: SceneData) -> None:
    """Sent from a thread of its own; what is worked out meanwhile made its pickling fail, and no picture came."""
    import pickle

    class Meanwhile:
        def __reduce__(self) -> tuple[type, tuple[()]]:
            assert sent.radius > 0 and sent.floor is not None
            return str, ()

    sent = replace(data, images={"C01": Meanwhile()})
    assert len(pickle.loads(pickle.dumps(sent)).points) == len(data.points)
