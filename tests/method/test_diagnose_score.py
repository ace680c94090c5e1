"""Tests of changes that a network does not have: against dense equations, and on noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from spherecal.adjust.bundle import datum_defect
from spherecal.adjust.covariance import covariance
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.diagnose.geometry import smaller_part
from spherecal.diagnose.moves import SURE, alike, confirmed, differ, find_moves, inflation, pose_values, prepare, raised
from spherecal.diagnose.score import Change, ScoreTest, change_of, conditional, field_values, make_score_test, misfits
from spherecal.geometry.camera import project
from spherecal.geometry.rotation import exp_rotation
from tests.method.test_covariance import with_world
from tests.networks import dense_equations, one_thread, small_network

__all__ = ["one_thread"]

CASES: dict[str, dict[str, object]] = {
    "free": {},
    "weights": {"sigma": True},
    "shared": {"intrinsics": "shared"},
    "lengths": {"lengths": 4},
    "one camera locked": {"locked": (2,)},
    "rigid": {"rigid": True},
    "rigid, lengths": {"rigid": True, "lengths": 4},
}


def solved(seed: int = 0, **options: object) -> tuple[ScoreTest, Problem, State]:
    """A small network at its minimum, ready for tests."""
    problem, state, places = with_world(small_network(seed=seed, **options))  # type: ignore[arg-type]
    minimum = minimise(problem, state, Settings(tolerance=1e-14, max_iterations=200))
    cofactors = covariance(problem, minimum.state, places)
    assert cofactors is not None
    redundancy = problem.rows - problem.unknowns + datum_defect(problem)
    return make_score_test(problem, minimum.state, cofactors, minimum.cost, redundancy), problem, minimum.state


@pytest.mark.parametrize("name", CASES)
def test_scores_are_those_of_the_dense_equations(name: str) -> None:
    probe, problem, state = solved(**CASES[name])  # type: ignore[arg-type]
    dense = dense_equations(problem, state)
    jacobian = dense.jacobian / np.maximum(np.linalg.norm(dense.jacobian, axis=0), 1e-30)
    u, s, _ = np.linalg.svd(jacobian, full_matrices=False)
    u = u[:, s > 1e-9 * s[0]]
    rng = np.random.default_rng(1)
    camera = 1
    rows = np.flatnonzero(problem.camera == camera)
    values = np.concatenate(
        [pose_values(probe, rows, rng.random(len(rows)) < 0.5), rng.normal(size=(len(rows), 2, 2))], axis=2
    )
    b = np.zeros((len(u), 8))
    b[(2 * rows[:, None] + np.arange(2)).ravel()] = values.reshape(-1, 8)
    scale = np.linalg.norm(b, axis=0)
    g, a, own = probe.block(rows, values)
    expected = b.T @ b - (u.T @ b).T @ (u.T @ b)
    np.testing.assert_allclose(own, b.T @ b, rtol=1e-9, atol=1e-9 * scale.max() ** 2)
    np.testing.assert_allclose(a / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-6)
    np.testing.assert_allclose(g / scale, b.T @ dense.residual / scale, atol=1e-9)

    of_images = b[: 2 * len(problem.uv)]
    np.testing.assert_allclose(of_images.T @ probe.past_unknowns(of_images), a, atol=1e-9 * scale.max() ** 2)

    # the same with one of them given
    with_seventh = np.concatenate([jacobian, b[:, 6:7] / scale[6]], axis=1)
    full = np.linalg.lstsq(np.concatenate([with_seventh, b / scale], axis=1), dense.residual, rcond=1e-9)[0]
    left = np.linalg.lstsq(with_seventh, dense.residual, rcond=1e-9)[0]
    sizes = [
        float(((dense.residual - m @ x) ** 2).sum())
        for m, x in ((with_seventh, left), (np.concatenate([with_seventh, b / scale], axis=1), full))
    ]
    change = change_of(*conditional(g, a, own, np.array([6])), 1.0)
    assert change.statistic == pytest.approx(sizes[0] - sizes[1], rel=1e-3, abs=1e-4)


def test_a_change_taken_into_the_model_leaves_nothing_of_it() -> None:
    probe, problem, _ = solved(noise_px=0.05)
    rows = np.flatnonzero(problem.camera == 0)
    values = pose_values(probe, rows, np.arange(len(rows)) % 2 == 0)
    change = change_of(*probe.block(rows, values), probe.variance)
    after = probe.after(rows, values, change)
    assert change_of(*after.block(rows, values), 1.0).statistic < 1e-6 * change.statistic
    assert (after.residual**2).sum() == pytest.approx(after.squares, rel=1e-6)
    assert after.redundancy == probe.redundancy - change.dof


def test_statistics_of_noise_are_chi_square() -> None:
    """Over many recordings of noise the test of one change has the distribution that it is judged by."""
    statistics = []
    for seed in range(60):
        probe, problem, _ = solved(seed=seed, rigid=True, n_points=30)
        assert problem.placement is not None
        rows = np.flatnonzero(problem.camera == seed % 5)
        change = change_of(*probe.block(rows, pose_values(probe, rows, problem.placement[rows] == 1)), 0.05**2)
        assert change.dof == 6
        statistics.append(change.statistic)
    assert stats.kstest(statistics, stats.chi2(6).cdf).pvalue > 0.01


def moved_network(camera: int, placements: tuple[int, ...], step: np.ndarray) -> tuple[ScoreTest, Problem]:
    """A small rigid network of which one camera stood elsewhere at some placements."""
    net = small_network(rigid=True, n_points=60, noise_px=0.02, seed=3)
    problem, truth = net.problem, net.truth
    assert problem.placement is not None and truth.placement_rotation is not None
    assert truth.placement_translation is not None
    rows = np.flatnonzero((problem.camera == camera) & np.isin(problem.placement, placements))
    t = problem.placement[rows]
    x = np.einsum("nij,nj->ni", truth.placement_rotation[t], truth.points[problem.point[rows]])
    x = (x + truth.placement_translation[t]) @ truth.rotation[camera].T + truth.translation[camera]
    shifted = x @ exp_rotation(step[:3]).T + step[3:]
    intrinsics = truth.intrinsics[camera]
    uv = problem.uv.copy()
    uv[rows] += project(shifted, intrinsics) - project(x, intrinsics)
    problem, state, places = with_world(replace(net, problem=replace(problem, uv=uv)))
    minimum = minimise(problem, state, Settings(tolerance=1e-14, max_iterations=200))
    cofactors = covariance(problem, minimum.state, places)
    assert cofactors is not None
    redundancy = problem.rows - problem.unknowns + datum_defect(problem)
    return make_score_test(problem, minimum.state, cofactors, minimum.cost, redundancy), problem


def test_a_moved_camera_is_found_with_its_size() -> None:
    step = np.array([0.0, 4e-4, 0.0, 0.4, 0.0, 0.2])
    probe, problem = moved_network(3, (2,), step)
    assert problem.placement is not None
    tests = prepare(probe, problem.placement)
    assert tests is not None
    moves = find_moves(probe, tests)
    assert [(m.camera, m.placements) for m in moves] == [(3, (2,))]
    assert moves[0].dof == 6
    assert confirmed(probe, problem.placement, moves) == moves
    np.testing.assert_allclose(moves[0].step[:3], step[:3], atol=2e-4)
    np.testing.assert_allclose(moves[0].step[3:], step[3:], atol=0.3)


def test_a_move_that_another_form_refutes_takes_with_it_what_that_form_cannot_tell() -> None:
    """A ball that changed feigns moves in the rigid form; a network without any move stands for the free form."""
    step = np.array([0.0, 4e-4, 0.0, 0.4, 0.0, 0.2])
    probe, problem = moved_network(3, (2,), step)
    still, _ = moved_network(3, (2,), np.zeros(6))
    assert problem.placement is not None
    tests = prepare(probe, problem.placement)
    assert tests is not None
    move = find_moves(probe, tests)[0]
    small = replace(move, step=1e-3 * move.step)  # would have a chi-square of 0.001
    assert confirmed(still, problem.placement, [move]) == []
    assert confirmed(still, problem.placement, [small]) == [small]
    assert confirmed(still, problem.placement, [move, small]) == []


def test_two_moved_cameras_are_told_apart() -> None:
    one, _ = moved_network(3, (2,), np.array([0.0, 2e-3, 0.0, 0.0, 0.0, 0.0]))
    first, problem = moved_network(1, (0,), np.array([1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert problem.placement is not None
    both = replace(one, residual=one.residual + first.residual, squares=one.squares + first.squares)
    tests = prepare(both, problem.placement)
    assert tests is not None
    assert {(m.camera, m.placements) for m in find_moves(both, tests)} == {(3, (2,)), (1, (0,))}


def test_sets_that_may_stand_elsewhere_are_no_complements() -> None:
    assert alike(np.array([4])) == []
    assert alike(np.array([4, 7])) == [(7,)]
    for count in (3, 4, 7):
        sets = alike(np.arange(count))
        assert {(k,) for k in range(count)} <= set(sets)
        assert all(any(set(s) in (set(range(k, count)), set(range(k))) for s in sets) for k in range(1, count))
        assert len({frozenset((frozenset(s), frozenset(range(count)) - frozenset(s))) for s in sets}) == len(sets)


def test_structure_over_the_image_is_found_and_noise_is_not() -> None:
    sizes = np.full((5, 2), [1000.0, 800.0])
    probe, problem, _ = solved(n_points=600, noise_px=0.05)
    noise = np.full(5, 0.05)
    assert misfits(probe, sizes, noise, {}) == []
    rows = np.flatnonzero(problem.camera == 2)
    field = field_values(probe, rows, sizes[2])
    column = np.zeros(field.shape[2])
    column[7] = 0.05  # one polynomial of u
    residual = probe.residual.copy()
    residual[(2 * rows[:, None] + np.arange(2)).ravel()] += (field @ column).ravel()
    found = misfits(replace(probe, residual=residual), sizes, noise, {})
    assert max(found, key=lambda misfit: misfit.statistic).camera == 2


def graph(*edges: tuple[int, int]) -> np.ndarray:
    n = max(max(edge) for edge in edges) + 1
    out = np.zeros((n, n), dtype=bool)
    for i, j in edges:
        out[i, j] = out[j, i] = True
    return out


def test_threads_of_a_graph() -> None:
    def parts(*edges: tuple[int, int]) -> dict[int, list[int]]:
        edge = graph(*edges)
        every = np.arange(len(edge))
        return {i: part for i in every.tolist() if (part := smaller_part(edge, np.delete(every, i)))}

    assert parts((0, 1), (1, 2), (2, 3), (3, 0)) == {}
    assert parts((0, 1), (1, 2), (2, 0), (2, 3), (3, 4), (4, 2)) == {2: [0, 1]}
    assert parts((0, 1), (1, 2)) == {1: [0]}
    # what one pair of cameras connects is connected by each of the two alone, by one where the other is the whole part
    assert parts((0, 1), (1, 2), (2, 0), (2, 3), (3, 4), (4, 5), (5, 3)) == {2: [0, 1], 3: [4, 5]}
    assert parts((0, 1), (1, 2), (2, 0), (2, 3)) == {2: [3]}


def test_noise_alone_inflates_nothing() -> None:
    rng = np.random.default_rng(5)
    found = [inflation((rng.chisquare(12), 12), [(rng.chisquare(18), 18) for _ in range(9)]) for _ in range(400)]
    assert np.mean(np.array(found) == 1.0) > 0.85
    assert np.quantile(found, 0.99) < 1.5


def test_inflation_is_that_of_the_camera_or_of_the_others() -> None:
    assert inflation((120.0, 12), [(18.0, 18)] * 9) == pytest.approx(120 / stats.chi2.isf(SURE, 12))
    assert 8.0 < inflation((12.0, 12), [(180.0, 18)] * 9) < 10.0
    assert inflation((12.0, 12), [(180.0, 18), *[(18.0, 18)] * 9]) == 1.0  # one that moved says nothing of the others
    assert inflation((0.0, 0), []) == 1.0
    assert raised(30.0, 1.0) == 30.0
    assert raised(30.0, 2.0) > 2 * raised(30.0, 1.0)


def test_images_that_all_differ_are_no_move() -> None:
    """Every image has an offset of its own, as lenses beyond the model give it; the same offset in one is a move."""
    probe, problem = moved_network(3, (2,), np.zeros(6))
    placement = problem.placement
    assert placement is not None
    step, rng = np.array([0.0, 4e-4, 0.0, 0.4, 0.0, 0.2]), np.random.default_rng(4)
    images = [(c, t) for c in range(problem.n_cameras) for t in range(problem.n_placements)]
    scattered = {image: np.roll(step, 3 * rng.integers(2)) * rng.choice([-1, 1], 6) for image in images}

    def shifted(steps: dict[tuple[int, int], np.ndarray]) -> ScoreTest:
        out = probe
        for (c, t), value in steps.items():
            rows = np.flatnonzero(problem.camera == c)
            out = out.after(rows, pose_values(out, rows, placement[rows] == t), Change(0.0, 0, value))
        return replace(out, squares=float((out.residual**2).sum()))

    for steps, expected in (({(3, 2): step}, [(3, (2,))]), (scattered, [])):
        spoilt = shifted(steps)
        tests = prepare(spoilt, placement)
        assert tests is not None and differ(spoilt, tests)
        assert [(m.camera, m.placements) for m in find_moves(spoilt, tests)] == expected
