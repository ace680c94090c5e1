"""The studies of benchmarks/studies with few runs on small balls: the same code, checked with wide limits."""

import numpy as np
import pytest

from benchmarks.stages import without_effects
from benchmarks.studies import accuracy, convergence, coverage, folds, groups, misfit, moves, outliers, shape
from benchmarks.studies.alignment import similarity
from benchmarks.studies.bound import dense_network
from benchmarks.studies.compared import ratio_error, rmse_um
from benchmarks.studies.report import Report
from benchmarks.studies.simulated import estimate_from_truth, make_bars, simulate
from benchmarks.studies.workers import Job, spread
from spherecal.calibrate import calibrate
from spherecal.data.observations import find_features
from spherecal_sim.rigs import random_rotations
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions
from tests.networks import unstrained

__all__ = ["unstrained"]

SMALL = SimulationOptions(targets=60)
SMALLER = SimulationOptions(targets=40)


# so few targets do not link rig B's two sides by triples: it only runs from the truth
@pytest.mark.parametrize(
    ("rig", "case", "whole"),
    [("rigA", "turned", 1), ("rigB", "moved", 0), ("rigA", f"turned, {accuracy.BAR_POSES} poses of a bar inside", 1)],
)
def test_accuracy_reaches_the_bound_and_predicts_its_errors(rig, case, whole, unstrained):
    runs = 6
    collected, bounds = accuracy.study(rig, case, 0, runs, whole, SMALL), accuracy.bounds(rig, case, SMALL)
    for form, found in collected.items():
        figures = accuracy.figures(rig, case, form, bounds[form], found)
        assert figures.covariance_difference < 1e-6
        assert figures.ratio < 1.05 + 4 * figures.ratio_error
        assert figures.ratio > 0.6
        assert abs(figures.chi2.mean() - 1) < 5 * np.sqrt(2 / figures.redundancy / runs)
        for name, each in figures.normalised.items():
            assert abs(each.ratio - 1) < max(0.1, 5 * each.standard_error), (form, name)
        assert len(figures.whole) == whole
        assert all(run.other_used <= 2 and run.cost_difference < 2e-3 for run in figures.whole), figures.whole


def test_intervals_are_neither_far_too_narrow_nor_too_wide():
    for form, runs in coverage.study("rigA", "one blurred", 0, 4, SMALL).items():
        assert len(runs) == 4
        for name, found in coverage.coverage(runs).items():
            assert 0.4 < found.ratio < 2.0, (form, name)
            assert found.share > 0.5, (form, name)


def test_coverage_counts_what_lies_inside():
    runs = [{"x": np.array([0.0, 1.9, -1.9, 2.0])}, {"x": np.array([0.0, 0.0, 0.0, -5.0])}]
    found = coverage.coverage(runs)["x"]
    assert found.share == pytest.approx(0.75)
    assert found.standard_error == pytest.approx(0.0)
    assert found.ratio == pytest.approx(np.sqrt((2 * 1.9**2 + 4.0 + 25.0) / 8))


def test_walls_share_no_dot():
    session, truth = coverage.walls(*simulate_session("rigB", 1, SMALL))
    o = session.observations
    assert o is not None
    assert len(session.cameras) == len(truth.cameras) == len(o.cameras) == 6
    behind = np.array([c.centre_mm[1] < 0 for c in truth.cameras])[o.camera]
    feature = find_features(o).of_observation
    assert behind.any() and not behind.all()
    assert not np.intersect1d(feature[behind], feature[~behind]).size


def test_errors_of_whole_calibrations_are_of_their_uncertainties():
    found = coverage.whole("rig A", 1, False)
    assert found is not None
    assert all(0.5 < np.sqrt((found[name] ** 2).mean()) < 2.2 for name in ("points", "centres", "lengths"))
    assert found["U"] == pytest.approx(2 * found["error"] / found["lengths"])


def test_a_knock_is_blamed_and_repaired_and_nothing_without_one():
    (told,) = moves.knocked(702, 1, 0.05, 0.0, 0.0)
    assert told.only_blamed and told.mended
    assert not told.codes & moves.ACCUSATIONS
    (clean,) = moves.faultless(702, 1, False)
    assert (clean.blamed, clean.repaired, clean.verdict, clean.right) == (set(), set(), "valid", True)


def test_images_held_out_may_turn(monkeypatch):
    """Cameras that turned by a milliradian: 2 to 3 px with cameras held, the noise where they turn."""
    monkeypatch.setattr(moves, "DRIFT_RAD", (1e-3, 1e-3))
    session, _ = simulate_session("rigA", 1, SMALL)
    done, drifted = calibrate(session), moves._drifting(session, np.random.default_rng(1)).observations
    assert drifted is not None
    held, turning = folds.held_out(done, drifted.select(np.flatnonzero(drifted.placement == 3)))
    assert np.sqrt(held.mean()) > 0.5
    assert np.sqrt(turning.mean()) < 1.2 * SMALL.sigma_px * np.sqrt(2)


