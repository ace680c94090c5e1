"""Sub-pixel centres: the eight dots of a sticker fitted together as blurred ellipses of one shape.

Light of a dot at pixel x:  b + h . (x - c) + a m (1 + g . (x - c)) + a blur^2 g . grad m,  m as in blurred_ellipse.py

with the centre c, amplitude a and background b of each dot. Shape and tilt of the ellipses come from the sticker's view
(sticker_view.py) and are not free: that is what keeps a steep dot's shape apart from its amplitude.

Shared by a sticker are the blur, the dots' growth (ink gain) and the slopes of the light: a g of the amplitude, h of
the background, those of the planes through the eight of each. The first left out shifts a dot by up to 0.01 px, the
second, where the film shines, by 0.003 px, the same way for all cameras; free per dot they double the variance.
Pixels belong to the next dot, and the light of its neighbours is taken off. Gauss-Newton with iterated weights: the
camera's noise times Cauchy's weight, which drops what scratches and highlights add.
"""

import math

import numpy as np

from spherecal.base.kernels import BARE, KERNEL, njit
from spherecal.targets import blurred_ellipse as ellipse
from spherecal.targets.dot_equations import RIGHT, ROW, WEIGHT, light_variances, set_covariance, solve_step
from spherecal.targets.sheet_edge import leak, near_sides
from spherecal.targets.sticker_view import local_affine

# state of a dot: centre in px, amplitude and background in grey
CU, CV, AMPLITUDE, BACKGROUND = range(4)
# shared state of a sticker: blur in px, radius / nominal radius, slope of the amplitude in grey/px, normalised rms
BLUR, GROWTH, SLOPE_U, SLOPE_V, MISFIT = range(5)
SHARED_SIZE = 5
BINS = 24

# shape of a dot: direction of the long axis, semi-axes in px, half extent in u and v, place on the sticker per px
_LONG_U, _LONG_V, _LONG, _SHORT, _HALF_U, _HALF_V, _X_U, _X_V, _Y_U, _Y_V = range(10)
_SHAPE_SIZE = 10

_WINDOW_BLURS, _WINDOW_PX = 2.0, 0.6  # pixels used beyond a dot's edge: only they show the background
_CAUCHY = 1 / 16  # one over the square of 4 standard deviations
_MODEL_ERROR = 0.003  # of the amplitude: the blur's form, and print
_SETTLED_PX = 0.005  # Gauss-Newton converges twentyfold a step here: what is left is below 5e-4 px
# Departures of dots and their surroundings from planes over the sticker, standard deviations as parts of the dots'
# light: they matter only where a dot does not show its own amplitude (saturated) or background (blurred).
_EVEN_AMPLITUDE, _EVEN_BACKGROUND = 0.03, 0.01
_FAINT = 4.0  # blurs outside a dot's edge: its light is below 1e-4 there
_LOST_PX = 3.0
_LEAST_PIXELS = 8
_SHEET_EDGE_BLURS = 1.0  # pixels nearer to the edge of the sticker see half of the light around it: its cut is rough
_PERFECT = 0.86  # mean square of the residuals over their noise, with Cauchy's weight, where the model is true
_FLAT = 0.02  # change of m per px below which a pixel shows noise rather than misfit


