"""What the pages show, without widgets."""

import os
import re
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from spherecal.base.context import Context, Progress
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal_boards import board_images
from spherecal_cameras.camera_settings import CameraProfile
from spherecal_cameras.new_recording import RigCameras
from spherecal_cameras.protocol import CameraInfo, CameraState, CameraStatus, Counters, Discovery, SetupReport
from spherecal_files.findings_file import Sentence
from spherecal_files.verification_file import BarReport, BarRow, ProcedureReport
from spherecal_gui import coverage as cov
from spherecal_gui.controllers.camera_controller import _delivers
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import word
from spherecal_gui.presenters.bars_presenter import (
    budget_cells,
    errors_of,
    length_cells,
    next_pose,
    pose_name,
    rule_text,
)
from spherecal_gui.presenters.calibrate_presenter import CourseOfWork
from spherecal_gui.presenters.connect_presenter import camera_lines, connect_summary
from spherecal_gui.presenters.look_presenter import summary, tile_state
from spherecal_gui.presenters.placement_presenter import AutoTrigger, Scene, island_text, need_lists
from spherecal_gui.presenters.results_presenter import CameraRow, bar_verdict
from spherecal_gui.presenters.step_states import (
    BarFacts,
    CheckFacts,
    PlacementFacts,
    VerifyFacts,
    bar_says,
    check_says,
    left_text,
    placement_says,
    seeing,
    verify_says,
)
from spherecal_gui.tasks.ghost import ToGo
from spherecal_gui.workflow import Status
from spherecal_verify.budget import Budget, Contribution
from spherecal_verify.limit import Acceptance, Conformity, LengthConformity, LengthLimit
from spherecal_verify.verification import LengthStatistics
from tests.conftest import ROOT

SIZE = (1000, 500)


def dots(targets: range, low: float = 0.0, high: float = 1.0) -> cov.Dots:
    """Eight dots of each target, spread over a part of the image."""
    count = 8 * len(targets)
    t = np.linspace(low, high, count, endpoint=False)
    uv = np.column_stack([t * SIZE[0], (t * 37 % 1) * SIZE[1]])
    return cov.Dots(np.repeat(np.array(targets), 8), np.tile(np.arange(8), len(targets)), uv, SIZE)


# --- coverage --------------------------------------------------------------------------------------------------------


def test_cells_lie_where_the_dots_are():
    one = cov.Dots(np.array([1, 1]), np.array([0, 1]), np.array([[0.0, 0.0], [999.0, 499.0]]), SIZE)
    counts = cov.cells([one, one])
    assert counts[0, 0] == 2
    assert counts[9, 9] == 2
    assert counts.sum() == 4
    assert cov.coverage([one]) == pytest.approx(0.02)


def test_common_dots_count_the_same_placement_only():
    first = {"A": dots(range(10)), "B": dots(range(5, 15))}
    second = {"A": dots(range(20, 22)), "B": dots(range(30, 32)), "C": dots(range(20, 21))}
    common = cov.common_dots([first, second], ["A", "B", "C"])
    assert common.tolist() == [[96, 40, 8], [40, 96, 0], [8, 0, 8]]


def test_common_dots_agree_with_the_engine():
    """The engine counts in its own way; the technician must not be told otherwise."""
    from spherecal.data.observations import find_features, seen_matrix
    from spherecal_sim.simulate_session import simulate_session
    from spherecal_sim.truth import SimulationOptions

    session, _ = simulate_session("demo", 3, SimulationOptions(placements=2, targets=60, bar_poses=0))
    o = session.observations
    assert o is not None
    seen = seen_matrix(find_features(o), o, np.ones(len(o), bool)).astype(int)
    sets = []
    for p in range(len(session.placements)):
        rows = {name: (o.placement == p) & (o.camera == c) for c, name in enumerate(o.cameras)}
        sets.append({n: cov.Dots(o.target[r], o.point[r], o.uv[r], (1280, 1024)) for n, r in rows.items()})
    assert np.array_equal(cov.common_dots(sets, list(o.cameras)), seen @ seen.T)


def test_islands_are_found():
    common = np.array([[99, 50, 0, 0], [50, 99, 5, 0], [0, 5, 99, 30], [0, 0, 30, 99]])
    assert cov.islands(common) == [[0, 1], [2, 3]]
    assert island_text(cov.islands(common), "ABCD") == ("Not linked with each other: A B | C D", "bad")
    assert island_text([[0, 1]], "AB")[1] == "good"


