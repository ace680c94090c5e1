"""The camera model against other people's numbers, its derivatives against differences, and its inverse."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st

from spherecal.adjust import engine as compiled
from spherecal.adjust.problem import Problem, moved
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.data.rig_camera import RigCamera
from spherecal.detect.redetection import _predict
from spherecal.geometry.camera import (
    INTRINSIC_NAMES,
    camera_matrix,
    distort,
    distort_with_jacobian,
    fisheye_vector,
    intrinsics_vector,
    is_unfolded,
    project,
    project_with_derivatives,
    project_with_point_derivatives,
    undistort,
)
from spherecal.geometry.length_uncertainty import Cameras, predict_lengths
from spherecal_rigs.next_placement import _cameras_at, _in_view
from tests import reference_engine as reference
from tests.networks import small_network

EXCERPT = ROOT / "tests" / "data" / "projection_excerpt.json"
# an action camera's wide lens: strong terms that nearly cancel each other
WIDE = np.r_[2440.0, 2440.0, 2655.0, 1482.5, 5.75, 1.58, 1e-5, -4e-4, -0.052, 6.06, 3.10, 0.063, 0, 0, 0, 0]


def assert_projections_agree(vectors: dict[str, Any], models: set[str]) -> None:
    assert models <= set(vectors)
    for model in models:
        params = vectors[model]["params"]
        matrix = np.array([[params[0], 0, params[2]], [0, params[1], params[3]], [0, 0, 1]])
        uv = project(np.array(vectors["points"]), intrinsics_vector(matrix, params[4:]))
        np.testing.assert_allclose(uv, vectors[model]["pixels"], rtol=0, atol=1e-6, err_msg=model)


def test_projection_agrees_with_published_vectors(shared_data: Path) -> None:
    vectors = json.loads((shared_data / "projection" / "vectors.json").read_text())
    assert_projections_agree(vectors, {"opencv4", "opencv5", "opencv8"})


def test_projection_agrees_with_the_excerpt_of_them() -> None:
    vectors = json.loads(EXCERPT.read_text())
    assert "Apache-2.0" in vectors["license"]
    assert "github.com/dkogan/mrcal" in vectors["source"]
    assert_projections_agree(vectors, {"opencv4", "opencv8"})


def random_camera(rng: np.random.Generator, size: float = 0.1) -> FloatArray:
    c = np.r_[rng.uniform(500, 4000, 2), rng.uniform(200, 2000, 2), rng.normal(0, size, 12)]
    c[[6, 7, 12, 13, 14, 15]] *= 0.1
    return c


def test_projection_agrees_with_opencv() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        c = random_camera(rng)
        x = np.column_stack([rng.uniform(-1, 1, (30, 2)), rng.uniform(1, 5, 30)]) * rng.uniform(0.1, 1000)
        expected = cv2.projectPoints(x, np.zeros(3), np.zeros(3), camera_matrix(c), c[4:])[0].reshape(-1, 2)
        np.testing.assert_allclose(project(x, c), expected, rtol=1e-12, atol=1e-6)
        np.testing.assert_allclose(project(x, np.tile(c, (30, 1))), expected, rtol=1e-12, atol=1e-6)


def test_distortion_leaves_the_centre_and_a_plain_lens_alone() -> None:
    xy = np.random.default_rng(0).uniform(-1, 1, (10, 2))
    np.testing.assert_array_equal(distort(xy, np.r_[1.0, 1.0, np.zeros(14)]), xy)
    np.testing.assert_array_equal(distort(np.zeros((1, 2)), random_camera(np.random.default_rng(1))), 0.0)


def test_points_behind_are_projected_without_a_word() -> None:
    c = intrinsics_vector(np.diag([1000.0, 1000.0, 1.0]), [])
    np.testing.assert_allclose(project(np.array([[1.0, 2.0, -4.0]]), c), [[-250.0, -500.0]])


def differences(function: Callable[[float], FloatArray], step: float) -> FloatArray:
    """The derivative at 0 by five points, error of fourth order."""
    near, far = function(step) - function(-step), function(2 * step) - function(-2 * step)
    return (8 * near - far) / (12 * step)


def assert_block(analytic: FloatArray, numeric: FloatArray, what: str) -> None:
    size = np.abs(numeric).max()
    assert size > 0, f"{what}: the test sees nothing"
    np.testing.assert_allclose(analytic, numeric, rtol=0, atol=2e-8 * size, err_msg=what)


@pytest.fixture(scope="module")
def derivative_case() -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(5)
    x = np.column_stack([rng.uniform(-0.6, 0.6, (40, 2)), rng.uniform(0.8, 1.5, 40)])
    return x, np.array([random_camera(rng) for _ in x])


def test_projection_with_derivatives_projects(derivative_case: tuple[FloatArray, FloatArray]) -> None:
    x, c = derivative_case
    uv, by_point, _ = project_with_derivatives(x, c)
    np.testing.assert_allclose(uv, project(x, c), rtol=1e-13)
    for intrinsics in (c, np.tile(c[0], (len(x), 1)), c[0]):
        uv, by_point, _ = project_with_derivatives(x, intrinsics)
        for one, other in zip(project_with_point_derivatives(x, intrinsics), (uv, by_point), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-9)
    with_one, with_many = project_with_derivatives(x, c[0]), project_with_derivatives(x, np.tile(c[0], (len(x), 1)))
    for one, many in zip(with_one, with_many, strict=True):
        np.testing.assert_allclose(one, many, rtol=1e-13)


@pytest.mark.parametrize("axis", range(2))
def test_derivatives_of_the_distortion(derivative_case: tuple[FloatArray, FloatArray], axis: int) -> None:
    x, c = derivative_case
    xy = x[:, :2] / x[:, 2:]
    distorted, jacobian = distort_with_jacobian(xy, c)
    np.testing.assert_allclose(distorted, distort(xy, c), rtol=1e-13, atol=1e-15)
    assert_block(jacobian[:, :, axis], differences(lambda h: distort(xy + h * np.eye(2)[axis], c), 1e-3), "xy"[axis])


@pytest.mark.parametrize("axis", range(3))
def test_derivatives_by_the_point(derivative_case: tuple[FloatArray, FloatArray], axis: int) -> None:
    x, c = derivative_case
    unit = np.eye(3)[axis]
    numeric = differences(lambda h: project(x + h * unit, c), 1e-3)
    assert_block(project_with_derivatives(x, c)[1][:, :, axis], numeric, "xyz"[axis])


@pytest.mark.parametrize("i", range(16), ids=INTRINSIC_NAMES)
def test_derivatives_by_each_intrinsic(derivative_case: tuple[FloatArray, FloatArray], i: int) -> None:
    x, c = derivative_case
    unit = np.eye(16)[i]
    numeric = differences(lambda h: project(x, c + h * unit), 1.0 if i < 4 else 1e-3)
    assert_block(project_with_derivatives(x, c)[2][:, :, i], numeric, INTRINSIC_NAMES[i])


ENGINES = [reference, compiled]
ENGINE_NAMES = ["reference", "compiled"]


def shifted(problem: Problem, state: State, column: int, by: float) -> State:
    step = np.zeros(problem.layout.size)
    step[column] = by
    return moved(problem, state, step, np.zeros_like(state.points))


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
@pytest.mark.parametrize("rigid", [False, True], ids=["free", "rigid"])
def test_camera_columns_of_the_engines(engine: ModuleType, rigid: bool) -> None:
    net = small_network(rigid=rigid, intrinsics="all", n_cameras=3, n_points=10, sigma=True)
    problem, state = net.problem, net.truth
    analytic = engine.linearise(problem, state, None).by_camera
    assert analytic.shape == (len(problem.uv), 2, 22)
    for camera in range(3):
        own = problem.camera == camera
        for i in range(22):
            step = 1e-4 if i < 3 else 0.1 if i < 6 else 1.0 if i < 10 else 1e-3
            at = 22 * camera + i
            numeric = differences(lambda h, at=at: engine.residuals(problem, shifted(problem, state, at, h)), step)
            assert_block(analytic[own, :, i], numeric[own], f"camera {camera} column {i}")
            assert (numeric[~own] == 0).all()


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
@pytest.mark.parametrize("rigid", [False, True], ids=["free", "rigid"])
def test_point_columns_of_the_engines(engine: ModuleType, rigid: bool) -> None:
    net = small_network(rigid=rigid, n_cameras=3, n_points=10, sigma=True)
    problem, state = net.problem, net.truth
    analytic = engine.linearise(problem, state, None).by_point
    for axis in range(3):
        numeric = differences(
            lambda h, axis=axis: engine.residuals(problem, replace(state, points=state.points + h * np.eye(3)[axis])),
            0.1,
        )
        assert_block(analytic[:, :, axis], numeric, f"point {'xyz'[axis]}")


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
def test_placement_columns_of_the_engines(engine: ModuleType) -> None:
    net = small_network(rigid=True, n_cameras=3, n_points=10, sigma=True)
    problem, state = net.problem, net.truth
    assert problem.placement is not None
    analytic = engine.linearise(problem, state, None).by_placement
    first = 3 * 15
    for placement in range(3):
        own = problem.placement == placement
        for i in range(6):
            at = first + 6 * placement + i
            step = 1e-4 if i < 3 else 0.1
            numeric = differences(lambda h, at=at: engine.residuals(problem, shifted(problem, state, at, h)), step)
            assert_block(analytic[own, :, i], numeric[own], f"placement {placement} column {i}")
            assert (numeric[~own] == 0).all()


@pytest.mark.parametrize("engine", ENGINES, ids=ENGINE_NAMES)
def test_robust_weights_scale_the_rows(engine: ModuleType) -> None:
    net = small_network(rigid=True, sigma=True)
    weight = np.random.default_rng(0).uniform(0.1, 1, len(net.problem.uv))
    plain = engine.linearise(net.problem, net.truth, None)
    weighted = engine.linearise(net.problem, net.truth, weight)
    for name in ("residual", "by_camera", "by_point", "by_placement"):
        rows = getattr(plain, name)
        expected = rows * weight.reshape(-1, *[1] * (rows.ndim - 1))
        np.testing.assert_allclose(getattr(weighted, name), expected, rtol=1e-12, atol=1e-9)


# lenses whose distortion grows along every ray within the field tested below, so that each point has one image
lenses = st.tuples(
    *[st.floats(-0.15, 0.15)] * 2,
    *[st.floats(-0.01, 0.01)] * 2,
    *[st.floats(-0.08, 0.08)] * 4,
    *[st.floats(-0.01, 0.01)] * 4,
)
coordinate = st.floats(-0.6, 0.6)


@given(lenses, st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=8))
def test_undistortion_takes_distortion_back(lens: tuple[float, ...], points: list[tuple[float, float]]) -> None:
    c = np.r_[2000.0, 1900.0, 1000.0, 800.0, lens]
    xy = np.array(points)
    found, converged = undistort(project(np.column_stack([xy, np.ones(len(xy))]), c), c)
    assert converged.all()
    np.testing.assert_allclose(found, xy, rtol=0, atol=1e-9)


def test_undistortion_of_the_whole_frame_of_a_wide_lens() -> None:
    u, v = np.meshgrid(np.linspace(-0.5, 5311.5, 120), np.linspace(-0.5, 2987.5, 80))
    uv = np.column_stack([u.ravel(), v.ravel()])
    xy, converged = undistort(uv, WIDE)
    radius = np.hypot(*((uv - WIDE[2:4]) / WIDE[:2]).T)
    within = radius < 1.21  # it folds over at 1.224 +- 0.015, 69 degrees off the axis
    assert 0.99 < within.mean() < 1
    assert converged[within].all()
    assert not converged[radius > 1.24].any()
    again = project(np.column_stack([xy, np.ones(len(xy))]), WIDE)
    np.testing.assert_allclose(again[within], uv[within], rtol=0, atol=1e-6)


FOLDING = np.r_[
    1000.0, 1000.0, 0.0, 0.0, -0.5, np.zeros(11)
]  # r (1 - r^2 / 2): folds at r = sqrt(2/3), 0.544 distorted
FOLD, MOST = np.sqrt(2 / 3), np.sqrt(2 / 3) * 2 / 3


@given(st.floats(0.001, 3.0), st.floats(0, 2 * np.pi))
def test_undistortion_says_where_a_lens_folds_over(radius: float, angle: float) -> None:
    uv = 1000 * radius * np.array([[np.cos(angle), np.sin(angle)]])
    xy, converged = undistort(uv, FOLDING)
    if radius > MOST * (1 + 1e-6):
        assert not converged[0]
        assert np.isnan(xy).all()
    elif radius < MOST * (1 - 1e-3):
        assert converged[0]
        assert np.hypot(*xy[0]) < FOLD
        np.testing.assert_allclose(project(np.r_[xy[0], 1.0][None], FOLDING), uv, atol=1e-6)


def test_undistortion_refuses_what_lies_beyond_a_fold() -> None:
    # rises to 0.6 at r = 1, falls to 0.57 at r = 1.41 and rises again: 0.7 is the image of no point in the first part
    lens = np.r_[1000.0, 1000.0, 0.0, 0.0, -0.5, 0.1, np.zeros(10)]
    angle = np.linspace(0, 6, 20)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    for radius, first in ((0.3, True), (0.55, True), (0.62, False), (0.7, False), (2.0, False)):
        xy, converged = undistort(1000 * radius * circle, lens)
        assert (converged == first).all()
        assert (np.hypot(*xy.T) < 1).all() == first


def test_undistortion_never_returns_a_wrong_point() -> None:
    rng = np.random.default_rng(3)
    for _ in range(100):
        c = random_camera(rng, size=1.0)  # wild lenses: some fold within the frame
        uv = c[2:4] + c[:2] * rng.uniform(-1.5, 1.5, (50, 2))
        with np.errstate(all="ignore"):
            xy, converged = undistort(uv, c)
        assert np.isnan(xy[~converged]).all()
        assert np.isfinite(xy[converged]).all()
        again = project(np.column_stack([xy, np.ones(50)]), c)
        np.testing.assert_allclose(again[converged], uv[converged], rtol=0, atol=1e-4)


def test_undistortion_takes_each_point_with_its_own_camera() -> None:
    rng = np.random.default_rng(4)
    cameras = np.array([np.r_[rng.uniform(1000, 2000, 4), rng.normal(0, 0.02, 2), np.zeros(10)] for _ in range(20)])
    xy = rng.uniform(-0.4, 0.4, (20, 2))
    uv = project(np.column_stack([xy, np.ones(20)]), cameras)
    found, converged = undistort(uv, cameras)
    assert converged.all()
    np.testing.assert_allclose(found, xy, atol=1e-10)
    assert undistort(np.zeros((0, 2)), cameras[:0])[0].shape == (0, 2)


SIZE = (2064, 1544)
# usual: 65 degrees off the axis its polynomial comes back into the image, which shows 30
USUAL = intrinsics_vector(np.array([[2319.0, 0, 1031.5], [0, 2319.0, 771.5], [0, 0, 1]]), [-0.1, 0.09, 0, 0, -0.025])
FISHEYE = fisheye_vector(np.array([[985.0, 0, 1031.5], [0, 985.0, 771.5], [0, 0, 1]]), [])


def off_axis(degrees: float) -> FloatArray:
    """A place towards the image's corner, mm."""
    angle = np.deg2rad(degrees)
    return 1000.0 * np.array([0.8 * np.sin(angle), 0.6 * np.sin(angle), np.cos(angle)])


