"""Masks, single cameras, drivers, guided bars, repairs: what is set by hand beside the walk itself."""

import json
import os
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QMessageBox, QPushButton

from spherecal.base.context import Context
from spherecal.base.errors import Cancelled
from spherecal.targets.masks import masked
from spherecal_cameras.simulated import simulated_source
from spherecal_files.read_session import read_session
from spherecal_gui import languages
from spherecal_gui.controllers.camera_controller import DriverQuestion
from spherecal_gui.coverage import Dots, unmasked
from spherecal_gui.languages import error_text
from spherecal_gui.pages.connect_dialogs import CameraDialog
from spherecal_gui.pages.live_page import LookPage
from spherecal_gui.pages.placement_page import PlacementPage
from spherecal_gui.project_folder import load_project
from spherecal_gui.widgets.tile import CameraTile
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Status
from tests.built_producer import built_producer
from tests.gui_walking import begun, pump, settle, status, take

pytestmark = pytest.mark.usefixtures("images_at_rest")


@pytest.fixture
def german(qapp):
    languages.use("de")
    yield
    languages.use("en")


@pytest.fixture
def wizard(qapp, home):
    made = begun(home / "projects")
    made.cameras.live_hz = 2.0
    yield made
    made.close_project()


# --- masks -----------------------------------------------------------------------------------------------------------


def test_a_mask_is_drawn_on_the_image_and_told_in_its_pixels(qtbot):
    tile = CameraTile("S1", "C01")
    qtbot.addWidget(tile)
    tile.resize(640, 400)
    tile.show()
    told: list[tuple[str, tuple]] = []
    tile.masked.connect(lambda *words: told.append(words))
    tile.show_image(np.full((1000, 2000), 90, np.uint8), 8, 1.0)
    field, scale = tile._field()

    def at(u: float, v: float) -> QPoint:
        return QPoint(round(field.left() + (u + 0.5) * scale), round(field.top() + (v + 0.5) * scale))

    def drag(start: QPoint, end: QPoint) -> None:
        QTest.mousePress(tile, Qt.MouseButton.LeftButton, pos=start)
        QTest.mouseMove(tile, end)
        QTest.mouseRelease(tile, Qt.MouseButton.LeftButton, pos=end)

    drag(at(300, 200), at(900, 600))
    assert told == [], "dragging draws nothing unless masks are being drawn"
    tile.masking = True
    drag(at(300, 200), at(302, 201))
    assert told == [], "nor does a click"
    drag(at(900, 600), at(300, 200))  # from any corner
    ((serial, rectangle),) = told
    assert serial == "S1"
    assert rectangle == pytest.approx((300, 200, 600, 400), abs=1.5 / scale)
    QTest.mouseDClick(tile, Qt.MouseButton.LeftButton, pos=at(500, 400))
    tile.show_masks((rectangle,))
    assert tile.grab().toImage().pixelColor(at(300, 400)).name() != "#5a5a5a", "the mask is seen"


def test_dots_in_masks_do_not_count():
    uv = np.array([[10.0, 10.0], [50.0, 50.0], [90.0, 90.0]])
    dots = Dots(np.arange(3), np.zeros(3, int), uv, (100, 100))
    assert unmasked(dots, ()) is dots
    assert unmasked(dots, ((40.0, 40.0, 20.0, 20.0),)).target.tolist() == [0, 2]


@pytest.mark.slow
def test_masks_count_live_in_what_was_taken_and_in_the_session_and_can_be_undone(wizard, home):
    take(wizard, "P1")
    free = len(wizard.recording.dots["P1"]["C02"])
    where = np.percentile(wizard.recording.dots["P1"]["C02"].uv, (25, 75), axis=0)
    rectangle = (float(where[0, 0]), float(where[0, 1]), *(float(x) for x in where[1] - where[0]))
    wizard.recording.mask("SIM-C02", rectangle)
    left = len(wizard.recording.dots["P1"]["C02"])
    assert 0 < left < free
    assert len(wizard.recording.dots["P1"]["C01"]) > 0
    pump(lambda: (s := wizard.cameras.live.sight("SIM-C02")) is not None and len(s.dots) <= left + 8)
    session = read_session(wizard.project.folder)
    masks = {camera.id: camera.ignore for camera in session.cameras}
    (mask,) = masks.pop("C02")
    assert mask == pytest.approx(rectangle)
    assert set(masks.values()) == {()}
    assert load_project(wizard.project.folder).masks == (("C02", rectangle),)
    assert ("masks" in dict(wizard.project.calibration_inputs)) and wizard.project.masks
    wizard.recording.mask("SIM-C03", (0.0, 0.0, 5.0, 5.0))
    wizard.recording.undo_mask()
    assert [camera for camera, _ in wizard.project.masks] == ["C02"]
    wizard.recording.clear_masks()
    assert len(wizard.recording.dots["P1"]["C02"]) == free
    assert all(not camera.ignore for camera in read_session(wizard.project.folder).cameras)
    assert "masks" not in dict(wizard.project.calibration_inputs)


