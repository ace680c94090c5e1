"""Groups of blobs that are targets: the template found dot by dot, and the code read with error detection.

A blob is taken for D; two others on opposite sides for A and E, at 5/8 of the way. Two more are taken for B and C, with
their middle at 3/4 of it. The five must fit a view of a flat or bent sticker, and the remaining blobs on the sticker
must be three that are at the places of a code.
"""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.kernels import KERNEL, njit
from spherecal.targets import code_reading as reading
from spherecal.targets import sticker_view as sv
from spherecal.targets.blobs import Blobs
from spherecal.targets.code_reading import CodeLookup
from spherecal.targets.code_table import CodeTable
from spherecal.targets.neighbours import D_E_MM, HALF_B_C_MM, may_be_apart, metric_of, neighbours, sorted_blobs
from spherecal.targets.partial_groups import find_partial_groups
from spherecal.targets.sticker_view import VIEW_SIZE

# Prediction along A-E and across it, from the sag on a ball of 150 mm diameter; part of |AE| plus mm times the scale.
_ALONG_TOLERANCE = (0.06, 1.5)
_ACROSS_TOLERANCE = (0.05, 1.0)
_PREDICTION_NOISE_PX = 0.6

# As code_reading.py lists them. Stickers printed 0.1 mm off a coordinate still pass. No random cluster of 7 to 14 dots
# was read as a target in 240,000 with 0.25 and 0.6 mm; of 48,000 stickers with 8 % of the dots lost and as many specks
# one was read as another then.
_EXACTNESS = (0.18, 0.5, 0.5, 5.0, 0.7)

# For `may_be_template`. Sag and perspective, left out there, shift dots by up to 1.4 mm: what lies within 11.5 mm lies
# on the print.
_QUICK_LOOK = (_EXACTNESS[2], _EXACTNESS[3], 7, 11.5)

# As looks.py lists them. The dots of 2,500 rendered targets, blurred, faint and steep ones too, have shapes that differ
# by up to 0.37 from their mean and rings by up to 0.47 of the contrast.
_LIKENESS = (3.0, 4.0, 0.8, 0.8)


@dataclass(frozen=True)
class DecodedTargets:
    """Decoded targets: `target` (n,) index into the code table, `blobs` (n, 8) in the order of DOTS, -1 for none.

    `views` (n, VIEW_SIZE) as sticker_view.py describes them, in units of the code table.
    """

    target: IntArray
    blobs: IntArray
    views: FloatArray


def find_groups(blobs: Blobs, table: CodeTable, camera: FloatArray) -> DecodedTargets:
    """All targets among the blobs of an image; targets with all dots come first.

    Each blob serves one target and each target is found once at most. Where two groups claim the same blob the one that
    fits better is kept; where two groups read the same id neither is.

    `camera`: rough focal length and centre u, v in px, (3,).
    """
    lookup = CodeLookup(table.template, table.places, table.by_triple, table.by_pair, table.layouts, camera)
    in_cells = sorted_blobs(blobs.uv, blobs.moments, blobs.looks)
    rows, views = _search(in_cells, lookup)
    keep = _without_conflicts(rows, views[:, sv.RMS])
    rows, views = rows[keep], views[keep]
    more = find_partial_groups(in_cells, rows, lookup)
    rows, views = np.concatenate([rows, more[0]]), np.concatenate([views, more[1]])
    return DecodedTargets(rows[:, 0], rows[:, 1:], views)


def _without_conflicts(rows: IntArray, rms: FloatArray) -> IntArray:
    """Rows to keep, best fit first, so that no blob is used twice, and no target that is read at two places."""
    keep: list[int] = []
    used: set[int] = set()
    seen: dict[int, int] = {}
    refuted: set[int] = set()
    for i in np.argsort(rms, kind="stable").tolist():
        target, *blobs = rows[i].tolist()
        if used & set(blobs):
            continue
        used |= set(blobs)
        if target in seen:
            refuted.add(seen[target])
        else:
            seen[target] = i
            keep.append(i)
    return np.array([i for i in keep if i not in refuted], dtype=np.int64)


