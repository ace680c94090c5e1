"""Which blobs are near each other, and enough alike to be dots of one sticker."""

from typing import NamedTuple

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.kernels import BARE, njit
from spherecal.targets.looks import Looks, are_alike

_CELL_PX = 32
_RADIUS_MM = 1.5  # of a dot on a 28 mm sticker

# A blob's moments give the view of its sticker up to a rotation, and so the distance in mm from it to any place of the
# sticker: 0.30 to 1.25 of the true one in 9,500 pairs of dots of rendered targets (nominal, blurred, faint, steep; blur
# makes a dot look larger), 0.41 to 1.04 where one dot is missing and the others are as exact as is then asked for.
NEAREST, FARTHEST = 0.25, 1.4
A_D_MM, D_E_MM, HALF_B_C_MM = 17.68, 10.61, 7.07  # B and C lie on either side of 3/4 of A-E


class SortedBlobs(NamedTuple):
    """The blobs of an image as groups of them are looked for.

    Centres `uv` (n, 2) px and central `moments` xx xy yy (n, 3) px^2; `scales` (n,) in px/mm on a 28 mm sticker if each
    is a dot, from its longest axis. Sorted by cells of a grid: `start` (rows, columns + 1) into `order` (n,).
    """

    uv: FloatArray
    moments: FloatArray
    looks: Looks
    scales: FloatArray
    start: IntArray
    order: IntArray


def sorted_blobs(uv: FloatArray, moments: FloatArray, looks: Looks) -> SortedBlobs:
    """Blobs with their scales, sorted by cells of a grid."""
    half = (moments[:, 0] + moments[:, 2]) / 2
    root = np.hypot((moments[:, 0] - moments[:, 2]) / 2, moments[:, 1])
    cell = np.maximum(uv // _CELL_PX, 0).astype(np.int64)
    columns, rows = (cell.max(axis=0) + 1).tolist() if len(uv) else (1, 1)
    flat = cell[:, 1] * columns + cell[:, 0]
    order = np.argsort(flat, kind="stable")
    ends = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=rows * columns))])
    start = ends[np.arange(rows)[:, None] * columns + np.arange(columns + 1)]
    return SortedBlobs(uv, moments, looks, 2 * np.sqrt(half + root) / _RADIUS_MM, start, order)


@njit(**BARE)
def metric_of(moments, pivot, metric):
    """Write to `metric` what makes squared mm on the sticker of squared px, if blob `pivot` is a dot.

    `moments`, `pivot`: central moments xx xy yy of all blobs, (n, 3) px^2, and the blob; `metric`: output: factors (3,)
    of du^2, 2 du dv, dv^2, mm^2/px^2.
    """
    xx, xy, yy = moments[pivot, 0], moments[pivot, 1], moments[pivot, 2]
    part = (_RADIUS_MM / 2) ** 2 / max(xx * yy - xy * xy, 1e-9)
    metric[0], metric[1], metric[2] = part * yy, -part * xy, part * xx


@njit(**BARE)
def may_be_apart(metric, du, dv, millimetres):
    """Whether two places of the image may be `millimetres` apart on the sticker.

    `du`, `dv`: their difference in px.
    """
    squared = metric[0] * du * du + 2 * metric[1] * du * dv + metric[2] * dv * dv
    return (NEAREST * millimetres) ** 2 < squared < (FARTHEST * millimetres) ** 2


@njit(**BARE)
def may_be_within(metric, du, dv, millimetres):
    """Whether two places of the image may be less than `millimetres` apart on the sticker.

    `du`, `dv`: their difference in px.
    """
    squared = metric[0] * du * du + 2 * metric[1] * du * dv + metric[2] * dv * dv
    return squared < (FARTHEST * millimetres) ** 2


@njit(**BARE)
def neighbours(blobs, d, reach_mm, likeness, near):
    """Number of blobs like blob d within reach of it, if it is a dot; at most as many as `near` takes."""
    uv, start, reach = blobs.uv, blobs.start, blobs.scales[d] * reach_mm
    count = 0
    rows, columns = start.shape[0], start.shape[1] - 1
    left, right = max(int((uv[d, 0] - reach) // _CELL_PX), 0), min(int((uv[d, 0] + reach) // _CELL_PX), columns - 1)
    top, bottom = max(int((uv[d, 1] - reach) // _CELL_PX), 0), min(int((uv[d, 1] + reach) // _CELL_PX), rows - 1)
    for row in range(top, bottom + 1):
        for k in range(start[row, left], start[row, right + 1]):
            i = blobs.order[k]
            near_enough = i != d and (uv[i, 0] - uv[d, 0]) ** 2 + (uv[i, 1] - uv[d, 1]) ** 2 < reach * reach
            if near_enough and are_alike(blobs.looks, i, d, likeness):
                if count == len(near):
                    return count
                near[count] = i
                count += 1
    return count