@njit(**KERNEL)
def fit_sticker(  # noqa: C901, PLR0912 - one kernel: its arrays live through all steps
    image, layout, radius, view, present, top, clip, noise, prior, steps, dots, shared, covariance, bins
):
    """Fit the dots of one sticker; False if a dot is lost (too few pixels, or it wandered off).

    `image`: grey image, (h, w); `layout`, `radius`: places (8, 2) and radius of the dots, in the unit of the view;
    `present`: which dots to fit, (8,); `noise` (3,); `prior`: standard deviations of blur (px) and growth about their
    start, (2,); `dots`, `shared` (8, 4); `covariance`: output: uu uv vv of the centres, (8, 3) px^2, of noise and
    misfit.
    """
    shapes = np.empty((8, _SHAPE_SIZE))
    for k in range(8):
        if present[k]:
            _set_shape(view, layout[k, 0], layout[k, 1], radius, shapes, k)
    start_blur, start_growth = shared[BLUR], shared[GROWTH]
    equations, own_bins, misfits = np.zeros((8, 6, ROW)), np.empty_like(bins), np.empty(8)
    strips, counts = np.empty((8, ellipse.MOST_STRIPS, 3)), np.empty(8, np.int64)
    weights, planes = np.ones((2, 8)), np.empty((2, 5))
    for step in range(steps):
        _fit_plane(dots, AMPLITUDE, present, weights[0], planes[0])
        _fit_plane(dots, BACKGROUND, present, weights[1], planes[1])
        shared[SLOPE_U], shared[SLOPE_V] = planes[0, 3], planes[0, 4]
        _cut_dots(shapes, present, shared, strips, counts)
        equations[:], own_bins[:] = 0.0, 0.0
        total, pixels = 0.0, 0
        for k in range(8):
            if present[k]:
                misfit, count = _add_dot(
                    image, layout, shapes, k, present, top, clip, noise, dots, shared, planes[1], strips, counts,
                    equations, own_bins,
                )  # fmt: skip
                if count < _LEAST_PIXELS:
                    return False
                misfits[k] = misfit / (_PERFECT * count)
                total, pixels = total + misfit, pixels + count
                if step > 0:
                    light = abs(planes[0, 2])
                    _hold_to_plane(dots, k, AMPLITUDE, planes[0], _EVEN_AMPLITUDE * light, equations)
                    _hold_to_plane(dots, k, BACKGROUND, planes[1], _EVEN_BACKGROUND * light, equations)
        shared[MISFIT] = math.sqrt(total / (_PERFECT * pixels))
        pull = (start_blur - shared[BLUR]) / prior[0] ** 2, (start_growth - shared[GROWTH]) / prior[1] ** 2
        change = solve_step(equations, present, prior, pull, dots, shared)
        if not change < _LOST_PX:
            return False
        for k in range(8):
            if present[k]:
                light = abs(planes[0, 2])
                of_amplitude, of_background = light_variances(equations, k)
                weights[0, k] = 1 / (of_amplitude + (_EVEN_AMPLITUDE * light) ** 2)
                weights[1, k] = 1 / (of_background + (_EVEN_BACKGROUND * light) ** 2)
        if change < _SETTLED_PX:
            break
    bins += own_bins
    for k in range(8):
        if present[k]:
            # by chance half of the dots misfit less than the sticker: with 1 as the least, sigmas were 8 % too large
            set_covariance(equations, k, max(misfits[k], shared[MISFIT] ** 2), covariance)
    return True


@njit(**BARE)
def _set_shape(view, x, y, radius, shapes, k):
    """The ellipse of dot k from the derivatives of the view at its place."""
    uu, uv, vu, vv = local_affine(view, x, y)
    det = uu * vv - uv * vu
    shapes[k, _X_U], shapes[k, _X_V], shapes[k, _Y_U], shapes[k, _Y_V] = vv / det, -uv / det, -vu / det, uu / det
    a, b, c = uu * uu + uv * uv, uu * vu + uv * vv, vu * vu + vv * vv
    angle = 0.5 * math.atan2(2 * b, a - c)
    half, root = (a + c) / 2, math.hypot((a - c) / 2, b)
    shapes[k, _LONG_U], shapes[k, _LONG_V] = math.cos(angle), math.sin(angle)
    shapes[k, _LONG], shapes[k, _SHORT] = radius * math.sqrt(half + root), radius * math.sqrt(max(half - root, 1e-9))
    shapes[k, _HALF_U], shapes[k, _HALF_V] = radius * math.sqrt(a), radius * math.sqrt(c)


@njit(**BARE)
def _fit_plane(dots, column, present, weights, plane):
    """Weighted plane through amplitudes or backgrounds over the image: mean u, v, value, slopes per px in `plane` (5,).

    Level where fewer than five dots are there.
    """
    dots_there, n, u, v, a = 0, 0.0, 0.0, 0.0, 0.0
    for k in range(8):
        if present[k]:
            w = weights[k]
            dots_there += 1
            n, u, v, a = n + w, u + w * dots[k, CU], v + w * dots[k, CV], a + w * dots[k, column]
    u, v, a = u / n, v / n, a / n
    uu, uv, vv, ua, va = 1e-9, 0.0, 1e-9, 0.0, 0.0
    for k in range(8):
        if present[k]:
            du, dv, da, w = dots[k, CU] - u, dots[k, CV] - v, dots[k, column] - a, weights[k]
            uu, uv, vv = uu + w * du * du, uv + w * du * dv, vv + w * dv * dv
            ua, va = ua + w * du * da, va + w * dv * da
    det = uu * vv - uv * uv
    plane[0], plane[1], plane[2], plane[3], plane[4] = u, v, a, 0.0, 0.0
    if dots_there >= 5 and det > 1e-3 * uu * vv:
        plane[3], plane[4] = (vv * ua - uv * va) / det, (uu * va - uv * ua) / det


