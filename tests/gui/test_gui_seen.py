"""Faults that were seen at the window: one test for each, and that its kind is mended."""

import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtWidgets import QLabel, QPushButton

from spherecal_cameras.protocol import CameraState, CameraStatus, Counters
from spherecal_cameras.simulated.simulated_source import SimulatedFault
from spherecal_gui.controllers import project_controller
from spherecal_gui.controllers.camera_controller import CameraController
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import moved_text, reason_text, status_word
from spherecal_gui.pages import wizard_page
from spherecal_gui.pages.images_dialogs import ImportDialog
from spherecal_gui.pages.placement_page import PlacementPage
from spherecal_gui.pages.verify_page import VerifyPage
from spherecal_gui.presenters.connect_presenter import connect_summary
from spherecal_gui.presenters.drivers_presenter import DriverNote
from spherecal_gui.presenters.look_presenter import summary, tile_state
from spherecal_gui.presenters.results_presenter import FindingAdvice
from spherecal_gui.presenters.start_presenter import project_lines
from spherecal_gui.presenters.step_states import ResultFacts, SaveFacts, results_says, save_says
from spherecal_gui.project import Project
from spherecal_gui.project_folder import is_project, load_project
from spherecal_gui.rig_scenes import GuidanceView
from spherecal_gui.standing import Part
from spherecal_gui.tasks.ghost import Ghost, LastBall, Lenses, Lying
from spherecal_gui.widgets.connect_views import Thumbnail
from spherecal_gui.widgets.results_views import FindingsList
from spherecal_gui.widgets.verification_view import VerificationView
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Reason, Running, Status, Step, StepState, resolve
from tests.gui_walking import begun, pump, settle, take, words_shown

pytestmark = pytest.mark.usefixtures("images_at_rest", "no_advice")


@pytest.fixture
def window(qtbot, home, monkeypatch) -> Iterator[Any]:
    monkeypatch.setattr(CameraController, "live_hz", 4.0)
    made = WizardWindow(home / "projects")
    qtbot.addWidget(made)
    made.showNormal()
    made.resize(1280, 800)
    yield made
    made.close()


def at_placement(window: Any) -> Any:
    """Its cameras are connected and looked at; nothing is captured."""
    window.new_project("simulated:demo")
    controller = window.controller
    settle(controller)
    controller.recording.confirm_bench()
    settle(controller)
    controller.cameras.accept_look()
    controller.go("placement:P1")
    return controller


def button(window: WizardWindow, key: str) -> QPushButton:
    assert window.page is not None
    return next(one for one in window.page.findChildren(QPushButton) if one.property("key") == key)


# 2: an enlarged camera


def test_a_camera_enlarged_in_one_project_is_not_enlarged_in_the_next(window):
    controller = at_placement(window)
    controller.go("look")
    wall = window.page.wall
    wall.zoom(next(iter(wall.tiles)))
    assert wall.alone is not None
    window.new_project("simulated:demo")
    settle(controller)
    controller.recording.confirm_bench()
    controller.go("look")
    assert window.page.wall is not wall and window.page.wall.alone is None
    assert not any(tile.isHidden() for tile in window.page.wall.tiles.values())


# 3: an empty placement


def test_next_does_not_pass_over_an_empty_placement(window):
    controller = at_placement(window)
    window.page.tick()
    assert not window.footer.next.isEnabled() and "captured" in window.footer.next.toolTip()
    window.go_next()
    assert controller.project.step == "placement:P1", "nor by the keyboard"
    assert button(window, "skip").isVisible()
    assert status_word(Status.READY, "placement") == "not captured"
    assert "not captured" in window.rail.item("placement:P2").accessibleName()
    button(window, "skip").click()
    assert "P1" not in controller.project.placements


# 4: the project's folder is gone


def test_a_project_whose_folder_is_gone_says_so_and_writes_nothing(window):
    controller = at_placement(window)
    take(controller, "P1")
    folder = controller.project.folder
    shutil.rmtree(folder)
    assert not controller.sets.take("P2", "placement:P2")
    settle(controller)
    assert not folder.exists(), "it is not made anew with one placement in it"
    state = controller.state
    assert all(one.status is Status.FAILED for one in state.steps)
    assert "gone" in reason_text(state.now.reason)
    window.page.show_standing()
    assert folder.name in window.page.headline.text() and window.page.action() is None
    assert window.footer.default == "" and not window.footer.next.isEnabled()
    controller.cameras.accept_look()
    assert not is_project(folder)
    assert [line.folder for line in project_lines(window.projects) if line.folder == folder] == []


