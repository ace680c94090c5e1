"""What the refined dots of a reading have to prove before its id is believed.

Eight dots prove their code: a single dot lost and another added makes no other code. But at steep views a millimetre on
the sticker is half a pixel, and the search has to be wide. There a reading is no target whose dots neither are where
they were printed nor look like dots. Seven dots prove less. A speck that passes for a dot, on a sticker that lost two
of its code dots, reads as another target if it is where that one has a dot. So the dots have to be there as exactly as
stickers are printed, look like dots, and be as large as dots.
"""

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.targets import sticker_view as sv
from spherecal.targets.family import TEMPLATE_DOTS
from spherecal.targets.refinement import RefinedDots

_CODE = len(TEMPLATE_DOTS)  # code dots from here on

# Eight dots. Of 3,700 rendered targets seen at more than 60 degrees (rigs A and B, stress table) 3,490 lie within
# 0.06 mm rms of their layout and 97 % within 0.1 mm; those farther off (faint light, dots printed 0.1 and 0.2 mm off)
# have a misfit of 1.2 at most. Misfits from 1.7 to 2.6 come from long streaks of motion and from eightfold light, at
# an rms of 0.04 mm at most. Of 225,000 random clusters of dots the five that read as a target have rms 0.14 to 0.58
# mm, misfit 2.2 to 2.6 and tilt 67 to 76 degrees.
_STEEP_COSINE, _STEEP_RMS_MM, _STEEP_MISFIT = 0.5, 0.1, 1.7

# Seven dots. Rendered stickers with print errors of 0.02 mm a coordinate, up to 80 degrees: rms at most 0.048 mm; a
# code dot within 0.09 mm of where the others put it (99 %, 0.12 beyond 65 degrees); misfit 1, of 181 on drawn damaged
# ones at most 1.7 (a photographed board's grid that passed for a target: 2.96). Of simulated stickers
# with two dots lost and one speck at random, 3 in 10,000 still pass for another target, of those with 8 % of the dots
# lost and as many specks 2 in 57,600; without these limits 29 and 4 in 10,000.
_MOST_RMS_MM, _MOST_OFF_MM, _MOST_MISFIT = 0.06, 0.12, 2.0
_LEAST_DOTS = 7
# Size of the dots over that of the set's: rendered ones 0.92 to 1.06, over-exposed four and eight times 1.17 and 1.28.
# The code's lattice, turned by 45 degrees, fits itself with every root 2 mm for one: dots that pass for a target in
# that way (11 of 45,000 clusters of dots on the lattice) are 1.42 to 1.44 times too large.
_SIZES = 0.8, 1.35


def proven(
    dots: RefinedDots, layouts: FloatArray, views: FloatArray, complete: BoolArray, camera: FloatArray
) -> BoolArray:
    """Which readings, places (n, 8, 2) mm on a 28 mm sticker, are targets (n,) of a camera (f, u, v) px."""
    holds = np.zeros(len(layouts), dtype=bool)
    for i, (uv, layout) in enumerate(zip(dots.uv, layouts, strict=True)):
        seen = np.isfinite(uv[:, 0])
        if complete[i]:
            doubtful = views[i, sv.COSINE] < _STEEP_COSINE and dots.misfit[i] > _STEEP_MISFIT
            holds[i] = not doubtful or _rms_mm(uv, layout, seen, camera) <= _STEEP_RMS_MM
        elif seen.sum() >= _LEAST_DOTS and dots.misfit[i] < _MOST_MISFIT:
            holds[i] = _SIZES[0] < dots.growth[i] < _SIZES[1] and _lie_exactly(uv, layout, seen, camera)
    return holds


def _rms_mm(uv: FloatArray, layout: FloatArray, seen: BoolArray, camera: FloatArray) -> float:
    """Distance of the dots `seen` (8,) at `uv` (8, 2) px from a view of the layout, infinite where there is none."""
    view = np.zeros(sv.VIEW_SIZE)
    fits = seen.sum() >= _CODE and sv.fit_view(layout[seen], uv[seen], camera, True, view)
    return float(view[sv.RMS]) if fits else np.inf


def _lie_exactly(uv: FloatArray, layout: FloatArray, seen: BoolArray, camera: FloatArray) -> bool:
    """Whether the dots fit a view of the layout, and each code dot is where the others put it."""
    if _rms_mm(uv, layout, seen, camera) > _MOST_RMS_MM:
        return False
    if seen[_CODE:].all():
        return True  # all three code dots are read: no one of them decides
    view = np.zeros(sv.VIEW_SIZE)
    for k in _CODE + np.flatnonzero(seen[_CODE:]):
        others = seen.copy()
        others[k] = False
        if not sv.fit_view(layout[others], uv[others], camera, True, view):
            return False
        if np.hypot(*(np.array(sv.place_of(view, uv[k, 0], uv[k, 1])) - layout[k])) > _MOST_OFF_MM:
            return False
    return True
