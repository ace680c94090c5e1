"""The program opens its window, says plainly why it cannot, and Qt's binding does not eat references."""

import gc
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication, QMessageBox, QWidget

from spherecal_gui import app

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A user who has never used the program."""
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    monkeypatch.setenv("SPHERECAL_PROJECTS", str(tmp_path / "projects"))
    return tmp_path


def test_the_window_opens_on_the_start_page(qapp, home):
    window = app.make_window()
    window.show()
    qapp.processEvents()
    assert window.isVisible()
    assert window.stack.currentWidget() is window.start
    assert not window.rail.isVisible()
    assert not window.grab().toImage().isNull()
    assert not window.start.verify.isEnabled()
    assert "No calibration is in use yet" in window.start.verify.toolTip()
    window.close()


def test_the_window_remembers_how_it_was(qapp, home):
    window = app.make_window()
    window.show()
    window.header.dark.setChecked(True)
    window.header.far.setChecked(True)
    window.resize(window.width(), 700)  # the screen of the offscreen platform is 800 px high
    window.close()
    again = app.make_window()
    assert again.header.dark.isChecked()
    assert again.header.far.isChecked()
    assert not again.header.mute.isChecked()
    assert again.height() == 700
    again.header.dark.setChecked(False)
    again.header.far.setChecked(False)
    again.close()


def test_closing_the_window_ends_the_program(home):
    closer = (
        "import sys; from PySide6.QtCore import QTimer; from spherecal_gui import app\n"
        "show = app.WizardWindow.show\n"
        "app.WizardWindow.show = lambda window: (show(window), QTimer.singleShot(50, window.close))\n"
        "sys.exit(app.main(['spherecal']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", closer], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr


def test_nothing_heavy_is_loaded_before_the_window_stands(home):
    """Importing pyvista, numba or pyqtgraph costs half a second each; the window must not wait for them."""
    code = (
        "import sys; from PySide6.QtWidgets import QApplication; from spherecal_gui import app\n"
        "a = QApplication(['x']); w = app.make_window(); w.show(); a.processEvents()\n"
        "heavy = {'pyvista', 'vtkmodules', 'numba', 'pyqtgraph', 'scipy', 'matplotlib', 'cv2'} & set(sys.modules)\n"
        "w.close(); print(sorted(heavy)); sys.exit(bool(heavy))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_project_is_begun_before_anything_heavy_is_loaded(home):
    """The first click: the window stood still for a second of imports. Those of the cameras are the worker's."""
    code = (
        "import sys; from pathlib import Path; from PySide6.QtWidgets import QApplication\n"
        "from spherecal_gui import app\n"
        "a = QApplication(['x']); w = app.make_window(Path(sys.argv[1])); w.show(); a.processEvents()\n"
        "w.controller.cameras.connect_all = lambda: None\n"
        "w.new_project('simulated:demo'); a.processEvents()\n"
        "heavy = {'pyvista', 'vtkmodules', 'numba', 'pyqtgraph', 'scipy', 'matplotlib', 'cv2'} & set(sys.modules)\n"
        "there = w.controller.project is not None and w.page is not None\n"
        "w.close(); print(there, sorted(heavy)); sys.exit(bool(heavy) or not there)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(home)], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_screen_is_said_plainly():
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")}
    if not sys.platform.startswith("linux"):
        pytest.skip("only on Linux can the screen be absent")
    command = [sys.executable, "-m", "spherecal_gui"]
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "no screen" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_error_nobody_caught_ends_in_one_dialog(qapp, monkeypatch, capsys):
    shown = []
    monkeypatch.setattr(QMessageBox, "exec", lambda box: shown.append((box.text(), box.detailedText())))
    hooks = app.Hooks()
    for text in ("first", "second"):
        try:
            raise ValueError(text)
        except ValueError as error:
            hooks._main(type(error), error, error.__traceback__)
    qapp.processEvents()
    assert "What was recorded is safe" in shown[0][0]
    assert "ValueError: first" in shown[0][1]
    assert "ValueError: first" in capsys.readouterr().err


def test_the_dialog_of_an_error_saves_a_support_bundle(qtbot, home):
    window = app.make_window(home / "projects")
    qtbot.addWidget(window)
    hooks = app.Hooks()
    hooks.save_bundle = window.save_bundle

    def press():
        box = QApplication.activeModalWidget()
        assert isinstance(box, QMessageBox)
        save = next(one for one in box.buttons() if one.text() == "Save a support bundle")
        assert save.isVisible()
        save.click()

    QTimer.singleShot(200, press)
    hooks._tell("ValueError: of this kind")
    (bundle,) = (home / "projects").glob("support-*.zip")
    with zipfile.ZipFile(bundle) as opened:
        assert "ValueError: of this kind" in opened.read("log.txt").decode()


def test_hooks_catch_what_qt_slots_and_threads_raise(qapp, monkeypatch):
    import threading

    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(threading, "excepthook", threading.excepthook)
    hooks = app.Hooks()
    hooks.install()
    assert sys.excepthook == hooks._main
    assert threading.excepthook == hooks._thread


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="None is immortal from Python 3.12 on")
def test_qt_returns_none_with_a_reference(qapp):
    """PySide6 6.12.0 took one reference from None per call, and the process aborted after some seconds."""
    assert isinstance(qapp, QApplication)
    widget = QWidget()
    gc.collect()  # a window of an earlier test, collected meanwhile, gives back some hundred references
    before = sys.getrefcount(None)
    for _ in range(1000):
        widget.update()
    assert abs(sys.getrefcount(None) - before) < 100