def test_a_folder_that_goes_while_images_are_taken_is_not_made_anew(window):
    controller = at_placement(window)
    folder = controller.project.folder
    said = []
    controller.said.connect(lambda *one: said.append(one))
    assert controller.sets.take("P1", "placement:P1")
    shutil.rmtree(folder)
    settle(controller)
    assert any("gone" in one[1] for one in said) and "P1" not in controller.project.taken
    assert not is_project(folder)


# 5: one advice


def test_advice_does_not_change_while_the_ball_is_carried_to_it():
    controller = Controller()
    lenses = Lenses(("C01",), np.zeros((1, 16)), np.eye(3)[None], np.zeros((1, 3)), np.full((1, 2), 1000.0))
    body = LastBall(np.arange(3), np.zeros((3, 3)), np.zeros(3), 100.0, np.array([0, 0, 1.0]))

    def advice(x: float, **figures) -> GuidanceView:
        return GuidanceView(figures.get("now"), 0.1, Ghost(lenses, body, np.array([x, 0, 0]), np.eye(3)))

    first, better = advice(190.0), advice(560.0, now=0.2)
    controller.advice.guidance = first
    controller.advice.lying = Lying(np.array([5.0, 0, 0]), np.eye(3))
    assert controller.advice._kept_under_way(better) is better, "nobody has moved it yet"
    controller.advice.lying = Lying(np.array([120.0, 0, 0]), np.eye(3))
    kept = controller.advice._kept_under_way(better)
    assert kept is not None and kept.ghost is first.ghost and kept.now_mm == 0.2


# 6: a lost camera


def test_a_lost_camera_is_greyed_counted_out_and_said_in_full(window):
    controller = at_placement(window)
    take(controller, "P1")
    controller.go("placement:P1")
    pump(lambda: window.page.ready.text() == "6 / 6")
    controller.cameras.connection.source.inject(SimulatedFault("lose", "C04"))
    pump(lambda: controller.cameras.lost() == ("C04",))
    controller.cameras.live.forget()  # as after the ball was staged: no image of it is kept
    window.page.tick()
    assert window.page.ready.text() == "5 / 6"
    tile = next(tile for tile in window.page.wall.tiles.values() if tile.name == "C04")
    assert tile.state.lost and "C04" in window.page.headline.text()
    window._show_buttons()
    assert window.footer.action.isVisible() and window.footer.action.text() == "Go on without C04"
    assert window.footer.default == "", "red goes on by a click, not by the space bar"
    pump(lambda: not window.footer.is_quiet)
    window.footer.action.click()
    assert controller.project.step == "placement:P2"


# 9: a recording


def test_nothing_of_a_recording_is_to_be_moved_and_it_is_captured_by_itself(home, qtbot, monkeypatch):
    monkeypatch.setattr(CameraController, "live_hz", 4.0)
    made = begun(home / "first")
    take(made, "P1")
    take(made, "P2")
    folder = made.project.folder
    made.close_project()
    window: Any = WizardWindow(home / "projects")
    qtbot.addWidget(window)
    window.show()
    window.open_project(str(folder.parent / "nothing"))  # a folder that is not there is said, and nothing happens
    session = home / "session"
    shutil.copytree(folder, session)
    (session / "wizard.json").unlink()
    window.open_project(str(session))  # 10: a session that is opened as a project
    controller = window.controller
    settle(controller)
    assert controller.project.source == f"replay:{session}"
    controller.recording.confirm_bench()
    controller.cameras.accept_look()
    controller.go("placement:P1")
    pump(lambda: window.page.standing().level == "good")
    assert "Press space" in window.page.headline.text()
    words = words_shown(window)
    assert "Move the ball" not in words and "Put it there" not in words and "Need them elsewhere" not in words
    window.header.goes_on.setChecked(True)
    window.page.automatic.setChecked(True)
    pump(lambda: {"P1", "P2"} <= set(controller.project.taken))
    window.close()


# 10: a folder of images


def test_a_folder_of_images_is_imported_with_what_was_recognised(home, qtbot, window):
    folder = home / "images"
    for camera in ("cam1", "cam2"):
        (folder / camera).mkdir(parents=True)
        for number in (1, 2, 3):
            cv2.imwrite(str(folder / camera / f"{number:04d}.png"), np.full((240, 320), 40 * number, np.uint8))
    window.open_project(str(folder))
    dialog: Any = window.import_dialog
    assert isinstance(dialog, ImportDialog)
    words = words_shown(dialog)
    assert "Cameras: 2" in words and "cam1, cam2" in words and "Placements: 3" in words
    dialog.start()
    pump(lambda: window.controller.project is not None)
    settle(window.controller)
    source = Path(window.controller.project.source.partition(":")[2])
    assert (source / "session.json").is_file() and source.parent == home / "projects"
    assert "assumed" in window.banner.text.lower(), "what nobody said is told"
    assert not (folder / "session.json").exists()


