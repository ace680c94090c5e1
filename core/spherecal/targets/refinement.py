"""Sub-pixel dots of all targets of an image: two passes of dot_fit.py with the image's own noise and blur.

The first pass is over the stickers seen most squarely, with the noise guessed. It estimates the noise of the camera
(variance = constant + gain * light, from flat pixels) and the usual blur and growth of dots in this image. The second
starts from these.
"""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.kernels import KERNEL, njit
from spherecal.targets import dot_fit as df
from spherecal.targets import sticker_view as sv
from spherecal.targets.blobs import GreyImage
from spherecal.targets.dot_fit import BINS, SHARED_SIZE, fit_sticker
from spherecal.targets.sticker_view import eccentricity, local_affine

_START_BLUR_PX = 0.8  # a good lens has 0.65 px, and the pixel's own width adds 0.29 px
_START_PRIOR = (0.5, 0.06)  # standard deviations of blur in px and of growth, before anything is known
_PRIOR = (0.15, 0.03)  # and from sticker to sticker of one image: depth of field, and ink
_START_NOISE = 0.03  # of a dot's light
_FIRST_PASS = 8  # stickers: blur to 0.005 px and the noise to 5 %
_STEPS = 10
_CLIPPED_PIXELS = 16  # that many pixels at the image's largest value are saturation, not chance
_ROUNDING = 1 / 12  # variance of whole grey values
_BORDER_PX = 1.5  # a dot nearer to the image's border lacks the background on one side

# Where the background around a dot is looked at: cosines and sines of twelve directions.
_RING = np.stack([np.cos(np.pi / 6 * np.arange(12)), np.sin(np.pi / 6 * np.arange(12))], axis=1)

_FLOOR_PX = 0.0007  # standard deviation that the fit's covariance does not know: noise-free images leave it


@dataclass(frozen=True)
class RefinedDots:
    """Refined dots of n targets.

    `uv` (n, 8, 2) px: images of the centres of the dots' rims, NaN where there is none; `sigma` (n, 8, 2) px: their
    standard uncertainties. `misfit` (n,): rms of the residuals over their expected noise. `blur_px` and `growth`
    (n,).
    """

    uv: FloatArray
    sigma: FloatArray
    misfit: FloatArray
    blur_px: FloatArray
    growth: FloatArray


def refine(
    image: GreyImage, uv: FloatArray, layouts: FloatArray, radius: float, views: FloatArray, focal_error: float,
    wanted: IntArray | None = None,
) -> RefinedDots:  # fmt: skip
    """The dots of n targets, fitted to the image; a target whose fit fails has no dots.

    Dots may be brighter or darker than their background. Where some are `wanted`, the others only tell the image's
    noise and blur.

    `image`: grey image, (h, w); `uv`: where to start, (n, 8, 2) px, NaN where a dot is to be left out; `layouts`,
    `radius`: places (n, 8, 2) and radius of the dots, in the unit of the views.
    """
    n = len(uv)
    present = np.isfinite(uv[..., 0])
    dots = np.zeros((n, 8, 4))
    dots[:, :, :2] = np.nan_to_num(uv)
    _start(image, layouts, radius, views, present, dots)
    shared = np.zeros((n, SHARED_SIZE))
    shared[:, df.BLUR], shared[:, df.GROWTH] = _START_BLUR_PX, 1.0
    covariance = np.full((n, 8, 3), np.nan)
    ok = present.sum(axis=1) > 0
    typical = np.median(np.abs(dots[present][:, df.AMPLITUDE])) if present.any() else 1.0
    noise = np.array([(_START_NOISE * typical) ** 2, 0.0, 0.0])
    largest, times = _largest_value(image)
    top, clip = float(largest), float(largest) if times >= _CLIPPED_PIXELS else np.inf
    first = np.argsort(-views[:, sv.COSINE], kind="stable")[:_FIRST_PASS]
    for chosen, prior in ((first, _START_PRIOR), (np.arange(n) if wanted is None else wanted, _PRIOR)):
        bins = np.zeros((BINS, 3))
        _fit_all(
            image, layouts, radius, views, present, top, clip, noise, np.array(prior), chosen, dots, shared, covariance,
            ok, bins,
        )  # fmt: skip
        if chosen is first and ok[first].any():
            noise, known = _fit_noise(bins, noise), first[ok[first]]
            shared[:, df.BLUR], shared[:, df.GROWTH] = np.median(shared[known][:, [df.BLUR, df.GROWTH]], axis=0)
    shift = _eccentricities(layouts, radius, views)
    good = present & ok[:, None]
    sigma = np.sqrt(covariance[:, :, [0, 2]] + _FLOOR_PX**2 + (focal_error * shift) ** 2)
    found, sigma = (np.where(good[..., None], one, np.nan) for one in (dots[:, :, :2] + shift, sigma))
    return RefinedDots(found, sigma, shared[:, df.MISFIT], shared[:, df.BLUR], shared[:, df.GROWTH])


