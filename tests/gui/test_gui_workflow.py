"""The wizard's state: computed from the project, never stored; what was taken is lost by nothing but delete."""

import json
import os
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from conftest import ROOT
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from spherecal.base.errors import InputError, OutputError
from spherecal_gui import project as changes
from spherecal_gui import workflow
from spherecal_gui.languages import reason_text, step_title, word
from spherecal_gui.project import Artefacts, Project, fingerprint
from spherecal_gui.project_folder import WIZARD, load_project, new_folder, recent_projects, save_project, taken_in
from spherecal_gui.widgets.rail import Rail
from spherecal_gui.workflow import Reason, Running, Status, resolve, steps_of

BENCH = Artefacts("dots8", "500 mm", "bar B", "B", ("A",), "bar A")
OPEN = Running(connected=True)


def ready_project(folder: Path = Path("nowhere")) -> Project:
    """Connected once, confirmed, looked at, nothing taken."""
    project = Project(folder, "simulated:demo", scale_poses=("B-01",), check_poses=("A-01",))
    project = replace(changes.with_cameras(project, ("S1", "S2", "S3")), artefacts=BENCH)
    return replace(project, looked=project.cameras)


def taken_project() -> Project:
    """All that a calibration needs."""
    project = ready_project()
    for number, name in enumerate(project.sets):
        project = changes.with_set(project, name, f"t{number}")
    return project


def statuses(project: Project, running: Running = OPEN) -> dict[str, Status]:
    return {state.step.id: state.status for state in resolve(project, running).steps}


def test_thresholds_are_the_engines():
    from spherecal.diagnose import run_checks as checks
    from spherecal.initialise import view_graph as graph
    from spherecal_gui import coverage

    assert workflow.FEW_PLACEMENTS == checks.FEW_PLACEMENTS
    assert coverage.MIN_COMMON == graph.MIN_COMMON
    assert (coverage.CELLS, coverage.LITTLE_COVERAGE) == (checks.COVERAGE_CELLS, checks.LITTLE_COVERAGE)


def test_a_new_project_can_only_connect():
    found = statuses(Project(Path("x"), "genicam"), Running())
    assert found.pop("connect") is Status.READY
    assert set(found.values()) == {Status.BLOCKED}


def test_the_steps_are_those_of_the_walk():
    steps = steps_of(ready_project())
    assert [step.kind for step in steps] == [
        "connect", "look", "placement", "placement", "placement", "placement", "scale", "calibrate", "results",
        "verify", "save", "measure",
    ]  # fmt: skip
    assert "scale" not in [step.kind for step in steps_of(replace(ready_project(), scale_poses=()))]
    assert all(step_title(step) and word("tasks", step.kind) for step in steps)


def test_the_bench_must_be_confirmed():
    state = resolve(replace(ready_project(), artefacts=None), OPEN)
    assert state.of("connect").status is Status.READY
    assert state.of("placement:P1").reason == Reason("confirm the bench", (), "connect")


def test_calibrate_says_how_many_placements_are_missing():
    project = changes.with_set(ready_project(), "P1", "t")
    reason = resolve(project, OPEN).of("calibrate").reason
    assert reason == Reason("placements missing", ("1", "3"), "placement:P2")
    assert "1 of at least 3" in reason_text(reason)


def test_calibrate_wants_the_bar_that_gives_the_scale():
    project = changes.without_set(taken_project(), "B-01")
    reason = resolve(project, OPEN).of("calibrate").reason
    assert reason is not None and reason.code == "scale missing" and reason.go_to == "scale"


def test_three_of_four_placements_are_enough_to_begin():
    assert statuses(changes.without_set(taken_project(), "P4"))["calibrate"] is Status.READY


def test_the_walk_ends_with_everything_done():
    project = changes.with_calibration(taken_project(), "valid")
    project = replace(project, accepted=project.calibrated)
    project = changes.with_set(project, "A-01", "t9")
    assert statuses(project)["verify"] is Status.READY
    project = changes.with_saved(changes.with_verification(project, "consistent"))
    found = statuses(project)
    assert found.pop("measure") is Status.READY  # there is always more to measure
    assert set(found.values()) == {Status.DONE}


def test_measuring_needs_a_calibrated_rig_and_its_cameras():
    assert statuses(taken_project())["measure"] is Status.BLOCKED
    project = changes.with_calibration(taken_project(), "valid")
    assert statuses(project)["measure"] is Status.READY
    assert statuses(project, Running())["measure"] is Status.BLOCKED


