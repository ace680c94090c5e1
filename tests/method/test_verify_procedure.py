"""The verification's procedure: budget, decision, pose plan, departures, and what casts doubt on it."""

import json
import math
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2
from scipy.stats import t as student

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig, RigScale
from spherecal.data.session import BarLength, Certificate, Session
from spherecal_files.bar_registry import REGISTERED_BAR, RegisteredBar
from spherecal_files.rig_file import rig_bytes
from spherecal_files.write_verification import write_verification
from spherecal_rigs.pose_plan import BarMarks, cameras_that_see, judge_pose, measured_ends, plan_poses
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import CameraMove, SimulationOptions, Truth
from spherecal_verify.budget import Contribution, certificate_freedom, combine, resolution_mm
from spherecal_verify.departures import LINES, MeasuringVolume, lengths_on_lines, volume_box
from spherecal_verify.limit import LengthLimit, judge_against, parse_limit
from spherecal_verify.verification import LengthBudget, MeasuredLength, Verification
from spherecal_verify.verify_bars import VerifySettings, verify
from tests.export_rigs import make_rig
from tests.method.test_verify import codes, simulate, true_rig

KEY = ("A", "A1", "A2")


def measured(error_mm: float, length_mm: float = 500.0, pose: str = "A-01") -> MeasuredLength:
    budget = LengthBudget(0.01, 0.0, 0.0, 0.0, 0.0)
    return MeasuredLength("A", pose, "A1", "A2", length_mm + error_mm, length_mm, budget, 4)


@pytest.fixture(scope="module")
def two_bars() -> tuple[Session, Truth]:
    return simulate_session("rigA", 5, SimulationOptions(bar_poses=8, placements=1, targets=40))


def test_budget_follows_the_gum() -> None:
    """Two parts, 3 and 4 um, the second of 7 degrees of freedom: by hand, with Student's t of another library."""
    parts = (Contribution("thermometer", "B", "normal", 0.003), Contribution("certificate", "A", "normal", 0.004, 7))
    budget = combine(KEY, parts)
    assert budget.combined_mm == pytest.approx(0.005)
    freedom = 7 * (5 / 4) ** 4
    assert budget.freedom == pytest.approx(freedom)
    assert budget.coverage_factor == pytest.approx(student.ppf(0.97725, freedom))
    assert budget.expanded_mm == pytest.approx(budget.coverage_factor * 0.005)
    assert budget.shares() == [("certificate", pytest.approx(0.64)), ("thermometer", pytest.approx(0.36))]
    assert budget.remedy() == Phrase("remedy-certificate")
    assert combine(KEY, parts[:1]).coverage_factor == pytest.approx(2.0, abs=1e-4)


def test_a_negligible_contribution_leaves_the_degrees_of_freedom_infinite() -> None:
    """A repeatability of 1e-17 mm gave 3e66 of them, which no reader of the file accepts."""
    exact = Contribution("certificate", "B", "normal", 0.01)
    budget = combine(("A", "1", "2"), [exact, Contribution("repeatability", "A", "normal", 1e-17, 5)])
    assert math.isinf(budget.freedom) and budget.coverage_factor == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize("freedom", [3.0, 7.0, 30.0])
def test_a_certificates_k_tells_its_degrees_of_freedom(freedom: float) -> None:
    assert certificate_freedom(float(student.ppf(0.97725, freedom))) == pytest.approx(freedom, rel=1e-3)
    assert certificate_freedom(2.0) == math.inf
    assert certificate_freedom(14.0) == 1.0


def test_resolution_is_the_last_digit_stated() -> None:
    assert resolution_mm(BarLength("1", "2", 412.345, 0.004, 2)) == pytest.approx(1e-3)
    assert resolution_mm(BarLength("1", "2", 500.0, 0.0015, 2)) == pytest.approx(1e-4)
    assert resolution_mm(BarLength("1", "2", 500.0, 0.0, 2)) == 0.0


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("0.03+L/20000", LengthLimit(0.03, 20000)),
        ("0.05", LengthLimit(0.05)),
        ("50 um", LengthLimit(0.05)),
        ("30µm + L/2e4", LengthLimit(0.03, 20000)),
        (".1mm", LengthLimit(0.1)),
    ],
)
def test_limits_are_read(text: str, limit: LengthLimit) -> None:
    read = parse_limit(text)
    assert (read.constant_mm, read.divisor) == (pytest.approx(limit.constant_mm), limit.divisor)


@pytest.mark.parametrize("text", ["", "L/20000", "-0.1", "0", "0.1+L/0", "nan", "0.1+K/5", "1e99", "0.1 cm", "9" * 500])
def test_nonsense_is_no_limit(text: str) -> None:
    with pytest.raises(InputError, match="is not a limit"):
        parse_limit(text)


