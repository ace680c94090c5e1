"""What technicians know from other programs and expect here, as far as no other test holds it."""

import json
import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QCoreApplication, QEvent, QPoint, Qt
from PySide6.QtGui import QPixmap
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLineEdit

from spherecal.base.context import Context, Progress
from spherecal.data.findings import Finding, leave_out
from spherecal_app.cli.main import main
from spherecal_cameras.protocol import CameraSettings, CameraState, CameraStatus, Counters
from spherecal_files.write_result import write_result
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.calibrate_page import CalibratePage
from spherecal_gui.pages.check_page import CheckPage
from spherecal_gui.pages.profile_dialog import ProfileDialog
from spherecal_gui.presenters.calibrate_presenter import CourseOfWork
from spherecal_gui.presenters.check_presenter import check_cells, check_notes, check_verdict
from spherecal_gui.presenters.connect_presenter import CameraLine, connect_summary, model_text
from spherecal_gui.presenters.look_presenter import TileState, figures_text
from spherecal_gui.presenters.placement_presenter import AutoTrigger, Scene
from spherecal_gui.presenters.results_presenter import culprit
from spherecal_gui.presenters.start_presenter import in_use, picture_name, validity_of
from spherecal_gui.project import Computation, Project, fingerprint
from spherecal_gui.project_folder import load_project, save_project
from spherecal_gui.rig_scenes import check_scene
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.kept_check import read_kept_check
from spherecal_gui.tasks.task import BackgroundTask
from spherecal_gui.widgets.tile import Wall
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.wizard.window_settings import expected_s, pace_key, read_durations, with_duration
from spherecal_gui.workflow import Step
from spherecal_rigs.check_rig import FORMAT, VERSION
from spherecal_rigs.save_entry import SaveOptions, save_result
from spherecal_rigs.store import apply, create_profile, open_profile
from tests.gui_walking import pump, settle
from tests.method.test_results import example_calibration


@pytest.fixture
def wall(qtbot):
    made = Wall(renames=True)
    qtbot.addWidget(made)
    made.set_cameras({f"S{i}": f"C{i}" for i in range(1, 7)})
    made.resize(900, 600)
    made.show()
    return made


# 1: rename in place


def test_a_click_on_the_name_edits_it_and_enter_keeps_it(wall):
    named = []
    wall.renamed.connect(lambda *both: named.append(both))
    tile = wall.tiles["S2"]
    QTest.mouseClick(tile, Qt.MouseButton.LeftButton, pos=QPoint(20, 12))
    editor = tile.findChild(QLineEdit)
    QTest.keyClicks(editor, "left front")
    QTest.keyClick(editor, Qt.Key.Key_Return)
    assert named == [("S2", "left front")] and wall.alone is None, "enter is the name's, not the tile's"
    tile.setFocus()
    QTest.keyClick(tile, Qt.Key.Key_F2)
    editor = next(one for one in tile.findChildren(QLineEdit) if one.isVisible())
    QTest.keyClicks(editor, "else")
    QTest.keyClick(editor, Qt.Key.Key_Escape)
    assert len(named) == 1


def test_a_name_that_cannot_be_changed_says_why_and_is_not_edited(wall):
    tile = wall.tiles["S1"]
    tile.why_not_renamed = "The names come from the recording."
    QTest.mouseClick(tile, Qt.MouseButton.LeftButton, pos=QPoint(20, 12))
    assert tile.findChild(QLineEdit) is None


def test_the_controller_refuses_a_name_that_another_camera_has(monkeypatch):
    controller, said, done = Controller(), [], []
    connection: Any = SimpleNamespace(names={"S1": "C1", "S2": "C2"})
    controller.cameras.connection = connection
    controller.said.connect(lambda *one: said.append(one[1]))
    monkeypatch.setattr(controller.tuning, "why_not_renamed", lambda _: "")
    monkeypatch.setattr(controller.tuning, "settings_of", lambda _: CameraSettings())
    monkeypatch.setattr(controller.tuning, "set_camera", lambda *one: done.append(one))
    controller.tuning.name_camera("S1", "C2")
    controller.tuning.name_camera("S1", "a/b")
    assert len(said) == 2 and "C2" in said[0] and not done
    controller.tuning.name_camera("S1", "left")
    assert done[0][:2] == ("S1", "left")