@njit(**BARE)
def _hold_to_plane(dots, k, column, plane, sd, equations):
    """Add to dot k's equations that its amplitude or background is on the plane within `sd`."""
    expected = plane[2] + plane[3] * (dots[k, CU] - plane[0]) + plane[4] * (dots[k, CV] - plane[1])
    equations[k, column, column] += 1 / (sd * sd)
    equations[k, column, RIGHT] += (expected - dots[k, column]) / (sd * sd)


@njit(**BARE)
def _cut_dots(shapes, present, shared, strips, counts):
    """Strips of the dots that are narrow against the blur; none for wide ones."""
    for k in range(8):
        if present[k]:
            long, short = shared[GROWTH] * shapes[k, _LONG], shared[GROWTH] * shapes[k, _SHORT]
            narrow = ellipse.needs_strips(long, short, shared[BLUR])
            counts[k] = ellipse.cut_strips(long, short, shared[BLUR], strips, k) if narrow else 0


@njit(**BARE)
def _find_neighbours(shapes, k, present, dots, reach, near):
    """Dots whose light or pixels may meet those of dot k, into `near` (8,); returns their number."""
    count = 0
    for j in range(8):
        if (
            j != k
            and present[j]
            and abs(dots[j, CU] - dots[k, CU]) < shapes[j, _HALF_U] + shapes[k, _HALF_U] + 2 * reach
            and abs(dots[j, CV] - dots[k, CV]) < shapes[j, _HALF_V] + shapes[k, _HALF_V] + 2 * reach
        ):
            near[count] = j
            count += 1
    return count


@njit(**BARE)
def _neighbours_light(shapes, near, neighbours, dots, blur, growth, strips, counts, u, v, own):
    """Whether no other dot is nearer to a pixel than `own` (px inside the edge), and the light of the others there."""
    light = 0.0
    for i in range(neighbours):
        j = near[i]
        du, dv = u - dots[j, CU], v - dots[j, CV]
        p = shapes[j, _LONG_U] * du + shapes[j, _LONG_V] * dv
        q = shapes[j, _LONG_U] * dv - shapes[j, _LONG_V] * du
        per_long, per_short = 1 / (growth * shapes[j, _LONG]), 1 / (growth * shapes[j, _SHORT])
        inside = ellipse.distance_inside(per_long, per_short, p, q)
        if inside > own:
            return False, 0.0
        if inside > -_FAINT * blur:
            if counts[j]:
                m = ellipse.light_at(strips, j, counts[j], 1 / blur, growth, p, q)[0]
            else:
                m = ellipse.light_at_edge(per_long, per_short, blur, 1 / blur, growth, p, q)[0]
            light += dots[j, AMPLITUDE] * m
    return True, light