@pytest.mark.slow
def test_a_lamp_that_stays_is_proposed_as_a_mask_and_taken_or_left_by_one_click(wizard, monkeypatch):
    draw = simulated_source.digitise

    def with_a_lamp(*given: Any) -> np.ndarray:
        return cv2.circle(draw(*given), (90, 70), 30, 255, -1)

    take(wizard, "P1")
    assert wizard.recording.spots == {}
    take(wizard, "P2")
    assert wizard.recording.spots == {}, "nothing stays but the ball that was not moved"
    monkeypatch.setattr(simulated_source, "digitise", with_a_lamp)
    take(wizard, "P1")
    assert wizard.recording.spots == {}, "it was not there in all"
    take(wizard, "P2")
    spots = wizard.recording.spots
    assert len(spots) >= 4
    for (spot,) in spots.values():
        assert masked(np.array([[60.0, 40.0], [120.0, 100.0]]), [spot]).all() and spot[2] < 90, spot
    wizard.recording.leave_spots()
    take(wizard, "P3")
    assert not set(wizard.recording.spots) & set(spots), "what somebody left is proposed no more"
    wizard.recording._left = {}
    take(wizard, "P3")
    spots = wizard.recording.spots
    page = PlacementPage(wizard)
    page.enter(next(one.step for one in wizard.state.steps if one.step.id == "placement:P3"))
    page.show()  # the images of a page that nobody sees are not drawn
    tile = next(one for one in page.wall.tiles.values() if one.name in spots)
    pump(lambda: page.tick() or (page.small["mask-spots"].isVisibleTo(page) and tile.image is not None))
    tile.resize(400, 320)
    tile.show_masks((), ())
    plain_image = tile.grab().toImage()
    tile.show_masks((), spots[tile.name])
    assert tile.grab().toImage() != plain_image, "they are outlined"
    page.small["mask-spots"].click()
    assert wizard.recording.spots == {} and set(wizard.project.masks) == {(c, s[0]) for c, s in spots.items()}
    page.tick()
    assert not page.small["mask-spots"].isVisibleTo(page) and not page.small["leave-spots"].isVisibleTo(page)
    take(wizard, "P4")
    assert not set(wizard.recording.spots) & set(spots), "what is masked is proposed no more"
    page.close_page()


# --- one camera ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_cameras_dialog_shows_it_live_and_sets_it(qtbot, wizard):
    dialog = CameraDialog(wizard, "SIM-C03")
    qtbot.addWidget(dialog)
    dialog.show()
    pump(lambda: dialog.tile.image is not None)
    assert not dialog.name_field.isEnabled() and "simulated" in dialog.name_field.toolTip()
    assert not dialog.blink.isEnabled(), "a simulated camera has no light"
    assert not dialog.trigger.isEnabled() and "Simulated" in dialog.trigger.toolTip()
    pump(lambda: wizard.cameras.live.sight("SIM-C03") is not None)
    before = wizard.cameras.live.sight("SIM-C03").brightness
    dialog.exposure.setValue(3.0)
    dialog.apply.click()
    settle(wizard)
    assert wizard.tuning.settings_of("SIM-C03").exposure_us == pytest.approx(3000)
    pump(lambda: wizard.cameras.live.sight("SIM-C03").brightness < 0.6 * before)
    assert wizard.tuning.settings_of("SIM-C01").exposure_us == pytest.approx(10_000), "only this one"


