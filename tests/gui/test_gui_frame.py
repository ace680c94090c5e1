"""Origin and axes in the wizard: the choice without widgets, the dialog, and what the project keeps of it."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtWidgets import QFileDialog, QPushButton

from spherecal.base.context import Context
from spherecal_app.cli.main import main
from spherecal_files.write_result import write_result
from spherecal_gui import languages, theme
from spherecal_gui import project as changes
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.frame_dialog import FrameDialog
from spherecal_gui.pages.save_page import SavePage
from spherecal_gui.presenters.frame_presenter import FrameChoice, frame_words
from spherecal_gui.project import Artefacts, Project
from spherecal_gui.project_folder import profile_of
from spherecal_gui.tasks.outcome import read_outcome
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Step
from spherecal_rigs.framed_rig import FRAME, write_frame
from spherecal_rigs.user_frame import FrameDefinition
from spherecal_sim.simulate_session import write_session
from tests.gui_walking import settle
from tests.networks import calibrated, one_thread

__all__ = ["one_thread"]

THREE = FrameDefinition("P1", "P2", "P3")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A project's folder: session and result."""
    home = tmp_path_factory.mktemp("frame") / "project"
    calibration, session, truth = calibrated("demo", 1)
    write_session(session, truth, home)
    write_result(calibration, home / "result")
    return home


@pytest.fixture(scope="module")
def outcome(folder):
    return read_outcome(folder / "result", folder, folder.parent / "none", (), Context())


@pytest.fixture
def choice(outcome):
    return FrameChoice(outcome.result, outcome.places)


def opened(folder: Path, outcome) -> Controller:
    """A controller with the project open and its result read."""
    made = Controller()
    project = Project(folder, "simulated:demo", cameras=("S1",), looked=("S1",))
    project = replace(project, artefacts=Artefacts("dots8", "", "", None))
    for name in project.placements:
        project = changes.with_set(project, name, "t")
    made.project = changes.with_calibration(project, "valid")
    made.outcome = outcome
    made.result_changed.emit()
    return made


@pytest.fixture
def controller(qapp, folder, outcome):
    """A controller with the project open and its result read."""
    made = opened(folder, outcome)
    yield made
    (folder / "frame.json").unlink(missing_ok=True)


# --- the choice ------------------------------------------------------------------------------------------------------


def test_at_first_it_is_the_reference_cameras_frame(choice, outcome):
    assert choice.is_plain and not choice.can_undo
    assert choice.sentence == (
        f"Exports are given in: the reference camera's frame ({outcome.result.rig.reference_camera}).",
        "none",
    )
    camera = next(c for c in choice.scene.scene.cameras if c.id == outcome.result.rig.reference_camera)
    for (start, end), (_, tip) in zip(choice.axes, [e for e, _ in choice.scene.reference_axes], strict=True):
        assert start == pytest.approx(camera.centre, abs=1e-6)
        assert np.cross(end - start, tip - start) == pytest.approx([0, 0, 0], abs=1e-6), "the same axes, longer"


def test_an_origin_suggests_the_other_places(choice):
    choice.choose("origin", "P1")
    definition = choice.definition
    assert {definition.origin, definition.x, definition.xy} < {"P1", "P2", "P3", "P4"}
    away = {n: np.linalg.norm(p.place_mm - choice.places["P1"].place_mm) for n, p in choice.places.items()}
    assert definition.x == max(away, key=lambda name: away[name])
    text, level = choice.sentence
    assert level == "good" and "P1 lies at 0.0 / 0.0 / 0.0 mm" in text and "Uncertainty" in text
    assert [name for name, _ in choice.marked] == [definition.origin, definition.x, definition.xy]
    ((start, tip), *_), marked = choice.axes, dict(choice.marked)
    assert start == pytest.approx(marked["P1"], abs=1e-6)
    to_x = marked[definition.x] - marked["P1"]
    assert np.cross(tip - start, to_x) == pytest.approx([0, 0, 0], abs=1e-6 * float(to_x @ to_x))


