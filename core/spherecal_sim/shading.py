"""How bright a surface of the scene is: ring lights, gloss, and what is printed on it (numba kernels)."""

import numpy as np

from spherecal.base.kernels import njit
from spherecal_sim.tracing import ARM, ARM_SKIN, BALL, BALL_SKIN, BAR, BAR_SKIN, BLOB, DOT, MARK, PAPER, STICKER, WALL


@njit(nogil=True, cache=False, forceinline=True)
def light(scene, eye, place, normal):
    """Diffuse irradiance and gloss (Blinn's, exponent 64, as of a satin film) of all ring lights as seen from `eye`."""
    (px, py, pz), (nx, ny, nz) = place, normal
    vx, vy, vz = eye[0] - px, eye[1] - py, eye[2] - pz
    q = 1.0 / np.sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx * q, vy * q, vz * q
    diffuse, shine = scene.ambient, 0.0
    for k in range(len(scene.lights)):
        lx, ly, lz = scene.lights[k, 0] - px, scene.lights[k, 1] - py, scene.lights[k, 2] - pz
        d2 = lx * lx + ly * ly + lz * lz
        q = 1.0 / np.sqrt(d2)
        cosine = (lx * nx + ly * ny + lz * nz) * q
        if cosine <= 0.0:
            continue
        power = scene.light_power / d2
        diffuse += power * cosine
        hx, hy, hz = lx * q + vx, ly * q + vy, lz * q + vz
        c = (hx * nx + hy * ny + hz * nz) / np.sqrt(hx * hx + hy * hy + hz * hz)
        if c > 0.8:  # 0.8^64 = 6e-7
            c *= c
            c *= c
            c *= c
            c *= c
            c *= c
            shine += power * c * c
    return diffuse, scene.gloss * shine


@njit(nogil=True, cache=False, forceinline=True)
def albedo(scene, code, x, y):
    """Albedo of a surface at a place (x, y) mm on it, hard edges."""
    if code >= STICKER:
        return sticker_albedo(scene, scene.sticker_dots[code - STICKER], code - STICKER, x, y)
    if code >= MARK:
        m = code - MARK
        return sticker_albedo(scene, scene.mark_dots[m], len(scene.sticker_dots) + m, x, y)
    if code >= BAR:
        return scene.albedos[BAR_SKIN]
    if code == BALL:
        return scene.albedos[BALL_SKIN]
    if code == ARM:
        return scene.albedos[ARM_SKIN]
    return wall_albedo(scene, code, x, y)


@njit(nogil=True, cache=False, forceinline=True)
def sticker_albedo(scene, dots, dirt_index, x, y):
    """Albedo of a sticker at (x, y) mm: paper, dots (n, 2) mm, and dirt on top."""
    value = scene.albedos[PAPER]
    for k in range(len(dots)):
        if (x - dots[k, 0]) ** 2 + (y - dots[k, 1]) ** 2 <= scene.dot_radius**2:
            value = scene.albedos[DOT]
    for k in range(scene.dirt.shape[1]):
        if dirt_distance(scene.dirt[dirt_index, k], x, y) <= 0.0:
            value = scene.dirt[dirt_index, k, 5]
    return value


@njit(nogil=True, cache=False, forceinline=True)
def dirt_distance(dirt, x, y):
    """Distance in mm from the edge of a speck or scratch (ends, half width, albedo), negative inside."""
    if dirt[4] <= 0.0:
        return 1.0
    ax, ay = dirt[2] - dirt[0], dirt[3] - dirt[1]
    s = ((x - dirt[0]) * ax + (y - dirt[1]) * ay) / max(ax * ax + ay * ay, 1e-12)
    s = min(max(s, 0.0), 1.0)
    return np.hypot(x - dirt[0] - s * ax, y - dirt[1] - s * ay) - dirt[4]


@njit(nogil=True, cache=False, forceinline=True)
def wall_albedo(scene, wall, x, y):
    """Albedo of the room's walls, with their white blobs, at two coordinates in mm."""
    g = scene.blob_grid.shape[1]
    first = 1 if wall < 2 else 0
    second = 1 if wall >= 4 else 2
    i = int((x - scene.room[0, first]) / (scene.room[1, first] - scene.room[0, first]) * g)
    j = int((y - scene.room[0, second]) / (scene.room[1, second] - scene.room[0, second]) * g)
    if 0 <= i < g and 0 <= j < g:
        for c in range(scene.blob_grid.shape[3]):
            b = scene.blob_grid[wall, i, j, c]
            if b < 0:
                break
            if (x - scene.blobs[b, 1]) ** 2 + (y - scene.blobs[b, 2]) ** 2 <= scene.blobs[b, 3] ** 2:
                return scene.albedos[BLOB]
    return scene.albedos[WALL]
