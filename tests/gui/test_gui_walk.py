"""The whole walk on the simulated demo rig, as a technician takes it: by the one large button."""

import os
import re
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import ROOT

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QCoreApplication
from PySide6.QtWidgets import QApplication

from spherecal_app.cli.main import main
from spherecal_cameras.simulated.simulated_source import SimulatedFault
from spherecal_gui.controllers.camera_controller import CameraController
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.verify_page import VerifyPage
from spherecal_gui.project_folder import load_project
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Status
from tests.gui_walking import pump, words_shown
from tests.gui_walking import settle as settled

pytestmark = pytest.mark.usefixtures("images_at_rest")


def settle(window: WizardWindow) -> None:
    """Until no work runs and what it left in the queue is done."""
    settled(window.controller)


def click(window: WizardWindow) -> None:
    """The large button, once what it does has been seen for a moment."""
    pump(lambda: not window.footer.is_quiet)
    window.footer.action.click()


def press(window: WizardWindow) -> None:
    """The large button, and what it starts."""
    assert window.footer.action.isEnabled(), window.footer.why.text()
    click(window)
    settle(window)


class Walk:
    """A walk that was made, its window still open."""

    def __init__(self, projects: Path) -> None:
        self.projects = projects
        self.window = WizardWindow(projects)
        self.window.show()
        self.visited: list[str] = []
        self.shown: dict[str, str] = {}

    def look(self) -> None:
        """Keep what the window says in this step."""
        step = self.step().partition(":")[0]
        self.shown[step] = self.shown.get(step, "") + "\n" + words_shown(self.window)

    @property
    def controller(self) -> Controller:
        return self.window.controller

    @property
    def folder(self) -> Path:
        assert self.controller.project is not None
        return self.controller.project.folder

    def statuses(self) -> dict[str, Status]:
        state = self.controller.state
        assert state is not None
        return {one.step.id: one.status for one in state.steps}

    def step(self) -> str:
        assert self.controller.project is not None
        return self.controller.project.step

    def poses_taken(self) -> list[str]:
        project = self.controller.project
        return [pose for pose in project.check_poses if pose in project.taken] if project is not None else []

    def go_on(self) -> None:
        """Do the step's work, then on to the next."""
        self.visited.append(self.step())
        window = self.window
        for _ in range(6):
            action = window.page.action() if window.page is not None else None
            self.look()
            if action is None or action.done:
                break
            if self.step() == "verify" and len(self.poses_taken()) == 3:
                assert isinstance(window.page, VerifyPage)
                window.page.enough.click()
                settle(window)
                continue
            pump(window.footer.action.isEnabled)
            press(window)
        self.look()
        window.go_next()
        QCoreApplication.processEvents()


@pytest.fixture(scope="module")
def walk(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Walk]:
    home = tmp_path_factory.mktemp("walk")
    lost: list[BaseException | None] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPHERECAL_SETTINGS", str(home / "settings.ini"))
        patch.setenv("SPHERECAL_3D", "2d")
        patch.setattr(CameraController, "live_hz", 2.0)  # leave the cores to the walk
        patch.setattr(sys, "excepthook", lambda _kind, value, _trace: lost.append(value))
        patch.setattr(threading, "excepthook", lambda args: lost.append(args.exc_value))
        before = set(threading.enumerate())
        made = Walk(home / "projects")
        made.window.new_project("simulated:demo")
        settle(made.window)
        while made.step() != "save":
            made.go_on()
        yield made
        made.window.close()
        left = [thread.name for thread in threading.enumerate() if thread not in before and thread.is_alive()]
        assert not [name for name in left if "detect" in name or "live" in name or "task" in name], left
    assert not lost, lost


def test_the_walk_reaches_the_end(walk):
    assert walk.visited == [
        "connect", "look", "placement:P1", "placement:P2", "placement:P3", "placement:P4", "scale", "calibrate",
        "results", "verify",
    ]  # fmt: skip
    found = walk.statuses()
    assert found.pop("save") is found.pop("measure") is Status.READY
    assert set(found.values()) == {Status.DONE}


# The steps of each section of the guide's walk, and those of its words that this walk gives no cause for.
SECTIONS = {
    "Connect": ("connect",), "Camera check": ("look",), "Placements": ("placement",), "Scale bar": ("scale",),
    "Calibrate": ("calibrate", "results"), "Verify": ("verify",), "Save": ("save",),
}  # fmt: skip
SELDOM = {
    "Fixed again", "Cancel", "Stop here", "Measure the bar", "Write the report", "The rig's profile",
    "Give it an address", "Use the built-in driver",
}  # fmt: skip


