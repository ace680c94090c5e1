"""The limits in the window: shown, changed, noted in the log, and what they change elsewhere."""

import html
import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QDoubleSpinBox,
    QLabel,
    QLineEdit,
    QMenu,
    QPushButton,
    QScrollArea,
    QWidget,
)

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.data.session import Bar, BarLength
from spherecal_files.write_result import write_result
from spherecal_gui import languages, theme
from spherecal_gui import limits_in_force as limits
from spherecal_gui import project as changes
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.limits_dialog import LimitsDialog
from spherecal_gui.pages.profile_dialog import ProfileDialog
from spherecal_gui.pages.save_page import SavePage
from spherecal_gui.pages.verify_page import VerifyPage
from spherecal_gui.presenters.connect_presenter import bench_rows
from spherecal_gui.presenters.limits_presenter import LimitsDesk, limit_problems, load_limits
from spherecal_gui.presenters.placement_presenter import Scene
from spherecal_gui.project import Artefacts, Project
from spherecal_gui.tasks import jobs
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Step
from spherecal_rigs.calibration_age import ValidityLimits
from spherecal_rigs.limits_file import Limits, read_limits, write_limits
from spherecal_rigs.result_folder import answer_for, read_bar_report
from spherecal_rigs.save_entry import SaveOptions, save_result
from spherecal_rigs.store import apply, create_profile, open_profile
from tests.method.test_results import example_calibration

TIGHT = Limits(150, 2.0, 4.0, 0.5, 1.0, "0.03+L/20000", verification_limit_open=False, unverified_use=False)


@pytest.fixture(autouse=True)
def delivered_again():
    yield
    limits.use(Limits())


@pytest.fixture
def path(tmp_path, monkeypatch):
    file = tmp_path / "limits.json"
    monkeypatch.setenv("SPHERECAL_LIMITS", str(file))
    return file


@pytest.fixture
def desk(path, tmp_path):
    """Limits that are tighter than those delivered."""
    write_limits(TIGHT, path)
    return LimitsDesk(tmp_path / "rig-profile", path)


def shown(qtbot, desk, tmp_path):
    dialog = LimitsDialog(tmp_path / "rig-profile", desk=desk)
    qtbot.addWidget(dialog)
    dialog.show()
    return dialog


def key(dialog, name):
    return next(one for one in dialog.findChildren(QPushButton) if one.property("key") == name)


def test_what_is_saved_is_noted_used_and_given_to_the_profile(desk, path, tmp_path):
    create_profile(tmp_path / "rig-profile")
    assert "still has others" in desk.profile_text()
    said, problem = desk.save(replace(TIGHT, stale_hours=6.0, unverified_use=True))
    assert problem == ""
    assert said == [
        "Out of date after: 4 h → 6 h",
        "A calibration that was not verified may be put to use: no → yes",
    ]
    assert limits.now().stale_hours == 6.0
    assert open_profile(tmp_path / "rig-profile").limits == ValidityLimits(2.0, 6.0, 0.5, 1.0)
    assert desk.profile_text() == ""
    assert load_limits(path) == "" and limits.now().stale_hours == 6.0


def test_problems_are_told_at_the_limit():
    assert limit_problems(TIGHT) == {}
    found = limit_problems(replace(TIGHT, ageing_hours=9.0, verification_limit="much"))
    assert set(found) == {"stale_hours", "verification_limit"}
    assert "ages before" in found["stale_hours"] and "is not a limit" in found["verification_limit"]


def test_a_damaged_file_is_said_and_never_written_over(qtbot, path, tmp_path):
    path.write_text("{")
    limits.use(TIGHT)
    assert "delivered limits" in load_limits(path) and limits.now() == Limits()
    desk = LimitsDesk(tmp_path / "rig-profile", path)
    assert desk.save(TIGHT)[0] == [] and "limits.json" in desk.save(TIGHT)[1]
    dialog = shown(qtbot, desk, tmp_path)
    assert "limits.json" in dialog.state.text() and "delivered limits" in dialog.state.text()
    assert not any(field.isEnabled() for field in dialog.fields.values())
    assert not key(dialog, "save-limits").isEnabled() and not key(dialog, "delivered-limits").isEnabled()
    assert path.read_text() == "{"
    dialog.close()


