"""The radiance of a scene on a grid of quarter pixels, as fine as each place needs it (numba kernels).

Dots are sampled 16 x 16 times a pixel, edges 4 x 4 times, plain surfaces once. Every cell belongs to all the pixels
whose point-spread function reaches it, so neighbouring pixels share their samples.

In all kernels `rotation` (3, 3) is world to camera, `centre` (3,) mm the projection centre, and `intrinsics` (16,)
follow OpenCV's model or its fisheye model. Values of four corners have the order of `bilinear`.
"""

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.kernels import njit
from spherecal.geometry.camera import FISHEYE_MARK
from spherecal.geometry.fisheye import WIDEST
from spherecal_sim.shading import albedo, dirt_distance, light
from spherecal_sim.tracing import ARM, DOT, MARK, PAPER, STICKER, TracedScene, place_on, trace
from spherecal_sim.unowned import unowned

CELLS = 4  # a pixel is CELLS x CELLS cells
TILE = 4  # pixels; a tile whose corners show one surface is interpolated between them
EDGE, DENSE = 1, 2  # marks of pixels: something small may begin here; sample dots 16 x 16 times a pixel

_SAMPLES = 4  # a side of a cell of a dot: 16 x 16 a pixel


@njit(nogil=True, cache=True)
def ideal_place(intrinsics, u, v, x, y):
    """Normalised ideal coordinates (x, y) of an image point (u, v) px, by Newton's method."""
    if intrinsics[15] == FISHEYE_MARK:
        return _fisheye_place(intrinsics, u, v, x, y)
    fu, fv, u0, v0, k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = intrinsics
    gx, gy = (u - u0) / fu, (v - v0) / fv
    for _ in range(20):
        r2 = x * x + y * y
        iden = 1.0 / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) * iden
        slope = (k1 + r2 * (2 * k2 + 3 * k3 * r2) - radial * (k4 + r2 * (2 * k5 + 3 * k6 * r2))) * iden
        ex = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + s2 * r2) - gx
        ey = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + s4 * r2) - gy
        a = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x + 2 * x * (s1 + 2 * s2 * r2)
        b = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y + 2 * y * (s1 + 2 * s2 * r2)
        c = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y + 2 * x * (s3 + 2 * s4 * r2)
        d = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x + 2 * y * (s3 + 2 * s4 * r2)
        det = a * d - b * c
        dx, dy = (d * ex - b * ey) / det, (a * ey - c * ex) / det
        x, y = x - dx, y - dy
        if abs(dx) + abs(dy) < 1e-13:
            break
    return x, y


@njit(nogil=True, cache=True)
def _fisheye_place(intrinsics, u, v, x, y):
    """`ideal_place` of a fisheye lens; what is farther off the axis than 89 degrees is brought to 89 degrees."""
    k1, k2, k3, k4 = intrinsics[4], intrinsics[5], intrinsics[6], intrinsics[7]
    gx, gy = (u - intrinsics[2]) / intrinsics[0], (v - intrinsics[3]) / intrinsics[1]
    goal = np.sqrt(gx * gx + gy * gy)
    if goal < 1e-9:
        return gx, gy
    theta = np.arctan(np.sqrt(x * x + y * y))
    for _ in range(20):
        t2 = theta * theta
        error = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))) - goal
        rise = 1.0 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
        step = theta - error / rise
        step = min(max(step, 0.0), WIDEST)
        done = abs(step - theta) < 1e-13
        theta = step
        if done:
            break
    factor = np.tan(theta) / goal
    return gx * factor, gy * factor


@njit(nogil=True, cache=False, forceinline=True)
def ray_of(rotation, centre, x, y):
    """The ray along normalised coordinates."""
    dx = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0]
    dy = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1]
    dz = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2]
    q = 1.0 / np.sqrt(x * x + y * y + 1.0)
    return centre[0], centre[1], centre[2], dx * q, dy * q, dz * q


@njit(nogil=True, cache=True)
def look_along(scene, rotation, centre, x, y):
    """The surface seen along normalised coordinates, with its light: code, place (x, y) on it, diffuse, gloss."""
    code, sx, sy, place, normal = trace(scene, ray_of(rotation, centre, x, y))
    diffuse, shine = light(scene, centre, place, normal)
    return code, sx, sy, diffuse, shine


