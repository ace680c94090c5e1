"""Targets of which seven of the eight dots are there, among the blobs that complete targets leave.

Two codes share at most one dot, so two code dots still determine the code where the template is complete; with a
template dot missing all three are asked for. Either way the seven dots must fit three times as well as eight need to,
and no other blob may be on the sticker. Two different readings of the same dots refute each other.
"""

from typing import NamedTuple

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.kernels import BARE, KERNEL, njit
from spherecal.targets import code_reading as reading
from spherecal.targets import sticker_view as sv
from spherecal.targets.code_reading import MISSING, CodeLookup
from spherecal.targets.looks import are_alike
from spherecal.targets.neighbours import (
    A_D_MM,
    D_E_MM,
    HALF_B_C_MM,
    SortedBlobs,
    may_be_apart,
    may_be_within,
    metric_of,
    neighbours,
)
from spherecal.targets.sticker_view import VIEW_SIZE, place_of

# As code_reading.py lists them: seven dots with print errors of 0.05 mm a coordinate leave 0.05 mm. Four template dots
# define an affine view only; sag and perspective put dots up to 0.5 mm off, code dots up to 1.1 mm.
_EXACTNESS = (0.08, 0.25, 0.8, 3.0, 0.2)
_LOOSE_EXACTNESS = (0.5, 1.1, 0.8, 3.0, 0.3)
# As looks.py lists them: what may be a dot of the same sticker, or must not lie on it beside them; and what may be one
# where more than so many blobs are about. Of the dots of 20 rendered targets with one missing, in poor light and
# blurred too, areas are 3.6 times each other at most, contrasts 2.5, shapes differ by 0.26 from their mean and rings by
# 0.21; asked for everywhere, that loses 0.3 % of the targets in the stress table's images.
_LOOSE_LIKENESS = (3.0, 4.0, 0.8, 0.8)
_LIKENESS = (2.5, 2.0, 0.35, 0.3)
_CLUTTERED = 14
# For `may_be_template`; 9.5 mm: as in grouping.py, where a place is extrapolated from dots on one side of it.
_QUICK_LOOK = (_EXACTNESS[2], _EXACTNESS[3], 6, 9.5)
_DEFORMED_MM = 1.5  # a dot that is there, but looks like none, has its centre no farther off than its radius
_FEWEST = 6  # other blobs near the pivot
_MOST_NEAR, _MOST_FAR = 16, 24  # within reach of D, and of A: few enough to try all readings
_FAR_REACH_MM = 32.5  # from A to all of the sticker
_PREDICTION = 0.12, 0.6  # part of the distance between the two dots a third is predicted from, plus px

_A, _B, _C, _D, _E = range(5)

# For each template dot that may be missing on the line A-D-E, in steps from the pivot to the other dot of the line:
# their distance in mm, A less the pivot, E less A, the middle of B and C less the pivot
_ON_LINE = (
    (D_E_MM, -1 / 0.6, 1 / 0.375, 1 / 3),
    (0.0, 0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, 0.0),
    (A_D_MM + D_E_MM, 0.0, 1.0, 0.75),
    (A_D_MM, 1.0, -1.6, -0.2),
)


class _Readings(NamedTuple):
    """What is read so far: `rows` (k, 9) target and eight blobs, `MISSING` for none, and `views` (k, VIEW_SIZE).

    `free` (n,): blobs that no complete target has; `seen` (t,): complete targets.
    """

    lookup: CodeLookup
    free: BoolArray
    seen: BoolArray
    rows: IntArray
    views: FloatArray


def find_partial_groups(blobs: SortedBlobs, complete: IntArray, lookup: CodeLookup) -> tuple[IntArray, FloatArray]:
    """Targets with one dot missing among the blobs that complete targets (rows (m, 9)) leave: rows and views."""
    n = len(blobs.uv)
    free = np.ones(n, dtype=bool)
    free[complete[:, 1:].ravel()] = False
    seen = np.zeros(len(lookup.layouts), dtype=bool)
    seen[complete[:, 0]] = True
    rows, views = np.empty((4 * n + 8, 9), np.int64), np.empty((4 * n + 8, VIEW_SIZE))
    found, views = _search(blobs, _Readings(lookup, free, seen, rows, views))
    keep = _unrefuted(found, views[:, sv.RMS])
    return found[keep], views[keep]


def _unrefuted(rows: IntArray, rms: FloatArray) -> IntArray:
    """One row for each target and set of blobs; none where a blob serves two targets or a target is read twice."""
    users: dict[int, set[int]] = {}
    readers: dict[int, set[frozenset[int]]] = {}
    for row in rows.tolist():
        blobs = frozenset(row[1:]) - {MISSING}
        readers.setdefault(row[0], set()).add(blobs)
        for blob in blobs:
            users.setdefault(blob, set()).add(row[0])
    keep: dict[int, int] = {}
    for i in np.argsort(rms, kind="stable").tolist():
        target, *blobs = rows[i].tolist()
        if len(readers[target]) == 1 and all(len(users[blob]) == 1 for blob in blobs if blob != MISSING):
            keep.setdefault(target, i)
    return np.array(sorted(keep.values()), dtype=np.int64)


