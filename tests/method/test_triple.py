"""Triples of cameras reconstructed against the truth, and refused cleanly where nothing can be reconstructed."""

import warnings
from dataclasses import dataclass

import numpy as np
import pytest

from spherecal.base.arrays import FloatArray
from spherecal.geometry.resection import MIN_AGREEING, resect
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal.geometry.transform import fit_similarity
from spherecal.initialise.triple import MIN_POINTS, Triple, reconstruct_triple
from spherecal_sim.rigs import look_at

FOCAL = np.array([2000.0, 2100.0, 2200.0])


@dataclass(frozen=True)
class Scene:
    """Three cameras, points (n, 3) and their normalised image points (3, n, 2)."""

    rotation: FloatArray
    translation: FloatArray
    points: FloatArray
    xy: FloatArray

    @property
    def features(self) -> np.ndarray:
        return 100 + 3 * np.arange(len(self.points))

    def reconstruct(self, xy: FloatArray | None = None) -> Triple | None:
        return reconstruct_triple((4, 7, 9), self.features, self.xy if xy is None else xy, FOCAL)


def scene(points: FloatArray, places: FloatArray | None = None) -> Scene:
    if places is None:
        places = np.array([[-700.0, -450.0, 1200.0], [0.0, -430.0, 1180.0], [650.0, 460.0, 1220.0]])
    rotation = np.array([look_at(p, np.array([20.0, -10.0, 30.0]), np.array([0.0, 1.0, 0.0])) for p in places])
    translation = -np.einsum("cij,cj->ci", rotation, places)
    x = np.einsum("cij,nj->cni", rotation, points) + translation[:, None]
    return Scene(rotation, translation, points, x[:, :, :2] / x[:, :, 2:])


