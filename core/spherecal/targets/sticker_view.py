"""How a flat or bent sticker appears in an image: an affine map, its perspective and the sag of its surface.

A sticker on a ball of radius R is (x^2 + y^2) / 2R below its tangent plane. The sag and the perspective shift its
dots in the image along the direction in which it is tilted. Both follow from the affine map (tilt, scale) but for two
things, the tilt's sign and the curvature 1/2R, and these are fitted with it. The focal length need only be
roughly right, and lens distortion is absorbed by the affine map to first order.

A view is a vector of numbers, named below; kernels fill it. `camera` is (focal length, centre u, centre v) in px.
"""

import numpy as np

from spherecal.base.kernels import BARE, KERNEL, njit

# image of the sticker's origin; affine map, px/mm; tilt of the sticker's axes and inward normal to the line of sight,
# in mm/mm: a point (x, y) is TILT_X x + TILT_Y y farther away than the origin; what these lack of the tilt along the
# optical axis, by which perspective shrinks; image of the inward normal, px/mm; 1 / distance in 1/mm; curvature 1/2R in
# 1/mm; rms of the fit in mm on the sticker; px/mm across the tilt
U, V, XX, XY, YX, YY, TILT_X, TILT_Y, COSINE, LEAN_X, LEAN_Y, LEAN_N, NORMAL_U, NORMAL_V = range(14)
NEARNESS, CURVATURE, RMS, SCALE = range(14, 18)
VIEW_SIZE = 18

MOST_CURVATURE = 1 / 150.0  # a sticker of 28 mm does not lie flat on a ball of less than 150 mm diameter
_UNTILTED = 0.9998  # cosine: below one degree neither sag nor perspective shifts a dot by 0.01 mm
_STEPS = 2  # the sag changes the affine map and so the tilt; a third step changes dots by less than 1e-3 mm


@njit(**KERNEL)
def fit_view(places, image_points, camera, with_sag, view):
    """Fit a view to the dots of a sticker; False where they are degenerate.

    `places`, `image_points`: the dots on the sticker, (n, 2) mm, and in the image, (n, 2) px; `camera`: focal length
    and centre u, v in px, (3,).
    """
    count = len(places)
    inverse = np.empty((3, 3))
    if not _invert_moments(places, inverse):
        return False
    corrected = image_points.copy()
    shifts = np.empty((3, count, 2))
    view[:] = 0.0
    _fit_affine(places, corrected, inverse, view)
    if not _set_tilt(view, camera):
        return False
    for _ in range(_STEPS):
        if view[COSINE] > _UNTILTED or not with_sag:
            break
        _fit_sag(places, image_points, inverse, view, shifts)
        for i in range(count):
            for axis in range(2):
                shift = view[CURVATURE] * shifts[0, i, axis] + shifts[1, i, axis] + shifts[2, i, axis]
                corrected[i, axis] = image_points[i, axis] - shift
        _fit_affine(places, corrected, inverse, view)
        if not _set_tilt(view, camera):
            return False
    view[RMS] = np.sqrt(_misfit(places, image_points, view) / count)
    return True


@njit(**BARE)
def project_place(view, x, y):
    """Image point (u, v) px of a place on the sticker."""
    sag = view[CURVATURE] * (x * x + y * y)
    deeper = (view[TILT_X] - view[LEAN_X]) * x + (view[TILT_Y] - view[LEAN_Y]) * y + (view[COSINE] - view[LEAN_N]) * sag
    nearer = 1 / (1 + view[NEARNESS] * deeper)
    u = view[U] + nearer * (view[XX] * x + view[XY] * y + view[NORMAL_U] * sag)
    v = view[V] + nearer * (view[YX] * x + view[YY] * y + view[NORMAL_V] * sag)
    return u, v


@njit(**BARE)
def place_of(view, u, v):
    """Place (x, y) mm on the sticker of an image point; the inverse of `project_place` to 1e-3 mm."""
    det = view[XX] * view[YY] - view[XY] * view[YX]
    x, y = 0.0, 0.0
    for _ in range(4):
        at_u, at_v = project_place(view, x, y)
        x += (view[YY] * (u - at_u) - view[XY] * (v - at_v)) / det
        y += (view[XX] * (v - at_v) - view[YX] * (u - at_u)) / det
    return x, y


@njit(**BARE)
def local_affine(view, x, y):
    """Derivatives (du/dx, du/dy, dv/dx, dv/dy) in px/mm of the image point at a place on the sticker."""
    step = 0.5  # mm; the map is quadratic to 1e-4, so that central differences are exact
    right_u, right_v = project_place(view, x + step, y)
    left_u, left_v = project_place(view, x - step, y)
    down_u, down_v = project_place(view, x, y + step)
    up_u, up_v = project_place(view, x, y - step)
    return right_u - left_u, down_u - up_u, right_v - left_v, down_v - up_v