def test_each_step_shows_what_the_guide_says_of_it(walk):
    """In the guide bold is what stands on the screen; here on that very page."""
    walk.look()  # at Save
    sections = re.split(r"^## (.+)$", (ROOT / "docs" / "guide" / "first.md").read_text(encoding="utf-8"), flags=re.M)
    told = dict(zip(sections[1::2], sections[2::2], strict=True))
    absent = {}
    for title, steps in SECTIONS.items():
        shown = "\n".join(walk.shown[step] for step in steps)
        words = {re.sub(r"\s+", " ", word) for word in re.findall(r"\*\*(.+?)\*\*", told[title], re.S)}
        assert words
        absent[title] = {word for word in words - SELDOM if not re.search(rf"^{re.escape(word)}", shown, re.M)}
    assert not any(absent.values()), absent


def test_the_results_are_in_the_window(walk):
    page = walk.window.pages["results"]
    assert page.word.text().startswith("VALID")
    assert page.table.rowCount() == 6
    rms = [float(page.table.item(row, 1).text()) for row in range(6)]
    assert rms == sorted(rms, reverse=True), "the worst first"
    assert page.scene.data is not None
    assert set(page.scene.on_screen()) == {f"C0{i}" for i in range(1, 7)}
    assert len(page.findings.shown) == len(walk.controller.result.rig.quality.findings)
    page.show_camera("C03")
    assert page.scene.marked == "C03"


def test_the_check_bar_is_guided_over_seven_lines(walk):
    """The poses are those that the engine plans; the simulated bar lies where the plan wants it."""
    project, plan = walk.controller.project, walk.controller.outcome.plan
    assert project.check_poses == tuple(pose.id for pose in plan.poses)
    assert {pose.partition("-")[0] for pose in project.check_poses} == {f"L{i}" for i in range(1, 8)}
    assert walk.poses_taken() == ["L1-1", "L1-2", "L2-1"]
    walk.controller.go("verify")
    page = walk.window.page
    page.more.click()
    pump(lambda: page.guide is not None and page.guide.level == "good")
    assert page.message.text() == "Pose 4 of 14 · Ready: press space"
    source = walk.controller.cameras.connection.source
    source.stage.move((0.0, 0.0, 0.0), (0.0, 0.0, 30.0))
    walk.controller.cameras.live.forget()
    pump(lambda: page.guide is not None and not page.guide.accepted)
    assert "bar A" in page.message.text(), "turned, moved, or laid again if it left the images"
    assert not page.action().enabled and page.action().why == page.guide.text
    assert page.as_it_lies.isEnabled(), "nobody is forced"
    walk.controller.go("save")
    assert walk.statuses()["verify"] is Status.DONE, "what was not taken changes nothing"


def test_the_verification_is_in_the_window(walk):
    walk.controller.go("verify")
    view = walk.window.pages["verify"].outcome
    assert view.word.text() == "CONSISTENT"  # no limit was given
    assert view.table.rowCount() == 3
    assert "9 lengths" in view.sentence.text()
    shares = [view.budget.item(row, 3).text() for row in range(view.budget.rowCount())]
    assert shares.count("100 %") == 3
    walk.controller.go("save")


def test_the_command_line_gives_the_same_bytes(walk, tmp_path, capsys):
    """What "copy as command" promises."""
    calibrate, verify = walk.controller.saving.commands()
    result = str(walk.folder / "result")
    other = tmp_path / "other"
    for line in (calibrate, verify):
        words = [word.replace(result, str(other)) for word in line.split()]
        assert main(words[1:]) == 0
    capsys.readouterr()
    names = sorted(path.name for path in other.iterdir())
    assert names == sorted(path.name for path in Path(result).iterdir())
    for name in names:
        assert (other / name).read_bytes() == (Path(result) / name).read_bytes(), name


