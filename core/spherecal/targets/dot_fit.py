"""Sub-pixel centres: the eight dots of a sticker fitted together as blurred ellipses of one shape.

Light of a dot at pixel x:  (b + a m(x)) (1 + g . (x - c)),  m = F(d / s) - F(d' / s)

with the centre c, amplitude a and background b of each dot; F the normal distribution; d and d' the distances of x
inside the near and far edge of the dot's ellipse along the ray from c. Shape and tilt of the ellipses come from the
sticker's view (sticker_view.py) and are not free: that is what keeps a steep dot's shape apart from its amplitude.
Shared by a sticker are the blur s, the dots' growth (ink gain) and the slope g of the light, which is that of the
plane through the eight amplitudes: left out it shifts a dot by up to 0.01 px, free per dot it doubles the variance.
Pixels belong to the nearest dot, and the light of its neighbours is taken off. Gauss-Newton with iterated weights:
the camera's noise times Cauchy's weight. m is symmetrical about c, so that its misfit to the true image of a dot does
not shift the centre.
"""

import math

import numpy as np
from numba import njit

from spherecal.targets.sticker_view import local_affine

# state of a dot: centre in px, amplitude and background in grey
CU, CV, AMPLITUDE, BACKGROUND = range(4)
# shared state of a sticker: blur in px, radius / nominal radius, slope of the amplitude in grey/px, normalised rms
BLUR, GROWTH, SLOPE_U, SLOPE_V, MISFIT = range(5)
# sums over flat pixels by light: light, squared residual, number
BINS = 24

_WINDOW_BLURS, _WINDOW_PX = 2.5, 1.0  # pixels used beyond a dot's edge: only they tell the background
_FAR_EDGE = 4.0  # in blurs: farther away the other edge changes nothing
_CAUCHY = 4.0  # standard deviations
_SETTLED_PX = 1e-3  # Gauss-Newton converges at least tenfold a step here: what is left is below 1e-4 px
_LOST_PX = 3.0
_LEAST_PIXELS = 8
_HALF_SHEET_MM = 14.0
_SHEET_EDGE_BLURS = 1.5  # beyond the sticker the ball's light begins
_FLAT = 0.02  # change of m per px below which a pixel shows noise rather than misfit

_SQRT2 = math.sqrt(2.0)
_NORMAL = 1 / math.sqrt(2 * math.pi)


@njit(nogil=True, cache=True)
def fit_sticker(image, layout, radius, view, present, clip, noise, prior, steps, dots, shared, covariance, bins):
    """Fit the dots of one sticker from the start in `dots` (8, 4) and `shared` (5,), both overwritten.

    `noise` (2,): variance = noise[0] + noise[1] * light. `clip`: grey value at which a pixel is saturated. `prior`
    (2,): standard deviations of blur (px) and growth about their start. `covariance` (8, 3) gets uu uv vv in px^2 as the
    noise makes it; `bins` (BINS, 3) is added to. Returns False if a dot is lost (too few pixels, or it wandered off).
    """
    shapes = np.empty((8, 6))
    for k in range(8):
        if present[k]:
            _set_shape(view, layout[k, 0], layout[k, 1], radius, shapes, k)
    start_blur, start_growth = shared[BLUR], shared[GROWTH]
    normal, right, own_bins = np.zeros((8, 6, 6)), np.zeros((8, 6)), np.empty_like(bins)
    for _ in range(steps):
        _set_slope(dots, present, shared)
        normal[:], right[:], own_bins[:] = 0.0, 0.0, 0.0
        total, pixels = 0.0, 0
        for k in range(8):
            if present[k]:
                misfit, count = _add_dot(
                    image, layout, radius, shapes, k, present, clip, noise, dots, shared, normal, right, own_bins
                )
                if count < _LEAST_PIXELS:
                    return False
                total, pixels = total + misfit, pixels + count
        shared[MISFIT] = math.sqrt(total / pixels)
        pull = (start_blur - shared[BLUR]) / prior[0] ** 2, (start_growth - shared[GROWTH]) / prior[1] ** 2
        change = _solve(normal, right, present, prior, pull, dots, shared)
        if not change < _LOST_PX:
            return False
        if change < _SETTLED_PX:
            break
    bins += own_bins
    for k in range(8):
        if present[k]:
            _set_covariance(normal, k, covariance)
    return True


@njit(nogil=True, cache=True)
def _set_shape(view, x, y, radius, shapes, k):
    """Inverse of the map from the unit circle to dot k's ellipse (4) and the ellipse's half extent in u and v."""
    uu, uv, vu, vv = local_affine(view, x, y)
    det = (uu * vv - uv * vu) * radius
    shapes[k, 0], shapes[k, 1], shapes[k, 2], shapes[k, 3] = vv / det, -uv / det, -vu / det, uu / det
    shapes[k, 4], shapes[k, 5] = radius * math.hypot(uu, uv), radius * math.hypot(vu, vv)


