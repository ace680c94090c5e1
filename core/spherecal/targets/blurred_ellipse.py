"""The image of a dot: an ellipse of even light blurred by a Gaussian, with its derivatives.

With p along the ellipse's major axis, q along its minor one, and the chord of half height h(p) = b sqrt(1 - p^2/a^2),

    m(p, q) = integral of f((t - p) / s) / s [F((h(t) - q) / s) - F((-h(t) - q) / s)] dt,  -a < t < a

F and f being the normal distribution and its density. With t = a sin(angle) the integrand is smooth. A sum over strips
of 1.5 s needs only those up to three s from the pixel. Its error is below 4e-3, symmetrical about the centre. Where the
ellipse is wide against the blur, m is the blurred edge of a curved half plane, with an error of 2e-2 at the tips (rms
5e-3):

    m = F(d / s - k s / 2),  d = distance inside the edge along the ray, k = the edge's curvature there
"""

import math

import numpy as np
from scipy.special import ndtr

from spherecal.base.kernels import BARE, njit

# F and f from a table, rows value and difference to the next of either; linear interpolation errs by less than 1e-5
_PER_UNIT = 64
_REACH = 4
_GRID = np.arange(-_REACH * _PER_UNIT, _REACH * _PER_UNIT + 2) / _PER_UNIT
_VALUES = np.column_stack([ndtr(_GRID), np.exp(-(_GRID**2) / 2) / math.sqrt(2 * math.pi)])
_NORMAL = np.ascontiguousarray(np.column_stack([_VALUES[:-1], np.diff(_VALUES, axis=0)]))

_STRIP = 1.5  # in blurs
_ALONG = 3.2  # strips farther than this many blurs away add less than 1e-3
MOST_STRIPS = 256

# The edge alone decides where the smaller semi-axis and the radius of the tips are larger than so many blurs. Without
# the second limit dots of 26 x 5 px err by 0.1 at their tips, which gave targets of rig B beyond 65 degrees misfits of
# 1.4 and uncertainties a fifth too large.
_WIDE, _BLUNT = 3.0, 2.0


@njit(**BARE)
def normal(z):
    """The normal distribution and its density at z; beyond 4 standard deviations 0 or 1, and 0."""
    if z <= -_REACH:
        return 0.0, 0.0
    if z >= _REACH:
        return 1.0, 0.0
    place = (z + _REACH) * _PER_UNIT
    index = np.uint32(place)  # no sign: nothing asks whether to count from the end
    part = place - index
    return _NORMAL[index, 0] + part * _NORMAL[index, 2], _NORMAL[index, 1] + part * _NORMAL[index, 3]


@njit(**BARE)
def cut_strips(long_px, short_px, blur_px, strips, k):
    """Cut ellipse k into strips across its long axis; returns their number n, at most `MOST_STRIPS`."""
    count = min(max(math.ceil(math.pi * long_px / (_STRIP * blur_px)), 6), MOST_STRIPS)
    for j in range(count):
        angle = math.pi * ((j + 0.5) / count - 0.5)
        strips[k, j, 0], strips[k, j, 1] = long_px * math.sin(angle), short_px * math.cos(angle)
        strips[k, j, 2] = long_px * math.cos(angle) * math.pi / count / blur_px
    return count


@njit(**BARE)
def needs_strips(long_px, short_px, blur_px):
    """Whether an ellipse is too narrow, or its tips too pointed, for `light_at_edge`."""
    return short_px <= _WIDE * blur_px or short_px * short_px <= _BLUNT * blur_px * long_px


@njit(**BARE)
def light_at(strips, k, count, per_blur, growth, p, q):
    """Light m at a place in the blurred ellipse, and its derivatives by p, q, blur and the growth of the ellipse.

    The derivatives by blur and growth follow from the diffusion equation dm/ds = s (m_pp + m_qq) and from m being
    unchanged when all lengths are scaled.

    `per_blur`: 1 / blur, 1/px.
    """
    m, m_p, m_q, curved = 0.0, 0.0, 0.0, 0.0
    for j in range(count):
        t = (strips[k, j, 0] - p) * per_blur
        if t > _ALONG:
            break
        if t < -_ALONG:
            continue
        weight = strips[k, j, 2] * normal(t)[1]
        above, below = (strips[k, j, 1] - q) * per_blur, (-strips[k, j, 1] - q) * per_blur
        to_above, at_above = normal(above)
        to_below, at_below = normal(below)
        part = weight * (to_above - to_below)
        m += part
        m_p += part * t
        m_q -= weight * (at_above - at_below)
        curved += part * (t * t - 1) - weight * (above * at_above - below * at_below)
    m_p, m_q = m_p * per_blur, m_q * per_blur
    return m, m_p, m_q, curved * per_blur, -(curved + p * m_p + q * m_q) / growth


@njit(**BARE)
def distance_inside(per_long, per_short, p, q):
    """Distance in px of a place from the edge of an ellipse along the ray from its centre, negative outside."""
    along, across = p * per_long, q * per_short
    squared = along * along + across * across
    steepness = (along * per_long) ** 2 + (across * per_short) ** 2
    return (math.sqrt(squared) - squared) / math.sqrt(steepness) if steepness > 1e-12 else 1 / per_short


@njit(**BARE)
def light_at_edge(per_long, per_short, blur, per_blur, growth, p, q):
    """What `light_at` returns, for an ellipse wide against the blur.

    `per_long`, `per_short`: 1 over the semi-axes, 1/px; `blur`, `per_blur`: standard deviation of the blur in px, and 1
    over it.
    """
    along, across = p * per_long, q * per_short
    squared = along * along + across * across
    slope_p, slope_q = along * per_long, across * per_short
    steepness = slope_p * slope_p + slope_q * slope_q
    if steepness < 1e-12:
        return 1.0, 0.0, 0.0, 0.0, 0.0
    polar, per_steep = math.sqrt(squared), 1 / math.sqrt(steepness)
    inside = (polar - squared) * per_steep
    scale = polar * per_steep  # 1 / gradient of the polar radius
    half_bend = 0.5 * (per_long * per_short) ** 2 * scale * scale * scale
    m, density = normal(inside * per_blur - half_bend * blur)
    fall = -density * per_blur * per_steep
    m_p, m_q = fall * slope_p, fall * slope_q
    m_blur = -density * (inside * per_blur * per_blur + half_bend)
    return m, m_p, m_q, m_blur, -(blur * m_blur + p * m_p + q * m_q) / growth