def test_every_choice_can_be_taken_back(choice):
    seen = [choice.definition]
    choice.choose("origin", "P1")
    seen.append(choice.definition)
    choice.turn("x90")
    seen.append(choice.definition)
    for z in (2.0, 25.0, 250.0):  # typed figure by figure
        choice.let_lie_at((0.0, 0.0, z))
    assert choice.lies_at_mm == (0.0, 0.0, 250.0) and choice.definition.offset_mm == (0.0, -250.0, 0.0)
    assert "P1 lies at 0.0 / 0.0 / 250.0 mm" in choice.sentence[0], "in the axes as they are"
    seen.append(choice.definition)
    choice.reset()
    assert choice.definition.places and not choice.definition.turns and not any(choice.definition.offset_mm)
    for before in reversed(seen):
        choice.undo()
        assert choice.definition == before
    assert not choice.can_undo


def test_places_that_do_not_do_are_said(qapp, choice):
    choice.choose("origin", "P1")
    choice.choose("x", choice.definition.xy)
    assert choice.frame is None and choice.axes == []
    assert choice.sentence[1] == "bad" and "named twice" in choice.sentence[0]
    languages.use("de")
    try:
        choice.choose("x", "P1")
        assert "ist zweimal genannt" in choice.sentence[0]
    finally:
        languages.use("en")


def test_places_that_are_gone_are_replaced_as_far_as_can_be(outcome):
    assert FrameChoice(outcome.result, outcome.places, replace(THREE, origin="P9")).is_plain
    kept = FrameChoice(outcome.result, outcome.places, replace(THREE, xy="P9", turns=("x90",))).definition
    assert kept.origin == "P1" and kept.turns == ("x90",) and "P9" not in kept.places


def test_words_for_the_page():
    assert frame_words(None, "C01") == "the reference camera's frame (C01)"
    words = frame_words(replace(THREE, offset_mm=(0.0, 0.5, 250.0), turns=("z90", "x-90")), "C01")
    assert words.endswith("XY plane with P3, offset 0 / 0.5 / 250 mm, turned Z +90° X \N{MINUS SIGN}90°")


# --- the dialog ------------------------------------------------------------------------------------------------------


def press(dialog, key):
    next(one for one in dialog.findChildren(QPushButton) if one.property("key") == key).click()


@pytest.fixture
def dialog(qtbot, choice):
    made = FrameDialog(choice)
    qtbot.addWidget(made)
    made.show()
    return made


def test_the_dialog_follows_every_press(dialog, choice):
    assert not dialog.place["x"].isEnabled() and not dialog.undo.isEnabled()
    before = dialog.scene.grab().toImage()
    dialog.place["origin"].setCurrentIndex(dialog.place["origin"].findData("P2"))
    assert choice.definition.origin == "P2"
    assert dialog.place["x"].currentData() == choice.definition.x is not None
    assert dialog.scene.grab().toImage() != before
    dialog.shift[2].setValue(250.0)
    press(dialog, "turn-x-90")
    assert choice.definition.offset_mm == (0.0, 0.0, 250.0) and choice.definition.turns == ("x-90",)
    assert dialog.sentence.text() == choice.sentence[0]
    assert [box.value() for box in dialog.shift] == [0.0, -250.0, 0.0], "the same place in the turned axes"
    press(dialog, "frame-undo")
    press(dialog, "frame-undo")
    assert dialog.shift[2].value() == 0.0
    dialog.place["x"].setCurrentIndex(dialog.place["x"].findData("P2"))
    assert not dialog.ok.isEnabled() and "named twice" in dialog.ok.toolTip()
    press(dialog, "frame-camera")
    assert choice.is_plain and dialog.ok.isEnabled() and not dialog.place["xy"].isEnabled()


def test_axes_are_red_green_blue(dialog, choice):
    from spherecal_documents.scene.model import AXIS_TINTS

    choice.choose("origin", "P1")
    dialog.scene.update()
    image = dialog.scene.grab().toImage()
    (start, _), tips = choice.axes[0], [end for _, end in choice.axes]
    for tip, tint in zip(tips, AXIS_TINTS, strict=True):
        x, y = dialog.scene.shown_eye.flat((0.3 * start + 0.7 * tip)[None])[0]
        near = {image.pixelColor(int(x) + i, int(y) + j).name() for i in (-2, 0, 2) for j in (-2, 0, 2)}
        assert tint in near


def test_the_dialog_can_be_used_by_keyboard_and_read_aloud(dialog):
    for widget in (*dialog.place.values(), *dialog.shift, *dialog.findChildren(QPushButton)):
        assert widget.accessibleName()
        assert widget.focusPolicy() & type(widget.focusPolicy()).TabFocus