def test_taking_a_placement_again_makes_later_steps_stale_and_names_it():
    project = changes.with_calibration(taken_project(), "valid")
    project = replace(project, accepted=project.calibrated)
    project = changes.with_saved(changes.with_verification(changes.with_set(project, "A-01", "t9"), "consistent"))
    state = resolve(changes.with_set(project, "P2", "later"), OPEN)
    for step in ("calibrate", "results", "verify", "save"):
        assert state.of(step).status is Status.STALE
    assert state.of("calibrate").reason == Reason("changed", ("P2",), "calibrate")
    assert project.calibrated is not None, "nothing is thrown away"


def test_undoing_makes_it_current_again():
    project = changes.with_calibration(taken_project(), "valid")
    changed = changes.without_set(project, "P2")
    assert statuses(changed)["calibrate"] is Status.STALE
    assert statuses(changes.with_set(changed, "P2", project.taken["P2"]))["calibrate"] is Status.DONE


def test_a_verification_leaves_the_calibration_as_it_is():
    project = changes.with_calibration(taken_project(), "valid")
    assert statuses(changes.with_set(project, "A-01", "t9"))["calibrate"] is Status.DONE


def test_another_bench_makes_the_calibration_stale():
    project = changes.with_calibration(taken_project(), "valid")
    other = replace(project, artefacts=replace(BENCH, scale="bar C"))
    reason = resolve(other, OPEN).of("calibrate").reason
    assert reason is not None
    assert reason_text(reason) == "Changed since: the bench."


def test_results_that_are_not_valid_are_a_problem():
    assert statuses(changes.with_calibration(taken_project(), "not valid"))["results"] is Status.FAILED


def test_nothing_that_uses_a_calibration_looks_better_than_it():
    """Verify, Save and Measure said "ready" behind a calibration that is not valid, and Measure behind any."""
    wrong = statuses(changes.with_calibration(taken_project(), "not valid"))
    assert {wrong[step] for step in ("verify", "save", "measure")} == {Status.FAILED}
    doubtful = statuses(changes.with_calibration(taken_project(), "use with care"))
    assert doubtful["measure"] is Status.CARE
    assert {doubtful[step] for step in ("verify", "save")} == {Status.READY}
    project = changes.with_set(changes.with_calibration(taken_project(), "valid"), "P2", "later")
    assert statuses(project)["measure"] is Status.STALE


def test_a_step_that_was_not_begun_has_no_problem_of_its_own(qtbot):
    """A run that was stopped left "problem" at Verify, Save and Measure too."""
    rail = Rail()
    qtbot.addWidget(rail)
    project = replace(changes.with_calibration(taken_project(), "not valid"), step="calibrate")
    rail.show_state(resolve(project, Running(connected=True)))
    said = {step: rail.item(step).accessibleName().partition(", ")[2] for step in ("results", "verify", "save")}
    assert said == {"results": "problem", "verify": "not yet", "save": "not yet"}
    assert rail.item("verify").cursor().shape().name == "PointingHandCursor", "one can go there all the same"


def test_a_bar_that_contradicts_is_a_problem():
    project = changes.with_set(changes.with_calibration(taken_project(), "valid"), "A-01", "t9")
    project = changes.with_verification(project, "inconsistent")
    assert statuses(project)["verify"] is Status.FAILED


def test_no_check_bar_blocks_only_the_verification():
    project = replace(changes.with_calibration(taken_project(), "valid"), check_poses=())
    found = statuses(project)
    assert found["verify"] is Status.BLOCKED
    assert found["save"] is Status.READY


def test_running_work_blocks_what_is_not_done_and_leaves_the_rest():
    found = statuses(changes.without_set(taken_project(), "P4"), Running("calibrate", True))
    assert found["calibrate"] is Status.RUNNING
    assert found["placement:P4"] is Status.BLOCKED
    assert found["placement:P1"] is Status.DONE


def test_a_failure_is_shown_until_the_next_try():
    project = changes.with_failure(taken_project(), "calibrate", "The disk is full. Free it.")
    state = resolve(project, OPEN).of("calibrate")
    assert state.status is Status.FAILED
    assert reason_text(state.reason) == "The disk is full. Free it."
    assert statuses(changes.without_failure(project, "calibrate"))["calibrate"] is Status.READY
    assert statuses(changes.with_calibration(project, "valid"))["calibrate"] is Status.DONE


def test_unplugging_keeps_what_was_taken():
    found = statuses(taken_project(), Running(connected=False))
    assert found["placement:P1"] is Status.DONE
    assert found["calibrate"] is Status.READY
    assert found["look"] is Status.BLOCKED


