"""Rays against the simulated scene: the bumpy ball with its bent stickers, bars, an arm and the room (numba kernels).

World frame, millimetres. A surface has a code: 0 to 5 the room's walls, ARM, BALL, BAR + p the bare face of bar p. MARK
+ m is a bar's sticker, STICKER + s a sticker of the ball. Kernels take the `TracedScene` as one tuple of arrays. A ray
is its origin and its unit direction, (ox, oy, oz, dx, dy, dz).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.kernels import njit

ARM, BALL, BAR, MARK, STICKER = 6, 7, 10, 100, 10_000

# indices into Scene.albedos
DOT, PAPER, BALL_SKIN, BAR_SKIN, ARM_SKIN, WALL, BLOB = range(7)


class TracedScene(NamedTuple):
    """A scene as arrays for the kernels; what is absent has length zero, and `ball_radius` 0 means no ball.

    Ball and stickers as in `Ball`, lobes transposed (3, k) and (6, k). `sticker_grid` (g, g, g, c) lists the stickers
    (or -1) near each cell of the cube of directions. Bar p: `bar_rotations[p]`, `bar_places[p]`, face rectangle
    `bar_faces[p]` (x low, x high, half width); sticker m of all marks is on bar `mark_bar[m]` at `mark_x[m]`. `dirt`
    (stickers then marks, d, 6): segment ends, half width, albedo. `arms` (a, 7): ends and radius. `blobs` (b, 4): wall,
    two coordinates, radius; `blob_grid` (6, g, g, c) lists those near each cell of a wall.
    """

    ball_radius: float
    ball_reach: float
    ball_rotation: FloatArray
    ball_place: FloatArray
    lobe_axes: FloatArray
    lobe_coefficients: FloatArray
    sticker_frames: FloatArray
    sticker_dots: FloatArray
    sticker_grid: NDArray[np.int32]
    bar_rotations: FloatArray
    bar_places: FloatArray
    bar_faces: FloatArray
    mark_bar: NDArray[np.int64]
    mark_x: FloatArray
    mark_dots: FloatArray
    half_sticker: float
    dot_radius: float
    dirt: FloatArray
    arms: FloatArray
    room: FloatArray
    blobs: FloatArray
    blob_grid: NDArray[np.int32]
    albedos: FloatArray
    lights: FloatArray
    light_power: float
    ambient: float
    gloss: float


# Fast sums let the loop run four lobes at a time; no cache and inlined as in adjust/kernel.py.
@njit(nogil=True, cache=False, forceinline=True, fastmath={"reassoc", "contract"})
def bump(axes, c, nx, ny, nz):
    """Height of the ball's bumps in mm and its gradient (not yet tangential); lobes (3, k), coefficients (6, k) mm."""
    h = gx = gy = gz = 0.0
    for k in range(axes.shape[1]):
        t = nx * axes[0, k] + ny * axes[1, k] + nz * axes[2, k]
        h += c[0, k] + t * (c[1, k] + t * (c[2, k] + t * (c[3, k] + t * (c[4, k] + t * c[5, k]))))
        g = c[1, k] + t * (2 * c[2, k] + t * (3 * c[3, k] + t * (4 * c[4, k] + t * 5 * c[5, k])))
        gx += g * axes[0, k]
        gy += g * axes[1, k]
        gz += g * axes[2, k]
    return h, gx, gy, gz


# Newton's error after a step s on a sphere of radius R is s^2 / 2R: 5e-8 mm here
_LAST_STEP_MM = 5e-3


