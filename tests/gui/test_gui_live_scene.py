"""The live scene: cameras, ball and bar in space on the pages before the calibration."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtWidgets import QApplication

from spherecal_gui.coverage import same_place
from spherecal_gui.pages.bars_page import ScalePage
from spherecal_gui.pages.connect_page import ConnectPage
from spherecal_gui.pages.live_page import LookPage
from spherecal_gui.wizard.window import WizardWindow
from tests.gui_walking import pump, settle

pytestmark = pytest.mark.usefixtures("images_at_rest")
NAMES = {f"C0{number}" for number in range(1, 7)}


@pytest.fixture
def window(qapp: QApplication, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[WizardWindow]:
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    monkeypatch.setenv("SPHERECAL_3D", "2d")
    made = WizardWindow(tmp_path / "projects")
    made.showNormal()
    made.new_project("simulated:demo")
    settle(made.controller)
    yield made
    made.close()


def test_cameras_and_ball_are_in_space_before_anything_was_captured(window: WizardWindow) -> None:
    """By the ball in sight alone; six cameras on a ring, the ball of nominal size below them."""
    page, controller = window.page, window.controller
    assert isinstance(page, ConnectPage) and page.space.view.isHidden()
    pump(lambda: controller.advice.known is not None and set(controller.advice.known.cameras) == NAMES)
    view = page.space.view
    pump(lambda: view.isVisible() and view.live.ball is not None and {c.id for c in view.data.scene.cameras} == NAMES)
    data, live = view.data, view.live
    assert data is not None and live.ball is not None and set(live.images) == NAMES
    assert set(live.levels) == NAMES and not data.scene.placements, "the ball is drawn where it lies now, once"
    places = data.every_place()
    low, high = places.min(axis=0), places.max(axis=0)
    assert (live.ball[0] > low).all() and (live.ball[0] < high).all(), "the ball is in the picture"
    truth = controller.cameras.connection.source.stage.truth  # type: ignore[union-attr]
    own = {camera.id: camera.centre_mm for camera in truth.cameras}
    there = {camera.id: camera.centre for camera in data.scene.cameras}
    true, found = (
        np.array([np.linalg.norm(where[a] - where[b]) for a in sorted(NAMES) for b in sorted(NAMES) if a < b])
        for where in (own, there)
    )
    assert np.abs(found / true - 1).max() < 0.05, "to some per cent, by the print of the targets"
    controller.recording.confirm_bench()
    settle(controller)
    controller.go("look")
    assert isinstance(window.page, LookPage)
    view = window.page.space.view
    pump(lambda: view.isVisible() and view.live.ball is not None)
    versions = []
    view.scene_changed = lambda: versions.append(1)  # type: ignore[method-assign]
    window.header.dark.setChecked(not window.header.dark.isChecked())
    assert versions, "it is drawn in the new colours: it stayed dark on a light page"


def test_the_bar_lies_in_space_on_its_page(window: WizardWindow) -> None:
    controller = window.controller
    controller.recording.confirm_bench()
    controller.cameras.accept_look()
    assert controller.project is not None
    controller.go("placement:P1")
    controller.sets.take("P1", "placement:P1")
    settle(controller)
    pump(lambda: controller.advice.guidance is not None)
    controller.go("scale")
    page = window.page
    assert isinstance(page, ScalePage) and page.space is not None
    view = page.space.view
    pump(lambda: view.isVisible() and bool(view.live.bars))
    ends, lying = view.live.bars[0]
    assert lying and view.live.ball is None
    length = float(np.linalg.norm(ends[1] - ends[0]))  # from the outer dots of one mark to those of the other
    assert 0.97 * 500 < length < 1.03 * (500 + 28), length


def test_the_scale_bar_is_captured_by_itself_once_it_was_moved_and_lies_still(window: WizardWindow) -> None:
    """Two poses without a press; the second only after the bar was turned (the training does so)."""
    controller = window.controller
    controller.recording.confirm_bench()
    controller.cameras.accept_look()
    controller.go("scale")
    page = window.page
    assert isinstance(page, ScalePage) and page.by_itself is not None
    pump(lambda: page.said().level == "good")
    page.by_itself.setChecked(True)
    poses = page.pose_ids()
    pump(lambda: controller.project is not None and set(poses) <= set(controller.project.taken))
    settle(controller)
    first, second = (controller.recording.dots[pose] for pose in poses)
    assert not same_place(first, second), "it was not captured twice as it lay"
