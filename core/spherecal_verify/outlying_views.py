"""Triangulation of few but important points: gross errors in single views are found and left out."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.transform import PosedCameras
from spherecal.geometry.triangulation import Triangulation, triangulate

# A good view exceeds 4.5 standard deviations once in 25 000 (two coordinates), and no view within 0.15 px is gross:
# the limits that kept all good points and missed none of 0.5 % to 5 % outliers in the adjustment's trials.
_GATE_SIGMAS = 4.5
_GATE_PX = 0.15
# From 30 redundant observations on, a standard deviation is known to 1/sqrt(2 * 30) = 13 %.
LEAST_REDUNDANCY = 30
_MEDIAN_TO_SIGMA = 1.1774  # the median length of (x, y), both normal with sigma 1


@dataclass(frozen=True)
class Views:
    """Row i shows point `feature[i]` at `uv[i]` (n, 2), sigma[i] (n, 2) px, in camera `camera[i]` of `cameras`."""

    feature: IntArray
    camera: IntArray
    uv: FloatArray
    sigma: FloatArray
    n_features: int
    cameras: PosedCameras

    @property
    def intrinsics(self) -> FloatArray:
        """The cameras' lenses (c, 16)."""
        return self.cameras.intrinsics

    @property
    def rotation(self) -> FloatArray:
        """The cameras' rotations (c, 3, 3) from the world to the camera."""
        return self.cameras.rotation

    @property
    def translation(self) -> FloatArray:
        """The cameras' translations (c, 3) from the world to the camera, mm."""
        return self.cameras.translation

    def triangulate(self, keep: BoolArray) -> Triangulation:
        """The points (m,) from the views to keep (n,); the residuals are those of all views."""
        return self._triangulate(self.feature, np.arange(len(self.uv)), keep, self.n_features)

    def _triangulate(self, feature: IntArray, rows: IntArray, keep: BoolArray, n_features: int) -> Triangulation:
        weight = keep[:, None] / self.sigma[rows] ** 2
        return triangulate(feature, self.camera[rows], self.uv[rows], weight, n_features, self.cameras)

    def leaving_one_out(self, rows: IntArray) -> Triangulation:
        """For k views of one point: k points, the i-th without view i; residuals (k * k, 2), the i-th block for it."""
        k = len(rows)
        return self._triangulate(np.repeat(np.arange(k), k), np.tile(rows, k), ~np.eye(k, dtype=bool).ravel(), k)


@dataclass(frozen=True)
class CheckedPoints:
    """Points, the views they rest on (`kept`, (n,)), those given up (`contradicting`, (m,)), noise in sigmas."""

    views: Views
    points: Triangulation
    kept: BoolArray
    contradicting: BoolArray
    noise: float


def triangulate_checked(views: Views, expected_noise: float) -> CheckedPoints:
    """The points without a view without which the others agree; given up where none can be told to be wrong."""
    kept = np.ones(len(views.uv), dtype=bool)
    contradicting = np.zeros(views.n_features, dtype=bool)
    points = views.triangulate(kept)
    noise = robust_noise(views, points, expected_noise)
    gate = np.maximum(_GATE_SIGMAS * noise * views.sigma.max(axis=1), _GATE_PX)
    while True:
        gross = kept & (np.linalg.norm(points.residual, axis=1) > gate)
        suspects = np.unique(views.feature[gross])
        suspects = suspects[~contradicting[suspects]]
        if not len(suspects):
            break
        for feature in suspects:
            rows = np.flatnonzero(kept & (views.feature == feature))
            wrong = _wrong_view(views, rows, gate[rows])
            if wrong is None:
                contradicting[feature] = True
            else:
                kept[rows[wrong]] = False
        points = views.triangulate(kept)
    good = kept & ~contradicting[views.feature] & np.isfinite(points.residual[:, 0])
    return CheckedPoints(views, points, good, contradicting, weighted_noise(views, points, good, expected_noise))


def _wrong_view(views: Views, rows: IntArray, gate: FloatArray) -> int | None:
    """Which of the k views of one point to leave out; None where that cannot be decided."""
    k = len(rows)
    if k < 3:
        return None
    without = views.leaving_one_out(rows)
    residual = without.residual.reshape(k, k, 2)
    others = ~np.eye(k, dtype=bool)
    agree = ((np.linalg.norm(residual, axis=2) <= gate) | ~others).all(axis=1)
    if k == 3 and agree.sum() != 1:
        return None
    cost = ((residual / views.sigma[rows]) ** 2).sum(axis=2)
    total = np.where(others, cost, 0.0).sum(axis=1)
    return int(np.argmin(np.where(np.isfinite(total), total, np.inf)))


def _redundancy(views: Views, points: Triangulation, kept: BoolArray) -> int:
    found = np.unique(views.feature[kept & np.isfinite(points.residual[:, 0])])
    return 2 * int((kept & np.isin(views.feature, found)).sum()) - 3 * len(found)


def robust_noise(views: Views, points: Triangulation, expected: float) -> float:
    """The noise in units of sigma from the median residual, on which gross errors have little effect."""
    found = np.isfinite(points.residual[:, 0])
    redundancy = _redundancy(views, points, found)
    if redundancy < LEAST_REDUNDANCY:
        return expected
    size = np.linalg.norm(points.residual[found] / views.sigma[found], axis=1)
    return float(np.median(size)) / _MEDIAN_TO_SIGMA / float(np.sqrt(redundancy / (2 * found.sum())))


def weighted_noise(views: Views, points: Triangulation, kept: BoolArray, expected: float) -> float:
    """The noise in units of sigma of the views kept: sqrt(v'Pv / redundancy)."""
    redundancy = _redundancy(views, points, kept)
    if redundancy < LEAST_REDUNDANCY:
        return expected
    return float(np.sqrt(((points.residual[kept] / views.sigma[kept]) ** 2).sum() / redundancy))