def test_after_a_crash_it_reopens_at_the_same_step_with_the_counters_intact(walk, qapp):
    """Another program opens the folder while this one never closed it."""
    again = Controller()
    try:
        again.open_project(walk.folder)
        pump(lambda: again.runner.running is None and again.cameras.connection is not None)
        pump(lambda: again.runner.running is None)
        assert again.project == walk.controller.project
        assert again.state is not None
        assert again.state.current == walk.step()
        counts = {name: {c: len(d) for c, d in dots.items()} for name, dots in walk.controller.recording.dots.items()}
        assert {name: {c: len(d) for c, d in dots.items()} for name, dots in again.recording.dots.items()} == counts
        pump(lambda: again.result is not None, 60)
    finally:
        again.close_project()


def test_lost_counters_are_found_again_in_the_images(walk, qapp):
    (walk.folder / "wizard" / "P2.npz").unlink()
    again = Controller()
    try:
        again.open_project(walk.folder)
        pump(lambda: "P2" in again.recording.dots, 120)
        before = {camera: len(dots) for camera, dots in walk.controller.recording.dots["P2"].items()}
        assert {camera: len(dots) for camera, dots in again.recording.dots["P2"].items()} == before
        pump(lambda: again.runner.running is None)
    finally:
        again.close_project()


def test_delete_makes_stale_and_undo_makes_current(walk):
    walk.controller.sets.delete("P3")
    assert not (walk.folder / "placements" / "P3").exists()
    found = walk.statuses()
    assert found["placement:P3"] is Status.READY
    assert found["calibrate"] is found["results"] is found["verify"] is Status.STALE
    assert load_project(walk.folder).taken.keys() == walk.controller.project.taken.keys()
    walk.controller.sets.undo()
    settle(walk.window)
    found = walk.statuses()
    assert found.pop("save") is found.pop("measure") is Status.READY
    assert set(found.values()) == {Status.DONE}
    assert len(list((walk.folder / "placements" / "P3").iterdir())) == 6


def test_cancelling_takes_effect_at_once_and_keeps_everything(walk):
    walk.controller.go("calibrate")
    before = {path.name: path.read_bytes() for path in (walk.folder / "result").iterdir()}
    taken = dict(walk.controller.project.taken)
    assert walk.controller.computation.calibrate()
    task = walk.controller.runner.task
    pump(lambda: walk.window.page.tick() or walk.window.page.course.fraction > 0.03)
    pump(lambda: not walk.window.footer.is_quiet)  # until then it takes no click: what it does has just changed
    began = time.perf_counter()
    click(walk.window)
    assert walk.window.page.word.text().startswith("Stopping")
    said_after_s = time.perf_counter() - began
    assert said_after_s < 0.2
    assert task is not None and task.stopping
    settle(walk.window)
    assert time.perf_counter() - began < 15, "measured: 0.1 to 0.4 s on two busy cores"
    assert {path.name: path.read_bytes() for path in (walk.folder / "result").iterdir()} == before
    assert dict(walk.controller.project.taken) == taken
    assert walk.statuses()["calibrate"] is Status.DONE


def test_what_was_chosen_stays_when_the_look_changes(walk):
    walk.controller.go("results")
    QCoreApplication.processEvents()
    page = walk.window.page
    page.show_camera("C03", "P2")
    for dark in (True, False):
        walk.window.header.dark.setChecked(dark)
        QCoreApplication.processEvents()
        assert (page.image.currentText(), page.image.currentData()) == ("C03 · P2", "P2")


def test_a_valid_result_is_not_given_away_for_a_part_of_one(walk):
    walk.controller.go("calibrate")
    assert walk.controller.computation.calibrate()
    QCoreApplication.processEvents()
    page = walk.window.page
    assert page.stop_here.isVisible() and not page.stop_here.isEnabled()
    assert "cancel instead" in page.stop_here.toolTip()
    click(walk.window)
    settle(walk.window)
    assert not page.stop_here.isVisible()
    assert walk.statuses()["calibrate"] is Status.DONE


def test_a_lost_camera_is_named_on_the_page(walk):
    walk.controller.go("placement:P1")
    QCoreApplication.processEvents()
    source, page = walk.controller.cameras.connection.source, walk.window.page
    source.inject(SimulatedFault("lose", "C02"))
    pump(lambda: "C02" in page.scene().lost, 60)
    assert walk.statuses()["connect"] is Status.FAILED, "the state is that of now, though the project is the same"
    walk.controller.go("look")
    pump(lambda: "C02" in walk.window.page.summary.text(), 60)
    tile = walk.window.page.wall.tiles["SIM-C02"]
    assert tile.state.level == "bad"
    source.heal("C02")
    pump(lambda: "C02" not in walk.window.page.summary.text(), 60)
    assert walk.statuses()["connect"] is Status.DONE