@njit(nogil=True, cache=True)
def place_along(scene, code, rotation, centre, x, y):
    """The place (x, y) mm on a sticker that shows along normalised coordinates."""
    return place_on(scene, code, ray_of(rotation, centre, x, y))


@njit(nogil=True, cache=True)
def bilinear(a, b, c, d, s, t):
    """The value between four corners: at (0, 0), at s = 1, at t = 1, and at (1, 1)."""
    return (a * (1 - s) + b * s) * (1 - t) + (c * (1 - s) + d * s) * t


@njit(nogil=True, cache=True)
def trace_band(
    scene: TracedScene,
    rotation: FloatArray,
    centre: FloatArray,
    intrinsics: FloatArray,
    marks: NDArray[np.uint8],
    u_first: int,
    v_first: int,
    cells: NDArray[np.float32],
) -> None:
    """Fill `cells` with the radiance of the pixels from (u_first, v_first) on; `marks` (rows, columns)."""
    scene, rotation, centre, intrinsics = unowned((scene, rotation, centre, intrinsics))
    rows, columns = marks.shape
    n_v, n_u = rows // TILE, columns // TILE
    coarse_x, coarse_y = np.empty((n_v + 1, n_u + 1)), np.empty((n_v + 1, n_u + 1))
    code = np.empty((n_v + 1, n_u + 1), np.int64)
    value = np.empty((n_v + 1, n_u + 1))
    x = y = 0.0
    for i in range(n_v + 1):
        if i > 0:
            x, y = coarse_x[i - 1, 0], coarse_y[i - 1, 0]
        for j in range(n_u + 1):
            x, y = ideal_place(intrinsics, u_first + TILE * j - 0.5, v_first + TILE * i - 0.5, x, y)
            coarse_x[i, j], coarse_y[i, j] = x, y
            code[i, j], sx, sy, diffuse, shine = look_along(scene, rotation, centre, x, y)
            value[i, j] = albedo(scene, code[i, j], sx, sy) * diffuse + shine
    for i in range(n_v):
        for j in range(n_u):
            block = cells[i * TILE * CELLS : (i + 1) * TILE * CELLS, j * TILE * CELLS : (j + 1) * TILE * CELLS]
            tile_marks = marks[i * TILE : (i + 1) * TILE, j * TILE : (j + 1) * TILE]
            if is_plain(code, i, j) and not tile_marks.any():
                fill_bilinear(block, value[i, j], value[i, j + 1], value[i + 1, j], value[i + 1, j + 1], TILE * CELLS)
            else:
                trace_tile(
                    scene, rotation, centre, intrinsics, tile_marks, u_first + TILE * j, v_first + TILE * i,
                    coarse_x[i, j], coarse_y[i, j], block,
                )  # fmt: skip


@njit(nogil=True, cache=True)
def is_plain(code, i, j):
    """Whether tile (i, j) shows one surface only; for a wall its neighbours must too: nothing can begin inside."""
    first = code[i, j]
    if first >= ARM:
        return code[i, j + 1] == first and code[i + 1, j] == first and code[i + 1, j + 1] == first
    for k in range(max(i - 1, 0), min(i + 3, code.shape[0])):
        for m in range(max(j - 1, 0), min(j + 3, code.shape[1])):
            if code[k, m] != first:
                return False
    return True


@njit(nogil=True, cache=True)
def fill_bilinear(block, a, b, c, d, n):
    """Fill the n x n cells of a block from the values at the corners."""
    for k in range(n):
        t = (k + 0.5) / n
        for m in range(n):
            block[k, m] = bilinear(a, b, c, d, (m + 0.5) / n, t)