@njit(nogil=True, cache=True)
def _set_slope(dots, present, shared):
    """Slope of the plane through the amplitudes of the dots; 0 where fewer than five are there."""
    n, u, v, a = 0.0, 0.0, 0.0, 0.0
    for k in range(8):
        if present[k]:
            n, u, v, a = n + 1, u + dots[k, CU], v + dots[k, CV], a + dots[k, AMPLITUDE]
    u, v, a = u / n, v / n, a / n
    uu, uv, vv, ua, va = 1e-9, 0.0, 1e-9, 0.0, 0.0
    for k in range(8):
        if present[k]:
            du, dv, da = dots[k, CU] - u, dots[k, CV] - v, dots[k, AMPLITUDE] - a
            uu, uv, vv, ua, va = uu + du * du, uv + du * dv, vv + dv * dv, ua + du * da, va + dv * da
    det = uu * vv - uv * uv
    enough = n >= 5 and det > 1e-3 * uu * vv
    shared[SLOPE_U] = (vv * ua - uv * va) / det if enough else 0.0
    shared[SLOPE_V] = (uu * va - uv * ua) / det if enough else 0.0


@njit(nogil=True, cache=True)
def _distance(shapes, k, du, dv):
    """Polar radius in dot k's ellipse, its gradient's length 1/px and direction (u, v)."""
    x, y = shapes[k, 0] * du + shapes[k, 1] * dv, shapes[k, 2] * du + shapes[k, 3] * dv
    if abs(x) + abs(y) < 1e-6:
        x = 1e-6
    polar = math.hypot(x, y)
    gu, gv = (shapes[k, 0] * x + shapes[k, 2] * y) / polar, (shapes[k, 1] * x + shapes[k, 3] * y) / polar
    steep = math.hypot(gu, gv)
    return polar, steep, gu / steep, gv / steep


@njit(nogil=True, cache=True)
def _edge(z):
    """The normal distribution and its density."""
    return 0.5 * (1 + math.erf(z / _SQRT2)), _NORMAL * math.exp(-0.5 * z * z)


@njit(nogil=True, cache=True)
def _neighbours_light(shapes, k, present, dots, shared, u, v, own):
    """Light of the other dots at a pixel; negative if one of them is nearer than `own` (px inside the edge)."""
    light = 0.0
    reach = 2 * (_WINDOW_BLURS * shared[BLUR] + _WINDOW_PX)
    for j in range(8):
        if j == k or not present[j]:
            continue
        du, dv = u - dots[j, CU], v - dots[j, CV]
        if abs(du) > shapes[j, 4] + reach or abs(dv) > shapes[j, 5] + reach:
            continue
        polar, steep, _, _ = _distance(shapes, j, du, dv)
        inside = (shared[GROWTH] - polar) / steep
        if inside > own:
            return -1.0
        light += max(dots[j, AMPLITUDE], 0.0) * _edge(inside / shared[BLUR])[0]
    return light


@njit(nogil=True, cache=True)
def _add_dot(image, layout, radius, shapes, k, present, clip, noise, dots, shared, normal, right, bins):
    """Add dot k's pixels to its normal equations; returns the weighted sum of squared residuals and their number."""
    blur, growth = shared[BLUR], shared[GROWTH]
    cu, cv, amplitude, background = dots[k, CU], dots[k, CV], dots[k, AMPLITUDE], dots[k, BACKGROUND]
    slope_u, slope_v = shared[SLOPE_U] / max(amplitude, 1e-9), shared[SLOPE_V] / max(amplitude, 1e-9)
    reach = _WINDOW_BLURS * blur + _WINDOW_PX
    half_u, half_v = shapes[k, 4] * growth + reach, shapes[k, 5] * growth + reach
    limit_x = _HALF_SHEET_MM - _SHEET_EDGE_BLURS * blur * radius * math.hypot(shapes[k, 0], shapes[k, 1])
    limit_y = _HALF_SHEET_MM - _SHEET_EDGE_BLURS * blur * radius * math.hypot(shapes[k, 2], shapes[k, 3])
    if not (1 < cu < image.shape[1] - 2 and 1 < cv < image.shape[0] - 2):
        return 0.0, 0
    total, pixels = 0.0, 0
    row = np.empty(6)
    for v in range(max(int(math.ceil(cv - half_v)), 0), min(int(cv + half_v), image.shape[0] - 1) + 1):
        for u in range(max(int(math.ceil(cu - half_u)), 0), min(int(cu + half_u), image.shape[1] - 1) + 1):
            du, dv = u - cu, v - cv
            polar, steep, nu, nv = _distance(shapes, k, du, dv)
            inside = (growth - polar) / steep
            if inside < -reach:
                continue
            x = layout[k, 0] + radius * (shapes[k, 0] * du + shapes[k, 1] * dv)
            y = layout[k, 1] + radius * (shapes[k, 2] * du + shapes[k, 3] * dv)
            if abs(x) > limit_x or abs(y) > limit_y:
                continue
            others = _neighbours_light(shapes, k, present, dots, shared, u, v, inside)
            if others < 0:
                continue
            near, near_density = _edge(inside / blur)
            far, far_density = 0.0, 0.0
            beyond = (-growth - polar) / steep
            if beyond > -_FAR_EDGE * blur:
                far, far_density = _edge(beyond / blur)
            m = near - far
            shade = 1 + slope_u * du + slope_v * dv
            light = (background + amplitude * m) * shade + others
            value = float(image[v, u])
            variance = noise[0] + noise[1] * max(light, 0.0)
            # a saturated pixel only says that the light was at least that
            if value >= clip and light > clip - 2 * math.sqrt(variance):
                continue
            rise = (near_density - far_density) / blur
            row[0] = amplitude * rise * nu * shade - (background + amplitude * m) * slope_u
            row[1] = amplitude * rise * nv * shade - (background + amplitude * m) * slope_v
            row[2] = m * shade
            row[3] = shade
            row[4] = amplitude * (beyond * far_density - inside * near_density) / (blur * blur)
            row[5] = amplitude * (near_density + far_density) / (blur * steep)
            residual = value - light
            weight = 1 / (variance + residual * residual / (_CAUCHY * _CAUCHY))
            for i in range(6):
                for j in range(i + 1):
                    normal[k, i, j] += weight * row[i] * row[j]
                right[k, i] += weight * row[i] * residual
            total += weight * residual * residual
            pixels += 1
            if abs(rise) < _FLAT:
                index = min(max(int(BINS * light / clip), 0), BINS - 1)
                bins[index, 0] += light
                bins[index, 1] += min(residual * residual, 16 * variance)
                bins[index, 2] += 1
    return total, pixels