def test_more_dots_and_better_spread_are_told_apart():
    many, few, bunched = dots(range(20)), dots(range(2)), dots(range(20), 0.0, 0.2)
    found = cov.needs([{"A": many, "B": many, "C": few, "D": bunched}], ["A", "B", "C", "D"])
    assert [one.need for one in found] == ["enough", "enough", "more", "spread"]
    assert [one.level for one in found] == ["good", "good", "bad", "caution"]
    more, spread = need_lists(found)
    assert more is not None and more.text == "Need more dots: C"
    assert spread is not None and spread.text == "Need them elsewhere in the image: D"
    later = need_lists(found, more_to_come=True)[1]
    assert later is not None and later.text == "At the next placements, fill other parts of the image: D"
    assert need_lists([one for one in found if one.need == "enough"]) == (None, None)


def test_a_camera_that_shares_nothing_needs_more_however_much_it_sees():
    alone = {"A": dots(range(20)), "B": dots(range(20)), "C": dots(range(50, 90))}
    assert cov.needs([alone], ["A", "B", "C"])[2].need == "more"


# --- placement -------------------------------------------------------------------------------------------------------


def advice(scene, **facts):
    return placement_says(PlacementFacts(scene, **facts))


AWAY = ToGo(560.0, None, near=False, level_mm=560.0, towards="C06")


def test_advice_names_the_most_urgent():
    enough = {"A": 200, "B": 200}
    assert advice(Scene({}, None), work="exposing").text.startswith("Hold still")
    assert "Hold still" not in advice(Scene({}, None), work="computing").text
    assert "Put the ball" in advice(Scene({"A": 0, "B": 0}, None)).text
    assert "B sees too little" in advice(Scene({"A": 200, "B": 30}, False)).text
    assert "No images from B: check cable" in advice(Scene({"A": 200, "B": 0}, True, ("B",))).text
    assert "come to rest" in advice(Scene(enough, False)).text
    assert advice(Scene(enough, True)).level == "good"
    assert advice(Scene(enough, True), taken=True).text.startswith("Captured")
    assert advice(Scene(enough, True), to_go=AWAY).text == "Move the ball 560 mm towards C06"


def test_a_lost_camera_does_not_hold_up_the_others():
    assert Scene({"A": 200, "B": 0}, True, ("B",)).enough
    assert not Scene({"A": 200, "B": 0}, True).enough
    assert not Scene({}, None).enough


def test_where_the_ball_lies_in_place_and_a_camera_stays_short_the_page_says_so_with_what_to_do():
    short = Scene({"A": 200, "B": 88, "C": 91}, True)
    assert advice(short).text == "Fewer than 100 dots: B (88), C (91). Capture anyway, or move the ball"
    assert advice(short).level == "caution"
    assert "Turn or move the ball" in advice(replace(short, still=None)).text
    assert "Move the ball 560 mm" in advice(short, to_go=AWAY).text
    assert "Turn or move the ball" in advice(short, as_before=True).text
    assert not short.enough


def test_what_a_camera_lacks_here_the_other_placements_may_make_up_for():
    made_up = Scene({"A": 200, "B": 88}, True, made_up=True)
    assert made_up.enough
    told = advice(made_up)
    assert told.level == "good"
    assert "B sees little here, but enough elsewhere" in told.text
    assert advice(replace(made_up, still=False)).text == "Let the ball come to rest"
    trigger = AutoTrigger()
    assert not trigger.feed(made_up, 0.0) and trigger.feed(made_up, 1.5)


def test_it_takes_by_itself_once_and_again_only_after_a_movement():
    trigger = AutoTrigger()
    still, moving = Scene({"A": 200}, True), Scene({"A": 200}, False)
    times = [trigger.feed(still, t / 10) for t in range(40)]
    assert times.count(True) == 1
    assert times.index(True) == 15
    assert not trigger.feed(moving, 5.0)
    assert not trigger.feed(still, 5.1)
    assert trigger.feed(still, 6.7)


def test_it_does_not_take_what_is_not_enough():
    trigger = AutoTrigger()
    for scene in (Scene({"A": 50}, True), Scene({"A": 200}, None)):
        assert not trigger.feed(scene, 0.0) and not trigger.feed(scene, 10.0)


