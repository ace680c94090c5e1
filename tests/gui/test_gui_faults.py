"""Faults while walking: what the user is told, and that nothing is lost."""

import errno
import os
import signal
from collections.abc import Iterator

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.simulated.simulated_source import SimulatedFault
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.presenters.step_states import PlacementFacts, placement_says
from spherecal_gui.project_folder import load_project, taken_in
from spherecal_gui.workflow import Status
from tests.built_producer import built_producer
from tests.gui_killed import exit_code_of, killed_while_taking
from tests.gui_walking import begun, pump, settle, status, take

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("images_at_rest", "no_advice")]


@pytest.fixture
def said() -> list[tuple[str, str, str]]:
    return []


@pytest.fixture
def wizard(qapp, tmp_path, said) -> Iterator[Controller]:
    made = begun(tmp_path)
    made.said.connect(lambda *words: said.append(words))
    yield made
    made.close_project()


def full(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_while_taking_keeps_what_was_taken(wizard, said, monkeypatch):
    take(wizard, "P1")
    before = {path.name: path.read_bytes() for path in (wizard.project.folder / "placements" / "P1").iterdir()}
    with monkeypatch.context() as patch:
        patch.setattr("spherecal_cameras.capture.png_bytes", full)
        take(wizard, "P2")
    assert status(wizard, "placement:P2") is Status.FAILED
    kind, text, hint = said[-1]
    assert kind == "bad"
    assert "No space left on device".lower() in text.lower() and hint
    assert taken_in(wizard.project.folder).keys() == {"P1"}
    after = {path.name: path.read_bytes() for path in (wizard.project.folder / "placements" / "P1").iterdir()}
    assert after == before
    take(wizard, "P2")  # somebody has freed the disk
    assert status(wizard, "placement:P2") is Status.DONE


def test_a_full_disk_while_retaking_keeps_the_one_before(wizard, monkeypatch):
    take(wizard, "P1")
    at = wizard.project.taken["P1"]
    with monkeypatch.context() as patch:
        patch.setattr("spherecal_cameras.capture.png_bytes", full)
        take(wizard, "P1")
    assert taken_in(wizard.project.folder) == {"P1": at}, "at once, without anybody's undo"
    assert wizard.sets.can_undo is None
    assert len(list((wizard.project.folder / "placements" / "P1").iterdir())) == 6


def test_a_retake_that_is_cut_short_leaves_the_one_before(wizard):
    """The program is killed after the old placement was put aside and before the new one is there."""
    take(wizard, "P1")
    folder, at = wizard.project.folder, wizard.project.taken["P1"]
    wizard.recording.session.remove("P1", retaking=True)
    assert taken_in(folder) == {}
    again = Controller()
    try:
        again.open_project(folder)
        settle(again)
        assert dict(again.project.taken) == {"P1": at} == taken_in(folder)
        assert len(list((folder / "placements" / "P1").iterdir())) == 6
        assert set(again.recording.dots["P1"]) == {f"C0{i}" for i in range(1, 7)}
        again.sets.delete("P1")  # a deletion is meant: it does not come back
        again.close_project()
        again.open_project(folder)
        settle(again)
        assert dict(again.project.taken) == {}
    finally:
        again.close_project()


def test_a_camera_lost_while_taking_is_named_and_the_others_are_kept(wizard, said):
    wizard.cameras.connection.source.inject(SimulatedFault("lose", "C04"))
    take(wizard, "P1")
    assert status(wizard, "placement:P1") is Status.FAILED, "it is kept, and never called done"
    assert "P1 is captured, but without C04." in [text for _, text, _ in said]
    wizard.cameras.connection.source.heal("C04")
    take(wizard, "P1")
    assert status(wizard, "placement:P1") is Status.DONE
    assert set(wizard.recording.dots["P1"]) == {f"C0{i}" for i in range(1, 7)}


def test_all_cameras_lost_while_taking_is_an_error_and_nothing_else(wizard, said):
    for i in range(1, 7):
        wizard.cameras.connection.source.inject(SimulatedFault("lose", f"C0{i}"))
    take(wizard, "P1")
    assert status(wizard, "placement:P1") is Status.FAILED
    assert "No camera delivered an image of P1." in said[-1][1]
    assert taken_in(wizard.project.folder) == {}


def test_a_calibration_that_fails_names_the_file_and_keeps_everything(wizard, said):
    for name in ("P1", "P2", "P3"):
        take(wizard, name)
    for pose in wizard.project.scale_poses:
        take(wizard, pose, shown="P1")  # the bar is not there: the ball is seen instead
    image = wizard.project.folder / "placements" / "P2" / "C03.png"
    kept = image.read_bytes()
    image.write_bytes(b"no picture")
    assert wizard.computation.calibrate()
    settle(wizard)
    assert status(wizard, "calibrate") is Status.FAILED
    assert "C03.png" in said[-1][1] and "Retake P2" in said[-1][2]
    assert not wizard.project.result_folder.exists()
    assert set(wizard.project.taken) == {"P1", "P2", "P3", *wizard.project.scale_poses}
    image.write_bytes(kept)
    assert wizard.computation.calibrate()
    settle(wizard)
    assert wizard.project.calibrated.verdict == "not valid"
    codes = {finding.code: finding for finding in wizard.result.rig.quality.findings}
    assert codes["no-scale"].severity == "error", "a bar that was not found gives no scale, and that is said"
    assert status(wizard, "results") is Status.FAILED


def test_targets_that_are_not_on_the_ball_are_not_found(qapp, tmp_path):
    """The wrong ball: the page says that nothing is seen, and nothing can be calibrated with it."""
    import json

    from spherecal.targets.family import make_target_set
    from spherecal_files.target_set_file import write_target_set
    from spherecal_gui.pages.placement_page import PlacementPage

    bench = tmp_path / "bench"
    bench.mkdir()
    write_target_set(bench / "targets.json", make_target_set(20, start_id=300))
    plan = {"format": "spherecal/session", "version": 1, "placements": [{"id": f"P{i}"} for i in range(1, 5)]}
    (bench / "session.json").write_text(json.dumps(plan | {"target_set": "targets.json"}))
    made = begun(tmp_path / "projects", bench=str(bench / "session.json"))
    try:
        made.go("placement:P1")
        page = PlacementPage(made)
        assert made.state is not None
        page.enter(made.state.of("placement:P1").step)
        pump(lambda: len(page.sights()) == 6, 120)
        scene = page.scene()
        assert not any(scene.counts.values())
        assert placement_says(PlacementFacts(scene)).text == "Put the ball where the cameras see it"
        page.deleteLater()
    finally:
        made.close_project()


def test_detection_that_breaks_is_said_once_and_the_window_lives(qtbot, tmp_path, monkeypatch):
    from spherecal_gui.wizard.window import WizardWindow

    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    monkeypatch.setattr(
        "spherecal.targets.detection.Detector.detect", lambda *_: (_ for _ in ()).throw(ValueError("x"))
    )
    window = WizardWindow(tmp_path)
    qtbot.addWidget(window)
    window.show()
    window.new_project("simulated:demo")
    pump(lambda: window.banner.isVisible() and "wrong inside the program" in window.banner.text, 60)
    assert window.controller.cameras.connection is not None
    window.close()


@pytest.mark.skipif(os.name == "nt", reason="kills by signal")
def test_the_camera_process_killed_is_seen_and_the_walk_goes_on(qapp, tmp_path, monkeypatch):
    from spherecal.base.context import Context
    from spherecal_gentl.producer.producer_control import RigFeed
    from spherecal_sim.render_session import demo_session

    cti = built_producer()
    session = demo_session(Context())
    with RigFeed(session) as feed:
        for name, value in feed.control.environment.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setenv("GENICAM_GENTL64_PATH", str(cti.parent))
        monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
        made = Controller()
        made.cameras.live_hz = 2.0
        try:
            made.new_project("genicam", tmp_path / "projects", str(session))
            settle(made)
            assert made.cameras.connection is not None, made.project.failures
            made.recording.confirm_bench()
            made.cameras.accept_look()
            take(made, "P1")
            assert status(made, "placement:P1") is Status.DONE
            source = made.cameras.connection.source
            assert isinstance(source, GenicamSource)
            before = source.service_pid
            assert before is not None
            os.kill(before, signal.SIGKILL)
            pump(lambda: source.service_pid not in (None, before), 60)
            pump(lambda: all(one.state.usable for one in source.statuses().values()), 60)
            feed.show("P2")
            take(made, "P2")
            assert set(taken_in(made.project.folder)) == {"P1", "P2"}
        finally:
            made.close_project()


@pytest.mark.skipif(os.name == "nt", reason="kills by signal")
@pytest.mark.parametrize(
    ("where", "there"),
    [("before the images", {"P1"}), ("before the metadata", {"P1"}), ("after all", {"P1", "P2"})],
)
def test_killed_while_taking_it_goes_on_at_the_same_step(qapp, tmp_path, where, there):
    assert exit_code_of(killed_while_taking, str(tmp_path), where) == -signal.SIGKILL
    (folder,) = (path.parent for path in tmp_path.glob("*/wizard.json"))
    project = load_project(folder)
    assert set(project.taken) == there
    assert project.step == "placement:P2"
    again = Controller()
    try:
        again.open_project(folder)
        settle(again)
        pump(lambda: set(again.recording.dots) == there, 60)
        if "P2" not in there:
            take(again, "P2")
            assert set(taken_in(folder)) == {"P1", "P2"}
    finally:
        again.close_project()
