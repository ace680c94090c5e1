"""The parts of pages, each alone."""

import os
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QEvent, QPointF, QRectF, QSizeF, Qt
from PySide6.QtGui import QColor, QImage, QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QHBoxLayout, QLabel, QPushButton, QWidget

from spherecal_documents.scene.model import SceneData
from spherecal_gui import coverage as cov
from spherecal_gui import project as changes
from spherecal_gui import sounds, theme
from spherecal_gui.presenters.bars_presenter import Errors
from spherecal_gui.presenters.placement_presenter import NeedLine
from spherecal_gui.presenters.results_presenter import Action, CameraResiduals, FindingAdvice
from spherecal_gui.project import Project
from spherecal_gui.widgets.basic import add, button, once
from spherecal_gui.widgets.charts import ConvergenceChart, CoverageChart, ErrorChart, PairMatrix
from spherecal_gui.widgets.fields import NeedLabel
from spherecal_gui.widgets.rail import Rail
from spherecal_gui.widgets.results_views import FindingsList, ResidualView
from spherecal_gui.widgets.scene_overlay import place_tags
from spherecal_gui.widgets.scene_view import SceneView
from spherecal_gui.widgets.table import Table
from spherecal_gui.widgets.tile import CameraTile, Wall, shown_image
from spherecal_gui.workflow import Running, resolve


def colours_of(widget) -> set[str]:
    """The colours of a widget's picture."""
    image: QImage = widget.grab().toImage().scaled(160, 120)
    return {image.pixelColor(x, y).name() for x in range(0, 160, 2) for y in range(0, 120, 2)}


# --- widgets ---------------------------------------------------------------------------------------------------------


def test_a_part_of_a_row_keeps_its_size_where_it_has_an_alignment_and_grows_by_its_stretch(qtbot):
    box, aligned, stretched = QWidget(), QPushButton("Search again"), QLabel("3 cameras")
    qtbot.addWidget(box)
    row = add(QHBoxLayout(box), (stretched, 1), (aligned, Qt.AlignmentFlag.AlignTop))
    box.resize(900, 300)
    box.show()
    assert row.stretch(0) == 1 and row.stretch(1) == 0
    assert aligned.width() < 200 < stretched.width() and aligned.height() < 100


def test_the_rail_shows_every_step_with_its_state(qtbot):
    rail = Rail()
    qtbot.addWidget(rail)
    project = changes.with_failure(Project(theme_folder(), "simulated:demo"), "connect", "No camera was found.")
    rail.show_state(resolve(project, Running()))
    item = rail.item("connect")
    assert item.accessibleName() == "Connect, problem"
    assert "No camera was found." in item.toolTip()
    assert rail.item("calibrate").accessibleName() == "Calibrate, not yet"
    rail.resize(230, 600)
    assert theme.LIGHT.bad in colours_of(rail) or len(colours_of(rail)) > 5


def theme_folder():
    from pathlib import Path

    return Path("nowhere")


@pytest.mark.parametrize(("dtype", "bits"), [(np.uint8, 8), (np.uint16, 12)])
def test_images_are_thinned_out_and_keep_their_grey(dtype, bits):
    image = np.zeros((1000, 2000), dtype)
    image[:, 1000:] = 2**bits - 1
    shown = shown_image(image, bits, 500)
    assert (shown.width(), shown.height()) == (500, 250)
    assert shown.pixelColor(10, 10).value() == 0
    assert shown.pixelColor(490, 10).value() == 255


