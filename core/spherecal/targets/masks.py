"""Parts of an image in which nothing is looked for: reflections of the ball, targets that are elsewhere in the room."""

from collections.abc import Sequence

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray

# Left, top, width and height in px, (0, 0) being the centre of the top left pixel.
Rectangle = tuple[float, float, float, float]


def masked(uv: FloatArray, rectangles: Sequence[Rectangle]) -> BoolArray:
    """Which of some places (..., 2) px are in one of the rectangles, borders included; NaN is in none."""
    inside = np.zeros(uv.shape[:-1], dtype=bool)
    for left, top, width, height in rectangles:
        low = np.array([left, top])
        with np.errstate(invalid="ignore"):
            inside |= ((uv >= low) & (uv <= low + np.array([width, height]))).all(axis=-1)
    return inside
