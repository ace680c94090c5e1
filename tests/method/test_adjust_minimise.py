"""The minimiser: it goes down, it arrives, it finds the truth, and what is known beside the images holds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from spherecal.adjust import engine
from spherecal.adjust.bundle import (
    Adjustment,
    best_observations,
    datum_defect,
    refine,
    residual_size,
    robust_start,
)
from spherecal.adjust.covariance import covariance
from spherecal.adjust.intrinsic_priors import RATIONAL_SD, prior_sigmas, with_intrinsic_priors
from spherecal.adjust.least_squares import _Bundle, minimise
from spherecal.adjust.levenberg import Damping, Minimum, Settings, levenberg_marquardt
from spherecal.adjust.network import Network, free_network
from spherecal.adjust.problem import Priors, Problem, length_residuals, prior_residuals
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.base.errors import Cancelled
from spherecal.geometry.rotation import log_rotation
from spherecal.geometry.transform import fit_similarity
from tests.networks import lengths_between, one_thread, perturbed, small_network

__all__ = ["one_thread"]

# small against the curvature of so few points: rigs have ten times as many and stand 0.04 px
NOISE_PX = 0.01
FORMS: dict[str, dict[str, object]] = {
    "own": {},
    "shared": {"intrinsics": "shared"},
    "partly": {"intrinsics": "partly", "n_cameras": 6},
    "fixed": {"intrinsics": "fixed"},
    "locked": {"locked": (0, 3)},
    "lengths": {"lengths": 5},
    "rigid": {"rigid": True},
    "rigid, shared": {"rigid": True, "intrinsics": "shared"},
}


def camera_centres(state: State) -> FloatArray:
    return -np.einsum("cji,cj->ci", state.rotation, state.translation)


def world_points(problem: Problem, state: State) -> FloatArray:
    """All points of all placements, one below the other."""
    if not len(state.placement_rotation):
        return state.points
    turned = np.einsum("tij,pj->tpi", state.placement_rotation, state.points)
    return (turned + state.placement_translation[:, None]).reshape(-1, 3)


def assert_same_network(problem: Problem, found: State, true: State, with_scale: bool, tolerance_mm: float) -> None:
    """Equal up to the datum: a similarity, a rigid motion where the scale is fixed."""
    own, other = world_points(problem, found), world_points(problem, true)
    datum = fit_similarity(own, other, with_scale)
    np.testing.assert_allclose(datum.apply(own), other, rtol=0, atol=tolerance_mm)
    np.testing.assert_allclose(datum.apply(camera_centres(found)), camera_centres(true), rtol=0, atol=tolerance_mm)
    turns = log_rotation(found.rotation @ datum.rotation.T @ true.rotation.transpose(0, 2, 1))
    np.testing.assert_allclose(turns, 0.0, atol=tolerance_mm / 500)


def total_cost(problem: Problem, state: State, cauchy: float | None) -> float:
    model = _Bundle(problem, cauchy)
    return model.cost(state, model.linearise(state))


@pytest.mark.parametrize("cauchy", [None, 2.0], ids=["plain", "robust"])
@pytest.mark.parametrize("form", FORMS)
def test_cost_never_rises_and_the_end_is_a_minimum(form: str, cauchy: float | None) -> None:
    net = small_network(**FORMS[form])  # type: ignore[arg-type]
    start = perturbed(net.problem, net.truth)
    settings = Settings(cauchy=cauchy, max_iterations=200, tolerance=1e-12)
    minimum = minimise(net.problem, start, settings)
    assert minimum.converged
    assert (np.diff(minimum.costs) < 0).all()
    assert minimum.costs[0] == pytest.approx(total_cost(net.problem, start, cauchy), rel=1e-9)
    assert minimum.costs[-1] == minimum.cost
    assert minimum.cost == pytest.approx(total_cost(net.problem, minimum.state, cauchy), rel=1e-9)
    for seed in range(10):  # uphill in every direction
        for size in (1e-4, 1e-6):
            nearby = perturbed(net.problem, minimum.state, size, seed)
            assert total_cost(net.problem, nearby, cauchy) > minimum.cost * (1 - 1e-9)


@pytest.mark.parametrize("form", FORMS)
def test_without_noise_the_truth_is_recovered(form: str) -> None:
    net = small_network(noise_px=0.0, **FORMS[form])  # type: ignore[arg-type]
    minimum = minimise(net.problem, perturbed(net.problem, net.truth), Settings(max_iterations=200))
    assert np.sqrt(2 * minimum.cost / net.problem.rows) < 1e-6
    with_scale = form not in ("lengths", "locked")
    assert_same_network(net.problem, minimum.state, net.truth, with_scale, 1e-3)
    np.testing.assert_allclose(minimum.state.intrinsics[:, :4], net.truth.intrinsics[:, :4], rtol=0, atol=1e-3)


@pytest.mark.parametrize("form", FORMS)
def test_without_noise_it_still_says_converged(form: str) -> None:
    """A cost of rounding errors is as low as it gets; that is no failure to converge."""
    net = small_network(noise_px=0.0, **FORMS[form])  # type: ignore[arg-type]
    assert minimise(net.problem, perturbed(net.problem, net.truth), Settings(max_iterations=200)).converged
    assert minimise(net.problem, net.truth, Settings()).converged


@pytest.mark.parametrize("seed", range(5))
def test_different_starts_end_in_the_same_minimum(seed: int) -> None:
    net = small_network(n_points=40)
    best = minimise(net.problem, net.truth, Settings(max_iterations=200, tolerance=1e-13))
    other = minimise(
        net.problem, perturbed(net.problem, net.truth, 2.0, seed), Settings(max_iterations=200, tolerance=1e-13)
    )
    assert best.converged and other.converged
    assert other.cost == pytest.approx(best.cost, rel=1e-9)
    assert_same_network(net.problem, other.state, best.state, True, 1e-3)


def test_minimum_is_that_of_a_general_solver() -> None:
    """Cameras known, points free: scipy finds the same points from the same equations."""
    net = small_network(locked=(0, 1, 2, 3, 4), intrinsics="fixed", n_points=10, sigma=True, noise_px=0.5)
    minimum = minimise(net.problem, perturbed(net.problem, net.truth), Settings(tolerance=1e-14))

    def residual(x: FloatArray) -> FloatArray:
        return engine.residuals(net.problem, replace(net.truth, points=x.reshape(-1, 3))).ravel()

    best = least_squares(residual, net.truth.points.ravel(), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert minimum.cost == pytest.approx(best.cost, rel=1e-10)
    np.testing.assert_allclose(minimum.state.points, best.x.reshape(-1, 3), atol=1e-5)


def test_far_start_costs_more_steps_and_a_limit_is_kept() -> None:
    net = small_network()
    start = perturbed(net.problem, net.truth, 2.0)
    short = minimise(net.problem, start, Settings(max_iterations=2))
    assert not short.converged
    assert len(short.costs) <= 3
    assert short.costs and short.cost < short.costs[0]


def test_refused_steps_count_whether_it_converged_or_not() -> None:
    """A valley of one unknown, x^2 about 0; every step but the last leads uphill."""

    class Uphill:
        damping, count = Damping(), 1

        def __init__(self, good_after: int) -> None:
            self.good_after, self.steps = good_after, 0

        def linearise(self, _state: float) -> float:
            return 0.0

        def cost(self, state: float, _linear: float) -> float:
            return state**2

        def accepted(self, _state: float, cost: float) -> tuple[None, float]:
            return None, cost

        def step(self, state: float, _linear: float, _damping: float) -> tuple[float, float]:
            self.steps += 1
            return (state + 1.0 if self.steps <= self.good_after else state * (1 - 1e-12)), 1.0

    for good_after, converged in ((5, False), (2, True)):
        ended = levenberg_marquardt(Uphill(good_after), 1.0, Settings(max_iterations=3))  # type: ignore[arg-type]
        assert (ended.converged, ended.iterations) == (converged, 3)


@pytest.mark.usefixtures("either_engine")
def test_every_step_is_reported_and_may_stop_the_work() -> None:
    net = small_network()
    told: list[tuple[int, float]] = []
    start = perturbed(net.problem, net.truth)
    minimum = minimise(net.problem, start, Settings(), lambda i, cost: told.append((i, cost)))
    assert [cost for _, cost in told if cost < minimum.costs[0]][-1] >= minimum.cost
    assert len(told) >= len(minimum.costs) - 1
    assert [i for i, _ in told] == sorted({i for i, _ in told})

    def stop(_iteration: int, _cost: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        minimise(net.problem, start, Settings(), stop)


def test_robust_loss_withstands_wrong_observations() -> None:
    net = small_network(n_points=60)
    rng = np.random.default_rng(0)
    wrong = rng.permutation(len(net.problem.uv))[:8]
    uv = net.problem.uv.copy()
    uv[wrong] += rng.choice([-1, 1], (8, 2)) * rng.uniform(20, 60, (8, 2))
    spoilt = replace(net.problem, uv=uv)
    start = perturbed(net.problem, net.truth, 0.5)
    robust = minimise(spoilt, start, Settings(cauchy=0.2, max_iterations=200)).state
    plain = minimise(spoilt, start, Settings(max_iterations=200)).state
    best = minimise(net.problem, start, Settings(max_iterations=200)).state

    def distance(state: State) -> float:
        datum = fit_similarity(state.points, best.points)
        return float(np.median(np.linalg.norm(datum.apply(state.points) - best.points, axis=1)))

    assert distance(robust) < 0.1 * distance(plain)


@pytest.mark.parametrize("wrong_scale", [0.7, 1.3])
def test_length_rows_fix_the_scale(wrong_scale: float) -> None:
    net = small_network(lengths=6)
    start = perturbed(net.problem, net.truth, 0.2).scaled(wrong_scale)
    minimum = minimise(net.problem, start, Settings(max_iterations=200))
    assert minimum.converged
    assert net.problem.lengths is not None
    residual, _ = length_residuals(net.problem, minimum.state)
    assert np.abs(residual).max() < 6  # of their standard uncertainties
    rows = net.problem.lengths
    found = np.linalg.norm(np.einsum("mk,mki->mi", rows.coefficient, minimum.state.points[rows.points]), axis=1)
    assert (found / net.problem.lengths.length).mean() == pytest.approx(1.0, abs=2e-4)
    # twice the lengths: the same network, twice as large
    double = replace(rows, length=2 * rows.length, covariance=4 * rows.covariance)
    larger = minimise(replace(net.problem, lengths=double), minimum.state.scaled(2.0), Settings(max_iterations=200))
    assert larger.cost == pytest.approx(minimum.cost, rel=1e-6)
    assert_same_network(net.problem, larger.state, minimum.state.scaled(2.0), False, 0.05)


def test_without_lengths_the_scale_stays_where_it_was() -> None:
    net = small_network()
    start = perturbed(net.problem, net.truth, 0.2)
    one, twice = (minimise(net.problem, s, Settings(max_iterations=200)) for s in (start, start.scaled(2.0)))
    assert one.cost == pytest.approx(twice.cost, rel=1e-8)
    ratio = fit_similarity(one.state.points, twice.state.points).scale
    assert ratio == pytest.approx(2.0, rel=0.1)


def test_length_rows_between_shared_points_add_up() -> None:
    """A chain of lengths over common points: each kept point enters once."""
    net = small_network(n_points=40, noise_px=NOISE_PX)
    first, second = np.array([0, 1, 2, 0]), np.array([1, 2, 3, 3])
    true = np.linalg.norm(net.truth.points[second] - net.truth.points[first], axis=1)
    problem = replace(net.problem, lengths=lengths_between(first, second, true, np.full(4, 1e-4)))
    assert problem.kept_points.tolist() == [0, 1, 2, 3]
    minimum = minimise(problem, perturbed(problem, net.truth, 0.3), Settings(max_iterations=200))
    assert minimum.converged
    assert np.abs(length_residuals(problem, minimum.state)[0]).max() < 3


@pytest.mark.usefixtures("either_engine")
@pytest.mark.parametrize("intrinsics", ["own", "shared"])
def test_priors_hold_as_strongly_as_they_say(intrinsics) -> None:
    net = small_network(intrinsics=intrinsics, n_points=60, noise_px=NOISE_PX)
    value = net.truth.intrinsics.copy()
    value[:, 0] += 20.0  # a focal length that the images contradict by 20 px
    start = perturbed(net.problem, net.truth, 0.3)
    focal = []
    for sigma in (1e-3, 1.0, 1e7):
        priors = Priors(value, np.where(np.arange(16) == 0, sigma, np.inf) * np.ones((5, 1)))
        problem = replace(net.problem, priors=priors)
        minimum = minimise(problem, start, Settings(max_iterations=300, tolerance=1e-14))
        assert minimum.converged
        assert len(prior_residuals(problem, minimum.state)[0]) == (1 if intrinsics == "shared" else 5)
        focal.append(minimum.state.intrinsics[:, 0] - net.truth.intrinsics[:, 0])
    np.testing.assert_allclose(focal[0], 20.0, atol=0.01)
    free = minimise(net.problem, start, Settings(max_iterations=300, tolerance=1e-14)).state.intrinsics[:, 0]
    np.testing.assert_allclose(focal[2], free - net.truth.intrinsics[:, 0], atol=0.01)
    assert (np.abs(focal[2]) < 10.0).all()
    assert (focal[1] > focal[2] + 0.1).all()
    assert focal[1].mean() < 20.0


def test_focal_lengths_never_pass_through_zero() -> None:
    """Images turned by 180 degrees: negative focal lengths would explain them perfectly and are no lenses."""
    net = small_network(n_points=40, locked=(0, 1, 2, 3, 4), noise_px=0.0)
    free = net.problem.free_intrinsics & (np.arange(16) < 2)
    turned = 2 * net.truth.intrinsics[net.problem.camera, 2:4] - net.problem.uv
    problem = replace(net.problem, uv=turned, free_intrinsics=free)
    negative = net.truth.intrinsics * np.where(np.arange(16) < 2, -1.0, 1.0)
    perfect = replace(net.truth, intrinsics=negative)
    assert total_cost(problem, perfect, None) < 1e-10
    end = minimise(problem, net.truth, Settings(max_iterations=100))
    assert (end.state.intrinsics[:, :2] > 0).all()
    assert end.cost > 1.0


@pytest.mark.usefixtures("either_engine")
def test_point_without_depth_stops_nothing() -> None:
    """Twice the same ray: a singular point block to the last bit, in the step and in the covariance."""
    net = small_network(n_points=30, locked=(0,))
    state = replace(net.truth, rotation=net.truth.rotation.copy(), translation=net.truth.translation.copy())
    state.rotation[0], state.translation[0] = np.eye(3), 0.0
    points = state.points.copy()
    points[5] = [0.0, 0.0, 512.0]
    first = np.flatnonzero(net.problem.point == 5)[:1]
    keep = (net.problem.point != 5) | np.isin(np.arange(len(net.problem.uv)), first)
    camera = np.where(net.problem.point == 5, 0, net.problem.camera)
    problem = replace(net.problem, camera=camera).select(keep)  # point 5: one view, along the axis of camera 0
    with np.errstate(all="ignore"):
        minimum = minimise(problem, replace(state, points=points), Settings(max_iterations=5))
        assert np.isfinite(minimum.state.intrinsics).all()
        assert covariance(problem, replace(state, points=points)) is None


@pytest.mark.usefixtures("either_engine")
def test_nothing_to_adjust_is_no_success() -> None:
    net = small_network()
    empty = net.problem.select(np.zeros(len(net.problem.uv), dtype=bool))
    minimum = minimise(empty, net.truth, Settings())
    assert not minimum.converged
    assert covariance(empty, net.truth) is None


def test_shared_intrinsics_stay_shared_and_fixed_ones_fixed() -> None:
    for form in ("shared", "partly", "fixed"):
        net = small_network(**FORMS[form])  # type: ignore[arg-type]
        start = perturbed(net.problem, net.truth)
        end = minimise(net.problem, start, Settings(max_iterations=200)).state
        fixed = ~net.problem.free_intrinsics
        np.testing.assert_array_equal(end.intrinsics[fixed], start.intrinsics[fixed])
        for g in np.unique(net.problem.group):
            members = np.flatnonzero((net.problem.group == g) & ~fixed.all(axis=1))
            np.testing.assert_allclose(
                end.intrinsics[members], end.intrinsics[members[:1]].repeat(len(members), 0), atol=1e-9
            )


def as_network(seed: int, noise_px: float = NOISE_PX, **options: object) -> tuple[Network, State, FloatArray]:
    """A free network of full views for the whole adjustment, its truth and perfect image points."""
    net = small_network(noise_px=noise_px, seed=seed, n_points=150, n_cameras=6, **options)  # type: ignore[arg-type]
    p = net.problem
    network = free_network(p.point, p.camera, p.uv, p.n_points, p.free_intrinsics, p.group)
    return network, net.truth, net.perfect_uv


def run(network: Network, start: State) -> Adjustment:
    every, placed = np.ones(len(network.uv), dtype=bool), np.ones(len(network.group), dtype=bool)
    state, used = robust_start(network, start, every, placed, Context())
    return refine(network, state, used, placed, Context())


@pytest.fixture(scope="module")
def adjusted() -> tuple[Network, State, Adjustment]:
    network, truth, _ = as_network(1)
    problem = network.problem(np.ones(len(network.uv), dtype=bool), network.free, np.ones(6, dtype=bool), True)[0]
    return network, truth, run(network, perturbed(problem, truth))


def test_whole_adjustment_reaches_the_noise(adjusted: tuple[Network, State, Adjustment]) -> None:
    network, truth, result = adjusted
    assert result.minimum.converged
    assert result.used.all()
    assert result.redundancy == 2 * len(network.uv) - 3 * 150 - 6 * 15 + 7
    assert result.variance == pytest.approx(NOISE_PX**2, rel=4 * np.sqrt(2 / result.redundancy))
    assert_same_network(result.problem, result.state, truth, True, 10.0)


def test_rows_of_the_final_problem_are_told(adjusted: tuple[Network, State, Adjustment]) -> None:
    network, _, result = adjusted
    np.testing.assert_array_equal(network.uv[result.rows], result.problem.uv)
    np.testing.assert_array_equal(network.camera[result.rows], result.problem.camera)
    assert np.array_equal(np.sort(result.rows), np.flatnonzero(result.used))


def test_gate_takes_out_wrong_observations_and_hardly_any_right_ones() -> None:
    network, truth, _ = as_network(2)
    rng = np.random.default_rng(0)
    wrong = rng.permutation(len(network.uv))[:25]
    uv = network.uv.copy()
    angle = rng.uniform(0, 2 * np.pi, 25)
    uv[wrong] += rng.uniform(2, 60, (25, 1)) * np.column_stack([np.cos(angle), np.sin(angle)])
    spoilt = replace(network, uv=uv)
    problem = network.problem(np.ones(len(uv), dtype=bool), network.free, np.ones(6, dtype=bool), True)[0]
    result = run(spoilt, perturbed(problem, truth, 0.5))
    assert result.minimum.converged
    # what stays although wrong hides in features of few views, along the epipolar lines
    views = np.bincount(network.feature, minlength=150)[network.feature[wrong]]
    assert not result.used[wrong[views >= 4]].any()
    assert result.used[wrong].mean() < 0.2
    right = np.setdiff1d(np.arange(len(uv)), wrong)
    partners = np.isin(network.feature[right], network.feature[wrong])
    assert result.used[right[~partners]].mean() > 0.999
    assert result.variance == pytest.approx(NOISE_PX**2, rel=0.15)


def test_gate_is_wider_for_a_camera_that_is_noisier() -> None:
    network, truth, perfect = as_network(3)
    blurred = network.camera == 2
    uv = np.where(blurred[:, None], perfect + 50 * (network.uv - perfect), network.uv)
    problem = network.problem(np.ones(len(uv), dtype=bool), network.free, np.ones(6, dtype=bool), True)[0]
    result = run(replace(network, uv=uv), perturbed(problem, truth, 0.5))
    assert result.used[blurred].mean() > 0.95
    assert result.used[~blurred].mean() > 0.8


def test_camera_that_lost_all_its_observations_leaves_the_rest_determined(
    adjusted: tuple[Network, State, Adjustment],
) -> None:
    network, _, result = adjusted
    used = network.camera != 2
    used &= (network.views(used) >= 2)[network.feature]
    problem, rows = network.problem(used, network.free, np.ones(6, dtype=bool), weighted=True)
    assert problem.free_pose.tolist() == [c != 2 for c in range(6)]
    assert not problem.free_intrinsics[2].any()
    assert (network.camera[rows] != 2).all()
    found = covariance(problem, result.state)
    assert found is not None
    assert np.isfinite(found.cameras).all()
    assert datum_defect(problem) == 7  # nothing holds the network in its place


def test_residual_size_is_infinite_without_a_point_before_the_camera(
    adjusted: tuple[Network, State, Adjustment],
) -> None:
    network, _, result = adjusted
    state = result.state
    plain = residual_size(network, state)
    assert np.isfinite(plain).all()
    points = state.points.copy()
    points[3] = np.nan
    points[4] = camera_centres(state)[0] - 100 * state.rotation[0, 2]  # behind camera 0
    size = residual_size(network, replace(state, points=points))
    assert np.isinf(size[network.feature == 3]).all()
    assert np.isinf(size[(network.feature == 4) & (network.camera == 0)]).all()
    unplaced = replace(state, translation=np.where(np.arange(6)[:, None] == 5, np.nan, state.translation))
    assert np.isinf(residual_size(network, unplaced)[network.camera == 5]).all()


def test_adjusted_without_redundancy_has_no_variance() -> None:
    net = small_network()
    nothing = Minimum(net.truth, 1.0, 1, True, (1.0,))
    assert np.isnan(Adjustment(net.truth, net.problem, np.arange(0), np.zeros(0, dtype=bool), nothing, 0).variance)
    assert datum_defect(net.problem) == 7


def network_of(camera: list[int], feature: list[int]) -> Network:
    """Cameras that see features somewhere, nothing of their lenses estimated."""
    n, c = len(camera), max(camera) + 1
    sees, whole = np.array(camera), np.array(feature)
    free, each = np.zeros((c, 16), bool), np.ones(c)
    return Network(whole, sees, np.zeros((n, 2)), np.ones((n, 2)), max(feature) + 1, free, np.arange(c), each, each < 0)


def test_of_every_camera_some_observations_are_taken_first() -> None:
    """Also of one that sees only what few others do: the best of all cameras' would be none of its own."""
    network = network_of([0] * 9 + [1] * 9 + [2] * 9 + [2] * 9 + [3] * 9, [*range(9)] * 3 + [*range(9, 18)] * 2)
    taken = best_observations(network, np.ones(45, dtype=bool), 4)
    assert np.bincount(network.camera[taken]).tolist() == [4, 4, 8, 4]
    assert (network.feature[taken & (network.camera < 2)] < 9).all()


def test_a_rational_lens_whose_data_are_known_keeps_what_was_stated_of_it() -> None:
    """The weak prior on denominators is for lenses of which nothing is known beside."""
    network = network_of([0, 1, 2], [0, 0, 0])
    network.free[:2, 9:12] = True
    known = np.tile(np.r_[1500.0, 1500.0, 640.0, 480.0, np.zeros(12)], (3, 1))
    priors = with_intrinsic_priors(network, known, np.array([True, False, False]), 0.5).priors
    assert priors.sigma[0] == pytest.approx(prior_sigmas(known)[0] / 0.5)
    assert (priors.sigma[1, 9:12] == RATIONAL_SD).all()
    assert np.isinf(priors.sigma[1, :9]).all() and np.isinf(priors.sigma[2]).all()
