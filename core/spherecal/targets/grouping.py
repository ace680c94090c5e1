"""Groups of blobs that are targets: the template found dot by dot, and the code read with error detection.

A blob is taken for D; two others on opposite sides for A and E, at 5/8 of the way; two more for B and C, with their
middle at 3/4 of it. The five must fit a view of a flat or bent sticker, and the remaining blobs on the sticker must be
three that lie at the places of a code.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from spherecal.arrays import FloatArray, IntArray
from spherecal.targets import sticker_view as sv
from spherecal.targets.blobs import Blobs
from spherecal.targets.code_table import CodeTable
from spherecal.targets.sticker_view import VIEW_SIZE, fit_view, place_of

MISSING = -1

_CELL_PX = 32
_MOST_NEIGHBOURS = 64

# All lengths in mm are for a 28 mm sticker.
_REACH_MM = 19.0  # from D to A, the farthest, with 7 % for sag and perspective
_RADIUS_MM = 1.5
_MOST_AREA_RATIO = 3.0  # between dots of a sticker: perspective, and levels at which blurred dots were found, make 2
_MOST_PEAK_RATIO = 4.0  # light falls off by less across a sticker, but a highlight may lie on one of its dots
_STEEPEST_COSINE = 0.17  # 80 degrees
_SHEET_MM = 12.0  # a blob nearer than this to both middle lines lies on the sticker

# Prediction along A-E and across it, from the sag of a ball of 150 mm diameter; part of |AE| plus part of the scale.
_ALONG_TOLERANCE = (0.06, 1.5)
_ACROSS_TOLERANCE = (0.05, 1.0)
_PREDICTION_NOISE_PX = 0.6

# Fit of the view, rms, and distance of a code dot from its place: with these no random cluster of dots was read as a
# target in 156 000. The centres of blobs contribute up to the given noise, more of it where the view is steep.
TEMPLATE_TOLERANCE_MM = 0.25
CODE_TOLERANCE_MM = 0.6
_CENTRE_NOISE_PX = 0.08


@dataclass(frozen=True)
class Groups:
    """Decoded targets: `target` (n,) index into the code table, `blobs` (n, 8) in the order of DOTS, -1 for none.

    `views` (n, VIEW_SIZE) as sticker_view.py describes them, in units of the code table.
    """

    target: IntArray
    blobs: IntArray
    views: FloatArray


def find_groups(blobs: Blobs, table: CodeTable, camera: FloatArray) -> Groups:
    """All targets among the blobs of an image; `camera` (3,) is its rough focal length and centre in px.

    Each blob serves one target and each target is found once at most: where two groups claim the same blob the one
    that fits better stays, and where two complete groups read the same id neither does.
    """
    start, order = _sort_into_cells(blobs.uv)
    rows, views = _search(
        blobs.uv, blobs.moments, blobs.area, blobs.peak, start, order,
        table.template, table.places, table.by_triple, table.layouts, camera,
    )  # fmt: skip
    keep = _without_conflicts(rows, views[:, sv.RMS])
    return Groups(rows[keep, 0], rows[keep, 1:], views[keep])


def _sort_into_cells(uv: FloatArray) -> tuple[IntArray, IntArray]:
    """Blobs sorted by cells of a grid: `start` (rows, columns + 1) into `order` (n,)."""
    cell = np.maximum(uv // _CELL_PX, 0).astype(np.int64)
    columns, rows = (cell.max(axis=0) + 1).tolist() if len(uv) else (1, 1)
    flat = cell[:, 1] * columns + cell[:, 0]
    order = np.argsort(flat, kind="stable")
    ends = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=rows * columns))])
    start = ends[np.arange(rows)[:, None] * columns + np.arange(columns + 1)]
    return start, order


def _without_conflicts(rows: IntArray, rms: FloatArray) -> IntArray:
    """Rows to keep, best fit first, so that no blob and no target is used twice."""
    keep: list[int] = []
    used: set[int] = set()
    seen: dict[int, int] = {}
    refuted: set[int] = set()
    complete = (rows[:, 1:] != MISSING).all(axis=1)
    for i in np.lexsort((rms, ~complete)).tolist():
        blobs = {blob for blob in rows[i, 1:].tolist() if blob != MISSING}
        if blobs & used:
            continue
        used |= blobs
        target = int(rows[i, 0])
        if target not in seen:
            seen[target] = i
            keep.append(i)
        elif complete[i]:
            refuted.add(seen[target])
    return np.array([i for i in keep if i not in refuted], dtype=np.int64)


@njit(nogil=True, cache=True)
def _search(uv, moments, area, peak, start, order, template, places, by_triple, layouts, camera):
    """Rows (target, eight blobs) of all complete groups, with their views."""
    rows = np.empty((len(uv), 9), np.int64)
    views = np.empty((len(uv), VIEW_SIZE))
    near = np.empty(_MOST_NEIGHBOURS, np.int64)
    found = 0
    for d in range(len(uv)):
        half = (moments[d, 0] + moments[d, 2]) / 2
        axis = 2 * np.sqrt(half + np.hypot((moments[d, 0] - moments[d, 2]) / 2, moments[d, 1]))
        scale = axis / _RADIUS_MM
        count = _neighbours(uv, area, peak, start, order, d, scale * _REACH_MM, near)
        if count >= 7 and _best_reading(
            uv, area, near[:count], d, scale, template, places, by_triple, layouts, camera, rows[found], views[found]
        ):
            found += 1
    return rows[:found], views[:found]


@njit(nogil=True, cache=True)
def _neighbours(uv, area, peak, start, order, d, reach, near):
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


@njit(nogil=True, cache=True)
def _best_reading(uv, area, near, d, scale, template, places, by_triple, layouts, camera, row, view):
    """The best-fitting complete target with blob d as its D, written to `row` and `view`; False if there is none."""
    best = np.inf
    trial_row, trial_view = np.empty(9, np.int64), np.empty(VIEW_SIZE)
    five = np.empty(5, np.int64)
    five[3] = d
    along, across = _ALONG_TOLERANCE[1] * scale, _ACROSS_TOLERANCE[1] * scale
    for e in near:
        au, av = uv[d, 0] - (uv[e, 0] - uv[d, 0]) / 0.6, uv[d, 1] - (uv[e, 1] - uv[d, 1]) / 0.6
        length = np.hypot(uv[e, 0] - au, uv[e, 1] - av)
        a_reach = (_ALONG_TOLERANCE[0] * length + along + _PREDICTION_NOISE_PX) ** 2
        c_reach = (_ACROSS_TOLERANCE[0] * length + across + _PREDICTION_NOISE_PX) ** 2
        for a in near:
            if (uv[a, 0] - au) ** 2 + (uv[a, 1] - av) ** 2 > a_reach or a == e:
                continue
            eu, ev = uv[e, 0] - uv[a, 0], uv[e, 1] - uv[a, 1]
            mu, mv = uv[a, 0] + 0.75 * eu, uv[a, 1] + 0.75 * ev
            for b in near:
                # B lies to the left of A-E as printed, y being down
                if eu * (uv[b, 1] - uv[a, 1]) - ev * (uv[b, 0] - uv[a, 0]) >= 0 or b in (a, e):
                    continue
                cu, cv = 2 * mu - uv[b, 0], 2 * mv - uv[b, 1]
                for c in near:
                    if (uv[c, 0] - cu) ** 2 + (uv[c, 1] - cv) ** 2 > c_reach or c in (a, b, e):
                        continue
                    five[0], five[1], five[2], five[4] = a, b, c, e
                    if (
                        _fits_template(uv, area, five, template, camera, trial_view)
                        and _read_code(uv, near, five, trial_view, places, by_triple, trial_row)
                        and _fits_layout(uv, trial_row, layouts, camera, trial_view)
                        and trial_view[sv.RMS] < best
                    ):
                        best = trial_view[sv.RMS]
                        row[:] = trial_row
                        view[:] = trial_view
    return best < np.inf


@njit(nogil=True, cache=True)
def _tolerance(view, millimetres):
    """A tolerance with the noise of blob centres, as seen along the tilt, added."""
    return millimetres + _CENTRE_NOISE_PX / (view[sv.SCALE] * view[sv.COSINE])


@njit(nogil=True, cache=True)
def _fits_template(uv, area, five, template, camera, view):
    points = np.empty((5, 2))
    for k in range(5):
        points[k, 0], points[k, 1] = uv[five[k], 0], uv[five[k], 1]
    if not fit_view(template, points, camera, view):
        return False
    return view[sv.COSINE] > _STEEPEST_COSINE and view[sv.RMS] < _tolerance(view, TEMPLATE_TOLERANCE_MM)


@njit(nogil=True, cache=True)
def _read_code(uv, near, five, view, places, by_triple, row):
    """Whether the other blobs on the sticker are three code dots of a target; writes the row of the group."""
    hits = 0
    code, blob = np.empty(3, np.int64), np.empty(3, np.int64)
    reach = _tolerance(view, CODE_TOLERANCE_MM)
    for i in near:
        if i in (five[0], five[1], five[2], five[4]):
            continue
        x, y = place_of(view, uv[i, 0], uv[i, 1])
        if max(abs(x), abs(y)) > _SHEET_MM:
            continue
        nearest, place = np.inf, 0
        for k in range(len(places)):
            distance = np.hypot(x - places[k, 0], y - places[k, 1])
            if distance < nearest:
                nearest, place = distance, k
        if nearest > reach or hits == 3:
            return False
        code[hits], blob[hits] = place, i
        hits += 1
    if hits < 3:
        return False
    by_place = np.argsort(code)
    target = by_triple[code[by_place[0]], code[by_place[1]], code[by_place[2]]]
    if target < 0:
        return False
    row[0] = target
    row[1:6] = five
    row[6:] = blob
    return True


@njit(nogil=True, cache=True)
def _fits_layout(uv, row, layouts, camera, view):
    """Put the code dots in the order of the target's layout and fit the view to all eight."""
    layout = layouts[row[0]]
    points = np.empty((8, 2))
    for k in range(5):
        points[k, 0], points[k, 1] = uv[row[1 + k], 0], uv[row[1 + k], 1]
    blobs = row[6:].copy()
    for k in range(3):
        nearest = np.inf
        for blob in blobs:
            x, y = place_of(view, uv[blob, 0], uv[blob, 1])
            distance = np.hypot(x - layout[5 + k, 0], y - layout[5 + k, 1])
            if distance < nearest:
                nearest = distance
                row[6 + k] = blob
        points[5 + k, 0], points[5 + k, 1] = uv[row[6 + k], 0], uv[row[6 + k], 1]
    if row[6] == row[7] or row[6] == row[8] or row[7] == row[8] or not fit_view(layout, points, camera, view):
        return False
    return view[sv.COSINE] > _STEEPEST_COSINE and view[sv.RMS] < _tolerance(view, TEMPLATE_TOLERANCE_MM)
