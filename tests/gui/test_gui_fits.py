"""Every page on 1280 x 800: complete without scrolling, nothing cut short; large text scrolls one way at most."""

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)


from spherecal_gui import languages, theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.placement_page import PlacementPage
from spherecal_gui.pages.verify_page import VerifyPage
from spherecal_gui.presenters.placement_presenter import Scene, short_text
from spherecal_gui.presenters.step_states import move_text
from spherecal_gui.project_folder import TRAINING_PROFILE, load_project, save_project
from spherecal_gui.tasks.ghost import ToGo
from spherecal_gui.wizard.window import WizardWindow
from tests.gui_fit import covered, cut_short, scrolled, settled
from tests.gui_walking import pump, settle

pytestmark = pytest.mark.usefixtures("images_at_rest")

SIZE = (1280, 800)
STEPS = ("connect", "look", "placement:P1", "scale", "calibrate", "results", "verify", "save", "measure")
FEW_DOTS = {"C01": 88, "C02": 90, "C03": 94, "C04": 97}


@pytest.fixture(scope="module")
def connected(walked, tmp_path_factory) -> Iterator[Controller]:
    """A project of which everything but the last step is done, with the cameras connected."""
    home = tmp_path_factory.mktemp("fits")
    folder = home / "projects" / walked.name
    shutil.copytree(walked, folder)
    save_project(replace(load_project(folder), saved=None))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPHERECAL_SETTINGS", str(home / "settings.ini"))
        patch.setenv("SPHERECAL_3D", "2d")
        made = Controller()
        made.cameras.live_hz = 0.2  # what is measured are the widgets, not the images in them
        made.open_project(folder)
        settle(made)
        settle(made)
        yield made
        made.close_project()


@pytest.mark.slow
@pytest.mark.parametrize("language", ["en", "de", "zh_CN"])
def test_every_page_is_complete(qapp, qtbot, home: Path, connected: Controller, language: str) -> None:
    languages.use(language)
    window = WizardWindow(home, controller=connected)
    try:
        qtbot.addWidget(window)
        window.showNormal()
        window.resize(*SIZE)
        connected.sets.delete("P4")  # a placement that is not captured has the ghost, and most buttons
        connected.go("placement:P4")
        pump(lambda: connected.advice.to_go is not None)
        wrong = []
        for large in (False, True):  # as seldom as can be: each change of size styles every widget again
            window.header.far.setChecked(large)
            wrong += faults_of_advice(window, connected, large)
        connected.sets.undo()
        settle(connected)
        for large in (True, False):
            window.header.far.setChecked(large)
            for step in STEPS:
                connected.go(step)
                settle(connected)
                wrong += [f"{step}, {one}" for one in faults_at(window, large)]
            connected.go("verify")
            settle(connected)
            page = window.page
            assert isinstance(page, VerifyPage)
            page.outcome.tables.setCurrentIndex(1)
            assert page.outcome.cameras.rowCount() == 6
            wrong += [f"verify's cameras, {one}" for one in faults_at(window, large)]
            page.outcome.tables.setCurrentIndex(0)
        assert not wrong, "\n".join(wrong)
    finally:
        for page in window.pages.values():
            page.close_page()
        window.close()
        languages.use("en")
        theme.apply(qapp, dark=False)


def faults_of_advice(window: WizardWindow, connected: Controller, large: bool) -> list[str]:
    """What does not fit on a placement not captured yet: with its advice, the longest one, where few dots are seen."""
    wrong = [f"placement:P4, {one}" for one in faults_at(window, large)]
    shown = window.page
    assert isinstance(shown, PlacementPage)
    facts = PlacementPage._facts_of
    few = Scene(FEW_DOTS, True)
    for name, change in (("longest advice", {"to_go": longest_advice()}), ("few dots", {"to_go": None, "scene": few})):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                PlacementPage, "_facts_of", lambda self, scene, change=change: replace(facts(self, scene), **change)
            )
            shown.tick()
            wrong += [f"placement:P4, {name}, {one}" for one in faults_at(window, large)]
            assert shown.advice.text() in (move_text(longest_advice()), short_text(FEW_DOTS))
    return wrong


