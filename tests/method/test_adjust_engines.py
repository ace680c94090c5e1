"""Both engines of the adjustment: equal to each other and to the normal equations written out in full."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

from spherecal.adjust import engine as compiled
from spherecal.adjust.bundle import datum_defect
from spherecal.adjust.least_squares import assembled, minimise
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.parameter_layout import symmetric
from spherecal.adjust.problem import moved
from spherecal.base.arrays import FloatArray
from tests import reference_engine as reference
from tests.networks import Small, dense_equations, one_thread, perturbed, small_network

__all__ = ["one_thread"]

CASES: dict[str, dict[str, object]] = {
    "own": {},
    "shared": {"intrinsics": "shared"},
    "partly": {"intrinsics": "partly", "n_cameras": 6},
    "all 16": {"intrinsics": "all", "n_points": 40},
    "fixed": {"intrinsics": "fixed"},
    "locked": {"locked": (0, 3)},
    "all locked": {"locked": (0, 1, 2, 3, 4), "intrinsics": "fixed"},
    "priors": {"priors": True},
    "shared priors": {"priors": True, "intrinsics": "shared"},
    "lengths": {"lengths": 5},
    "weights": {"sigma": True},
    "all at once": {
        "intrinsics": "partly", "locked": (1,), "lengths": 4, "priors": True, "sigma": True, "n_cameras": 6,
    },
    "fisheye and others": {"fisheye": (1, 4), "lengths": 3},
    "fisheye, shared": {"fisheye": (0, 1, 2, 3, 4), "intrinsics": "shared"},
    "rigid": {"rigid": True},
    "rigid, fisheye": {"rigid": True, "fisheye": (0, 2), "intrinsics": "partly", "n_cameras": 6},
    "rigid, shared, locked": {"rigid": True, "intrinsics": "shared", "locked": (2,)},
    "rigid, all at once": {
        "rigid": True, "intrinsics": "partly", "locked": (1,), "lengths": 4, "priors": True, "sigma": True,
        "n_cameras": 6,
    },
}  # fmt: skip
ENGINES = [reference, compiled]
ENGINE_NAMES = ["reference", "compiled"]


@pytest.fixture(params=CASES, ids=lambda name: name.replace(" ", "-"))
def net(request: pytest.FixtureRequest) -> Small:
    return small_network(**CASES[request.param])  # type: ignore[arg-type]


@pytest.fixture(params=[False, True], ids=["plain", "robust"])
def weight(request: pytest.FixtureRequest, net: Small) -> FloatArray | None:
    return np.random.default_rng(9).uniform(0.1, 1.0, len(net.problem.uv)) if request.param else None


def assert_close(one: np.ndarray | None, other: np.ndarray | None, what: str) -> None:
    """Equal to 1e-9 of the largest element."""
    if one is None or other is None:
        assert one is other
        return
    assert one.shape == other.shape
    np.testing.assert_allclose(
        one, other, rtol=0, atol=1e-9 * max(np.abs(other).max(initial=0.0), 1e-300), err_msg=what
    )


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_engines_are_equal(net: Small, weight: FloatArray | None, damping: float) -> None:
    problem, state = net.problem, perturbed(net.problem, net.truth, 0.3)
    layout = problem.layout
    assert_close(compiled.residuals(problem, state), reference.residuals(problem, state), "residuals")
    a, b = (engine.linearise(problem, state, weight) for engine in (compiled, reference))
    for name in ("residual", "by_camera", "by_point", "by_placement"):
        assert_close(getattr(a, name), getattr(b, name), name)
    # the same linearisation to both, so that each stage answers for itself
    p, q = (engine.reduce(problem, b, damping) for engine in (compiled, reference))
    unit = 1 / np.sqrt(np.maximum(layout.fold_vector(q.diagonal), 1e-300))
    assert_close(
        symmetric(layout.fold_matrix(p.matrix)) * unit * unit[:, None],
        symmetric(layout.fold_matrix(q.matrix)) * unit * unit[:, None],
        "matrix",
    )
    assert_close(layout.fold_vector(p.gradient) * unit, layout.fold_vector(q.gradient) * unit, "gradient")
    assert_close(p.point_inverse, q.point_inverse, "point_inverse")
    assert_close(p.point_gradient, q.point_gradient, "point_gradient")
    np.testing.assert_allclose(layout.fold_vector(p.diagonal), layout.fold_vector(q.diagonal), rtol=1e-9)
    step = layout.expanded_rows(np.random.default_rng(3).normal(size=layout.size) * unit)
    (one, cost), (other, other_cost) = (engine.back_substitute(problem, b, q, step) for engine in ENGINES)
    assert_close(one, other, "point step")
    assert cost == pytest.approx(other_cost, rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_reduced_system_is_that_of_the_full_normal_equations(
    net: Small, weight: FloatArray | None, engine: ModuleType, damping: float
) -> None:
    problem, state = net.problem, perturbed(net.problem, net.truth, 0.3)
    full = dense_equations(problem, state, weight)
    d = full.reduced
    assert d == problem.layout.size
    n, g = full.jacobian.T @ full.jacobian, full.jacobian.T @ full.residual
    v = n[d:, d:] + damping * np.diag(n.diagonal()[d:])
    schur = n[:d, :d] - n[:d, d:] @ np.linalg.solve(v, n[d:, :d])
    gradient = g[:d] - n[:d, d:] @ np.linalg.solve(v, g[d:])
    linear = engine.linearise(problem, state, weight)
    normal = assembled(problem, state, engine.reduce(problem, linear, damping))
    unit = 1 / np.sqrt(np.maximum(n.diagonal()[:d], 1e-300))
    assert_close(symmetric(normal.matrix) * unit * unit[:, None], schur * unit * unit[:, None], "matrix")
    assert_close(normal.gradient * unit, gradient * unit, "gradient")
    np.testing.assert_allclose(normal.diagonal, n.diagonal()[:d], rtol=1e-9)
    # a step of the reduced unknowns determines the points: the full equations' second block row
    step = np.random.default_rng(3).normal(size=d) * unit
    point_step, cost = engine.back_substitute(problem, linear, normal.reduced, problem.layout.expanded_rows(step))
    expected = -np.linalg.solve(v, g[d:] + n[d:, :d] @ step)
    rest = np.setdiff1d(np.arange(problem.n_points), problem.kept_points)
    assert_close(point_step[rest], expected.reshape(-1, 3), "point step")
    assert (point_step[problem.kept_points] == 0).all()
    rows = 2 * len(problem.uv)  # the engine's cost is that of the image points
    after = full.residual[:rows] + full.jacobian[:rows] @ np.r_[step, expected]
    assert cost == pytest.approx(0.5 * (after**2).sum(), rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
def test_gauss_newton_step_is_that_of_the_full_equations(net: Small, engine: ModuleType) -> None:
    problem, state = net.problem, perturbed(net.problem, net.truth, 0.1)
    full = dense_equations(problem, state)
    n = full.jacobian.T @ full.jacobian
    damping = 1e-3 * np.diag(n.diagonal())
    expected = -np.linalg.solve(n + damping, full.jacobian.T @ full.residual)
    linear = engine.linearise(problem, state, None)
    normal = assembled(problem, state, engine.reduce(problem, linear, 1e-3))
    matrix = symmetric(normal.matrix) + 1e-3 * np.diag(normal.diagonal)
    step = np.asarray(-np.linalg.solve(matrix, normal.gradient), np.float64)
    point_step, _ = engine.back_substitute(problem, linear, normal.reduced, problem.layout.expanded_rows(step))
    rest = np.setdiff1d(np.arange(problem.n_points), problem.kept_points)
    found = np.r_[step, point_step[rest].ravel()]
    unit = np.sqrt(n.diagonal())
    assert_close(found * unit, expected * unit, "step")


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
@pytest.mark.parametrize("rigid", [False, True], ids=["free", "rigid"])
def test_points_that_nobody_sees_take_no_part(engine: ModuleType, rigid: bool) -> None:
    net = small_network(rigid=rigid)
    problem = net.problem.select(net.problem.point % 5 != 2)
    linear = engine.linearise(problem, net.truth, None)
    reduced = engine.reduce(problem, linear, 1e-3)
    unseen = np.arange(problem.n_points) % 5 == 2
    assert np.isfinite(reduced.matrix).all()
    assert (reduced.point_inverse[unseen] == 0).all()
    step = problem.layout.expanded_rows(np.full(problem.layout.size, 1e-3))
    point_step, cost = engine.back_substitute(problem, linear, reduced, step)
    assert (point_step[unseen] == 0).all()
    assert np.isfinite(point_step).all() and np.isfinite(cost)


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
def test_cameras_that_see_nothing_take_no_part(engine: ModuleType) -> None:
    net = small_network()
    problem = net.problem.select(net.problem.camera != 2)
    free_pose = problem.free_pose & (np.arange(5) != 2)
    problem = replace(problem, free_pose=free_pose, free_intrinsics=problem.free_intrinsics & free_pose[:, None])
    assert problem.layout.size == 4 * 15
    normal = assembled(problem, net.truth, engine.reduce(problem, engine.linearise(problem, net.truth, None), 1e-3))
    assert np.isfinite(symmetric(normal.matrix)).all()
    assert np.isfinite(normal.gradient).all()
    assert (normal.diagonal > 0).all()


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
def test_wild_values_stay_visible(engine: ModuleType) -> None:
    """A point in the plane of a camera must not pass for a good one."""
    net = small_network()
    points = net.truth.points.copy()
    points[0] = net.truth.rotation[0].T @ ([100.0, 50.0, 0.0] - net.truth.translation[0])
    state = replace(net.truth, points=points)
    with np.errstate(all="ignore"):
        residual = engine.residuals(net.problem, state)
    own = (net.problem.point == 0) & (net.problem.camera == 0)
    assert own.any()
    assert not (np.abs(residual[own]) < 1e6).any()


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
def test_dividing_by_zero_raises_nothing(engine: ModuleType) -> None:
    net = small_network()
    rotation, translation, points = (a.copy() for a in (net.truth.rotation, net.truth.translation, net.truth.points))
    rotation[0], translation[0], points[0] = np.eye(3), 0.0, [3.0, 4.0, 0.0]  # exactly in the camera's plane
    state = replace(net.truth, rotation=rotation, translation=translation, points=points)
    own = (net.problem.point == 0) & (net.problem.camera == 0)
    assert own.any()
    with np.errstate(all="ignore"):
        assert not np.isfinite(engine.residuals(net.problem, state)[own]).any()
        assert not np.isfinite(engine.linearise(net.problem, state, None).residual[own]).any()
    linear = reference.linearise(net.problem, net.truth, None)
    linear.by_point[net.problem.point == 3, :, 2] = 0.0  # no depth at all
    reduced = engine.reduce(net.problem, linear, 0.0)
    assert not np.isfinite(reduced.point_inverse[3]).all()
    assert np.isfinite(reduced.point_inverse[4]).all()


def test_layout_expands_and_folds(net: Small) -> None:
    layout = net.problem.layout
    rng = np.random.default_rng(0)
    reduced = rng.normal(size=layout.size)
    expanded = layout.expanded_rows(reduced)
    assert (expanded[layout.column < 0] == 0).all()
    np.testing.assert_array_equal(expanded[layout.column >= 0], reduced[layout.column[layout.column >= 0]])
    # folding is the transpose of expanding
    other = rng.normal(size=layout.expanded)
    assert layout.fold_vector(other) @ reduced == pytest.approx(other @ expanded)
    many = rng.normal(size=(layout.size, 3))
    np.testing.assert_array_equal(layout.expanded_rows(many)[:, 1], layout.expanded_rows(many[:, 1]))
    square = rng.normal(size=(layout.expanded, layout.expanded))
    square = square + square.T
    folded = symmetric(layout.fold_matrix(np.triu(square)))
    assert reduced @ folded @ reduced == pytest.approx(expanded @ square @ expanded)


def test_rows_and_unknowns_are_counted(net: Small) -> None:
    problem = net.problem
    full = dense_equations(problem, net.truth)
    assert problem.rows == len(full.residual)
    assert problem.unknowns == full.jacobian.shape[1]


@pytest.mark.parametrize(
    ("options", "defect"),
    [
        ({}, 7),
        ({"lengths": 3}, 6),
        ({"locked": (0, 3)}, 0),
        ({"intrinsics": "fixed"}, 7),
        ({"rigid": True}, 13),
        ({"rigid": True, "lengths": 3}, 12),
        ({"rigid": True, "locked": (0, 3)}, 6),
        ({"locked": (0,)}, 1),
        ({"locked": (0,), "lengths": 3}, 0),
    ],
)
def test_datum_defect_is_the_rank_that_is_missing(options: dict[str, Any], defect: int) -> None:
    net = small_network(n_points=14 if "rigid" in options else 24, noise_px=0.0, **options)
    problem, state = net.problem, net.truth
    full = dense_equations(problem, state)
    scaled = full.jacobian / np.linalg.norm(full.jacobian, axis=0)
    values = np.linalg.svd(scaled, compute_uv=False)
    assert (values < 1e-10).sum() == defect
    assert values[-defect - 1] > 1e-7
    assert datum_defect(problem) == defect


def test_moving_keeps_what_is_locked_or_fixed(net: Small) -> None:
    problem, state = net.problem, net.truth
    step = np.random.default_rng(0).normal(size=problem.layout.size) * 1e-3
    new = moved(problem, state, step, np.zeros_like(state.points))
    locked = ~problem.free_pose
    np.testing.assert_array_equal(new.rotation[locked], state.rotation[locked])
    np.testing.assert_array_equal(new.translation[locked], state.translation[locked])
    assert (new.intrinsics == state.intrinsics)[~problem.free_intrinsics].all()
    assert (new.intrinsics != state.intrinsics)[problem.free_intrinsics].all()
    for group in np.unique(problem.group):
        members = np.flatnonzero((problem.group == group) & problem.free_intrinsics.any(axis=1))
        change = (new.intrinsics - state.intrinsics)[members]
        np.testing.assert_allclose(change, np.tile(change[:1], (len(members), 1)), rtol=0, atol=1e-12)


# all 16 at once are no sensible adjustment: the terms above and below the fraction nearly cancel
@pytest.mark.parametrize("name", [name for name in CASES if name != "all 16"])
def test_a_whole_adjustment_is_equal(name: str) -> None:
    net = small_network(**CASES[name], seed=3)  # type: ignore[arg-type]
    start = perturbed(net.problem, net.truth, 0.3)
    for cauchy in (None, 2.0):
        settings = Settings(cauchy=cauchy, tolerance=1e-13, max_iterations=200)
        one = minimise(net.problem, start, settings)
        with reference.reference_instead():
            other = minimise(net.problem, start, settings)
        assert one.converged and other.converged
        assert one.cost == pytest.approx(other.cost, rel=1e-9)


REDUCED = """
import hashlib
from spherecal.adjust import engine as compiled
from tests import reference_engine as reference
from tests.networks import perturbed, small_network
net = small_network(rigid=True, intrinsics="shared")
linear = reference.linearise(net.problem, perturbed(net.problem, net.truth, 0.3), None)
found = compiled.reduce(net.problem, linear, 0.5)
arrays = (found.matrix, found.gradient, found.diagonal, found.point_inverse, found.point_gradient)
print(hashlib.sha256(b"".join(one.tobytes() for one in arrays)).hexdigest())
"""


def test_the_process_that_compiles_gets_the_bits_of_those_that_load(tmp_path: Path) -> None:
    """Inner kernels that were not inlined had two copies, rounded differently; which one ran depended on the cache."""
    paths = os.pathsep.join([str(ROOT / "core"), str(ROOT)])
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": paths}
    printed = [
        subprocess.run([sys.executable, "-c", REDUCED], env=environment, capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert any(tmp_path.rglob("schur_kernel.*.nbc"))
    assert printed[0].stdout == printed[1].stdout
