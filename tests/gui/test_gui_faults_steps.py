"""Every fault in every step: what the window says, that nothing is lost, that it opens again where it was."""

import errno
import json
import os
import shutil
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QCoreApplication
from PySide6.QtWidgets import QPushButton

from spherecal_cameras.simulated.simulated_source import SimulatedFault, SimulatedSource
from spherecal_gentl.producer.producer_control import RigFeed
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.placement_page import PlacementPage
from spherecal_gui.project_folder import load_project, save_project
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Status
from spherecal_rigs.store import copy_is_right, open_profile
from tests.built_producer import built_producer
from tests.gui_killed import exit_code_of, killed_in_step, killed_while_saving
from tests.gui_still import calibrated_once
from tests.gui_walking import WORK, pump, settle, status, take

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("images_at_rest", "no_advice")]

STEPS = ("connect", "look", "placement:P2", "scale", "calibrate", "results", "verify", "save")


def copied(walked: Path, home: Path, step: str) -> Path:
    """The project as somebody left it at a step, with what only comes later taken away."""
    folder = home / "projects" / walked.name
    shutil.copytree(walked, folder)
    shutil.copytree(walked.parent / "training-profile", folder.parent / "training-profile")
    project = load_project(folder)
    if step in ("connect", "look", "placement:P2", "scale", "calibrate"):
        shutil.rmtree(project.result_folder)
        shutil.rmtree(project.verification_folder)
        poses = tuple(p for p, _ in project.pose_bars)
        project = replace(
            project,
            calibrated=None,
            accepted=None,
            verified=None,
            saved=None,
            taken={k: v for k, v in project.taken.items() if k not in poses},
        )
    elif step in ("results", "verify"):
        project = replace(project, verified=None, saved=None, accepted=None if step == "results" else project.accepted)
    save_project(replace(project, step=step))
    return folder


def all_files(folder: Path) -> dict[str, bytes]:
    """What was recorded and computed: everything but the wizard's own notes."""
    kept = ("placements", "bars", "result", "verification")
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for part in kept
        for path in sorted((folder / part).rglob("*"))
        if path.is_file()
    }


def counters(controller: Controller) -> dict[str, dict[str, int]]:
    return {name: {c: len(d) for c, d in dots.items()} for name, dots in controller.recording.dots.items()}


def opened_window(qtbot, home, folder) -> WizardWindow:
    """A window that shows a project, its cameras connected."""
    window = WizardWindow(home / "projects")
    qtbot.addWidget(window)
    window.controller.cameras.live_hz = 2.0
    window.show()
    window.open_project(str(folder))
    settle(window.controller)
    settle(window.controller)
    return window


@pytest.fixture
def opened(qtbot, home, walked, request) -> Iterator[WizardWindow]:
    """The window at a step."""
    folder = copied(walked, home, request.param)
    window = opened_window(qtbot, home, folder)
    yield window
    window.close()


# --- a camera is lost ------------------------------------------------------------------------------------------------


def told_on(window: WizardWindow) -> str:
    """All that the page and the frame say in words."""
    page = window.page
    words = [window.source.text, window.banner.text if window.banner.isVisible() else ""]
    for name in ("summary", "advice", "told", "word"):
        part = getattr(page, name, None)
        words.append(part.text() if part is not None and hasattr(part, "text") else "")
    return " | ".join(words)


def lose_a_camera(opened: WizardWindow) -> None:
    """It is named, nothing is lost, and it comes back."""
    controller = opened.controller
    before = all_files(controller.project.folder)
    source = controller.cameras.connection.source
    assert isinstance(source, SimulatedSource)
    source.inject(SimulatedFault("lose", "C04"))
    pump(lambda: "without C04" in opened.source.text)
    step = controller.project.step
    if step == "connect":
        pump(lambda: "5 of 6 cameras ready" in told_on(opened))
    elif step == "look":
        pump(lambda: "No images from C04" in told_on(opened))
    elif step == "placement:P2":
        page = opened.page
        assert isinstance(page, PlacementPage)
        pump(lambda: "C04" in page.scene().lost)
    assert all_files(controller.project.folder) == before
    assert controller.state.current == step
    source.heal("C04")
    pump(lambda: "without" not in opened.source.text)


