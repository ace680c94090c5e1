"""The soft form: a ball with some play, against the same equations with every play as an unknown of its own."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable, Free, as_rigid
from spherecal.adjust.covariance import covariance
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.datum import Places, datum_motions
from spherecal.adjust.least_squares import NormalEquations, minimise, normal_equations
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.geometry.camera import project
from spherecal.geometry.transform import fit_similarity
from tests.method.test_covariance import (
    TRIAL_PX,
    TRIALS,
    Trial,
    Whole,
    assert_matrices_agree,
    assert_stated_is_found,
    places_of,
    whole_by_brute_force,
    with_world,
)
from tests.networks import dense_equations, one_thread, small_network

__all__ = ["one_thread"]

PLAY_MM = 0.3  # as large as what an image point's noise of 0.05 px is in space, so that both count
CASES: dict[str, dict[str, object]] = {
    "plain": {},
    "shared": {"intrinsics": "shared"},
    "partly": {"intrinsics": "partly", "n_cameras": 6},
    "weights": {"sigma": True},
    "priors": {"priors": True},
    "lengths": {"lengths": 4},
    "two cameras locked": {"locked": (0, 3)},
    "one locked, lengths": {"locked": (2,), "lengths": 3},
}


def soft_network(name: str, noise_px: float = 0.05, n_points: int = 24) -> tuple[Problem, State, Places]:
    """A small rigid network with play of all dots but those of length rows, its true state and its places."""
    net = small_network(rigid=True, noise_px=noise_px, n_points=n_points, **CASES[name])  # type: ignore[arg-type]
    problem, state, places = with_world(net)
    assert places is not None and problem.placement is not None
    shape_sd = np.where(np.isin(places.point, problem.kept_points), 0.0, PLAY_MM)
    place = problem.placement * problem.n_points + problem.point
    order = np.lexsort((problem.camera, place, problem.point))
    ball = Deformable(problem.placement, problem.ball.free_placement, place, shape_sd)
    return replace(problem, ball=ball).select(order), state, places


def equations(problem: Problem, state: State) -> NormalEquations:
    """The reduced normal equations, undamped."""
    return normal_equations(problem, state, engine.linear_model(problem, state, None), 0.0)


def with_ties(problem: Problem, state: State) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Jacobian and residuals with one play (3 columns) for every feature and its tie; the first of these columns."""
    dense = dense_equations(problem, state)
    linear = engine.linearise(problem, state, None)
    jacobian = dense.jacobian.copy()
    first_pose = dense.reduced - POSE * problem.n_placements - 3 * len(problem.kept_points)
    jacobian[:, first_pose : first_pose + POSE] = 0.0  # the world's own pose is none
    count, before = len(problem.ball.shape_sd), jacobian.shape[1]
    wide = np.zeros((len(jacobian) + 3 * count, before + 3 * count))
    wide[: len(jacobian), :before] = jacobian
    for k, place in enumerate(problem.ball.place):
        if problem.ball.shape_sd[place] > 0:
            own = before + 3 * place
            wide[2 * k : 2 * k + 2, own : own + 3] = linear.by_placement[k, :, 3:]
    tied = np.repeat(problem.ball.shape_sd > 0, 3)
    sd = np.repeat(problem.ball.shape_sd, 3)[tied]
    wide[len(jacobian) + np.flatnonzero(tied), before + np.flatnonzero(tied)] = 1 / sd
    right = np.concatenate([dense.residual, np.zeros(3 * count)])
    return wide, right, np.array([before, dense.reduced])


