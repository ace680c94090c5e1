"""A walk from the start page to the end by real clicks: each hits what lies under the mouse, wherever that is.

`installer/walk.py` does the same with an installed program under a window system; here its two foundations are tested
too: the map of buttons, and that it says that the window has answered.
"""

import json
import os
import time
from typing import Any

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QCheckBox, QPushButton, QWidget

from benchmarks.timed_window import WalkTimes
from installer.walk import GOES_ON_S
from spherecal_gui.click_map import ClickMap
from spherecal_gui.controllers.camera_controller import CameraController
from spherecal_gui.wizard.header import Footer
from spherecal_gui.wizard.window import WizardWindow
from tests.gui_walking import pump, settle

pytestmark = pytest.mark.usefixtures("images_at_rest")


class Hand:
    """Clicks buttons by their keys, where they are on the screen; `clicks` so far."""

    def __init__(self, window: WizardWindow) -> None:
        self.window, self.clicks = window, 0

    def button(self, key: str) -> QPushButton | None:
        """The button that is in sight and can be pressed."""
        found = [one for one in self.window.findChildren(QPushButton) if one.property("key") == key]
        return next((one for one in found if one.isVisible() and one.isEnabled()), None)

    def click(self, key: str) -> None:
        """Wait until it can be pressed, and press what lies at its middle."""
        pump(lambda: self.button(key) is not None and not (key == "action" and self.window.footer.is_quiet))
        one = self.button(key)
        assert one is not None
        at = one.mapTo(self.window, one.rect().center())
        assert self.window.childAt(at) is one, f"{key} is covered by {self.window.childAt(at)}"
        QTest.mouseClick(self.window.windowHandle(), Qt.MouseButton.LeftButton, pos=at)
        self.clicks += 1
        settle(self.window.controller)


@pytest.fixture
def hand(qtbot, home, monkeypatch):
    monkeypatch.setenv("SPHERECAL_3D", "2d")
    monkeypatch.setattr(CameraController, "live_hz", 4.0)
    window = WizardWindow(home / "projects")
    qtbot.addWidget(window)
    window.showNormal()
    window.resize(1280, 800)
    yield Hand(window)
    window.close()


@pytest.mark.slow
def test_a_walk_by_clicks_from_the_start_page_to_the_end(hand):
    window, controller = hand.window, hand.window.controller
    window.header.goes_on.setChecked(True)
    began = time.monotonic()
    hand.click("new-simulated")
    steps = []
    while controller.project.step != "save":
        step = controller.project.step
        steps.append(step)
        while controller.project.step == step and window.footer.default != "next":
            if step == "verify" and len(window.page.project.taken.keys() & set(window.page.pose_ids())) == 2:
                hand.click("measure-now")
            else:
                pump(lambda: window.footer.default in ("action", "next"))
                if window.footer.default == "action":
                    hand.click("action")
        until = time.monotonic() + GOES_ON_S
        while controller.project.step == step and time.monotonic() < until:
            pump(lambda until=until, step=step: controller.project.step != step or time.monotonic() > until)
        if controller.project.step == step:
            assert step == "verify", "what is there to be read is left by a click, and nothing else"
            hand.click("next")
        assert controller.project.step != step
    assert steps[:2] == ["connect", "look"] and steps[-3:] == ["calibrate", "results", "verify"]
    hand.click("action")  # save and put to use
    pump(lambda: window.page.action().does == "report")
    hand.click("action")
    pump(lambda: window.page.action().does == "finish")
    assert list(controller.project.folder.glob("report.pdf"))
    hand.click("action")
    assert controller.project is None and hand.button("check") is not None
    assert hand.clicks <= 20, "one for each thing that is done"
    print(f"{hand.clicks} clicks, {time.monotonic() - began:.0f} s")


def test_the_map_of_buttons_says_that_the_window_has_answered(qtbot, tmp_path):
    """Nothing changes on the screen, and yet somebody who waits for an answer gets one."""
    around = QWidget()
    one = QPushButton("Next", around)
    one.setProperty("key", "next")
    QCheckBox("Put it to use now", around)  # it has no key, and stood where the count is: the walk waited for ever
    qtbot.addWidget(around)
    around.show()
    file = tmp_path / "map.json"
    found = ClickMap(file)
    found._timer.stop()
    looks = []
    for _ in range(3):
        found.write()
        looks.append(json.loads(file.read_text()))
    assert looks[0]["next"] == looks[2]["next"] and looks[0]["next"][3] == "Next"
    assert looks[0][""][0] < looks[1][""][0] < looks[2][""][0]


