"""Verification of rigs whose truth is known: errors, uncertainties, findings, files."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.context import Context
from spherecal.base.errors import Cancelled, InputError, OutputError
from spherecal.data.observations import Observations
from spherecal.data.rig import CameraSigma, Quality, Rig, RigCamera, RigScale
from spherecal.data.session import Bar, BarLength, Session
from spherecal_files.rig_file import rig_bytes
from spherecal_files.write_result import write_result
from spherecal_files.write_verification import write_verification
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions, Truth
from spherecal_verify.agreement import decide
from spherecal_verify.uncertainty import length_statistics
from spherecal_verify.verification import LengthBudget, MeasuredLength, Verification
from spherecal_verify.verify_bars import verify
from tests.method.test_results import example_calibration


def stated(value: float | None) -> float:
    """A figure that is always stated of lengths that were measured."""
    assert value is not None
    return value


def simulate(preset: str = "rigA", seed: int = 1, poses: int = 8, **options) -> tuple[Session, Rig]:
    """A session with bars, and the true rig as if it had been calibrated without error."""
    session, truth = simulate_session(preset, seed, SimulationOptions(bar_poses=poses, placements=1, **options))
    return session, true_rig(truth)


def true_rig(truth: Truth, focal_factor: float = 1.0, focal_sigma_px: float = 0.0, scale: float = 1.0) -> Rig:
    sigma = CameraSigma(np.zeros(3), np.zeros(3), np.r_[focal_sigma_px, focal_sigma_px, np.zeros(14)])
    cameras = tuple(
        RigCamera(
            c.id,
            None,
            c.kind.image_size,
            c.intrinsics * np.r_[focal_factor, focal_factor, np.ones(14)],
            c.rotation,
            c.translation_mm * scale,
            0.05,
            500,
            sigma,
        )
        for c in truth.cameras
    )
    return Rig(cameras[0].id, cameras, RigScale("bar", 0.0), Quality(True, 0.05, 0.04, 0.04, ()), "")


def observed(session: Session) -> Observations:
    assert session.observations is not None
    return session.observations


def codes(verification: Verification) -> set[str]:
    return {finding.code for finding in verification.findings}


@pytest.mark.parametrize("preset", ["rigA", "rigB"])
@pytest.mark.parametrize("mark_points", ["centre", "dots"])
def test_stated_uncertainty_is_that_of_the_errors(preset: str, mark_points: str) -> None:
    scores = []
    for seed in range(3):
        verification = verify(*simulate(preset, seed, 10, mark_points=mark_points))
        assert verification.findings == ()
        assert verification.decision.verdict == "consistent"
        assert len(verification.measured) == 60
        assert min(m.views for m in verification.measured) >= 2
        # certificates err alike in all poses: judge the scatter about each length's mean by the noise
        for length in verification.lengths:
            of_length = [
                m for m in verification.measured if (m.from_mark, m.to_mark) == (length.from_mark, length.to_mark)
            ]
            scores += [(m.error_mm - stated(length.mean_error_mm)) / m.budget.noise_mm for m in of_length]
            assert abs(stated(length.mean_error_mm)) < 1.6 * stated(length.expanded_uncertainty_mm)  # 3.2 sigma
    freedom = 3 * 6 * 9
    assert np.square(scores).sum() / freedom == pytest.approx(1.0, abs=4 * math.sqrt(2 / freedom))


def test_temperature_is_corrected() -> None:
    """Bars of steel 3 K too warm measure 17 um too long at 500 mm; the reference follows them."""
    session, rig = simulate(sigma_px=0.0)
    by_pose = {pose.id: pose.temperature_c for pose in session.bar_poses}
    for m in verify(session, rig).measured:
        temperature = by_pose[m.pose]
        assert temperature is not None
        bar = next(bar for bar in session.bars if bar.id == m.bar)
        certified = next(x for x in bar.lengths if (x.from_mark, x.to_mark) == (m.from_mark, m.to_mark))
        assert m.reference_mm == pytest.approx(certified.length_mm * (1 + 1.15e-5 * (temperature - 20)), abs=1e-12)
        assert abs(m.error_mm) < 4 * 0.002 + 4 * 0.05 * 1.15e-5 * m.length_mm


def test_unmeasured_temperature_costs_uncertainty() -> None:
    session, rig = simulate()
    cold = replace(session, bar_poses=tuple(replace(pose, temperature_c=None) for pose in session.bar_poses))
    verification = verify(cold, rig)
    assert "no-temperature" in codes(verification)
    for m, known in zip(verification.measured, verify(session, rig).measured, strict=True):
        assert m.budget.temperature_mm == pytest.approx(1.15e-5 * m.reference_mm * 5 / math.sqrt(3), rel=1e-9)
        assert m.budget.temperature_mm > 5 * known.budget.temperature_mm


def test_wrong_scale_is_found() -> None:
    session, truth = simulate_session("rigA", 1, SimulationOptions(bar_poses=8, placements=1))
    verification = verify(session, true_rig(truth, scale=1.0005))
    longest = max(verification.lengths, key=lambda length: stated(length.mean_error_mm))
    assert longest.mean_error_mm == pytest.approx(0.25, abs=0.02)
    assert verification.decision.verdict == "inconsistent"
    assert len(verification.decision.exceeding) > 10
    rig = replace(true_rig(truth, scale=1.0005), scale=RigScale("target_spacing", 5e-4))
    admitted = verify(session, rig)
    assert admitted.decision.verdict == "consistent"
    assert admitted.lengths[0].expanded_uncertainty_mm > 2 * 5e-4 * 100


def test_focal_lengths_carry_the_calibration_part() -> None:
    """A common error of all focal lengths by their standard uncertainty: the errors stay within the stated part."""
    session, truth = simulate_session("rigA", 1, SimulationOptions(bar_poses=8, placements=1, sigma_px=0.0))
    relative = 1e-4
    verification = verify(session, true_rig(truth, 1 + relative, focal_sigma_px=relative * 2319))
    # n cameras in common instead of each on its own: at most sqrt(2 n) times the part
    for m in verification.measured:
        assert abs(m.error_mm) < math.sqrt(20) * m.budget.calibration_mm + 0.01
        assert 0.2 < m.budget.calibration_mm / (relative * m.length_mm) < 2


def test_gross_views_do_not_matter() -> None:
    session, rig = simulate(poses=10)
    clean = verify(session, rig)
    o = observed(session)
    rows = np.flatnonzero(o.placement >= len(session.placements))
    rng = np.random.default_rng(0)
    feature = o.placement[rows] * 10_000 + o.target[rows]
    # one gross view in every fifth mark with four views or more
    many = [f for f, n in zip(*np.unique(feature, return_counts=True), strict=True) if n >= 4][::5]
    wrong = np.array([rng.choice(rows[feature == f]) for f in many])
    uv = o.uv.copy()
    uv[wrong] += rng.choice([-1, 1], (len(wrong), 2)) * rng.uniform(2, 40, (len(wrong), 2))
    spoilt = verify(replace(session, observations=replace(o, uv=uv)), rig)
    (finding,) = spoilt.findings
    assert finding.code == "outlying-views"
    assert set(finding.where) == {f"{o.placements[o.placement[i]]}/{o.cameras[o.camera[i]]}" for i in wrong}
    assert len(spoilt.measured) == len(clean.measured)
    assert spoilt.overall.rms_error_mm == pytest.approx(clean.overall.rms_error_mm, rel=0.3)
    assert spoilt.decision.verdict == "consistent"


def test_what_cannot_be_measured_is_said() -> None:
    session, rig = simulate(poses=2, mark_points="dots")
    o = observed(session)
    mark = session.bars[0].marks["A1"]
    hidden = (o.target == mark.target) & np.isin(o.point, range(5))  # three dots are left: no centre
    verification = verify(replace(session, observations=o.select(~hidden)), rig)
    finding = next(f for f in verification.findings if f.code == "mark-not-found")
    assert "A1" in finding.message and "needs 4" in finding.message
    assert finding.where == ("A-01", "A-02")
    assert not any(m.from_mark == "A1" for m in verification.measured)
    assert any(m.from_mark == "A3" for m in verification.measured)
    verification = verify(replace(session, target_set=None), rig)
    assert verification.decision.verdict == "no data"
    assert verification.overall.mean_error_mm is None


def test_scale_bars_do_not_check() -> None:
    session, truth = simulate_session("rigA", 1, SimulationOptions(bar_poses=3, placements=1, scale="bar"))
    scale_bar = session.scale.bar if session.scale else None
    verification = verify(session, true_rig(truth))
    assert scale_bar is not None
    assert all(m.bar != scale_bar for m in verification.measured)
    assert "scale-bar-left-out" in codes(verification)


def test_nothing_to_verify() -> None:
    session, rig = simulate(poses=1)
    verification = verify(replace(session, bar_poses=()), rig)
    assert codes(verification) == {"no-check-bars"}
    assert (verification.decision.verdict, verification.lengths) == ("no data", ())
    o = observed(session)
    verification = verify(replace(session, observations=o.select(o.placement < 1)), rig)
    assert codes(verification) == {"mark-not-found", "camera-not-verified"}


def test_rig_without_scale_or_validity() -> None:
    session, rig = simulate(poses=2)
    verification = verify(
        session, replace(rig, scale=RigScale("none", None), quality=replace(rig.quality, valid=False))
    )
    assert {"no-scale", "rig-not-valid"} <= codes(verification)
    assert verification.decision.verdict == "no data"


def test_cameras_that_the_rig_lacks() -> None:
    session, rig = simulate(poses=4)
    verification = verify(session, replace(rig, cameras=rig.cameras[:8]))
    assert "camera-not-in-rig" in codes(verification)
    assert verification.measured
    strangers = tuple(replace(camera, id=f"X{camera.id}") for camera in rig.cameras)
    with pytest.raises(InputError, match="none of its cameras"):
        verify(session, replace(rig, cameras=strangers))
    cropped = tuple(replace(camera, image_size=(1000, 1000)) for camera in rig.cameras)
    with pytest.raises(InputError, match="1000 x 1000"):
        verify(session, replace(rig, cameras=cropped))
    with pytest.raises(InputError, match="no observations"):
        verify(replace(session, observations=None), rig)


def test_it_can_be_stopped() -> None:
    with pytest.raises(Cancelled):
        verify(*simulate(poses=1), Context(is_cancelled=lambda: True))


def measured(errors: list[float], noise: float = 0.01) -> list[MeasuredLength]:
    budget = LengthBudget(noise, 0.0, 0.003, 0.004, 0.0)
    return [MeasuredLength("A", f"A-{i}", "A1", "A2", 400 + e, 400.0, budget, 4) for i, e in enumerate(errors)]


def test_statistics_follow_the_gum() -> None:
    statistics = length_statistics(measured([0.02, 0.04, 0.03]))
    assert (statistics.n, statistics.max_abs_error_mm) == (3, pytest.approx(0.04))
    assert statistics.mean_error_mm == pytest.approx(0.03)
    assert statistics.sd_mm == pytest.approx(0.01)
    type_a, type_b = 0.01 / math.sqrt(3), 0.005
    combined = math.hypot(type_a, type_b)
    freedom = 2 * (combined / type_a) ** 4  # 6.1: Student's factor for 95.45 % lies between 2.43 (7) and 2.52 (6)
    assert freedom == pytest.approx(6.125)
    assert 2.43 < stated(statistics.coverage_factor) < 2.52
    assert statistics.expanded_uncertainty_mm == pytest.approx(stated(statistics.coverage_factor) * combined)
    single = length_statistics(measured([0.02]))
    assert (single.sd_mm, single.coverage_factor) == (None, pytest.approx(2.0, abs=1e-3))
    assert single.expanded_uncertainty_mm == pytest.approx(2 * math.hypot(0.01, 0.005), rel=1e-3)


BAR = Bar("A", "check", {}, (BarLength("A1", "A2", 400.0, 0.008),), 1.15e-5)


def test_decision_allows_for_many_errors() -> None:
    """Normal errors of the stated size: k grows with n, so that 99.1 % of all verifications are consistent."""
    u = math.sqrt(0.01**2 + 0.005**2)
    rng = np.random.default_rng(1)
    decided = [decide(measured(list(rng.normal(0, u, 100))), {"A": BAR}, None, 0.0, True) for _ in range(2000)]
    assert 0.984 < [one.verdict for one in decided].count("consistent") / 2000 < 0.998  # three standard errors
    decision = decide(measured([0.0, 0.1, 0.0]), {"A": BAR}, None, 0.0, True)
    assert (decision.verdict, decision.exceeding) == ("inconsistent", (("A-1", "A1", "A2"),))
    assert decide([], {}, None, 0.0, True).verdict == "no data"


def test_files(tmp_path: Path) -> None:
    session, rig = simulate(poses=2)
    verification = verify(session, rig)
    rig_path = tmp_path / "rig.json"
    rig_path.write_bytes(rig_bytes(rig))
    write_verification(verification, tmp_path / "out", rig_path)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["bars.csv", "rig.json", "verification.json"]
    with (tmp_path / "out" / "bars.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["bar", "pose", "from", "to", "length_mm", "reference_mm", "error_mm", "u_mm", "views"]
    assert len(rows) == len(verification.measured) == 12
    for row, m in zip(rows, verification.measured, strict=True):
        assert float(row["length_mm"]) - float(row["reference_mm"]) == pytest.approx(float(row["error_mm"]), abs=1e-8)
        assert float(row["u_mm"]) == pytest.approx(m.budget.combined_mm, rel=1e-6)
    document = json.loads((tmp_path / "out" / "verification.json").read_text())
    assert (document["format"], document["version"]) == ("spherecal/verification", 1)
    assert list(document["lengths"][0])[:9] == [
        "bar", "from", "to", "n", "mean_error_mm", "sd_mm", "max_abs_error_mm", "expanded_uncertainty_mm",
        "coverage_factor",
    ]  # fmt: skip
    assert document["overall"]["n"] == 12
    assert document["decision"]["verdict"] == "consistent"


def test_verification_joins_its_calibration(tmp_path: Path) -> None:
    """Into the result folder of the same rig.json it adds its files; any other older result is replaced whole."""
    verification = verify(*simulate(poses=1))
    calibration = example_calibration()
    write_result(calibration, tmp_path / "out")
    for _ in range(2):
        write_verification(verification, tmp_path / "out", tmp_path / "out" / "rig.json")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    calibration_files = {"rig.json", "points.csv", "residuals.csv", "spheres.csv", "observations.csv"}
    assert names == calibration_files | {"bars.csv", "verification.json"}
    other = tmp_path / "other.json"
    other.write_bytes(rig_bytes(calibration.rig, {"note": "another"}))
    write_verification(verification, tmp_path / "out", other)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"rig.json", "bars.csv", "verification.json"}
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError):
        write_verification(verification, tmp_path / "mine", other)
