"""Fast drawing of the simulated ball or bar, 15 to 60 ms an image: dots as ellipses, no clutter, dirt or gloss."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.kernels import njit
from spherecal.geometry.camera import image_reach, project
from spherecal_sim.dot_truth import RIM_POINTS, Station, TrueDots

_BACKGROUND = 0.08
_BALL = 0.25
_BLACK = 0.04
_WHITE = 0.85
_STEEPEST = np.cos(np.deg2rad(78.0))  # stickers seen flatter than this are left out, as detection leaves them
_EVERY = 4  # of the rim's points: 8 give an ellipse's axes


@dataclass(frozen=True)
class Solid:
    """The body with the dots: a ball (centre (3,), radius) or a bar's face (corners (4, 3)), mm, in the world."""

    ball: tuple[FloatArray, float] | None = None
    face: FloatArray | None = None


def draw(solid: Solid, dots: TrueDots, station: Station, blur_px: float, white: float) -> NDArray[np.float32]:
    """The noise-free image (h, w), 1 = full scale."""
    width, height = station.size
    image = np.full((height, width), _BACKGROUND * white, np.float32)
    level = white / _WHITE
    if solid.ball is not None:
        _draw_ball(image, *solid.ball, station, level)
    if solid.face is not None:
        corners = _image_points(solid.face[None], station)
        if np.isfinite(corners).all():
            _fill_quads(image, corners, np.array([_BALL * level]), blur_px)
    towards = station.centre_mm - dots.places
    cosine = (towards * dots.normals).sum(axis=1) / np.linalg.norm(towards, axis=1)
    per_sheet = len(dots.places) // len(dots.sheets)
    seen = cosine.reshape(-1, per_sheet).min(axis=1) > _STEEPEST
    sheets = _image_points(dots.sheets[seen], station)
    good = np.isfinite(sheets).all(axis=(1, 2))
    _fill_quads(image, sheets[good], np.full(int(good.sum()), _BLACK * level), blur_px)
    shown = np.flatnonzero(np.repeat(seen, per_sheet))
    centres, axes = _ellipses(dots.rims[shown, ::_EVERY], station)
    good = np.isfinite(centres).all(axis=1)
    light = _WHITE * level * (0.4 + 0.6 * cosine[shown])
    _fill_ellipses(image, centres[good], axes[good], light[good], blur_px)
    return image


def _image_points(points: FloatArray, station: Station) -> FloatArray:
    """Image points (..., 2) px of world points (..., 3); NaN behind the camera or far outside the lens's field."""
    flat = points.reshape(-1, 3) @ station.rotation.T + station.translation_mm
    wide = image_reach(station.intrinsics[None], np.array([station.size]))
    out = (flat[:, 2] <= 1.0) | (np.hypot(flat[:, 0], flat[:, 1]) > wide * flat[:, 2])
    uv = project(np.where(out[:, None], [0.0, 0.0, 1.0], flat), station.intrinsics)
    uv[out] = np.nan
    return uv.reshape(*points.shape[:-1], 2)


def _ellipses(rims: FloatArray, station: Station) -> tuple[FloatArray, FloatArray]:
    """Centres (n, 2) and conjugate half axes (n, 2, 2) px of circles given by even points (n, m, 3) of their rims."""
    uv = _image_points(rims, station)
    angle = 2 * np.pi * np.arange(rims.shape[1]) / rims.shape[1]
    middle = _image_points(rims.mean(axis=1), station)
    centres = middle + 2 * (uv.mean(axis=1) - middle)
    waves = np.stack([np.cos(angle), np.sin(angle)]) * (2 / rims.shape[1])
    return centres, np.einsum("km,nmj->nkj", waves, uv)


def _draw_ball(image: NDArray[np.float32], place: FloatArray, radius: float, station: Station, level: float) -> None:
    """The ball's outline is a circle in space nearer than its centre."""
    ray = place - station.centre_mm
    distance = float(np.linalg.norm(ray))
    if distance <= radius:
        return
    shrink = 1 - (radius / distance) ** 2
    side = np.cross(ray, [0.0, 0.0, 1.0] if abs(ray[2]) < 0.9 * distance else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(ray / distance, side)
    angle = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    circle = radius * np.sqrt(shrink) * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other)
    centres, axes = _ellipses((station.centre_mm + shrink * ray + circle)[None], station)
    if np.isfinite(centres).all():
        _shade_ellipse(image, centres[0], axes[0], _BALL * level)


@njit(nogil=True, cache=True)
def _soft(distance_px: float, blur_px: float) -> float:
    """Light of a straight edge at a distance (positive: outside), blurred by a Gaussian: 1 deep inside, 0 outside."""
    x = distance_px / (1.4142135623730951 * blur_px)
    if x > 3.0:
        return 0.0
    if x < -3.0:
        return 1.0
    # Abramowitz and Stegun 7.1.26: erf to 1.5e-7
    t = 1.0 / (1.0 + 0.3275911 * abs(x))
    poly = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    erf = 1.0 - poly * np.exp(-x * x)
    return 0.5 * (1.0 - erf) if x >= 0 else 0.5 * (1.0 + erf)


