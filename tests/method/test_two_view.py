"""The two-view gate: wrong matches are voted out, the same way every time."""

from dataclasses import dataclass

import numpy as np
import pytest

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.errors import Cancelled
from spherecal.data.observations import find_features
from spherecal.geometry.camera import camera_matrix
from spherecal.geometry.rotation import cross_matrix
from spherecal.initialise.two_view import (
    GATE_PX,
    MIN_POINTS_A_PAIR,
    TwoViewGate,
    epipolar_distance,
    robust_fundamental,
    vote,
)
from spherecal.initialise.view_graph import common_counts
from tests.networks import observed, simulated

OUTLIERS = [0.005, 0.02, 0.05]


@dataclass(frozen=True)
class Case:
    """The gate's input from a simulated session, which matches are wrong, true fundamental matrices."""

    table: IntArray
    uv: FloatArray
    wrong: np.ndarray
    counts: IntArray
    epipolar: dict[tuple[int, int], FloatArray]

    def vote(self, seed: int = 0, context: Context | None = None) -> TwoViewGate:
        return vote(self.table, self.uv, self.counts, GATE_PX, seed, context or Context())


def gate_case(preset: str, fraction: float) -> Case:
    session, truth = simulated(preset, targets=200, outlier_fraction=fraction)
    o = observed(session)
    features = find_features(o)
    table = np.full((len(o.cameras), len(features)), -1)
    table[o.camera, features.of_observation] = np.arange(len(o))
    epipolar = {}
    for i, a in enumerate(truth.cameras):
        for j, b in enumerate(truth.cameras[i + 1 :], start=i + 1):
            turn = b.rotation @ a.rotation.T
            essential = cross_matrix(b.translation_mm - turn @ a.translation_mm) @ turn
            epipolar[i, j] = (
                np.linalg.inv(camera_matrix(b.intrinsics)).T @ essential @ np.linalg.inv(camera_matrix(a.intrinsics))
            )
    return Case(table, o.uv, truth.outlier, common_counts(table >= 0), epipolar)


@pytest.fixture(scope="module", params=OUTLIERS)
def spoilt(request: pytest.FixtureRequest) -> tuple[Case, TwoViewGate]:
    case = gate_case("rigA", request.param)
    return case, case.vote()


def test_right_matches_are_kept(spoilt: tuple[Case, TwoViewGate]) -> None:
    case, gate = spoilt
    assert gate.keep[~case.wrong].mean() > 0.99


def test_wrong_matches_are_voted_out(spoilt: tuple[Case, TwoViewGate]) -> None:
    """Those that the true geometry shows in most of their pairs: an error along the epipolar line shows in none."""
    case, gate = spoilt
    shown, kept = 0, 0
    for column in case.table.T:
        cameras = np.flatnonzero(column >= 0)
        for c in cameras[case.wrong[column[cameras]]]:
            pairs = [(min(c, o), max(c, o)) for o in cameras if o != c]
            rows = [(column[i], column[j]) for i, j in pairs]
            distance = [
                epipolar_distance(case.epipolar[pair], case.uv[[a]], case.uv[[b]])[0]
                for pair, (a, b) in zip(pairs, rows, strict=True)
            ]
            # the estimated epipolar lines have to swallow the distortion, some 10 px
            if len(pairs) >= 2 and np.mean(np.array(distance) > 3 * GATE_PX) > 0.5:
                shown += 1
                kept += bool(gate.keep[column[c]])
    assert shown > 0.3 * case.wrong.sum()
    assert kept == 0


def test_consistent_matches_of_a_pair_agree_with_the_true_geometry(spoilt: tuple[Case, TwoViewGate]) -> None:
    case, gate = spoilt
    worst = []
    for (i, j), features in gate.consistent.items():
        assert i < j
        assert case.counts[i, j] >= MIN_POINTS_A_PAIR
        rows = case.table[:, features]
        assert (rows[[i, j]] >= 0).all()
        assert (np.diff(features) > 0).all()
        true = epipolar_distance(case.epipolar[i, j], case.uv[rows[i]], case.uv[rows[j]])
        bad = case.wrong[rows[i]] | case.wrong[rows[j]]
        worst.append((true[bad] > 5 * GATE_PX).sum() / max(len(features), 1))
    assert np.mean(worst) < 0.002


def test_clean_matches_are_all_kept() -> None:
    for preset in ("rigA", "rigB"):
        case = gate_case(preset, 0.0)
        gate = case.vote()
        assert gate.keep.mean() > 0.995
        common = [len(gate.consistent[pair]) / case.counts[pair] for pair in gate.consistent if case.counts[pair] > 20]
        assert np.mean(common) > 0.98


def test_same_seed_same_votes(spoilt: tuple[Case, TwoViewGate]) -> None:
    case, gate = spoilt
    again = case.vote()
    assert np.array_equal(gate.keep, again.keep)
    assert gate.consistent.keys() == again.consistent.keys()
    assert all(np.array_equal(gate.consistent[pair], again.consistent[pair]) for pair in gate.consistent)
    other = case.vote(seed=12345)
    assert (other.keep == gate.keep).mean() > 0.99


