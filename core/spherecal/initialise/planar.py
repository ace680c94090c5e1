"""Local reconstruction of three cameras that see a plane, where the projective factorisation has no unique answer.

Two views of a plane are related by a homography H = R + t n'/d. It has up to four decompositions, two of them with
the points in front of both cameras (O. Faugeras, F. Lustman, Motion and structure from motion in a piecewise planar
environment, 1988). A third view decides: both pairs must see the same plane.
"""

import cv2
import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.initialise.triple import MIN_POINTS, Triple

# A plane's homography holds to the distortion that is not known yet, as the two-view gate's fundamental matrix does. On
# rigs A and B the ball's cap leaves 40 to 130 px (median) in neighbouring cameras, flat sheets (camcal) 2 to 5 px.
PLANE_PX = 12.0
# Share of a triple's points that must lie on the plane.
ON_PLANE = 0.9


def homography(a: FloatArray, b: FloatArray, gate: float) -> tuple[FloatArray, BoolArray] | None:
    """H (3,3) with b ~ H a of normalised matches (n,2), and which agree within the gate (n,); else None."""
    if len(a) < MIN_POINTS:
        return None
    cv2.setRNGSeed(1)
    h, _ = cv2.findHomography(a, b, cv2.RANSAC, gate, maxIters=500, confidence=0.999)
    if h is None:
        return None
    h = np.asarray(h, dtype=float)
    mapped = np.column_stack([a, np.ones(len(a))]) @ h.T
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - b, axis=1)
    return h, error <= gate


def is_flat(xy_a: FloatArray, xy_b: FloatArray, focal_px: float) -> bool:
    """Whether two views' normalised matches (n,2) are on one plane, as far as these views can show."""
    found = homography(xy_a, xy_b, PLANE_PX / focal_px)
    return found is not None and found[1].mean() >= ON_PLANE


def reconstruct_planar_triple(
    cameras: tuple[int, int, int], features: IntArray, xy: FloatArray, focal_px: FloatArray
) -> Triple | None:
    """Three cameras from points `xy` (3,n,2) of one plane, its distance from the first as unit; None if on none."""
    good = np.ones(len(features), dtype=bool)
    h = []
    for k in (1, 2):
        found = homography(xy[0], xy[k], PLANE_PX / float(focal_px[k]))
        if found is None or found[1].mean() < ON_PLANE:
            return None
        h.append(found[0])
        good &= found[1]
    if good.sum() < MIN_POINTS:
        return None
    features, xy = features[good], xy[:, good]
    rays = np.concatenate([xy, np.ones((*xy.shape[:2], 1))], axis=2)
    best = None
    for rotation_1, translation_1, normal_1 in _decompositions(h[0], rays[0]):
        for rotation_2, translation_2, normal_2 in _decompositions(h[1], rays[0]):
            normal = normal_1 + normal_2
            if np.linalg.norm(normal) < 1.0:  # opposite sides
                continue
            rotation = np.stack([np.eye(3), rotation_1, rotation_2])
            translation = np.stack([np.zeros(3), translation_1, translation_2])
            points = rays[0] / (rays[0] @ (normal / np.linalg.norm(normal)))[:, None]
            x = np.einsum("cij,nj->cni", rotation, points) + translation[:, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                error = np.linalg.norm(x[:, :, :2] / x[:, :, 2:] - xy, axis=2)
            error = np.where(x[:, :, 2] > 0, error, np.inf) * focal_px[:, None]
            if np.isfinite(error).all() and (best is None or error.mean() < best.error_px.mean()):
                best = Triple(cameras, rotation, translation, features, points, error.mean(axis=1))
    return best


def _decompositions(h: FloatArray, rays: FloatArray) -> list[tuple[FloatArray, ...]]:
    """The decompositions of a homography that have the plane's points (rays (n,3) of the first camera) before both.

    Pose of a second camera against the first, at unit distance to the plane, and the plane's normal in the first.
    """
    if np.linalg.det(h) < 0:
        h = -h
    _, rotations, translations, normals = cv2.decomposeHomographyMat(h, np.eye(3))
    views = []
    for rotation, translation, normal in zip(rotations, translations, normals, strict=True):
        depth = rays @ normal.ravel()
        if np.median(depth) < 0:
            depth, normal, translation = -depth, -normal, -translation  # noqa: PLW2901
        points = rays / depth[:, None]
        behind = points @ rotation[2] + translation.ravel()[2] <= 0
        if (depth > 0).all() and not behind.any():
            parts = rotation, translation.ravel(), normal.ravel()
            views.append(tuple(np.asarray(part, dtype=np.float64) for part in parts))
    return views