@dataclass(frozen=True)
class Case:
    problem: Problem
    state: State
    places: Places
    whole: Whole
    found: Covariance


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    problem, state, places = soft_network(request.param, noise_px=0.0)
    found = covariance(problem, state, places)
    assert found is not None
    rigid = whole_by_brute_force(problem, state, places)
    jacobian, _, columns = with_ties(problem, state)
    before, more = columns[0], jacobian.shape[1] - columns[0]
    by_unknown = np.concatenate([rigid.by_unknown, np.eye(more).reshape(-1, 3, more)], axis=2)
    motions = np.vstack([rigid.motions, np.zeros((more, rigid.motions.shape[1]))])
    conditions = np.einsum("fiu,fig->ug", by_unknown, rigid.moved)
    unseen = motions.shape[1] - (problem.has_lengths and motions.shape[1] > 0)
    used = np.flatnonzero(np.abs(jacobian).max(axis=0) > 0)
    unit = 1 / np.linalg.norm(jacobian[:, used], axis=0)
    scaled = jacobian[:, used] * unit
    # any generalised inverse will do before the S-transformation: the null space is added and taken off
    null = np.linalg.qr(motions[used][:, :unseen] / unit[:, None])[0]
    inverse = (np.linalg.inv(scaled.T @ scaled + null @ null.T) - null @ null.T) * unit * unit[:, None]
    every = np.zeros((jacobian.shape[1],) * 2)
    every[np.ix_(used, used)] = inverse
    taken = np.eye(len(every))
    if motions.shape[1]:
        taken -= motions @ np.linalg.inv(conditions.T @ motions) @ conditions.T
    expanded = np.hstack([rigid.expanded, np.zeros((len(rigid.expanded), more))])
    assert before == rigid.expanded.shape[1]
    whole = Whole(
        problem, state, places, expanded, by_unknown, jacobian, every, taken @ every @ taken.T, motions, rigid.moved
    )
    return Case(problem, state, places, whole, found)


def test_cameras_are_those_of_the_whole_system(case: Case) -> None:
    assert_matrices_agree(case.found.all_cameras(), case.whole.cameras())


def test_places_are_those_of_the_whole_system(case: Case) -> None:
    expected = case.whole.of_places()
    for f, block in enumerate(case.found.points):
        own = slice(3 * f, 3 * f + 3)
        assert_matrices_agree(block, expected[own, own])


def test_functions_of_places_have_all_correlations(case: Case) -> None:
    rng, block = np.random.default_rng(0), case.whole.of_places()
    sd = np.sqrt(np.maximum(case.whole.cameras().diagonal(), 0.0))
    for count in (2, 2, len(case.found.points)):
        gradient = rng.normal(size=case.found.points.shape[:2])
        gradient[rng.permutation(len(gradient))[count:]] = 0.0
        flat = gradient.ravel()
        assert case.found.functional(gradient) == pytest.approx(flat @ block @ flat, rel=1e-6)
        by_unknown = np.einsum("fi,fiu->u", gradient, case.whole.by_unknown)
        expected = case.whole.expanded @ case.whole.cofactors @ by_unknown
        size = sd * np.sqrt(flat @ block @ flat)
        assert (np.abs(case.found.cameras_with(gradient) - expected) <= 1e-6 * size + 1e-9 * size.max()).all()


def test_size_is_known_only_by_lengths(case: Case) -> None:
    if not case.problem.has_lengths:
        assert case.found.stretch is None
        return
    flat = case.whole.moved.reshape(-1, case.whole.moved.shape[2])
    fitted = np.linalg.lstsq(flat, case.whole.by_unknown.reshape(len(flat), -1), rcond=None)[0][-1]
    assert case.found.stretch == pytest.approx(fitted @ case.whole.open @ fitted, rel=1e-6)


def test_point_noise_is_that_with_known_cameras_and_placements(case: Case) -> None:
    """Of one dot: its images and ties alone."""
    problem, places = case.problem, case.places
    before = case.whole.jacobian.shape[1] - 3 * len(places.point)
    for f in (0, 11, 40):
        if places.point[f] in problem.kept_points:
            continue
        same = np.flatnonzero(places.point == places.point[f])
        own = np.flatnonzero(np.abs(case.whole.by_unknown[same[0]][:, :before]).max(axis=0) > 0)[-3:]
        columns = np.concatenate([own, (before + 3 * same[:, None] + np.arange(3)).ravel()])
        noise = np.linalg.inv(case.whole.jacobian[:, columns].T @ case.whole.jacobian[:, columns])
        through = case.whole.by_unknown[f][:, columns]
        assert_matrices_agree(case.found.own_noise[f], through @ noise @ through.T)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.usefixtures("either_engine")