# 4: worst first, always


def test_a_camera_in_trouble_comes_first_once_the_trouble_lasts(wall, monkeypatch):
    monkeypatch.setattr(wall, "underMouse", lambda: False)

    def order():
        at = {serial: wall._grid.getItemPosition(wall._grid.indexOf(tile))[:2] for serial, tile in wall.tiles.items()}
        return sorted(at, key=lambda serial: at[serial])

    rigs = order()
    wall.tiles["S5"].show_state(TileState("C5", "bad", "dark"), np.empty((0, 2)))
    wall.follow_worst(10.0)
    wall.follow_worst(11.0)
    assert order() == rigs, "a moment moves nothing"
    wall.follow_worst(13.5)
    assert order()[0] == "S5" and order()[1:] == [one for one in rigs if one != "S5"]
    wall.tiles["S5"].show_state(TileState("C5", "good", ""), np.empty((0, 2)))
    wall.follow_worst(14.0)
    wall.follow_worst(18.0)
    assert order() == rigs
    wall.worst_first(False)
    wall.tiles["S6"].show_state(TileState("C6", "bad", "dark"), np.empty((0, 2)))
    wall.follow_worst(20.0)
    wall.follow_worst(30.0)
    assert order() == rigs


def test_nothing_moves_under_somebodys_pointer(wall, monkeypatch):
    monkeypatch.setattr(wall, "underMouse", lambda: True)
    wall.tiles["S5"].show_state(TileState("C5", "bad", "dark"), np.empty((0, 2)))
    for now in (1.0, 5.0, 60.0):
        wall.follow_worst(now)
    assert wall._order == []


# 5: all figures on the tile


def test_serial_rate_exposure_and_temperature_stand_on_the_tile():
    status = CameraStatus("S", CameraState.STREAMING, counters=Counters(rate_hz=5.0), temperature_c=41.4)
    assert figures_text("40012345", status, 8000.0) == "40012345 · 5 fps · 8 ms · 41 °C"
    assert figures_text("40012345", None, 125.0) == "40012345 · 0.12 ms"


def test_a_large_tile_has_the_figures_below_its_trouble(wall):
    tile = wall.tiles["S1"]
    state = TileState("C1", "bad", "dark. Lens cap?", 0, "S1 · 8 ms")
    tile.show_state(state, np.empty((0, 2)))
    assert tile._has_two_lines and tile._foot > 30
    tile.resize(200, 130)
    assert not tile._has_two_lines


# 8: named where missing


def test_who_is_missing_is_named():
    def line(name, level):
        return CameraLine(name, "", name, "", level)

    lines = [line("C04", "bad"), *(line(f"C0{i}", "good") for i in (1, 2, 3))]
    assert connect_summary(lines, False, "") == ("3 of 4 cameras ready, without C04", "bad")
    many = [line(f"X{i}", "bad") for i in range(9)]
    assert connect_summary([*many, line("C1", "good")], False, "")[0].endswith("X5 …")
    assert model_text("simulated 1.3 MP") == "simulated 1.3 MP" and model_text("acA2440") == "acA2440"


# 17: hold still


def test_how_long_it_has_lain_still_grows_to_the_whole():
    trigger, still = AutoTrigger(), Scene({"C1": 999}, True)
    assert trigger.held(0.0) == 0.0
    trigger.feed(still, 10.0)
    assert trigger.held(10.75) == 0.5 and trigger.held(20.0) == 1.0
    trigger.feed(replace(still, still=False), 11.0)
    assert trigger.held(11.0) == 0.0


# 21: elapsed and expected


def test_time_is_said_after_a_second_and_compared_with_the_last_times():
    kept = ""
    for seconds in (9.0, 20.0, 21.0, 22.0, 23.0, 300.0):
        kept = with_duration(kept, seconds)
    assert expected_s(read_durations(kept)) == 22.0 and read_durations("x") == () and expected_s(()) is None
    assert pace_key("placement:P3") == "pace-placement"