def cloud(n: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform(-250, 250, (n, 3))


def half_ball(n: int, seed: int = 0) -> FloatArray:
    d = np.random.default_rng(seed).normal(size=(n, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    d[:, 2] = np.abs(d[:, 2])
    return 250 * d


def check_is_consistent(triple: Triple) -> None:
    """What holds for every triple, right or wrong."""
    for values in (triple.rotation, triple.translation, triple.points, triple.error_px):
        assert np.isfinite(values).all()
    np.testing.assert_allclose(
        triple.rotation @ triple.rotation.transpose(0, 2, 1), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12
    )
    assert np.linalg.det(triple.rotation) == pytest.approx(np.ones(3))
    depth = np.einsum("cj,nj->cn", triple.rotation[:, 2], triple.points) + triple.translation[:, 2:3]
    assert (depth > 0).all()
    assert len(triple.points) == len(triple.features) >= MIN_POINTS


def differences(triple: Triple, true: Scene) -> tuple[float, float, float]:
    """Largest error of rotations in degrees, of camera centres and of points in mm, after the best similarity."""
    rows = np.searchsorted(true.features, triple.features)
    fit = fit_similarity(triple.points, true.points[rows])
    centre = -np.einsum("cji,cj->ci", triple.rotation, triple.translation)
    true_centre = -np.einsum("cji,cj->ci", true.rotation, true.translation)
    turn = [log_rotation(r @ fit.rotation.T @ q.T) for r, q in zip(triple.rotation, true.rotation, strict=True)]
    return (
        float(np.rad2deg(np.abs(turn).max())),
        float(np.linalg.norm(fit.apply(centre) - true_centre, axis=1).max()),
        float(np.linalg.norm(fit.apply(triple.points) - true.points[rows], axis=1).max()),
    )


@pytest.mark.parametrize("shape", [cloud, half_ball])
@pytest.mark.parametrize("n", [MIN_POINTS, 30, 400])
def test_without_noise_the_truth_comes_back(shape, n: int) -> None:
    true = scene(shape(n))
    triple = true.reconstruct()
    assert triple is not None
    check_is_consistent(triple)
    assert triple.cameras == (4, 7, 9)
    assert triple.features.tolist() == true.features.tolist()
    turn, centre, point = differences(triple, true)
    assert turn < 1e-5
    assert centre < 1e-3
    assert point < 1e-3
    assert triple.error_px.max() < 1e-5
    bases = [triple.baseline(0, 1) / triple.baseline(0, 2), triple.baseline(1, 2) / triple.baseline(0, 2)]
    c = -np.einsum("cji,cj->ci", true.rotation, true.translation)
    size = np.linalg.norm(c[0] - c[2])
    assert bases == pytest.approx([np.linalg.norm(c[0] - c[1]) / size, np.linalg.norm(c[1] - c[2]) / size], rel=1e-6)


def test_with_noise_errors_grow_in_proportion() -> None:
    worst = {}
    for noise_px in (0.05, 0.5):
        errors = []
        for seed in range(8):
            true = scene(half_ball(200, seed))
            triple = true.reconstruct(true.xy + np.random.default_rng(seed).normal(0, noise_px / 2000, true.xy.shape))
            assert triple is not None
            check_is_consistent(triple)
            errors.append([*differences(triple, true), *triple.error_px])
        worst[noise_px] = np.sqrt(np.mean(np.square(errors), axis=0))
    # degrees, mm, mm and px at half a pixel of noise: the adjustment's basin is a hundred times as wide
    assert (worst[0.5] < [0.5, 10.0, 10.0, 5.0, 5.0, 5.0]).all()
    np.testing.assert_allclose(worst[0.5] / worst[0.05], 10.0, rtol=0.2)


def test_errors_are_means_in_pixels_of_each_camera() -> None:
    true = scene(half_ball(100))
    xy = true.xy + np.random.default_rng(0).normal(0, 0.2 / 2000, true.xy.shape)
    triple = true.reconstruct(xy)
    assert triple is not None
    rows = np.searchsorted(true.features, triple.features)
    x = np.einsum("cij,nj->cni", triple.rotation, triple.points) + triple.translation[:, None]
    error = np.linalg.norm(x[:, :, :2] / x[:, :, 2:] - xy[:, rows], axis=2)
    np.testing.assert_allclose(triple.error_px, error.mean(axis=1) * FOCAL, rtol=1e-9)


def test_matches_wrong_along_the_epipolar_line_are_left_out() -> None:
    """The two-view gate cannot see them when three cameras stand in a row; here they contradict each other."""
    true = scene(half_ball(200), np.array([[-700.0, 300, 1200], [0, 310, 1190], [700, 320, 1180]]))
    rng = np.random.default_rng(1)
    xy = true.xy + rng.normal(0, 0.3 / 2000, true.xy.shape)
    wrong = np.array([5, 60, 130])
    centre = -true.rotation[0].T @ true.translation[0]
    elsewhere = centre + (true.points[wrong] - centre) * [[0.85], [1.15], [1.2]]  # on the first camera's rays
    x = elsewhere @ true.rotation[1].T + true.translation[1]
    xy[1, wrong] = x[:, :2] / x[:, 2:]
    assert (np.linalg.norm(xy[1, wrong] - true.xy[1, wrong], axis=1) * 2000 > 50).all()
    triple = true.reconstruct(xy)
    assert triple is not None
    check_is_consistent(triple)
    assert not np.isin(true.features[wrong], triple.features).any()
    assert len(triple.features) >= 190
    assert differences(triple, true)[1] < 20.0


def test_frame_of_the_input_does_not_matter() -> None:
    true = scene(half_ball(100))
    order = np.random.default_rng(0).permutation(100)
    triple, again = true.reconstruct(), reconstruct_triple((4, 7, 9), true.features[order], true.xy[:, order], FOCAL)
    assert triple is not None and again is not None
    ratio = [triple.baseline(i, j) / again.baseline(i, j) for i, j in ((0, 1), (0, 2), (1, 2))]
    assert ratio == pytest.approx([ratio[0]] * 3, rel=1e-6)


def plane(n: int, tilt: float = 0.3) -> FloatArray:
    return (cloud(n) * [1, 1, 0]) @ exp_rotation(np.array([tilt, 0.2, 0.0])).T


LINE = np.linspace(-250, 250, 40)[:, None] * np.array([[0.6, 0.5, 0.3]])
ONE_PLACE = np.tile([[0.0, -430.0, 1180.0]], (3, 1))
DEGENERATE = {
    "too few": scene(cloud(MIN_POINTS - 1)),
    "none": scene(cloud(0)),
    "collinear": scene(LINE),
    "planar": scene(plane(60)),
    "planar, level": scene(plane(60, 0.0)),
    "one point": scene(np.zeros((40, 3))),
    "two points": scene(np.tile(cloud(2), (20, 1))),
    "one place": scene(cloud(60), ONE_PLACE),
    "two at one place": scene(cloud(60), np.array([[-700.0, -450, 1200], [-700.0, -450, 1200], [650, 460, 1220.0]])),
}


# nothing in these points tells right from wrong once there is noise: what comes back must be a sound figure at least
NOISE_LOOKS_LIKE_DEPTH = ("planar", "planar, level", "one place", "two at one place")


@pytest.mark.parametrize("noise_px", [0.0, 0.1])
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_input_gives_none_without_a_warning(name: str, noise_px: float) -> None:
    true = DEGENERATE[name]
    xy = true.xy + np.random.default_rng(0).normal(0, noise_px / 2000, true.xy.shape)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        triple = true.reconstruct(xy)
    if noise_px == 0 or name not in NOISE_LOOKS_LIKE_DEPTH:
        assert triple is None
    if triple is not None:
        check_is_consistent(triple)


def test_matches_that_mean_nothing_are_no_reconstruction() -> None:
    found = 0
    for seed in range(20):
        xy = np.random.default_rng(seed).uniform(-0.4, 0.4, (3, 60, 2))
        triple = reconstruct_triple((0, 1, 2), np.arange(60), xy, FOCAL)
        if triple is not None:
            check_is_consistent(triple)
            found += 1
    assert found <= 4


def resection_case(n: int, wrong: int, noise_px: float, seed: int = 0) -> tuple[Scene, FloatArray]:
    true = scene(half_ball(n, seed))
    rng = np.random.default_rng(seed)
    xy = true.xy[0] + rng.normal(0, noise_px / 2000, true.xy[0].shape)
    xy[:wrong] = rng.uniform(-0.3, 0.3, (wrong, 2))
    return true, xy


@pytest.mark.parametrize(("wrong", "noise_px"), [(0, 0.0), (0, 0.3), (30, 0.0), (30, 0.3)])
def test_resection_finds_the_pose(wrong: int, noise_px: float) -> None:
    true, xy = resection_case(100, wrong, noise_px)
    found = resect(true.points, xy, 12 / 2000)
    assert found is not None
    rotation, translation, agreeing = found
    assert 100 - wrong <= agreeing <= 100 - 0.9 * wrong
    assert np.rad2deg(np.linalg.norm(log_rotation(rotation @ true.rotation[0].T))) < 0.1 * noise_px + 1e-3
    np.testing.assert_allclose(-rotation.T @ translation, [-700.0, -450.0, 1200.0], atol=5 * noise_px + 0.1)


def test_resection_is_the_same_every_time() -> None:
    true, xy = resection_case(60, 20, 0.3)
    one, other = resect(true.points, xy, 12 / 2000), resect(true.points, xy, 12 / 2000)
    assert one is not None and other is not None
    assert np.array_equal(one[0], other[0]) and np.array_equal(one[1], other[1])


def test_resection_that_is_not_possible() -> None:
    true, xy = resection_case(60, 0, 0.0)
    assert resect(true.points[: MIN_AGREEING - 1], xy[: MIN_AGREEING - 1], 12 / 2000) is None
    assert resect(true.points[:0], xy[:0], 12 / 2000) is None
    nonsense = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 2))
    meaningless = resect(true.points, nonsense, 1 / 2000)
    assert meaningless is None or meaningless[2] < 12
    for spread in (0.0, 1e-9, 1e-3):  # all in one place
        points = 100.0 + spread * np.random.default_rng(0).normal(size=(60, 3))
        one_place = resect(points, np.random.default_rng(1).normal(0, 1e-5, (60, 2)), 12 / 2000)
        assert one_place is None or np.isfinite(np.r_[one_place[0].ravel(), one_place[1]]).all()


@pytest.mark.parametrize("size_mm", [100.0, 8.0])
def test_resection_from_a_single_target_far_away(size_mm: float) -> None:
    """Dots some ten pixels apart: close together for a solver, and all there is for a camera at the edge."""
    place = np.array([300.0, 200.0, 2500.0])
    rotation = look_at(place, np.zeros(3), np.array([0.0, 1.0, 0.0]))
    points = np.random.default_rng(0).uniform(-size_mm, size_mm, (16, 3)) * [1, 1, 0.3]
    x = (points - place) @ rotation.T
    found = resect(points, x[:, :2] / x[:, 2:], 12 / 2000)
    assert found is not None
    np.testing.assert_allclose(-found[0].T @ found[1], place, atol=0.1)
    assert found[2] == 16