def test_a_double_click_enlarges_one_camera_and_again_shows_all(qtbot):
    wall = Wall()
    qtbot.addWidget(wall)
    wall.set_cameras({f"S{i}": f"C{i}" for i in range(6)})
    wall.show()
    wall.activateWindow()
    qtbot.waitUntil(wall.isActiveWindow)
    left, middle = Qt.MouseButton.LeftButton, wall.tiles["S3"].rect().center()
    QTest.mouseClick(wall.tiles["S3"], left, pos=middle)
    QTest.mouseDClick(wall.tiles["S3"], left, pos=middle)  # as a window system sends it: no press between
    QTest.mouseRelease(wall.tiles["S3"], left, pos=middle)
    assert wall.alone == "S3", "a double click enlarges too"
    assert [serial for serial, tile in wall.tiles.items() if tile.isVisible()] == ["S3"]
    assert wall.all_again.isVisible(), "the way back is in sight"
    QTest.mouseClick(wall.all_again, left)
    assert wall.alone is None and not wall.all_again.isVisible()
    QTest.mouseClick(wall.tiles["S3"], left, pos=middle)
    QTest.keyClick(wall.tiles["S3"], Qt.Key.Key_Escape)
    assert wall.alone is None, "Esc goes back too"
    QTest.mouseClick(wall.tiles["S3"], left, pos=middle)
    QTest.keyClick(wall.tiles["S3"], Qt.Key.Key_Return)
    assert wall.alone is None
    assert all(tile.isVisible() for tile in wall.tiles.values())


def test_a_tile_draws_image_and_dots(qtbot):
    tile = CameraTile("S1", "C01")
    qtbot.addWidget(tile)
    tile.resize(400, 300)
    assert tile.image is None
    tile.show_image(np.full((100, 200), 90, np.uint8), 8, 1.0)
    tile.show_state(replace(tile.state, level="good", dots=3), np.array([[50.0, 50.0], [100.0, 20.0], [150.0, 80.0]]))
    image = tile.grab().toImage()
    found = {image.pixelColor(x, y).name() for x in range(400) for y in range(40, 270)}
    assert "#5a5a5a" in found
    assert any(QColor(name).blue() > 200 and QColor(name).red() < 90 for name in found), "the dots"


def test_the_last_image_of_a_lost_camera_is_faint_and_says_since_when(qtbot):
    tile = CameraTile("S1", "C01")
    qtbot.addWidget(tile)
    tile.resize(400, 300)
    tile.show_image(np.full((100, 200), 200, np.uint8), 8, 1.0)
    live = replace(tile.state, level="good", dots=3)
    tile.show_state(live, np.array([[50.0, 20.0]]))
    assert "#c8c8c8" in colours_of(tile)
    tile.show_state(
        replace(live, level="bad", dots=None, since="no images since 14:03:22", lost=True), np.array([[50.0, 20.0]])
    )
    assert "#c8c8c8" not in colours_of(tile)
    assert "14:03:22" in tile.accessibleName()
    tile.show_state(live, np.array([[50.0, 20.0]]))
    assert "#c8c8c8" in colours_of(tile)


def test_charts_draw_what_they_are_given(qtbot):
    cameras, size = ["A", "B"], (100, 100)
    dots = cov.Dots(np.arange(200), np.zeros(200, int), np.random.default_rng(1).uniform(0, 99, (200, 2)), size)
    cells, pairs = CoverageChart(), PairMatrix()
    errors, course = ErrorChart(), ConvergenceChart()
    grid = cov.cells([dots])
    cells.show_cells(cameras, [grid, 0 * grid], [0 * grid, grid], ["good", "caution"])
    pairs.show_common(cameras, np.array([[200, 10], [10, 150]]))
    errors.show_errors(Errors(("x", "y"), np.array([0.01, -0.2]), np.array([0.05, 0.05]), (False, True)))
    course.show_runs([[100.0, 10.0, 9.0], [5.0, 4.0]])
    c = theme.now()
    for chart, wanted in (
        (cells, {theme.mixed(c.window, c.good, 0.5), theme.mixed(c.window, c.accent, 0.5)}),
        (pairs, {c.bad}),
        (errors, {c.border}),
    ):
        qtbot.addWidget(chart)
        chart.resize(500, 400)
        chart.show()
        qtbot.waitExposed(chart)
        assert wanted <= colours_of(chart), type(chart).__name__
    errors.show_errors(
        Errors(("x", "y"), np.array([0.01, -0.2]), np.array([0.05, 0.05]), (False, True))
    )  # as after a retake
    axis = errors.getAxis("left")
    shown = [float(text) for text in axis.tickStrings([-0.2, 0.1], axis.autoSIPrefixScale * axis.scale, 0.1)]
    assert shown == [-0.2, 0.1], "millimetres are millimetres"
    qtbot.addWidget(course)
    course.resize(500, 400)
    assert c.accent in colours_of(course)