@njit(**KERNEL)
def _search(blobs, lookup):
    """Rows (target, eight blobs) of all complete groups, with their views."""
    rows = np.empty((len(blobs.uv), 9), np.int64)
    views = np.empty((len(blobs.uv), VIEW_SIZE))
    near = np.empty(reading.MOST_NEIGHBOURS, np.int64)
    found = 0
    for d in range(len(blobs.uv)):
        count = neighbours(blobs, d, reading.REACH_MM, _LIKENESS, near)
        if 7 <= count < reading.MOST_NEIGHBOURS:
            found += _best_reading(blobs, near[:count], d, lookup, rows[found], views[found])
    return rows[:found], views[:found]


@njit(**KERNEL)
def _best_reading(blobs, near, d, lookup, row, view):
    """The best-fitting complete target with blob d as its D, written to `row` and `view`; False if there is none."""
    uv, scale, best = blobs.uv, blobs.scales[d], np.inf
    trial_row, trial_view = np.empty(9, np.int64), np.empty(VIEW_SIZE)
    five, metric = np.empty(5, np.int64), np.empty(3)
    five[3] = d
    metric_of(blobs.moments, d, metric)
    du, dv = uv[d, 0], uv[d, 1]
    long, wide = _ALONG_TOLERANCE[1] * scale, _ACROSS_TOLERANCE[1] * scale
    for e in near:
        eu, ev = uv[e, 0] - du, uv[e, 1] - dv
        if not may_be_apart(metric, eu, ev, D_E_MM):
            continue
        au, av = du - eu / 0.6, dv - ev / 0.6
        length = np.hypot(uv[e, 0] - au, uv[e, 1] - av)
        a_reach = (_ALONG_TOLERANCE[0] * length + long + _PREDICTION_NOISE_PX) ** 2
        c_reach = (_ACROSS_TOLERANCE[0] * length + wide + _PREDICTION_NOISE_PX) ** 2
        for a in near:
            if (uv[a, 0] - au) ** 2 + (uv[a, 1] - av) ** 2 > a_reach or a == e:
                continue
            along = uv[e, 0] - uv[a, 0], uv[e, 1] - uv[a, 1]
            mu, mv = uv[a, 0] + 0.75 * along[0], uv[a, 1] + 0.75 * along[1]
            for b in near:
                # B lies to the left of A-E as printed, y being down
                if along[0] * (uv[b, 1] - uv[a, 1]) - along[1] * (uv[b, 0] - uv[a, 0]) >= 0 or b in (a, e):
                    continue
                if not may_be_apart(metric, uv[b, 0] - mu, uv[b, 1] - mv, HALF_B_C_MM):
                    continue
                cu, cv = 2 * mu - uv[b, 0], 2 * mv - uv[b, 1]
                for c in near:
                    if (uv[c, 0] - cu) ** 2 + (uv[c, 1] - cv) ** 2 > c_reach or c in (a, b, e):
                        continue
                    across = uv[c, 0] - uv[b, 0], uv[c, 1] - uv[b, 1]
                    if not reading.may_be_template(blobs, near, d, (uv[a, 0], uv[a, 1]), along, across, _QUICK_LOOK):
                        continue
                    five[0], five[1], five[2], five[4] = a, b, c, e
                    if _reads(blobs, near, five, lookup, trial_row, trial_view) and trial_view[sv.RMS] < best:
                        best = trial_view[sv.RMS]
                        row[:] = trial_row
                        view[:] = trial_view
    return best < np.inf


@njit(**KERNEL)
def _reads(blobs, near, five, lookup, row, view):
    """Whether the five template dots, with exactly three more blobs on their sticker, are a target."""
    if not reading.fits_view(blobs, five, lookup.template, True, lookup.camera, _EXACTNESS, view):
        return False
    hits, code, dots = reading.read_code(blobs.uv, near, five, view, lookup.places, _EXACTNESS[reading.CODE_MM])
    if hits != 3:
        return False
    code.sort()
    target = lookup.by_triple[code[0], code[1], code[2]]
    return target >= 0 and reading.fits_layout(blobs, five, dots, target, lookup, _EXACTNESS, row, view)