def test_decision_leaves_the_doubt_on_both_sides() -> None:
    """Limit 0.1 mm, u 0.01 mm, two lengths: proven to 0.0836, refuted above 0.1196 (95 %), else nobody knows."""
    budget = combine(KEY, (Contribution("scale", "B", "normal", 0.01),))
    within, beyond = budget.guard_mm(), budget.guard_mm(2)
    assert (within, beyond) == (pytest.approx(0.01645, abs=1e-5), pytest.approx(0.01960, abs=1e-5))
    limit = LengthLimit(0.05, 10000.0)
    assert limit.at(500.0) == pytest.approx(0.1)
    for error, verdict in (
        (0.1 - within - 1e-9, "pass"),
        (0.1 - within + 1e-9, "cannot tell"),
        (0.1 + beyond - 1e-9, "cannot tell"),
        (0.1 + beyond + 1e-9, "fail"),
    ):
        for sign in (1, -1):
            rows = [measured(0.001), measured(sign * error, pose="A-02")]
            decided = judge_against(limit, rows, [budget], True)
            assert decided.verdict == verdict
            assert decided.lengths[0].worst_pose == "A-02"
    assert judge_against(limit, [measured(0.0)], [budget], False).verdict is None


def test_verification_decides_and_explains(two_bars: tuple[Session, Truth], tmp_path: Path) -> None:
    session, truth = two_bars
    rig = true_rig(truth)
    corners = truth.volume_mm[0], truth.volume_mm[1]
    done = verify(session, rig, None, VerifySettings(parse_limit("0.2+L/20000"), None, corners))
    assert done.findings == ()
    procedure = done.procedure
    assert procedure is not None and procedure.acceptance is not None
    assert procedure.acceptance.verdict == "pass"
    assert {"departure-longest", "departure-corners"} <= {one.key for one in procedure.departures}
    tight = verify(session, rig, None, VerifySettings(parse_limit("0.02")))
    assert tight.procedure and tight.procedure.acceptance
    assert tight.procedure.acceptance.verdict == "cannot tell"
    wrong = verify(session, true_rig(truth, scale=1.001), None, VerifySettings(parse_limit("0.1")))
    assert wrong.procedure and wrong.procedure.acceptance
    assert wrong.procedure.acceptance.verdict == "fail"

    (tmp_path / "rig.json").write_bytes(rig_bytes(rig))
    write_verification(done, tmp_path / "result", tmp_path / "rig.json")
    written = json.loads((tmp_path / "result" / "verification.json").read_bytes())["procedure"]
    assert "reduced" in written["title"] and written["acceptance"]["verdict"] == "pass"
    first = written["budgets"][0]
    assert sum(c["share"] for c in first["contributions"]) == pytest.approx(1.0)
    assert math.hypot(*(c["standard_uncertainty_mm"] for c in first["contributions"])) == pytest.approx(
        first["combined_mm"]
    )
    assert len(written["poses"]) == 16


def test_the_limit_is_judged_by_the_test_alone(two_bars: tuple[Session, Truth]) -> None:
    """A rig that knows its scale to 0.5 % only, and is 0.5 % wrong, had U 2.7 mm and "cannot tell" at a limit of 75 um.

    Its errors agree with what it states, which is the other question.
    """
    session, truth = two_bars
    rig = replace(true_rig(truth, scale=1.005), scale=RigScale("target_spacing", 0.005))
    done = verify(session, rig, None, VerifySettings(parse_limit("0.05+L/20000")))
    assert done.procedure and done.procedure.acceptance
    assert done.procedure.acceptance.verdict == "fail" and done.decision.verdict == "consistent"
    assert "limit-exceeded" in codes(done) and "lengths-contradict" not in codes(done)
    for budget in done.procedure.budgets:
        names = [c.name for c in budget.contributions]
        assert names == ["certificate", "thermometer", "expansion", "centring", "resolution"]
        assert budget.expanded_mm < 0.05


def test_errors_that_agree_one_by_one_may_contradict_together(two_bars: tuple[Session, Truth]) -> None:
    """A scale 40 ppm too large, stated as exact: 20 um on 500 mm, where a length's own noise is 15 um."""
    session, truth = two_bars
    right = verify(session, true_rig(truth)).decision
    assert right.verdict == "consistent" and right.chi_square is not None
    assert right.most_chi_square == pytest.approx(chi2.isf(0.001, 48)) and right.chi_square < 70
    done = verify(session, true_rig(truth, scale=1.00004))
    assert not done.decision.exceeding and done.decision.verdict == "inconsistent" and done.failed
    (finding,) = (f for f in done.findings if f.code == "lengths-contradict")
    assert finding.severity == "error" and finding.kind == "together"
    assert "every" not in phrase(done.decision.rule)