def test_a_set_without_a_camera_is_taken_and_said(walk):
    walk.controller.go("placement:P4")
    QCoreApplication.processEvents()
    source = walk.controller.cameras.connection.source
    source.inject(SimulatedFault("lose", "C05"))
    walk.window.page.small["retake"].click()
    settle(walk.window)
    source.heal("C05")
    page, rail = walk.window.page, walk.window.rail.item("placement:P4")
    pump(lambda: not walk.controller.cameras.lost())
    pump(lambda: page.advice.text() == "Captured without C05: retake it.")
    assert page.ready.text() == "5 / 6" and rail.level == "bad"
    assert walk.window.footer.default == "action" and page.action().text == "Retake  (space)"
    assert walk.statuses()["placement:P4"] is Status.FAILED
    page.small["keep-set"].click()
    assert walk.statuses()["placement:P4"] is Status.CARE and walk.window.footer.default == "next"
    assert "C05" not in walk.controller.recording.dots["P4"]
    assert walk.statuses()["calibrate"] is Status.STALE
    walk.controller.sets.undo()
    settle(walk.window)
    assert walk.statuses()["calibrate"] is Status.DONE


def test_the_profile_is_saved_and_put_to_use(walk):
    walk.controller.go("save")
    QCoreApplication.processEvents()
    page = walk.window.page
    assert "Not saved" in page.word.text()
    assert page.action().text == "Save and put to use", "else somebody writes the report and goes home"
    page.apply.setChecked(False)
    assert page.action().text == "Save in the profile"
    page.apply.setChecked(True)
    press(walk.window)
    assert walk.statuses()["save"] is Status.DONE
    assert page.word.text() == "Saved"
    assert page.action().text == "Write the report"
    kept = walk.projects / "training-profile"
    assert (kept / "rig.json").read_bytes() == (walk.folder / "result/rig.json").read_bytes()
    assert not (walk.projects / "rig-profile").exists(), "what is simulated never counts as the rig's calibration"
    assert walk.window.validity.text.startswith("SIMULATED · ")
    assert walk.window.validity.text.startswith(("SIMULATED · calibration fresh", "SIMULATED · calibration ageing"))


def test_live_detection_sees_the_ball(walk, qtbot):
    view = walk.controller.cameras.live
    qtbot.waitUntil(lambda: view.sight("SIM-C01") is not None, timeout=30_000)
    sight = view.sight("SIM-C01")
    assert 0.4 < (sight.blur_px or 0.7) < 1.0
    assert 0.0 < sight.brightness < 0.5


def test_a_replay_of_the_recording_is_a_source_too(walk, tmp_path):
    again = Controller()
    try:
        again.new_project(f"replay:{walk.folder}", tmp_path)
        pump(lambda: again.runner.running is None)
        assert again.cameras.connection is not None
        assert again.cameras.connection.source.label.startswith("REPLAY")
        assert again.project is not None
        assert again.project.placements == ("P1", "P2", "P3", "P4")
        assert again.project.check_poses == (), "check bars are in a session of their own"
        again.recording.confirm_bench()
        again.cameras.accept_look()
        again.staging.show_pose("P2")
        assert again.sets.take("P2", "placement:P2")
        pump(lambda: again.runner.running is None)
        counts = {camera: len(dots) for camera, dots in again.recording.dots["P2"].items()}
        assert counts == {camera: len(dots) for camera, dots in walk.controller.recording.dots["P2"].items()}
    finally:
        again.close_project()


def checked(folder: Path, source: str = "") -> Controller:
    """A check like the walk's project, as far as its answer."""
    again = Controller()
    again.new_check(replace(load_project(folder), source=source or "simulated:demo"))
    pump(lambda: again.runner.running is None)
    again.recording.confirm_bench()
    again.cameras.accept_look()
    assert again.state is not None
    assert [one.step.id for one in again.state.steps] == ["connect", "look", "placement:P1", "check"]
    assert again.sets.take("P1", "placement:P1")
    pump(lambda: again.runner.running is None)
    assert again.checks.check()
    pump(lambda: again.runner.running is None)
    return again


