"""The image of a dot: an ellipse of even light blurred by a Gaussian, with its derivatives.

With p along the ellipse's major axis and q along its minor one, and the chord of half height h(p) = b sqrt(1 - p^2/a^2),

    m(p, q) = integral of f((t - p) / s) / s [F((h(t) - q) / s) - F((-h(t) - q) / s)] dt,  -a < t < a

F and f being the normal distribution and its density. With t = a sin(angle) the integrand is smooth, and the rectangle
rule with strips of 1.5 s has an error below 3e-4: three strips to either side of a pixel make its light.
"""

import math

import numpy as np
from numba import njit
from scipy.special import ndtr

# F and f from a table; linear interpolation errs by less than 1e-5
_PER_UNIT = 64
_REACH = 5
_GRID = np.arange(-_REACH * _PER_UNIT, _REACH * _PER_UNIT + 2) / _PER_UNIT
_NORMAL = np.ascontiguousarray(np.column_stack([ndtr(_GRID), np.exp(-(_GRID**2) / 2) / math.sqrt(2 * math.pi)]))

_STRIP = 1.5  # in blurs
_ALONG = 3.5  # strips farther than this many blurs away add less than 3e-4
MOST_STRIPS = 256

# what `light_at` writes: m, its derivatives by p and q of the pixel, by the blur, by the growth of the ellipse
LIGHT, BY_P, BY_Q, BY_BLUR, BY_GROWTH = range(5)


@njit(nogil=True, cache=True)
def normal(z):
    """The normal distribution and its density at z."""
    place = (z + _REACH) * _PER_UNIT
    if place <= 0:
        return 0.0, 0.0
    if place >= 2 * _REACH * _PER_UNIT:
        return 1.0, 0.0
    index = int(place)
    part = place - index
    below, above = _NORMAL[index], _NORMAL[index + 1]
    return below[0] + part * (above[0] - below[0]), below[1] + part * (above[1] - below[1])


@njit(nogil=True, cache=True)
def cut_strips(long_px, short_px, blur_px, strips):
    """Cut an ellipse with these semi-axes: `strips` (n, 3) gets place, half height and width over blur; returns n."""
    count = min(max(math.ceil(math.pi * long_px / (_STRIP * blur_px)), 6), MOST_STRIPS)
    for j in range(count):
        angle = math.pi * ((j + 0.5) / count - 0.5)
        strips[j, 0], strips[j, 1] = long_px * math.sin(angle), short_px * math.cos(angle)
        strips[j, 2] = long_px * math.cos(angle) * math.pi / count / blur_px
    return count


@njit(nogil=True, cache=True)
def light_at(strips, count, blur_px, growth, p, q, light):
    """Light m at a pixel (p, q) px from the centre, and its derivatives, into `light` (5,).

    The derivatives by blur and growth follow from the diffusion equation dm/ds = s (m_pp + m_qq) and from m being
    unchanged when all lengths are scaled.
    """
    m, m_p, m_q, curved = 0.0, 0.0, 0.0, 0.0
    for j in range(count):
        t = (strips[j, 0] - p) / blur_px
        if t > _ALONG:
            break
        if t < -_ALONG:
            continue
        weight = strips[j, 2] * normal(t)[1]
        above, below = (strips[j, 1] - q) / blur_px, (-strips[j, 1] - q) / blur_px
        to_above, at_above = normal(above)
        to_below, at_below = normal(below)
        part = weight * (to_above - to_below)
        m += part
        m_p += part * t
        m_q -= weight * (at_above - at_below)
        curved += part * (t * t - 1) - weight * (above * at_above - below * at_below)
    m_p, m_q = m_p / blur_px, m_q / blur_px
    light[LIGHT], light[BY_P], light[BY_Q] = m, m_p, m_q
    light[BY_BLUR] = curved / blur_px
    light[BY_GROWTH] = -(curved + p * m_p + q * m_q) / growth
