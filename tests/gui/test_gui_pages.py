"""Pages, widgets and keys, with pytest-qt and without cameras that take long."""

import os
import shutil
import threading
import time
from dataclasses import replace

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QFileDialog

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal_gui import theme
from spherecal_gui.project import Project
from spherecal_gui.project_folder import save_project
from spherecal_gui.tasks.task import Runner
from spherecal_gui.widgets.basic import enable
from spherecal_gui.wizard.window import WizardWindow


@pytest.fixture
def window(qtbot, home):
    """An empty wizard on the start page."""
    made = WizardWindow(home / "projects")
    qtbot.addWidget(made)
    made.show()
    yield made
    made.close()


# --- look ------------------------------------------------------------------------------------------------------------


def contrast(first: str, second: str) -> float:
    """The contrast of two colours by WCAG 2."""

    def light(name: str) -> float:
        color = QColor(name)
        parts = [part / 255 for part in (color.red(), color.green(), color.blue())]
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
    assert window.page.summary.text() == "This folder contains no recording."
    assert "session.json" in window.page.why.text()


def test_instead_of_a_damaged_recording_another_can_be_chosen(qtbot, window, tmp_path, monkeypatch):
    (tmp_path / "session.json").write_text('{"format": "spherecal/session", "version": 1, "cam')
    window.new_project(f"replay:{tmp_path}")
    qtbot.waitUntil(lambda: window.controller.runner.running is None, timeout=20_000)
    page = window.page
    assert page.summary.text() == "This recording is damaged." and "not valid JSON" in page.why.text()
    assert page.other.text() == "Choose another" and page.other.isVisible() and not page.again.isVisible()
    asked = []
    chosen = tmp_path / "other"
    chosen.mkdir()
    (chosen / "session.json").write_text("{}")
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *_: asked.append(1) or str(chosen))
    page.other.click()
    qtbot.waitUntil(lambda: window.controller.runner.running is None, timeout=20_000)
    assert asked == [1] and window.controller.project.source == f"replay:{chosen}"


def test_connect_shows_the_cameras_images_and_the_bench_to_scale(qtbot, window):
    window.new_project("simulated:demo")
    qtbot.waitUntil(lambda: window.controller.runner.running is None, timeout=60_000)
    pictures = window.page.pictures()
    assert len(pictures) == 6
    qtbot.waitUntil(lambda: all(one.image is not None for one in pictures), timeout=60_000)
    shown = window.page.drawn._shown
    assert (shown.diameter_mm, shown.targets) == (500.0, 200)
    assert [name for name, _ in shown.bars] == ["A", "B"]
    lengths = {bar.id: {one.length_mm for one in bar.lengths} for bar in window.controller.cameras.connection.plan.bars}
    for name, marks in shown.bars:
        between = {abs(a - b) for a in marks for b in marks}
        assert all(min(abs(one - d) for d in between) < 1e-6 for one in lengths[name]), "every length is there"


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
    assert line.where == "0 of 4 placements captured"
    assert line.source == "SIMULATED"


def test_help_is_there_for_every_step(qtbot, window):
    from spherecal.base.resources import resource_path

    for kind in ("start", "connect", "look", "placement", "scale", "calibrate", "results", "verify", "save", "measure"):
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
        qtbot.waitUntil(lambda made=made: made.controller.cameras.connection is not None, timeout=60_000)
        made.controller.recording.confirm_bench()
        made.controller.cameras.accept_look()
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
    page.training.click()
    faults = next(one.menu() for one in window.header.menu.actions() if one.menu() and "Train" in one.text()).actions()
    for row in (1, -1):
        faults[row].trigger()
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
            context.report_iteration("bundle adjustment", 0.1, i, 1.0)
        go.wait(10)

    runner.start("x", works, lambda _: None, lambda _: None)
    assert runner.task is not None
    task, news = runner.task, []
    qtbot.waitUntil(lambda: news.extend(task.take_news()) or len(news) >= 4, timeout=10_000)
    assert len(news) < 60
    assert [(one.iteration, one.message) for one in news if one.iteration is not None] == [
        (i, f"iteration {i}, cost 1") for i in range(3)
    ]
    go.set()
    qtbot.waitUntil(lambda: runner.running is None, timeout=10_000)


EVIL = '<img src="/dev/zero">'


def taken_for_html(widgets) -> list[str]:
    """What of these widgets Qt would draw as HTML although it came from outside."""
    from PySide6.QtWidgets import QLabel, QMessageBox

    found = []
    for one in widgets:
        texts = [one.toolTip(), one.whatsThis(), one.statusTip()]
        if isinstance(one, QMessageBox):
            texts += [one.informativeText()]
        if isinstance(one, QLabel) and one.textFormat() != Qt.TextFormat.PlainText:
            texts.append(one.text())
        found += [f"{type(one).__name__} {one.objectName()}: {text}" for text in texts if "<img" in text]
    return found


def test_texts_from_outside_are_never_taken_for_html(qtbot, window, tmp_path):
    """A model or serial number with HTML would have the window read files, and on Windows send passwords."""
    import json

    from PySide6.QtWidgets import QApplication, QLabel

    from spherecal_sim.render_session import demo_session

    session = tmp_path / "session"
    shutil.copytree(demo_session(), session)
    document = json.loads((session / "session.json").read_text())
    for number, camera in enumerate(document["cameras"]):
        camera["model"], camera["serial"] = EVIL, f"{number}{EVIL}"
    (session / "session.json").write_text(json.dumps(document))
    window.new_project(f"replay:{session}")
    qtbot.waitUntil(lambda: window.controller.runner.running is None, timeout=60_000)
    seen = []
    for step in window.controller.state.steps:
        window._show_step(step.step)
        window.page.refresh()
        QApplication.processEvents()
        widgets = QApplication.allWidgets()
        assert taken_for_html(widgets) == []
        seen += [one.text() for one in widgets if isinstance(one, QLabel) and EVIL in one.text()]
    assert seen, "the texts are shown somewhere"


def test_what_a_bundle_would_hold_is_shown_before_it_is_written(qtbot, window, home):
    save_project(Project(home / "projects" / "one", "simulated:demo"))
    window.open_project(str(home / "projects" / "one"))
    box = window.offer_bundle()
    assert "project/wizard.json" in box.detailedText() and "Replaced" in box.informativeText()
    assert not list((home / "projects").glob("support-*.zip"))
    next(one for one in box.buttons() if one.property("key") == "bundle-save").click()
    qtbot.waitUntil(lambda: bool(list((home / "projects").glob("support-*.zip"))), timeout=10_000)


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
def test_a_project_that_another_window_has_open_is_left_alone(qtbot, window, home):
    import subprocess
    import sys

    folder = home / "projects" / "one"
    save_project(Project(folder, "simulated:nonsense"))
    code = (
        "import sys, time; from pathlib import Path; from spherecal_files.lock import locked\n"
        "with locked(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
    )
    other = subprocess.Popen([sys.executable, "-c", code, str(folder / "wizard.json")], stdout=subprocess.PIPE)
    assert other.stdout is not None
    other.stdout.readline()
    window.open_project(str(folder))
    assert window.controller.project is None and f"process {other.pid}" in window.banner.text
    other.kill()
    other.wait()
    window.open_project(str(folder))
    assert window.controller.project is not None
    qtbot.waitUntil(lambda: window.controller.runner.running is None, timeout=20_000)
    window.controller.close_project()
    assert sorted(path.name for path in folder.iterdir()) == ["wizard.json"]