def test_where_the_user_is_survives_a_step_that_vanishes():
    project = replace(ready_project(), step="placement:P4")
    dropped = changes.without_placement(project, "P4")
    assert resolve(dropped, OPEN).current == "placement:P3"
    assert changes.without_placement(changes.with_set(project, "P4", "t"), "P4").placements == project.placements


def check_project() -> Project:
    """A check, as far as its one placement."""
    project = replace(ready_project(), purpose="check", placements=("P1",), scale_poses=(), check_poses=())
    return changes.with_set(project, "P1", "t1")


def test_a_check_has_few_steps_and_needs_its_placement():
    project = check_project()
    assert [step.kind for step in steps_of(project)] == ["connect", "look", "placement", "check"]
    without = changes.without_set(project, "P1")
    reason = resolve(without, OPEN).of("check").reason
    assert reason == Reason("placement missing", (), "placement:P1")
    assert statuses(project)["check"] is Status.READY


def test_a_check_that_says_recalibrate_is_a_problem_and_a_new_placement_makes_it_stale():
    project = check_project()
    assert statuses(changes.with_check(project, "ok"))["check"] is Status.DONE
    assert statuses(changes.with_check(project, "watch"))["check"] is Status.CARE
    bad = changes.with_check(project, "recalibrate")
    assert statuses(bad)["check"] is Status.FAILED
    assert statuses(changes.with_set(bad, "P1", "t2"))["check"] is Status.STALE


def test_a_check_comes_back_as_it_was(tmp_path):
    project = replace(changes.with_check(check_project(), "watch"), folder=tmp_path, step="check")
    write_capture(tmp_path, dict(project.taken))
    save_project(project)
    assert load_project(tmp_path) == project


# --- on disk ---------------------------------------------------------------------------------------------------------


def write_capture(folder: Path, taken: dict[str, str]) -> None:
    """capture.json as the camera side writes it, as far as the wizard reads it."""
    folder.mkdir(parents=True, exist_ok=True)
    sets = [{"id": name, "taken": at, "images": {"C01": "x.png"}} for name, at in taken.items()]
    (folder / "capture.json").write_text(json.dumps({"sets": sets}))


def test_a_project_comes_back_as_it_was(tmp_path):
    project = replace(changes.with_failure(taken_project(), "save", "No."), folder=tmp_path, step="calibrate")
    write_capture(tmp_path, dict(project.taken))
    save_project(project)
    assert load_project(tmp_path) == project


def test_the_images_on_disk_are_the_truth_after_a_crash(tmp_path):
    """The program died between writing P2's images and wizard.json."""
    project = replace(ready_project(), folder=tmp_path)
    save_project(project)
    write_capture(tmp_path, {"P1": "a", "P2": "b"})
    assert load_project(tmp_path).taken == {"P1": "a", "P2": "b"}


def test_a_result_that_was_deleted_is_not_shown_as_done(tmp_path):
    project = replace(changes.with_calibration(taken_project(), "valid"), folder=tmp_path)
    write_capture(tmp_path, dict(project.taken))
    save_project(project)
    assert load_project(tmp_path).calibrated is None
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "rig.json").write_text("{}")
    assert load_project(tmp_path).calibrated == project.calibrated


@pytest.mark.parametrize("text", ["", "{", '{"format": "spherecal/wizard", "version": 1}', '{"format": "other"}'])
def test_broken_files_are_named(tmp_path, text):
    (tmp_path / "wizard.json").write_text(text)
    with pytest.raises(InputError, match=r"wizard\.json"):
        load_project(tmp_path)


def test_a_broken_capture_file_is_named(tmp_path):
    (tmp_path / "capture.json").write_text('{"sets": [{}]}')
    with pytest.raises(InputError, match=r"capture\.json"):
        taken_in(tmp_path)


