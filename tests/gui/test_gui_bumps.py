"""A camera that is moved while the ball lies still is told from a ball that is moved."""

import os
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from spherecal.targets.detection import Detector
from spherecal.targets.target_set import TargetSet
from spherecal_cameras.simulated.simulated_source import SimulatedFault, SimulatedSource
from spherecal_gui.pages.live_page import LookPage
from spherecal_gui.presenters.look_presenter import bump_text, tile_state
from spherecal_gui.tasks.live_detection import BUMP_PX, BumpWatch, LiveView
from spherecal_gui.wizard.window import WizardWindow
from tests.gui_walking import at_rest, pump, settle

CAMERAS = ("A", "B", "C", "D")


class Scene:
    """Four cameras that look at 40 dots each; every round brings one image of each."""

    def __init__(self) -> None:
        self.watch = BumpWatch()
        self.rng = np.random.default_rng(7)
        self.at = {name: np.zeros(2) for name in CAMERAS}
        self.places = self.rng.uniform(0, 1000, (40, 2))
        self.clock = 0.0
        self.rounds(6)

    def rounds(self, count: int, *cameras: str) -> None:
        for _ in range(count):
            for name in cameras or CAMERAS:
                self.clock += 0.1
                noisy = self.places + self.at[name] + self.rng.normal(0, 0.05, self.places.shape)
                self.watch.feed(name, np.arange(40) // 8, np.arange(40) % 8, noisy, self.clock)


def test_the_camera_that_moves_alone_was_bumped_and_stays_named_until_it_is_fixed():
    scene = Scene()
    assert scene.watch.bumped == {}
    scene.at["C"] = np.array([3.0, 4.0])
    scene.rounds(3)
    assert scene.watch.bumped == {"C": pytest.approx(5.0, abs=0.2)}
    for name in CAMERAS:  # then the ball goes to its next place
        scene.at[name] = scene.at[name] + np.array([80.0, 20.0])
    scene.rounds(8)
    scene.watch.forget_scene()
    scene.rounds(8)
    assert set(scene.watch.bumped) == {"C"}
    scene.watch.forgive()
    scene.rounds(8)
    assert scene.watch.bumped == {}


def test_a_camera_that_is_put_back_is_no_longer_named():
    scene = Scene()
    scene.at["A"] = np.array([-6.0, 0.0])
    scene.rounds(3)
    assert set(scene.watch.bumped) == {"A"}
    scene.at["A"] = np.zeros(2)
    scene.rounds(1)
    assert scene.watch.bumped == {}


@pytest.mark.parametrize("nudge_px", [BUMP_PX * 1.2, 4.0, 200.0])
def test_a_ball_that_moves_is_no_bump(nudge_px):
    """Even where one camera sees it long before the others, and two see next to nothing of it."""
    scene = Scene()
    scene.at["B"] = np.array([nudge_px, 0.0])
    scene.rounds(4, "B")
    scene.at |= {name: np.array([0.4 * nudge_px, 0.0]) for name in ("A", "C")}
    scene.rounds(12)
    assert scene.watch.bumped == {}


def test_two_cameras_say_nothing_about_who_moved():
    watch, dots = BumpWatch(), np.arange(30)
    for k in range(9):
        for i, name in enumerate(("A", "B")):
            uv = np.stack([dots, dots], axis=1).astype(float) * 10.0 + (9.0 if name == "A" and k > 4 else 0.0)
            watch.feed(name, dots, np.zeros(30, int), uv, k + 0.1 * i)
    assert watch.bumped == {}


def test_an_image_of_the_scene_before_is_no_bump():
    """Drawn before the bar was laid anew, there after it: one camera's dots would be 686 px from where they were."""
    source = SimulatedSource("demo")
    serials = [f"SIM-C0{i}" for i in range(1, 5)]
    source.open(serials, {})
    try:
        infos = tuple(SimpleNamespace(serial=serial, entry={}) for serial in serials)
        connection: Any = SimpleNamespace(source=source, cameras=infos, detector=lambda: Detector(targets(source)))
        live = LiveView(connection)
        source.show("P1")
        before = source.capture_set().frames
        source.show("P2")
        live.forget()
        after = source.capture_set().frames
        late = dict(after) | {"SIM-C02": before["SIM-C02"]}  # under load it came when the others showed the new scene
        for k, frames in enumerate((late, late, after, after, after)):
            for serial in serials:
                moved_s = 2.0 * k  # longer than the watch waits for images that are older
                old = frames[serial] is before["SIM-C02"]
                frame = frames[serial]
                taken_s = frame.taken_s if old else frame.taken_s + moved_s
                live._examine(serial, replace(frame, taken_s=taken_s, arrived_s=after[serial].arrived_s + moved_s))
        assert {"SIM-C01", "SIM-C03", "SIM-C04"} <= set(live.watch._seen), "the others are watched"
        assert live.watch.bumped == {}
    finally:
        source.close()


def targets(source: SimulatedSource) -> TargetSet:
    assert source.stage.session.target_set is not None
    return source.stage.session.target_set


def test_the_tile_and_the_message_name_it():
    class Sight:
        dots = np.zeros(5)

    sight: Any = Sight()
    state = tile_state("C03", None, sight, bumped_px=12.3)
    assert (state.level, state.word) == ("bad", "moved by 12 px, alone. Is it fixed?")
    what, todo = bump_text({"C03": 12.3})
    assert what == "Only C03 moved (12 px)."
    assert bump_text({"C03": 12.3, "C04": 5.0})[0] == "Only these moved: C03 (12 px), C04 (5 px)."
    assert todo.startswith("Tighten its mount") and "Retake" in todo


@pytest.mark.slow
@pytest.mark.usefixtures("images_at_rest")
def test_a_bump_on_the_wall_is_said_at_once(qtbot, tmp_path, monkeypatch):
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    window = WizardWindow(tmp_path / "projects")
    qtbot.addWidget(window)
    window.controller.cameras.live_hz = 10.0
    window.show()
    window.new_project("simulated:demo")
    controller = window.controller
    settle(controller)
    controller.recording.confirm_bench()
    controller.go("look")
    page = window.page
    assert isinstance(page, LookPage)
    pump(lambda: "sharp, dots found" in page.summary.text())
    assert page.fixed.isHidden()
    pump(lambda: at_rest(controller))
    source = controller.cameras.connection.source
    assert isinstance(source, SimulatedSource)
    source.inject(SimulatedFault("bump", "C03"))
    pump(lambda: page.summary.text().startswith("C03 was moved."))
    assert window.banner.isHidden(), "the page says it"
    pump(lambda: window.rail.item("look").level == "bad")
    assert window.footer.default == "", "red never goes on by itself"
    assert "moved by" in page.wall.tiles["SIM-C03"].state.word
    page.fixed.click()
    pump(lambda: "sharp, dots found" in page.summary.text())
    assert page.fixed.isHidden()
    window.close()