@njit(**KERNEL)
def _search(blobs, readings):
    near, far = np.empty(reading.MOST_NEIGHBOURS, np.int64), np.empty(reading.MOST_NEIGHBOURS, np.int64)
    found, metric = 0, np.empty(3)
    for pivot in range(len(blobs.uv)):
        if not readings.free[pivot]:
            continue
        metric_of(blobs.moments, pivot, metric)
        count = neighbours(blobs, pivot, _FAR_REACH_MM, _LOOSE_LIKENESS, far)
        if not _FEWEST <= count < reading.MOST_NEIGHBOURS:
            continue
        count = _within(blobs.uv, readings.free, pivot, metric, _FAR_REACH_MM, far[:count], far)
        if count > _CLUTTERED:
            count = _agreeing(blobs.looks, pivot, far[:count])
        within = _within(blobs.uv, readings.free, pivot, metric, reading.REACH_MM, far[:count], near)
        if _FEWEST <= within <= _MOST_NEAR:
            found = _read_along_line(blobs, near[:within], pivot, readings, found)
            for missing in (_A, _E):
                found = _read_across_line(blobs, near[:within], pivot, missing, readings, found)
        if _FEWEST <= count <= _MOST_FAR:
            found = _read_across_line(blobs, far[:count], pivot, _D, readings, found)
    alone = np.empty(found, np.bool_)
    for k in range(found):
        alone[k] = _is_alone(blobs, readings, readings.rows[k], readings.views[k])
    return readings.rows[:found][alone], readings.views[:found][alone]


@njit(**BARE)
def _within(uv, free, pivot, metric, reach_mm, some, near):
    """Those of some blobs that no complete target has and that may be within reach of the pivot; returns their number.

    `near` may be `some` itself.
    """
    left = 0
    for i in some:
        if free[i] and may_be_within(metric, uv[i, 0] - uv[pivot, 0], uv[i, 1] - uv[pivot, 1], reach_mm):
            near[left] = i
            left += 1
    return left


@njit(**BARE)
def _agreeing(looks, pivot, some):
    """Those of some blobs with the ring of a dot and much like the pivot come first; returns their number."""
    left = 0
    for i in some:
        if looks.clean[i] and looks.clean[pivot] and are_alike(looks, i, pivot, _LIKENESS):
            some[left] = i
            left += 1
    return left


@njit(**KERNEL)
def _is_alone(blobs, readings, row, view):
    """Whether no other blob that might be a dot of it is on the sticker, but where the missing dot should be."""
    near, gap = np.empty(reading.MOST_NEIGHBOURS, np.int64), readings.lookup.layouts[row[0], np.argmin(row[1:])]
    uv = blobs.uv
    for dot in row[1:]:
        if dot == MISSING:
            continue
        count = neighbours(blobs, dot, reading.REACH_MM, _LOOSE_LIKENESS, near)
        for i in near[:count]:
            if not readings.free[i] or (row[1:] == i).any() or not reading.is_on_sheet(view, uv[i, 0], uv[i, 1]):
                continue
            x, y = place_of(view, uv[i, 0], uv[i, 1])
            if np.hypot(x - gap[0], y - gap[1]) > _DEFORMED_MM:
                return False
    return True


@njit(**KERNEL)
def _read_along_line(blobs, near, d, readings, found):
    """Readings with blob d as D between A and E: B, C or a code dot missing; returns the number of rows."""
    uv, scale, five, metric = blobs.uv, blobs.scales[d], np.empty(5, np.int64), np.empty(3)
    five[_D] = d
    metric_of(blobs.moments, d, metric)
    for e in near:
        eu, ev = uv[e, 0] - uv[d, 0], uv[e, 1] - uv[d, 1]
        if not (_is_plausible(np.hypot(eu, ev), D_E_MM, scale) and may_be_apart(metric, eu, ev, D_E_MM)):
            continue
        slack = _slack(np.hypot(eu, ev) / 0.375)
        for a in near:
            # A lies at D - (E - D) / 0.6
            if a == e or (uv[a, 0] - uv[d, 0] + eu / 0.6) ** 2 + (uv[a, 1] - uv[d, 1] + ev / 0.6) ** 2 > slack:
                continue
            five[_A], five[_E] = a, e
            mu, mv = uv[d, 0] + eu / 3, uv[d, 1] + ev / 3
            for b in near:
                if b in (a, e):
                    continue
                bu, bv = uv[b, 0] - mu, uv[b, 1] - mv
                if not may_be_apart(metric, bu, bv, HALF_B_C_MM):
                    continue
                left = _is_left(uv, a, e, b)
                along = uv[e, 0] - uv[a, 0], uv[e, 1] - uv[a, 1]
                across = (-2 * bu, -2 * bv) if left else (2 * bu, 2 * bv)
                if not reading.may_be_template(blobs, near, d, (uv[a, 0], uv[a, 1]), along, across, _QUICK_LOOK):
                    continue
                five[_B], five[_C] = (b, MISSING) if left else (MISSING, b)
                found = _try(blobs, near, five, readings, found)
                for c in near:
                    if left and c not in (a, b, e) and _is_middle(uv, b, c, mu, mv, slack):
                        five[_C] = c
                        found = _try(blobs, near, five, readings, found)
    return found


