"""Checks of a supposed target: does the template fit a view, do the remaining blobs read as a code, do all dots fit.

All lengths in mm are for a 28 mm sticker. The kernels take blobs by index; a row of a group is the target's index in
the code table and eight blobs in the order of DOTS.
"""

from typing import NamedTuple

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.kernels import BARE, KERNEL, njit
from spherecal.targets import sticker_view as sv
from spherecal.targets.sticker_view import fit_view, place_of


class CodeLookup(NamedTuple):
    """Arrays of the code table, as code_table.py names them, and the camera: focal length, centre u, v in px."""

    template: FloatArray
    places: FloatArray
    by_triple: IntArray
    by_pair: IntArray
    layouts: FloatArray
    camera: FloatArray


MISSING = -1
MOST_NEIGHBOURS = 64
REACH_MM = 19.0  # from D to A, the farthest, with 7 % for sag and perspective

# Centres of blobs are this much off, in mm more where the view is steep.
_CENTRE_NOISE_PX = 0.1

_STEEPEST_COSINE = 0.17  # 80 degrees
# A blob nearer than this to both middle lines lies on the sticker: it ends at 14 mm, the print of its dots at 11.5 mm.
_SHEET_MM = 13.0
_RADIUS_MM = 1.5

# For the quick look: |AE| |BC|, and how much rougher than the fit it is.
_A_E_BY_B_C_MM2, _ROUGH_AREA = 400.0, 1.5

# How exact a reading has to be: rms of the fit and distance of a code dot from its place in mm; blobs against dots as
# the view has them, smallest and largest ratio of areas and difference in shape (0 to 1). In 1200 renderings of targets
# rms stays below 0.05 mm, 0.2 under heavy blur; areas of blobs go from 0.8 to 3.9 times the dots' (low levels and
# saturation), shapes differ by 0.1, under heavy blur by 0.6.
RMS_MM, CODE_MM, SMALLEST, LARGEST, SHAPE = range(5)


@njit(**BARE)
def tolerance(view, millimetres):
    """A tolerance in mm with the noise of blob centres, as seen along the tilt, added."""
    return millimetres + _CENTRE_NOISE_PX / (view[sv.SCALE] * view[sv.COSINE])


@njit(**KERNEL)
def fits_view(blobs, dots, places, with_sag, camera, exactness, view):
    """Whether blobs are where a view of a sticker puts its dots, and look like its dots there.

    `dots`, `places`: indices (n,) of blobs, and where they should be (n, 2) mm; `exactness`: limits (5,) in the order
    of RMS_MM, CODE_MM, SMALLEST, LARGEST, SHAPE.
    """
    n = len(dots)
    uv, moments, area = blobs.uv, blobs.moments, blobs.looks.area
    points = np.empty((n, 2))
    mean_area, xx, xy, yy = 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        blob = dots[k]
        points[k, 0], points[k, 1] = uv[blob, 0], uv[blob, 1]
        mean_area += area[blob] / n
        xx, xy, yy = xx + moments[blob, 0] / n, xy + moments[blob, 1] / n, yy + moments[blob, 2] / n
    if not fit_view(places, points, camera, with_sag, view):
        return False
    # written so that NaN, as of blobs of one pixel or a map that is all but flat, fits nothing
    if not (view[sv.COSINE] >= _STEEPEST_COSINE and view[sv.RMS] <= tolerance(view, exactness[RMS_MM])):
        return False
    a, b, c, d = view[sv.XX], view[sv.XY], view[sv.YX], view[sv.YY]
    ratio = mean_area / (np.pi * _RADIUS_MM**2 * abs(a * d - b * c))
    # blur adds to both moments alike: their difference and the mixed one remain those of the ellipse
    second = _RADIUS_MM**2 / 4
    skew = np.hypot(xx - yy - second * (a * a + b * b - c * c - d * d), 2 * (xy - second * (a * c + b * d))) / (xx + yy)
    return exactness[SMALLEST] < ratio < exactness[LARGEST] and skew < exactness[SHAPE]


