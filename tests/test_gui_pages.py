"""Pages, widgets and keys, with pytest-qt and without cameras that take long."""

import os
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

try:
    from PySide6.QtCore import Qt
    from PySide6.QtGui import QColor, QImage
    from PySide6.QtTest import QTest

    from spherecal_gui import project as changes
    from spherecal_gui import sounds, theme
    from spherecal_gui.presenters import coverage as cov
    from spherecal_gui.presenters.guidance import Guidance
    from spherecal_gui.presenters.results import Action, Advice, CameraResiduals
    from spherecal_gui.presenters.scene import SceneData
    from spherecal_gui.project import Project
    from spherecal_gui.project_folder import save_project
    from spherecal_gui.tasks.task import Runner
    from spherecal_gui.widgets.basic import enable
    from spherecal_gui.widgets.charts import ConvergenceChart, CounterChart, CoverageChart, ErrorChart, PairMatrix
    from spherecal_gui.widgets.findings import FindingsList
    from spherecal_gui.widgets.rail import Rail
    from spherecal_gui.widgets.residual_view import ResidualView
    from spherecal_gui.widgets.scene import Scene2D, make_scene_view
    from spherecal_gui.widgets.table import Table
    from spherecal_gui.widgets.tile import CameraTile, Wall, shown_image
    from spherecal_gui.widgets.top_view import TopView
    from spherecal_gui.wizard.window import WizardWindow
    from spherecal_gui.workflow import Running, resolve
except ImportError as error:
    pytest.skip(f"Qt cannot be loaded here: {error}", allow_module_level=True)

from spherecal.context import Context
from spherecal.errors import InputError


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    monkeypatch.setenv("SPHERECAL_3D", "2d")
    return tmp_path


@pytest.fixture
def window(qtbot, home):
    """An empty wizard on the start page."""
    made = WizardWindow(home / "projects")
    qtbot.addWidget(made)
    made.show()
    yield made
    made.close()


def colours_of(widget) -> set[str]:
    """The colours of a widget's picture."""
    image: QImage = widget.grab().toImage().scaled(160, 120)
    return {image.pixelColor(x, y).name() for x in range(0, 160, 2) for y in range(0, 120, 2)}


# --- look ------------------------------------------------------------------------------------------------------------


def contrast(first: str, second: str) -> float:
    """The contrast of two colours by WCAG 2."""

    def light(name: str) -> float:
        parts = [part / 255 for part in QColor(name).getRgb()[:3]]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    brighter, darker = sorted((light(first), light(second)), reverse=True)
    return (brighter + 0.05) / (darker + 0.05)


@pytest.mark.parametrize("c", [theme.LIGHT, theme.DARK], ids=["light", "dark"])
def test_letters_can_be_read(c):
    for ground in (c.window, c.surface, c.raised):
        assert contrast(c.text, ground) >= 7
        assert contrast(c.soft, ground) >= 4.5
    for state in (c.good, c.caution, c.bad, c.accent):
        assert contrast(state, c.surface) >= 4.5
    assert contrast(c.on_accent, c.accent) >= 4.5


def test_distance_mode_makes_letters_larger(qapp):
    theme.apply(qapp, dark=False, far=False)
    near = theme.pt(10)
    theme.apply(qapp, dark=False, far=True)
    assert theme.pt(10) == pytest.approx(theme.FAR_FACTOR * near)
    theme.apply(qapp, dark=False, far=False)


def test_a_disabled_button_says_why(qtbot):
    from spherecal_gui.widgets.basic import button

    one = button("Calibrate", "calibrate")
    qtbot.addWidget(one)
    enable(one, False, "Two placements are missing.")
    assert one.toolTip() == one.accessibleDescription() == "Two placements are missing."
    enable(one, True)
    assert one.toolTip() == ""


# --- window ----------------------------------------------------------------------------------------------------------


