"""Resection: the pose of one camera from points that are known already."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.kernels import KERNEL, njit
from spherecal.geometry.rotation import exp_rotation

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
                rotations.append(cv2.Rodrigues(vector)[0])
                translations.append(np.asarray(shift, dtype=float).ravel())
    if not rotations:
        return []
    rotation, translation = np.array(rotations), np.array(translations)
    scored = points[some], xy[some], scale
    left = np.argsort([pose_cost(*pose, *scored) for pose in zip(rotation, translation, strict=True)], kind="stable")
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
    return _equations(rotation, translation, points, xy, scale)[0]


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
    damping, (cost, front, normal, gradient) = 1e-3, _equations(rotation, translation, points, xy, scale)
    for _ in range(STEPS):
        if front < 3:
            break
        try:
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        except np.linalg.LinAlgError:
            break
        trial = cv2.Rodrigues(step[:3])[0] @ rotation, translation + step[3:]
        found = _equations(*trial, points, xy, scale)
        if found[0] < cost:
            done = cost - found[0] < 1e-6 * cost
            (rotation, translation), (cost, front, normal, gradient), damping = trial, found, damping / 10
            if done:
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    return rotation, translation


@njit(**KERNEL)
def _equations(rotation, translation, points, xy, scale):
    """The cost of a pose, the points in front of it, and its normal equations by w and t of exp(w) R X + t."""
    normal, gradient, cost, front, turned = np.zeros((6, 6)), np.zeros(6), 0.0, 0, np.zeros(3)
    for i in range(len(points)):
        for a in range(3):
            turned[a] = rotation[a, 0] * points[i, 0] + rotation[a, 1] * points[i, 1] + rotation[a, 2] * points[i, 2]
        u, v, w = turned
        z, size = w + translation[2], _MOST_SCALES**2
        if z > 0:
            front += 1
            x, y = (u + translation[0]) / z, (v + translation[1]) / z
            dx, dy = x - xy[i, 0], y - xy[i, 1]
            square = dx**2 + dy**2
            size = min(square / scale**2, size)
            by_x = (-v * x / z, (w + u * x) / z, -v / z, 1 / z, 0.0, -x / z)
            by_y = (-(w + v * y) / z, u * y / z, u / z, 0.0, 1 / z, -y / z)
            for a in range(6):
                ax, ay = by_x[a] / (scale**2 + square), by_y[a] / (scale**2 + square)
                gradient[a] += ax * dx + ay * dy
                for b in range(6):
                    normal[a, b] += ax * by_x[b] + ay * by_y[b]
        cost += 0.5 * np.log1p(size)
    return cost, front, normal, gradient


def _same(rotation: FloatArray, translation: FloatArray, pose: ResectedPose, points: FloatArray) -> BoolArray:
    """Which of some poses (h,3,3), (h,3) are one with another; it is one with itself, whatever the rounding."""
    cosine = (np.einsum("hij,ij->h", rotation, pose.rotation) - 1) / 2
    centre, other = -np.einsum("hji,hj->hi", rotation, translation), -pose.rotation.T @ pose.translation
    distance = float(np.linalg.norm(np.median(points, axis=0) - other))
    apart = np.linalg.norm(centre - other, axis=1)
    return (cosine >= np.cos(SAME_ANGLE_RAD)) & (apart <= SAME_SHIFT * distance)