def test_the_table_sorts_by_value_not_by_text(qtbot):
    table = Table(["name", "rms"])
    qtbot.addWidget(table)
    table.fill([[("A", "A", ""), ("9.0", 9.0, "")], [("B", "B", ""), ("10.0", 10.0, "bad")]], sort_by=1)
    assert [table.name_of(row) for row in range(2)] == ["B", "A"]
    table.select_name("A")
    assert table.selectionModel().selectedRows()[0].row() == 1


def test_findings_have_buttons_that_ask_for_what_they_advise(qtbot):
    findings = FindingsList()
    qtbot.addWidget(findings)
    actions = (Action("add placement", "", "Add a placement"),)
    findings.show_advice([FindingAdvice("caution", "Few", "Few placements.", "Add one.", actions)])
    details, button = findings.findChildren(QPushButton)
    said = next(one for one in findings.findChildren(QLabel) if one.text() == "Few placements.")
    findings.show()
    assert button.isVisible()
    assert not said.isVisible()
    details.click()
    assert said.isVisible(), "the engine's words are one click away"
    with qtbot.waitSignal(findings.asked) as caught:
        button.click()
    assert caught.args == ["add placement", ""]
    findings.show_advice([])
    assert findings.shown == []


def test_a_finding_that_asks_for_nothing_is_one_line(qtbot):
    findings = FindingsList()
    qtbot.addWidget(findings)
    findings.show_advice(
        [FindingAdvice("none", "Few", "Few placements.", "Add one.", (Action("add placement", "", "Add"),))]
    )
    findings.show()
    hint = next(one for one in findings.findChildren(QLabel) if one.text() == "Add one.")
    add, details = sorted(findings.findChildren(QPushButton), key=lambda one: one.text())
    assert not hint.isVisible()
    assert not add.isVisible()
    details.click()
    assert hint.isVisible()
    assert add.isVisible()


def test_residuals_are_drawn_and_those_left_out_stand_out(qtbot):
    view = ResidualView()
    qtbot.addWidget(view)
    view.resize(400, 300)
    rng = np.random.default_rng(2)
    used = np.arange(300) > 60
    view.show_camera(
        CameraResiduals("C01", (100, 80), rng.uniform(5, 75, (300, 2)), rng.normal(0, 0.1, (300, 2)), used)
    )
    image = view.grab().toImage()
    found = {image.pixelColor(x, y).name() for x in range(400) for y in range(300)}
    assert {theme.now().bad, theme.now().accent} <= found
    view.show_camera(None)
    assert theme.now().bad not in colours_of(view)


def scene_of_two() -> SceneData:
    def camera(name: str, x: float):
        centre = np.array([x, 0.0, 1000.0])
        corners = centre + np.array([[-50, -40, -100], [50, -40, -100], [50, 40, -100], [-50, 40, -100]], float)
        return SimpleNamespace(id=name, centre=centre, corners=corners)

    ball = SimpleNamespace(name="P1", ball_centre=np.zeros(3), ball_radius=200.0)
    scene = SimpleNamespace(cameras=(camera("C01", -500.0), camera("C02", 500.0)), placements=(ball,))
    points = np.random.default_rng(3).normal(0, 150, (200, 3))
    return SceneData(scene, points, np.linspace(0, 1, 200))


def test_the_plain_view_tells_which_camera_was_meant(qtbot, home):
    view = SceneView()
    assert view._broken  # painted, as the tests ask
    qtbot.addWidget(view)
    view.resize(500, 400)
    view.show_scene(scene_of_two())
    view.show()
    x, y = view.on_screen()["C02"]
    from PySide6.QtCore import QPoint

    with qtbot.waitSignal(view.camera_chosen) as caught:
        QTest.mouseDClick(view, Qt.MouseButton.LeftButton, pos=QPoint(int(x), int(y)))
    assert caught.args == ["C02"]
    view.mark("C02")
    view.look_from("top")
    assert theme.now().accent in colours_of(view) or len(colours_of(view)) > 3