def test_a_source_that_does_not_exist_is_said_on_the_page(qtbot, window):
    window.new_project("simulated:nonsense")
    qtbot.waitUntil(lambda: window.controller.runner.running is None, timeout=20_000)
    assert not window.banner.isVisible(), "once is enough"
    assert "no rig preset" in window.page.summary.text()
    assert window.controller.project is not None
    assert (window.controller.project.folder / "wizard.json").is_file()
    assert not window.footer.next.isEnabled()
    assert not window.footer.action.isEnabled()


def test_a_replay_folder_without_images_is_said(qtbot, window, tmp_path):
    window.new_project(f"replay:{tmp_path}")
    qtbot.waitUntil(lambda: window.controller.runner.running is None, timeout=20_000)
    assert "session.json" in window.page.summary.text()


def test_a_blocked_step_on_the_rail_says_why(qtbot, window):
    window.new_project("simulated:nonsense")
    qtbot.waitUntil(lambda: window.controller.runner.running is None, timeout=20_000)
    window.rail.item("calibrate").click()
    assert "Calibrate: Nobody has confirmed" in window.banner.text
    assert window.controller.project.step == "connect"


def test_a_project_that_cannot_be_read_is_said_on_the_start_page(window, home):
    folder = home / "projects" / "broken"
    folder.mkdir(parents=True)
    (folder / "wizard.json").write_text("{")
    window.start.refresh()
    window.open_project(str(folder))
    assert "wizard.json" in window.banner.text
    assert window.stack.currentWidget() is window.start


def test_the_start_page_lists_projects_with_how_far_they_came(window, home):
    project = replace(Project(home / "projects" / "one", "simulated:demo"))
    save_project(project)
    window.start.refresh()
    (line,) = window.start._lines
    assert line.where == "0 of 4 placements taken"
    assert line.source == "SIMULATED"


def test_help_is_there_for_every_step(qtbot, window):
    from spherecal.resources import resource_path

    for kind in ("start", "connect", "look", "placement", "scale", "calibrate", "results", "verify", "save"):
        text = resource_path("help", "en", f"{kind}.html").read_text(encoding="utf-8")
        assert len(text) > 150
    dialog = window.show_help()
    assert dialog.isVisible()
    dialog.close()


def test_space_bar_and_remote_do_the_pages_work(qtbot, window, monkeypatch):
    asked = []
    monkeypatch.setattr(window, "advance", lambda: asked.append("advance"))
    window.setFocus()
    QTest.keyClick(window, Qt.Key.Key_Space)
    assert asked == ["advance"]


def test_closing_while_work_runs_waits_for_it(qtbot, home):
    made = WizardWindow(home / "projects")
    made.show()
    made.new_project("simulated:demo")
    assert made.controller.runner.running == "connect"
    assert made.close()
    assert made.controller.runner.task is None or made.controller.runner.task.isFinished()
    assert not [thread for thread in threading.enumerate() if thread.name in ("live", "detection")]


def test_windows_leave_nothing_behind(qtbot, home, qapp):
    """Neither widgets nor threads, however often a project is opened."""
    import gc

    from PySide6.QtCore import QCoreApplication, QEvent

    counts = []
    for number in range(3):
        made = WizardWindow(home / "projects")
        made.show()
        made.new_project("simulated:demo")
        qtbot.waitUntil(lambda made=made: made.controller.connection is not None, timeout=60_000)
        made.controller.confirm_bench()
        made.controller.accept_look()
        made.controller.go("placement:P1" if number else "look")
        made.controller.go("placement:P1")
        assert made.close()
        made.deleteLater()
        del made
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        qapp.processEvents()
        gc.collect()
        counts.append(len(qapp.allWidgets()))
    assert counts[2] <= counts[1], counts
    left = [thread.name for thread in threading.enumerate() if thread is not threading.main_thread()]
    assert not [name for name in left if "live" in name or "detection" in name or "task" in name], left


def test_a_support_bundle_holds_no_images(window, home):
    import zipfile

    project = replace(Project(home / "projects" / "one", "simulated:demo"))
    save_project(project)
    (project.folder / "placements").mkdir()
    (project.folder / "placements" / "C01.png").write_bytes(b"png")
    window.controller.project = project
    path = window.save_bundle()
    assert path is not None
    with zipfile.ZipFile(path) as bundle:
        names = set(bundle.namelist())
        assert {"about.txt", "log.txt", "project/wizard.json"} <= names
        assert not [name for name in names if name.endswith(".png")]
        assert "SphereCal" in bundle.read("about.txt").decode()
    window.controller.project = None


