"""Noise with heavy tails, as real detectors have it."""

import numpy as np

from spherecal.base.arrays import FloatArray

# Student's t with 5 degrees of freedom: 2.3 in 1000 coordinates beyond 4 sigma, where a normal distribution has 0.06
_DEGREES = 5.0


def heavy_noise(sd_px: FloatArray, rng: np.random.Generator, degrees: float = _DEGREES) -> FloatArray:
    """Errors (n, 2) px of standard deviations (n,) px per coordinate, distributed by Student's t."""
    return sd_px[:, None] * np.sqrt((degrees - 2) / degrees) * rng.standard_t(degrees, (len(sd_px), 2))