def test_effects_can_be_left_out():
    session, _ = simulate_session("rigA", 1, SimulationOptions(targets=100, misfit_px=0.1))
    fields = [camera.field is not None for camera in calibrate(session).rig.cameras]
    with without_effects():
        plain = [camera.field is not None for camera in calibrate(session).rig.cameras]
    assert any(fields) and not any(plain)
    assert any(camera.field is not None for camera in calibrate(session).rig.cameras)


def test_a_bent_ball_is_better_free_and_a_misfit_better_rigid():
    bent = shape.study("rigA", "moved", 0.3, 1, SMALLER)
    assert bent["auto"][0].form == "free"
    assert rmse_um(bent["free"]) < rmse_um(bent["rigid"])
    assert ratio_error(bent["auto"], bent["free"]) == np.inf  # one run tells nothing of its scatter
    fitted = misfit.study("rigA", 0.05, 1, SMALLER)
    assert rmse_um(fitted["rigid"], "rescaled") < rmse_um(fitted["free"], "rescaled")
    assert rmse_um(fitted[misfit.WITH_BAR]) < rmse_um(fitted["free"])


def test_facing_cameras_are_linked():
    found = groups.study(groups.SERIES[2], groups.FIRST_SEED, 1)[0]
    assert (found.cameras, found.shared_dots) == (6, 0)
    assert 1e3 * np.sqrt(found.bars.rescaled.mean()) < 3 * found.bound_um


def test_sides_that_tie_other_placements_share_one_ball() -> None:
    """Each side alone ties other placements to the ball, both together all of them: bars were 12 um off before."""
    found = groups.study(groups.SERIES[1], groups.FIRST_SEED + 1, 1)[0]
    assert found.cameras == 6
    assert 1e3 * np.sqrt(found.bars.rescaled.mean()) < 1.5 * found.bound_um


@pytest.mark.parametrize("processes", [1, 2])
def test_jobs_come_back_in_their_order(processes):
    assert spread([Job(pow, (k, 2)) for k in range(5)], processes) == [0, 1, 4, 9, 16]


def test_bad_starts_converge():
    outcomes = convergence.study("rigA", 1, SMALL)
    assert all(o.converged for o in outcomes), outcomes


def test_outliers_are_found():
    for share, outcomes in outliers.study("rigA", 1, SMALL).items():
        summary = outliers.Summary(outcomes)
        wrong, missed, _, _ = summary.counts
        assert summary.linked == 1, share
        assert missed < 0.05 * wrong, share
        assert summary.ratio < 3, share


def test_exact_observations_give_the_exact_network():
    simulated = simulate("rigA", 3, SimulationOptions(targets=40, sigma_px=1e-9, bump_mm=0.0))
    bars = make_bars(simulated.truth, 1)
    assert np.abs(bars.errors_of(simulated.true, None)).max() < 1e-9
    estimate = estimate_from_truth(simulated)
    # a chord over a sphere with no bumps leaves nothing to the scale but its own formula
    assert np.abs(bars.errors_of(estimate.solution.state, None)).max() < 1e-3


@pytest.mark.parametrize("form", ["free", "rigid"])
def test_the_dense_covariance_keeps_the_points_in_place(form):
    dense = dense_network(simulate("rigA", 1, SimulationOptions(targets=30)), form)
    features = np.flatnonzero(dense.known)
    rows = dense.unknowns.by_places(features, np.broadcast_to(np.eye(3), (len(features), 3, 3)))
    of_places = (rows @ dense.in_datum).reshape(len(features), 3, -1)
    assert np.abs(of_places.mean(axis=0)).max() < 1e-9 * np.abs(of_places).max()


def test_similarity_is_found():
    rng = np.random.default_rng(0)
    x, r = rng.normal(size=(20, 3)), random_rotations(1, rng)[0]
    fit = similarity(x, 2.5 * x @ r.T + [1.0, 2.0, 3.0])
    assert fit.scale == pytest.approx(2.5)
    assert np.allclose(fit.rotation, r)
    assert np.allclose(fit.shift, [1, 2, 3])


def test_a_report_says_what_was_missed(tmp_path):
    page = Report("Title", "command")
    page.table(("a", "b"), [(1, 2.0)])
    page.verdict("one", True, "1")
    page.verdict("two", False, "2")
    text = page.write(tmp_path, "name").read_text(encoding="utf-8")
    assert "**met**: one" in text
    assert "**MISSED**: two" in text
    assert "| 1 | 2 |" in text
