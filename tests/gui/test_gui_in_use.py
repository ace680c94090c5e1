"""The calibration in use: what rules its chip, verified again without its project, never put to use where not valid."""

import json
import os
import shutil
from pathlib import Path

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QCoreApplication
from PySide6.QtWidgets import QInputDialog

from spherecal.base.errors import InputError
from spherecal_gui.controllers.camera_controller import CameraController
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.in_use import keep_verification, last_verification, number_of, result_of
from spherecal_gui.pages.profile_dialog import ProfileDialog
from spherecal_gui.pages.save_page import SavePage
from spherecal_gui.presenters.start_presenter import in_use, validity_of
from spherecal_gui.project_folder import TRAINING_PROFILE
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Status
from spherecal_rigs.store import open_profile
from tests.gui_walking import pump, settle, status, take
from tests.networks import calibrated

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("images_at_rest", "no_advice")]


@pytest.fixture
def projects(walked, home) -> Path:
    """Projects with one that is done, saved in the training's profile and in use."""
    shutil.copytree(walked.parent, home / "projects")
    return home / "projects"


@pytest.fixture
def profile(projects) -> Path:
    return projects / TRAINING_PROFILE


def edited(profile: Path, **changes: object) -> None:
    """Change what the profile says of its calibration, as if it had been saved so."""
    path = profile / "history" / "0001" / "entry.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def shown(profile):
    """The chip's word without the age, and its level."""
    word, level, _ = validity_of(profile)
    return word.rpartition(" · ")[0], level


def test_check_and_verification_rule_the_chip_before_age(profile):
    word, level, _ = validity_of(profile)
    assert word.startswith("SIMULATED · calibration fresh") and level == "caution"
    keep_verification(profile, "0001", "inconsistent")
    assert shown(profile) == ("SIMULATED · the check bar contradicts it", "bad")
    keep_verification(profile, "0001", "consistent")
    found = in_use(profile)
    assert found is not None and "verified" in found.verified and "0001" in found.verified
    keep_verification(profile, "0002", "inconsistent")
    assert last_verification(profile, "0001") is None, "of another calibration"
    assert validity_of(profile)[0].startswith("SIMULATED · calibration fresh"), "then what was saved with it counts"


def test_an_unverified_calibration_is_not_called_fresh(profile):
    edited(profile, verification=None)
    assert shown(profile) == ("SIMULATED · calibration not verified", "caution")
    found = in_use(profile)
    assert found is not None and "not verified" in found.verified
    assert found.next_check.startswith("Check the rig again by 20")


def test_a_check_that_says_recalibrate_makes_the_chip_red(profile):
    from spherecal_rigs.kept_checks import keep_check

    check = {"verdict": "recalibrate", "sentence": "C03 has moved.", "tolerance_mm": 0.1, "cameras": [], "balls": [],
             "lengths": []}  # fmt: skip
    keep_check(profile, "0001", check, None)
    assert shown(profile) == ("SIMULATED · check: recalibrate", "bad")


def test_what_is_not_valid_is_never_put_to_use(profile, qtbot, monkeypatch):
    shutil.copytree(profile / "history" / "0001", profile / "history" / "0002")
    path = profile / "history" / "0002" / "entry.json"
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document | {"quality": document["quality"] | {"valid": False, "verdict": "not-valid"}}))
    dialog = ProfileDialog(profile)
    qtbot.addWidget(dialog)
    dialog.table.select_name("0002")
    assert not dialog.use.isEnabled() and "not valid" in dialog.why_not.text()
    path.write_text(json.dumps(document | {"verification": None}))
    dialog._fill()
    assert dialog.table.chosen == "0002", "what was chosen stays chosen"
    assert dialog.use.isEnabled()
    monkeypatch.setattr(QInputDialog, "getText", lambda *_: ("", True))
    dialog.use.click()
    assert open_profile(profile).active_id == "0001" and "reason" in dialog.message.text()
    monkeypatch.setattr(QInputDialog, "getText", lambda *_: ("the bar comes tomorrow", True))
    dialog.use.click()
    assert open_profile(profile).active_id == "0002"


def test_the_calibration_in_use_is_a_result_again(profile, tmp_path):
    number, verdict = result_of(profile, tmp_path / "result")
    assert (number, verdict) == ("0001", "valid")
    assert number_of(profile, tmp_path / "result") == "0001"
    assert not (tmp_path / "result" / "verification.json").exists()
    (tmp_path / "result" / "rig.json").write_text("{}")
    assert number_of(profile, tmp_path / "result") is None
    with pytest.raises(InputError):
        result_of(tmp_path / "nothing", tmp_path / "other")


def test_verify_the_rig_verifies_the_calibration_in_use(projects, profile, qtbot, monkeypatch):
    """From the start page to the end; the project that it was made in may be gone."""
    monkeypatch.setattr(CameraController, "live_hz", 2.0)
    window = WizardWindow(projects)
    qtbot.addWidget(window)
    window.show()
    assert window.start.verify.isEnabled(), window.start.verify.toolTip()
    window.start.verify.click()
    controller = window.controller
    settle(controller)
    assert controller.project.purpose == "verify"
    assert [one.step.kind for one in controller.state.steps] == ["connect", "look", "verify", "save"]
    controller.recording.confirm_bench()
    settle(controller)
    controller.cameras.accept_look()
    assert status(controller, "verify") is Status.READY
    pump(lambda: controller.result is not None)
    for pose in controller.project.check_poses[:2]:
        take(controller, pose)
    assert controller.computation.verify()
    settle(controller)
    assert status(controller, "verify") is Status.DONE, controller.project.verified
    kept = last_verification(profile, "0001")
    assert kept is not None and kept.verdict == "consistent"
    assert "verify" in controller.saving.commands()[0]
    controller.go("save")
    QCoreApplication.processEvents()
    page = window.page
    assert isinstance(page, SavePage) and page.is_kept
    assert not page.profile.isVisible() and not page.apply.isVisible(), "what is saved is not offered to be saved"
    for text in ("Write the report", "Finish"):
        assert page.action().text == text
        page.act()
        settle(controller)
        QCoreApplication.processEvents()
    assert controller.project is None, "the run has an end"
    window.close()


def test_another_limit_reads_no_image_again(projects, monkeypatch):

    walk = Controller()
    walk.cameras.live_hz = 1.0
    folder = next(path.parent for path in projects.glob("calibration-*/wizard.json"))
    walk.open_project(folder)
    settle(walk)
    settle(walk)
    assert walk.computation.verify()
    settle(walk)
    import spherecal.detect.session_images as engine

    monkeypatch.setattr(engine, "observed", lambda *_, **__: pytest.fail("detected again"))
    assert walk.bars.set_limit("0.5") == ""
    assert walk.computation.verify()
    settle(walk)
    assert walk.project.verified.verdict in ("pass", "undecided") and "verify" not in walk.project.failures
    assert walk.computation.seen_bars is not None
    walk.close_project()


def test_the_reference_camera_stays_that_of_the_calibration_in_use(profile, tmp_path):
    from spherecal.steps.settings import CalibrationSettings
    from spherecal_gui.tasks import jobs

    kept = jobs.kept_reference(profile, tmp_path)
    assert kept == open_profile(profile).rig().reference_camera
    assert jobs.kept_reference(tmp_path, tmp_path) is None
    other = next(f"C0{i}" for i in range(1, 7) if f"C0{i}" != kept)
    rig = calibrated("demo", 1, CalibrationSettings(reference=other), targets=60)[0].rig
    assert rig.reference_camera == other and rig.quality.valid