@njit(nogil=True, cache=True)
def _factor(matrix, n):
    """Cholesky factor of the leading n x n block, in place (lower triangle); False if it is not positive definite."""
    for i in range(n):
        for j in range(i + 1):
            value = matrix[i, j]
            for m in range(j):
                value -= matrix[i, m] * matrix[j, m]
            if i == j:
                if value <= 0:
                    return False
                matrix[i, i] = math.sqrt(value)
            else:
                matrix[i, j] = value / matrix[j, j]
    return True


@njit(nogil=True, cache=True)
def _solve(normal, right, present, prior, pull, dots, shared):
    """One step of all unknowns, applied; the dots' own are eliminated first. Returns the largest move of a centre, px.

    Leaves in `normal` the Cholesky factors L of the dots' own 4 x 4 blocks. NaN if a block is singular.
    """
    bb, bg, gg = 1 / prior[0] ** 2, 0.0, 1 / prior[1] ** 2
    rb, rg = pull
    coupling = np.empty((8, 3, 4))  # L^-1 times (column of blur, of growth, right side)
    for k in range(8):
        if not present[k]:
            continue
        matrix = normal[k]
        bb, bg, gg = bb + matrix[4, 4], bg + matrix[5, 4], gg + matrix[5, 5]
        rb, rg = rb + right[k, 4], rg + right[k, 5]
        if not _factor(matrix, 4):
            return np.nan
        for c in range(3):
            for i in range(4):
                value = right[k, i] if c == 2 else matrix[4 + c, i]
                for m in range(i):
                    value -= matrix[i, m] * coupling[k, c, m]
                coupling[k, c, i] = value / matrix[i, i]
        for i in range(4):
            b, g, r = coupling[k, 0, i], coupling[k, 1, i], coupling[k, 2, i]
            bb, bg, gg, rb, rg = bb - b * b, bg - b * g, gg - g * g, rb - b * r, rg - g * r
    det = bb * gg - bg * bg
    if not det > 0:
        return np.nan
    blur, growth = (gg * rb - bg * rg) / det, (bb * rg - bg * rb) / det
    shared[BLUR] = min(max(shared[BLUR] + blur, 0.3), shared[BLUR] + 1.0)
    shared[GROWTH] = min(max(shared[GROWTH] + growth, 0.5), 2.0)
    largest = 0.0
    step = np.empty(4)
    for k in range(8):
        if present[k]:
            for i in range(3, -1, -1):
                value = coupling[k, 2, i] - blur * coupling[k, 0, i] - growth * coupling[k, 1, i]
                for m in range(i + 1, 4):
                    value -= normal[k, m, i] * step[m]
                step[i] = value / normal[k, i, i]
            for i in range(4):
                dots[k, i] += step[i]
            largest = max(largest, math.hypot(step[0], step[1]))
    return largest


@njit(nogil=True, cache=True)
def _set_covariance(normal, k, covariance):
    """Covariance of dot k's centre from the Cholesky factor of its block: the leading block of (L L')^-1."""
    columns = np.zeros((2, 4))
    for c in range(2):
        for i in range(4):
            value = 1.0 if i == c else 0.0
            for m in range(i):
                value -= normal[k, i, m] * columns[c, m]
            columns[c, i] = value / normal[k, i, i]
    covariance[k, :] = 0.0
    for i in range(4):
        covariance[k, 0] += columns[0, i] * columns[0, i]
        covariance[k, 1] += columns[0, i] * columns[1, i]
        covariance[k, 2] += columns[1, i] * columns[1, i]