def test_the_window_says_how_long_work_takes_and_remembers_it(qtbot, tmp_path, monkeypatch):
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    window = WizardWindow(tmp_path / "projects")
    qtbot.addWidget(window)
    go = [False]

    def work(context: Context) -> None:
        context.report("exporting", 0.0)
        pump(lambda: go[0])

    window.controller.runner.start("save", work, lambda _: None, lambda _: None)
    window.controller.runner.task.began_s -= 12.0
    window._tick()
    pump(lambda: window._tick() or "Exporting" in window.doing.text())
    assert window.doing.text().endswith(" s")
    go[0] = True
    settle(window.controller)
    assert read_durations(window.settings.value("pace-save"))[0] >= 12.0
    window.close()


# 30: the culprit


def test_the_culprit_is_who_the_findings_accuse_not_who_has_the_largest_residuals():
    def result(*findings) -> Any:
        quality = SimpleNamespace(findings=findings)
        residuals = SimpleNamespace(placement=np.array(["P1", "P2", "P3"]))
        return SimpleNamespace(camera_ids=("C1", "C2", "C3"), rig=SimpleNamespace(quality=quality), residuals=residuals)

    warning = Finding("dark", "warning", {"limit": 0.1}, ("C1",))
    error = Finding("dark", "error", {"limit": 0.1}, ("P2", "C3"), leave_out("C3@P2"))
    assert culprit(result(warning, error)) == ("C3", "P2")
    assert culprit(result(warning)) == ("C1", None)
    assert culprit(result(Finding("dark", "info", {"limit": 0.1}, ("C1",)))) is None
    assert culprit(result(Finding("dark", "error", {"limit": 0.1}, ("P1",)))) is None


# 37: the chip


@pytest.mark.parametrize(
    ("ago", "words", "at_start"),
    [
        ({"minutes": 5}, "5 min old", "5 minutes"),
        ({"hours": 3}, "3 h old", "3 hours"),
        ({"hours": 40}, "40 h old", "40 hours"),
        ({"days": 4}, "4 days old", "4 days"),
    ],
)
def test_chip_and_start_say_how_old_and_by_whom(tmp_path, ago, words, at_start):
    write_result(example_calibration(), tmp_path / "result")
    made = datetime.now(UTC) - timedelta(**ago)
    profile = tmp_path / "rig-profile"
    options = SaveOptions(calibrated_at=made, note="Maria, after the bump")
    number = save_result(create_profile(profile), tmp_path / "result", options)
    apply(open_profile(profile), number)
    word, _, details = validity_of(profile)
    assert word.endswith(words) and "Maria" in details and f"{made.astimezone():%Y-%m-%d %H:%M}" in details
    found = in_use(profile)
    assert found is not None and found.age == f"Calibrated {at_start} ago"
    assert open_profile(profile).validity().age_hours == pytest.approx(timedelta(**ago).total_seconds() / 3600, abs=0.1)


# a cancelled computation, another language, a check of another day


@pytest.fixture
def page(qtbot, tmp_path):
    controller = Controller()
    controller.project = Project(tmp_path / "p", "simulated:demo", step="calibrate")
    made = CalibratePage(controller)
    qtbot.addWidget(made)
    made.step = Step("calibrate", "calibrate")
    return made


def course(*stages):
    made = CourseOfWork()
    for stage in stages:
        made.add(Progress(stage, 0.5))
    return made


def test_a_cancelled_stage_is_not_ticked(page):
    page.course = page.controller.computation.course = course("detect", "triples")
    page._draw()
    assert page._stages.text().count("✓") == 1 and page._stages.text().count("✕") == 1
    page.course = page.controller.computation.course = course("detect", "triples", "writing the result")
    page._draw()
    assert page._stages.text().count("✓") == 3 and "✕" not in page._stages.text()


def test_what_the_computation_said_last_counts(page):
    """It ended between two ticks of the window: a valid calibration had a cross at its last stage."""
    task = BackgroundTask("calibrate", lambda context: context.on_progress(Progress("writing the result", 1.0)))
    page.course = page.controller.computation.course = course("detect", "triples")
    page.controller.computation._task = task
    task.run()
    page.controller.computation.follow()
    page._show_news(last=True)
    assert page._stages.text().count("✓") == 3 and "✕" not in page._stages.text()


def test_a_window_made_anew_shows_the_stages_and_another_project_does_not(page, qtbot):
    page.controller.computation.course = course("detect", "triples")
    other = CalibratePage(page.controller)
    qtbot.addWidget(other)
    assert "Linking three cameras" in other._stages.text()
    page.controller.computation.course = None
    other.step = Step("calibrate", "calibrate")
    other.refresh()
    assert other._stages.text() == ""