def test_normal_equations_are_those_of_the_whole_system(name: str) -> None:
    problem, state, _ = soft_network(name)
    normal = equations(problem, state)
    jacobian, residual, (_, reduced) = with_ties(problem, state)
    used = np.abs(jacobian).max(axis=0) > 0
    kept = used.copy()
    kept[reduced:] = False
    rest = used & ~kept
    n, g = jacobian.T @ jacobian, jacobian.T @ residual
    carry = np.linalg.solve(n[np.ix_(rest, rest)], n[np.ix_(rest, kept)]).T
    expected = n[np.ix_(kept, kept)] - carry @ n[np.ix_(rest, kept)]
    unit = 1 / np.sqrt(normal.matrix.diagonal())
    found = (np.triu(normal.matrix) + np.triu(normal.matrix, 1).T) * unit * unit[:, None]
    np.testing.assert_allclose(found, expected * unit * unit[:, None], rtol=0, atol=1e-8)
    slope = g[kept] - carry @ g[rest]
    np.testing.assert_allclose(normal.gradient * unit, slope * unit, rtol=0, atol=1e-6 * np.abs(slope * unit).max())


def bent(problem: Problem, state: State, play_mm: float, seed: int) -> Problem:
    """The problem observed again with dots off the shape and image noise of one sigma."""
    rng = np.random.default_rng(seed)
    off = play_mm * rng.normal(size=(len(problem.ball.shape_sd), 3)) * (problem.ball.shape_sd > 0)[:, None]
    x = np.einsum("nij,nj->ni", state.placement_rotation[problem.placement], state.points[problem.point])
    x += state.placement_translation[problem.placement] + off[problem.ball.place]
    as_points = state.free(x)
    one_each = replace(problem, point=np.arange(len(x)), ball=Free(), n_points=len(x), uv=np.zeros_like(problem.uv))
    seen = engine.residuals(one_each, as_points) / problem.weight
    noise = np.empty_like(seen)
    noise[np.lexsort((problem.placement, problem.camera, problem.point))] = rng.normal(size=seen.shape)
    return replace(problem, uv=seen + noise / problem.weight)


def test_minimum_is_that_of_all_unknowns_and_keeps_the_size() -> None:
    """Converged where no step of the whole system lowers its cost, the network as large as it was."""
    problem, state, _ = soft_network("weights", n_points=60)
    problem = bent(problem, state, PLAY_MM, 1)
    found = minimise(problem, state, Settings())
    assert found.converged
    assert (
        found.state.shape_residual is not None and problem.ball.shape_sd is not None and problem.ball.place is not None
    )
    jacobian, residual, (before, _) = with_ties(problem, found.state)
    shape_residual = found.state.shape_residual
    at = np.concatenate([np.zeros(before), shape_residual.ravel()])
    gradient = jacobian.T @ (residual + jacobian @ at)
    unit = np.linalg.norm(jacobian, axis=0)
    assert np.abs(gradient[unit > 0] / unit[unit > 0]).max() < 1e-3 * np.sqrt(2 * found.cost)
    assert found.cost == pytest.approx(0.5 * float(((residual + jacobian @ at) ** 2).sum()), rel=1e-9)
    size = fit_similarity(state.points, found.state.points).scale
    assert abs(size - 1) < 2e-4  # ties of absolute size, as weak rows in the cost, shrink it by percents


def test_play_is_found_again_and_the_cost_is_as_expected() -> None:
    problem, state, places = soft_network("weights", n_points=80)
    found = minimise(bent(problem, state, PLAY_MM, 2), state, Settings())
    redundancy = problem.rows - problem.unknowns + 7
    assert 2 * found.cost / redundancy == pytest.approx(1.0, abs=4 * np.sqrt(2 / redundancy))
    rigid = minimise(replace(bent(problem, state, PLAY_MM, 2), ball=as_rigid(problem.ball)), state, Settings())
    assert rigid.cost > 1.5 * found.cost
    assert len(places.point) == len(found.state.shape_residual)  # type: ignore[arg-type]