@pytest.mark.parametrize("language", ["en", "de", "zh_CN"])
def test_from_afar_it_fits_a_small_screen(qtbot, qapp, outcome, language):
    languages.use(language)
    theme.apply(qapp, dark=False, far=True)
    try:
        choice = FrameChoice(outcome.result, outcome.places, replace(THREE, offset_mm=(1.0, 2.0, 3.0), turns=("z90",)))
        dialog = FrameDialog(choice)
        qtbot.addWidget(dialog)
        dialog.show()
        least = dialog.minimumSizeHint()
        assert least.width() <= 1280 and least.height() <= 760
    finally:
        theme.apply(qapp, dark=False, far=False)
        languages.use("en")


# --- the project -----------------------------------------------------------------------------------------------------


def test_the_frame_is_kept_used_and_given_up(controller, folder, tmp_path):
    definition = replace(THREE, offset_mm=(0.0, 0.0, 250.0), turns=("x90", "x90"))
    assert controller.user_frame.choose(definition)
    assert controller.user_frame.frame.definition == definition
    assert controller.saving.export("csv", tmp_path / "rig.csv")
    settle(controller)
    line = (tmp_path / "rig.csv").read_text().splitlines()[1].split(",")
    rig = controller.result.rig
    camera = rig.camera(line[0])
    assert np.array(line[-3:], dtype=float) == pytest.approx(
        controller.user_frame.frame.apply(camera.centre_mm[None])[0]
    )
    assert controller.user_frame.choose(FrameDefinition())
    assert controller.user_frame.frame is None and not (folder / "frame.json").exists()


def test_the_command_makes_the_same_file(controller, folder, tmp_path, capsys):
    controller.user_frame.choose(replace(THREE, offset_mm=(-1.5, 0.0, 250.0), turns=("x90", "z-90")))
    assert controller.saving.commands()[-1].startswith("spherecal frame ")
    words = list(controller.user_frame.command())
    words[words.index("-o") + 1] = str(tmp_path / "again.json")
    assert main(words[1:]) == 0
    assert (tmp_path / "again.json").read_bytes() == (folder / "frame.json").read_bytes()


def test_another_calibration_makes_the_frame_anew_or_says_that_it_cannot(controller, folder, outcome):
    controller.user_frame.choose(THREE)
    before = FRAME.read(folder / "frame.json")
    moved = {n: replace(p, place_mm=p.place_mm + np.array([0, 0, 5.0])) for n, p in outcome.places.items()}
    controller.outcome = replace(outcome, places=moved)
    controller.result_changed.emit()
    after = FRAME.read(folder / "frame.json")
    assert after.origin_mm == pytest.approx(before.origin_mm + np.array([0, 0, 5.0]))
    assert controller.user_frame.frame.origin_mm == pytest.approx(after.origin_mm)

    said = []
    controller.said.connect(lambda *words: said.append(" ".join(words)))
    controller.outcome = replace(outcome, places={n: p for n, p in outcome.places.items() if n != "P3"})
    controller.result_changed.emit()
    assert controller.user_frame.frame is None
    assert 'no place "P3"' in controller.user_frame.problem
    assert len(said) == 1 and "Choose origin and axes again" in said[0]
    assert controller.user_frame.definition == THREE
    controller.user_frame.choose(replace(THREE, xy="P4"))
    assert controller.user_frame.frame is not None and not controller.user_frame.problem


def test_the_rigs_frame_is_the_default_of_later_calibrations(controller, folder, outcome):
    """As it is, in the world that the reference camera keeps: the ball of today stands elsewhere."""
    profile = profile_of(controller.project)
    assert controller.user_frame.choose(THREE)
    kept = controller.user_frame.frame
    assert controller.saving.save_profile(profile, True, "for the test")
    settle(controller)
    (folder / "frame.json").unlink()
    moved = {n: replace(p, place_mm=p.place_mm + np.array([0, 0, 5.0])) for n, p in outcome.places.items()}
    controller.outcome = replace(outcome, places=moved)
    controller.result_changed.emit()
    assert controller.user_frame.frame is not None and np.array_equal(
        controller.user_frame.frame.rotation, kept.rotation
    )
    assert np.array_equal(controller.user_frame.frame.translation_mm, kept.translation_mm)
    assert controller.user_frame.command() == (), "it was not made of this calibration's places"
    assert controller.user_frame.choose(FrameDefinition())
    assert controller.user_frame.frame is not None and controller.user_frame.frame.definition == FrameDefinition(), (
        "and it can be given up"
    )
    other = next(one.id for one in outcome.result.rig.cameras if one.id != outcome.result.rig.reference_camera)
    write_frame(replace(kept, reference_camera=other), profile / "frame.json")
    (folder / "frame.json").unlink()
    controller.outcome = outcome
    controller.result_changed.emit()
    assert controller.user_frame.frame is None, "another camera's world"
    shutil.rmtree(profile)  # the other tests' projects share it