def test_the_paper_s_method_is_chosen_before_and_among_the_details(page):
    save_project(page.project)
    page.show()
    page.refresh()
    before = page.project.calibration_inputs
    assert page.method.isVisible() and page.method.currentData() == ""
    page.method.setCurrentIndex(1)
    page.method.activated.emit(1)
    assert page.controller.project.method == load_project(page.project.folder).method == "tao2021"
    assert page.project.calibration_inputs != before  # what was computed by another method is out of date
    page.course = page.controller.computation.course = course("detect", "triples")
    page.refresh()
    assert not page.method.isVisible()
    page.details.setChecked(True)
    assert page.method.isVisible() and page.method.currentData() == "tao2021"


def test_the_window_calibrates_by_the_method_chosen(tmp_path):
    assert main(["simulate", "demo", "--observations-only", "-q", "-o", str(tmp_path / "s")]) == 0
    for chosen, method in (("tao2021", "tao2021"), ("", "auto")):
        jobs.calibrate(Project(tmp_path / "s", "simulated:demo", method=chosen), Context())
        written = json.loads((tmp_path / "s" / "result" / "rig.json").read_bytes())
        assert written["software"]["method"] == method


def test_a_check_that_is_opened_again_has_its_numbers(tmp_path, monkeypatch):
    project = Project(tmp_path / "check", "simulated:demo", purpose="check", placements=("P1",), step="check")
    save_project(replace(project, checked=Computation((("P1", "x"),), "recalibrate")))
    camera = {
        "id": "C03", "verdict": "recalibrate", "points": 90, "rms_px": 2.0, "calibrated_rms_px": 0.1, "moved": True,
        "move_px": 9.1, "shift_mm": 4.5, "turn_deg": 0.3, "point_mm": 7.5, "probability": 0.0, "reason": "",
    }  # fmt: skip
    document = {
        "format": FORMAT, "version": VERSION, "verdict": "recalibrate", "sentence": "", "tolerance_mm": 0.2,
        "cameras": [camera], "untested": ["C05"], "lengths": [],
        "balls": [{"placement": "P1", "dots": 9, "scale_ppm": 3.0, "scale_sd_ppm": 2.0, "changed": False}],
        "findings": [{"severity": "warning", "code": "dark", "message": "m", "hint": "h", "where": ["C03"]}],
    }  # fmt: skip
    (project.folder / "check.json").write_text(json.dumps(document))
    found = read_kept_check(project.folder)
    assert found is not None
    assert check_verdict(found).word == "RECALIBRATE" and "C03" in check_verdict(found).sentence
    (row,) = check_cells(found)
    assert [text for text, *_ in row][2:] == ["9.100", "7.500", "4.500", "0.3000", "2.000", "0.100"]
    assert len(check_notes(found)) == 3 and found.to_repair == ("C03",)
    controller = Controller()
    monkeypatch.setattr(controller.cameras, "connect_all", lambda: None)
    controller.open_project(project.folder)
    assert controller.checks.found.to_repair == ("C03",)
    drawn = check_scene(example_calibration().rig, found)
    assert drawn is not None and drawn.moved == (), "where to is not kept: nothing is drawn, and nothing fails"
    controller.close_project()
    (project.folder / "check.json").write_text("{")
    assert read_kept_check(project.folder) is None


# --- defects that were seen ------------------------------------------------------------------------------------------


@pytest.fixture
def profile(tmp_path):
    """Three calibrations with pictures of their own, the first in use."""
    calibration = example_calibration()
    folder = tmp_path / "rig-profile"
    create_profile(folder)
    for number in range(3):
        rig = replace(calibration.rig, input_sha256=str(number) * 64)
        write_result(replace(calibration, rig=rig), tmp_path / f"result{number}")
        saved = save_result(open_profile(folder), tmp_path / f"result{number}", SaveOptions())
        picture = QPixmap(20 + number, 10)
        picture.fill(Qt.GlobalColor.black)
        picture.save(str(folder / picture_name(saved)))
    apply(open_profile(folder), "0001")
    return folder


