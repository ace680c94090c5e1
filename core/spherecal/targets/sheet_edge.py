"""Light that blur carries from beyond the edge of a sticker onto its dots.

The surroundings next to each side of the sheet are taken as even; their light comes in with the profile of a straight
blurred edge. Left out, a ball of a quarter of the dots' light shifts the outer dots by 0.05 px at a blur of 2 px.
"""

import math

import numpy as np

from spherecal.base.kernels import BARE, KERNEL, njit
from spherecal.targets.blurred_ellipse import normal

_HALF_SHEET_MM = 14.0
_NEAR = 3.0  # blurs: no light comes in from farther
_BEYOND_BLURS, _BEYOND_PX = 3.0, 1.0  # where the surroundings are looked at, outside the edge
_ALONG_MM = (-2.0, -1.0, 0.0, 1.0, 2.0)

# a side of the sheet as a dot sees it: how far inside it lies, in blurs; the change of that per px in u and v; the
# light beyond
_INSIDE, _PER_U, _PER_V, _LIGHT = range(4)


@njit(**KERNEL)
def near_sides(image, place, per_px, u, v, reach_px, blur, sides):
    """Number of sides of the sheet whose light may reach the pixels near a dot.

    `image`: grey image, (h, w); `place`, `per_px` (2,) mm; `u`, `v`: the dot in the image, px; `sides`: output, (4, 4).
    """
    det = per_px[0] * per_px[3] - per_px[1] * per_px[2]
    values = np.empty(len(_ALONG_MM))
    count = 0
    for axis in range(2):
        px_per_mm = 1 / math.sqrt(per_px[2 * axis] ** 2 + per_px[2 * axis + 1] ** 2)
        for sign in (1.0, -1.0):
            inside_px = (_HALF_SHEET_MM - sign * place[axis]) * px_per_mm
            if inside_px - reach_px > _NEAR * blur:
                continue
            sides[count, _INSIDE] = inside_px / blur
            sides[count, _PER_U] = -sign * per_px[2 * axis] * px_per_mm / blur
            sides[count, _PER_V] = -sign * per_px[2 * axis + 1] * px_per_mm / blur
            out = sign * (_HALF_SHEET_MM + (_BEYOND_BLURS * blur + _BEYOND_PX) / px_per_mm) - place[axis]
            looked = 0
            for along in _ALONG_MM:
                dx, dy = (out, along) if axis == 0 else (along, out)
                column = round(u + (per_px[3] * dx - per_px[1] * dy) / det)
                row = round(v + (per_px[0] * dy - per_px[2] * dx) / det)
                if 0 <= column < image.shape[1] and 0 <= row < image.shape[0]:
                    values[looked] = image[row, column]
                    looked += 1
            sides[count, _LIGHT] = np.median(values[:looked]) if looked else np.nan
            count += 1
    return count


@njit(**BARE)
def leak(sides, count, background, du, dv):
    """Light in excess of the background at a pixel, and its least distance from an edge in blurs, at most 3.

    `du`, `dv`: the pixel, in px from the dot.
    """
    light, least = 0.0, _NEAR
    for side in range(count):
        inside = sides[side, _INSIDE] + sides[side, _PER_U] * du + sides[side, _PER_V] * dv
        least = min(least, inside)
        if inside < _NEAR and not math.isnan(sides[side, _LIGHT]):
            light += (sides[side, _LIGHT] - background) * (1 - normal(inside)[0])
    return light, least