# --- the dialog ------------------------------------------------------------------------------------------------------


def test_each_limit_has_its_unit_and_its_reason(qtbot, desk, tmp_path):
    dialog = shown(qtbot, desk, tmp_path)
    assert dialog.limits == TIGHT
    for field in dialog.fields.values():
        assert field.isEnabled() and field.accessibleDescription() in html.unescape(field.toolTip())
        assert len(field.toolTip()) > 60, "why it is what it is"
    assert dialog.fields["ageing_hours"].text() == "2.0 h" and dialog.fields["needed_dots"].text() == "150 dots"
    assert not key(dialog, "save-limits").isEnabled(), "nothing was changed"
    assert str(desk.path) in dialog.state.text()
    dialog.close()


def test_changed_by_the_keyboard_alone(qtbot, desk, tmp_path, path):
    dialog = shown(qtbot, desk, tmp_path)
    field = dialog.fields["stale_hours"]
    assert isinstance(field, QAbstractSpinBox)
    field.selectAll()
    QTest.keyClicks(field, "1")
    QTest.keyClick(field, Qt.Key.Key_Tab)
    assert dialog.problems["stale_hours"].isVisible() and not dialog.save.isEnabled()
    field.selectAll()
    QTest.keyClicks(field, "9.5")
    QTest.keyClick(field, Qt.Key.Key_Tab)
    assert not dialog.problems["stale_hours"].isVisible()
    assert dialog.close_button.text() == "Close without saving"
    with qtbot.waitSignal(dialog.changed) as caught:
        key(dialog, "save-limits").click()
    assert "4 h → 9.5 h" in caught.args[0][0]
    assert read_limits(path) == replace(TIGHT, stale_hours=9.5)
    assert dialog.close_button.text() == "Close" and not dialog.save.isEnabled()
    dialog.close()


def test_back_to_the_delivered_values(qtbot, desk, tmp_path, path):
    dialog = shown(qtbot, desk, tmp_path)
    key(dialog, "delivered-limits").click()
    assert dialog.limits == Limits() and read_limits(path) == TIGHT, "saved only when asked"
    key(dialog, "save-limits").click()
    assert read_limits(path) == Limits()
    dialog.close()


def test_a_value_finer_than_the_field_stays_as_it_was(qtbot, path, tmp_path):
    write_limits(replace(Limits(), ageing_hours=4.25), path)
    dialog = shown(qtbot, LimitsDesk(tmp_path / "rig-profile", path), tmp_path)
    assert dialog.limits.ageing_hours == 4.25
    dialog.close()


@pytest.mark.parametrize("language", languages.LANGUAGES)
def test_from_afar_it_fits_a_small_screen(qtbot, qapp, desk, tmp_path, language):
    theme.apply(qapp, dark=False, far=True)
    languages.use(language)
    try:
        dialog = shown(qtbot, desk, tmp_path)
        dialog.show_limits(replace(TIGHT, ageing_hours=9.0, verification_limit="much"))
        for _ in range(5):
            QCoreApplication.processEvents()
        assert dialog.width() <= 1240 and dialog.height() <= 740
        for area in dialog.findChildren(QScrollArea):
            assert area.widget().width() <= area.viewport().width(), "nothing is out of sight to the right"
        for one in dialog.findChildren(QPushButton):
            assert not one.isVisible() or one.width() >= one.sizeHint().width()
        for one in dialog.findChildren(QWidget):
            if (
                isinstance(one, QPushButton | QLineEdit | QAbstractSpinBox)
                and one.objectName() != "qt_spinbox_lineedit"
            ):
                assert one.accessibleName(), one.objectName()
        dialog.close()
    finally:
        languages.use("en")
        theme.apply(qapp, dark=False, far=False)


# --- what they change ------------------------------------------------------------------------------------------------