@njit(**KERNEL)
def _largest_value(image):
    """The largest grey value, and how many pixels of an image have it."""
    height, width = image.shape
    of_row = np.empty(height, image.dtype)
    for y in range(height):
        most = image[y, 0]
        for x in range(width):
            most = max(most, image[y, x])
        of_row[y] = most
    largest, count = of_row.max(), 0
    for y in range(height):
        if of_row[y] == largest:
            for x in range(width):
                count += image[y, x] == largest
    return largest, count


@njit(**KERNEL)
def _fit_all(
    image, layouts, radius, views, present, top, clip, noise, prior, chosen, dots, shared, covariance, ok, bins
):
    for n in chosen:
        if ok[n]:
            ok[n] = fit_sticker(
                image, layouts[n], radius, views[n], present[n], top, clip, noise, prior, _STEPS, dots[n], shared[n],
                covariance[n], bins,
            )  # fmt: skip


@njit(**KERNEL)
def _start(image, layouts, radius, views, present, dots):
    """Background and amplitude to start from: the median on a ring around each dot, and the light at its centre.

    Dots that the border of the image cuts are taken out of `present`.
    """
    ring = np.empty(len(_RING))
    height, width = image.shape
    for n in range(len(layouts)):
        for k in range(8):
            if not present[n, k]:
                continue
            uu, uv, vu, vv = local_affine(views[n], layouts[n, k, 0], layouts[n, k, 1])
            u, v = dots[n, k, 0], dots[n, k, 1]
            half_u, half_v = radius * np.hypot(uu, uv) + _BORDER_PX, radius * np.hypot(vu, vv) + _BORDER_PX
            if u < half_u or v < half_v or u > width - 1 - half_u or v > height - 1 - half_v:
                present[n, k] = False
                continue
            for i in range(len(ring)):
                x, y = radius * _RING[i, 0], radius * _RING[i, 1]
                eu, ev = uu * x + uv * y, vu * x + vv * y
                longer = 1 + 2.0 / max(np.hypot(eu, ev), 1e-6)
                column = min(max(round(u + longer * eu), 0), width - 1)
                row = min(max(round(v + longer * ev), 0), height - 1)
                ring[i] = image[row, column]
            dots[n, k, 3] = np.median(ring)
            dots[n, k, 2] = image[round(v), round(u)] - dots[n, k, 3]


def _fit_noise(bins: FloatArray, before: FloatArray) -> FloatArray:
    """Constant and gain of variance = constant + gain * light from the bins of flat pixels, and the least variance.

    The constant may be negative: light counts from the camera's black level, grey values from zero.
    """
    filled = bins[:, 2] >= 10
    if not filled.any():
        return before
    light, variance = bins[filled, 0] / bins[filled, 2], bins[filled, 1] / bins[filled, 2]
    least = max(0.5 * float(variance.min()), _ROUNDING)
    weight = np.sqrt(bins[filled, 2]) / np.maximum(variance, least)
    design = np.column_stack([np.ones_like(light), light]) * weight[:, None]
    constant, gain = np.linalg.lstsq(design, variance * weight, rcond=None)[0]
    if gain < 0:  # no law of shot noise, as where a camera's curve is bent
        constant, gain = float(np.average(variance, weights=weight**2)), 0.0
    return np.array([constant, gain, least])


@njit(**KERNEL)
def _eccentricities(layouts, radius, views):
    """From the centres of the ellipses to the images of the circles' centres, (n, 8, 2) px."""
    shift = np.empty((len(layouts), 8, 2))
    for n in range(len(layouts)):
        for k in range(8):
            shift[n, k, 0], shift[n, k, 1] = eccentricity(views[n], layouts[n, k, 0], layouts[n, k, 1], radius)
    return shift
