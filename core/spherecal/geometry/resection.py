"""Resection: the pose of one camera from points that are known already."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.geometry.rotation import cross, exp_rotation

# Fewest points a resected camera must agree with: six unknowns, and chance agreement of wrong matches at 12 px.
MIN_AGREEING = 6
# Samples of three points from which poses are proposed: with 40 % wrong points all three are good in a fifth of them.
SAMPLES = 120
# Points that score the proposals, and how many of the best are refined.
SCORED_POINTS, REFINED = 200, 12
# Poses nearer to each other than this are one: angle, and distance of the centres over that of the points.
SAME_ANGLE_RAD, SAME_SHIFT = np.deg2rad(1.0), 0.01
# A residual of this many scales, or a point behind the camera, costs no more than this.
_MOST_SCALES = 1e3
# The losses by which a proposal is refined, in scales, and the most steps with each. Proposals from three points of a
# small patch are off by tens of scales: a wide loss first keeps all points in. But it leads from a second minimum into
# the best one, hence also without.
WIDENINGS, STEPS = ((1.0,), (30.0, 3.0, 1.0)), 15


@dataclass(frozen=True)
class ResectedPose:
    """x_camera = rotation (3,3) @ x + translation (3,); `cost`: half the sum of log(1 + (residual / scale)^2)."""

    rotation: FloatArray
    translation: FloatArray
    cost: float


def resect(points: FloatArray, xy: FloatArray, gate: float) -> tuple[FloatArray, FloatArray, int] | None:
    """R (3, 3), t (3,) and number of agreeing points (n, 3) seen at normalised `xy` (n, 2); None for too few."""
    if len(points) < MIN_AGREEING:
        return None
    found, agreeing = False, None
    rotation = translation = np.zeros(3)
    for method in (cv2.SOLVEPNP_SQPNP, cv2.SOLVEPNP_EPNP):
        cv2.setRNGSeed(1)
        try:
            found, rotation, translation, agreeing = cv2.solvePnPRansac(
                points, xy, np.eye(3), None, reprojectionError=gate, iterationsCount=300, flags=method
            )
            break
        except cv2.error:  # the first method refuses image points as close together as the dots of one target
            continue
    if not found or agreeing is None or len(agreeing) < MIN_AGREEING:
        return None
    some = np.asarray(agreeing, dtype=np.int64).ravel()
    rotation, translation = cv2.solvePnPRefineLM(points[some], xy[some], np.eye(3), None, rotation, translation)
    if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
        return None
    turn, shift = (np.asarray(part, dtype=float).ravel() for part in (rotation, translation))
    return exp_rotation(turn), shift, len(some)


def resected_poses(points: FloatArray, xy: FloatArray, scale: float) -> list[ResectedPose]:
    """All distinct poses that points (n,3) at ideal image points (n,2) suggest, likeliest first; none for three.

    P3P on random triples (X. Gao et al., Complete solution classification for the perspective-three-point problem,
    2003), scored by Cauchy's loss and refined. Few points, or points near a plane, have a second pose that fits nearly
    as well; who takes the first must look at the second. Deterministic.
    """
    if len(points) < 4:
        return []
    rng = np.random.default_rng(0)
    some = rng.permutation(len(points))[:SCORED_POINTS]
    rotations, translations = [], []
    for _ in range(SAMPLES):
        three = rng.choice(len(points), 3, replace=False)
        count, vectors, shifts = cv2.solveP3P(points[three], xy[three], np.eye(3), None, flags=cv2.SOLVEPNP_AP3P)
        for vector, shift in zip(vectors[:count], shifts[:count], strict=False):
            if np.isfinite(vector).all() and np.isfinite(shift).all():
                rotations.append(exp_rotation(np.asarray(vector, dtype=float).ravel()))
                translations.append(np.asarray(shift, dtype=float).ravel())
    if not rotations:
        return []
    rotation, translation = np.array(rotations), np.array(translations)
    left = np.argsort(_costs(rotation, translation, points[some], xy[some], scale), kind="stable")
    distinct: list[ResectedPose] = []
    while len(left) and len(distinct) < REFINED:
        best = ResectedPose(rotation[left[0]], translation[left[0]], 0.0)
        distinct.append(best)
        left = left[~_same(rotation[left], translation[left], best, points)]
    refined = [_refined(pose, points, xy, scale, losses) for losses in WIDENINGS for pose in distinct]
    refined.sort(key=lambda pose: pose.cost)
    kept: list[ResectedPose] = []
    for pose in refined:
        if not any(_same(pose.rotation[None], pose.translation[None], other, points)[0] for other in kept):
            kept.append(pose)
    return kept


def pose_cost(rotation: FloatArray, translation: FloatArray, points: FloatArray, xy: FloatArray, scale: float) -> float:
    """The cost of a pose as `ResectedPose` has it: half the sum of log(1 + (residual / scale)^2)."""
    return float(_costs(rotation[None], translation[None], points, xy, scale)[0])


def _costs(
    rotation: FloatArray, translation: FloatArray, points: FloatArray, xy: FloatArray, scale: float
) -> FloatArray:
    """Costs (h,) of poses (h,3,3), (h,3)."""
    x = points @ rotation.transpose(0, 2, 1) + translation[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        size = ((x[:, :, :2] / x[:, :, 2:] - xy) ** 2).sum(axis=2) / scale**2
    size = np.where((x[:, :, 2] > 0) & (size < _MOST_SCALES**2), size, _MOST_SCALES**2)
    return 0.5 * np.log1p(size).sum(axis=1)


def _refined(
    pose: ResectedPose, points: FloatArray, xy: FloatArray, scale: float, losses: tuple[float, ...]
) -> ResectedPose:
    """The pose of least cost near a proposal: Levenberg-Marquardt with Cauchy's weights of some `losses`, in scales."""
    rotation, translation = pose.rotation, pose.translation
    for wide in losses:
        rotation, translation = _minimised(rotation, translation, points, xy, wide * scale)
    cost = pose_cost(rotation, translation, points, xy, scale)
    before = pose_cost(pose.rotation, pose.translation, points, xy, scale)
    return ResectedPose(rotation, translation, cost) if cost < before else replace(pose, cost=before)