@njit(nogil=True, cache=True)
def trace_tile(scene, rotation, centre, intrinsics, marks, u_first, v_first, x, y, block):
    """Fill the cells of one tile, pixel by pixel, from rays through the pixels' corners."""
    n = TILE + 1
    cx, cy = np.empty((n, n)), np.empty((n, n))
    code = np.empty((n, n), np.int64)
    sx, sy = np.empty((n, n)), np.empty((n, n))
    diffuse, shine, value, print_ = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    for k in range(n):
        if k > 0:
            x, y = cx[k - 1, 0], cy[k - 1, 0]
        for m in range(n):
            x, y = ideal_place(intrinsics, u_first + m - 0.5, v_first + k - 0.5, x, y)
            cx[k, m], cy[k, m] = x, y
            code[k, m], sx[k, m], sy[k, m], diffuse[k, m], shine[k, m] = look_along(scene, rotation, centre, x, y)
            print_[k, m] = albedo(scene, code[k, m], sx[k, m], sy[k, m])
            value[k, m] = print_[k, m] * diffuse[k, m] + shine[k, m]
    for k in range(TILE):
        for m in range(TILE):
            pixel = block[k * CELLS : (k + 1) * CELLS, m * CELLS : (m + 1) * CELLS]
            x4, y4 = corners(cx, k, m), corners(cy, k, m)
            c = code[k, m]
            same = c == code[k, m + 1] and c == code[k + 1, m] and c == code[k + 1, m + 1]
            if same and marks[k, m] == DENSE and c >= MARK:
                places = (corners(sx, k, m), corners(sy, k, m))
                dense_pixel(
                    scene, c, rotation, centre, x4, y4, places, corners(diffuse, k, m), corners(shine, k, m), pixel
                )
                continue
            p = print_[k, m]
            if same and p == print_[k, m + 1] and p == print_[k + 1, m] and p == print_[k + 1, m + 1]:
                fill_bilinear(pixel, value[k, m], value[k, m + 1], value[k + 1, m], value[k + 1, m + 1], CELLS)
            else:
                edge_pixel(scene, rotation, centre, x4, y4, 2 if marks[k, m] == DENSE else 1, pixel)


@njit(nogil=True, cache=True)
def corners(grid, k, m):
    """The four values of a grid (rows, columns) around the square (k, m)."""
    return grid[k, m], grid[k, m + 1], grid[k + 1, m], grid[k + 1, m + 1]


@njit(nogil=True, cache=True)
def edge_pixel(scene, rotation, centre, x4, y4, samples, pixel):
    """Fill a pixel across an edge, by rays through each cell; `x4`, `y4`: its corners, normalised, (4,)."""
    n = CELLS * samples
    for k in range(CELLS):
        for m in range(CELLS):
            total = 0.0
            for a in range(samples):
                t = (k * samples + a + 0.5) / n
                for b in range(samples):
                    s = (m * samples + b + 0.5) / n
                    x = bilinear(x4[0], x4[1], x4[2], x4[3], s, t)
                    y = bilinear(y4[0], y4[1], y4[2], y4[3], s, t)
                    code, sx, sy, diffuse, shine = look_along(scene, rotation, centre, x, y)
                    total += albedo(scene, code, sx, sy) * diffuse + shine
            pixel[k, m] = total / (samples * samples)