@pytest.mark.slow
def test_real_cameras_blink_are_renamed_and_asked_about(qtbot, home, monkeypatch):
    """Over the simulated producer, copied to a place where it is a stranger."""
    from spherecal_cameras.camera_settings import (
        CameraDescription,
        CameraProfile,
        default_profile_path,
        read_profile,
        write_profile,
    )
    from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera

    cti = built_producer()
    folder = home / "driver"
    folder.mkdir()
    stranger = folder / "stranger.cti"
    stranger.write_bytes(cti.read_bytes() + b"\0")  # other contents: nobody has allowed it
    monkeypatch.setenv("SPHERECAL_DRIVERS", str(home / "drivers.json"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(home / "config"))
    lenses = {s: CameraDescription(s, focal_length_mm=8.0, pixel_pitch_um=3.45) for s in ("SIM1", "SIM2")}
    write_profile(default_profile_path(), CameraProfile(lenses))
    cameras = [SimulatedCamera(serial, 320, 240) for serial in ("SIM1", "SIM2")]
    with ProducerControl(cameras) as control:
        for name, value in control.environment.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setenv("GENICAM_GENTL64_PATH", str(folder))
        window = WizardWindow(home / "projects")
        qtbot.addWidget(window)
        window.show()
        controller = window.controller
        window.new_project("genicam")
        pump(lambda: getattr(window, "question", None) is not None)
        press(window.question, "driver-no")
        settle(controller)
        assert controller.cameras.connection is None
        assert [one.kind for one in controller.cameras.driver_troubles] == ["not-allowed"]
        del window.question
        controller.cameras.connect_all()
        pump(lambda: getattr(window, "question", None) is not None)
        question = window.question
        assert isinstance(question, QMessageBox) and str(stranger) in question.informativeText()
        press(window.question, "driver-yes")
        settle(controller)
        assert controller.cameras.connection is not None, controller.project.failures
        assert str(stranger) in (home / "drivers.json").read_text()

        answers: list[bool] = []
        states: set[object] = set()
        controller.tuning.blink("SIM2", answers.append)
        pump(lambda: states.add(control.settings("SIM2")["indicator"]) or answers)
        assert answers == [True]
        assert states == {0, 1}
        assert control.settings("SIM2")["indicator"] == 0, "as it was"

        assert controller.tuning.why_not_renamed("SIM1") == ""
        assert controller.tuning.set_camera("SIM1", "left", 5000.0, 0.0)
        settle(controller)
        settle(controller)
        assert controller.cameras.connection.names["SIM1"] == "left"
        assert control.settings("SIM1")["exposure_us"] == pytest.approx(5000)
        assert json.loads(default_profile_path().read_text())["cameras"][0]["name"] == "left"

        dialog = CameraDialog(controller, "SIM1")
        qtbot.addWidget(dialog)
        assert dialog.trigger.currentData() == "software"
        for mode in ("free", "software"):
            dialog.trigger.setCurrentIndex(dialog.trigger.findData(mode))
            dialog.trigger.activated.emit(dialog.trigger.currentIndex())
            settle(controller)
            entries = read_profile(default_profile_path()).cameras
            assert {entries[serial].settings.trigger for serial in lenses} == {mode}
            assert entries["SIM1"].settings.exposure_us == pytest.approx(5000), "the rest is as it was"
        window.close()


def press(box, key: str) -> None:
    """A button of a dialog, by its key."""
    (one,) = (b for b in box.findChildren(QPushButton) if b.property("key") == key)
    one.click()


def test_a_question_about_a_driver_waits_for_the_first_answer_or_the_end():
    question, got = DriverQuestion("x.cti", "ab", changed=False), []
    asking = threading.Thread(target=lambda: got.append(question.wait(Context())))
    asking.start()
    question.answer(True)
    question.answer(False)
    asking.join(5)
    assert got == [True]
    with pytest.raises(Cancelled):
        DriverQuestion("x.cti", "ab", changed=True).wait(Context(is_cancelled=lambda: True))


# --- the check's repair ----------------------------------------------------------------------------------------------


def test_the_repaired_rig_is_in_use_only_when_somebody_says_so(tmp_path):
    from spherecal_gui import project as changes
    from spherecal_gui.project import Project
    from spherecal_gui.project_folder import save_project
    from spherecal_gui.workflow import Running, resolve

    def step(project: Project) -> Status:
        return resolve(project, Running(None, True)).of("check").status

    project = Project(tmp_path / "p", "simulated:demo", placements=("P1",), purpose="check")
    project = changes.with_check(changes.with_set(project, "P1", "t1"), "recalibrate")
    assert step(project) is Status.FAILED
    project = changes.with_repaired(project, "valid")
    assert step(project) is Status.CARE, "repaired, but not in use yet"
    project = changes.with_repair_in_use(project)
    assert step(project) is Status.DONE
    save_project(project)
    project.repair_folder.mkdir()
    (project.repair_folder / "rig.json").write_text("{}")
    assert load_project(project.folder).repaired == project.repaired
    again = changes.with_check(changes.with_set(project, "P1", "t2"), "recalibrate")
    assert step(again) is Status.FAILED, "it has moved once more"


# --- words in other languages ----------------------------------------------------------------------------------------


def test_a_finding_speaks_the_readers_language_with_its_figures(german):
    from spherecal.data.findings import Finding, leave_out
    from spherecal_gui.presenters.results_presenter import advice

    values = {"noise_px": 0.1, "times": 2.5, "others_px": 0.04, "percent": 4.0, "points": 400}
    finding = Finding("camera-noisy", "warning", values, ("C03",), leave_out("camera:C03"))
    rig = SimpleNamespace(quality=SimpleNamespace(findings=(finding,)))
    result: Any = SimpleNamespace(rig=rig, camera_ids=("C03",))
    (one,) = advice(result, ())
    assert one.title == "Eine Kamera ist unschärfer oder wackelt"
    assert one.message.startswith("Die Punkte der Kamera C03 streuen um 0.100 px, 2.5-mal so viel")
    assert one.hint.startswith("Fokus, Blende und Belichtung prüfen") and "--leave-out" not in one.hint
    languages.use("en")
    (one,) = advice(result, ())
    assert one.message == finding.message


def real_errors(tmp_path: Path) -> list:
    """What the engine says to mistakes and broken files."""
    from spherecal.base.errors import SpherecalError
    from spherecal.targets.images import read_image
    from spherecal_cameras.sources import open_source
    from spherecal_files.atomic import write_file_whole
    from spherecal_verify.limit import parse_limit

    (tmp_path / "no.png").write_bytes(b"no picture")
    found = []
    for act in (
        lambda: open_source("nonsense"),
        lambda: open_source("simulated:nonsense"),
        lambda: parse_limit("x"),
        lambda: read_image(tmp_path / "no.png"),
        lambda: write_file_whole(tmp_path / "no.png" / "x", b""),
    ):
        with pytest.raises(SpherecalError) as caught:
            act()
        found.append(caught.value)
    return found


def test_the_errors_of_the_engine_that_are_known_are_translated(tmp_path, german):
    errors = real_errors(tmp_path)
    for error in errors:
        message, hint = error_text(error)
        assert message != error.message, error.message
        assert not error.hint or hint != error.hint, error.hint
    languages.use("en")
    assert all(error_text(error) == (error.message, error.hint) for error in errors)


@pytest.mark.slow
def test_a_lost_camera_is_said_in_german(wizard, german):
    from spherecal_cameras.simulated.simulated_source import SimulatedFault
    from spherecal_gui.presenters.connect_presenter import camera_lines

    wizard.cameras.connection.source.inject(SimulatedFault("lose", "C02"))
    pump(lambda: not wizard.cameras.connection.source.statuses()["SIM-C02"].state.usable)
    lines = {line.name: line for line in camera_lines(wizard.cameras.connection, wizard.project.cameras)}
    assert lines["C02"].word.startswith("Verloren.")
    assert status(wizard, "look") is Status.DONE


# --- all cameras at once ---------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_exposures_and_pixel_formats_of_all_cameras_are_set_by_one_click(qtbot, wizard):
    page = LookPage(wizard)
    qtbot.addWidget(page)
    page.resize(1300, 800)
    page.show()
    state = wizard.state.of("look")
    page.enter(state.step)
    page.refresh()
    names = wizard.cameras.connection.names
    assert page.format.currentText() == "Mono8"
    wizard.tuning.set_camera("SIM-C03", names["SIM-C03"], 90_000.0, 0.0)
    settle(wizard)
    page.expose.click()
    settle(wizard)
    chosen = [wizard.tuning.settings_of(serial).exposure_us for serial in names]
    assert all(8_000 < one < 12_000 for one in chosen), "the demo rig is lit for 10 ms"
    page.format.setCurrentText("Mono12")
    page.format.textActivated.emit("Mono12")
    settle(wizard)
    assert {one.pixel_format for one in wizard.tuning.of_all()} == {"Mono12"}
    pump(lambda: all((s := wizard.cameras.live.sight(one)) is not None and s.frame.bits == 12 for one in names))
    page.refresh()
    assert page.format.currentText() == "Mono12"
    page.gain.setValue(3.0)
    settle(wizard)
    assert {one.gain_db for one in wizard.tuning.of_all()} == {3.0}
    wizard.tuning.set_camera("SIM-C03", names["SIM-C03"], 10_000.0, 0.0)
    settle(wizard)
    page.gain.clearFocus()
    page.refresh()
    assert page.gain.text() == page.gain.specialValueText()
    wizard.tuning.set_all(gain_db=0.0)
    settle(wizard)
    sight = wizard.cameras.live.sight("SIM-C03")
    assert sight.histogram.sum() == np.ceil(np.array(sight.frame.image.shape) / 8).prod()
    assert sight.saturated < 0.001 and sight.histogram[40:].sum() > 0, "bright dots that do not clip"
    tile = page.wall.tiles["SIM-C03"]
    before = tile.grab().toImage()
    tile.show_histogram(None)
    assert tile.grab().toImage() != before, "the histogram is seen"