def test_the_first_picture_is_told_though_the_last_page_has_no_scene(qtbot, tmp_path):
    """The figure was empty at the end of every walk: the report's page shows none."""
    around = QWidget()
    scene: Any = QWidget(around)
    scene.setObjectName("scene")
    qtbot.addWidget(around)
    around.show()
    times = WalkTimes(tmp_path / "times.json")
    QTest.mouseClick(around.windowHandle(), Qt.MouseButton.LeftButton)
    times.write()
    QTest.mouseClick(around.windowHandle(), Qt.MouseButton.LeftButton)
    scene.first_picture_s = 1.5
    scene.hide()
    times.write()
    found = json.loads((tmp_path / "times.json").read_text())
    assert (found["first picture of the scene, s"], found["clicks"]) == (1.5, 1)
    scene.deleteLater()
    qtbot.waitUntil(lambda: around.findChild(QWidget, "scene") is None)
    times.write()
    assert json.loads((tmp_path / "times.json").read_text())["first picture of the scene, s"] == 1.5


def test_the_walk_of_the_installer_waits_for_the_same_answer(tmp_path, monkeypatch):
    """`settle` of installer/walk.py stood for ever where the window did not change."""
    import sys

    from tests.conftest import ROOT

    monkeypatch.syspath_prepend(str(ROOT / "installer"))
    sys.modules.pop("walk", None)
    import walk  # type: ignore[import-not-found]

    monkeypatch.setattr(walk, "PATIENCE_S", 3.0)
    made: Any = walk.Walk.__new__(walk.Walk)
    made.folder, made.map = tmp_path, tmp_path / "map.json"
    made.process = type("Alive", (), {"poll": lambda _: None})()
    looks = iter(range(1, 1000))

    def tell() -> dict:
        return {"": [next(looks), 0, False, "", False], "next": [1, 2, True, "Next", False]}

    monkeypatch.setattr(made, "buttons", tell)
    made.settle()


def test_a_press_that_was_meant_for_something_else_is_not_heard(qtbot, tmp_path):
    """ "Cancel" ends as the finger comes down: the button is "Calibrate" by then, and must not begin anew."""
    from spherecal_gui.project import Project
    from spherecal_gui.standing import Button, Said, Standing
    from spherecal_gui.wizard.header import AFTER_CANCEL_S
    from spherecal_gui.workflow import Running, resolve

    footer = Footer()
    qtbot.addWidget(footer)
    footer.show()
    heard: list[bool] = []
    footer.acted.connect(lambda: heard.append(True))
    state = resolve(Project(tmp_path, "simulated:demo", step="calibrate"), Running())

    def show(text: str, does) -> None:
        footer.show_standing(Standing("none", "", "action", Said("none", "", Button(text, does))), state, False)

    show("Cancel", "cancel")
    qtbot.waitUntil(lambda: not footer.is_quiet)
    QTest.mousePress(footer.action, Qt.MouseButton.LeftButton)
    show("Calibrate", "calibrate")
    QTest.mouseRelease(footer.action, Qt.MouseButton.LeftButton)
    assert not heard and not footer.action.isEnabled()
    QTest.mouseClick(footer.action, Qt.MouseButton.LeftButton)
    assert not heard, "nor a second press at once"
    began = time.monotonic()
    qtbot.waitUntil(lambda: not footer.is_quiet)
    show("Calibrate", "calibrate")
    assert time.monotonic() - began < AFTER_CANCEL_S + 0.5
    QTest.mouseClick(footer.action, Qt.MouseButton.LeftButton)
    assert heard == [True], "after a second it may"
    show("See what to do", "results")
    QTest.mouseClick(footer.action, Qt.MouseButton.LeftButton)
    assert heard == [True], "350 ms of quiet after any change"
    qtbot.waitUntil(lambda: not footer.is_quiet)
    QTest.mouseClick(footer.action, Qt.MouseButton.LeftButton)
    assert heard == [True, True]


def test_the_map_tells_when_a_press_is_heard(qtbot, tmp_path):
    """A driver pressed "The images are good" on a new page: that was not heard, and it waited for ever."""
    from spherecal_gui.project import Project
    from spherecal_gui.standing import Button, Said, Standing
    from spherecal_gui.workflow import Running, resolve

    footer = Footer()
    qtbot.addWidget(footer)
    footer.show()
    file = tmp_path / "map.json"
    found = ClickMap(file)
    found._timer.stop()
    said = Said("none", "", Button("Calibrate", "calibrate"))
    state = resolve(Project(tmp_path, "simulated:demo", step="calibrate"), Running())
    footer.show_standing(Standing("none", "", "action", said), state, False)
    found.write()
    assert footer.is_quiet and footer.action.isEnabled()
    assert not json.loads(file.read_text())["action"][2]
    qtbot.waitUntil(lambda: not footer.is_quiet)
    found.write()
    assert json.loads(file.read_text())["action"][2]
