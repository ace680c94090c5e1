"""How a blob looks against its surroundings, and whether two may be dots of one sticker."""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from spherecal.arrays import BoolArray, FloatArray

_RING = 3.4, 1.0  # of the ellipse's standard deviations (2 are its rim), and px: in the gap to the next dot
# How alike dots of one sticker are at least: ratios of areas (perspective, and levels at which blurred dots were found)
# and of contrasts, difference of shapes, difference of their rings over the contrast.
AREA, CONTRAST, SHAPE, GROUND = range(4)

# Fourth brightest of 16 pixels around a dot over their median, as part of its contrast: at most 0.5 in the targets with
# one dot missing below.
_MOST_RING = 0.6


class Looks(NamedTuple):
    """What of a blob tells whether it may be a dot of the same sticker as another, (n,) each.

    `area` px^2, `contrast` grey over its ring; `ground` grey of the ring; shape as the ellipse's elongation 0 to 1
    along the image's axes and diagonals (`straight`, `slanted`); `clean`: its ring is that of a dot on black paper.
    """

    area: FloatArray
    contrast: FloatArray
    ground: FloatArray
    straight: FloatArray
    slanted: FloatArray
    clean: BoolArray


def looks_of(
    image: NDArray[Any], uv: FloatArray, moments: FloatArray, area: FloatArray, peak: FloatArray
) -> Looks:  # fmt: skip
    """The looks of blobs, given as blobs.py has them, in their image."""
    ground, bright = _rings(image, uv, moments)
    xx, xy, yy = moments.T
    contrast = peak - ground
    clean = bright - ground <= _MOST_RING * contrast
    return Looks(area, contrast, ground, (xx - yy) / (xx + yy), 2 * xy / (xx + yy), clean)


@njit(nogil=True, cache=True, error_model="numpy")
def are_alike(looks, i, d, likeness):
    """Whether blobs i and d may be dots of one sticker."""
    ratio = looks.area[i] / looks.area[d]
    if not 1 / likeness[AREA] < ratio < likeness[AREA]:
        return False
    contrast = looks.contrast[i] / max(looks.contrast[d], 1e-9)
    if not 1 / likeness[CONTRAST] < contrast < likeness[CONTRAST]:
        return False
    straight, slanted = looks.straight[i] - looks.straight[d], looks.slanted[i] - looks.slanted[d]
    if straight * straight + slanted * slanted > likeness[SHAPE] ** 2:
        return False
    return abs(looks.ground[i] - looks.ground[d]) <= likeness[GROUND] * max(looks.contrast[i], looks.contrast[d])


@njit(nogil=True, cache=True, error_model="numpy")
def _rings(image, uv, moments):
    """Median and fourth brightest of 16 pixels around each blob, clear of its own light: (n,) and (n,)."""
    ground, bright = np.empty(len(uv)), np.empty(len(uv))
    ring, height, width = np.empty(16), image.shape[0], image.shape[1]
    for n in range(len(uv)):
        u, v, xx, xy, yy = uv[n, 0], uv[n, 1], moments[n, 0], moments[n, 1], moments[n, 2]
        half, root = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)
        long = _RING[0] * np.sqrt(half + root) + _RING[1]
        short = _RING[0] * np.sqrt(max(half - root, 0.01)) + _RING[1]
        cosine, sine = np.cos(angle), np.sin(angle)
        for i in range(len(ring)):
            x, y = long * np.cos(np.pi / 8 * i), short * np.sin(np.pi / 8 * i)
            column = min(max(int(u + cosine * x - sine * y + 0.5), 0), width - 1)
            row = min(max(int(v + sine * x + cosine * y + 0.5), 0), height - 1)
            ring[i] = image[row, column]
        ring.sort()
        ground[n], bright[n] = (ring[7] + ring[8]) / 2, ring[12]
    return ground, bright
