"""What large rigs are worked on with: the same numbers as small ones get, by other ways."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from spherecal.adjust import dense_elimination, point_factors
from spherecal.adjust import engine as compiled
from spherecal.adjust.covariance import covariance
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Settings
from spherecal.base import arrays
from spherecal.initialise import view_graph as graph
from spherecal.initialise.triple import Triple
from tests import reference_engine as reference
from tests.method.test_covariance import with_world
from tests.networks import one_thread, small_network

__all__ = ["one_thread"]

CASES: dict[str, dict[str, object]] = {
    "plain": {},
    "shared": {"intrinsics": "shared"},
    "weights": {"sigma": True},
    "lengths": {"lengths": 4},
    "locked": {"locked": (0, 3)},
}


@pytest.mark.parametrize("name", CASES)
def test_dense_elimination_is_that_by_runs(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    net = small_network(rigid=True, n_points=30, **CASES[name])  # type: ignore[arg-type]
    problem = net.problem.select(net.problem.point != 4)  # one dot that nobody sees
    linear = reference.linearise(problem, net.truth, None)
    expected = reference.reduce(problem, linear, 1e-3)
    monkeypatch.setattr(dense_elimination, "LEAST_COLUMNS", 0)
    monkeypatch.setattr(dense_elimination, "_CHUNK", 7)
    assert dense_elimination.is_dense(problem)
    found = compiled.reduce(problem, linear, 1e-3)
    unit = 1 / np.sqrt(expected.diagonal)
    np.testing.assert_allclose(
        np.triu(found.matrix) * unit * unit[:, None],
        np.triu(expected.matrix) * unit * unit[:, None],
        rtol=0,
        atol=1e-11,
    )
    np.testing.assert_allclose(found.gradient * unit, expected.gradient * unit, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.diagonal, expected.diagonal, rtol=1e-12)
    np.testing.assert_allclose(found.point_inverse, expected.point_inverse, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.point_gradient, expected.point_gradient, rtol=1e-9, atol=1e-9)


def test_the_minimum_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    net = small_network(rigid=True)
    usual = minimise(net.problem, net.truth, Settings())
    monkeypatch.setattr(dense_elimination, "LEAST_COLUMNS", 0)
    dense = minimise(net.problem, net.truth, Settings(first_damping=1e-8))
    assert dense.cost == pytest.approx(usual.cost, rel=1e-10)
    np.testing.assert_allclose(dense.state.intrinsics, usual.state.intrinsics, rtol=1e-5, atol=1e-6)


def test_a_singular_dot_is_seen_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rays to the same place in the same direction: no finite step, and no exception."""
    net = small_network(rigid=True)
    monkeypatch.setattr(dense_elimination, "LEAST_COLUMNS", 0)
    first = np.flatnonzero(net.problem.point == 0)[1:]
    problem = net.problem.select(~np.isin(np.arange(len(net.problem.point)), first))
    linear = compiled.linearise(problem, net.truth, None)
    reduced = compiled.reduce(problem, linear, 0.0)  # two rows for three coordinates
    assert not np.isfinite(reduced.matrix).all() or np.abs(reduced.matrix).max() > 1e3


@pytest.mark.parametrize("rigid", [False, True])
def test_many_observations_are_worked_on_by_parts(rigid: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, state, places = with_world(small_network(rigid=rigid, n_points=30))
    whole = covariance(problem, state, places)
    monkeypatch.setattr(arrays, "ROWS_AT_ONCE", 17)
    monkeypatch.setattr(point_factors, "_MOST_KEPT", 20)
    parts = covariance(problem, state, places)
    assert whole is not None and parts is not None
    np.testing.assert_allclose(parts.cameras, whole.cameras, rtol=1e-9, atol=1e-12 * np.abs(whole.cameras).max())
    np.testing.assert_allclose(parts.points, whole.points, rtol=1e-9, atol=1e-12 * np.abs(whole.points).max())
    gradient = np.random.default_rng(0).normal(size=(len(whole.points), 3))
    assert parts.functional(gradient) == pytest.approx(whole.functional(gradient), rel=1e-9)
    np.testing.assert_allclose(parts.cameras_with(gradient), whole.cameras_with(gradient), rtol=1e-6, atol=1e-12)


def test_common_scales_are_those_of_the_equations_written_out() -> None:
    """Triples of two parts of a rig that share no edge, each in a size of its own, one of them a blunder."""
    rng = np.random.default_rng(0)
    centres, triples = rng.normal(size=(12, 3)), []
    for first in (0, 6):
        for cameras in combinations(range(first, first + 6), 3):
            size = float(np.exp(rng.normal()))
            place = centres[list(cameras)] * size * (1 + 0.01 * rng.normal(size=(3, 1)))
            turn, nothing = np.tile(np.eye(3), (3, 1, 1)), np.zeros((0, 3))
            triples.append(Triple(cameras, turn, -place, np.zeros(0, dtype=np.int64), nothing, np.ones(3)))
    triples[3] = replace(triples[3], translation=triples[3].translation * [[1.0], [3.0], [1.0]])
    pairs = [(n, pair) for n, t in enumerate(triples) for pair in combinations(range(3), 2)]
    names = [tuple(triples[n].cameras[c] for c in pair) for n, pair in pairs]
    edges = sorted(set(names))
    base = np.log([triples[n].baseline(*pair) for n, pair in pairs])
    rows = np.zeros((len(pairs), len(triples) + len(edges)))  # scale + base - length of an edge
    rows[np.arange(len(pairs)), [n for n, _ in pairs]] = 1.0
    rows[np.arange(len(pairs)), [len(triples) + edges.index(name) for name in names]] = -1.0
    root, found = np.ones(len(pairs)), np.zeros(rows.shape[1])
    for _ in range(10):
        found = np.linalg.lstsq(rows * root[:, None], -base * root, rcond=1e-12)[0]
        root = np.maximum(np.abs(base + rows @ found), 1e-3) ** -0.5
    expected = found[: len(triples)].reshape(2, -1)  # of the two parts
    expected = np.exp(expected - expected.mean(axis=1, keepdims=True)).ravel()
    np.testing.assert_allclose(graph.common_scales(triples), expected, rtol=1e-8)
