"""Where in an image stickers may be, by the blobs that the first thresholds have found."""

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.kernels import KERNEL, njit
from spherecal.targets.looks import Looks
from spherecal.targets.neighbours import neighbours, sorted_blobs

_TILE_PX = 8
# As looks.py lists them: wide enough for dots of which some are found at another threshold.
_LIKENESS = (3.0, 2.5, 0.6, 0.5)
_REACH_MM = 19.0  # from D, and nearly from any dot, to all others
_REGION_MM = 24.0  # beyond a dot, for the others of its sticker and one that is blurred into its neighbour


def sticker_regions(rows: FloatArray, looks: Looks, shape: tuple[int, ...], least: int) -> BoolArray:
    """Tiles near blobs that have enough others like them near, bool in the given shape.

    `rows`, `looks`: the blobs, u v xx xy yy area peak (n, 7), and their looks.
    """
    region = np.zeros(shape, dtype=bool)
    if not len(rows):
        return region
    uv, moments = np.ascontiguousarray(rows[:, 0:2]), np.ascontiguousarray(rows[:, 2:5])
    _set_regions(sorted_blobs(uv, moments, looks), least, region)
    return region


@njit(**KERNEL)
def _set_regions(blobs, least, region):
    near, uv = np.empty(least, np.int64), blobs.uv
    for d in range(len(uv)):
        if neighbours(blobs, d, _REACH_MM, _LIKENESS, near) < least:
            continue
        reach = blobs.scales[d] * _REGION_MM
        top, bottom = max(int((uv[d, 1] - reach) / _TILE_PX), 0), int((uv[d, 1] + reach) / _TILE_PX) + 1
        left, right = max(int((uv[d, 0] - reach) / _TILE_PX), 0), int((uv[d, 0] + reach) / _TILE_PX) + 1
        region[top:bottom, left:right] = True