def test_a_folded_model_shows_no_point() -> None:
    folded = off_axis(65.0)[None]
    assert (np.abs(project(folded, USUAL) - USUAL[2:4]) < np.array(SIZE) / 2).all(), "else this says nothing"
    assert not is_unfolded(folded, USUAL[None]).any()
    turning = fisheye_vector(camera_matrix(FISHEYE), [-0.3])  # rises up to 60 degrees
    angles = (1.0, 59.0, 62.0, 85.0)
    x = np.array([off_axis(a) for a in angles])
    np.testing.assert_array_equal(is_unfolded(x, np.tile(turning, (4, 1))), [True, True, False, False])
    mixed = np.stack([FISHEYE, USUAL, USUAL, FISHEYE])
    np.testing.assert_array_equal(is_unfolded(x, mixed), [True, False, False, True])


@pytest.mark.parametrize(("lens", "size"), [(USUAL, SIZE), (FISHEYE, SIZE), (WIDE, (5312, 2988))])
def test_no_part_of_an_image_is_folded(lens: FloatArray, size: tuple[int, int]) -> None:
    uv = np.random.default_rng(0).uniform(-0.5, np.array(size) - 0.5, (500, 2))
    xy, good = undistort(uv, lens)
    assert good.mean() > 0.9  # of the third lens, corners are seen 75 degrees off the axis and more
    assert is_unfolded(np.column_stack([xy, np.ones(500)])[good], np.tile(lens, (good.sum(), 1))).all()


