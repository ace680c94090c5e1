"""Results: what findings advise as buttons, repairs that come and go, residuals image by image, what has changed."""

import os
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtWidgets import QLabel, QPushButton

from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal.calibrate import calibrate
from spherecal.data.findings import AdvisedRepair, Finding
from spherecal_documents.scene.model import SceneData, scene_data
from spherecal_files.write_result import write_result
from spherecal_gui import project as changes
from spherecal_gui import theme
from spherecal_gui.presenters.results_presenter import (
    Action,
    FindingAdvice,
    advice,
    camera_rows,
    compared_text,
    repair_text,
    residual_text,
    residuals_of,
)
from spherecal_gui.project import Artefacts, Project
from spherecal_gui.project_folder import load_project, save_project
from spherecal_gui.tasks.outcome import read_outcome
from spherecal_gui.widgets.results_views import FindingsList
from spherecal_gui.workflow import Running, Status, resolve
from spherecal_rigs.result_folder import read_result
from spherecal_sim.simulate_session import write_session
from tests.networks import calibrated, one_thread, simulated

__all__ = ["one_thread"]

# --- findings --------------------------------------------------------------------------------------------------------


def test_buttons_say_what_they_do():
    repairs = [
        ("--swap", "C05,C06@P3"), ("--swap", "A,B"), ("--split", "C05@P3"), ("--leave-out", "placement:P2"),
        ("--leave-out", "C1@P1"),
    ]  # fmt: skip
    assert [repair_text(*one) for one in repairs] == [
        "Exchange C05 / C06 at P3",
        "Exchange A / B",
        "Split C05 from P3 on",
        "Leave out P2",
        "Leave out C1 at P1",
    ]


def moved_camera() -> Finding:
    values = {"camera": "C05", "place": "P3", "size": Phrase("move-pixels", {"px": 3.0}), "evidence": "e"}
    return Finding("camera-moved", "warning", values, ("C05", "P3"), (AdvisedRepair("split", "C05@P3"),), "before")


def result_with(*findings: Finding) -> Any:
    return SimpleNamespace(rig=SimpleNamespace(quality=SimpleNamespace(findings=findings)), camera_ids=["C05"])


def test_advice_retakes_repairs_or_shows():
    few = Finding("few-placements", "warning", {"placements": 2})
    told = replace(moved_camera(), severity="info")
    first, second, third = advice(result_with(moved_camera(), few, told), ("P1", "P3"))
    assert [(one.kind, one.target) for one in first.actions] == [("--split", "C05@P3"), ("retake", "P3")]
    assert first.title == "C05 was moved, 3 px in its images, at placement 3" and not first.where
    assert (second.title, second.where) == ("Few placements", "")
    assert [one.kind for one in second.actions] == ["add placement"]
    assert [(one.kind, one.target) for one in third.actions] == [("show camera", "C05")]


def test_a_repair_that_was_asked_for_is_listed_and_can_be_taken_back(qtbot):
    shown = FindingsList()
    qtbot.addWidget(shown)
    asked = Action("--split", "C05@P3", "Split C05 from P3 on")
    shown.show_advice([FindingAdvice("caution", "Moved", "It moved.", "", (asked,))], (("--split", "C05@P3"),))
    back, _, split = shown.findChildren(QPushButton)  # between them “Details”
    assert not split.isEnabled() and "calibrate again" in split.toolTip()
    with qtbot.waitSignal(shown.taken_back) as caught:
        back.click()
    assert caught.args == ["--split", "C05@P3"]


# --- repairs in the project ------------------------------------------------------------------------------------------


def calibrated_project(folder: Path = Path("nowhere")) -> Project:
    project = Project(folder, "simulated:demo", cameras=("S1",), looked=("S1",))
    project = replace(project, artefacts=Artefacts("dots8", "", "", None))
    for name in project.placements:
        project = changes.with_set(project, name, "t")
    return changes.with_calibration(project, "valid")


def test_a_repair_makes_the_calibration_stale_and_taking_it_back_current_again():
    project = calibrated_project()
    mended = changes.with_repair(project, "--leave-out", "C05@P3")
    state = resolve(mended, Running(connected=True)).of("calibrate")
    assert state.status is Status.STALE
    assert state.reason is not None and state.reason.values == ("repairs",)
    back = changes.without_repair(mended, "--leave-out", "C05@P3")
    assert resolve(back, Running(connected=True)).of("calibrate").status is Status.DONE
    assert changes.with_repair(mended, "--leave-out", "C05@P3") == mended


