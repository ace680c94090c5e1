"""Which blobs lie near which, and are like them enough to be dots of one sticker."""

import numpy as np
from numba import njit

from spherecal.arrays import FloatArray, IntArray

_CELL_PX = 32
_RADIUS_MM = 1.5  # of a dot on a 28 mm sticker
_MOST_AREA_RATIO = 3.0  # between dots of a sticker: perspective, and levels at which blurred dots were found, make 2
_MOST_PEAK_RATIO = 4.0  # light falls off by less across a sticker, but a highlight may lie on one of its dots


def dot_scales(moments: FloatArray) -> FloatArray:
    """Scale in px/mm (on a 28 mm sticker) of each blob (n,) if it is a dot, from its longest axis; moments (n, 3)."""
    half = (moments[:, 0] + moments[:, 2]) / 2
    root = np.hypot((moments[:, 0] - moments[:, 2]) / 2, moments[:, 1])
    return 2 * np.sqrt(half + root) / _RADIUS_MM


def sort_into_cells(uv: FloatArray) -> tuple[IntArray, IntArray]:
    """Blobs sorted by cells of a grid: `start` (rows, columns + 1) into `order` (n,)."""
    cell = np.maximum(uv // _CELL_PX, 0).astype(np.int64)
    columns, rows = (cell.max(axis=0) + 1).tolist() if len(uv) else (1, 1)
    flat = cell[:, 1] * columns + cell[:, 0]
    order = np.argsort(flat, kind="stable")
    ends = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=rows * columns))])
    start = ends[np.arange(rows)[:, None] * columns + np.arange(columns + 1)]
    return start, order


@njit(nogil=True, cache=True, error_model="numpy")
def neighbours(uv, area, peak, start, order, d, reach, near):
    """Blobs like blob d within reach of it, at most as many as `near` takes; returns their number."""
    count = 0
    rows, columns = start.shape[0], start.shape[1] - 1
    left, right = max(int((uv[d, 0] - reach) // _CELL_PX), 0), min(int((uv[d, 0] + reach) // _CELL_PX), columns - 1)
    for row in range(
        max(int((uv[d, 1] - reach) // _CELL_PX), 0), min(int((uv[d, 1] + reach) // _CELL_PX), rows - 1) + 1
    ):
        for k in range(start[row, left], start[row, right + 1]):
            i = order[k]
            ratio = area[i] / area[d]
            brighter = peak[i] / max(peak[d], 1.0)
            if (
                i != d
                and 1 / _MOST_AREA_RATIO < ratio < _MOST_AREA_RATIO
                and 1 / _MOST_PEAK_RATIO < brighter < _MOST_PEAK_RATIO
                and (uv[i, 0] - uv[d, 0]) ** 2 + (uv[i, 1] - uv[d, 1]) ** 2 < reach * reach
            ):
                if count == len(near):
                    return 0
                near[count] = i
                count += 1
    return count