def test_dots_that_a_camera_needs():
    scene = Scene({"C01": 120, "C02": 400}, True)
    assert scene.ready == ("C01", "C02")
    limits.use(TIGHT)
    assert scene.ready == ("C02",)


def test_the_menu_opens_them_and_the_log_has_the_change(qtbot, home, path):
    window = WizardWindow(home / "projects")
    qtbot.addWidget(window)
    window.show()
    menu = window.header.findChild(QMenu)
    next(one for one in menu.actions() if one.text() == "Limits").trigger()
    dialog = window.findChild(LimitsDialog)
    field = dialog.fields["needed_dots"]
    assert isinstance(field, QDoubleSpinBox)
    field.setValue(180)
    key(dialog, "save-limits").click()
    assert limits.now().needed_dots == 180
    assert "Limit changed: Dots that each camera needs at a placement: 100 dots" in window.lines.toPlainText()
    dialog.close()
    window.close()
    path.write_text("{")
    again = WizardWindow(home / "projects")
    qtbot.addWidget(again)
    again.show()
    assert "delivered limits" in again.banner.text and limits.now() == Limits()
    again.close()


def test_a_new_project_has_the_limit_which_may_be_locked(qtbot, home, monkeypatch):
    limits.use(TIGHT)
    controller = Controller()
    monkeypatch.setattr(controller, "_begin", lambda project: setattr(controller, "project", project))
    controller.new_project("simulated:demo", home / "projects")
    assert controller.project.limit == "0.03+L/20000"
    page = VerifyPage(controller)
    qtbot.addWidget(page)
    page._show_limit(idle=True)
    assert not page.limit.isEnabled() and "responsible person" in page.limit.toolTip()
    limits.use(replace(TIGHT, verification_limit_open=True))
    page._show_limit(idle=True)
    assert page.limit.isEnabled() and "0.03+L/20000" in page.limit.toolTip()


@pytest.fixture
def result(tmp_path):
    write_result(example_calibration(), tmp_path / "result")
    return tmp_path / "result"


def test_an_unverified_calibration_is_put_to_use_only_where_that_is_allowed(qtbot, home, result):
    controller = Controller()
    page = SavePage(controller)
    qtbot.addWidget(page)
    project = replace(Project(home / "projects" / "one", "simulated:demo"), placements=("P1", "P2", "P3"))
    controller.project = changes.with_calibration(project, "valid")
    page.note.setText("the bar is away")
    assert page._why_not_saved() == ""
    limits.use(TIGHT)
    assert "the limits forbid its use" in page._why_not_saved()
    page.apply.setChecked(False)
    assert page._why_not_saved() == "", "kept in the profile it may be"

    number = jobs.save_profile(result, home, home / "rig-profile", False, "", Context())
    assert open_profile(home / "rig-profile").limits == TIGHT.validity, "a new profile has the limits in use"
    dialog = ProfileDialog(home / "rig-profile")
    qtbot.addWidget(dialog)
    assert dialog.table.chosen == number
    assert not dialog.use.isEnabled() and "limits forbid" in dialog.use.toolTip()
    limits.use(Limits())
    dialog._selected()
    assert dialog.use.isEnabled()


