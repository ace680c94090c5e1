"""Triangulation against truth: exact points, honest covariances, and the cases without a point."""

import numpy as np
import pytest

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.camera import project
from spherecal.geometry.transform import PosedCameras
from spherecal.geometry.triangulation import Triangulation, triangulate
from spherecal_verify.outlying_views import Views, triangulate_checked


def ring_of_cameras(n: int, seed: int = 1) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cameras on a ring of 1.5 m that look at the origin: intrinsics, rotations, translations."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    centre = np.column_stack([1500 * np.cos(angle), 1500 * np.sin(angle), rng.uniform(-300, 300, n)])
    ahead = -centre / np.linalg.norm(centre, axis=1, keepdims=True)
    right = np.cross([0.0, 0.0, 1.0], ahead)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    rotation = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    intrinsics = np.tile(np.r_[2300.0, 2310.0, 1031.5, 771.5, -0.1, 0.02, 1e-3, -1e-3, np.zeros(8)], (n, 1))
    return intrinsics, rotation, -np.einsum("cij,cj->ci", rotation, centre)


def look_at(points: FloatArray, feature: IntArray, camera: IntArray, cameras: tuple[FloatArray, ...]) -> FloatArray:
    intrinsics, rotation, translation = cameras
    x = np.einsum("nij,nj->ni", rotation[camera], points[feature]) + translation[camera]
    return project(x, intrinsics[camera])


@pytest.fixture(scope="module")
def scene() -> tuple[tuple[FloatArray, ...], FloatArray, IntArray, IntArray, FloatArray]:
    """Cameras, 3000 points in a cube of 0.5 m, which camera sees which, and exact image points."""
    rng = np.random.default_rng(2)
    cameras = ring_of_cameras(8)
    points = rng.uniform(-250, 250, (3000, 3))
    feature, camera = np.nonzero(rng.random((3000, 8)) < 0.45)
    return cameras, points, feature, camera, look_at(points, feature, camera, cameras)


def test_exact_image_points_give_exact_points(scene) -> None:
    cameras, points, feature, camera, uv = scene
    found = triangulate(feature, camera, uv, np.ones(len(uv)), len(points), PosedCameras(*cameras))
    views = np.bincount(feature, minlength=len(points))
    np.testing.assert_array_equal(found.views, views)
    np.testing.assert_array_equal(np.isfinite(found.points[:, 0]), found.in_front)
    assert found.in_front[views >= 3].all()
    good = found.max_angle_rad > 0.02  # opposite cameras of the ring see each other's rays almost in line
    np.testing.assert_allclose(found.points[good], points[good], atol=1e-6)
    assert np.nanmax(np.abs(found.residual)) < 1e-6


def test_predicted_covariance_is_the_empirical_one(scene) -> None:
    """Errors weighed by their covariance are chi-square with 3 degrees of freedom, residuals with 2n - 3m."""
    cameras, points, feature, camera, uv = scene
    rng = np.random.default_rng(3)
    sigma = rng.choice([0.02, 0.1], size=(len(uv), 2))
    found = triangulate(
        feature, camera, uv + sigma * rng.normal(size=uv.shape), 1 / sigma**2, len(points), PosedCameras(*cameras)
    )
    good = np.isfinite(found.points[:, 0]) & (found.max_angle_rad > 0.1)
    error = (found.points - points)[good]
    chi2 = np.einsum("mi,mij,mj->m", error, np.linalg.inv(found.covariance[good]), error)
    assert chi2.mean() / 3 == pytest.approx(1, abs=4 * np.sqrt(2 / 3 / good.sum()))
    of_good = good[feature]
    freedom = 2 * of_good.sum() - 3 * good.sum()
    size = ((found.residual / sigma)[of_good] ** 2).sum() / freedom
    assert size == pytest.approx(1, abs=4 * np.sqrt(2 / freedom))


def test_minimum_is_reached(scene) -> None:
    """No small shift of a point lowers its weighted squared residuals."""
    cameras, points, feature, camera, uv = scene
    rng = np.random.default_rng(4)
    noisy = uv + 0.5 * rng.normal(size=uv.shape)
    found = triangulate(feature, camera, noisy, np.ones(len(uv)), len(points), PosedCameras(*cameras))
    good = np.isfinite(found.points[:, 0]) & (found.max_angle_rad > 0.1)
    cost = np.bincount(feature, (found.residual**2).sum(axis=1), len(points))
    for shift in 0.01 * np.vstack([np.eye(3), -np.eye(3)]):
        moved = ((look_at(found.points + shift, feature, camera, cameras) - noisy) ** 2).sum(axis=1)
        assert (np.bincount(feature, moved, len(points))[good] > cost[good]).all()


