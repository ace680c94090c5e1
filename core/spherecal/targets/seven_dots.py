"""What the refined dots of a target have to prove when one of its eight is missing.

Eight dots prove their code: a single dot lost and another added makes no other code. Seven dots do not. A speck that
passes for a dot, on a sticker that lost two of its code dots, reads as another target if it lies where that one has a
dot; so the dots have to lie there as exactly as stickers are printed, and look like dots.
"""

import numpy as np

from spherecal.arrays import BoolArray, FloatArray
from spherecal.targets import sticker_view as sv
from spherecal.targets.family import TEMPLATE_DOTS
from spherecal.targets.refinement import Dots

_CODE = len(TEMPLATE_DOTS)  # code dots from here on

# Rendered stickers with print errors of 0.02 mm a coordinate, up to 80 degrees: rms at most 0.048 mm; a code dot within
# 0.09 mm of where the others put it (99 %, 0.12 beyond 65 degrees); misfit 1. Of simulated stickers with two dots lost
# and one speck at random, 3 in 10,000 still pass for another target, of those with 8 % of the dots lost and as many
# specks 2 in 57,600; without these limits 29 and 4 in 10,000.
_MOST_RMS_MM, _MOST_OFF_MM, _MOST_MISFIT = 0.06, 0.12, 3.0
_LEAST_DOTS = 7


def proven_by_seven(dots: Dots, layouts: FloatArray, camera: FloatArray) -> BoolArray:
    """Which targets' refined dots lie where their layouts (n, 8, 2) have them, and look like dots, (n,).

    Layouts in mm for a 28 mm sticker; `camera` (3,) as sticker_view.py has it.
    """
    proven = np.zeros(len(layouts), dtype=bool)
    for i, (uv, layout) in enumerate(zip(dots.uv, layouts, strict=True)):
        seen = np.isfinite(uv[:, 0])
        if seen.sum() >= _LEAST_DOTS and dots.misfit[i] < _MOST_MISFIT:
            proven[i] = lie_exactly(uv, layout, seen, camera)
    return proven


def lie_exactly(uv: FloatArray, layout: FloatArray, seen: BoolArray, camera: FloatArray) -> bool:
    """Whether the dots `seen` (8,) at `uv` (8, 2) px fit a view of the layout (8, 2), and each code dot the others'."""
    view = np.zeros(sv.VIEW_SIZE)
    if not sv.fit_view(layout[seen], uv[seen], camera, True, view) or view[sv.RMS] > _MOST_RMS_MM:
        return False
    if seen[_CODE:].all():
        return True  # all three code dots are read: no one of them decides
    for k in _CODE + np.flatnonzero(seen[_CODE:]):
        others = seen.copy()
        others[k] = False
        if not sv.fit_view(layout[others], uv[others], camera, True, view):
            return False
        if np.hypot(*(np.array(sv.place_of(view, uv[k, 0], uv[k, 1])) - layout[k])) > _MOST_OFF_MM:
            return False
    return True
