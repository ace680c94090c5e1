"""The origin of a target in space, from its reconstructed dots."""

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.geometry.transform import fit_similarity

LEAST_DOTS = 4  # fixed by the interface: fewer dots are left without a centre

# Dots on one line leave the figure free to turn about it. The flattest four dots of family dots8 that are not on one
# line spread by more than 0.1 of their length across it.
_COLLINEAR = 0.01


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
