"""The robust gate before any reconstruction: with 2 % wrong matches the factorisation lost cameras in every trial."""

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context

# A fundamental matrix of linear cameras must swallow the distortion that is not known yet: 12 px kept all good points
# of rigs with 2.3 % of distortion in the corners, where 3 px lost a tenth of them.
GATE_PX = 12.0
# Enough to estimate seven numbers many times over; more only costs time (0.3 ms per 100 points).
MOST_POINTS_A_PAIR = 600
MIN_POINTS_A_PAIR = 8
MIN_IN_FRONT = 0.8  # of the points of a pair: of the four poses of an essential matrix one has all


@dataclass(frozen=True)
class TwoViewGate:
    """What the two-view geometry supports: observations (n,), and for each pair (i < j) its consistent features."""

    keep: BoolArray
    consistent: dict[tuple[int, int], IntArray]

    def common(self, cameras: tuple[int, int, int]) -> IntArray:
        """Features on which all three pairs of a triple agree, sorted."""
        i, j, k = sorted(cameras)
        none = np.zeros(0, dtype=np.int64)
        first, second, third = (self.consistent.get(pair, none) for pair in ((i, j), (i, k), (j, k)))
        return np.intersect1d(np.intersect1d(first, second, assume_unique=True), third, assume_unique=True)


def vote(
    feature_table: IntArray, flat: FloatArray, counts: IntArray, gate_px: float, seed: int, context: Context
) -> TwoViewGate:
    """Observations that at least half of their pairs of cameras find consistent (MAGSAC on fundamental matrices)."""
    agreed, asked = np.zeros(len(flat)), np.zeros(len(flat))
    consistent = {}
    pairs = [(i, j) for i, j in combinations(range(len(counts)), 2) if counts[i, j] >= MIN_POINTS_A_PAIR]
    for number, (i, j) in enumerate(pairs):
        context.report("two-view gate", number / len(pairs))
        common = np.flatnonzero((feature_table[i] >= 0) & (feature_table[j] >= 0))
        a, b = feature_table[i, common], feature_table[j, common]
        some = np.linspace(0, len(a) - 1, min(len(a), MOST_POINTS_A_PAIR)).astype(int)
        fundamental = robust_fundamental(flat[a[some]], flat[b[some]], gate_px, seed)
        good = np.zeros(len(a), dtype=bool)
        if fundamental is not None:
            good = epipolar_distance(fundamental, flat[a], flat[b]) <= gate_px
        consistent[i, j] = common[good]
        for rows in (a, b):
            agreed[rows] += good
            asked[rows] += 1
    return TwoViewGate(2 * agreed >= asked, consistent)


def robust_fundamental(a: FloatArray, b: FloatArray, gate_px: float, seed: int) -> FloatArray | None:
    """F with b' F a = 0 of matches (k,2) px by MAGSAC, None where they define none; deterministic for a seed."""
    parameters = cv2.UsacParams()
    parameters.threshold = gate_px
    parameters.confidence = 0.9999
    parameters.maxIterations = 2000
    parameters.score = cv2.SCORE_METHOD_MAGSAC
    parameters.sampler = cv2.SAMPLING_UNIFORM
    parameters.loMethod = cv2.LOCAL_OPTIM_SIGMA
    parameters.randomGeneratorState = seed + 1
    try:
        fundamental, _ = cv2.findFundamentalMat(a, b, parameters)
    except cv2.error:
        return None
    return None if fundamental is None or fundamental.shape != (3, 3) else np.asarray(fundamental, dtype=float)


def epipolar_distance(fundamental: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """The larger of a match's two distances from its epipolar lines in pixels, (k,)."""
    a1, b1 = np.column_stack([a, np.ones(len(a))]), np.column_stack([b, np.ones(len(b))])
    in_b, in_a = a1 @ fundamental.T, b1 @ fundamental
    product = np.abs((b1 * in_b).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = product / np.minimum(np.linalg.norm(in_b[:, :2], axis=1), np.linalg.norm(in_a[:, :2], axis=1))
    return np.where(np.isfinite(distance), distance, np.inf)


@dataclass(frozen=True)
class Pair:
    """Two cameras (indices) and the pose of the second in the frame of the first, whose distance is the unit."""

    cameras: tuple[int, int]
    rotation: FloatArray
    translation: FloatArray


def relative_orientation(
    cameras: tuple[int, int], a: FloatArray, b: FloatArray, focal_px: float, seed: int
) -> Pair | None:
    """The relative orientation of two cameras by normalised matches (k,2); None where most are not in front of both.

    The essential matrix is the one nearest to MAGSAC's F.
    """
    fundamental = robust_fundamental(focal_px * a, focal_px * b, GATE_PX, seed)
    if fundamental is None:
        return None
    scale = np.array([focal_px, focal_px, 1.0])
    u, _, vt = np.linalg.svd(scale[:, None] * fundamental * scale)
    essential = u @ np.diag([1.0, 1.0, 0.0]) @ vt
    front, rotation, translation, _ = cv2.recoverPose(essential, np.ascontiguousarray(a), np.ascontiguousarray(b))
    if front < MIN_IN_FRONT * len(a):
        return None
    return Pair(cameras, np.asarray(rotation, dtype=float), np.asarray(translation, dtype=float).ravel())
