"""Normal equations of a sticker's dots: four unknowns of each dot, two shared by all, solved by elimination.

The unknowns of a dot are its centre, amplitude and background; the shared ones are blur and growth.
"""

import math

import numpy as np

from spherecal.base.kernels import BARE, KERNEL, njit

ROW = 8  # of a pixel: derivatives by six unknowns, the right side, and the weight
RIGHT, WEIGHT = 6, 7

_OWN = 4
_BLUR_LIMITS_PX = (0.3, 6.0)
_GROWTH_LIMITS = (0.6, 1.6)


@njit(**KERNEL)
def solve_step(equations, present, prior, pull, dots, shared):
    """One step of all unknowns, applied to `dots` and `shared`; returns the largest change of a centre or the blur, px.

    NaN if the equations are singular.

    `present`: which dots take part, (8,); `prior`, `pull` (2,); `dots`: centre, amplitude and background of the dots,
    (8, 4), updated.
    """
    # rows L^-1 times: the coupling with blur, with growth, the right side
    reduced = np.zeros((8, 3, _OWN))
    bb, bg, gg = 1 / prior[0] ** 2, 0.0, 1 / prior[1] ** 2
    rb, rg = pull
    for k in range(8):
        if not present[k]:
            continue
        bb, bg, gg = bb + equations[k, 4, 4], bg + equations[k, 5, 4], gg + equations[k, 5, 5]
        rb, rg = rb + equations[k, 4, RIGHT], rg + equations[k, 5, RIGHT]
        if not _factor(equations, k):
            return np.nan
        _reduce(equations, k, reduced)
        for i in range(_OWN):
            b, g, r = reduced[k, 0, i], reduced[k, 1, i], reduced[k, 2, i]
            bb, bg, gg, rb, rg = bb - b * b, bg - b * g, gg - g * g, rb - b * r, rg - g * r
    det = bb * gg - bg * bg
    if not det > 0:
        return np.nan
    blur, growth = (gg * rb - bg * rg) / det, (bb * rg - bg * rb) / det
    largest = abs(blur)
    for k in range(8):
        if present[k]:
            largest = max(largest, _move(equations, k, reduced, blur, growth, dots))
    shared[0] = min(max(shared[0] + blur, _BLUR_LIMITS_PX[0]), _BLUR_LIMITS_PX[1])
    shared[1] = min(max(shared[1] + growth, _GROWTH_LIMITS[0]), _GROWTH_LIMITS[1])
    return largest


@njit(**BARE)
def _factor(equations, k):
    """Cholesky factor of dot k's own block, in place; False if it is not positive definite."""
    for i in range(_OWN):
        for j in range(i + 1):
            value = equations[k, i, j]
            for m in range(j):
                value -= equations[k, i, m] * equations[k, j, m]
            if i == j:
                if not value > 0:
                    return False
                equations[k, i, i] = math.sqrt(value)
            else:
                equations[k, i, j] = value / equations[k, j, j]
    return True


@njit(**BARE)
def _reduce(equations, k, reduced):
    for c in range(3):
        for i in range(_OWN):
            value = equations[k, i, RIGHT] if c == 2 else equations[k, _OWN + c, i]
            for m in range(i):
                value -= equations[k, i, m] * reduced[k, c, m]
            reduced[k, c, i] = value / equations[k, i, i]


@njit(**KERNEL)
def _move(equations, k, reduced, blur, growth, dots):
    """Apply the step of dot k's own unknowns; returns the move of its centre."""
    step = np.empty(_OWN)
    for i in range(_OWN - 1, -1, -1):
        value = reduced[k, 2, i] - blur * reduced[k, 0, i] - growth * reduced[k, 1, i]
        for m in range(i + 1, _OWN):
            value -= equations[k, m, i] * step[m]
        step[i] = value / equations[k, i, i]
    for i in range(_OWN):
        dots[k, i] += step[i]
    return math.hypot(step[0], step[1])


@njit(**KERNEL)
def set_covariance(equations, k, factor, covariance):
    """Covariance uu uv vv of the centre of dot k, times `factor`, px^2: the leading block of (L L')^-1.

    `covariance`: output: row k of (8, 3).
    """
    columns = np.zeros((2, _OWN))
    for c in range(2):
        for i in range(c, _OWN):
            value = 1.0 if i == c else 0.0
            for m in range(i):
                value -= equations[k, i, m] * columns[c, m]
            columns[c, i] = value / equations[k, i, i]
    covariance[k, 0] = factor * (columns[0] * columns[0]).sum()
    covariance[k, 1] = factor * (columns[0] * columns[1]).sum()
    covariance[k, 2] = factor * (columns[1] * columns[1]).sum()


@njit(**BARE)
def light_variances(equations, k):
    """Variances of dot k's amplitude and background from its factor L: elements (2, 2) and (3, 3) of (L L')^-1."""
    of_background = 1 / equations[k, 3, 3] ** 2
    coupled = equations[k, 3, 2] / equations[k, 2, 2]
    return 1 / equations[k, 2, 2] ** 2 + coupled * coupled * of_background, of_background
