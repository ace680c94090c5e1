"""Work by blocks of observations: the same bits as all at once, whatever the size of the blocks."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from spherecal.adjust import dense_elimination, linear, point_factors
from spherecal.adjust import engine as compiled
from spherecal.adjust.bundle import datum_defect, residual_size
from spherecal.adjust.covariance import covariance
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.datum import Places
from spherecal.adjust.least_squares import minimise, normal_equations
from spherecal.adjust.levenberg import Minimum, Settings
from spherecal.adjust.network import Network, free_network
from spherecal.adjust.point_factors import shift_matrix
from spherecal.adjust.problem import Problem
from spherecal.adjust.weights import left_over_by_points
from spherecal.base import arrays
from spherecal.base.arrays import blocks, blocks_of_groups
from spherecal.calibrate import calibrate
from spherecal.diagnose.score import ScoreTest, make_score_test
from spherecal.geometry.camera import undistort, undistort_views
from spherecal.geometry.length_uncertainty import Cameras, predict_lengths
from spherecal.geometry.triangulation import Triangulation, ray_angles, triangulate
from spherecal.steps.settings import CalibrationSettings
from spherecal_files.write_result import write_result
from tests.method.test_covariance import with_world
from tests.networks import Small, observed, one_thread, perturbed, simulated, small_network

__all__ = ["one_thread"]

CASES: dict[str, dict[str, object]] = {
    "free": {},
    "shared": {"intrinsics": "shared"},
    "lengths": {"lengths": 4},
    "rigid": {"rigid": True},
    "rigid, shared, lengths": {"rigid": True, "intrinsics": "shared", "lengths": 4},
}


@pytest.fixture(params=[7, 50])
def small_blocks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch):
    """A function that makes blocks small from here on."""

    def shrink() -> None:
        monkeypatch.setattr(arrays, "ROWS_AT_ONCE", request.param)
        monkeypatch.setattr(linear, "MOST_IN_MEMORY", 0)

    return shrink


@pytest.fixture(params=CASES)
def net(request: pytest.FixtureRequest) -> Small:
    return small_network(n_points=40, **CASES[request.param])  # type: ignore[arg-type]


def test_blocks_cover_everything_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrays, "ROWS_AT_ONCE", 7)
    for count in (0, 1, 7, 8, 30):
        assert [i for rows in blocks(count) for i in range(count)[rows]] == list(range(count))
    rng = np.random.default_rng(0)
    for groups in (0, 1, 40):
        start = np.r_[0, np.cumsum(rng.integers(0, 6, groups))]
        pairs = list(blocks_of_groups(start))
        assert [g for first, last in pairs for g in range(first, last)] == list(range(groups))
        assert all(start[last] - start[first] <= 7 + 5 for first, last in pairs)


@pytest.mark.parametrize("dense", [False, True], ids=["by runs", "dense"])
@pytest.mark.parametrize("robust", [False, True], ids=["plain", "robust"])
def test_a_step_is_the_same_bits(net: Small, dense: bool, robust: bool, small_blocks, monkeypatch) -> None:
    monkeypatch.setattr(dense_elimination, "LEAST_COLUMNS", 0 if dense else 10**9)
    monkeypatch.setattr(dense_elimination, "LEAST_VIEWS", 0)
    monkeypatch.setattr(dense_elimination, "_CHUNK", 11)
    monkeypatch.setattr(dense_elimination, "_CHUNK_FREE", 11)
    problem, state = net.problem.select(net.problem.point != 4), perturbed(net.problem, net.truth, 0.3)
    weight = np.random.default_rng(1).uniform(0.2, 1.0, len(problem.uv)) if robust else None
    whole = compiled.linear_model(problem, state, weight)
    step = np.random.default_rng(2).normal(size=problem.layout.expanded) * 1e-3
    expected = compiled.reduce(problem, whole, 1e-3)
    points, cost = compiled.back_substitute(problem, whole, expected, step)
    small_blocks()
    parts = compiled.linear_model(problem, state, weight)
    assert isinstance(whole, linear.Linearisation) and isinstance(parts, linear.LinearByBlocks)
    np.testing.assert_array_equal(parts.residual, whole.residual)
    assert parts.width == whole.width
    found = compiled.reduce(problem, parts, 1e-3)
    unit = 1 / np.sqrt(np.where(expected.diagonal > 0, expected.diagonal, 1.0))
    # dots that the same cameras and placements see, but not equally often, may be parted between two products
    exact = not net.problem.n_placements or dense
    np.testing.assert_allclose(
        found.matrix * unit * unit[:, None], expected.matrix * unit * unit[:, None], rtol=0, atol=0 if exact else 1e-13
    )
    for name in ("gradient", "diagonal", "point_inverse", "point_gradient"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    again, same_cost = compiled.back_substitute(problem, parts, expected, step)
    np.testing.assert_array_equal(again, points)
    assert same_cost == cost


def test_free_points_by_their_cameras_are_those_by_runs(monkeypatch) -> None:
    net = small_network(n_points=300, n_cameras=8)
    problem, state = net.problem, perturbed(net.problem, net.truth, 0.3)
    linearised = compiled.linear_model(problem, state, None)
    expected = compiled.reduce(problem, linearised, 1e-3)
    monkeypatch.setattr(dense_elimination, "LEAST_COLUMNS", 0)
    monkeypatch.setattr(dense_elimination, "LEAST_VIEWS", 0)
    assert dense_elimination.is_dense(problem)
    found = compiled.reduce(problem, linearised, 1e-3)
    unit = 1 / np.sqrt(expected.diagonal.clip(min=1e-30))
    difference = np.triu(found.matrix - expected.matrix) * unit * unit[:, None]
    np.testing.assert_allclose(difference, 0, atol=1e-13)
    np.testing.assert_allclose(
        (found.gradient - expected.gradient) * unit, 0, atol=1e-12 * abs(expected.gradient * unit).max()
    )
    np.testing.assert_allclose(found.diagonal, expected.diagonal, rtol=1e-12)
    np.testing.assert_allclose(found.point_inverse, expected.point_inverse, rtol=1e-10)
    np.testing.assert_allclose(found.point_gradient, expected.point_gradient, rtol=1e-12)


def test_runs_that_are_cut_are_the_same_bits(small_blocks) -> None:
    """Hundreds of points that the same cameras see are eliminated 64 at a time; no block ends within these."""
    net = small_network(n_points=400, n_cameras=3)
    problem = net.problem
    seen_by_all = np.bincount(problem.point, minlength=problem.n_points)[problem.point] == 3
    problem = problem.select(seen_by_all)
    assert seen_by_all.sum() > 3 * 100
    expected = normal_equations(problem, net.truth, compiled.linear_model(problem, net.truth, None), 0.1)
    small_blocks()
    found = normal_equations(problem, net.truth, compiled.linear_model(problem, net.truth, None), 0.1)
    np.testing.assert_array_equal(found.matrix, expected.matrix)
    np.testing.assert_array_equal(found.gradient, expected.gradient)


def test_the_minimum_is_the_same(net: Small, small_blocks) -> None:
    start = perturbed(net.problem, net.truth, 0.3)
    expected = minimise(net.problem, start, Settings(cauchy=2.0))
    small_blocks()
    found = minimise(net.problem, start, Settings(cauchy=2.0))
    assert found.cost == pytest.approx(expected.cost, rel=1e-12)
    np.testing.assert_allclose(found.state.intrinsics, expected.state.intrinsics, rtol=1e-6, atol=1e-9)
    if not net.problem.n_placements:
        assert found.costs == expected.costs
        np.testing.assert_array_equal(found.state.points, expected.state.points)


def test_what_points_leave_over_is_the_same(net: Small, small_blocks, either_engine) -> None:
    expected = left_over_by_points(net.problem, net.truth)
    small_blocks()
    for found, whole in zip(left_over_by_points(net.problem, net.truth), expected, strict=True):
        np.testing.assert_allclose(found, whole, rtol=1e-12, atol=1e-12)


def _network(net: Small) -> Network:
    p = net.problem
    network = free_network(p.point, p.camera, p.uv, p.n_points, p.free_intrinsics, p.group)
    return replace(network, sigma=1 / p.weight, ball=p.ball)


def test_points_and_residuals_are_the_same_bits(net: Small, small_blocks) -> None:
    network, rng = _network(net), np.random.default_rng(3)
    network = network.only(rng.permutation(len(network.uv)))  # recordings are not sorted by points
    used = rng.random(len(network.uv)) < 0.8
    state = perturbed(net.problem, net.truth, 0.1)
    triangulated, angles, size = (
        network.triangulated(state, used),
        network.angles(state, used),
        residual_size(network, state),
    )
    rays = undistort(network.uv, state.intrinsics[network.camera])
    small_blocks()
    found = network.triangulated(state, used)
    for field in fields(Triangulation):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(triangulated, field.name), err_msg=field.name)
    np.testing.assert_array_equal(network.angles(state, used), angles)
    np.testing.assert_array_equal(residual_size(network, state), size)
    for some, whole in zip(undistort_views(network.uv, network.camera, state.intrinsics), rays, strict=True):
        np.testing.assert_array_equal(some, whole)


def test_a_whole_calibration_is_the_same_bytes(tmp_path, monkeypatch) -> None:
    """From the files that a user reads: nothing beyond the first block is missing or at another place."""
    session, _ = simulated("demo", 1, targets=60)
    settings = CalibrationSettings(method="free")
    write_result(calibrate(session, settings), tmp_path / "whole")
    monkeypatch.setattr(arrays, "ROWS_AT_ONCE", 300)
    assert len(observed(session)) > 3 * arrays.ROWS_AT_ONCE
    write_result(calibrate(session, settings), tmp_path / "blocks")
    for name in ("residuals.csv", "points.csv", "spheres.csv", "rig.json"):
        assert (tmp_path / "blocks" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name


def test_nothing_to_triangulate_is_no_point() -> None:
    state, none = small_network().truth, np.zeros(0, dtype=np.int64)
    poses = state.cameras
    found = triangulate(none, none, np.zeros((0, 2)), np.zeros(0), 3, poses)
    assert np.isnan(found.points).all() and not found.in_front.any() and (found.views == 0).all()
    assert (ray_angles(none, none, np.zeros((0, 2)), 3, poses) == 0).all()
    assert len(triangulate(none, none, np.zeros((0, 2)), np.zeros(0), 0, poses).points) == 0


def _solved(net: Small) -> tuple[Problem, Minimum, Places | None]:
    problem, state, places = with_world(net)
    return problem, minimise(problem, state, Settings(tolerance=1e-14, max_iterations=200)), places


def _probed(problem: Problem, minimum: Minimum, places: Places | None) -> tuple[Covariance, ScoreTest]:
    cofactors = covariance(problem, minimum.state, places)
    assert cofactors is not None
    redundancy = problem.rows - problem.unknowns + datum_defect(problem)
    return cofactors, make_score_test(problem, minimum.state, cofactors, minimum.cost, redundancy)


def _assert_alike(found: Covariance, expected: Covariance) -> None:
    for name in ("cameras", "points"):
        a, b = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9 * np.nanmax(np.abs(b)), err_msg=name)


@pytest.mark.parametrize("most_kept", [10**9, 0], ids=["", "shifts held"])
def test_covariance_and_tests_of_changes_are_alike(net: Small, most_kept: int, small_blocks, monkeypatch) -> None:
    """With the shifts of a rigid ball's dots held, as in recordings of more than 200,000 observations."""
    solved = _solved(net)
    expected, probe = _probed(*solved)
    rows = np.flatnonzero(probe.problem.camera == 1)
    values = np.random.default_rng(4).normal(size=(len(rows), 2, 3))
    columns = np.random.default_rng(5).normal(size=(2 * len(probe.problem.uv), 2))
    small_blocks()
    monkeypatch.setattr(point_factors, "_MOST_KEPT", most_kept)
    found, again = _probed(*solved)
    _assert_alike(found, expected)
    once, in_blocks = expected, found
    assert isinstance(once, point_factors.PointFactors) and isinstance(in_blocks, point_factors.PointFactors)
    assert (in_blocks.shifts is not None) == (most_kept == 0 and net.problem.n_placements > 0)
    whole, parts = shift_matrix(once).toarray(), shift_matrix(in_blocks).toarray()
    np.testing.assert_allclose(parts, whole, rtol=1e-6, atol=1e-9 * np.abs(whole).max())
    for a, b in zip(again.block(rows, values), probe.block(rows, values), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-7 * np.abs(b).max())
    np.testing.assert_array_equal(again.by_pose(rows), probe.by_pose()[rows])
    np.testing.assert_allclose(again.past_unknowns(columns), probe.past_unknowns(columns), atol=1e-7)
    np.testing.assert_allclose(again.past_unknowns(columns[:, 0]), probe.past_unknowns(columns)[:, 0], atol=1e-7)