@pytest.mark.parametrize("scale", [1.01, 0.998])
def test_a_wrong_scale_is_said(two_bars: tuple[Session, Truth], scale: float) -> None:
    """One length that is wrong by as much is not the scale."""
    session, truth = two_bars
    done = verify(session, true_rig(truth, scale=scale))
    (finding,) = (f for f in done.findings if f.code == "lengths-contradict")
    assert finding.kind == "scale" and finding.values["percent"] == pytest.approx(100 * (scale - 1), abs=0.02)
    assert "the scale is wrong" in finding.words("message", "en")
    lengths = tuple(
        replace(x, length_mm=x.length_mm * (scale if i == 1 else 1)) for i, x in enumerate(session.bars[0].lengths)
    )
    wrong = replace(session, bars=(replace(session.bars[0], lengths=lengths), *session.bars[1:]))
    (finding,) = (f for f in verify(wrong, true_rig(truth)).findings if f.code == "lengths-contradict")
    assert finding.kind == "each"


def moved_ends(verification: Verification) -> set[str]:
    return {place for f in verification.findings if f.code == "camera-moved" for place in f.where}


def test_a_wrong_certificate_is_named(two_bars: tuple[Session, Truth]) -> None:
    session, truth = two_bars
    lengths = tuple(
        replace(x, length_mm=x.length_mm + (0.15 if x.length_mm > 450 else 0.0)) for x in session.bars[0].lengths
    )
    wrong = replace(session, bars=(replace(session.bars[0], lengths=lengths), *session.bars[1:]))
    done = verify(wrong, true_rig(truth), None, VerifySettings(parse_limit("1")))
    (finding,) = (f for f in done.findings if f.code == "length-doubtful")
    assert finding.where == ("A",) and "A1 to A4" in finding.message
    acceptance = done.procedure.acceptance  # type: ignore[union-attr]
    assert acceptance is not None
    assert acceptance.verdict == "cannot tell" and acceptance.doubts == ("length-doubtful",)


def test_a_length_that_contradicts_its_bar_fails_no_rig(two_bars: tuple[Session, Truth]) -> None:
    """0.5 mm are far beyond the limit, and no error of the rig; where another length fails too, the rig does."""
    session, truth = two_bars
    longest = max(session.bars[0].lengths, key=lambda x: x.length_mm)
    lengths = tuple(replace(x, length_mm=x.length_mm + 0.5 * (x is longest)) for x in session.bars[0].lengths)
    wrong = replace(session, bars=(replace(session.bars[0], lengths=lengths), *session.bars[1:]))
    for scale, verdict in ((1.0, "cannot tell"), (1.001, "fail")):
        done = verify(wrong, true_rig(truth, scale=scale), None, VerifySettings(parse_limit("0.1")))
        acceptance = done.procedure.acceptance  # type: ignore[union-attr]
        assert acceptance is not None and acceptance.verdict == verdict
        assert "fail" in {x.verdict for x in acceptance.lengths}


def test_a_bar_that_is_wrong_as_a_whole_is_named(two_bars: tuple[Session, Truth]) -> None:
    session, truth = two_bars
    lengths = tuple(replace(x, length_mm=x.length_mm * 1.0004) for x in session.bars[1].lengths)
    wrong = replace(session, bars=(session.bars[0], replace(session.bars[1], lengths=lengths)))
    (finding,) = (f for f in verify(wrong, true_rig(truth)).findings if f.code == "bars-disagree")
    assert finding.where == ("B",)


def test_a_thermometer_5_kelvin_off_is_named(two_bars: tuple[Session, Truth]) -> None:
    session, truth = two_bars
    poses = tuple(
        replace(p, temperature_c=(p.temperature_c or 0) + 5.0) if p.bar == "A" else p for p in session.bar_poses
    )
    done = verify(replace(session, bar_poses=poses), true_rig(truth), None, VerifySettings(parse_limit("0.5")))
    assert "temperatures-differ" in codes(done)
    acceptance = done.procedure.acceptance  # type: ignore[union-attr]
    assert acceptance is not None and acceptance.verdict == "cannot tell"