def test_a_folder_with_nothing_in_it_is_said(home, window):
    (home / "empty").mkdir()
    window.open_project(str(home / "empty"))
    assert window.banner.alarms and "empty" in window.banner.text and window.controller.project is None


# 11: no driver


def test_without_a_driver_the_headline_says_that_and_nothing_else():
    note = DriverNote("No camera driver is installed.", ("Install the driver package of the cameras' maker.",))
    text, level = connect_summary([], False, "No camera was found. Plug them in.", [note])
    assert text.startswith("No camera driver is installed. Install") and "Plug" not in text and level == "bad"


# 12 and 13


def test_a_check_asks_for_no_dots_elsewhere(window, home):
    controller = at_placement(window)
    controller.project = Project(**{**controller.project.__dict__, "purpose": "check"})
    take(controller, "P1")
    window.page.refresh()
    assert not window.page.spread_dots.isVisible() and not window.page.more_dots.isVisible()


def test_training_does_not_describe_the_real_bench_and_draws_the_dots_of_the_scale(window):
    window.new_project("simulated:demo")
    settle(window.controller)
    assert button(window, "describe-bench").isHidden()


# 14


def test_the_menu_shows_what_is_on(window):
    for option in (window.header.dark, window.header.far, window.header.mute, window.header.show_log):
        assert option.isCheckable() and option.icon().isNull(), "an icon would stand where the check mark is"


def test_only_the_start_page_says_that_computations_are_prepared(window):
    """It stood in the header of every page, for fifteen minutes."""
    window.show()
    for percent, told in ((40, True), (100, False)):
        window.show_compiling(percent)
        assert window.header.compiling.isVisible() is told
    at_placement(window)
    window.show_compiling(40)
    assert not window.header.compiling.isVisible()


def test_a_dim_image_is_not_called_well_lit():
    status = CameraStatus("S1", CameraState.STREAMING, "", "", Counters(), None)
    sight: Any = SimpleNamespace(dots=np.empty(9), blur_px=0.7, saturated=0.0, brightness=0.1)
    state = tile_state("C01", status, sight)
    assert "lit" not in state.word and "lit" not in summary([state])[0]


def test_a_click_on_a_thumbnail_is_heard(qtbot):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    one = Thumbnail()
    qtbot.addWidget(one)
    with qtbot.waitSignal(one.clicked, timeout=1000):
        QTest.mouseClick(one, Qt.MouseButton.LeftButton)


def test_the_footer_does_not_jump(window):
    controller = at_placement(window)
    window.page.tick()
    next_at, height = window.footer.next.geometry(), window.footer.height()
    controller.go("connect")
    assert window.footer.action.isHidden()
    assert window.footer.next.geometry().right() == next_at.right()
    for kind in ("plain", "primary"):  # neither button may be the one to press
        for one in (window.footer.action, window.footer.next):
            window.footer._set_kind(one, kind)
        settle(controller)
        assert window.footer.height() == height


# 15


def test_writing_the_report_shows_that_it_writes_and_can_be_cancelled(window, monkeypatch):
    said = save_says(SaveFacts(running="save", left="3 s"))
    assert said.button is not None and said.button.does == "cancel" and said.left == "3 s"


def test_the_first_click_is_answered_before_anything_is_loaded(window, monkeypatch):
    seen = []

    def slow(*_: object) -> None:
        seen.append((window.doing.text(), window.start.isEnabled()))

    monkeypatch.setattr(window.controller, "new_project", slow)
    window.new_project("genicam")
    assert seen == [("Opening", False)] and window.start.isEnabled() and window.doing.text() == ""


# 16


def test_what_a_technician_reads_has_no_words_of_experts(window):
    controller = at_placement(window)
    words = words_shown(window)
    controller.go("look")
    window.page.tick()
    words += words_shown(window)
    for one in ("GENICAM_GENTL64_PATH", "Focus 0", "L1-1", "k = ", "blunders", "as a share"):
        assert one not in words


def test_a_step_says_that_the_folder_is_gone_whatever_it_is():
    states = resolve(Project(Path("p"), "simulated:demo"), Running(gone=True)).steps
    assert {one.status for one in states} == {Status.FAILED}