@njit(nogil=True, cache=True)
def dense_pixel(scene, code, rotation, centre, x4, y4, places, d4, g4, pixel):
    """Fill a pixel wholly on one sticker: exact at 3 x 3 nodes, else quadratic (off by 1e-6 mm), 4 x 4 samples a cell.

    `x4`, `y4`: normalised corners (4,); `places`: theirs on the sticker, mm; `d4`, `g4`: diffuse light and gloss (4,).
    """
    nodes = np.empty((2, 3, 3))
    for k in range(3):
        for m in range(3):
            if k != 1 and m != 1:
                nodes[0, k, m], nodes[1, k, m] = places[0][k + m // 2], places[1][k + m // 2]
                continue
            x = bilinear(x4[0], x4[1], x4[2], x4[3], m / 2, k / 2)
            y = bilinear(y4[0], y4[1], y4[2], y4[3], m / 2, k / 2)
            nodes[0, k, m], nodes[1, k, m] = place_along(scene, code, rotation, centre, x, y)
    n = CELLS + 1
    sx, sy = np.empty((n, n)), np.empty((n, n))
    for k in range(n):
        t0, t1, t2 = quadratic_weights(k / CELLS)
        for m in range(n):
            s0, s1, s2 = quadratic_weights(m / CELLS)
            for axis, out in ((0, sx), (1, sy)):
                q = nodes[axis]
                out[k, m] = (
                    t0 * (s0 * q[0, 0] + s1 * q[0, 1] + s2 * q[0, 2])
                    + t1 * (s0 * q[1, 0] + s1 * q[1, 1] + s2 * q[1, 2])
                    + t2 * (s0 * q[2, 0] + s1 * q[2, 1] + s2 * q[2, 2])
                )
    if code >= STICKER:
        dots = scene.sticker_dots[code - STICKER]
        dirt = scene.dirt[code - STICKER]
    else:
        dots = scene.mark_dots[code - MARK]
        dirt = scene.dirt[len(scene.sticker_dots) + code - MARK]
    paper, white, radius = scene.albedos[PAPER], scene.albedos[DOT], scene.dot_radius
    for k in range(CELLS):
        for m in range(CELLS):
            s, t = (m + 0.5) / CELLS, (k + 0.5) / CELLS
            diffuse = bilinear(d4[0], d4[1], d4[2], d4[3], s, t)
            shine = bilinear(g4[0], g4[1], g4[2], g4[3], s, t)
            x = (sx[k, m], sx[k, m + 1], sx[k + 1, m], sx[k + 1, m + 1])
            y = (sy[k, m], sy[k, m + 1], sy[k + 1, m], sy[k + 1, m + 1])
            pixel[k, m] = diffuse * cell_albedo(paper, white, radius, dots, dirt, x, y) + shine


@njit(nogil=True, cache=True)
def quadratic_weights(s):
    """Weights of the values at 0, 1/2 and 1 for the quadratic through them at s."""
    return (2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)


@njit(nogil=True, cache=True)
def cell_albedo(paper, white, radius, dots, dirt, x, y):
    """Mean albedo of a cell on a sticker; a sample on a rim counts with the part inside, a ramp as wide as the sample.

    `radius` of `dots` (n, 2), mm; `dirt` (d, 6) as in `TracedScene`; `x`, `y`: the cell's corners on the sticker (4,).
    """
    ux, uy = (x[1] - x[0] + x[3] - x[2]) / 2 / _SAMPLES, (y[1] - y[0] + y[3] - y[2]) / 2 / _SAMPLES
    vx, vy = (x[2] - x[0] + x[3] - x[1]) / 2 / _SAMPLES, (y[2] - y[0] + y[3] - y[1]) / 2 / _SAMPLES
    mx, my = (x[0] + x[1] + x[2] + x[3]) / 4, (y[0] + y[1] + y[2] + y[3]) / 4
    reach = _SAMPLES * (np.hypot(ux, uy) + np.hypot(vx, vy)) / 2
    nearest, distance = -1, 1e30
    for k in range(len(dots)):
        d = np.sqrt((mx - dots[k, 0]) ** 2 + (my - dots[k, 1]) ** 2)
        if d < distance:
            nearest, distance = k, d
    dirty = False
    for k in range(len(dirt)):
        dirty = dirty or dirt_distance(dirt[k], mx, my) < reach
    if not dirty and distance > radius + reach:
        return paper
    if not dirty and distance < radius - reach:
        return white
    total = 0.0
    for a in range(_SAMPLES):
        t = (a + 0.5) / _SAMPLES
        for b in range(_SAMPLES):
            s = (b + 0.5) / _SAMPLES
            px = bilinear(x[0], x[1], x[2], x[3], s, t)
            py = bilinear(y[0], y[1], y[2], y[3], s, t)
            gx, gy = px - dots[nearest, 0], py - dots[nearest, 1]
            d = np.sqrt(gx * gx + gy * gy)
            inside = 0.0
            if d < radius + reach:
                width = np.sqrt((gx * ux + gy * uy) ** 2 + (gx * vx + gy * vy) ** 2) / max(d, 1e-9)
                inside = min(max(0.5 + (radius - d) / width, 0.0), 1.0)
            value = paper + (white - paper) * inside
            if dirty:
                for k in range(len(dirt)):
                    if dirt_distance(dirt[k], px, py) <= 0.0:
                        value = dirt[k, 5]
            total += value
    return total / (_SAMPLES * _SAMPLES)