def test_a_placement_that_was_taken_again_needs_no_mending():
    project = changes.with_repair(calibrated_project(), "--leave-out", "C05@P3")
    project = changes.with_repair(project, "--split", "C05@P2")
    again = changes.with_set(project, "P3", "later")
    assert again.repairs == (("--split", "C05@P2"),)
    deleted = changes.without_set(project, "P2")
    assert deleted.repairs_now == (("--leave-out", "C05@P3"),), "nobody splits at a placement that is not there"
    assert changes.with_set(deleted, "P2", "t").repairs_now == project.repairs


def test_repairs_survive_a_crash(tmp_path):
    project = changes.with_repair(calibrated_project(tmp_path), "--swap", "C05,C06@P3")
    save_project(project)
    assert load_project(tmp_path).repairs == (("--swap", "C05,C06@P3"),)


# --- the result itself -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A session, its result, and a profile that has another calibration of the rig in use."""
    from spherecal_rigs.save_entry import SaveOptions, save_result
    from spherecal_rigs.store import apply, create_profile, open_profile

    home = tmp_path_factory.mktemp("results")
    session, truth = simulated("demo", 1, targets=200)
    write_session(session, truth, home / "session")
    calibration = calibrated("demo", 1, targets=200)[0]
    write_result(calibration, home / "result")
    cameras = list(calibration.rig.cameras)
    moved = replace(cameras[1], translation_mm=cameras[1].translation_mm + np.array([0.8, 0.0, 0.0]))
    rig = replace(calibration.rig, cameras=(cameras[0], moved, *cameras[2:]), input_sha256="0" * 64, covariance=None)
    write_result(replace(calibration, rig=rig), home / "before")
    number = save_result(create_profile(home / "profile"), home / "before", SaveOptions())
    apply(open_profile(home / "profile"), number)
    return home


@pytest.fixture(scope="module")
def outcome(folders):
    return read_outcome(folders / "result", folders / "session", folders / "profile", (), Context())


def test_the_change_since_the_calibration_in_use_names_the_camera(outcome):
    assert outcome.compared is not None
    text, level = compared_text(outcome.compared)
    assert level == "caution"
    assert outcome.result.rig.cameras[1].id + " moved" in text
    assert "lengths change by up to" in text
    assert compared_text(None) == ("", "none")


def test_every_camera_has_a_path_to_the_first(outcome):
    names = {camera.id for camera in outcome.result.rig.cameras}
    reached, links = {outcome.result.rig.reference_camera}, set(outcome.links)
    for _ in names:
        reached |= {one for pair in links for one in pair if set(pair) & reached}
    assert reached == names
    assert len(links) <= len(names) * 2


def test_the_scene_has_the_map_of_uncertainty(outcome):
    data = scene_data(outcome.result, outcome.links)
    assert data is not None
    low, high = data.map_range
    assert 0.005 < low < high < 2.0
    assert len(data.map_places) == len(data.map_mm) == len(data.map_tints(dark=True)) > 20
    assert len(data.link_ends) == len(outcome.links)
    assert data.map_length_mm == 500.0


def test_without_a_profile_there_is_nothing_to_compare(folders, tmp_path):
    assert read_outcome(folders / "result", folders / "session", tmp_path, (), Context()).compared is None


def test_residuals_of_one_image(outcome):
    everything = residuals_of(outcome.result, "C01")
    assert everything is not None and everything.placement is None
    assert everything.placements == ("P1", "P2", "P3", "P4")
    parts = [residuals_of(outcome.result, "C01", name) for name in everything.placements]
    assert sum(len(part.uv) for part in parts if part is not None) == len(everything.uv)
    assert residuals_of(outcome.result, "C99") is None