def test_sparse_changes_are_tested_as_full_ones_are(net: Small) -> None:
    _, probe = _probed(*_solved(net))
    rows = np.flatnonzero(probe.problem.camera == 1)[::-1]
    values = np.random.default_rng(4).normal(size=(len(rows), 2, 12))
    values[:, :, 6:] *= np.arange(len(rows))[:, None, None] % 2
    expected = probe.block(rows, values)
    for a, b in zip(probe.block(rows, csr_array(values.reshape(-1, 12))), expected, strict=True):
        assert isinstance(a, np.ndarray)
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())


def test_full_shifts_are_multiplied_as_sparse_ones_are(net: Small, monkeypatch) -> None:
    _, probe = _probed(*_solved(net))
    rows = np.flatnonzero(probe.problem.camera == 1)
    values = np.random.default_rng(4).normal(size=(len(rows), 2, 12))
    monkeypatch.setattr("spherecal.diagnose.score.FULL", 1.0)
    sparse = probe.block(rows, values)
    monkeypatch.setattr("spherecal.diagnose.score.FULL", 0.0)
    for a, b in zip(probe.block(rows, values), sparse, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())


def test_tests_without_the_reduced_unknowns_hold_no_matrix(small_blocks, monkeypatch) -> None:
    monkeypatch.setattr("spherecal.diagnose.score.MOST_NONZERO", 0)
    net = small_network(n_points=40)
    solved = _solved(net)
    _, probe = _probed(*solved)
    columns = np.random.default_rng(5).normal(size=(2 * len(net.problem.uv), 2))
    rows = np.arange(len(net.problem.uv))
    a = probe.block(rows, columns.reshape(-1, 2, 2))[1]
    left = probe.past_unknowns(columns)
    assert probe.shift is None
    np.testing.assert_allclose(columns.T @ left, a, atol=1e-9)
    small_blocks()
    np.testing.assert_allclose(_probed(*solved)[1].past_unknowns(columns), left, atol=1e-9)


