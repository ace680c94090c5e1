"""How well a dot's centre can be measured at all: the Cramer-Rao bound of a blurred ellipse in a noisy image."""

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.kernels import njit
from spherecal_sim.optics import KernelTerm, Sensor, gather, separable
from spherecal_sim.radiance import CELLS

_AROUND_PX = 1.0  # window beyond the blurred rim, for the background
_STEP_PX = 0.05  # of the numeric derivatives; the sampled ellipse is linear over it to 1e-3


def dot_bounds(
    centres: FloatArray, outline_moments: FloatArray, exposure: NDArray[np.float32], kernel: FloatArray, sensor: Sensor
) -> FloatArray:
    """Cramer-Rao bounds sqrt(var u + var v) of dots' centres, (n,) px: nine parameters, the blur known."""
    terms = separable(kernel)
    blur = len(kernel) / CELLS / 2
    bounds = np.full(len(centres), np.nan)
    for i, (centre, moments) in enumerate(zip(centres, outline_moments, strict=True)):
        values, vectors = np.linalg.eigh(moments)
        if values[0] <= 0:
            continue
        axes = (vectors * (2 * np.sqrt(values))) @ vectors.T
        half = int(np.ceil(2 * np.sqrt(values[1]) + min(blur, 4.0) + _AROUND_PX))
        first = np.rint(centre).astype(int) - half
        n = 2 * half + 1
        if (first < 0).any() or first[0] + n > exposure.shape[1] or first[1] + n > exposure.shape[0]:
            continue
        window = exposure[first[1] : first[1] + n, first[0] : first[0] + n].astype(float)
        geometry = np.array([*(centre - first), axes[0, 0], axes[0, 1], axes[1, 1]])
        bounds[i] = _bound(geometry, window, terms, sensor)
    return bounds


def _bound(geometry: FloatArray, window: FloatArray, terms: list[KernelTerm], sensor: Sensor) -> float:
    """The bound of one dot in its window (n, n) of exposures; geometry: u, v in the window, a11, a12, a22."""
    n = len(window)
    v, u = np.mgrid[:n, :n] - (n - 1) / 2
    cover = _blurred(geometry, n, terms)
    plane = [cover, np.ones((n, n)), u, v]
    linear = np.stack([p.ravel() for p in plane], axis=1)
    contrast = np.linalg.lstsq(linear, window.ravel(), rcond=None)[0][0]
    slopes = []
    for k in range(5):
        step = np.zeros(5)
        step[k] = _STEP_PX
        change = _blurred(geometry + step, n, terms) - _blurred(geometry - step, n, terms)
        slopes.append(contrast * change.ravel() / (2 * _STEP_PX))
    jacobian = np.column_stack([*slopes, linear])
    digit = 1.0 / (2**sensor.bits - 1) / sensor.gain
    variance = (
        np.clip(window.ravel(), 0.0, 1.0) / sensor.full_well_e
        + (sensor.read_noise_e / sensor.full_well_e) ** 2
        + digit**2 / 12
    )
    information = jacobian.T @ (jacobian / variance[:, None])
    scale = 1 / np.sqrt(np.diag(information))
    covariance = np.linalg.pinv(information * scale * scale[:, None], hermitian=True) * scale * scale[:, None]
    return float(np.sqrt(covariance[0, 0] + covariance[1, 1]))


def _blurred(geometry: FloatArray, n: int, terms: list[KernelTerm]) -> FloatArray:
    """The part of each pixel (n, n) that the blurred ellipse covers."""
    margin = int(np.ceil(len(terms[0][0]) / 2 / CELLS))
    cells = np.empty(((n + 2 * margin) * CELLS,) * 2, np.float32)
    _cover(geometry, margin, cells)
    image = np.zeros((n, n), np.float32)
    for column, row in terms:
        gather(cells, column, row, margin, image)
    return image.astype(float)


@njit(nogil=True, cache=True)
def _cover(geometry, margin, cells):
    """The part of each cell inside the ellipse c + A w, |w| = 1, A symmetric; a linear ramp across the rim."""
    u0, v0, a, b, d = geometry
    det = a * d - b * b
    ia, ib, id_ = d / det, -b / det, a / det
    for i in range(cells.shape[0]):
        y = (i + 0.5) / CELLS - 0.5 - margin - v0
        for j in range(cells.shape[1]):
            x = (j + 0.5) / CELLS - 0.5 - margin - u0
            p, q = ia * x + ib * y, ib * x + id_ * y
            rho = np.sqrt(p * p + q * q)
            if rho < 1e-6:
                cells[i, j] = 1.0
                continue
            slope = np.hypot(ia * p + ib * q, ib * p + id_ * q) / rho
            cells[i, j] = min(max(0.5 + CELLS * (1.0 - rho) / slope, 0.0), 1.0)
