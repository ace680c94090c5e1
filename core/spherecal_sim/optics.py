"""From radiance to an image: point-spread function, vignetting, sensor noise, digits."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift, uniform_filter1d

from spherecal.base.arrays import FloatArray
from spherecal.base.kernels import njit
from spherecal_sim.radiance import CELLS

Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class Psf:
    """A lens's point-spread function; its centroid is zero, so that it moves no image."""

    kind: Literal["gaussian", "disc", "coma"] = "gaussian"
    # sd of gaussian and coma's core (flare: twice the width, a sixth of the light), radius of disc
    size_px: float = 0.65


@dataclass(frozen=True)
class Sensor:
    """How a sensor counts: electrons at full scale, read noise, digits, as a 3.45 um CMOS; 0 and full scale clip."""

    bits: int = 8  # more than 8 go into 16-bit pixels
    full_well_e: float = 10_500.0
    read_noise_e: float = 2.5
    black: float = 0.01  # offset, part of full scale
    gain: float = 1.0  # of electrons, before counting
    noise: bool = True
    high_bits: bool = False


_FINE = 8  # fine samples a cell when a kernel is made


def pixel_kernel(psf: Psf) -> FloatArray:
    """Weights (k, k) of the cells around a pixel's centre: point-spread function times pixel area, sum 1, k even."""
    cell = 1.0 / CELLS
    half = int(np.ceil(({"gaussian": 4.5, "disc": 1.1, "coma": 10.0}[psf.kind] * psf.size_px + 0.5) / cell))
    fine = (np.arange(2 * half * _FINE) + 0.5) * cell / _FINE - half * cell
    x, y = np.meshgrid(fine, fine)
    values = _psf_values(psf, x, y)
    values /= values.sum()
    values = shift(values, [-(values * a).sum() / (cell / _FINE) for a in (y, x)], order=1)
    width = CELLS * _FINE
    for axis in (0, 1):  # the pixel's square (an even width: the mean of its two places), then means over cells
        pair = [uniform_filter1d(values, width, axis, mode="constant", origin=origin) for origin in (0, -1)]
        values = (pair[0] + pair[1]) / 2
    kernel = values.reshape(2 * half, _FINE, 2 * half, _FINE).sum(axis=(1, 3))
    return kernel / kernel.sum()


def _psf_values(psf: Psf, x: FloatArray, y: FloatArray) -> FloatArray:
    s = psf.size_px
    if psf.kind == "disc":
        rim = 1.0 / (CELLS * _FINE)
        return np.clip((s - np.hypot(x, y)) / rim + 0.5, 0.0, 1.0)
    core = np.exp(-(x**2 + y**2) / (2 * s**2)) / s**2
    if psf.kind == "gaussian":
        return core
    flare = np.exp(-((x - 2 * s) ** 2 + (y - s) ** 2) / (2 * (2 * s) ** 2)) / (2 * s) ** 2
    return core + 0.2 * flare


KernelTerm = tuple[NDArray[np.float32], NDArray[np.float32]]


def separable(kernel: FloatArray) -> list[KernelTerm]:
    """The kernel as a short sum of outer products (column, row); a Gaussian needs one."""
    u, s, vt = np.linalg.svd(kernel)
    n = int((s > 1e-6 * s[0]).sum())  # far below one part of a 16-bit scale
    return [((u[:, i] * s[i]).astype(np.float32), vt[i].astype(np.float32)) for i in range(n)]


@njit(nogil=True, cache=True)
def gather(
    cells: NDArray[np.float32],
    column: NDArray[np.float32],
    row: NDArray[np.float32],
    margin: int,
    image: NDArray[np.float32],
) -> None:
    """Add to an image the cells weighted by column x row, (k,) each, around each pixel's centre."""
    k = len(column)
    offset = margin * CELLS + CELLS // 2 - k // 2
    line = np.empty(cells.shape[1], np.float32)
    for i in range(image.shape[0]):
        line[:] = 0.0
        for a in range(k):
            weight = column[a]
            source = cells[i * CELLS + offset + a]
            for j in range(len(line)):
                line[j] += weight * source[j]
        for j in range(image.shape[1]):
            total = np.float32(0.0)
            for b in range(k):
                total += row[b] * line[j * CELLS + offset + b]
            image[i, j] += total


def vignetting(intrinsics: FloatArray, size: tuple[int, int]) -> NDArray[np.float32]:
    """Natural vignetting cos^4 of the angle from the axis, (height, width), of a lens (16,)."""
    width, height = size
    x2 = ((np.arange(width) - intrinsics[2]) / intrinsics[0]) ** 2
    y2 = ((np.arange(height) - intrinsics[3]) / intrinsics[1]) ** 2
    return (1.0 / (1.0 + x2[None, :] + y2[:, None]) ** 2).astype(np.float32)


def expose(exposure: NDArray[np.float32], sensor: Sensor, rng: np.random.Generator) -> Image:
    """Grey values (height, width) of an image: shot and read noise, gain, black level, clipping, rounding."""
    electrons = np.clip(exposure, 0.0, None) * np.float32(sensor.full_well_e)
    if sensor.noise:
        deviation = np.sqrt(electrons + np.float32(sensor.read_noise_e**2))
        electrons = electrons + deviation * rng.standard_normal(exposure.shape, dtype=np.float32)
    electrons = np.minimum(electrons, sensor.full_well_e)
    top = 2**sensor.bits - 1
    digits = np.rint((electrons * (sensor.gain / sensor.full_well_e) + sensor.black) * top)
    digits = np.clip(digits, 0, top)
    if sensor.bits <= 8:
        return digits.astype(np.uint8)
    whole = digits.astype(np.uint16)
    return whole << (16 - sensor.bits) if sensor.high_bits else whole