@pytest.mark.parametrize("opened", ["calibrate"], indirect=True)
def test_stopped_where_it_is_shows_what_there_is_and_goes_on_though_a_camera_is_lost(opened):
    """Pressed at once: the free form, marked as stopped, to be looked at and not to be taken for a calibration."""
    controller = opened.controller
    assert controller.computation.calibrate()
    QCoreApplication.processEvents()
    opened.page.stop_here.click()
    assert opened.page.word.text().startswith("Stopping as soon as") and not opened.page.stop_here.isEnabled()
    assert opened.page.action().text == "Cancel", "it may still be cancelled"
    settle(controller)
    rig = json.loads((controller.project.result_folder / "rig.json").read_text())
    assert rig["quality"]["findings"][0]["code"] == "stopped-early" and not rig["quality"]["valid"]
    assert rig["form"]["name"] == "free" and len(rig["cameras"]) == 6
    assert controller.project.calibrated.verdict == "not valid"
    controller.go("results")
    QCoreApplication.processEvents()
    assert opened.page.findings.shown[0].title == "The computation was stopped"
    assert opened.page.word.text() == "NOT VALID"
    again = next(one for one in opened.page.findings.findChildren(QPushButton) if one.text() == "Calibrate again")
    with calibrated_once():
        again.click()
        assert controller.state.current == "calibrate" and opened.page.is_running
        controller.cameras.connection.source.inject(SimulatedFault("lose", "C04"))  # which harms no computation
        settle(controller)
    assert status(controller, "calibrate") is Status.DONE
    assert controller.project.calibrated.verdict == "valid"
    pump(lambda: "without C04" in opened.source.text)


@pytest.mark.parametrize("opened", ["scale", "verify"], indirect=True)
def test_a_pose_without_a_camera_is_taken_and_said(opened):
    controller, step = opened.controller, opened.controller.project.step
    poses = controller.project.scale_poses if step == "scale" else controller.project.check_poses
    controller.cameras.connection.source.inject(SimulatedFault("lose", "C04"))
    take(controller, poses[0])
    assert f"{poses[0]} is captured, but without C04." in opened.banner.text
    assert "C04" not in controller.recording.dots[poses[0]]


# --- the cameras' process is killed ----------------------------------------------------------------------------------


@pytest.fixture
def real(qtbot, home, walked, monkeypatch, request) -> Iterator[tuple[WizardWindow, RigFeed]]:
    """The window at a step, the same rig being seen through genicam and the simulated producer."""
    cti = built_producer()
    folder = copied(walked, home, request.param)
    save_project(replace(load_project(folder), source="genicam", bench=str(walked)))
    with RigFeed(walked) as feed:
        for name, value in feed.control.environment.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setenv("GENICAM_GENTL64_PATH", str(cti.parent))
        monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
        window = opened_window(qtbot, home, folder)
        assert window.controller.cameras.connection is not None, window.controller.project.failures
        yield window, feed
        window.close()


@pytest.mark.skipif(os.name == "nt", reason="kills by signal")
@pytest.mark.parametrize("real", ["connect", "look", "verify"], indirect=True)
def test_the_camera_process_killed_is_said_and_all_cameras_come_back(real):
    window, feed = real
    controller = window.controller
    step, source = controller.project.step, controller.cameras.connection.source
    before, dots = all_files(controller.project.folder), counters(controller)
    pump(lambda: all(controller.cameras.live.sight(serial) for serial in controller.cameras.connection.names))
    assert "without" not in window.source.text
    pid = source.service_pid
    os.kill(pid, signal.SIGKILL)
    pump(lambda: "without C01, C02, C03, C04, C05, C06" in window.source.text)
    if step == "connect":
        pump(lambda: "0 of 6 cameras ready" in told_on(window))
    elif step == "look":
        pump(lambda: "No images from C01, C02" in told_on(window))
    pump(lambda: "without" not in window.source.text)
    assert source.service_pid not in (None, pid)
    assert controller.state.current == step
    assert all_files(controller.project.folder) == before
    assert counters(controller) == dots
    if step == "connect":
        pump(lambda: "6 of 6 cameras ready" in told_on(window))
    elif step == "look":
        feed.show("P3")
        pump(lambda: "sharp, dots found" in told_on(window))
        assert window.page.action().done
    else:
        pose = controller.project.check_poses[1]
        feed.show(controller.project.scale_poses[0])
        assert controller.sets.take(pose, "verify")
        settle(controller)
        assert set(controller.recording.dots[pose]) == {f"C0{i}" for i in range(1, 7)}


# --- the disk is full ------------------------------------------------------------------------------------------------