def test_votes_do_not_depend_on_what_opencv_drew_before(spoilt: tuple[Case, TwoViewGate]) -> None:
    import cv2

    case, gate = spoilt
    cv2.setRNGSeed(99)
    cv2.randu(np.zeros(1000), np.zeros(1), np.ones(1))
    assert np.array_equal(case.vote().keep, gate.keep)


def test_common_features_of_a_triple(spoilt: tuple[Case, TwoViewGate]) -> None:
    _, gate = spoilt
    for cameras in ((0, 1, 5), (5, 1, 0), (2, 7, 8)):
        i, j, k = sorted(cameras)
        expected = set(gate.consistent[i, j]) & set(gate.consistent[i, k]) & set(gate.consistent[j, k])
        common = gate.common(cameras)
        assert common.tolist() == sorted(expected)
        assert len(common) > 0
    lonely = TwoViewGate(gate.keep, {pair: f for pair, f in gate.consistent.items() if 3 not in pair})
    assert len(lonely.common((2, 3, 4))) == 0


def test_pairs_with_too_few_matches_have_no_say() -> None:
    rng = np.random.default_rng(0)
    table = np.arange(14).reshape(2, 7)
    gate = vote(table, rng.uniform(0, 1000, (14, 2)), np.full((2, 2), 7), GATE_PX, 0, Context())
    assert gate.keep.all()
    assert gate.consistent == {}


def two_views(n: int, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Image points of both cameras and the true fundamental matrix of two simulated cameras."""
    _, truth = simulated("rigA")
    a, b = truth.cameras[0], truth.cameras[1]
    x = np.random.default_rng(seed).uniform(truth.volume_mm[0], truth.volume_mm[1], (n, 3)) * 0.6
    uv, matrix = [], []
    for c in (a, b):
        k = camera_matrix(c.intrinsics)
        h = (x @ c.rotation.T + c.translation_mm) @ k.T
        uv.append(h[:, :2] / h[:, 2:])
        matrix.append(k)
    turn = b.rotation @ a.rotation.T
    essential = cross_matrix(b.translation_mm - turn @ a.translation_mm) @ turn
    return uv[0], uv[1], np.linalg.inv(matrix[1]).T @ essential @ np.linalg.inv(matrix[0])


def test_epipolar_distance_is_that_of_the_farther_line() -> None:
    a, b, f = two_views(30)
    np.testing.assert_allclose(epipolar_distance(f, a, b), 0.0, atol=1e-6)
    np.testing.assert_allclose(epipolar_distance(1e-5 * f, a, b), 0.0, atol=1e-6)
    off = b + np.array([3.0, -4.0])
    distances = []
    for p, q in zip(a, off, strict=True):
        in_b, in_a = f @ [*p, 1.0], f.T @ [*q, 1.0]
        distances.append(max(abs(in_b @ [*q, 1]) / np.hypot(*in_b[:2]), abs(in_a @ [*p, 1]) / np.hypot(*in_a[:2])))
    np.testing.assert_allclose(epipolar_distance(f, a, off), distances, rtol=1e-9)
    assert max(distances) > 1


def test_epipolar_distance_without_a_line_is_infinite() -> None:
    assert np.isinf(epipolar_distance(np.zeros((3, 3)), np.ones((2, 2)), np.ones((2, 2)))).all()


@pytest.mark.parametrize("share", [0.0, 0.2, 0.4])
def test_fundamental_matrix_survives_wrong_matches(share: float) -> None:
    a, b, _ = two_views(200)
    rng = np.random.default_rng(1)
    wrong = np.arange(200) < 200 * share
    spoilt = b + rng.normal(0, 0.3, b.shape)
    spoilt[wrong] = rng.permutation(spoilt[wrong])
    found = robust_fundamental(a, spoilt, 3.0, 0)
    assert found is not None
    assert epipolar_distance(found, a[~wrong], b[~wrong]).max() < 3.0
    if wrong.any():
        assert np.median(epipolar_distance(found, a[wrong], spoilt[wrong])) > 3.0


def test_points_without_a_fundamental_matrix_raise_nothing() -> None:
    a, b, _ = two_views(30)
    line = np.column_stack([np.arange(30.0), np.arange(30.0)])
    cases = [
        (a[:6], b[:6]),
        (np.zeros((20, 2)), np.zeros((20, 2))),
        (line, line),
        (a, np.zeros_like(b)),
        (a[:0], b[:0]),
    ]
    for left, right in cases:
        found = robust_fundamental(left, right, 3.0, 0)
        assert found is None or found.shape == (3, 3)
    assert robust_fundamental(a[:6], b[:6], 3.0, 0) is None
    table = np.arange(40).reshape(2, 20)
    gate = vote(table, np.zeros((40, 2)), np.full((2, 2), 20), GATE_PX, 0, Context())
    assert gate.keep.shape == (40,)


def test_gate_can_be_cancelled() -> None:
    case = gate_case("rigA", 0.0)
    with pytest.raises(Cancelled):
        case.vote(context=Context(is_cancelled=lambda: True))
