"""Rotations near the hard places, transforms and spheres against their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import least_squares

from spherecal.base.arrays import FloatArray
from spherecal.geometry.rotation import cross_matrix, exp_rotation, log_rotation, nearest_rotation
from spherecal.geometry.sphere import fit_sphere
from spherecal.geometry.transform import fit_similarity
from spherecal.scale.metric import fit_spheres

ordinary = st.floats(0, np.pi)
tiny = st.floats(0, 1e-7)
nearly_half_turn = st.floats(0, 1e-6).map(lambda gap: np.pi - gap)
angles = st.one_of(ordinary, tiny, nearly_half_turn, st.sampled_from([0.0, 1e-300, 1e-16, np.pi / 2, np.pi]))
component = st.floats(-1, 1)
axes = (
    st.tuples(component, component, component)
    .filter(lambda a: np.linalg.norm(a) > 0.01)
    .map(lambda a: np.array(a) / np.linalg.norm(a))
)


def assert_rotation(r: FloatArray) -> None:
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(r) == pytest.approx(1.0, abs=1e-14)


def test_cross_matrix_is_the_cross_product() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 7, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", cross_matrix(a), b), np.cross(a, b), atol=1e-15)
    assert cross_matrix(np.zeros((2, 5, 3))).shape == (2, 5, 3, 3)


@given(axes, angles)
def test_exponential_is_that_of_the_matrix(axis: FloatArray, angle: float) -> None:
    r = exp_rotation(axis * angle)
    assert_rotation(r)
    np.testing.assert_allclose(r, expm(cross_matrix(axis * angle)), atol=1e-14)


@given(axes, angles)
def test_logarithm_takes_the_exponential_back(axis: FloatArray, angle: float) -> None:
    w = axis * angle
    r = exp_rotation(w)
    again = log_rotation(r)
    assert np.linalg.norm(again) <= np.pi * (1 + 1e-15)
    np.testing.assert_allclose(exp_rotation(again), r, atol=1e-14)
    if angle < np.pi - 1e-3:
        np.testing.assert_allclose(again, w, rtol=0, atol=1e-12)
    else:  # at a half turn both axes mean the same rotation
        np.testing.assert_allclose(min(again, -again, key=lambda v: float(np.linalg.norm(v - w))), w, atol=1e-6)


@given(axes, st.floats(1e-12, 1e-7))
def test_small_turns_lose_no_digits(axis: FloatArray, angle: float) -> None:
    np.testing.assert_allclose(log_rotation(exp_rotation(axis * angle)), axis * angle, rtol=1e-8, atol=1e-8 * angle)


def test_rotations_keep_the_shape_of_what_they_are_given() -> None:
    w = np.random.default_rng(0).normal(size=(2, 4, 3))
    r = exp_rotation(w)
    assert r.shape == (2, 4, 3, 3)
    assert exp_rotation(np.zeros(3)).shape == (3, 3)
    assert exp_rotation(np.zeros((0, 3))).shape == (0, 3, 3)
    np.testing.assert_allclose(r[1, 2], exp_rotation(w[1, 2]))
    np.testing.assert_allclose(exp_rotation(log_rotation(r)), r, atol=1e-14)


@given(axes, angles, st.integers(0, 1000))
def test_nearest_rotation_is_nearer_than_others(axis: FloatArray, angle: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    r = exp_rotation(axis * angle)
    np.testing.assert_allclose(nearest_rotation(rng.uniform(0.1, 10) * r), r, atol=1e-13)
    m = r + rng.normal(0, 0.3, (3, 3))
    found = nearest_rotation(m)
    assert_rotation(found)
    best = np.linalg.norm(m - found)
    for other in exp_rotation(rng.normal(0, 0.01, (20, 3))) @ found:
        assert np.linalg.norm(m - other) >= best - 1e-12


def test_nearest_rotation_of_a_reflection_is_a_rotation() -> None:
    assert_rotation(nearest_rotation(np.diag([1.0, 1.0, -1.0])))
    assert_rotation(nearest_rotation(-exp_rotation(np.array([0.1, 0.2, 0.3]))))


@pytest.mark.parametrize("with_scale", [True, False])
@pytest.mark.parametrize("flat", [False, True])
@given(axes, angles, st.floats(1e-3, 1e3), st.integers(0, 1000))
def test_similarity_is_recovered(
    with_scale: bool, flat: bool, axis: FloatArray, angle: float, scale: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    scale = scale if with_scale else 1.0
    source = rng.normal(0, 100, (6, 3)) * [1, 1, 0 if flat else 1]
    r, t = exp_rotation(axis * angle), rng.normal(0, 1000, 3)
    found = fit_similarity(source, scale * source @ r.T + t, with_scale)
    assert found.scale == pytest.approx(scale, rel=1e-10)
    np.testing.assert_allclose(found.rotation, r, atol=1e-9)
    np.testing.assert_allclose(found.apply(source), scale * source @ r.T + t, rtol=0, atol=1e-8 * max(scale, 1))


def test_similarity_is_never_a_reflection() -> None:
    source = np.random.default_rng(0).normal(size=(10, 3))
    for with_scale in (True, False):
        found = fit_similarity(source, source * [1, 1, -1], with_scale)
        assert_rotation(found.rotation)
        assert found.scale > 0


@pytest.mark.parametrize("mirror", [1, -1])
def test_similarity_has_the_least_squares(mirror: int) -> None:
    rng = np.random.default_rng(1)
    source = rng.normal(0, 1, (12, 3))
    target = 2 * source @ exp_rotation(np.array([1.0, 2.0, 0.5])).T * [1, 1, mirror] + rng.normal(0, 0.3, (12, 3))
    found = fit_similarity(source, target)
    best = ((found.apply(source) - target) ** 2).sum()
    for _ in range(200):
        turn = exp_rotation(rng.normal(0, 0.02, 3)) @ found.rotation
        scale, shift = found.scale * (1 + rng.normal(0, 0.02)), found.translation + rng.normal(0, 0.02, 3)
        assert ((scale * source @ turn.T + shift - target) ** 2).sum() > best


def on_sphere(rng: np.random.Generator, n: int, radius: float, centre: FloatArray, cap: float = -1.0) -> FloatArray:
    direction = rng.normal(size=(50 * n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return centre + radius * direction[direction[:, 2] > cap][:n]


@given(st.floats(0.01, 1e4), st.tuples(*[st.floats(-1e4, 1e4)] * 3), st.integers(0, 1000))
def test_sphere_through_its_points(radius: float, centre: tuple[float, ...], seed: int) -> None:
    points = on_sphere(np.random.default_rng(seed), 20, radius, np.array(centre))
    sphere = fit_sphere(points)
    assert sphere is not None
    size = radius + float(np.linalg.norm(centre)) * 1e-5
    assert sphere.radius == pytest.approx(radius, abs=1e-8 * size)
    np.testing.assert_allclose(sphere.centre, centre, rtol=0, atol=1e-8 * size)
    assert sphere.radial_sd < 1e-8 * size


@pytest.mark.parametrize(("cap", "agreement"), [(-1.0, 1e-5), (0.0, 1e-5), (0.5, 5e-5)])
def test_sphere_of_an_imperfect_ball_is_the_geometric_one(cap: float, agreement: float) -> None:
    rng = np.random.default_rng(3)
    centre = np.array([100.0, -50.0, 900.0])
    points = on_sphere(rng, 400, 250.0, np.zeros(3), cap)
    points = centre + points * (1 + 0.002 * np.sin(points[:, :1] / 80) * np.cos(points[:, 1:2] / 60))

    def misfit(p: FloatArray) -> FloatArray:
        return np.linalg.norm(points - p[:3], axis=1) - p[3]

    best = least_squares(misfit, [*centre, 250.0], xtol=1e-15).x
    sphere = fit_sphere(points)
    assert sphere is not None
    assert sphere.radius == pytest.approx(best[3], rel=agreement)
    assert sphere.radial_sd == pytest.approx(np.sqrt((misfit(best) ** 2).sum() / 396), rel=1e-2)


def test_what_defines_no_sphere_gives_none() -> None:
    rng = np.random.default_rng(0)
    plane = rng.normal(size=(30, 3)) @ np.diag([1.0, 1.0, 0.0]) @ exp_rotation(np.array([0.3, 0.2, 0.1])).T + 5.0
    line = rng.normal(size=(30, 1)) * np.array([[1.0, 2.0, 3.0]])
    for points in (np.zeros((0, 3)), rng.normal(size=(3, 3)), plane, line, np.ones((10, 3)), np.zeros((10, 3))):
        assert fit_sphere(points) is None
    assert fit_sphere(rng.normal(size=(4, 3))) is not None


def test_a_point_far_off_takes_no_part_in_its_placements_sphere() -> None:
    rng = np.random.default_rng(0)
    on = rng.normal(size=(60, 3))
    on *= 250.0 / np.linalg.norm(on, axis=1, keepdims=True)
    points = np.vstack([on + np.array([900.0, 0.0, 0.0]), [[9e3, 4e3, 0.0]], on, np.full((2, 3), np.nan)])
    found = fit_spheres(points, np.r_[np.zeros(61, int), np.ones(62, int)], 3)
    assert found.keys() == {0, 1}
    assert [found[t].radius for t in (0, 1)] == pytest.approx([250.0, 250.0])
    assert found[0].centre == pytest.approx([900.0, 0.0, 0.0], abs=1e-6)