def test_where_opengl_fails_the_view_stays_painted(qapp, qtbot, monkeypatch, tmp_path):
    """The process that renders starts with our sys.path, where a pyvista without OpenGL comes first."""
    (tmp_path / "pyvista.py").write_text("raise RuntimeError('no OpenGL context can be made')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("SPHERECAL_3D", raising=False)
    theme.apply(qapp, dark=False)  # names are thick enough for their full colour in our own font only
    view = SceneView()
    assert not view._broken, "it is tried"
    qtbot.addWidget(view)
    view.show_scene(scene_of_two())
    view.resize(400, 300)
    view.show()
    qtbot.waitUntil(lambda: view._broken, timeout=60_000)
    assert not view.rendered
    assert theme.now().text in colours_of(view)
    view.close_view()


def test_no_name_covers_another_and_those_that_are_told_are_there():
    places = [QPointF(100 + 3 * i, 50) for i in range(5)] + [QPointF(296, 196), QPointF(20, 150)]
    names = [f"C0{i}" for i in range(1, 8)]
    sizes = [QSizeF(28, 14)] * 7
    room = QRectF(0, 0, 300, 200)
    found = place_tags(names, places, sizes, room, 10, first=("C05",))
    assert {"C05", "C06", "C07"} <= set(found)
    assert len(found) < 7, "five marks in a heap have not room for five names"
    boxes = list(found.values())
    assert not any(a.intersects(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert all(room.contains(box) for box in boxes)
    told = place_tags(names[:5], [QPointF(100, 50)] * 5, sizes[:5], QRectF(90, 40, 20, 20), 10, first=("C02",))
    assert set(told) == {"C02"}, "with no room at all the one that is told is there all the same"


def double_click(target) -> int:
    """What a window system sends for a double click; how often the button was clicked by it."""
    clicks: list[bool] = []
    target.clicked.connect(lambda: clicks.append(True))
    kinds, left, none = QEvent.Type, Qt.MouseButton.LeftButton, Qt.MouseButton.NoButton
    at = QPointF(target.rect().center())
    for kind in (kinds.MouseButtonPress, kinds.MouseButtonRelease, kinds.MouseButtonDblClick, kinds.MouseButtonRelease):
        held = none if kind == kinds.MouseButtonRelease else left
        event = QMouseEvent(kind, at, target.mapToGlobal(at), left, held, Qt.KeyboardModifier.NoModifier)
        QApplication.sendEvent(target, event)
    return len(clicks)


def test_a_double_click_is_one_click(qtbot):
    plain, guarded = button("Next", "next"), once(button("Next", "next"))
    for one in (plain, guarded):
        qtbot.addWidget(one)
        one.show()
    assert double_click(plain) == 2
    assert double_click(guarded) == 1


def test_a_camera_in_a_list_of_needs_can_be_clicked(qtbot):
    line, asked = NeedLabel("caution"), []
    qtbot.addWidget(line)
    line.asked.connect(asked.append)
    line.show_need(NeedLine("Need more dots:", ("C02", "C05"), everyone=False))
    assert line.accessibleName() == "Need more dots: C02, C05"
    assert 'href="C05"' in line.text()
    line.linkActivated.emit("C05")
    line.show_need(NeedLine("Need more dots:", ("C02", "C05"), everyone=True))
    assert "all cameras" in line.text()
    line.linkActivated.emit("")
    assert asked == ["C05", ""]
    line.show_need(None)
    assert line.isHidden()


def test_sounds_differ_and_can_be_muted():
    assert len({sounds.tone_bytes(kind) for kind in ("good", "bad", "done", "ready", "lost")}) == 5
    assert sounds.tone_bytes("good").startswith(b"RIFF")
    player = sounds.Sounds()
    player.muted = True
    assert not player.play("good")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows plays sounds itself")
def test_the_sound_device_can_be_tested(tmp_path):
    """The players' own answer: somebody who hears nothing learns why."""
    player = sounds.Sounds()
    player._player = None
    assert "paplay" in player.test()
    for code, words in ((1, "Connection refused"), (0, "")):
        fake = tmp_path / f"player{code}"
        fake.write_text(f"#!/bin/sh\ntest -s $1 || exit 2\necho '{words}.' >&2\nexit {code}\n")
        fake.chmod(0o755)
        player._player = [str(fake)]
        said = player.test()
        assert (words in said and said.endswith("settings.")) if code else said == "", said
    player.close()