# --- look and connect ------------------------------------------------------------------------------------------------


def status(state: CameraState = CameraState.STREAMING, **counted: int) -> CameraStatus:
    return CameraStatus("S1", state, "cause", "remedy", Counters(**counted), 40.0)


def sight(count: int = 40, blur: float | None = 0.7, saturated: float = 0.0, brightness: float = 0.2) -> Any:
    return SimpleNamespace(dots=dots(range(count)), blur_px=blur, saturated=saturated, brightness=brightness)


@pytest.mark.parametrize(
    ("seen", "level", "word"),
    [
        (sight(), "good", "sharp"),
        (sight(blur=1.8), "caution", "Out of focus (1.8 px)"),
        (sight(blur=3.0), "bad", "focus ring"),
        (sight(saturated=0.2), "caution", "20 % clipped"),
        (sight(count=0, blur=None, brightness=0.001), "bad", "Lens cap"),
        (sight(count=0, blur=None), "caution", "no targets"),
        (None, "none", "waiting"),
    ],
)
def test_a_tile_says_what_to_do(seen, level, word):
    state = tile_state("C01", status(), seen)
    assert state.level == level
    assert word in state.word


def test_a_lost_camera_says_so_before_anything_else():
    state = tile_state("C01", status(CameraState.LOST), sight())
    assert (state.level, state.word) == ("bad", "Lost. Check cable, power and network; it comes back by itself.")
    assert state.details == "lost. cause remedy"
    assert state.since == "", "it has never sent an image"
    frame: Any = SimpleNamespace(arrived_s=time.perf_counter() - 3600)
    known = [time.strftime("%H:%M:%S", time.localtime(time.time() - 3600 + late)) for late in (-1, 0, 1)]
    state = tile_state("C01", status(CameraState.LOST), sight(), newest=frame)
    assert state.since in [f"no images since {at}" for at in known]
    assert tile_state("C01", status(), sight(), newest=frame).since == ""


def test_the_wall_in_one_sentence():
    good, bad = tile_state("C01", status(), sight()), tile_state("C02", status(CameraState.LOST), None)
    assert summary([good]) == ("All 1 cameras: sharp, dots found.", "good")
    assert summary([good, bad]) == ("No images from C02: check cable, power and network.", "bad")
    dark = tile_state("C03", status(), sight(blur=3.0))
    assert summary([good, bad, dark]) == ("Check C02, C03.", "bad"), "each tile says what is wrong with it"
    assert summary([good, tile_state("C05", status(), sight(blur=3.0))]) == ("C05 is out of focus.", "bad")
    assert summary([good, tile_state("C05", status(), sight(saturated=0.2))]) == ("C05 is too bright.", "caution")


def connection(statuses: dict[str, CameraStatus]) -> Any:
    infos = tuple(CameraInfo(serial, "M", "V", "p") for serial in statuses)
    return SimpleNamespace(
        names={serial: f"C-{serial}" for serial in statuses},
        source=SimpleNamespace(statuses=lambda: statuses),
        discovery=Discovery(infos),
        info=Discovery(infos).camera,
        reports=tuple(SetupReport(serial, (), (640, 480)) for serial in statuses),
        profile=CameraProfile(),
        rig=RigCameras((), {}),
        wire=(),
    )


def test_expected_cameras_that_are_missing_come_first_and_are_named():
    lines = camera_lines(connection({"S1": status()}), ("S1", "S2"))
    assert [(line.name, line.level) for line in lines] == [("S2", "bad"), ("C-S1", "good")]
    assert connect_summary(lines, False, "") == ("1 of 2 cameras ready, without S2", "bad")
    assert connect_summary(lines, False, "No driver. Install it.")[0] == "No driver. Install it."


def test_cameras_of_one_name_say_so_each():
    linked = connection({"S1": status(), "S2": status(), "S3": status()})
    linked.discovery = Discovery(tuple(replace(one, user_name="Center") for one in linked.discovery.cameras[:2]))
    assert [line.about for line in camera_lines(linked, ())] == [
        "2 called Center · S1 · 640 x 480", "2 called Center · S2 · 640 x 480",
    ]  # fmt: skip
    linked.profile = linked.profile.with_entry(replace(linked.profile.entry("S2"), name="Left"))
    assert [line.about for line in camera_lines(linked, ())] == ["S1 · 640 x 480", "S2 · 640 x 480"]


