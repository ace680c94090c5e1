"""The origin of a target in space, from its reconstructed dots."""

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.geometry.transform import fit_similarity, rigid_origins

LEAST_DOTS = 4  # fixed by the interface: fewer dots are left without a centre

# Dots on one line leave the figure free to turn about it. The flattest four dots of family dots8 that are not on one
# line spread by more than 0.1 of their length across it.
_COLLINEAR = 0.01

_DIFFERENCE_MM = 1e-3  # of numerical derivatives: 1e-4 of a sticker, where they are good to 1e-7


def target_centre(layout_mm: FloatArray, points_mm: FloatArray) -> FloatArray | None:
    """Where a target's origin is, (3,) in the frame of its dots (k,3), by their layout (k,2); None if not determined.

    The layout is laid by least squares with equal weights over the dots, as a flat rigid figure: turned and shifted,
    never scaled or mirrored; z points away from the viewer, into the ball. It takes at least four dots, not all on one
    line unless that line passes through the origin.
    """
    if len(points_mm) < LEAST_DOTS:
        return None
    centred = layout_mm - layout_mm.mean(axis=0)
    _, spread, axes = np.linalg.svd(centred, full_matrices=False)
    origin_off_line = abs(axes[1] @ layout_mm.mean(axis=0))
    if spread[1] < _COLLINEAR * spread[0] and origin_off_line > _COLLINEAR * spread[0]:
        return None
    flat = np.column_stack([layout_mm, np.zeros(len(layout_mm))])
    return fit_similarity(flat, points_mm, with_scale=False).translation


def centre_by_point(flat: FloatArray, points: FloatArray) -> FloatArray:
    """Derivatives (k, 3, 3) of a target's centre by its k dots (flat (k, 2), in space (k, 3)), by differences."""
    k = len(points)
    if target_centre(flat, points) is None:
        return np.zeros((k, 3, 3))
    source, shift = np.column_stack([flat, np.zeros(k)]), _DIFFERENCE_MM * np.eye(3 * k).reshape(3 * k, k, 3)
    ahead, behind = rigid_origins(source, points + shift), rigid_origins(source, points - shift)
    derivative = ((ahead - behind) / (2 * _DIFFERENCE_MM)).reshape(k, 3, 3)
    return np.ascontiguousarray(derivative.transpose(0, 2, 1))