@njit(nogil=True, cache=False, forceinline=True)
def hit_ball(scene, ray):
    """Distance to the ball or -1, and the bumps' gradient there; from outside Newton's steps never overshoot."""
    ox, oy, oz, dx, dy, dz = ray
    b = ox * dx + oy * dy + oz * dz
    disc = b * b - (ox * ox + oy * oy + oz * oz - scene.ball_reach**2)
    axes, coefficients = scene.lobe_axes, scene.lobe_coefficients
    gx = gy = gz = 0.0
    if disc <= 0.0:
        return -1.0, gx, gy, gz
    t = -b - np.sqrt(disc)
    if t <= 0.0:
        return -1.0, gx, gy, gz
    for _ in range(20):
        px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
        r = np.sqrt(px * px + py * py + pz * pz)
        nx, ny, nz = px / r, py / r, pz / r
        h, gx, gy, gz = bump(axes, coefficients, nx, ny, nz)
        nd = nx * dx + ny * dy + nz * dz
        gn = gx * nx + gy * ny + gz * nz
        rate = nd - (gx * dx + gy * dy + gz * dz - gn * nd) / r
        if rate > -1e-3:  # past the limb
            return -1.0, gx, gy, gz
        step = (scene.ball_radius + h - r) / rate
        t += step
        if abs(step) < _LAST_STEP_MM:
            return t, gx, gy, gz
    return -1.0, gx, gy, gz


_NODES = (0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0))  # of ball.wrap


@njit(nogil=True, cache=False, forceinline=True)
def flatten(scene, s, nx, ny, nz):
    """Sticker coordinates in mm of the surface in a unit direction: the inverse of `ball.wrap`."""
    axes, coefficients = scene.lobe_axes, scene.lobe_coefficients
    f = scene.sticker_frames[s]
    ex = nx * f[0, 0] + ny * f[0, 1] + nz * f[0, 2]
    ey = nx * f[1, 0] + ny * f[1, 1] + nz * f[1, 2]
    cosine = -(nx * f[2, 0] + ny * f[2, 1] + nz * f[2, 2])
    sine = np.sqrt(ex * ex + ey * ey)
    if sine < 1e-12:
        return 0.0, 0.0
    ex /= sine
    ey /= sine
    tx = ex * f[0, 0] + ey * f[1, 0]
    ty = ex * f[0, 1] + ey * f[1, 1]
    tz = ex * f[0, 2] + ey * f[1, 2]
    angle = np.arctan2(sine, cosine)
    arc = 0.0
    for k in range(2):
        a = _NODES[k] * angle
        a2 = a * a
        q, c = a * (1 - a2 / 6 * (1 - a2 / 20)), 1 - a2 / 2 * (1 - a2 / 12 * (1 - a2 / 30))  # to 1e-9 for a < 0.17
        mx, my, mz = q * tx - c * f[2, 0], q * ty - c * f[2, 1], q * tz - c * f[2, 2]
        h, gx, gy, gz = bump(axes, coefficients, mx, my, mz)
        r = scene.ball_radius + h
        # the section's own direction is perpendicular to m, so the gradient needs no projection
        dr = gx * (c * tx + q * f[2, 0]) + gy * (c * ty + q * f[2, 1]) + gz * (c * tz + q * f[2, 2])
        arc += 0.5 * np.sqrt(r * r + dr * dr)
    return angle * arc * ex, angle * arc * ey


@njit(nogil=True, cache=False, forceinline=True)
def sticker_at(scene, nx, ny, nz):
    """The ball's sticker in a unit direction (or -1) and the place on it in mm."""
    g = scene.sticker_grid.shape[0]
    i = min(int((nx + 1) * 0.5 * g), g - 1)
    j = min(int((ny + 1) * 0.5 * g), g - 1)
    k = min(int((nz + 1) * 0.5 * g), g - 1)
    near = 1.1 * scene.half_sticker / scene.ball_radius
    for c in range(scene.sticker_grid.shape[3]):
        s = scene.sticker_grid[i, j, k, c]
        if s < 0:
            break
        f = scene.sticker_frames[s]
        if (
            nx * f[2, 0] + ny * f[2, 1] + nz * f[2, 2] < 0.0
            and abs(nx * f[0, 0] + ny * f[0, 1] + nz * f[0, 2]) < near
            and abs(nx * f[1, 0] + ny * f[1, 1] + nz * f[1, 2]) < near
        ):
            x, y = flatten(scene, s, nx, ny, nz)
            if abs(x) <= scene.half_sticker and abs(y) <= scene.half_sticker:
                return s, x, y
    return -1, 0.0, 0.0


