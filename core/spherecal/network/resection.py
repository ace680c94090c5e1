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
    found, agreeing = False, None
    turn = shift = np.zeros(3)
    for method in (cv2.SOLVEPNP_SQPNP, cv2.SOLVEPNP_EPNP):
        cv2.setRNGSeed(1)
        try:
            found, turn, shift, agreeing = cv2.solvePnPRansac(
                points, xy, np.eye(3), None, reprojectionError=gate, iterationsCount=300, flags=method
            )
            break
        except cv2.error:  # the first method refuses image points as close together as the dots of one target
            continue
    if not found or agreeing is None or len(agreeing) < MIN_AGREEING:
        return None
    some = np.asarray(agreeing, dtype=np.int64).ravel()
    turn, shift = cv2.solvePnPRefineLM(points[some], xy[some], np.eye(3), None, turn, shift)
    if not (np.isfinite(turn).all() and np.isfinite(shift).all()):
        return None
    return exp_rotation(np.asarray(turn, dtype=float).ravel()), np.asarray(shift, dtype=float).ravel(), len(some)