def test_training_comes_with_a_fault(window):
    page, asked = window.start, []
    page.wanted.disconnect(window.new_project)
    page.wanted.connect(asked.append)
    for row in (0, 1, page.fault.count() - 1):
        page.fault.setCurrentIndex(row)
        page.training.click()
    assert asked[:2] == ["simulated:demo", "simulated:demo+bump:C03:0.3@3"]
    assert asked[2].startswith("simulated:demo+"), "a surprise is one of the faults"


def test_about_names_the_versions(window):
    from PySide6.QtWidgets import QTextBrowser

    from spherecal_gui.wizard.dialogs import about_dialog

    dialog = about_dialog(window)
    assert "Apache License 2.0" in dialog.findChildren(QTextBrowser)[0].toPlainText()
    dialog.close()


# --- tasks -----------------------------------------------------------------------------------------------------------


def ended(qtbot, runner, work):
    """Run work; how it ended."""
    told = []
    runner.start(
        "x",
        work,
        lambda r: told.append(("done", r)),
        lambda e: told.append(("failed", e)),
        lambda: told.append(("cancelled", None)),
    )
    qtbot.waitUntil(lambda: bool(told), timeout=10_000)
    return told[0]


def test_a_task_ends_in_exactly_one_way(qtbot):
    runner = Runner()
    assert ended(qtbot, runner, lambda context: 42) == ("done", 42)

    def fails(context: Context):
        raise InputError("No.", "Do this.")

    kind, error = ended(qtbot, runner, fails)
    assert (kind, str(error)) == ("failed", "No. Do this.")
    assert runner.running is None


def test_cancelling_a_task(qtbot):
    runner = Runner()

    def works(context: Context):
        while True:
            context.check()
            time.sleep(0.01)

    threading.Timer(0.1, runner.cancel).start()
    began = time.perf_counter()
    assert ended(qtbot, runner, works)[0] == "cancelled"
    assert time.perf_counter() - began < 2.0


def test_only_one_task_runs_at_a_time(qtbot):
    runner, release = Runner(), threading.Event()
    assert runner.start("one", lambda context: release.wait(10), lambda _: None, lambda _: None)
    assert not runner.start("two", lambda context: None, lambda _: None, lambda _: None)
    release.set()
    qtbot.waitUntil(lambda: runner.running is None, timeout=10_000)


def test_progress_is_a_mailbox_and_keeps_iterations(qtbot):
    runner, go = Runner(), threading.Event()

    def works(context: Context):
        for i in range(1000):
            context.report("detect", i / 1000)
        for i in range(3):
            context.report("bundle adjustment", 0.1, f"iteration {i}, cost 1")
        go.wait(10)

    runner.start("x", works, lambda _: None, lambda _: None)
    assert runner.task is not None
    task, news = runner.task, []
    qtbot.waitUntil(lambda: news.extend(task.take_news()) or len(news) >= 4, timeout=10_000)
    assert len(news) < 60
    assert [one.message for one in news if "iteration" in one.message] == [f"iteration {i}, cost 1" for i in range(3)]
    go.set()
    qtbot.waitUntil(lambda: runner.running is None, timeout=10_000)


# --- widgets ---------------------------------------------------------------------------------------------------------


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
    QTest.mouseDClick(wall.tiles["S3"], Qt.MouseButton.LeftButton)
    assert wall.alone == "S3"
    assert [serial for serial, tile in wall.tiles.items() if tile.isVisible()] == ["S3"]
    QTest.keyClick(wall.tiles["S3"], Qt.Key.Key_Return)
    assert wall.alone is None
    assert all(tile.isVisible() for tile in wall.tiles.values())