@pytest.fixture(scope="module")
def checked(connected: Controller) -> Iterator[Controller]:
    """A check of the calibration in use, as far as its answer: a camera has moved, which has most to say."""
    folder = connected.project.folder
    connected.saving.save_profile(folder.parent / TRAINING_PROFILE, True)
    settle(connected)
    # the rig's picture is drawn by a process of its own, which may take longer than the saving
    pump(lambda: any((folder.parent / TRAINING_PROFILE).rglob("*.png")))
    again = Controller()
    again.new_check(replace(load_project(folder), source="simulated:demo+bump:C03:0.3"))
    settle(again)
    again.recording.confirm_bench()
    again.cameras.accept_look()
    assert again.sets.take("P1", "placement:P1")
    settle(again)
    assert again.checks.check()
    settle(again)
    yield again
    again.close_project()


@pytest.mark.slow
@pytest.mark.parametrize("language", ["en", "de", "zh_CN"])
def test_the_check_and_the_start_page_are_complete(
    qapp, qtbot, connected: Controller, checked: Controller, language: str
) -> None:
    languages.use(language)
    projects = connected.project.folder.parent
    checking, starting = WizardWindow(projects, controller=checked), WizardWindow(projects, controller=Controller())
    try:
        wrong = []
        for window, name in ((checking, "check"), (starting, "start")):
            qtbot.addWidget(window)
            window.showNormal()
            window.resize(*SIZE)
            if name == "check":
                checked.go("check")
                settle(checked)
            wrong += [f"{name}, {one}" for one in faults(window)]
            window.hide()
        assert not starting.start.picture.isHidden(), "the rig in use is shown"
        assert not wrong, "\n".join(wrong)
    finally:
        for window in (checking, starting):
            for page in window.pages.values():
                page.close_page()
            window.close()
        languages.use("en")
        theme.apply(qapp, dark=False)


def longest_advice() -> ToGo:
    """A move and a turn that take most words in the language of now."""
    ways = [
        ToGo(1300.0, 45.0, False, 1280.0, up, "C06", left, tips)
        for up in (-160.0, 160.0)
        for left, tips in ((False, ""), (True, ""), (False, "C01"))
    ]
    return max(ways, key=lambda one: len(move_text(one)))


def faults(window: WizardWindow) -> list[str]:
    """What does not fit, tab by tab, with normal and with large text."""
    found = []
    for large in (False, True):
        window.header.far.setChecked(large)
        found += faults_at(window, large)
    window.header.far.setChecked(False)
    return found


def faults_at(window: WizardWindow, large: bool) -> list[str]:
    """What does not fit, tab by tab, with the text as it is."""
    found = []
    tabs = getattr(window.page, "tabs", None)
    for index in range(tabs.count() if tabs is not None else 1):
        if tabs is not None:
            tabs.setCurrentIndex(index)
        settled(window)
        here = f"{'large text, ' if large else ''}tab {index}: "
        found += [here + one for one in (both_ways(window) if large else incomplete(window))]
    return found


def both_ways(window: WizardWindow) -> list[str]:
    """What scrolls sideways, grows the window, or, where nothing scrolls, is cut short."""
    areas = scrolled(window)
    found = [f"{name} scrolls sideways" for name, across, _ in areas if across]
    found += [f"the window is {window.width()} px wide"] if window.width() > SIZE[0] else []
    return found if areas else found + cut_short(window)


def incomplete(window: WizardWindow) -> list[str]:
    """What scrolls, is cut short or covered."""
    found = [f"{name} scrolls {'sideways' if across else 'downwards'}" for name, across, _ in scrolled(window)]
    if (window.width(), window.height()) != SIZE:
        found.append(f"the window is {window.width()} x {window.height()}")
    return found + cut_short(window) + covered(window)