@njit(**KERNEL)
def _read_across_line(blobs, near, pivot, missing, readings, found):
    """Readings with A, D or E missing, by the middle of B and C on the line of the other two; the pivot is D, or A."""
    uv, scale, five, metric = blobs.uv, blobs.scales[pivot], np.empty(5, np.int64), np.empty(3)
    metric_of(blobs.moments, pivot, metric)
    # what the pivot and the other are: where A is from the pivot, A-E, and the middle of B and C, all in steps from
    # the pivot to the other
    expected, a_at, a_e, part = _ON_LINE[missing]
    for other in near:
        du, dv = uv[other, 0] - uv[pivot, 0], uv[other, 1] - uv[pivot, 1]
        length = np.hypot(du, dv)
        if not (_is_plausible(length, expected, scale) and may_be_apart(metric, du, dv, expected)):
            continue
        if missing == _A:
            five[_A], five[_D], five[_E] = MISSING, pivot, other
        elif missing == _E:
            five[_A], five[_D], five[_E] = other, pivot, MISSING
        else:
            five[_A], five[_D], five[_E] = pivot, MISSING, other
        at_a, along = (uv[pivot, 0] + a_at * du, uv[pivot, 1] + a_at * dv), (a_e * du, a_e * dv)
        mu, mv = uv[pivot, 0] + part * du, uv[pivot, 1] + part * dv
        slack = _slack(length * (A_D_MM + D_E_MM) / expected)
        for b in near:
            # B lies to the left of A-E as printed, y being down; A-E runs from the pivot but where the other is A
            if (_is_left(uv, pivot, other, b) == (missing == _E)) or b == other:
                continue
            if not may_be_apart(metric, uv[b, 0] - mu, uv[b, 1] - mv, HALF_B_C_MM):
                continue
            for c in near:
                if c not in (b, other) and _is_middle(uv, b, c, mu, mv, slack):
                    across = uv[c, 0] - uv[b, 0], uv[c, 1] - uv[b, 1]
                    if reading.may_be_template(blobs, near, pivot, at_a, along, across, _QUICK_LOOK):
                        five[_B], five[_C] = b, c
                        found = _try(blobs, near, five, readings, found)
    return found


@njit(**BARE)
def _is_plausible(length_px, length_mm, scale):
    """Whether two dots this far apart may be so in the image; the scale is that of a blurred dot, too large by half."""
    return 0.1 * length_mm * scale < length_px < 1.15 * length_mm * scale


@njit(**BARE)
def _slack(a_e_px):
    """Square of the distance by which a dot may miss its prediction from others, given the distance of A and E."""
    return (_PREDICTION[0] * a_e_px + _PREDICTION[1]) ** 2


@njit(**BARE)
def _is_middle(uv, b, c, mu, mv, slack):
    """Whether the middle of two blobs is at (mu, mv); twice its distance is what C misses its prediction by."""
    return (uv[b, 0] + uv[c, 0] - 2 * mu) ** 2 + (uv[b, 1] + uv[c, 1] - 2 * mv) ** 2 < slack


@njit(**BARE)
def _is_left(uv, a, e, b):
    """Whether b is to the left of A-E as printed, y being down."""
    eu, ev = uv[e, 0] - uv[a, 0], uv[e, 1] - uv[a, 1]
    return eu * (uv[b, 1] - uv[a, 1]) - ev * (uv[b, 0] - uv[a, 0]) < 0


@njit(**KERNEL)
def _try(blobs, near, five, readings, found):
    """Add the reading with these five template dots, one of which may be missing, if it holds; returns the rows."""
    if found == len(readings.rows):
        return found
    lookup, view = readings.lookup, readings.views[found]
    known, dots, at = 0, np.empty(5, np.int64), np.empty((5, 2))
    for k in range(5):
        if five[k] != MISSING:
            dots[known] = five[k]
            at[known, 0], at[known, 1] = lookup.template[k, 0], lookup.template[k, 1]
            known += 1
    whole = known == 5
    exactness = _EXACTNESS if whole else _LOOSE_EXACTNESS
    if not reading.fits_view(blobs, dots[:known], at[:known], whole, lookup.camera, exactness, view):
        return found
    hits, code, code_blobs = reading.read_code(blobs.uv, near, five, view, lookup.places, exactness[reading.CODE_MM])
    if hits != 7 - known:
        return found
    code[:hits].sort()
    target = lookup.by_pair[code[0], code[1]] if whole else lookup.by_triple[code[0], code[1], code[2]]
    if target < 0 or readings.seen[target]:
        return found
    row = readings.rows[found]
    return found + reading.fits_layout(blobs, five, code_blobs[:hits], target, lookup, _EXACTNESS, row, view)
