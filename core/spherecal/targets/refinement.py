"""Sub-pixel dots of all targets of an image: two passes of dot_fit.py with the image's own noise and blur.

The first pass, with the noise guessed, tells the noise of the camera (variance = constant + gain * light, from flat
pixels) and the usual blur and growth of dots in this image; the second starts from these.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from spherecal.arrays import BoolArray, FloatArray
from spherecal.targets import dot_fit as df
from spherecal.targets import sticker_view as sv
from spherecal.targets.blobs import GreyImage
from spherecal.targets.code_table import CodeTable
from spherecal.targets.dot_fit import BINS, SHARED_SIZE, fit_sticker
from spherecal.targets.sticker_view import eccentricity, local_affine

_START_BLUR_PX = 0.8  # a good lens has 0.65 px, and the pixel's own width adds 0.29 px
_START_PRIOR = (0.5, 0.06)  # standard deviations of blur in px and of growth, before anything is known
_PRIOR = (0.15, 0.03)  # and from sticker to sticker of one image: depth of field, and ink
_START_NOISE = 0.03  # of a dot's light
_STEPS = 6
_CLIPPED_PIXELS = 16  # that many pixels at the image's largest value are saturation, not chance
_FIRST_PASS = 8  # stickers, those seen most squarely: blur to 0.005 px and the noise to 5 %


@dataclass(frozen=True)
class Dots:
    """Refined dots of n targets: `uv` (n, 8, 2) px, `covariance` (n, 8, 3) px^2 uu uv vv, `misfit` (n,) normalised rms.

    `ok` (n,): whether the fit held all dots. `noise`: constant and gain of the variance in grey^2. `uv` are the images of
    the centres of the dots' rims: the ellipses' centres less the perspective's eccentricity.
    """

    uv: FloatArray
    covariance: FloatArray
    misfit: FloatArray
    blur_px: FloatArray
    growth: FloatArray
    amplitude: FloatArray
    ok: BoolArray
    noise: tuple[float, float]


def refine(image: GreyImage, uv: FloatArray, layouts: FloatArray, views: FloatArray, table: CodeTable) -> Dots:
    """Fit the dots of n targets, starting from `uv` (n, 8, 2) px, NaN where a dot is to be left out.

    `layouts` (n, 8, 2) and `views` (n, VIEW_SIZE) are in units of the code table.
    """
    n = len(uv)
    present = np.isfinite(uv[..., 0])
    brightest = image.max()
    clip = float(brightest) if np.count_nonzero(image == brightest) >= _CLIPPED_PIXELS else float(brightest) + 1
    dots = np.zeros((n, 8, 4))
    dots[:, :, :2] = np.nan_to_num(uv)
    _start_light(image, layouts, table.dot_radius, views, present, dots)
    typical = np.median(dots[present][:, df.AMPLITUDE]) if present.any() else 1.0
    noise = np.array([(_START_NOISE * typical) ** 2, 0.0])
    shared = np.zeros((n, SHARED_SIZE))
    shared[:, df.BLUR], shared[:, df.GROWTH] = _START_BLUR_PX, 1.0
    covariance = np.zeros((n, 8, 3))
    ok = np.ones(n, dtype=bool)
    first = np.argsort(-views[:, sv.COSINE], kind="stable")[:_FIRST_PASS]
    for chosen, prior in ((first, _START_PRIOR), (np.arange(n), _PRIOR)):
        bins = np.zeros((BINS, 3))
        _fit_all(
            image, layouts, table.dot_radius, views, present, clip, noise, np.array(prior), chosen, dots, shared,
            covariance, ok, bins,
        )  # fmt: skip
        noise = _fit_noise(bins, noise)
        if chosen is first and ok[first].any():
            known = first[ok[first]]
            shared[:, df.BLUR], shared[:, df.GROWTH] = np.median(shared[known][:, [df.BLUR, df.GROWTH]], axis=0)
        ok[first] |= chosen is first
    centres = dots[:, :, :2].copy()
    _remove_eccentricity(layouts, table.dot_radius, views, centres)
    return Dots(
        np.where(present[..., None], centres, np.nan), covariance, shared[:, df.MISFIT], shared[:, df.BLUR],
        shared[:, df.GROWTH], dots[:, :, df.AMPLITUDE], ok, (float(noise[0]), float(noise[1])),
    )  # fmt: skip


@njit(nogil=True, cache=True)
def _fit_all(image, layouts, radius, views, present, clip, noise, prior, chosen, dots, shared, covariance, ok, bins):
    for n in chosen:
        if ok[n]:
            ok[n] = fit_sticker(
                image, layouts[n], radius, views[n], present[n], clip, noise, prior, _STEPS, dots[n], shared[n],
                covariance[n], bins,
            )  # fmt: skip


@njit(nogil=True, cache=True)
def _start_light(image, layouts, radius, views, present, dots):
    """Background and amplitude to start from: the median on a ring around each dot, and the light at its centre."""
    ring = np.empty(12)
    for n in range(len(layouts)):
        for k in range(8):
            if not present[n, k]:
                continue
            uu, uv, vu, vv = local_affine(views[n], layouts[n, k, 0], layouts[n, k, 1])
            u, v = dots[n, k, 0], dots[n, k, 1]
            for i in range(len(ring)):
                angle = 2 * np.pi * i / len(ring)
                x, y = radius * np.cos(angle), radius * np.sin(angle)
                eu, ev = uu * x + uv * y, vu * x + vv * y
                longer = 1 + 2.0 / max(np.hypot(eu, ev), 1e-6)
                column = min(max(int(round(u + longer * eu)), 0), image.shape[1] - 1)
                row = min(max(int(round(v + longer * ev)), 0), image.shape[0] - 1)
                ring[i] = image[row, column]
            column = min(max(int(round(u)), 0), image.shape[1] - 1)
            row = min(max(int(round(v)), 0), image.shape[0] - 1)
            dots[n, k, 3] = np.median(ring)
            dots[n, k, 2] = max(image[row, column] - dots[n, k, 3], 1.0)


def _fit_noise(bins: FloatArray, before: FloatArray) -> FloatArray:
    """Constant and gain of variance = constant + gain * light from the bins of flat pixels, both at least 0."""
    filled = bins[:, 2] >= 10
    if not filled.any():
        return before
    light, variance = bins[filled, 0] / bins[filled, 2], bins[filled, 1] / bins[filled, 2]
    weight = np.sqrt(bins[filled, 2]) / np.maximum(variance, 1e-6 * variance.max() + 1e-12)
    design = np.column_stack([np.ones_like(light), light]) * weight[:, None]
    constant, gain = np.linalg.lstsq(design, variance * weight, rcond=None)[0]
    if gain < 0:
        constant, gain = float(np.average(variance, weights=weight**2)), 0.0
    least = 1 / 12  # of rounding to whole grey values
    return np.array([max(constant, least), gain])


@njit(nogil=True, cache=True)
def _remove_eccentricity(layouts, radius, views, centres):
    """From the centres of the ellipses to the images of the circles' centres, in place."""
    for n in range(len(layouts)):
        for k in range(8):
            du, dv = eccentricity(views[n], layouts[n, k, 0], layouts[n, k, 1], radius)
            centres[n, k, 0] += du
            centres[n, k, 1] += dv