def test_a_project_opens_again_with_its_frame(controller, folder, outcome):
    controller.user_frame.choose(THREE)
    again = Controller()
    again.project = controller.project
    again.changed.emit()
    assert again.user_frame.frame is not None and again.user_frame.frame.definition == THREE, (
        "before the result is read"
    )
    (folder / "frame.json").write_text("{")
    again.project = None
    again.changed.emit()
    again.project = controller.project
    again.outcome = outcome
    again.result_changed.emit()
    assert again.user_frame.frame is None and "frame.json" in again.user_frame.problem


@pytest.mark.parametrize(("source", "wanted"), [("simulated:demo", "SIMULATED-rig-csv"), ("genicam", "rig-csv")])
def test_what_is_exported_from_a_training_is_called_simulated(qtbot, controller, monkeypatch, source, wanted):
    proposed = []
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *words: proposed.append(words[-1]) or ("", ""))
    controller.project = replace(controller.project, source=source)
    page = SavePage(controller)
    qtbot.addWidget(page)
    page.enter(Step("save", "save"))
    page.form.setCurrentText("csv")
    page.export.click()
    assert [Path(one).name for one in proposed] == [wanted]


def test_the_page_says_in_which_frame_exports_are(qtbot, controller):
    page = SavePage(controller)
    qtbot.addWidget(page)
    page.enter(Step("save", "save"))
    assert page.given_in.text().startswith("Exports are given in: the reference camera's frame (C")
    page.axes.click()
    assert page.dialog is not None
    page.dialog.place["origin"].setCurrentIndex(page.dialog.place["origin"].findData("P1"))
    page.dialog.ok.click()
    page.axes.click()
    page.dialog.reject()
    page.refresh()
    assert "the user's frame: origin P1" in page.given_in.text()
    assert page.commands.toPlainText().splitlines()[-1].startswith("spherecal frame")
    gone = {n: p for n, p in controller.outcome.places.items() if n != "P1"}
    controller.outcome = replace(controller.outcome, places=gone)
    controller.result_changed.emit()
    page.refresh()
    assert not page.export.isEnabled() and "cannot be made" in page.export.toolTip()
    assert page.axes.isEnabled()


def test_without_a_result_there_is_nothing_to_choose(qtbot, controller):
    controller.outcome = None
    controller.result_changed.emit()
    page = SavePage(controller)
    qtbot.addWidget(page)
    page.enter(Step("save", "save"))
    assert not page.axes.isEnabled() and page.axes.toolTip() == "There is no calibration yet."
    assert not controller.user_frame.choose(THREE)


def test_a_world_of_another_camera_is_warned_of(qtbot, folder, outcome, tmp_path):
    """The camera whose frame is the world of the calibration in use sees nothing this time."""
    project = tmp_path / "frames" / "project"
    shutil.copytree(folder, project)
    controller = opened(project, outcome)
    assert controller.project is not None and controller.result is not None
    controller.project = replace(controller.project, step="calibrate")
    assert controller.saving.save_profile(profile_of(controller.project), True, "for the test")
    settle(controller)
    before = controller.result.rig.reference_camera
    window = WizardWindow(project.parent, controller=controller)
    qtbot.addWidget(window)
    window.show()

    assert controller.computation.calibrate()
    settle(controller)
    assert controller.result.rig.reference_camera == before
    assert not window.banner.isVisible(), window.banner.text

    table = project / "observations.csv"
    lines = table.read_text(encoding="utf-8").splitlines(keepends=True)
    table.write_text("".join(one for one in lines if one.split(",")[1] != before), encoding="utf-8")
    assert controller.computation.calibrate()
    settle(controller)
    now = controller.result.rig.reference_camera
    assert now != before
    assert window.banner.isVisible()
    assert f"it was that of {before}, now it is that of {now}" in window.banner.text
    window.close()