def saved(walk):
    """The profile, which another worker may have saved in a walk of its own."""
    profile = walk.projects / "training-profile"
    if not (profile / "rig.json").is_file():
        walk.controller.saving.save_profile(profile, True)
        settle(walk.window)
    return profile


def test_a_check_says_that_all_is_as_it_was(walk):
    saved(walk)
    again = checked(walk.folder)
    try:
        assert again.checks.found.verdict == "ok"
        assert again.state is not None and again.state.of("check").status is Status.DONE
        assert (again.project.folder / "check.json").is_file()
        (line,) = again.saving.commands()
        assert line.startswith("spherecal check ") and "training-profile" in line
    finally:
        again.close_project()


def test_a_check_names_the_camera_that_was_knocked(walk, qtbot):
    from spherecal_gui.pages.check_page import CheckPage
    from spherecal_gui.presenters.check_presenter import repaired_verdict

    saved(walk)
    again = checked(walk.folder, "simulated:demo+bump:C03:0.3")
    try:
        assert again.checks.found.verdict == "recalibrate"
        assert again.checks.found.to_repair == ("C03",)
        assert again.state is not None and again.state.of("check").status is Status.FAILED
        page = CheckPage(again)
        qtbot.addWidget(page)
        page.enter(again.state.of("check").step)
        assert page.word.text() == "RECALIBRATE"
        assert page.sentence.text() == "Only C03 moved (9 px). Tighten its mount."
        assert page.table.name_of(0) == "C03"
        page.repair.click()
        pump(lambda: again.runner.running is None)
        page.refresh()
        assert (page.word.text(), page.sentence.text()) == ("REPAIRED", "Not in use yet.")
        assert "now by 0.00" in page.mended.text() and page.action().does == "use"
        assert again.checks.after is not None
        assert repaired_verdict(again.checks.after, in_use=True).word == "OK"
    finally:
        again.close_project()


def test_the_profile_lists_the_calibration_in_use(walk, qtbot):
    from spherecal_gui.pages.profile_dialog import ProfileDialog

    dialog = ProfileDialog(saved(walk))
    qtbot.addWidget(dialog)
    assert dialog.table.rowCount() == 1
    assert dialog.table.chosen == "0001"
    assert not dialog.use.isEnabled(), "it is in use already"
    assert dialog.table.item(0, 3).text() == "consistent"
    assert not dialog.picture.pixmap().isNull(), "the rig's picture"


def test_guidance_stands_on_the_placement_page(walk):
    walk.controller.go("placement:P4")
    pump(lambda: walk.controller.advice.guidance is not None, 60)
    page = walk.window.page
    assert page.tabs.tabText(0) == "In space"
    pump(lambda: page.now.text().startswith("If you stop now: 500 ± 0."), 60)
    pump(lambda: not walk.controller.advice.guidance.coarse, 60)
    assert page.space.data is not None and len(page.space.data.scene.placements) >= 3


def test_a_chart_is_drawn_when_its_tab_comes_into_sight(walk):
    """Only the one in sight follows the cameras; the others must not be older when they are looked at."""
    walk.controller.go("placement:P2")
    QCoreApplication.processEvents()
    page = walk.window.page
    for chart, other in ((page.coverage, page.pairs), (page.pairs, page.coverage)):
        page.tabs.setCurrentWidget(other.parentWidget())
        chart.clear()
        chart._drawn = None
        page.tabs.setCurrentWidget(chart.parentWidget())
        assert len(chart.plot_item.items) > 6
    drawn = list(page.pairs.plot_item.items)
    page.refresh()
    assert page.pairs.plot_item.items == drawn, "nothing has changed: nothing is drawn"


def test_an_image_can_be_left_out_and_taken_back(walk):
    walk.controller.go("results")
    QCoreApplication.processEvents()
    page = walk.window.page
    page.show_camera("C02")
    assert not page.leave_image.isEnabled()
    page.image.setCurrentIndex(page.image.findData("P3"))
    assert page.residuals._image is not None, "the image itself is behind its residuals"
    page.leave_image.click()
    assert walk.controller.project.repairs_now == (("--leave-out", "C02@P3"),)
    assert walk.statuses()["calibrate"] is Status.STALE
    assert page.action().text == "Calibrate again"
    assert "--leave-out C02@P3" in walk.controller.saving.commands()[0]
    walk.window.page.findings.taken_back.emit("--leave-out", "C02@P3")
    assert walk.statuses()["calibrate"] is Status.DONE