@njit(nogil=True, cache=True)
def _fill_ellipses(
    image: NDArray[np.float32], centres: FloatArray, axes: FloatArray, light: FloatArray, blur_px: float
) -> None:
    height, width = image.shape
    for i in range(len(centres)):
        a, b = axes[i, 0], axes[i, 1]
        det = a[0] * b[1] - a[1] * b[0]
        if abs(det) < 1e-6:
            continue
        reach_u = np.sqrt(a[0] ** 2 + b[0] ** 2) + 3 * blur_px + 1
        reach_v = np.sqrt(a[1] ** 2 + b[1] ** 2) + 3 * blur_px + 1
        for v in range(max(int(centres[i, 1] - reach_v), 0), min(int(centres[i, 1] + reach_v) + 2, height)):
            for u in range(max(int(centres[i, 0] - reach_u), 0), min(int(centres[i, 0] + reach_u) + 2, width)):
                x, y = u - centres[i, 0], v - centres[i, 1]
                p, q = (x * b[1] - y * b[0]) / det, (a[0] * y - a[1] * x) / det
                r = np.sqrt(p * p + q * q)
                if r < 1e-9:
                    inside = 1.0
                else:
                    slope_u, slope_v = (p * b[1] - q * a[1]) / (det * r), (q * a[0] - p * b[0]) / (det * r)
                    inside = _soft((r - 1.0) / np.sqrt(slope_u**2 + slope_v**2), blur_px)
                image[v, u] += inside * (light[i] - image[v, u])


@njit(nogil=True, cache=True)
def _shade_ellipse(image: NDArray[np.float32], centre: FloatArray, axes: FloatArray, light: float) -> None:
    height, width = image.shape
    a, b = axes[0], axes[1]
    det = a[0] * b[1] - a[1] * b[0]
    reach_u, reach_v = np.sqrt(a[0] ** 2 + b[0] ** 2), np.sqrt(a[1] ** 2 + b[1] ** 2)
    for v in range(max(int(centre[1] - reach_v), 0), min(int(centre[1] + reach_v) + 1, height)):
        for u in range(max(int(centre[0] - reach_u), 0), min(int(centre[0] + reach_u) + 1, width)):
            x, y = u - centre[0], v - centre[1]
            p, q = (x * b[1] - y * b[0]) / det, (a[0] * y - a[1] * x) / det
            r2 = p * p + q * q
            if r2 < 1.0:
                image[v, u] = light * (0.3 + 0.7 * np.sqrt(1.0 - r2))


@njit(nogil=True, cache=True)
def _fill_quads(image: NDArray[np.float32], corners: FloatArray, light: FloatArray, blur_px: float) -> None:
    """Convex four-sided figures (n, 4, 2)."""
    height, width = image.shape
    for i in range(len(corners)):
        q = corners[i]
        area = 0.0
        for k in range(4):
            j = (k + 1) % 4
            area += q[k, 0] * q[j, 1] - q[j, 0] * q[k, 1]
        turn = 1.0 if area > 0 else -1.0
        low_u, low_v = q[:, 0].min() - 3 * blur_px, q[:, 1].min() - 3 * blur_px
        high_u, high_v = q[:, 0].max() + 3 * blur_px, q[:, 1].max() + 3 * blur_px
        for v in range(max(int(low_v), 0), min(int(high_v) + 2, height)):
            for u in range(max(int(low_u), 0), min(int(high_u) + 2, width)):
                inside = 1.0
                for k in range(4):
                    j = (k + 1) % 4
                    du, dv = q[j, 0] - q[k, 0], q[j, 1] - q[k, 1]
                    far = turn * ((u - q[k, 0]) * dv - (v - q[k, 1]) * du) / np.sqrt(du * du + dv * dv)
                    inside *= _soft(far, blur_px)
                image[v, u] += inside * (light[i] - image[v, u])


_NOISE_BLOCK = np.random.default_rng(20).standard_normal(1 << 20).astype(np.float32)


def digitise(
    picture: NDArray[np.float32], bits: int, gain: float, rng: np.random.Generator
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Grey values (h, w) of a noise-free image: shot and read noise (from a block), gain, black level, clipping."""
    start = int(rng.integers(len(_NOISE_BLOCK)))
    out: NDArray[np.uint8] | NDArray[np.uint16]
    out = np.empty(picture.shape, np.uint8) if bits <= 8 else np.empty(picture.shape, np.uint16)
    _digitise(picture.ravel(), out.reshape(-1), _NOISE_BLOCK, start, float(2**bits - 1), float(gain))
    return out


_FULL_WELL_E = 10_500.0
_READ_NOISE_E = 2.5
_BLACK_LEVEL = 0.01


@njit(nogil=True, cache=True)
def _digitise(
    picture: NDArray[np.float32],
    out: NDArray[np.uint8] | NDArray[np.uint16],
    noise: NDArray[np.float32],
    start: int,
    top: float,
    gain: float,
) -> None:
    place, last = start, len(noise) - 1
    for i in range(len(picture)):
        electrons = picture[i] * _FULL_WELL_E
        electrons += noise[place] * np.sqrt(electrons + _READ_NOISE_E**2)
        place = (place + 1) & last
        value = (min(electrons, _FULL_WELL_E) / _FULL_WELL_E * gain + _BLACK_LEVEL) * top
        out[i] = int(min(max(value + 0.5, 0.0), top))