def test_an_ill_link_names_the_remedy():
    (line,) = camera_lines(connection({"S1": status(delivered=90, incomplete=10)}), ())
    assert line.level == "caution"
    assert "10 % of the images damaged. Check cable" in line.word
    (line,) = camera_lines(connection({"S1": status(delivered=0, incomplete=10)}), ())
    assert line.level == "bad", "no image arrives whole"


def test_one_whole_image_is_enough_to_count_as_a_camera_that_delivers():
    assert _delivers(status(delivered=1, incomplete=50)) and _delivers(status(delivered=0, incomplete=4))
    assert not _delivers(status(delivered=0, incomplete=5))


def test_a_camera_whose_images_all_arrive_damaged_is_lost(qapp):
    cameras = Controller().cameras
    cameras.connection = connection(
        {"S1": status(delivered=90, incomplete=10), "S2": status(delivered=0, incomplete=9)}
    )
    assert cameras.lost() == ("C-S2",)


# --- calibrate -------------------------------------------------------------------------------------------------------


def test_the_course_follows_the_engines_own_words():
    """Stages, iterations and the two runs of the method, as a real calibration reports them."""
    from spherecal.calibrate import calibrate
    from spherecal_sim.simulate_session import simulate_session
    from spherecal_sim.truth import SimulationOptions

    session, _ = simulate_session("demo", 1, SimulationOptions(targets=80, bar_poses=0))
    events: list[Progress] = [Progress("detect", 0.5, Phrase("image-of", {"number": 1, "images": 2}))]
    calibrate(session, None, Context(events.append))
    course = CourseOfWork()
    reached = []
    for event in events:
        course.add(event)
        reached.append(course.fraction)
    assert reached == sorted(reached)
    assert 0.3 < course.fraction < 0.65, "the second run is still to come"
    assert len(course.runs) >= 2
    assert all(np.isfinite(run).all() for run in map(np.array, course.runs))
    assert course.runs[-1][-1] <= course.runs[-1][0] * 1.001
    unknown = [stage for stage in course.stages if word("stages", stage, "") == ""]
    assert not unknown, "every stage has words for people"


def test_every_stage_that_the_window_reports_has_words():
    sources = (path.read_text(encoding="utf-8") for path in (ROOT / "spherecal_gui").rglob("*.py"))
    reported = {stage for text in sources for stage in re.findall(r'\.report\(\s*"([^"]+)"', text)}
    assert len(reported) > 10
    assert not [stage for stage in reported if word("stages", stage, "") == ""]


def test_the_images_of_a_board_are_counted_and_move_the_bar():
    course, reached = CourseOfWork(), []
    for done in range(95):
        where = Phrase("image-of", {"number": done + 1, "images": 95})
        course.add(Progress(board_images.STAGE, done / 95, detail=where))
        reached.append(course.fraction)
    assert len(set(reached)) == 95 and 0.8 < course.fraction < 0.9
    assert (
        course.said[20]
        == f"{word('stages', board_images.STAGE)}  image 21 of 95"
        != f"{board_images.STAGE}  image 21 of 95"
    )
    assert left_text(10.0, reached[40], None).endswith("s left")


def test_the_second_run_ends_near_the_whole():
    course = CourseOfWork()
    for stage, fraction, detail in (
        ("detect", 1.0, ""),
        ("two-view gate", 1.0, ""),
        ("rigid ball", 0.0, ""),
        ("uncertainty", 1.0, ""),
        ("detect", 1.0, Phrase("looking-again")),
        ("two-view gate", 1.0, ""),
        ("rigid ball", 0.0, ""),
        ("uncertainty", 1.0, ""),
        ("diagnosis", 1.0, ""),
    ):
        if stage == "uncertainty":
            course.add(Progress("bundle adjustment", 0.5, "", 3, 2.5))
        course.add(Progress(stage, fraction, detail))
    assert course.fraction == pytest.approx(0.97)
    assert course.runs == [[2.5], [2.5]]


# --- bars ------------------------------------------------------------------------------------------------------------


def test_bar_poses_are_asked_for_one_after_the_other():
    assert next_pose(("A-01", "A-02"), {"A-01": "t"}) == "A-02"
    assert next_pose(("A-01",), {"A-01": "t"}) is None


