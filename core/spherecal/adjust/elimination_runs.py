"""In which order points are eliminated, and which of them by one matrix product: a run of points.

A run is worked on in the columns of all cameras and placements that any of its points meets. Points that meet the same
ones make a run; so do neighbours that meet nearly the same, where the columns that are zero cost less than a product
of their own would.
"""

import numpy as np

from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import BoolArray, IntArray

# Points of one run at most; more gain nothing.
MOST_POINTS = 64
# Taking a product of u columns from the reduced matrix costs as much as six of its 3 u^2 multiplications for a point.
_TAKING = 6


def elimination_runs(
    camera: IntArray, placement: IntArray, point_start: IntArray, n_cameras: int, n_placements: int, width: int
) -> tuple[IntArray, BoolArray]:
    """The observed points in the order of elimination (o,), and where in it (o,) runs begin.

    `camera`, `placement` (n,): of observations, `point_start` (p+1,): sorted by point; `width`: columns of a camera.
    """
    n_points = len(point_start) - 1
    point = np.repeat(np.arange(n_points), np.diff(point_start))
    meets = np.zeros((n_points, n_cameras + n_placements), dtype=bool)
    meets[point, camera] = True
    if n_placements:
        meets[point, n_cameras + placement] = True
    patterns = np.packbits(meets, axis=1)
    tag = np.random.default_rng(0).integers(1, 2**62, patterns.shape[1], dtype=np.uint64)
    code = np.where(np.diff(point_start) > 0, (patterns * tag).sum(axis=1, dtype=np.uint64), 0)  # wrapping around
    _, first, group, count = np.unique(code, return_index=True, return_inverse=True, return_counts=True)
    in_order = np.argsort(first)  # points of one sticker follow each other, and see much the same
    cameras = int.from_bytes(np.packbits(np.arange(n_cameras + n_placements) < n_cameras).tobytes(), "big")
    sets = [int.from_bytes(row.tobytes(), "big") for row in patterns[first[in_order]]]
    run = np.empty(len(first), dtype=np.int64)
    run[in_order] = _runs(sets, count[in_order].tolist(), cameras, width)
    order = np.lexsort((np.arange(n_points), group, run[group]))
    order = order[np.diff(point_start)[order] > 0]
    own = run[group[order]]
    begins = np.append(True, own[1:] != own[:-1])[: len(order)]
    in_run = np.arange(len(order)) - np.maximum.accumulate(np.where(begins, np.arange(len(order)), 0))
    return order, in_run % MOST_POINTS == 0


def _runs(sets: list[int], counts: list[int], cameras: int, width: int) -> list[int]:
    """The run of each of some sets of blocks (bits) that so many points meet: neighbours together where it pays."""

    def cost(blocks: int, points: int) -> int:
        seen = (blocks & cameras).bit_count()
        return (width * seen + POSE * (blocks.bit_count() - seen)) ** 2 * (_TAKING + points)

    runs, number = [0][: len(sets)], 0
    blocks, points = (sets[0], counts[0]) if sets else (0, 0)
    for other, more in zip(sets[1:], counts[1:], strict=True):
        together = blocks | other
        if points + more <= MOST_POINTS and cost(together, points + more) < cost(blocks, points) + cost(other, more):
            blocks, points = together, points + more
        else:
            blocks, points, number = other, more, number + 1
        runs.append(number)
    return runs