def test_a_drifted_camera_is_named_and_no_other() -> None:
    """0.05 degrees or 0.5 mm since the calibration: the bars' few marks are enough to tell."""
    for move in (CameraMove("C03", 0, 0.5), CameraMove("C07", 0, 0.0, math.radians(0.05))):
        options = SimulationOptions(bar_poses=8, placements=1, targets=40, moved=move)
        session, truth = simulate_session("rigA", 6, options)
        done = verify(session, true_rig(truth), None, VerifySettings(parse_limit("1")))
        assert moved_ends(done) == {move.camera}
        assert done.procedure.acceptance.verdict == "cannot tell"  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("certificate", "code"),
    [
        (Certificate("K-1", valid_until=date(2026, 1, 1)), "certificate-expired"),
        (Certificate("K-1", valid_until=date(2026, 12, 1)), "certificate-expires-soon"),
        (Certificate("K-1", valid_until=date(2027, 12, 1)), None),
        (Certificate("K-1", date=date(2026, 12, 1)), "certificate-not-yet"),
    ],
)
def test_expired_certificates_are_named(
    two_bars: tuple[Session, Truth], certificate: Certificate, code: str | None
) -> None:
    session, truth = two_bars
    bars = (replace(session.bars[0], certificate=certificate), *session.bars[1:])
    done = verify(replace(session, bars=bars), true_rig(truth), None, VerifySettings(today=date(2026, 11, 21)))
    assert codes(done) == ({code} if code else set())


def test_bars_of_one_laboratory_err_alike(two_bars: tuple[Session, Truth]) -> None:
    """Their certificates do not average out in the mean of all errors; laboratories that are not known may be one."""
    session, truth = two_bars

    def mean(*laboratories: str) -> float:
        bars = tuple(
            replace(
                bar,
                certificate=Certificate("K", laboratory),
                lengths=tuple(replace(x, expanded_uncertainty_mm=0.2) for x in bar.lengths),
            )
            for bar, laboratory in zip(session.bars, laboratories, strict=True)
        )
        return verify(replace(session, bars=bars), true_rig(truth)).overall.expanded_uncertainty_mm or 0.0

    one, two = mean("PTB", " ptb"), mean("PTB", "NPL")
    assert one == mean("", "") == pytest.approx(0.2, rel=0.1) and one / two == pytest.approx(np.sqrt(2), rel=0.05)


# the plan


def planned(preset: str) -> tuple[Rig, Truth, Session]:
    session, truth = simulate_session(preset, 1, SimulationOptions(placements=1, targets=20, bar_poses=1))
    return true_rig(truth), truth, session


@pytest.mark.parametrize("preset", ["rigA", "rigB"])
def test_the_plan_covers_seven_lines_where_the_bars_are_seen(preset: str) -> None:
    rig, truth, session = planned(preset)
    low, high = truth.volume_mm
    marks = [BarMarks.of(bar.id, bar.lengths) for bar in session.bars]
    plan = plan_poses(rig, marks, (low, high))
    assert plan.missing == ()
    assert min(plan.lengths_on_line) >= 5
    assert len({pose.id for pose in plan.poses}) == len(plan.poses)
    directions = plan.box.directions()
    corners = directions @ plan.box.axes.T / plan.box.half
    assert (np.count_nonzero(abs(corners) > 1e-9, axis=1) == [1, 1, 1, 3, 3, 3, 3]).all()
    assert np.allclose(np.ptp(abs(corners[3:]), axis=1), 0)  # from corner to corner
    parallel = abs(directions @ directions.T) > 1 - 1e-6
    assert (parallel == np.eye(7, dtype=bool)).all()  # seven lines, none of them twice
    for pose in plan.poses:
        along = pose.end_mm - pose.start_mm
        assert np.linalg.norm(along) == pytest.approx(500.0, abs=0.5)
        assert abs(along @ directions[pose.line]) == pytest.approx(np.linalg.norm(along))
        assert abs(pose.facing @ along) < 1e-6
        middle = (pose.start_mm + pose.end_mm) / 2
        assert ((middle > low - 1) & (middle < high + 1)).all()
        # each end in two cameras or more, by the truth's own projection of the rig
        for end in (pose.start_mm, pose.end_mm):
            seen = 0
            for c in truth.cameras:
                x = c.rotation @ end + c.translation_mm
                u = c.intrinsics[0] * x[0] / x[2] + c.intrinsics[2], c.intrinsics[1] * x[1] / x[2] + c.intrinsics[3]
                seen += x[2] > 0 and -20 < u[0] < c.kind.image_size[0] + 20 and -20 < u[1] < c.kind.image_size[1] + 20
            assert seen >= 2
    middles = np.array([(pose.start_mm + pose.end_mm) / 2 for pose in plan.poses])
    assert np.ptp(middles, axis=0).max() > 300  # spread
    assert json.dumps(plan.as_json())