def test_only_what_the_lenses_show_is_predicted() -> None:
    """Lengths, the next placement and re-detection ask for it."""
    both = np.stack([USUAL, FISHEYE])
    middle, outer = off_axis(5.0), off_axis(65.0)
    towards = np.array([-1.0, 0, 0])  # two cameras of each lens at one place, the second one beside it
    where = np.tile(np.eye(3), (4, 1, 1))
    beside = np.array([np.zeros(3), np.zeros(3), towards, towards])
    lenses, sizes = np.tile(both, (2, 1)), np.tile(np.array(SIZE, dtype=float), (4, 1))
    cameras = Cameras(lenses, where, beside, sizes, np.zeros((24, 24)), np.empty(0, dtype=np.int64))
    ends = np.stack([[middle, off_axis(6.0)], [outer, off_axis(64.0)]])
    np.testing.assert_array_equal(predict_lengths(cameras, ends, 0.05).views, [4, 2])

    known = SimpleNamespace(
        state=SimpleNamespace(rotation=where, translation=np.zeros((4, 3)), intrinsics=lenses),
        size=sizes,
        body=SimpleNamespace(radius_mm=10.0),
    )
    places = np.stack([middle, outer])
    np.testing.assert_array_equal(_cameras_at(known, places), [[True] * 4, [False, True] * 2])  # pyright: ignore[reportArgumentType]
    ball = SimpleNamespace(dots=places, normals=-places / 1000.0)
    seen = _in_view(ball, known, np.eye(3), np.zeros(3))  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(seen, [[True, False], [True, True]] * 2)

    for lens, shown in ((USUAL, False), (FISHEYE, True)):
        camera = RigCamera("C01", None, SIZE, lens, np.eye(3), np.zeros(3), None, 0, None)
        uv = _predict(camera, np.tile(outer, (1, 8, 1)))
        assert np.isfinite(uv).all() if shown else np.isnan(uv).all()
