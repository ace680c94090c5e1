"""The ball as one rigid object: placements aligned by the dots they share, the rigid network and its solution."""

import time
from dataclasses import dataclass, replace

import numpy as np
import pytest

from spherecal.adjust.bundle import refine
from spherecal.adjust.covariance import covariance
from spherecal.adjust.network import Network, free_network
from spherecal.adjust.state import State
from spherecal.ball.rigid import LEAST_SHARED, align, share_shape
from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.data.observations import Features
from spherecal.geometry.camera import estimated_mask, project
from spherecal.geometry.rotation import exp_rotation
from spherecal_sim.rigs import look_at, random_rotations
from tests.networks import one_thread

__all__ = ["one_thread"]

DOTS = 8  # of a target


@dataclass(frozen=True)
class Turned:
    """Dots of a ball at placements: their features, where they are, and the true motions from the ball's frame."""

    features: Features
    points: FloatArray
    rotation: FloatArray
    shift: FloatArray


def turned_ball(seen: np.ndarray, seed: int = 0, noise_mm: float = 0.0) -> Turned:
    """A ball of targets with `DOTS` dots each; seen (placements, targets) says which ones are reconstructed."""
    rng = np.random.default_rng(seed)
    n_placements, n_targets = seen.shape
    middle = rng.normal(size=(n_targets, 1, 3))
    middle *= 250 / np.linalg.norm(middle, axis=2, keepdims=True)
    ball = (middle + rng.normal(0, 8, (n_targets, DOTS, 3))).reshape(-1, 3)
    rotation, shift = random_rotations(n_placements, rng), rng.uniform(-300, 300, (n_placements, 3))
    placement, dot = np.nonzero(np.repeat(seen, DOTS, axis=1))
    points = np.einsum("fij,fj->fi", rotation[placement], ball[dot]) + shift[placement]
    points += noise_mm * rng.normal(size=points.shape)
    features = Features(placement, 1 + dot // DOTS, dot % DOTS, np.arange(len(dot)))
    return Turned(features, points, rotation, shift)


def everything(n_placements: int, n_targets: int) -> np.ndarray:
    return np.ones((n_placements, n_targets), dtype=bool)


def assert_motions(ball: Turned, found, placements: list[int], atol: float = 1e-9) -> None:
    """The found motions carry each root's ball to these placements as the truth does."""
    for t in placements:
        root = found.root[t]
        turn = ball.rotation[t] @ ball.rotation[root].T
        np.testing.assert_allclose(found.rotation[t], turn, atol=atol)
        np.testing.assert_allclose(found.translation[t], ball.shift[t] - turn @ ball.shift[root], atol=1e3 * atol)


def test_placements_are_aligned_to_one() -> None:
    ball = turned_ball(everything(4, 10))
    found = align(ball.features, ball.points, 4, 4)
    assert len(np.unique(found.root)) == 1
    assert found.moved.sum() == 3
    assert_motions(ball, found, [0, 1, 2, 3])
    assert (found.shared[np.triu_indices(4, 1)] == 80).all()
    root = found.root[0]
    np.testing.assert_array_equal(found.rotation[root], np.eye(3))
    np.testing.assert_array_equal(found.translation[root], 0.0)
    expected = [np.rad2deg(np.arccos((np.trace(found.rotation[t]) - 1) / 2)) for t in np.flatnonzero(found.moved)]
    np.testing.assert_allclose(found.turned_deg, expected, rtol=1e-6)


def test_a_chain_of_overlaps_is_enough() -> None:
    """Each placement shares targets with its neighbours only: the motions follow along the tree."""
    seen = np.zeros((6, 30), dtype=bool)
    for t in range(6):
        seen[t, 4 * t : 4 * t + 8] = True
    ball = turned_ball(seen)
    found = align(ball.features, ball.points, 6, 6)
    assert len(np.unique(found.root)) == 1
    assert found.shared[0, 1] == 4 * DOTS
    assert found.shared[0, 3] == 0
    assert_motions(ball, found, list(range(6)), atol=1e-8)


def test_the_tree_takes_the_pairs_that_share_most() -> None:
    """A pair with few, noisy dots in common stays out where a better way round exists."""
    seen = np.zeros((3, 30), dtype=bool)
    seen[0, :20], seen[1, 5:30], seen[2, 17:30] = True, True, True  # 0-1: 15 targets, 1-2: 13, 0-2: 3
    ball = turned_ball(seen)
    of_few = (ball.features.placement == 2) & (ball.features.target <= 20)
    points = ball.points + np.where(of_few[:, None], np.random.default_rng(0).normal(0, 2.0, ball.points.shape), 0.0)
    found = align(ball.features, points, 3, 3)
    assert found.root[0] == found.root[1] == found.root[2] == 1
    good = replace(ball, points=points)
    assert_motions(good, found, [0, 1])
    turn = ball.rotation[2] @ ball.rotation[1].T
    assert np.rad2deg(np.arccos((np.trace(found.rotation[2].T @ turn) - 1) / 2)) < 0.1


def test_blunders_do_no_harm() -> None:
    """A tenth of the dots metres away, others centimetres: those that agree decide."""
    ball = turned_ball(everything(3, 12), noise_mm=0.02)
    rng = np.random.default_rng(1)
    off = rng.permutation(len(ball.points))[: len(ball.points) // 10]
    points = ball.points.copy()
    points[off] += rng.normal(0, 1, (len(off), 3)) * np.where(rng.random((len(off), 1)) < 0.5, 3000, 20)
    found = align(ball.features, points, 3, 3)
    assert len(np.unique(found.root)) == 1
    assert_motions(ball, found, [0, 1, 2], atol=3e-4)  # 0.02 mm on a ball of 250 mm


def test_unknown_points_are_not_shared() -> None:
    ball = turned_ball(everything(2, 10))
    points = np.where(
        (ball.features.placement == 1)[:, None] & (ball.features.target <= 6)[:, None], np.nan, ball.points
    )
    found = align(ball.features, points, 2, 2)
    assert found.shared[0, 1] == 4 * DOTS
    assert_motions(ball, found, [0, 1])


@pytest.mark.parametrize(
    ("targets", "dots", "linked"),
    [(2, 8, False), (3, 8, True), (11, 1, False), (12, 1, True), (1, 8, False), (0, 0, False)],
)
def test_too_few_shared_dots_align_nothing(targets: int, dots: int, linked: bool) -> None:
    """Fewer than 12 dots or than three targets: their turn would be noise."""
    own = 14
    seen = np.zeros((2, targets + 2 * own), dtype=bool)
    seen[:, :targets] = True
    seen[0, targets : targets + own] = True
    seen[1, targets + own :] = True
    ball = turned_ball(seen, noise_mm=0.01)
    keep = (ball.features.target > targets) | (ball.features.point < dots)
    f = ball.features
    features = Features(f.placement[keep], f.target[keep], f.point[keep], np.arange(keep.sum()))
    found = align(features, ball.points[keep], 2, 2)
    assert found.shared[0, 1] == targets * dots
    assert (targets * dots >= LEAST_SHARED and targets >= 3) == linked
    assert found.moved.sum() == linked


def test_groups_of_placements_have_roots_of_their_own() -> None:
    seen = np.zeros((5, 20), dtype=bool)
    seen[[0, 2], :10] = True
    seen[[1, 3, 4], 10:] = True
    ball = turned_ball(seen)
    found = align(ball.features, ball.points, 5, 5)
    assert found.root[0] == found.root[2]
    assert found.root[1] == found.root[3] == found.root[4]
    assert found.root[0] != found.root[1]
    assert found.moved.sum() == 3
    assert_motions(ball, found, [0, 1, 2, 3, 4])


def test_bar_poses_are_left_alone() -> None:
    """A bar's poses show the same marks again and again; they are no placements of the ball."""
    ball = turned_ball(everything(6, 10))
    found = align(ball.features, ball.points, 6, 3)  # the last three are a bar's
    assert found.root[3:].tolist() == [3, 4, 5]
    np.testing.assert_array_equal(found.rotation[3:], np.tile(np.eye(3), (3, 1, 1)))
    assert (found.shared[3:] == 0).all() and (found.shared[:, 3:] == 0).all()
    assert found.moved.sum() == 2


def test_600_placements_are_aligned_in_seconds() -> None:
    rng = np.random.default_rng(0)
    seen = np.zeros((600, 200), dtype=bool)
    for t in range(600):
        seen[t, rng.permutation(200)[:40]] = True
    ball = turned_ball(seen, noise_mm=0.02)
    begin = time.process_time()
    found = align(ball.features, ball.points, 600, 600)
    assert time.process_time() - begin < 10.0
    assert len(np.unique(found.root)) == 1
    assert_motions(ball, found, list(range(0, 600, 50)), atol=2e-3)


@dataclass(frozen=True)
class Rig:
    """A small network seen without noise: the free network, its features, its truth, and the ball behind it."""

    network: Network
    features: Features
    truth: State
    ball: Turned


def small_rig(noise_px: float = 0.0, n_targets: int = 14, n_placements: int = 3, bars: int = 0, seed: int = 0) -> Rig:
    """Five cameras around a ball of dots without faces: each dot is in two cameras at least."""
    rng = np.random.default_rng(seed)
    ball = turned_ball(everything(n_placements + bars, n_targets), seed)
    n = 5
    rotation, translation = np.empty((n, 3, 3)), np.empty((n, 3))
    for c in range(n):
        place = 1500 * np.array([np.cos(2 * np.pi * c / n), np.sin(2 * np.pi * c / n), rng.uniform(0.5, 1.0)])
        rotation[c] = look_at(place, rng.normal(0, 100, 3), rng.normal(size=3))
        translation[c] = -rotation[c] @ place
    intrinsics = np.zeros((n, 16))
    intrinsics[:, :4] = 1500, 1500, 640, 512
    intrinsics[:, 4] = -0.1
    seen = rng.random((len(ball.points), n)) < 0.7
    for row in seen:
        row[rng.permutation(n)[:2]] = True
    feature, camera = np.nonzero(seen)
    features = replace(ball.features, of_observation=feature)
    x = np.einsum("nij,nj->ni", rotation[camera], ball.points[feature]) + translation[camera]
    uv = project(x, intrinsics[camera]) + noise_px * rng.normal(size=(len(feature), 2))
    free = np.tile(estimated_mask("brown"), (n, 1))
    network = free_network(feature, camera, uv, len(ball.points), free, np.arange(n))
    return Rig(network, features, State(rotation, translation, intrinsics, ball.points), ball)


def residuals(network: Network, state: State) -> FloatArray:
    return project(network.camera_points(state), state.intrinsics[network.camera]) - network.uv


def test_a_shared_shape_predicts_the_same_images() -> None:
    """Between the two forms nothing is lost: from the free truth to the ball's dots and back."""
    rig = small_rig(bars=2)
    alignment = align(rig.features, rig.truth.points, 5, 3)
    rigid, start = share_shape(rig.network, rig.features, rig.truth, alignment)
    assert np.isnan(start.points).all()
    dots = 14 * DOTS
    assert rigid.network.n_features == 3 * dots  # of the ball, and of two bar poses that stand for themselves
    assert len(rigid.network.ball.free_placement) == 3  # the world and two that moved
    assert rigid.network.ball.free_placement.tolist() == [False, True, True]
    assert (rigid.network.ball.placement[rig.features.placement[rig.network.feature] >= 3] == 0).all()
    triangulated = replace(
        start, points=rigid.network.triangulated(start, np.ones(len(rig.network.uv), dtype=bool)).points
    )
    np.testing.assert_allclose(residuals(rigid.network, triangulated), 0.0, atol=1e-6)
    again = rigid.as_features(triangulated)
    assert len(again.placement_rotation) == 0
    np.testing.assert_allclose(again.points, rig.truth.points, atol=1e-5)
    np.testing.assert_allclose(residuals(rig.network, again), 0.0, atol=1e-6)


def test_a_rigid_network_may_be_seen_from_any_camera() -> None:
    rig = small_rig(bars=1)
    rigid, start = share_shape(rig.network, rig.features, rig.truth, align(rig.features, rig.truth.points, 4, 3))
    state = replace(start, points=rigid.network.triangulated(start, np.ones(len(rig.network.uv), dtype=bool)).points)
    for camera in range(5):
        moved = state.seen_from(camera)
        np.testing.assert_allclose(moved.rotation[camera], np.eye(3), atol=1e-12)
        np.testing.assert_allclose(moved.translation[camera], 0.0, atol=1e-9)
        assert moved.placement_rotation is not None and moved.placement_translation is not None
        np.testing.assert_allclose(moved.placement_rotation[0], np.eye(3), atol=1e-12)  # the world stays the world
        np.testing.assert_allclose(moved.placement_translation[0], 0.0, atol=1e-9)
        np.testing.assert_allclose(residuals(rigid.network, moved), residuals(rigid.network, state), atol=1e-8)
        of_features = replace(rig.truth, points=rigid.as_features(state).points).seen_from(camera)
        np.testing.assert_allclose(rigid.as_features(moved).points, of_features.points, atol=1e-8)


def test_without_noise_the_truth_is_found_from_afar() -> None:
    rig = small_rig()
    rng = np.random.default_rng(5)
    rigid, start = share_shape(rig.network, rig.features, rig.truth, align(rig.features, rig.truth.points, 3, 3))
    assert start.placement_translation is not None
    step = np.zeros(16)
    step[:9] = 15, 15, 8, 8, 0.02, 0.02, 1e-4, 1e-4, 0.01
    spoilt = replace(
        start,
        rotation=exp_rotation(rng.normal(0, 2e-3, (5, 3))) @ start.rotation,
        translation=start.translation + rng.normal(0, 3.0, (5, 3)),
        intrinsics=start.intrinsics + step * rng.normal(size=(5, 16)),
        placement_translation=start.placement_translation + np.array([[0, 0, 0], [3, -3, 2], [-2, 1, 4]]),
    )
    everything_used = np.ones(len(rig.network.uv), dtype=bool)
    spoilt = replace(spoilt, points=rigid.network.triangulated(spoilt, everything_used).points)
    adjusted = refine(replace(rigid.network), spoilt, everything_used, np.ones(5, dtype=bool), Context())
    assert adjusted.used.all()
    np.testing.assert_allclose(adjusted.state.intrinsics[:, :9], rig.truth.intrinsics[:, :9], atol=1e-2)
    assert adjusted.minimum.cost < 1e-8


def test_a_shared_shape_needs_fewer_unknowns_and_is_surer() -> None:
    rig = small_rig(noise_px=0.05)
    placed, used = np.ones(5, dtype=bool), np.ones(len(rig.network.uv), dtype=bool)
    free = refine(rig.network, rig.truth, used, placed, Context())
    alignment = align(rig.features, free.state.points, 3, 3)
    rigid, start = share_shape(rig.network, rig.features, free.state, alignment)
    one = refine(rigid.network, start, free.used, placed, Context())
    dots = 14 * DOTS
    assert free.used.all() and one.used.all()
    assert free.redundancy == 2 * len(used) - 15 * 5 - 3 * 3 * dots + 7
    assert one.redundancy == 2 * len(used) - 15 * 5 - 3 * dots - 2 * 6 + 7
    assert one.variance == pytest.approx(0.05**2, rel=4 * np.sqrt(2 / one.redundancy))
    surer, sure = (covariance(a.problem, a.state, places) for a, places in ((one, rigid.places), (free, None)))
    assert surer is not None and sure is not None
    assert (np.einsum("cii->ci", surer.cameras) < np.einsum("cii->ci", sure.cameras)).mean() > 0.9
    score = (one.state.intrinsics - rig.truth.intrinsics)[:, one.problem.intrinsic_columns] ** 2
    score /= one.variance * np.einsum("cii->ci", surer.cameras)[:, 6:]
    assert 0.3 < score.mean() < 2.0