@njit(**BARE)
def may_be_template(blobs, near, pivot, a, along, across, limits):
    """Whether an affine view with dots at given places of the image may be a sticker's; a quick look before the fit.

    It may be where the pivot is as large as a dot there, and few other blobs are in the middle of the sticker.

    `a`: where A is, px; `along`, `across`: the steps from A to E and from B to C, (2,) px each; `limits`: of the ratio
    of areas, most other blobs, and how far from the middle these are counted, mm.
    """
    smallest, largest, most, half = limits
    uv, area = blobs.uv, blobs.looks.area
    cross = along[0] * across[1] - along[1] * across[0]
    ratio = area[pivot] * _A_E_BY_B_C_MM2 / (np.pi * _RADIUS_MM**2 * max(cross, 1e-9))
    if not smallest / _ROUGH_AREA < ratio < largest * _ROUGH_AREA:
        return False
    # parts along A-E and across it of a place: D at 0.625 of A-E, B and C half of B-C aside of 0.75 of it
    inside = 0
    for i in near:
        u, v = uv[i, 0] - a[0], uv[i, 1] - a[1]
        s, t = (u * across[1] - v * across[0]) / cross, (along[0] * v - along[1] * u) / cross
        # mm from the middle of A-E along the sticker's sides, which run at 45 degrees to it
        x, y = 20.0 * (s - 0.5) - 10.0 * t, 20.0 * (s - 0.5) + 10.0 * t
        inside += max(abs(x), abs(y)) < half
        if inside > most:
            return False
    return True


@njit(**BARE)
def is_on_sheet(view, u, v):
    """Whether a place in the image is one on the sticker, so that a blob there is a dot of it.

    `u`, `v`: the place, px.
    """
    x, y = place_of(view, u, v)
    return max(abs(x), abs(y)) <= _SHEET_MM


@njit(**KERNEL)
def read_code(uv, near, five, view, places, reach_mm):
    """The number of blobs on the sticker other than its template dots (-1: no code), their places, and these blobs.

    They are none if one of them is at no place of a code dot, two are at the same place, or there are more than three.

    `uv`, `near`: centres of all blobs (b, 2) px, and indices of those around; `five`: indices (5,) of the template dots
    A to E, `MISSING` for none; `places`, `reach_mm` (k, 2) mm.
    """
    hits, code, blobs = 0, np.empty(3, np.int64), np.empty(3, np.int64)
    reach = tolerance(view, reach_mm)
    for i in near:
        if i in (five[0], five[1], five[2], five[3], five[4]):
            continue
        if not is_on_sheet(view, uv[i, 0], uv[i, 1]):
            continue
        x, y = place_of(view, uv[i, 0], uv[i, 1])
        nearest, place = np.inf, 0
        for k in range(len(places)):
            distance = (x - places[k, 0]) ** 2 + (y - places[k, 1]) ** 2
            if distance < nearest:
                nearest, place = distance, k
        if nearest > reach * reach or hits == 3:
            return -1, code, blobs
        for k in range(hits):
            if code[k] == place:
                return -1, code, blobs
        code[hits], blobs[hits] = place, i
        hits += 1
    return hits, code, blobs


@njit(**KERNEL)
def fits_layout(blobs, five, code_blobs, target, lookup, exactness, row, view):
    """Whether all dots fit the target's own layout; writes the group's row, each code dot as the one nearest to it.

    `five`: indices (5,) of the template dots A to E, `MISSING` for none; `exactness`: limits (5,), see `fits_view`;
    `row` (9,).
    """
    row[0] = target
    row[6], row[7], row[8] = MISSING, MISSING, MISSING
    for k in range(5):
        row[1 + k] = five[k]
    for blob in code_blobs:
        x, y = place_of(view, blobs.uv[blob, 0], blobs.uv[blob, 1])
        nearest, dot = np.inf, 0
        for k in range(5, 8):
            distance = (x - lookup.layouts[target, k, 0]) ** 2 + (y - lookup.layouts[target, k, 1]) ** 2
            if distance < nearest:
                nearest, dot = distance, k
        if row[1 + dot] != MISSING:
            return False
        row[1 + dot] = blob
    count = 0
    dots, places = np.empty(8, np.int64), np.empty((8, 2))
    for k in range(8):
        if row[1 + k] != MISSING:
            dots[count] = row[1 + k]
            places[count, 0], places[count, 1] = lookup.layouts[target, k, 0], lookup.layouts[target, k, 1]
            count += 1
    return fits_view(blobs, dots[:count], places[:count], True, lookup.camera, exactness, view)