@njit(**BARE)
def eccentricity(view, x, y, radius):
    """From the centre of the ellipse that a circle on the sticker shows as to the image of its centre, (du, dv) px.

    Seen in perspective the nearer half of a circle is larger. To first order the ellipse's centre is the image of the
    place r^2 p / w before the circle's centre, w = 1 + p . x being the denominator of the perspective there.
    """
    bend = 2 * view[CURVATURE] * (view[COSINE] - view[LEAN_N])
    px = view[NEARNESS] * (view[TILT_X] - view[LEAN_X] + bend * x)
    py = view[NEARNESS] * (view[TILT_Y] - view[LEAN_Y] + bend * y)
    shift = radius * radius / (1 + px * x + py * y)
    uu, uv, vu, vv = local_affine(view, x, y)
    return shift * (uu * px + uv * py), shift * (vu * px + vv * py)


@njit(**BARE)
def _invert_moments(places, inverse):
    """Inverse of sum (x, y, 1)(x, y, 1)'; False for places on a line."""
    xx, xy, yy, x, y, n = 0.0, 0.0, 0.0, 0.0, 0.0, float(len(places))
    for i in range(len(places)):
        px, py = places[i, 0], places[i, 1]
        xx, xy, yy, x, y = xx + px * px, xy + px * py, yy + py * py, x + px, y + py
    c00, c01, c02 = yy * n - y * y, y * x - xy * n, xy * y - yy * x
    det = xx * c00 + xy * c01 + x * c02
    if abs(det) < 1e-6 * n * (xx + yy) ** 2:
        return False
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = c00 / det, c01 / det, c02 / det
    inverse[1, 0], inverse[1, 1], inverse[1, 2] = c01 / det, (xx * n - x * x) / det, (xy * x - xx * y) / det
    inverse[2, 0], inverse[2, 1], inverse[2, 2] = c02 / det, inverse[1, 2], (xx * yy - xy * xy) / det
    return True


@njit(**BARE)
def _affine_row(places, values, axis, inverse):
    """Coefficients (of x, of y, constant) of the least-squares affine function through one column of `values`."""
    sx, sy, s = 0.0, 0.0, 0.0
    for i in range(len(places)):
        value = values[i, axis]
        sx, sy, s = sx + places[i, 0] * value, sy + places[i, 1] * value, s + value
    return (
        inverse[0, 0] * sx + inverse[0, 1] * sy + inverse[0, 2] * s,
        inverse[1, 0] * sx + inverse[1, 1] * sy + inverse[1, 2] * s,
        inverse[2, 0] * sx + inverse[2, 1] * sy + inverse[2, 2] * s,
    )


@njit(**BARE)
def _fit_affine(places, image_points, inverse, view):
    view[XX], view[XY], view[U] = _affine_row(places, image_points, 0, inverse)
    view[YX], view[YY], view[V] = _affine_row(places, image_points, 1, inverse)


@njit(**BARE)
def _remove_affine(places, values, inverse):
    for axis in range(2):
        a, b, c = _affine_row(places, values, axis, inverse)
        for i in range(len(places)):
            values[i, axis] -= a * places[i, 0] + b * places[i, 1] + c