def test_marks_lie_where_the_lengths_put_them() -> None:
    lengths = (
        BarLength("1", "2", 100.0, 0.01, 2),
        BarLength("3", "4", 200.0, 0.01, 2),
        BarLength("1", "4", 500.0, 0.01, 2),
        BarLength("8", "9", 10.0, 0.01, 2),
    )
    marks = BarMarks.of("A", lengths)
    assert marks.names == ("1", "2", "3", "4")
    assert marks.along_mm.tolist() == [0.0, 100.0, 300.0, 500.0]


def test_a_wide_lens_sees_what_it_shows_near_its_corners() -> None:
    """Beyond 1.3 times the corner's distance, of which 1.8 is seen here; a lens that folds shows nothing there."""
    rig = make_rig(4, 1)
    size, shown = (1280, 1024), np.array([[1.8 * 640, 1.8 * 512, 819.6], [0.0, 0.0, 819.6]])
    for barrel, seen in (((-0.15, 0.02), True), ((-0.4, 0.02), False)):
        lens = np.zeros(16)
        lens[:6] = 600.0, 600.0, 639.5, 511.5, *barrel
        camera = replace(rig.cameras[0], intrinsics=lens, image_size=size)
        camera = replace(camera, rotation=np.eye(3), translation_mm=np.zeros(3))
        assert cameras_that_see(replace(rig, cameras=(camera,)), shown).tolist() == [[seen, True]]


def test_a_bar_is_accepted_where_it_was_asked_either_way_round() -> None:
    rig, truth, session = planned("rigA")
    plan = plan_poses(rig, [BarMarks.of("A", session.bars[0].lengths)], (truth.volume_mm[0], truth.volume_mm[1]))
    first = plan.next_pose(())
    assert first is not None and first.id == "L1-1"
    ends = np.stack([first.start_mm, first.end_mm])
    assert judge_pose(first, ends + 20).accepted
    assert judge_pose(first, ends[::-1]).accepted
    off = judge_pose(first, ends + np.array([0, 400, 0]))
    assert not off.accepted and off.off_mm == pytest.approx(400) and off.off_deg == pytest.approx(0)
    turned = ends.mean(axis=0) + np.array([[0, -250, 0], [0, 250, 0]])
    across = judge_pose(first, turned)
    assert not across.accepted and across.off_deg == pytest.approx(90) and across.off_mm == pytest.approx(0)
    assert not judge_pose(first, None).accepted
    assert plan.next_pose({"L1-1"}) is plan.poses[1]
    assert plan.next_pose({pose.id for pose in plan.poses}) is None


@pytest.mark.parametrize("mark_points", ["centre", "dots"])
def test_the_bars_ends_are_measured_live(mark_points: str) -> None:
    session, rig = simulate(poses=2, mark_points=mark_points)
    _, truth = simulate_session("rigA", 1, SimulationOptions(bar_poses=2, placements=1, mark_points=mark_points))  # type: ignore[arg-type]
    assert session.observations is not None
    pose = truth.bar_poses[0]
    found = measured_ends(rig, session.bars[0], session.target_set, session.observations, len(session.placements))
    bar = truth.bar(pose.bar)
    true = pose.place_mm + np.outer(bar.x_mm[[0, -1]], pose.rotation[:, 0])
    assert found is not None
    np.testing.assert_allclose(found, true, atol=0.15)
    assert measured_ends(rig, session.bars[1], session.target_set, session.observations, 1) is None


def test_lengths_are_counted_on_their_lines() -> None:
    box = MeasuringVolume(np.zeros(3), np.eye(3), np.array([500.0, 400.0, 300.0]))
    ends = [np.array([-d, d]) * 100.0 for d in (np.array([1.0, 0, 0]), np.array([5.0, 4, 3]), np.array([-5.0, -4, -3]))]
    rows = [replace(measured(0.0), ends_mm=pair) for pair in ends]
    assert lengths_on_lines(rows, box).tolist() == [1, 0, 0, 2, 0, 0, 0]
    assert len(box.directions()) == LINES


def test_the_box_lies_as_the_cameras_do() -> None:
    _, rig = simulate()
    corners = np.array([-1.0, -2, -3]), np.array([1.0, 2, 3])
    assert volume_box(rig, corners).half.tolist() == [1, 2, 3]


def test_a_registered_bar_keeps_what_it_is() -> None:
    bar = RegisteredBar("S", {}, (), 1e-5, certificate=Certificate("K", "lab", date(2026, 1, 2), None))
    assert REGISTERED_BAR.entry(bar)["certificate"] == {"number": "K", "laboratory": "lab", "date": "2026-01-02"}