def test_a_tile_draws_image_and_dots(qtbot):
    tile = CameraTile("S1", "C01")
    qtbot.addWidget(tile)
    tile.resize(400, 300)
    assert not tile.has_image
    tile.show_image(np.full((100, 200), 90, np.uint8), 8, 1.0)
    tile.show_state(replace(tile.state, level="good", dots=3), np.array([[50.0, 50.0], [100.0, 20.0], [150.0, 80.0]]))
    image = tile.grab().toImage()
    found = {image.pixelColor(x, y).name() for x in range(400) for y in range(40, 270)}
    assert "#5a5a5a" in found
    assert any(QColor(name).blue() > 200 and QColor(name).red() < 90 for name in found), "the dots"


def test_charts_draw_what_they_are_given(qtbot):
    cameras, size = ["A", "B"], (100, 100)
    dots = cov.Dots(np.arange(200), np.zeros(200, int), np.random.default_rng(1).uniform(0, 99, (200, 2)), size)
    counters, cells, pairs = CounterChart(), CoverageChart(), PairMatrix()
    errors, course = ErrorChart(), ConvergenceChart()
    counters.show_counts(cameras, [150, 5])
    grid = cov.cells([dots])
    cells.show_cells(cameras, [grid, 0 * grid], [0 * grid, grid], ["good", "caution"])
    pairs.show_common(cameras, np.array([[200, 10], [10, 150]]))
    errors.show_errors(["x", "y"], np.array([0.01, -0.2]), np.array([0.05, 0.05]), [False, True])
    course.show_runs([[100.0, 10.0, 9.0], [5.0, 4.0]])
    c = theme.now()
    for chart, wanted in (
        (counters, {c.good, c.bad}),
        (cells, {c.good, c.accent}),
        (pairs, {c.bad}),
        (errors, {c.border}),
    ):
        qtbot.addWidget(chart)
        chart.resize(500, 400)
        chart.show()
        qtbot.waitExposed(chart)
        assert wanted <= colours_of(chart), type(chart).__name__
    errors.show_errors(["x", "y"], np.array([0.01, -0.2]), np.array([0.05, 0.05]), [False, True])  # as after a retake
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
    findings.show_advice([Advice("caution", "Few", "Few placements.", "Add one.", actions)])
    from PySide6.QtWidgets import QPushButton

    (button,) = findings.findChildren(QPushButton)
    with qtbot.waitSignal(findings.asked) as caught:
        button.click()
    assert caught.args == ["add placement", ""]
    findings.show_advice([])
    assert findings.shown == []


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
    view = make_scene_view()
    assert isinstance(view, Scene2D)
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


def test_where_opengl_fails_the_plain_view_takes_over(qtbot, monkeypatch):
    from spherecal_gui.widgets import scene

    def broken(*_):
        raise RuntimeError("no driver")

    monkeypatch.delenv("SPHERECAL_3D", raising=False)
    monkeypatch.setattr(scene, "Scene3D", broken)
    view = scene.make_scene_view()
    qtbot.addWidget(view)
    assert isinstance(view, Scene2D)


def test_guidance_is_drawn_when_there_is_some(qtbot):
    view = TopView()
    qtbot.addWidget(view)
    view.resize(300, 260)
    assert theme.now().good not in colours_of(view)
    view.show_guidance(
        Guidance(
            0.2, 0.05, ("C01",), np.array([[0.0, 500.0]]), ("P1",), np.array([[-200.0, 0.0]]), np.array([200.0, 0.0]),
            120.0, "C01", 400.0, 0.0, 45.0,
        )
    )  # fmt: skip
    assert "400 mm towards C01" in view.accessibleName()
    image = view.grab().toImage()
    found = {image.pixelColor(x, y).name() for x in range(300) for y in range(260)}
    assert {theme.now().good, theme.now().accent} <= found


def test_sounds_differ_and_can_be_muted():
    assert len({sounds.tone_bytes(kind) for kind in ("good", "bad", "done")}) == 3
    assert sounds.tone_bytes("good").startswith(b"RIFF")
    player = sounds.Sounds()
    player.muted = True
    assert not player.play("good")