@njit(**KERNEL)
def _add_dot(
    image, layout, shapes, k, present, top, clip, noise, dots, shared, around, strips, counts, equations, bins
):
    """Add dot k's pixels to its normal equations; returns the weighted sum of squared residuals and their number."""
    blur, growth = shared[BLUR], shared[GROWTH]
    cu, cv, amplitude, background = dots[k, CU], dots[k, CV], dots[k, AMPLITUDE], dots[k, BACKGROUND]
    if not (1 < cu < image.shape[1] - 2 and 1 < cv < image.shape[0] - 2) or amplitude == 0:
        return 0.0, 0
    slope_u, slope_v = shared[SLOPE_U] / amplitude, shared[SLOPE_V] / amplitude
    long_u, long_v = shapes[k, _LONG_U], shapes[k, _LONG_V]
    per_long, per_short = 1 / (growth * shapes[k, _LONG]), 1 / (growth * shapes[k, _SHORT])
    count, per_blur, bend = counts[k], 1 / blur, amplitude * blur * blur
    reach = _WINDOW_BLURS * blur + _WINDOW_PX
    half_u, half_v = shapes[k, _HALF_U] * growth + reach, shapes[k, _HALF_V] * growth + reach
    near, sides = np.empty(8, np.int64), np.empty((4, 4))
    neighbours = _find_neighbours(shapes, k, present, dots, reach, near)
    of_sheet = near_sides(image, layout[k], shapes[k, _X_U:], cu, cv, max(half_u, half_v), blur, sides)
    noise_constant, noise_gain, noise_least = noise[0], noise[1], noise[2]
    misfit = (_MODEL_ERROR * amplitude) ** 2
    total, pixels = 0.0, 0
    rows = np.empty((int(2 * half_u + 2) * int(2 * half_v + 2), ROW))
    for v in range(max(math.ceil(cv - half_v), 0), min(int(cv + half_v), image.shape[0] - 1) + 1):
        for u in range(max(math.ceil(cu - half_u), 0), min(int(cu + half_u), image.shape[1] - 1) + 1):
            du, dv = u - cu, v - cv
            p, q = long_u * du + long_v * dv, long_u * dv - long_v * du
            inside = ellipse.distance_inside(per_long, per_short, p, q)
            if inside < -reach:
                continue
            others = 0.0
            if of_sheet:
                others, from_edge = leak(sides, of_sheet, background, du, dv)
                if from_edge < _SHEET_EDGE_BLURS:
                    continue
            if neighbours:
                mine, light = _neighbours_light(
                    shapes, near, neighbours, dots, blur, growth, strips, counts, u, v, inside
                )
                if not mine:
                    continue
                others += light
            if count:
                m, m_p, m_q, m_blur, m_growth = ellipse.light_at(strips, k, count, per_blur, growth, p, q)
            else:
                m, m_p, m_q, m_blur, m_growth = ellipse.light_at_edge(per_long, per_short, blur, per_blur, growth, p, q)
            shade = 1 + slope_u * du + slope_v * dv
            m_u, m_v = m_p * long_u - m_q * long_v, m_p * long_v + m_q * long_u
            back = background + around[3] * du + around[4] * dv
            # a Gaussian blurs x times a picture to x times the blurred one plus blur^2 times its derivative
            light = back + amplitude * m * shade + bend * (slope_u * m_u + slope_v * m_v) + others
            variance = max(noise_constant + noise_gain * light, noise_least) + misfit
            # where the sensor may saturate a pixel shows nothing, whether it did or not
            if light > clip or (clip - light) ** 2 < 4 * variance:
                continue
            scale = amplitude * shade
            residual = float(image[v, u]) - light
            row = rows[pixels]
            row[0] = -scale * m_u - amplitude * m * slope_u - around[3]
            row[1] = -scale * m_v - amplitude * m * slope_v - around[4]
            row[2], row[3] = m * shade, 1.0
            row[4], row[5], row[6] = scale * m_blur, scale * m_growth, residual
            row[WEIGHT] = weight = 1 / (variance + residual * residual * _CAUCHY)
            total += weight * residual * residual
            pixels += 1
            if abs(m_p) + abs(m_q) < _FLAT:
                index = min(max(int(BINS * light / top), 0), BINS - 1)
                bins[index, 0] += light
                bins[index, 1] += min(residual * residual, 16 * variance)
                bins[index, 2] += 1
    _add_products(rows[:pixels], equations[k])
    return total, pixels


@njit(**BARE)
def _add_products(rows, equations):
    """Add the weighted products of pixels' rows (n, ROW) to the equations of a dot (6, ROW); sums stay in registers.

    With all eight columns, the last one for nothing, and two unknowns at once the compiler adds them by vectors.
    """
    for i in range(0, 6, 2):
        a, b, c, d, e, f, g, h = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        s, t, u, v, w, x, y, z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for n in range(len(rows)):
            row = rows[n]
            one, two = row[WEIGHT] * row[i], row[WEIGHT] * row[i + 1]
            a, b, c, d = a + one * row[0], b + one * row[1], c + one * row[2], d + one * row[3]
            e, f, g, h = e + one * row[4], f + one * row[5], g + one * row[6], h + one * row[7]
            s, t, u, v = s + two * row[0], t + two * row[1], u + two * row[2], v + two * row[3]
            w, x, y, z = w + two * row[4], x + two * row[5], y + two * row[6], z + two * row[7]
        _add_row(equations[i], a, b, c, d, e, f, g, h)
        _add_row(equations[i + 1], s, t, u, v, w, x, y, z)


@njit(**BARE)
def _add_row(sums, a, b, c, d, e, f, g, h):
    sums[0], sums[1], sums[2], sums[3] = sums[0] + a, sums[1] + b, sums[2] + c, sums[3] + d
    sums[4], sums[5], sums[6], sums[7] = sums[4] + e, sums[5] + f, sums[6] + g, sums[7] + h
