"""The rig painted by Qt: it shows what pyvista's view shows, turns, and needs no pyvista."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QWheelEvent
from pytestqt.qtbot import QtBot

from spherecal_documents.scene.model import SceneData, scene_data
from spherecal_gui.widgets.scene_view import SceneView
from spherecal_rigs.result_folder import read_result
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> SceneData:
    from spherecal_app.cli.main import main

    folder = tmp_path_factory.mktemp("painted")
    write_session(*simulate_session("demo", 1, SimulationOptions(targets=80)), folder / "session")
    assert main(["calibrate", str(folder / "session"), "-o", str(folder / "result")]) == 0
    shown = scene_data(read_result(folder / "result"), (("C01", "C02"),))
    assert shown is not None
    return shown


@pytest.fixture
def view(qtbot: QtBot, data: SceneData, monkeypatch: pytest.MonkeyPatch) -> SceneView:
    monkeypatch.setenv("SPHERECAL_3D", "painted")
    view = SceneView()
    qtbot.addWidget(view)
    view.resize(640, 480)
    view.show_scene(data)
    view.show()
    return view


def pixels(view: SceneView) -> np.ndarray:
    image = view.grab().toImage().convertToFormat(view.grab().toImage().Format.Format_RGB888)
    return np.frombuffer(bytes(image.constBits()), np.uint8).reshape(image.height(), -1)[:, : 3 * image.width()]


def test_all_cameras_lie_inside_the_picture_from_every_side(view: SceneView) -> None:
    pictures = []
    for side in ("oblique", "top", "front", "side"):
        view.look_from(side)
        places = view.on_screen()
        assert len(places) == 6
        assert all(20 < x < 620 and 20 < y < 460 for x, y in places.values()), side
        pictures.append(pixels(view).copy())
    assert all(len(np.unique(picture)) > 20 for picture in pictures)
    assert not np.array_equal(pictures[0], pictures[1])


def test_the_view_from_above_is_the_plan(view: SceneView, data: SceneData) -> None:
    view.look_from("top")
    on_screen = view.on_screen()
    flat = {camera.id: data.flat("top", camera.centre) for camera in data.scene.cameras}
    first, *others = on_screen
    ratios = [(np.array(on_screen[name]) - on_screen[first])[0] / (flat[name] - flat[first])[0] for name in others]
    assert np.ptp(ratios) < 1e-9 * abs(ratios[0])
    assert ratios[0] > 0


def test_dragging_turns_and_the_wheel_comes_closer(view: SceneView, qtbot: QtBot) -> None:
    before = view.on_screen()
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=QPoint(300, 200))
    qtbot.mouseMove(view, QPoint(380, 230))
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=QPoint(380, 230))
    turned = view.on_screen()
    assert max(np.hypot(*np.subtract(before[name], turned[name])) for name in before) > 30
    middle = QPointF(320, 240)
    wheel = QWheelEvent(
        middle,
        view.mapToGlobal(middle),
        QPoint(),
        QPoint(0, 120),
        Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier,
        Qt.ScrollPhase.NoScrollPhase,
        False,
    )
    view.wheelEvent(wheel)
    name = next(iter(turned))
    distances = [np.hypot(*np.subtract(places[name], (320, 240))) for places in (turned, view.on_screen())]
    assert distances[1] == pytest.approx(1.15 * distances[0])


def test_a_double_click_chooses_the_camera_and_layers_change_the_picture(view: SceneView, qtbot: QtBot) -> None:
    x, y = view.on_screen()["C03"]
    with qtbot.waitSignal(view.camera_chosen) as chosen:
        qtbot.mouseDClick(view, Qt.MouseButton.LeftButton, pos=QPoint(round(x), round(y)))
    assert chosen.args == ["C03"]
    plain = pixels(view).copy()
    view.mark("C03")
    assert not np.array_equal(plain, pixels(view))
    view.mark(None)
    view.set_layers((view.layers - {"map"}) | {"links"})
    assert not np.array_equal(plain, pixels(view))


def test_a_picture_of_6000_points_is_quick(view: SceneView) -> None:
    began = time.perf_counter()
    for _ in range(3):
        view.grab()
    assert (time.perf_counter() - began) / 3 < 1.0  # 0.01 s on an idle machine


def test_without_pyvista_the_painted_view_is_taken(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "pyvista", None)
    monkeypatch.delenv("SPHERECAL_3D", raising=False)
    view = SceneView()
    qtbot.addWidget(view)
    assert view._broken and view.settled
