"""Corners of a chessboard by fitting what a blurred crossing of two edges looks like to the grey values around each.

On 33 real pictures of six cameras this leaves 0.08 to 0.15 px (rms of OpenCV's calibration of each camera alone) where
OpenCV's finders and `cornerSubPix` with any window leave 0.12 to 0.32.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from spherecal.base.arrays import FloatArray

# Half a window in squares: the larger, the less noise, and beyond 0.5 is the next corner. In px: 30 leave 0.081 px
# where 20 leave 0.094 (squares of 53 to 144 px), and more costs more than it gains.
_WINDOW, _LEAST_PX, _MOST_PX = 0.42, 3, 30
_STEPS, _STILL_PX = 6, 0.003  # from starts that are off by 1.6 px: within 0.002 px of the end
_BLUR_PX = 1.2  # at the start
_MOST_STEP = np.array([1.5, 1.5, 0.2, 0.2, 0.5])  # px, px, rad, rad, px
_AT_ONCE = 16  # corners whose windows fit in the processor's cache
_PLACE, _ALL = 5, 9  # terms: x, y, two directions, blur; then mean, contrast and the fall of light along x and y


def fit_corners(image: NDArray[np.uint8], start: FloatArray, square_px: float) -> FloatArray:
    """The corners (rows, columns, 2) px near `start`; `square_px`: the shortest side of a square."""
    half = int(np.clip(_WINDOW * square_px, _LEAST_PX, _MOST_PX))
    edges = [np.gradient(start, axis=axis).reshape(-1, 2) for axis in (1, 0)]
    normals = np.column_stack([np.arctan2(edge[:, 0], -edge[:, 1]) for edge in edges])
    around = np.asarray(cv2.copyMakeBorder(image, half, half, half, half, cv2.BORDER_REPLICATE), dtype=np.uint8)
    centres = start.reshape(-1, 2)
    parts = [slice(at, at + _AT_ONCE) for at in range(0, len(centres), _AT_ONCE)]
    return np.concatenate([_fit(around, half, centres[part], normals[part]) for part in parts]).reshape(start.shape)


def _fit(around: NDArray[np.uint8], half: int, centres: FloatArray, normals: FloatArray) -> FloatArray:
    """Some corners (k, 2) px by Gauss-Newton steps; `normals`: of both edges, (k, 2) rad."""
    v, u = (axis.ravel() for axis in np.mgrid[-half : half + 1, -half : half + 1])
    inside = u**2 + v**2 <= (half + 0.5) ** 2
    u, v = u[inside], v[inside]
    root = np.exp(-(u**2 + v**2) / (4 * (half / 1.6) ** 2))  # of the weight: the middle counts most
    height, width = around.shape
    at = np.clip(np.rint(centres), 0, (width - 2 * half - 1, height - 2 * half - 1)).astype(int)
    grey = root * around[at[:, 1:] + half + v, at[:, :1] + half + u]
    x = np.column_stack([centres - at, normals, np.full(len(at), _BLUR_PX)])
    terms = np.empty((*grey.shape, _ALL))
    terms[:, :, 5], terms[:, :, 7], terms[:, :, 8] = root, u * root, v * root
    for _ in range(_STEPS):
        across, along, blur = u - x[:, :1], v - x[:, 1:2], x[:, 4:]
        cos, sin = np.cos(x[:, 2:4, None]), np.sin(x[:, 2:4, None])
        off = (across[:, None] * cos + along[:, None] * sin) / blur[:, None]  # from both edges, in blurs
        side = erf(off)
        terms[:, :, 6] = root * side[:, 0] * side[:, 1]
        levels = _solved(terms[:, :, _PLACE:], grey)
        left = grey - (terms[:, :, _PLACE:] @ levels[:, :, None])[:, :, 0]
        slope = 2 / np.sqrt(np.pi) * np.exp(-(off**2)) * side[:, ::-1] * (root * levels[:, 1:2] / blur)[:, None]
        terms[:, :, 0], terms[:, :, 1] = -(slope * cos).sum(axis=1), -(slope * sin).sum(axis=1)
        turned = slope * (along[:, None] * cos - across[:, None] * sin)
        terms[:, :, 2], terms[:, :, 3], terms[:, :, 4] = turned[:, 0], turned[:, 1], -(slope * off).sum(axis=1)
        step = _solved(terms, left)[:, :_PLACE]
        x += np.clip(step, -_MOST_STEP, _MOST_STEP)
        x[:, 4] = np.clip(x[:, 4], 0.5, half / 1.5)
        if np.abs(step[:, :2]).max() < _STILL_PX:
            break
    return np.asarray(at + x[:, :2], dtype=float)


def _solved(terms: FloatArray, values: FloatArray) -> FloatArray:
    """Least squares of values (k, n) by terms (k, n, m), slightly damped: (k, m)."""
    turned = terms.transpose(0, 2, 1)
    normal = turned @ terms
    diagonal = range(normal.shape[1])
    normal[:, diagonal, diagonal] = 1.001 * normal[:, diagonal, diagonal] + 1e-9
    return np.asarray(np.linalg.solve(normal, turned @ values[:, :, None])[:, :, 0], dtype=float)