@njit(**BARE)
def _set_tilt(view, camera):
    """Tilt, normal, distance and scale of the affine map; the tilt keeps the sign it has. False for a mirrored map.

    The map is first seen from the sticker's own line of sight. An image is stretched by 1 / cos across it and by
    1 / cos^2 away from the image's centre, cos being that of the angle off the optical axis.
    """
    du, dv = (view[U] - camera[1]) / camera[0], (view[V] - camera[2]) / camera[0]
    cos = 1 / np.sqrt(1 + du * du + dv * dv)
    off = np.hypot(du, dv)
    ru, rv = (du / off, dv / off) if off > 1e-9 else (1.0, 0.0)
    k = (1 - cos) * cos
    m00, m01, m11 = cos - k * ru * ru, -k * ru * rv, cos - k * rv * rv
    a, b = m00 * view[XX] + m01 * view[YX], m00 * view[XY] + m01 * view[YY]
    c, d = m01 * view[XX] + m11 * view[YX], m01 * view[XY] + m11 * view[YY]
    if not a * d - b * c > 0:
        return False
    # singular values of the map; the tilt is along the smaller one's direction on the sticker
    p, q, r = a * a + c * c, a * b + c * d, b * b + d * d
    half, root = (p + r) / 2, np.hypot((p - r) / 2, q)
    angle = 0.5 * np.arctan2(2 * q, p - r) + np.pi / 2
    tx, ty = np.cos(angle), np.sin(angle)
    if tx * view[TILT_X] + ty * view[TILT_Y] < 0:
        tx, ty = -tx, -ty
    view[SCALE] = np.sqrt(half + root)
    view[COSINE] = np.sqrt(max(half - root, 1e-12)) / view[SCALE]
    sine = np.sqrt(max(1 - view[COSINE] ** 2, 0.0))
    view[TILT_X], view[TILT_Y], view[NEARNESS] = sine * tx, sine * ty, view[SCALE] / camera[0]
    # the inward normal leans against the tilt's image; back into the image with the inverse of the stretch
    length = -sine / view[COSINE]
    nu, nv = length * (a * tx + b * ty), length * (c * tx + d * ty)
    det = m00 * m11 - m01 * m01
    view[NORMAL_U], view[NORMAL_V] = (m11 * nu - m01 * nv) / det, (m00 * nv - m01 * nu) / det
    view[LEAN_X], view[LEAN_Y] = off * (ru * a + rv * c) / view[SCALE], off * (ru * b + rv * d) / view[SCALE]
    view[LEAN_N] = off * (ru * nu + rv * nv) / view[SCALE]
    return True


@njit(**KERNEL)
def _fit_sag(places, image_points, inverse, view, shifts):
    """Sign of the tilt and curvature that fit best.

    `shifts` (3, n, 2) are those of the dots in px. The first is by unit curvature, the second by perspective along the
    line of sight. The third is by the rest of the perspective, which does not depend on the sign.
    """
    count = len(places)
    misfit = image_points.copy()
    for i in range(count):
        x, y = places[i, 0], places[i, 1]
        du, dv = view[XX] * x + view[XY] * y, view[YX] * x + view[YY] * y
        shrink = -view[NEARNESS] * (view[TILT_X] * x + view[TILT_Y] * y)
        lean = view[NEARNESS] * (view[LEAN_X] * x + view[LEAN_Y] * y)
        shifts[0, i, 0], shifts[0, i, 1] = view[NORMAL_U] * (x * x + y * y), view[NORMAL_V] * (x * x + y * y)
        shifts[1, i, 0], shifts[1, i, 1] = shrink * du, shrink * dv
        shifts[2, i, 0], shifts[2, i, 1] = lean * du, lean * dv
        misfit[i, 0], misfit[i, 1] = misfit[i, 0] - lean * du, misfit[i, 1] - lean * dv
    _remove_affine(places, misfit, inverse)
    bare = shifts[:2].copy()
    _remove_affine(places, bare[0], inverse)
    _remove_affine(places, bare[1], inverse)
    ss, sp, sm, pm, pp = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        for axis in range(2):
            s, p, m = bare[0, i, axis], bare[1, i, axis], misfit[i, axis]
            ss, sp, sm, pm, pp = ss + s * s, sp + s * p, sm + s * m, pm + p * m, pp + p * p
    best, sign, curvature = np.inf, 1.0, 0.0
    for trial in (1.0, -1.0):
        # |m - trial (k s + p)|^2 less its constant part
        k = min(max((trial * sm - sp) / max(ss, 1e-12), 0.0), MOST_CURVATURE)
        cost = pp + k * k * ss + 2 * k * sp - 2 * trial * (k * sm + pm)
        if cost < best:
            best, sign, curvature = cost, trial, k
    view[CURVATURE] = curvature
    if sign < 0:
        view[TILT_X], view[TILT_Y] = -view[TILT_X], -view[TILT_Y]
        view[NORMAL_U], view[NORMAL_V], view[LEAN_N] = -view[NORMAL_U], -view[NORMAL_V], -view[LEAN_N]
        for i in range(count):
            for axis in range(2):
                shifts[0, i, axis], shifts[1, i, axis] = -shifts[0, i, axis], -shifts[1, i, axis]


@njit(**BARE)
def _misfit(places, image_points, view):
    """Sum of the squared distances of the dots from the view, in mm^2 on the sticker."""
    det = view[XX] * view[YY] - view[XY] * view[YX]
    total = 0.0
    for i in range(len(places)):
        u, v = project_place(view, places[i, 0], places[i, 1])
        du, dv = image_points[i, 0] - u, image_points[i, 1] - v
        x, y = (view[YY] * du - view[XY] * dv) / det, (view[XX] * dv - view[YX] * du) / det
        total += x * x + y * y
    return total