def test_a_failed_verification_is_never_called_missing(qtbot, home, tmp_path):
    """After INCONSISTENT the page asked for a note "not verified", took the letter x, and the rig was in use."""
    from tests.gui.test_gui_workflow import taken_project
    from tests.rigs.test_failed_verification import verified

    controller = Controller()
    page = SavePage(controller)
    qtbot.addWidget(page)
    project = replace(taken_project(), folder=home / "projects" / "one")
    project = changes.with_calibration(project, "valid")
    project = replace(project, accepted=project.calibrated)
    project = changes.with_set(project, "A-01", "t9")
    result = verified(project.result_folder, 1.005, "0.05")
    bars = read_bar_report(result)
    assert bars is not None and jobs._verified_word(bars) == "inconsistent"
    controller.project = changes.with_verification(project, "inconsistent")
    page.enter(Step("save", "save"))
    page.note.setText("x")
    assert "verification failed" in page._why_not_saved() and not page.profile.isEnabled()
    assert "verification failed" in page.word.text() and page.word.property("level") == "bad"
    assert not page.export.isEnabled() and "failed" in page.export.toolTip()
    assert "not verified" not in " ".join(one.text() for one in page.findChildren(QLabel))
    for forbidden in (
        lambda: jobs.save_profile(result, home, home / "rig-profile", True, "x", Context()),
        lambda: jobs.export(result, "csv", home / "rig.csv", Context()),
    ):
        with pytest.raises(InputError) as refused:
            forbidden()
        assert refused.value.code == "error-verification-failed"
    assert not (home / "rig-profile").exists() and not (home / "rig.csv").exists(), "nothing was half done"
    page.apply.setChecked(False)
    assert page._why_not_saved() == "", "kept in the profile it may be"
    jobs.save_profile(result, home, home / "rig-profile", False, "", Context())
    dialog = ProfileDialog(home / "rig-profile")
    qtbot.addWidget(dialog)
    assert not dialog.use.isEnabled() and "verification failed" in dialog.use.toolTip()
    answer_for(result, "B. Responsible", "only shapes matter")
    with pytest.raises(InputError):
        apply(open_profile(home / "rig-profile"), str(dialog.table.chosen), "x")  # as it was saved before
    number = jobs.save_profile(result, home, home / "rig-profile", True, "as agreed", Context())
    assert open_profile(home / "rig-profile").active_id == number


def test_the_chip_follows_the_limits(home, result, desk, tmp_path):
    from spherecal_gui.in_use import keep_verification
    from spherecal_gui.presenters.start_presenter import validity_of

    profile = tmp_path / "rig-profile"
    before = SaveOptions(calibrated_at=datetime.now(UTC) - timedelta(hours=3))
    number = save_result(create_profile(profile), result, before)
    apply(open_profile(profile), number)
    assert validity_of(profile)[:2] == ("calibration not verified · 3 h old", "caution"), "before how old it is"
    keep_verification(profile, number, "consistent")
    assert validity_of(profile)[0] == "calibration fresh · 3 h old"
    desk.save(TIGHT)
    assert validity_of(profile)[0] == "calibration ageing · 3 h old", "after 2 h now"


# --- nominal lengths -------------------------------------------------------------------------------------------------


def a_bench(nominal) -> Any:
    lengths = (BarLength("1", "2", 500.012, 0.004, 2.0, nominal),)
    bars = (Bar("B", "scale", {}, lengths, 1e-5, 20.0), Bar("A", "check", {}, lengths, 1e-5, 20.0))
    return SimpleNamespace(plan=SimpleNamespace(bars=bars, target_set=None), names={})


ARTEFACTS = Artefacts("dots8", "500 mm", "B: 500.012 mm", "B", ("A",), "A: 500.012 mm")


@pytest.mark.parametrize(
    ("nominal", "text"), [(None, ": 500.012 mm"), (500.0, " (mm):\n500 nominal, 500.012 certified")]
)
def test_connect_shows_nominal_and_certified_lengths(nominal, text):
    assert [row.value for row in bench_rows(a_bench(nominal), ARTEFACTS)][2:] == [f"B{text}", f"A{text}"]
    assert [row.value for row in bench_rows(None, ARTEFACTS)][2:] == ["B: 500.012 mm", "A: 500.012 mm"]


def test_verify_shows_the_check_bars_nominal_length(qtbot, home):
    controller = Controller()
    page = VerifyPage(controller)
    qtbot.addWidget(page)
    controller.project = replace(Project(home / "one", "simulated:demo"), artefacts=ARTEFACTS)
    for nominal, text in ((None, ""), (500.0, "A (mm): 500 nominal, 500.012 certified")):
        controller.cameras.connection = a_bench(nominal)
        page._show_lengths()
        assert page.lengths.text() == text and page.lengths.isHidden() is not bool(text)
    controller.cameras.connection = None
