"""How a blob looks against its surroundings, and whether two may be dots of one sticker."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.kernels import BARE, KERNEL, njit

_RING = 3.4, 1.0  # of the ellipse's standard deviations (2 are its rim), and px: in the gap to the next dot
# How alike dots of one sticker are at least: ratios of areas (perspective, and levels at which blurred dots were found)
# and of contrasts, difference of shapes, difference of their rings over the contrast.
AREA, CONTRAST, SHAPE, GROUND = range(4)

# The 16 places of a ring around the ellipse, as cosines and sines along its axes.
_TURNS = np.stack([np.cos(np.pi / 8 * np.arange(16)), np.sin(np.pi / 8 * np.arange(16))], axis=1)
_INDEX_BITS = 4  # of a place in the ring

# Fourth brightest of 16 pixels around a dot over their median, as part of its contrast: at most 0.5 in the targets with
# one dot missing below.
_MOST_RING = 0.6


class Looks(NamedTuple):
    """The properties of a blob that decide whether it may be a dot of the same sticker as another, (n,) each.

    - `area` in px^2.
    - `contrast` in grey over its ring.
    - `ground`, grey of the ring.
    - `straight`, `slanted`: the ellipse's elongation 0 to 1 along the image's axes and diagonals.
    - `clean`: its ring is that of a dot on black paper.
    """

    area: FloatArray
    contrast: FloatArray
    ground: FloatArray
    straight: FloatArray
    slanted: FloatArray
    clean: BoolArray


def looks_of(image: NDArray[Any], rows: FloatArray) -> Looks:
    """The looks of blobs in their image.

    `image`: grey image, (h, w); `rows`: the blobs: u v xx xy yy area peak, (n, 7).
    """
    uv, moments = np.ascontiguousarray(rows[:, 0:2]), np.ascontiguousarray(rows[:, 2:5])
    area, peak = np.ascontiguousarray(rows[:, 5]), np.ascontiguousarray(rows[:, 6])
    ground, bright = _rings(image, uv, moments)
    xx, xy, yy = moments.T
    contrast = peak - ground
    clean = bright - ground <= _MOST_RING * contrast
    return Looks(area, contrast, ground, (xx - yy) / (xx + yy), 2 * xy / (xx + yy), clean)


def joined(parts: Sequence[Looks]) -> Looks:
    """The looks of several sets of blobs as those of one."""
    return Looks(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


@njit(**BARE)
def are_alike(looks, i, d, likeness):
    """Whether blobs i and d may be dots of one sticker.

    `likeness`: limits (4,) in the order of AREA, CONTRAST, SHAPE, GROUND.
    """
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


@njit(**KERNEL)
def _rings(image, uv, moments):
    """Median and fourth brightest of 16 pixels around each blob, clear of its own light: (n,) and (n,)."""
    ground, bright = np.empty(len(uv)), np.empty(len(uv))
    height, width = image.shape
    ring, below = np.empty(16, np.int32), np.empty(16, np.int32)
    for n in range(len(uv)):
        u, v, xx, xy, yy = uv[n, 0], uv[n, 1], moments[n, 0], moments[n, 1], moments[n, 2]
        half, root = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)
        long = _RING[0] * np.sqrt(half + root) + _RING[1]
        short = _RING[0] * np.sqrt(max(half - root, 0.01)) + _RING[1]
        cosine, sine = np.cos(angle), np.sin(angle)
        for i in range(16):
            x, y = long * _TURNS[i, 0], short * _TURNS[i, 1]
            column = min(max(int(u + cosine * x - sine * y + 0.5), 0), width - 1)
            row = min(max(int(v + sine * x + cosine * y + 0.5), 0), height - 1)
            ring[i] = np.int32(image[row, column]) << _INDEX_BITS | i  # no two are equal
        # ranks by counting: the compiler makes vectors of it, five times as fast as sorting
        below[:] = 0
        for i in range(16):
            for k in range(16):
                below[k] += np.int32(ring[i] < ring[k])
        middle = 0
        for i in range(16):
            if below[i] == 7 or below[i] == 8:
                middle += ring[i] >> _INDEX_BITS
            elif below[i] == 12:
                bright[n] = ring[i] >> _INDEX_BITS
        ground[n] = middle / 2
    return ground, bright
