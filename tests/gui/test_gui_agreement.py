"""No page contradicts itself: headline, rail, chip, tiles, counter, banner and default button take the worst part."""

import itertools
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtWidgets import QPushButton

from spherecal_cameras.simulated.simulated_source import SimulatedFault
from spherecal_gui import project as changes
from spherecal_gui.controllers.camera_controller import CameraController
from spherecal_gui.presenters.start_presenter import FAULTS
from spherecal_gui.project import Project
from spherecal_gui.project_folder import load_project, save_project
from spherecal_gui.standing import (
    Button,
    Level,
    Part,
    Said,
    camera_level,
    level_of,
    stand,
    status_shown,
    worse,
    worst,
)
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Running, Status, resolve
from tests.gui.test_gui_workflow import OPEN, statuses, taken_project
from tests.gui_agreement import Watcher
from tests.gui_walking import at_rest, pump, settle

pytestmark = pytest.mark.usefixtures("images_at_rest")

LEVELS: tuple[Level, ...] = ("none", "good", "caution", "bad")
BUTTONS = (
    None,
    *(
        Button("", "", enabled, "", done, accepts)
        for enabled, done, accepts in itertools.product((False, True), repeat=3)
    ),
)


# --- the resolved state ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("status", list(Status))
def test_all_combinations_take_the_worst_and_red_never_goes_on(status):
    step = Part(level_of(status), "step")
    for own, trouble, button, may, alarmed in itertools.product(LEVELS, LEVELS, BUTTONS, (False, True), (False, True)):
        found = stand(Said(own, "own", button), step, (Part(trouble, "trouble"),), may, alarmed)
        wanted = worst((own, step.level, trouble))
        assert found.level == ("none" if alarmed and wanted == "good" else wanted)
        assert {"own": own, "step": step.level, "trouble": trouble}[found.text] == wanted
        if wanted == "bad" or alarmed:
            assert found.default != "next"
            assert not (found.default == "action" and button is not None and button.accepts)
        if found.default == "action":
            assert button is not None and button.enabled and not button.done
        if found.default == "next":
            assert may
        if status not in (Status.RUNNING, Status.BLOCKED):
            drawn = level_of(status_shown(status, found.level))
            assert (drawn == "bad") == (found.level == "bad")
            assert not (found.level == "good" and worse(drawn, "good"))


def test_the_chip_is_red_only_where_the_page_needs_cameras():
    assert camera_level(lost=True, connected=True, kind="placement", live=True) == "bad"
    assert camera_level(lost=True, connected=True, kind="results", live=True) == "caution"
    assert camera_level(lost=False, connected=True, kind="placement", live=False) == "caution"
    assert camera_level(lost=False, connected=True, kind="placement", live=True) == "good"
    assert camera_level(lost=False, connected=True, kind="connect", live=True, page="bad") == "bad"
    assert camera_level(lost=False, connected=True, kind="connect", live=False, page="good") == "caution"


def flawed(**flaws: tuple[str, ...]) -> Project:
    """P2 was taken again with something wrong."""
    codes: dict[str, changes.FlawCode] = {"taken_without": "taken without", "taken_moving": "taken moving"}
    return changes.with_set(taken_project(), "P2", "later", {codes[key]: value for key, value in flaws.items()})


def test_a_placement_without_a_camera_is_red_until_it_is_taken_again_or_kept():
    project = flawed(taken_without=("C04",))
    found = statuses(project)
    assert found["placement:P2"] is Status.FAILED and found["calibrate"] is Status.FAILED
    assert statuses(changes.with_kept(project, "P2"))["placement:P2"] is Status.CARE
    assert statuses(changes.with_kept(project, "P2"))["calibrate"] is Status.READY
    assert statuses(changes.with_set(project, "P2", "still later"))["placement:P2"] is Status.DONE


def test_a_set_that_is_brought_back_has_its_flaws_again():
    project = flawed(taken_without=("C04",))
    again = changes.with_set(changes.without_set(project, "P2"), "P2", "later")
    assert statuses(again)["placement:P2"] is Status.FAILED
    assert statuses(changes.with_set(project, "P2", "t1"))["placement:P2"] is Status.DONE, "the one before was good"


def test_flaws_survive_the_disk(tmp_path):
    project = changes.with_kept(replace(flawed(taken_moving=("C01", "C02")), folder=tmp_path / "p"), "P2")
    save_project(project)
    assert load_project(project.folder).flaws == project.flaws


def test_a_moved_camera_makes_what_was_taken_and_computed_out_of_date():
    project = changes.with_calibration(taken_project(), "valid")
    project = replace(project, accepted=project.calibrated)
    running = replace(OPEN, moved=("C03",))
    live = {one.step.id: one.status for one in resolve(project, running).steps}
    assert live["look"] is Status.FAILED and live["placement:P1"] is Status.CARE
    fixed = changes.with_moved(project, ("C03",))
    found = statuses(fixed)
    assert found["placement:P1"] is found["placement:P4"] is Status.FAILED
    assert found["calibrate"] is Status.STALE and found["results"] is Status.STALE
    for name in project.sets:
        fixed = changes.with_set(fixed, name, "after")
    assert statuses(changes.with_calibration(fixed, "valid"))["calibrate"] is Status.DONE