def test_residuals_in_px_and_in_mm_at_the_ball(outcome):
    result = outcome.result
    shown = residuals_of(result, "C02", "P2")
    assert shown is not None
    told = [float(number) for number in re.findall(r"\d+\.\d+", residual_text(result, shown))]
    lengths = np.hypot(*shown.du_dv[shown.used].T)
    assert told[:2] == pytest.approx([lengths.mean(), lengths.max()], abs=6e-4)
    (ball,) = (one for one in result.spheres if one.placement == "P2")
    camera = result.rig.camera("C02")
    each = np.linalg.norm(ball.centre_mm - camera.centre_mm) / camera.intrinsics[0]
    assert told[2:] == pytest.approx([lengths.mean() * each, lengths.max() * each], abs=6e-4)
    free = replace(result, rig=replace(result.rig, scale=replace(result.rig.scale, source="none")))
    assert "mm" not in residual_text(free, shown), "without a scale there are no millimetres"


def test_a_hint_for_which_there_is_a_button_names_no_option():
    finding = moved_camera()
    (one,) = advice(result_with(finding), ("P3",))
    assert one.message == finding.message
    assert "--split C05@P3" in finding.hint
    assert one.hint == "Fix the camera's mount."
    assert ("--split", "C05@P3") in [(action.kind, action.target) for action in one.actions]
    (told,) = advice(result_with(replace(finding, severity="info")), ("P3",))
    assert "--split C05@P3" in told.hint, "there is no button for it"


def test_findings_of_a_result_folder_speak_and_offer_repairs(tmp_path, monkeypatch):
    """Their values come back from findings.json; without it they keep the words of rig.json."""
    calibration = calibrated("demo", 1)[0]
    quality = replace(calibration.rig.quality, findings=(moved_camera(), *calibration.rig.quality.findings))
    write_result(replace(calibration, rig=replace(calibration.rig, quality=quality)), tmp_path / "result")
    monkeypatch.setattr("spherecal_gui.languages.now", lambda: "de")
    first = advice(read_result(tmp_path / "result"), ())[0]
    assert first.message == "Die Kamera C05 hat sich vor P3 bewegt, um etwa 3 px in ihren Bildern: e."
    assert [(one.kind, one.target) for one in first.actions] == [("--split", "C05@P3")]
    (tmp_path / "result" / "findings.json").unlink()
    first = advice(read_result(tmp_path / "result"), ())[0]
    assert first.title == "Eine Kamera wurde zwischen Aufstellungen bewegt"
    assert first.message == moved_camera().message


def test_the_plain_view_draws_map_and_links(qtbot, outcome, monkeypatch):
    from spherecal_gui.widgets.scene_view import SceneView

    monkeypatch.setenv("SPHERECAL_3D", "2d")
    view = SceneView()
    qtbot.addWidget(view)
    view.resize(500, 400)
    data = scene_data(outcome.result, outcome.links)
    assert isinstance(data, SceneData)
    view.show_scene(data)
    plain = view.grab().toImage()
    view.set_layers((view.layers - {"links"}) | {"map"})
    mapped = view.grab().toImage()
    view.set_layers(view.layers | {"links"})
    assert plain != mapped
    assert view.grab().toImage() != mapped


def test_the_table_and_the_finding_count_the_same_dots_as_left_out(tmp_path):
    session = simulated("demo", 1, targets=200, outlier_fraction=0.02)[0]
    calibration = calibrate(session)
    write_result(calibration, tmp_path / "result")
    rows = camera_rows(read_result(tmp_path / "result"))
    told = next(one for one in calibration.rig.quality.findings if one.code == "outliers-removed")
    assert sum(row.left_out for row in rows) == int(told.message.split()[0]) > 50
    assert max(rows, key=lambda row: row.left_out).camera == told.where[0]


def test_the_marks_of_findings_take_the_colours_of_the_look(qtbot, qapp):
    """They kept the light look's grey on the dark ground."""
    found, marks = FindingsList(), []
    qtbot.addWidget(found)
    try:
        for dark in (False, True):
            theme.apply(qapp, dark=dark)
            found.show_advice([FindingAdvice("none", "Some dots were left out", "", "", where="C01")])
            mark = next(one for one in reversed(found.findChildren(QLabel)) if not one.pixmap().isNull())
            image = mark.pixmap().toImage()
            inked = {image.pixelColor(x, y).name() for x in range(image.width()) for y in range(image.height())
                     if image.pixelColor(x, y).alpha() == 255}  # fmt: skip
            marks.append((inked, theme.now().soft))
    finally:
        theme.apply(qapp, dark=False)
    assert all(soft in inked for inked, soft in marks), marks