def test_predicted_lengths_are_alike(small_blocks) -> None:
    net = small_network()
    state, rng = net.truth, np.random.default_rng(6)
    c, columns = len(state.rotation), np.arange(9)
    root = rng.normal(size=(c * 15, c * 15)) * 1e-4
    cameras = Cameras(
        state.intrinsics, state.rotation, state.translation, np.tile([2064.0, 1544.0], (c, 1)), root @ root.T, columns
    )
    middle = np.nanmean(state.points, axis=0)
    ends = middle + rng.normal(size=(40, 2, 3)) * 50.0
    expected = predict_lengths(cameras, ends, 0.05)
    assert np.isfinite(expected.own).any()
    small_blocks()
    found = predict_lengths(cameras, ends, 0.05)
    for name in ("calibration", "own", "views"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12, err_msg=name)
    assert len(predict_lengths(cameras, ends[:0], 0.05).own) == 0


def test_cameras_that_nobody_uses_do_not_disturb_the_blocks(small_blocks) -> None:
    net = small_network()
    problem = net.problem.select(net.problem.camera != 2)
    free_pose = problem.free_pose & (np.arange(problem.n_cameras) != 2)
    problem = replace(problem, free_pose=free_pose, free_intrinsics=problem.free_intrinsics & free_pose[:, None])
    expected = compiled.reduce(problem, compiled.linear_model(problem, net.truth, None), 0.0)
    small_blocks()
    found = compiled.reduce(problem, compiled.linear_model(problem, net.truth, None), 0.0)
    np.testing.assert_array_equal(found.matrix, expected.matrix)