def test_no_play_is_the_rigid_form() -> None:
    problem, state, places = soft_network("plain")
    assert isinstance(problem.ball, Deformable)
    stiff = replace(problem, ball=replace(problem.ball, shape_sd=np.zeros(len(places.point))))
    plain = replace(problem, ball=as_rigid(problem.ball))
    one, other = minimise(stiff, state, Settings()), minimise(plain, state, Settings())
    assert one.cost == pytest.approx(other.cost, rel=1e-9)
    np.testing.assert_allclose(one.state.intrinsics, other.state.intrinsics, rtol=1e-5, atol=1e-6)
    soft, rigid = covariance(stiff, state, places), covariance(plain, state, places)
    assert soft is not None and rigid is not None
    assert_matrices_agree(soft.all_cameras(), rigid.all_cameras())
    np.testing.assert_allclose(soft.points, rigid.points, rtol=1e-6, atol=1e-12)


def test_dots_seen_by_nobody_have_no_places() -> None:
    problem, state, places = soft_network("plain", n_points=30)
    problem = problem.select(problem.point != 4)
    state = replace(state, points=np.where(np.arange(30)[:, None] == 4, np.nan, state.points))
    found = covariance(problem, state, places)
    assert found is not None
    assert (np.isnan(found.points[:, 0, 0]) == (places.point == 4)).all()
    assert np.isfinite(found.cameras).all()


def test_a_place_that_no_camera_sees_is_where_the_shape_puts_it() -> None:
    """Its play is then only known by its standard deviation."""
    problem, state, places = soft_network("plain", n_points=30)
    assert problem.ball.place is not None
    there = covariance(problem, state, places)
    problem = problem.select(problem.ball.place != 5)
    found = covariance(problem, state, places)
    assert found is not None and there is not None
    assert found.points[5].trace() > 3 * PLAY_MM**2
    assert found.points[5].trace() > 2 * there.points[5].trace()


def test_datum_takes_back_what_no_observation_sees() -> None:
    problem, state, places = soft_network("plain")
    jacobian, _, (before, _) = with_ties(problem, state)
    motions = datum_motions(problem, state, places)
    assert motions.unseen.sum() == 7
    normal = equations(problem, state)
    full = np.triu(normal.matrix) + np.triu(normal.matrix, 1).T
    column = problem.layout.column
    gauge = np.zeros((len(full), 7))
    gauge[column[column >= 0]] = motions.columns[column >= 0]
    assert np.abs(full @ gauge).max() < 1e-7 * np.abs(full).max() * np.abs(gauge).max()
    assert before < jacobian.shape[1]


def test_places_that_a_camera_shows_twice_count_twice() -> None:
    """Their columns were opened twice: the compiled code wrote beyond its arrays, and the process died."""
    problem, state, _ = soft_network("plain")
    once = equations(replace(problem, weight=problem.weight * np.sqrt(2)), state)
    every = np.repeat(np.arange(len(problem.uv)), 2)
    assert problem.placement is not None
    assert problem.ball.place is not None
    double = replace(
        problem,
        camera=problem.camera[every],
        point=problem.point[every],
        uv=problem.uv[every],
        weight=problem.weight[every],
        ball=problem.ball.select(every),
    )
    twice = equations(double, state)
    unit = 1 / np.sqrt(once.diagonal)
    np.testing.assert_allclose(
        np.triu(twice.matrix) * unit * unit[:, None], np.triu(once.matrix) * unit * unit[:, None], atol=1e-9
    )
    np.testing.assert_allclose(
        twice.gradient * unit, once.gradient * unit, atol=1e-9 * np.abs(once.gradient * unit).max()
    )


def test_stated_uncertainties_are_those_of_repeated_trials() -> None:
    """200 times new noise and new play of every dot, both as large as stated."""
    problem, truth, places = soft_network("plain", noise_px=0.0)
    still, shape_sd = places_of(truth, places), problem.ball.shape_sd[:, None] * TRIAL_PX
    rng, trials = np.random.default_rng(0), []
    for _ in range(TRIALS):
        at = still + shape_sd * rng.normal(size=still.shape)
        x = np.einsum("nij,nj->ni", truth.rotation[problem.camera], at[problem.ball.place])
        uv = project(x + truth.translation[problem.camera], truth.intrinsics[problem.camera])
        noisy = replace(problem, uv=uv + rng.normal(0, TRIAL_PX, uv.shape))
        trials.append(Trial(minimise(noisy, truth, Settings()), at))
    assert_stated_is_found(problem, truth, places, trials)
