"""The keyboard: the space bar is the page's, on every page but the start page, and only once the page was seen."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import cast

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QCoreApplication, QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QTabWidget, QWidget

from spherecal_gui.controllers.camera_controller import CameraController
from spherecal_gui.project import Project
from spherecal_gui.project_folder import load_project, save_project
from spherecal_gui.wizard.keys import SEEN_S, Guard
from spherecal_gui.wizard.window import WizardWindow
from tests.conftest import ROOT
from tests.gui_walking import settle

pytestmark = pytest.mark.usefixtures("images_at_rest", "no_advice")


def test_a_page_that_was_not_seen_for_a_second_is_not_acted_on():
    now = [10.0]
    guard = Guard(lambda: now[0])
    guard.enter("connect")
    now[0] += SEEN_S / 2
    assert not guard.allows()
    now[0] += SEEN_S
    assert guard.allows() and guard.allows(), "a press that did nothing keeps nobody waiting"
    guard.enter("connect")
    assert guard.allows(), "it is the same page"
    guard.acted()
    assert not guard.allows(), "two presses within a second are one"
    now[0] += SEEN_S
    assert guard.allows()
    guard.enter("look")
    assert not guard.allows(), "a second press so soon was meant for the page before"
    now[0] += SEEN_S
    assert guard.allows()


@pytest.fixture
def window(qtbot, home):
    made = WizardWindow(home / "projects")
    qtbot.addWidget(made)
    made.controller.cameras.live_hz = 1.0
    made.show()
    made.activateWindow()
    made.guard = Guard(lambda: time.monotonic() + 1e6)
    yield made
    made.close()


def space(window: WizardWindow, focus=None) -> None:
    """As the system sends it: to the window, which hands it to the widget that has the focus."""
    QCoreApplication.processEvents()
    (focus or window).setFocus(Qt.FocusReason.TabFocusReason)
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Space)
    QCoreApplication.processEvents()


def test_nothing_happens_on_the_start_page(window):
    dark = window.header.dark.isChecked()
    for one in (window.start.training, window.header.more, window):
        space(window, one)
        assert window.controller.project is None and window.header.dark.isChecked() == dark


def test_space_on_an_option_or_in_the_header_is_the_pages(window, monkeypatch):
    window.new_project("simulated:nonsense")
    settle(window.controller)
    pressed = []
    monkeypatch.setattr(window, "advance", lambda: pressed.append(1))
    window.guard = Guard(lambda: 1e9)
    space(window, window.header.home)
    assert window.controller.project is not None and pressed == [1]
    space(window, window)
    assert pressed == [1, 1]
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Return)
    assert pressed == [1, 1], "Enter is not the page's"


def test_enter_presses_the_button_that_has_the_focus(window):
    window.new_project("simulated:nonsense")
    settle(window.controller)
    QCoreApplication.processEvents()
    window.header.home.setFocus(Qt.FocusReason.TabFocusReason)
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Return)
    assert window.controller.project is None


def test_an_opening_that_failed_leaves_no_project_behind(window, home):
    window.new_project("simulated:nonsense")
    settle(window.controller)
    folder = window.controller.project.folder
    assert folder.is_dir()
    window.show_start()
    assert not folder.exists()
    kept = home / "projects" / "kept"
    save_project(Project(kept, "simulated:nonsense"))
    window.open_project(str(kept))
    settle(window.controller)
    window.show_start()
    assert (kept / "wizard.json").is_file(), "what was there before stays"


@pytest.fixture
def finished(qtbot, home, walked, monkeypatch) -> Iterator[WizardWindow]:
    """A window on a project of which everything but the last step is done: space goes on."""
    monkeypatch.setattr(CameraController, "live_hz", 1.0)
    folder = home / "projects" / walked.name
    shutil.copytree(walked, folder)
    save_project(replace(load_project(folder), saved=None, step="placement:P1"))
    made = WizardWindow(home / "projects")
    qtbot.addWidget(made)
    made.showNormal()
    made.resize(1280, 800)
    made.open_project(str(folder))
    for _ in range(2):
        settle(made.controller)
    made.activateWindow()
    qtbot.waitActive(made)
    qtbot.waitUntil(made.isActiveWindow)
    yield made
    made.close()


def click(window: WizardWindow, at: QWidget, where: QPoint | None = None) -> None:
    """As the system sends it: to the window, which gives the focus where a click does."""
    QCoreApplication.processEvents()
    spot = at.mapTo(window, where or at.rect().center())
    QTest.mouseClick(window.windowHandle(), Qt.MouseButton.LeftButton, pos=spot)
    QCoreApplication.processEvents()


def click_tab(window: WizardWindow, tabs: QTabWidget, index: int) -> None:
    click(window, tabs.tabBar(), tabs.tabBar().tabRect(index).center())
    assert tabs.currentIndex() == index


def press_after_a_click(window: WizardWindow) -> str:
    """The step to which space leads, once the page was seen for a second; the large button had the focus."""
    assert window.focusWidget() is window.footer.next and window.footer.default == "next"
    window.guard.acted()
    now = window.guard._clock()
    window.guard._clock = lambda: now + 2 * SEEN_S
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Space)
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Space)
    QCoreApplication.processEvents()
    window.guard._clock = time.monotonic
    return window.controller.state.current


def test_after_a_click_on_an_option_the_large_button_has_the_focus(finished):
    """And the second of two quick presses does nothing on the page to which the first led."""
    window = finished
    automatic = window.page.automatic
    click(window, automatic, QPoint(10, automatic.height() // 2))
    assert automatic.isChecked()
    click(window, automatic, QPoint(10, automatic.height() // 2))
    assert not automatic.isChecked()
    assert press_after_a_click(window) == "placement:P2"
    click_tab(window, window.page.tabs, 1)
    assert press_after_a_click(window) == "placement:P3"
    window.controller.go("results")
    click_tab(window, window.page.tabs, 1)
    assert press_after_a_click(window) == "verify"
    click(window, window.header.help)
    shown = QApplication.activeWindow()
    assert shown is not window and shown is not None
    shown.close()
    window.activateWindow()  # as a window manager does
    QCoreApplication.processEvents()
    assert press_after_a_click(window) == "save"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGTERM")
def test_sigterm_closes_the_window(home):
    code = "import sys; from spherecal_gui import app; sys.exit(app.main(['spherecal', '--projects', sys.argv[1]]))"
    child = subprocess.Popen(
        [sys.executable, "-c", "import faulthandler\n" + code, str(home / "projects")],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
    )
    with child:
        time.sleep(0.5)
        until = time.monotonic() + 60
        while child.poll() is None and time.monotonic() < until:
            # sent until the handler stands: before that the program ends by it too, with another code
            if _is_shown(child.pid):
                child.send_signal(signal.SIGTERM)
                break
            time.sleep(0.2)
        assert child.wait(60) == 0


def _is_shown(pid: int) -> bool:
    """Whether the program handles the signal by now."""
    try:
        with open(f"/proc/{pid}/status", encoding="ascii") as status:
            caught = next(line for line in status if line.startswith("SigCgt"))
    except OSError:
        return False
    return bool(int(caught.split()[1], 16) & (1 << (signal.SIGTERM - 1)))


def test_the_window_goes_on_from_a_step_that_was_done_while_it_was_looked_at():
    """A second after it was done well; never from one that was gone back to, that is flawed, or there to be read."""
    from spherecal_gui.standing import Default, Level, Standing
    from spherecal_gui.wizard.keys import Onward
    from spherecal_gui.workflow import Step, StepKind

    now = [0.0]

    def goes(*seen: tuple[str, str], kind: StepKind = "placement") -> bool:
        onward, went = Onward(lambda: now[0]), False
        for default, level in seen:
            went = onward.feed(Step("a", kind), Standing(cast("Level", level), "", cast("Default", default)))
            now[0] += SEEN_S / 2
        return went

    doing, done = ("action", "good"), ("next", "good")
    assert goes(doing, done, done, done)
    assert not goes(doing, done, done), "it was in sight for half a second"
    assert not goes(done, done, done, done), "somebody went back to it"
    assert not goes(doing, ("next", "caution"), ("next", "caution"), ("next", "caution"))
    assert not goes(doing, done, doing, done, done), "it was undone meanwhile"
    assert not goes(doing, done, done, done, kind="verify")
    onward = Onward(lambda: now[0])
    onward.feed(Step("a", "look"), Standing("good", "", "action"))
    assert not onward.feed(Step("b", "look"), Standing("good", "", "next")), "another step begins anew"


def test_the_window_goes_on_by_itself_from_connect_to_the_images(tmp_path, monkeypatch, qapp):
    """One click confirms the bench; the option in the menu turns it off."""
    from spherecal_gui.wizard.frame import WindowFrame
    from tests.gui_walking import pump, settle

    monkeypatch.setattr(WindowFrame, "goes_on_at_first", True)
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    window = WizardWindow(tmp_path / "projects")
    try:
        window.show()
        window.new_project("simulated:demo")
        settle(window.controller)

        def step() -> str:
            return window.controller.project.step if window.controller.project is not None else ""

        assert step() == "connect"
        pump(lambda: window.footer.action.isEnabled() and not window.footer.is_quiet)
        window.footer.action.click()
        pump(lambda: step() == "look")
        window.header.goes_on.setChecked(False)
        again = WizardWindow(tmp_path / "projects")
        assert not again.header.goes_on.isChecked(), "it is remembered"
        again.close()
    finally:
        window.close()
