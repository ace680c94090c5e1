"""Resection: the pose of one camera from points that are known already."""

import cv2
import numpy as np

from spherecal.arrays import FloatArray
from spherecal.geometry.rotation import exp_rotation

# Fewest points a resected camera must agree with: six unknowns, and chance agreement of wrong matches at 12 px.
MIN_AGREEING = 6


def resect(points: FloatArray, xy: FloatArray, gate: float) -> tuple[FloatArray, FloatArray, int] | None:
    """Rotation, translation and number of agreeing points, from points (n,3) and normalised image points (n,2).

    Robust (RANSAC, `gate` in normalised units) and deterministic; None where too few points agree.
    """
    if len(points) < MIN_AGREEING:
        return None
    cv2.setRNGSeed(1)
    try:
        found, turn, shift, agreeing = cv2.solvePnPRansac(
            points, xy, np.eye(3), None, reprojectionError=gate, iterationsCount=300, flags=cv2.SOLVEPNP_SQPNP
        )
    except cv2.error:  # points that all lie in one place
        return None
    if not found or agreeing is None or len(agreeing) < MIN_AGREEING:
        return None
    some = np.asarray(agreeing, dtype=np.int64).ravel()
    turn, shift = cv2.solvePnPRefineLM(points[some], xy[some], np.eye(3), None, turn, shift)
    return exp_rotation(np.asarray(turn, dtype=float).ravel()), np.asarray(shift, dtype=float).ravel(), len(some)