@njit(nogil=True, cache=False, forceinline=True)
def place_on(scene, code, ray):
    """The place in mm on a sticker that a ray known to hit it hits."""
    if code < STICKER:
        m = code - MARK
        _, x, y, _ = hit_bar(scene, scene.mark_bar[m], ray)
        return x - scene.mark_x[m], y
    own = in_ball_frame(scene, ray)
    t, _, _, _ = hit_ball(scene, own)
    ox, oy, oz, dx, dy, dz = own
    px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
    q = np.sqrt(px * px + py * py + pz * pz)
    return flatten(scene, code - STICKER, px / q, py / q, pz / q)


@njit(nogil=True, cache=False, forceinline=True)
def in_ball_frame(scene, ray):
    """A ray of the world in the ball frame."""
    ox, oy, oz, dx, dy, dz = ray
    r, c = scene.ball_rotation, scene.ball_place
    qx, qy, qz = ox - c[0], oy - c[1], oz - c[2]
    return (
        r[0, 0] * qx + r[1, 0] * qy + r[2, 0] * qz,
        r[0, 1] * qx + r[1, 1] * qy + r[2, 1] * qz,
        r[0, 2] * qx + r[1, 2] * qy + r[2, 2] * qz,
        r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz,
        r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz,
        r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz,
    )


@njit(nogil=True, cache=False, forceinline=True)
def hit_arm(arm, ray):
    """Distance along a ray to a capsule (ends and radius, (7,) mm), or -1."""
    ox, oy, oz, dx, dy, dz = ray
    ax, ay, az = arm[3] - arm[0], arm[4] - arm[1], arm[5] - arm[2]
    px, py, pz = ox - arm[0], oy - arm[1], oz - arm[2]
    aa = ax * ax + ay * ay + az * az
    ad = ax * dx + ay * dy + az * dz
    ap = ax * px + ay * py + az * pz
    dp = dx * px + dy * py + dz * pz
    pp = px * px + py * py + pz * pz
    a = aa - ad * ad
    b = aa * dp - ap * ad
    h = b * b - a * (aa * pp - ap * ap - arm[6] ** 2 * aa)
    if h >= 0.0 and a > 0.0:
        t = (-b - np.sqrt(h)) / a
        y = ap + t * ad
        if 0.0 < y < aa:
            return t if t > 0.0 else -1.0
    best = -1.0
    for end in range(2):
        qx, qy, qz = px - end * ax, py - end * ay, pz - end * az
        b = dx * qx + dy * qy + dz * qz
        h = b * b - (qx * qx + qy * qy + qz * qz - arm[6] ** 2)
        if h > 0.0:
            t = -b - np.sqrt(h)
            if t > 0.0 and (best < 0.0 or t < best):
                best = t
    return best


@njit(nogil=True, cache=False, forceinline=True)
def hit_bar(scene, p, ray):
    """Distance along a ray to the face of a bar or -1, the place (x, y) on it, and whether it is the marked side."""
    ox, oy, oz, dx, dy, dz = ray
    r, o = scene.bar_rotations[p], scene.bar_places[p]
    dn = dx * r[0, 2] + dy * r[1, 2] + dz * r[2, 2]
    if abs(dn) < 1e-9:
        return -1.0, 0.0, 0.0, False
    qx, qy, qz = ox - o[0], oy - o[1], oz - o[2]
    t = -(qx * r[0, 2] + qy * r[1, 2] + qz * r[2, 2]) / dn
    qx, qy, qz = qx + t * dx, qy + t * dy, qz + t * dz
    x = qx * r[0, 0] + qy * r[1, 0] + qz * r[2, 0]
    y = qx * r[0, 1] + qy * r[1, 1] + qz * r[2, 1]
    face = scene.bar_faces[p]
    if t <= 0.0 or x < face[0] or x > face[1] or abs(y) > face[2]:
        return -1.0, 0.0, 0.0, False
    return t, x, y, dn > 0.0