def _minimised(
    rotation: FloatArray, translation: FloatArray, points: FloatArray, xy: FloatArray, scale: float
) -> tuple[FloatArray, FloatArray]:
    damping, cost = 1e-3, pose_cost(rotation, translation, points, xy, scale)
    for _ in range(STEPS):
        x = points @ rotation.T
        turned, x = x, x + translation
        front = x[:, 2] > 0
        if front.sum() < 3:
            break
        turned, x, goal = turned[front], x[front], xy[front]
        flat = x[:, :2] / x[:, 2:]
        residual = flat - goal
        weight = 1.0 / (scale**2 + (residual**2).sum(axis=1))
        by_x = np.zeros((len(x), 2, 3))
        by_x[:, 0, 0] = by_x[:, 1, 1] = 1.0 / x[:, 2]
        by_x[:, :, 2] = -flat / x[:, 2:]
        by_turn = cross(turned[:, None, :], by_x)  # of exp(w) R X by w
        jacobian = np.concatenate([by_turn, by_x], axis=2)
        normal = np.einsum("nki,n,nkj->ij", jacobian, weight, jacobian)
        gradient = np.einsum("nki,n,nk->i", jacobian, weight, residual)
        try:
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        except np.linalg.LinAlgError:
            break
        trial = exp_rotation(step[:3]) @ rotation, translation + step[3:]
        trial_cost = pose_cost(*trial, points, xy, scale)
        if trial_cost < cost:
            done = cost - trial_cost < 1e-6 * cost
            (rotation, translation), cost, damping = trial, trial_cost, damping / 10
            if done:
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    return rotation, translation


def _same(rotation: FloatArray, translation: FloatArray, pose: ResectedPose, points: FloatArray) -> BoolArray:
    """Which of some poses (h,3,3), (h,3) are one with another; it is one with itself, whatever the rounding."""
    cosine = (np.einsum("hij,ij->h", rotation, pose.rotation) - 1) / 2
    centre, other = -np.einsum("hji,hj->hi", rotation, translation), -pose.rotation.T @ pose.translation
    distance = float(np.linalg.norm(np.median(points, axis=0) - other))
    apart = np.linalg.norm(centre - other, axis=1)
    return (cosine >= np.cos(SAME_ANGLE_RAD)) & (apart <= SAME_SHIFT * distance)