def one_point(camera: list[int], uv: FloatArray | None = None, weight: FloatArray | None = None) -> Triangulation:
    cameras = ring_of_cameras(8)
    feature, seen_by = np.zeros(len(camera), dtype=int), np.array(camera, dtype=int)
    exact = look_at(np.array([[10.0, 20.0, 30.0]]), feature, seen_by, cameras)
    weight = np.ones(len(camera)) if weight is None else weight
    return triangulate(feature, seen_by, exact if uv is None else uv, weight, 1, PosedCameras(*cameras))


def test_impossible_points_are_nan() -> None:
    for camera in ([], [3], [3, 3]):
        found = one_point(camera)
        assert np.isnan(found.points).all() and np.isnan(found.covariance).all()
        assert not found.in_front.any()
    assert one_point([]).views[0] == 0


def test_weight_zero_leaves_a_view_out() -> None:
    wrong = look_at(np.array([[10.0, 20.0, 30.0]]), np.zeros(3, dtype=int), np.array([0, 1, 2]), ring_of_cameras(8))
    wrong[2] += 100
    found = one_point([0, 1, 2], wrong, np.array([1.0, 1.0, 0.0]))
    np.testing.assert_allclose(found.points[0], [10, 20, 30], atol=1e-8)
    assert found.views[0] == 2
    np.testing.assert_allclose(found.residual[2], [-100, -100], atol=1e-6)


def test_angle_of_rays() -> None:
    """Neighbours on the ring of eight look at its middle under about 45 degrees; opposite rays count as parallel."""
    assert np.rad2deg(one_point([0, 1]).max_angle_rad[0]) == pytest.approx(45, abs=8)
    assert np.rad2deg(one_point([0, 2]).max_angle_rad[0]) == pytest.approx(90, abs=8)
    assert np.rad2deg(one_point([0, 1, 2]).max_angle_rad[0]) == pytest.approx(90, abs=8)
    assert one_point([0, 4]).max_angle_rad[0] < 0.5


def test_point_behind_a_camera_is_told() -> None:
    cameras = ring_of_cameras(8)
    far = np.array([[3000.0, 100.0, 50.0]])  # outside the ring, behind the cameras near +x
    camera = np.array([0, 1, 2])
    feature = np.zeros(3, dtype=int)
    found = triangulate(feature, camera, look_at(far, feature, camera, cameras), np.ones(3), 1, PosedCameras(*cameras))
    np.testing.assert_allclose(found.points, far, rtol=1e-6)
    assert not found.in_front[0]


def checked(spoil: dict[int, tuple[float, float]], n: int, noise: float = 0.04):
    cameras = ring_of_cameras(8)
    rng = np.random.default_rng(5)
    points = rng.uniform(-200, 200, (30, 3))
    feature, camera = np.repeat(np.arange(30), n), np.tile(np.arange(n), 30)
    uv = look_at(points, feature, camera, cameras) + noise * rng.normal(size=(30 * n, 2))
    for row, shift in spoil.items():
        uv[row] += shift
    found = triangulate_checked(Views(feature, camera, uv, np.ones((30 * n, 2)), 30, PosedCameras(*cameras)), 1.0)
    return found, np.linalg.norm(found.points.points - points, axis=1)


def test_gross_views_are_left_out() -> None:
    one_a_point = {0: (5.0, 3.0), 7: (0.0, -1.0), 21: (-2.0, 2.0)}
    two_of_five = {0: (5.0, 3.0), 2: (0.0, -30.0), 17: (40.0, 0.0)}
    for spoil, views in ((one_a_point, 4), (two_of_five, 5)):
        found, error = checked(spoil, views)
        assert set(np.flatnonzero(~found.kept)) == set(spoil)
        assert error.max() < 0.3
        assert found.noise == pytest.approx(0.04, rel=0.15)


def test_contradiction_of_two_views_gives_the_point_up() -> None:
    found, error = checked({0: (0.0, 50.0)}, 2)
    assert list(np.flatnonzero(found.contradicting)) == [0]
    assert error[1:].max() < 0.5


def test_good_views_stay() -> None:
    found, _ = checked({}, 4)
    assert found.kept.all()
    found, _ = checked({}, 4, noise=0.0)
    assert found.kept.all()