@njit(nogil=True, cache=False, forceinline=True)
def hit_room(scene, ray):
    """Distance along a ray to the room's walls from inside, and the wall: 0 x low, 1 x high, 2 y low .. 5 z high."""
    best, wall = 1e30, 0
    for axis in range(3):
        along = ray[3 + axis]
        if abs(along) > 1e-12:
            side = 1 if along > 0.0 else 0
            t = (scene.room[side, axis] - ray[axis]) / along
            if 0.0 < t < best:
                best, wall = t, 2 * axis + side
    return best, wall


@njit(nogil=True, cache=False, forceinline=True)
def trace(scene, ray):
    """The first surface on a ray: code, place on it (x, y), point and normal in the world."""
    ox, oy, oz, dx, dy, dz = ray
    t, wall = hit_room(scene, ray)
    code = wall
    nx = ny = nz = x = y = 0.0
    for k in range(len(scene.arms)):
        s = hit_arm(scene.arms[k], ray)
        if 0.0 < s < t:
            t, code = s, ARM
            nx, ny, nz = arm_normal(scene.arms[k], ox + s * dx, oy + s * dy, oz + s * dz)
    for p in range(len(scene.bar_places)):
        s, bx, by, marked = hit_bar(scene, p, ray)
        if 0.0 < s < t:
            t, code, x, y = s, BAR + p, bx, by
            side = -1.0 if marked else 1.0
            r = scene.bar_rotations[p]
            nx, ny, nz = side * r[0, 2], side * r[1, 2], side * r[2, 2]
            if marked:
                for m in range(len(scene.mark_x)):
                    if (
                        scene.mark_bar[m] == p
                        and abs(bx - scene.mark_x[m]) <= scene.half_sticker
                        and abs(by) <= scene.half_sticker
                    ):
                        code, x = MARK + m, bx - scene.mark_x[m]
    if scene.ball_radius > 0.0:
        r = scene.ball_rotation
        own = in_ball_frame(scene, ray)
        bx, by, bz, ex, ey, ez = own
        s, gx, gy, gz = hit_ball(scene, own)
        if 0.0 < s < t:
            t, code = s, BALL
            bx, by, bz = bx + s * ex, by + s * ey, bz + s * ez
            q = np.sqrt(bx * bx + by * by + bz * bz)
            bx, by, bz = bx / q, by / q, bz / q
            gn = gx * bx + gy * by + gz * bz
            mx, my, mz = bx - (gx - gn * bx) / q, by - (gy - gn * by) / q, bz - (gz - gn * bz) / q
            q = np.sqrt(mx * mx + my * my + mz * mz)
            mx, my, mz = mx / q, my / q, mz / q
            nx = r[0, 0] * mx + r[0, 1] * my + r[0, 2] * mz
            ny = r[1, 0] * mx + r[1, 1] * my + r[1, 2] * mz
            nz = r[2, 0] * mx + r[2, 1] * my + r[2, 2] * mz
            sticker, x, y = sticker_at(scene, bx, by, bz)
            if sticker >= 0:
                code = STICKER + sticker
    px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
    if code < ARM:
        nx, ny, nz, x, y = wall_place(code, px, py, pz)
    return code, x, y, (px, py, pz), (nx, ny, nz)


@njit(nogil=True, cache=False, forceinline=True)
def arm_normal(arm, px, py, pz):
    """Outward unit normal of a capsule (ends and radius, (7,) mm) at a point of its surface, mm."""
    ax, ay, az = arm[3] - arm[0], arm[4] - arm[1], arm[5] - arm[2]
    s = ((px - arm[0]) * ax + (py - arm[1]) * ay + (pz - arm[2]) * az) / (ax * ax + ay * ay + az * az)
    s = min(max(s, 0.0), 1.0)
    nx, ny, nz = px - arm[0] - s * ax, py - arm[1] - s * ay, pz - arm[2] - s * az
    q = np.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / q, ny / q, nz / q


@njit(nogil=True, cache=False, forceinline=True)
def wall_place(wall, px, py, pz):
    """Inward normal of a wall and the two coordinates of a point (mm) on it."""
    side = -1.0 if wall % 2 else 1.0
    if wall < 2:
        return side, 0.0, 0.0, py, pz
    if wall < 4:
        return 0.0, side, 0.0, px, pz
    return 0.0, 0.0, side, px, py