def test_a_folder_that_cannot_be_written_is_said(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"):
        save_project(replace(ready_project(), folder=tmp_path / "file" / "project"))


def test_new_projects_never_meet(tmp_path):
    from datetime import datetime

    now = datetime(2026, 11, 21, 12, 0)
    names = []
    for _ in range(3):
        folder = new_folder(tmp_path, now)
        save_project(replace(ready_project(), folder=folder))
        names.append(folder.name)
    assert len(set(names)) == 3
    assert {path.name for path in recent_projects(tmp_path)} == set(names)


# --- anything in any order -------------------------------------------------------------------------------------------

SETS = ("P1", "P2", "P3", "P4", "B-01", "A-01")
REPAIRS = (("--leave-out", "C05@P3"), ("--leave-out", "camera:C02"), ("--split", "C05@P2"), ("--swap", "C05,C06"))


class Walk(RuleBasedStateMachine):
    """Edit, run, cancel, save, load, unplug in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.home = tempfile.TemporaryDirectory()
        self.project = ready_project(Path(self.home.name))
        self.running = OPEN
        self.clock = 0
        self.removed: list[tuple[str, str]] = []
        self.kept: dict[str, str] = {}

    def teardown(self) -> None:
        self.home.cleanup()

    @initialize(bench=st.booleans(), looked=st.booleans())
    def begin(self, bench, looked):
        self.project = replace(
            self.project, artefacts=BENCH if bench else None, looked=self.project.cameras if looked else ()
        )

    def is_open(self, step: str) -> bool:
        return resolve(self.project, self.running).of(step).open

    @property
    def idle(self) -> bool:
        return self.running.step is None

    @rule(connected=st.booleans())
    def plug(self, connected):
        self.running = replace(self.running, connected=connected)

    @rule()
    def confirm(self):
        self.project = replace(self.project, artefacts=BENCH)

    @precondition(lambda self: self.is_open("look"))
    @rule()
    def look(self):
        self.project = replace(self.project, looked=self.project.cameras)

    @precondition(lambda self: self.idle)
    @rule(name=st.sampled_from(SETS))
    def take(self, name):
        self.clock += 1
        if name in self.project.taken:
            self.removed.append((name, self.project.taken[name]))
        self.project = changes.with_set(self.project, name, f"t{self.clock}")
        self.kept[name] = f"t{self.clock}"

    @precondition(lambda self: self.idle)
    @rule(name=st.sampled_from(SETS))
    def delete(self, name):
        if name in self.project.taken:
            self.removed.append((name, self.project.taken[name]))
        self.project = changes.without_set(self.project, name)
        self.kept.pop(name, None)

    @precondition(lambda self: self.idle and self.removed)
    @rule()
    def undo(self):
        name, at = self.removed.pop()
        self.project = changes.with_set(self.project, name, at)
        self.kept[name] = at

    @rule()
    def more(self):
        if len(self.project.placements) < 6:
            self.project = changes.with_another_placement(self.project)

    @rule(data=st.data())
    def drop(self, data):
        self.project = changes.without_placement(self.project, data.draw(st.sampled_from(self.project.placements)))

    @precondition(lambda self: self.idle)
    @rule(repair=st.sampled_from(REPAIRS))
    def ask_for_a_repair(self, repair):
        self.project = changes.with_repair(self.project, *repair)

    @precondition(lambda self: self.idle and self.project.repairs)
    @rule(data=st.data())
    def take_a_repair_back(self, data):
        self.project = changes.without_repair(self.project, *data.draw(st.sampled_from(self.project.repairs)))

    @precondition(lambda self: self.idle)
    @rule(camera=st.sampled_from(["C01", "C02"]), left=st.floats(0, 100, width=16))
    def mask(self, camera, left):
        self.project = changes.with_mask(self.project, camera, (left, 0.0, 10.0, 10.0))

    @precondition(lambda self: self.idle)
    @rule(how=st.sampled_from(["last", None]))
    def unmask(self, how):
        left = self.project.masks[:-1] if how == "last" else ()
        self.project = replace(self.project, masks=left)

    @precondition(lambda self: self.idle)
    @rule(limit=st.sampled_from(["", "0.03+L/20000"]), celsius=st.sampled_from([None, 21.5]))
    def judge_by(self, limit, celsius):
        self.project = replace(self.project, limit=limit, bar_celsius=celsius)

    @precondition(lambda self: self.idle)
    @rule(count=st.integers(1, 3))
    def plan_bars(self, count):
        """The engine plans the check bar's poses; one that was taken is never lost."""
        poses = tuple((f"L{number}-1", "A") for number in range(1, count + 1))
        shown = {pose for pose in self.project.check_poses if pose in self.kept}
        self.project = changes.with_poses(self.project, poses)
        assert set(self.project.pose_bars) == set(poses)
        assert shown <= set(self.project.check_poses)

    @precondition(lambda self: self.idle and self.is_open("calibrate"))
    @rule()
    def start_calibration(self):
        self.running = replace(self.running, step="calibrate")

    @precondition(lambda self: self.running.step == "calibrate")
    @rule(how=st.sampled_from(["valid", "not valid", "cancelled", "failed"]))
    def end_calibration(self, how):
        self.running = replace(self.running, step=None)
        if how == "failed":
            self.project = changes.with_failure(self.project, "calibrate", "It failed.")
        elif how != "cancelled":
            self.project = changes.with_calibration(self.project, how)
            (self.project.result_folder).mkdir(exist_ok=True)
            (self.project.result_folder / "rig.json").write_text("{}")

    @precondition(lambda self: self.idle and self.project.calibrated is not None)
    @rule(verdict=st.sampled_from(["consistent", "inconsistent", "no data"]))
    def verify(self, verdict):
        self.project = changes.with_verification(self.project, verdict)
        (self.project.result_folder / "verification.json").write_text("{}")

    @precondition(lambda self: self.idle)
    @rule()
    def accept_and_save(self):
        self.project = changes.with_saved(replace(self.project, accepted=self.project.calibrated))

    @rule(data=st.data())
    def go(self, data):
        steps = [state.step.id for state in resolve(self.project, self.running).steps if state.open]
        self.project = replace(self.project, step=data.draw(st.sampled_from(steps)))

    @rule()
    def crash_and_load(self):
        """What comes back is what was there, at the same step; running work is gone, the cameras too."""
        taken = self.project.taken
        write_capture(self.project.folder, {name: at for name, at in taken.items() if name != "A-01"})
        write_capture(self.project.verification_folder, {name: at for name, at in taken.items() if name == "A-01"})
        save_project(self.project)
        loaded = load_project(self.project.folder)
        assert loaded == replace(self.project, taken=loaded.taken)
        self.project, self.running = loaded, Running(connected=self.running.connected)

    @invariant()
    def nothing_is_lost(self):
        assert dict(self.project.taken) == self.kept

    @invariant()
    def the_state_makes_sense(self):
        state = resolve(self.project, self.running)
        assert state == resolve(self.project, self.running)
        ids = [one.step.id for one in state.steps]
        assert state.current in ids
        assert len(set(ids)) == len(ids)
        for one in state.steps:
            explained = one.status in (Status.BLOCKED, Status.STALE, Status.FAILED)
            assert (one.reason is not None) == explained
            assert bool(reason_text(one.reason)) == explained
            if one.reason is not None:
                assert one.reason.go_to in ids
            assert (one.status is Status.RUNNING) == (one.step.id == self.running.step)

    @invariant()
    def repairs_name_what_is_there(self):
        for _, value in self.project.repairs_now:
            assert changes.repaired_set(value) in (None, *self.project.taken)

    @invariant()
    def done_means_made_from_what_is_there(self):
        found = {one.step.id: one.status for one in resolve(self.project, self.running).steps}
        if found["calibrate"] is Status.DONE:
            assert self.project.calibrated is not None
            assert self.project.calibrated.inputs == self.project.calibration_inputs
        if found["verify"] is Status.DONE:
            assert found["calibrate"] is not Status.STALE
        if found["save"] is Status.DONE:
            assert self.project.saved is not None and found["calibrate"] is not Status.STALE


TestWalk = Walk.TestCase
TestWalk.settings = settings(max_examples=25, stateful_step_count=20, deadline=None)


def test_what_version_1_computed_is_as_current_as_before():
    """It knew inputs by Python's repr of them; the file is of that version."""
    project = WIZARD.read(ROOT / "tests" / "data" / "wizard_v1.json")
    times = {"P1": "10:00", "P2": "10:05", "B-01": "10:07", "A-01": "10:09"}
    project = replace(project, taken={name: f"2026-11-20T{time}:00Z" for name, time in times.items()})
    assert project.calibrated is not None and project.calibrated.inputs == project.calibration_inputs
    assert project.accepted == project.calibrated
    assert project.verified is not None and project.verified.inputs == project.verification_inputs
    assert project.saved is not None and project.saved.inputs == changes.saved_inputs(project)
    assert project.repaired is not None and project.repaired.inputs == (("check", fingerprint(project.checked)),)
    assert project.artefacts is not None
    other = replace(project, artefacts=replace(project.artefacts, ball="ball 400 mm"))
    assert other.calibrated is not None and other.calibrated.inputs != other.calibration_inputs


def test_a_field_that_a_later_version_adds_changes_no_fingerprint():
    @dataclass(frozen=True)
    class Earlier:
        name: str
        places: tuple[float, ...] = ()

    @dataclass(frozen=True)
    class Later:
        places: tuple[float, ...] = ()
        kind: str = "ball"
        name: str = ""

    assert fingerprint(Earlier("A", (1.0,))) == fingerprint(Later((1.0,), name="A"))
    assert fingerprint(Earlier("A")) == fingerprint([Later(name="A")][0])
    others = (Earlier("B"), Earlier("A", (2.0,)), Later((), "board", "A"), None, "A", [])
    assert len({fingerprint(one) for one in (Earlier("A"), *others)}) == 1 + len(others)