def full(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def fill_the_disk(opened: WizardWindow, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is said, nothing is lost, and the work is done once somebody has freed the disk."""
    controller, step = opened.controller, opened.controller.project.step
    said: list[str] = []
    controller.said.connect(lambda kind, text, hint: said.append(f"{kind}: {text} {hint}"))
    before, taken = all_files(controller.project.folder), dict(controller.project.taken)
    profile = (controller.profile_folder / "rig.json").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", full)
        WORK[step](controller)
        settle(controller)
    told = [one for one in said if one.startswith("bad")]
    assert told and all("no space left on device" in one.lower() for one in told), said
    assert all_files(controller.project.folder) == before
    assert (controller.profile_folder / "rig.json").read_bytes() == profile
    assert set(load_project(controller.project.folder).taken) == set(taken)
    assert controller.state.current == step
    WORK[step](controller)  # somebody has freed the disk
    settle(controller)
    assert status(controller, step) in (Status.DONE, Status.READY)
    assert load_project(controller.project.folder).step == step, "what could not be written then is written now"


@pytest.mark.parametrize("opened", STEPS, indirect=True)
def test_a_lost_camera_and_a_full_disk_are_said_in_every_step_and_lose_nothing(opened, monkeypatch):
    lose_a_camera(opened)
    with calibrated_once():  # what cannot be written and what is written then is the same
        fill_the_disk(opened, monkeypatch)


# --- the wrong ball, no bar ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("opened", ["verify"], indirect=True)
def test_a_bar_that_is_not_there_is_said_before_and_after_measuring(opened):
    controller = opened.controller
    page = opened.page
    pose = controller.project.check_poses[0]
    controller.cameras.connection.source.show("P1")  # the ball still lies there
    controller.cameras.live.forget()
    pump(lambda: page.guide is not None and controller.bars.lying_ends is None)
    assert "Lay bar" in page.message.text()
    assert not page.action().enabled
    assert controller.sets.take(pose, "verify")  # as it lies: nobody is forced
    settle(controller)
    controller.computation.verify()
    settle(controller)
    assert controller.project.verified.verdict == "no data"
    assert status(controller, "verify") is Status.CARE
    assert page.outcome.word.text() == "NO DATA"
    assert page.outcome.sentence.text().endswith("capture them again.") and page.outcome.pictures.isHidden()
    assert opened.banner.isHidden(), "the page says it"
    found = json.loads((controller.project.result_folder / "verification.json").read_text())["findings"]
    assert "mark-not-found" in {one["code"] for one in found}
    assert page.standing().default == "action" and page.action().does == "retake"
    page.act()
    assert page.current == pose and page.outcome.isHidden()


@pytest.mark.parametrize("opened", ["placement:P2"], indirect=True)
def test_the_ball_of_another_rig_is_found_out(opened):
    """Other targets than those of the bench: nothing is seen, and the page says so before anything is taken."""
    controller = opened.controller
    controller.sets.delete("P2")
    controller.cameras.connection.source.stage.show(controller.cameras.connection.plan.sets[-1].id)  # no ball at all
    controller.cameras.live.forget()
    page = opened.page
    pump(lambda: len(page.sights()) == 6 and all(len(s.dots) < 50 for s in page.sights().values()))
    pump(lambda: page.advice.text().startswith(("Put the ball", "Turn or move")))


# --- the program is killed -------------------------------------------------------------------------------------------


@pytest.mark.skipif(os.name == "nt", reason="kills by signal")
@pytest.mark.parametrize("step", STEPS)
def test_killed_in_a_step_it_opens_there_with_the_counters_intact(qapp, home, walked, step):
    folder = copied(walked, home, step)
    before = load_project(folder)
    whole = all_files(folder)
    assert exit_code_of(killed_in_step, str(folder), step) == -signal.SIGKILL
    again = Controller()
    again.cameras.live_hz = 1.0
    try:
        again.open_project(folder)
        settle(again)
        settle(again)
        assert again.project is not None and again.state is not None
        assert again.state.current == step
        assert set(before.taken) <= set(again.project.taken)
        pump(lambda: set(again.recording.dots) >= set(before.taken))
        assert all(counters(again)[name] for name in before.taken)
        after = all_files(folder)
        images = [name for name in whole if name.endswith(".png")]
        assert all(name in after for name in images)
        assert again.cameras.connection is not None
        QCoreApplication.processEvents()
    finally:
        again.close_project()


@pytest.mark.skipif(os.name == "nt", reason="kills by signal")
@pytest.mark.parametrize("number", range(3, int(os.environ.get("SPHERECAL_KILLS", "60")), 20))
def test_killed_while_saving_one_calibration_is_in_use(qapp, home, walked, number):
    """Here at three of the calls that change the disk; docs/security.md says how many were tried."""
    folder = copied(walked, home, "save")
    profile = folder.parent / "training-profile"
    before = open_profile(profile)
    assert exit_code_of(killed_while_saving, str(folder), str(number)) in (-signal.SIGKILL, 0)
    after = open_profile(profile)
    assert not after.problems and copy_is_right(after)
    assert after.active_id in (before.active_id, list(after.entries)[-1])
    assert len(after.entries) - len(before.entries) in (0, 1)
    assert set(load_project(folder).taken) == set(load_project(walked).taken)