@pytest.mark.parametrize(
    ("calibrated", "verified", "wanted"),
    [("valid", "consistent", Status.DONE), ("valid", "pass", Status.DONE), ("valid", None, Status.CARE),
     ("valid", "undecided", Status.CARE), ("valid", "inconsistent", Status.FAILED),
     ("use with care", "consistent", Status.CARE), ("not valid", "consistent", Status.FAILED)],
)  # fmt: skip
def test_saved_is_never_greener_than_what_was_saved(calibrated, verified, wanted):
    project = changes.with_calibration(taken_project(), calibrated)
    project = replace(project, accepted=project.calibrated)
    if verified is not None:
        project = changes.with_verification(changes.with_set(project, "A-01", "t9"), verified)
    assert statuses(changes.with_saved(project))["save"] is wanted


def test_a_calibration_that_is_not_valid_is_red_on_the_rail():
    assert statuses(changes.with_calibration(taken_project(), "not valid"))["calibrate"] is Status.FAILED


def test_a_lost_camera_is_red_at_connect():
    assert statuses(taken_project(), Running(connected=True, lost=("C04",)))["connect"] is Status.FAILED


# --- the widgets -----------------------------------------------------------------------------------------------------


def begun_window(qtbot, home: Path, source: str) -> Watcher:
    window = WizardWindow(home / "projects")
    qtbot.addWidget(window)
    window.controller.cameras.live_hz = 10.0
    window.show()
    window.new_project(source)
    watcher = Watcher(window)
    watcher.settle()
    return watcher


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_no_page_contradicts_itself_with_a_fault_of_the_training(qtbot, home, fault):
    """As somebody walks who does what the program says, and goes on by click where it does not go on by itself."""
    watcher = begun_window(qtbot, home, "simulated:demo" + (f"+{fault}" if fault else ""))
    window = watcher.window
    controller = window.controller
    red = set()
    for _ in range(4):  # Connect, Look, two placements
        step = controller.project.step
        watcher.until(
            lambda: window.page.action() is not None and (window.page.action().enabled or window.page.action().done)
        )
        if step != "connect":
            assert controller.cameras.live is not None
            seen = controller.cameras.live.rounds
            watcher.until(lambda seen=seen: controller.cameras.live.rounds > seen + 2)
        if window.page.standing().level == "bad":
            red.add(step)
        if not window.page.action().done:
            window.page.act()
            watcher.settle()
        if window.page.standing().level == "bad":
            red.add(step)
        window.go_next()
    assert watcher.looks > 30
    assert not watcher.found
    wanted = {"lose": {"placement:P2"}, "blur": {"look"}}.get(fault.partition(":")[0], set())
    assert wanted <= red, "the fault is seen"
    window.close()


STEPS = ("connect", "look", "placement:P1", "placement:P4", "scale", "calibrate", "results", "verify", "save")


@pytest.fixture(scope="module")
def finished(qapp, walked, tmp_path_factory) -> Iterator[WizardWindow]:
    """The window of a project of which everything but the last step is done."""
    home = tmp_path_factory.mktemp("agreement")
    folder = home / "projects" / walked.name
    shutil.copytree(walked, folder)
    save_project(replace(load_project(folder), saved=None))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPHERECAL_SETTINGS", str(home / "settings.ini"))
        patch.setenv("SPHERECAL_3D", "2d")
        patch.setattr(CameraController, "live_hz", 10.0)
        window = WizardWindow(home / "projects")
        window.show()
        window.open_project(str(folder))
        settle(window.controller)
        settle(window.controller)
        yield window
        window.close()


@pytest.fixture
def opened(finished) -> Iterator[WizardWindow]:
    """That window at Camera check, where all is well; afterwards its cameras are healed and count as they stand."""
    finished.controller.go("look")
    pump(lambda: finished.page.standing().level == "good" and at_rest(finished.controller))
    yield finished
    finished.controller.cameras.connection.source.heal("C03")
    finished.controller.cameras.live.watch.forgive()


LIVE_FAULTS = [SimulatedFault("lose", "C03"), SimulatedFault("bump", "C03"), SimulatedFault("blur", "C03"),
               SimulatedFault("dim", "C03", 0.05)]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("fault", LIVE_FAULTS, ids=lambda fault: fault.kind)
def test_no_step_of_a_finished_project_contradicts_itself(opened, fault):
    """A camera fails, or is knocked, while somebody goes through everything that is done."""
    watcher, controller = Watcher(opened), opened.controller
    controller.cameras.connection.source.inject(fault)
    watcher.until(lambda: opened.page.standing().level in ("bad", "caution"))
    for step in STEPS:
        controller.go(step)
        for _ in range(3):
            watcher.look()
        if fault.kind == "bump" and step != "connect":
            assert opened.page.standing().level == "bad", "it no longer holds for a camera that was moved"
            assert opened.footer.default != "next"
    assert not watcher.found


@pytest.mark.slow
def test_fixed_again_asks_for_everything_that_was_taken_before(opened):
    watcher, controller = Watcher(opened), opened.controller
    controller.cameras.connection.source.inject(SimulatedFault("bump", "C03"))
    watcher.until(controller.cameras.moved)
    next(one for one in opened.page.findChildren(QPushButton) if one.property("key") == "fixed-again").click()
    state = controller.state
    assert state.of("placement:P1").status is state.of("placement:P4").status is Status.FAILED
    assert state.of("calibrate").status is Status.STALE
    controller.go("save")
    watcher.settle()
    assert opened.page.action().does == "results", "what was captured before is out of date: look, and save nothing"
    assert opened.footer.default == "action" and not watcher.found