def test_where_the_bar_goes_is_said_before_what_was_measured_once(window, monkeypatch):
    """A pose is taken anew: "Changed since: L1-1" stood where the bar's way belongs."""
    page = VerifyPage(window.controller)
    monkeypatch.setattr(VerifyPage, "shows_outcome", False)
    stale = StepState(Step("verify", "verify"), Status.STALE, Reason("changed", ("L1-1",), "verify"))
    assert page._step_part(stale).level == "none"
    undecided = StepState(Step("verify", "verify"), Status.CARE, Reason("undecided", (), "verify"))
    assert page._step_part(undecided) == Part("caution"), "its colour, and the words of the pose"
    monkeypatch.setattr(VerifyPage, "shows_outcome", True)
    assert page._step_part(stale).level == "caution"
    assert page._step_part(undecided).text
    page.close_page()


# seen in the pictures of every page


def test_a_computation_that_was_stopped_is_computed_again_by_the_large_button():
    said = results_says(ResultFacts(("NOT VALID", "bad", False), stopped=True))
    assert said.button is not None and said.button.does == "calibrate" and said.button.enabled


def test_a_verification_that_decided_nothing_is_not_called_missing():
    said = save_says(SaveFacts(verified=False, undecided=True, why_not="A reason."))
    assert said.text == "Not saved yet; its verification decided nothing" and said.level == "caution"
    assert save_says(SaveFacts(verified=False)).text == "Not saved yet; not verified"


def test_a_button_is_named_with_its_page_where_it_is_not_on_this_one():
    """Check said "press Fixed again" and had no such button."""
    assert moved_text(("C05",)).endswith("press “Fixed again”.")
    assert moved_text(("C05",), here=False).endswith("press “Fixed again” at Camera check.")


def test_what_to_do_about_a_verification_that_failed_is_not_cut_off(qtbot):
    """With large text the first and the last line of it were out of sight."""
    view = VerificationView()
    qtbot.addWidget(view)
    view.resize(700, 420)
    view.show()
    view.sentence.setText("Do not use the rig. Compare the lengths of both bars with their certificates. " * 3)
    pump(lambda: view.sentence.minimumHeight() > 3 * view.sentence.fontMetrics().lineSpacing())
    assert view.sentence.height() >= view.sentence.heightForWidth(view.sentence.width())


def test_the_bar_of_a_capture_lies_over_nothing(window):
    """The style's least height was more than the page's fixed one: it covered the tops of the images."""
    page = PlacementPage(window.controller)
    page.resize(1000, 620)
    page.show()
    page.hold.show()
    pump(lambda: page.hold.width() > 900)
    assert page.hold.height() <= page.hold.maximumHeight() == 8
    page.close_page()


def test_what_is_no_advice_stands_under_nothing_to_complain_about(qtbot):
    shown = FindingsList()
    qtbot.addWidget(shown)
    shown.show_advice([FindingAdvice("none", "Some dots were left out", "", "")])
    assert "Nothing to complain about." in words_of(shown)
    shown.show_advice([FindingAdvice("bad", "The computation was stopped", "", "")])
    assert "Nothing to complain about." not in words_of(shown)


def words_of(widget: Any) -> list[str]:
    return [one.text() for one in widget.findChildren(QLabel) if not one.isHidden()]


def test_a_key_without_figures_is_not_shown(window):
    page = PlacementPage(window.controller)
    page.resize(1600, 1000)
    page.now.setText("If you stop now: being worked out")
    page._show_keys()
    assert page.guide_key.isHidden()
    page.now.setText("If you stop now: 500 ± 0.200 mm")
    page._show_keys()
    assert not page.guide_key.isHidden()
    page.close_page()


def test_pages_to_come_are_made_while_images_are_captured(window):
    """Opening Results or Verify for the first time held the window for half a second."""
    at_placement(window)
    pump(lambda: {"calibrate", "results", "verify", "save"} <= set(wizard_page.loaded))
    assert "verify" not in window.pages
    release = threading.Event()
    window.controller.runner.start("waiting", lambda _: release.wait(), lambda _: None, lambda _: None)
    shown = window.page
    pump(lambda: {"scale", "calibrate", "results", "verify", "save"} <= set(window.pages))
    assert window.page is shown and window.stack.currentWidget() is shown
    release.set()
    settle(window.controller)


def test_a_step_is_written_beside_the_window_and_the_newest_project_wins(window, monkeypatch):
    controller = at_placement(window)
    folder, slow = controller.project.folder, threading.Event()
    writes = project_controller.save_project
    monkeypatch.setattr(project_controller, "save_project", lambda project: (slow.wait(), writes(project)))
    controller.go("placement:P2")  # does not wait for the disk
    assert controller.project.step == "placement:P2" and load_project(folder).step != "placement:P2"
    slow.set()
    pump(lambda: load_project(folder).step == "placement:P2")
    controller.go("placement:P3")
    controller.go("placement:P4")
    controller.close_project()
    assert load_project(folder).step == "placement:P4"