def test_the_profile_dialog_uses_the_row_that_was_chosen_once_and_shows_its_picture(qtbot, profile, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "spherecal_gui.pages.profile_dialog.QInputDialog.getText", lambda *_: asked.append(1) or ("tested", True)
    )
    dialog = ProfileDialog(profile)
    qtbot.addWidget(dialog)
    dialog.show()
    assert dialog.table.select_name("0002")
    dialog._selected()
    before = dialog.picture.pixmap().height()
    QTest.mouseClick(dialog.use, Qt.MouseButton.LeftButton)
    QTest.mouseDClick(dialog.use, Qt.MouseButton.LeftButton)
    found = in_use(profile)
    assert found is not None and found.number == "0002" and dialog.table.chosen == "0002" and len(asked) == 1
    assert not dialog.use.isEnabled()
    assert dialog.picture.pixmap().height() != before, "21 x 10 instead of 20 x 10, at the same width"


def test_the_profile_dialog_opens_once_and_goes_with_the_project(qtbot, profile, tmp_path, monkeypatch):
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    window = WizardWindow(tmp_path)
    qtbot.addWidget(window)
    window.show()
    window.start.show_profile()
    window.start.show_profile()

    def there():
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        return [one for one in window.findChildren(ProfileDialog) if one.isVisible()]

    assert len(there()) == 1
    monkeypatch.setattr(window.controller.cameras, "connect_all", lambda: None)
    window.new_project("simulated:demo")
    assert there() == []
    window.close()


def test_advice_is_gone_once_other_placements_are_there(monkeypatch, tmp_path):
    controller, told, asked = Controller(), [], []
    controller.advice.guidance_changed.connect(lambda: told.append(controller.advice.guidance))
    monkeypatch.setattr(controller.advice, "_ask", lambda dots, coarse: asked.append(sorted(dots)))
    controller.project = Project(tmp_path / "p", "simulated:demo", taken={"P1": "a", "P2": "b"}, step="scale")
    connection: Any = SimpleNamespace(plan=None)
    recorded: Any = SimpleNamespace()
    controller.cameras.connection, controller.recording.session = connection, recorded
    monkeypatch.setattr(type(controller.recording), "dots", property(lambda _: {"P1": {}, "P2": {}, "P3": {}}))
    controller.advice.plan_next()
    assert not asked, "only placements show advice"
    controller.project = replace(controller.project, step="placement:P2")
    controller.advice.plan_next()
    advice: Any = "move it left"
    controller.advice._planned(advice)
    controller.project = replace(controller.project, taken={"P1": "a"})
    controller.advice.plan_next()
    assert controller.advice.guidance is None and told[-1] is None and asked == [["P1", "P2"], ["P1"]]
    controller.project = replace(controller.project, taken={"P1": "a", "P2": "b"})
    controller.advice.plan_next()
    assert controller.advice.guidance == advice == told[-1], "the placement was brought back"
    assert len(asked) == 2


def test_why_a_repair_cannot_be_used_is_in_sight(qtbot, tmp_path):
    controller = Controller()
    checked = Computation((("P1", "x"),), "recalibrate")
    repaired = Computation((("check", fingerprint(checked)),), "not valid")
    controller.project = Project(
        tmp_path / "c",
        "simulated:demo",
        purpose="check",
        placements=("P1",),
        taken={"P1": "x"},
        step="check",
        checked=checked,
        repaired=repaired,
    )
    found: Any = SimpleNamespace(
        verdict="recalibrate", to_repair=("C03",), cameras=(), findings=(), untested=(), balls=(), tolerance_mm=None
    )
    controller.checks.found = controller.checks.after = found
    page = CheckPage(controller)
    qtbot.addWidget(page)
    page.enter(Step("check", "check"))
    assert not page.use.isEnabled() and not page.why_not.isHidden() and "not valid" in page.why_not.text()


def test_a_check_that_failed_says_so_in_two_words_and_the_cause_once(qtbot, tmp_path):
    """The cause, with a path, was the huge headline as well as the sentence beside it."""
    controller = Controller()
    controller.project = Project(
        tmp_path / "c",
        "simulated:demo",
        purpose="check",
        placements=("P1",),
        taken={"P1": "x"},
        step="check",
        failures={"check": "/rigs/a: there is no such file."},
    )
    page = CheckPage(controller)
    qtbot.addWidget(page)
    page.enter(Step("check", "check"))
    assert page.standing().level == "bad" and page.standing().text == "Not done"
    assert page.sentence.text() == "/rigs/a: there is no such file."