@pytest.mark.parametrize(
    ("targets", "level"), [({"A": 4}, "bad"), ({"A": 4, "B": 2}, "caution"), ({"A": 4, "B": 2, "C": 3}, "good")]
)
def test_a_bar_needs_cameras(targets, level):
    assert bar_says(BarFacts("A-01", seeing(targets))).level == level


def bars(verdict: str = "consistent", **others: Any) -> BarReport:
    row = BarRow("A", "A1", "A2", "A-01", 499.98, 500.0, -0.02, 0.01, 4)
    length = LengthStatistics("A", "A1", "A2", 1, -0.02, None, 0.02, 0.03, 2.0)
    return BarReport((length,), 1, verdict, Sentence("r"), coverage_factor=2.5, measured=(row,), **others)


def judged_by(limit_mm: float, decision: Conformity) -> BarReport:
    """The same with somebody's limit."""
    conformity = LengthConformity("A", "A1", "A2", "A-01", -0.02, limit_mm, 0.03, decision)
    acceptance = Acceptance(LengthLimit(limit_mm), decision, (conformity,))
    contributions = (
        Contribution("scale", "B", "normal", 0.003, share=0.1),
        Contribution("calibration", "B", "normal", 0.009, share=0.9),
    )
    budget = Budget("A", "A1", "A2", contributions, 0.0095, 2.0, 0.019)
    return bars(procedure=ProcedureReport("", (), (), (), (budget,), acceptance=acceptance))


def test_errors_carry_their_limits():
    shown = errors_of(bars(exceeding=frozenset({("A-01", "A1", "A2")})))
    assert shown.errors.tolist() == [-0.02]
    assert shown.allowed.tolist() == [pytest.approx(0.025)]
    assert shown.permitted is None
    assert shown.exceeding == (True,)


@pytest.mark.parametrize(
    ("limit", "decision", "word", "beyond"),
    [(0.06, "pass", "PASS", False), (0.03, "cannot tell", "UNDECIDED", False), (-0.02, "fail", "FAIL", True)],
)
def test_a_limit_decides_with_its_guard_band(limit, decision, word, beyond):
    found = judged_by(limit, decision)
    shown = errors_of(found)
    assert shown.permitted is not None and shown.guard is not None
    assert (shown.permitted.tolist(), shown.guard.tolist()) == ([limit], [0.03])
    assert shown.exceeding == (beyond,)
    assert bar_verdict(found).word == word
    assert ("Budget" in bar_verdict(found).sentence) == (word == "UNDECIDED"), "what to do about it"
    assert length_cells(found)[0][-2:] == (f"{limit:.3f}", decision)
    assert "its guard band" in rule_text(found)


def test_the_budget_names_the_largest_part_first_and_what_helps():
    whole, first, second = budget_cells(judged_by(0.06, "pass"))
    assert whole[0] == "A A1-A2" and whole[4].startswith("more placements of the ball")
    assert (first[1], first[3]) == ("the cameras' calibration", "90 %")
    assert (second[1], second[3]) == ("the scale", "10 %")


def test_there_is_no_negative_zero():
    found = bars()
    rounded = replace(found, lengths=(replace(found.lengths[0], mean_error_mm=-0.0002),))
    assert length_cells(rounded)[0][2] == "+0.000"


def test_absent_numbers_are_dashes_never_zero():
    assert length_cells(bars()) == [("A A1-A2", "1", "-0.020", "-", "0.020", "0.030", "-", "-")]
    assert CameraRow("C01", None, 0, 0, None, None, None, placed=False).rms_px is None


@pytest.mark.parametrize(
    ("verdict", "word", "level"),
    [("consistent", "CONSISTENT", "good"), ("inconsistent", "INCONSISTENT", "bad"), ("no data", "NO DATA", "caution")],
)
def test_the_verdict_is_one_word(verdict, word, level):
    told = bar_verdict(bars(verdict))
    assert (told.word, told.level) == (word, level)
    assert "largest 0.020 mm" in told.sentence


def test_a_verdict_that_is_bad_says_what_to_do():
    values = {
        "exceeding": 1,
        "n": 3,
        "worst_mm": 5.0,
        "times": 9.0,
        "k": 2.0,
        "chi": 0.0,
        "chi_limit": 0.0,
        "percent": 1.0,
    }
    found = bars("inconsistent", findings=(Finding("lengths-contradict", "error", values, ("A-01",), kind="scale"),))
    told = bar_verdict(found).sentence
    assert "+1.00 %: the scale is wrong. Do not use the rig." in told
    found = bars("inconsistent", findings=(Finding("lengths-contradict", "error", values, ("A-01",), kind="each"),))
    todo = "Check the bar's certificate, its temperature and its marks; then calibrate again."
    assert todo in bar_verdict(found).sentence.partition("largest")[0], "first"


