"""The window opens, says what works today, and Qt's binding does not eat references."""

import os
import subprocess
import sys

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

try:
    from PySide6.QtWidgets import QApplication, QLabel, QWidget

    from spherecal_gui import app
except ImportError as error:
    pytest.skip(f"Qt cannot be loaded here: {error}", allow_module_level=True)


@pytest.fixture(scope="module")
def application() -> QApplication:
    instance = QApplication.instance()
    return instance if isinstance(instance, QApplication) else QApplication(["spherecal"])


def test_window_says_what_works(application):
    window = app.make_window()
    window.show()
    application.processEvents()
    assert window.isVisible()
    assert not window.grab().toImage().isNull()
    text = window.centralWidget()
    assert isinstance(text, QLabel)
    assert "wizard is not part" in text.text()
    for command in app.COMMANDS:
        assert command in text.text()
    window.close()


def test_closing_the_window_ends_the_program():
    closer = (
        "import sys; from PySide6.QtCore import QTimer; from spherecal_gui import app\n"
        "show = app.QMainWindow.show\n"
        "app.QMainWindow.show = lambda window: (show(window), QTimer.singleShot(50, window.close))\n"
        "sys.exit(app.main(['spherecal']))"
    )
    done = subprocess.run([sys.executable, "-c", closer], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


def test_no_screen_is_said_plainly():
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")}
    if not sys.platform.startswith("linux"):
        pytest.skip("only on Linux can the screen be absent")
    command = [sys.executable, "-m", "spherecal_gui"]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "no screen" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="None is immortal from Python 3.12 on")
def test_qt_returns_none_with_a_reference(application):
    """PySide6 6.12.0 took one reference from None per call, and the process aborted after some seconds."""
    widget = QWidget()
    before = sys.getrefcount(None)
    for _ in range(1000):
        widget.update()
    assert abs(sys.getrefcount(None) - before) < 100