# --- guided bars -----------------------------------------------------------------------------------------------------

CAMERAS = np.array([[-1000.0, 0.0, 1500.0], [1000.0, 0.0, 1500.0], [0.0, 1000.0, 1500.0]])


def guided(ends: np.ndarray | None, still: bool | None = True):
    """What is said of a bar that should lie along x from -250 to 250 mm."""
    from spherecal_gui.presenters.bars_presenter import bar_guide
    from spherecal_gui.rig_scenes import RigPlanes
    from spherecal_rigs.pose_plan import PlannedPose

    planes = RigPlanes(np.eye(3), ("C01", "C02", "C03"), CAMERAS)
    pose = PlannedPose(
        "L1-1",
        0,
        "A",
        np.array([-250.0, 0, 0]),
        np.array([250.0, 0, 0]),
        np.array([0, 0, 1.0]),
        ("C01", "C02"),
        ("C01", "C02"),
        True,
    )
    return bar_guide(planes, pose, ends, still)


def ends_at(x: float, y: float, z: float, turn_deg: float = 0.0) -> np.ndarray:
    along = 250.0 * np.array([np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg)), 0.0])
    return np.array([x, y, z]) + np.stack([-along, along])


@pytest.mark.parametrize(
    ("ends", "still", "text", "accepted"),
    [
        (None, None, "Lay bar A as in the picture: from near C01 to near C02", False),
        (ends_at(0, 0, 300), True, "Move bar A 300 mm down", False),
        (ends_at(0, 0, -200), True, "Move bar A 200 mm up", False),
        (ends_at(0, -400, 0), True, "Move bar A 400 mm towards C03", False),
        (ends_at(600, 0, 0), True, "Move bar A 600 mm towards C01", False),
        (ends_at(0, 0, 0, 40), True, "Turn bar A by 40°: from near C01 to near C02", False),
        (ends_at(20, 0, 0, 5), False, "It is in place. Wait until it is at rest", True),
        (ends_at(20, 0, 0, 185), True, "Ready: press space", True),
    ],
)
def test_the_bar_is_guided_in_words(ends, still, text, accepted):
    guide = guided(ends, still)
    assert (guide.text, guide.accepted) == (text, accepted)
    assert (guide.level == "good") == text.startswith("Ready")


def test_poses_stand_in_columns_by_line():
    from spherecal_gui.presenters.bars_presenter import pose_columns

    assert pose_columns(["L1-1", "L1-2", "L2-1"]) == [["L1-1", "L1-2"], ["L2-1"]]
    assert pose_columns(["A-01", "A-02", "B-01"]) == [["A-01", "A-02"], ["B-01"]]


def test_a_pose_is_called_by_its_number_whatever_the_plan_calls_it():
    assert [pose_name(pose, ("A-07", "B-01")) for pose in ("A-07", "B-01")] == ["Pose 1 of 2", "Pose 2 of 2"]


def test_while_a_pose_is_being_captured_no_other_is_and_nothing_is_measured():
    for work in ("exposing", "computing", "other"):
        laid, last = BarFacts("A-01", 3, work), BarFacts(None, 3, work)
        assert not bar_says(laid).button.enabled and bar_says(laid).button.why
        for bar in (laid, last):
            said = verify_says(VerifyFacts(bar, taken=True))
            assert not said.button.enabled and not said.also
    assert bar_says(BarFacts("A-01", 3)).button.enabled
    assert verify_says(VerifyFacts(BarFacts(None, 3))).button.does == "measure"
    said = verify_says(VerifyFacts(BarFacts("A-01", 3), taken=True))
    assert said.button.does == "capture" and said.also == {"measure-now"}


def test_a_check_that_failed_before_it_began_is_bad_and_one_that_is_out_of_date_is_not():
    levels = {
        status: check_says(CheckFacts(status, reason="A reason.")).level for status in (Status.FAILED, Status.STALE)
    }
    assert levels == {Status.FAILED: "bad", Status.STALE: "caution"}
