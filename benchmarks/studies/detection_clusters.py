"""Images of dots that are no targets: random clusters as dense as stickers, mirrored targets, damaged targets."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.targets.family import LATTICE_MM
from spherecal.targets.target_set import TargetSet

Kind = Literal["anywhere", "lattice", "mirrored", "damaged"]

SIZE = (840, 700)  # px; 6 x 5 cells with one cluster each
_CELL_PX = 140
CLUSTERS = (SIZE[0] // _CELL_PX) * (SIZE[1] // _CELL_PX)
_DOTS = (8, 16)  # a cluster
_HALF_MM = 11.0
_APART_MM = 4.0  # dots of 3 mm
_DOT_RADIUS_MM = 1.5
_PX_PER_MM = (2.2, 3.4)
_SMALLEST_COSINE = 0.4
_LOST, _SPURIOUS = 0.08, 0.08  # parts of the dots of damaged targets
_BLUR_PX = 0.7


@dataclass(frozen=True)
class DotsImage:
    """An image, and where targets are: ids (n,) and their middles (n, 2) px; none among random clusters."""

    image: NDArray[np.uint8]
    ids: IntArray
    middles: FloatArray


def dots_image(kind: Kind, targets: TargetSet, rng: np.random.Generator) -> DotsImage:
    """An image with a cluster of dots of stickers' size in each cell, each under an affine view of its own.

    `anywhere`: 8 to 16 dots at random, not touching; `lattice`: the same on the code's lattice of 2.5 mm; `mirrored`:
    targets seen in a mirror; `damaged`: targets of whose dots 8 % are lost, and as many put anywhere.
    """
    light = rng.uniform(15, 60)
    canvas = np.full(SIZE[::-1], light)
    ids, middles = [], []
    for v in range(0, SIZE[1], _CELL_PX):
        for u in range(0, SIZE[0], _CELL_PX):
            view, middle = _affine(rng), np.array([u, v]) + _CELL_PX / 2 + rng.uniform(-8, 8, 2)
            places, target = _places(kind, targets, rng)
            contrast = rng.uniform(60, 180)
            _draw(canvas, places @ view.T + middle, view * _DOT_RADIUS_MM, contrast, _BLUR_PX)
            if target:
                ids.append(target)
                middles.append(middle)
    noisy = canvas + rng.normal(0.0, 1.0, canvas.shape) * np.sqrt(0.5 + canvas / 40.0)
    image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return DotsImage(image, np.array(ids, dtype=int), np.array(middles).reshape(-1, 2))


def _affine(rng: np.random.Generator) -> FloatArray:
    """From mm on a sticker to px: any turns, tilted to 66 degrees."""
    first, second = rng.uniform(0, 2 * np.pi, 2)
    squeeze = np.diag([1.0, rng.uniform(_SMALLEST_COSINE, 1.0)])
    return rng.uniform(*_PX_PER_MM) * _turn(first) @ squeeze @ _turn(second)


def _turn(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _places(kind: Kind, targets: TargetSet, rng: np.random.Generator) -> tuple[FloatArray, int]:
    """Dots (n, 2) in mm, and the target that they are (0: none)."""
    if kind in ("anywhere", "lattice"):
        return _random_places(kind == "lattice", int(rng.integers(_DOTS[0], _DOTS[1] + 1)), rng), 0
    target = int(rng.choice(list(targets.layouts)))
    places = np.array(list(targets.layouts[target].values()), dtype=float)
    if kind == "mirrored":
        return places * [-1.0, 1.0], 0
    keep = rng.uniform(size=len(places)) >= _LOST
    spurious = _random_places(False, int(rng.binomial(len(places), _SPURIOUS)), rng)
    free = [p for p in spurious if np.linalg.norm(places - p, axis=1).min() > _APART_MM]
    return np.vstack([places[keep], *free]), target


def _random_places(on_lattice: bool, count: int, rng: np.random.Generator) -> FloatArray:
    """Up to `count` dots on a sticker, none touching another."""
    tries = rng.uniform(-_HALF_MM, _HALF_MM, (20 * count, 2))
    if on_lattice:
        tries = np.clip(np.rint(tries / LATTICE_MM), -4, 4) * LATTICE_MM
    return _thrown(tries, count)


@njit(nogil=True, cache=True)
def _thrown(tries, count):
    """The first `count` of the places that keep their distance from those before."""
    kept = np.empty((count, 2))
    n = 0
    for i in range(len(tries)):
        free = n < count
        for k in range(n):
            free = free and np.hypot(tries[i, 0] - kept[k, 0], tries[i, 1] - kept[k, 1]) >= _APART_MM
        if free:
            kept[n] = tries[i]
            n += 1
    return kept[:n]


@njit(nogil=True, cache=True)
def _draw(canvas, centres, ellipse, contrast, blur):
    """Add ellipses with the axes `ellipse` (2, 2) of a unit circle at centres (n, 2) px, their rims blurred."""
    det = ellipse[0, 0] * ellipse[1, 1] - ellipse[0, 1] * ellipse[1, 0]
    a, b = ellipse[1, 1] / det, -ellipse[0, 1] / det
    c, d = -ellipse[1, 0] / det, ellipse[0, 0] / det
    reach = int(np.sqrt((ellipse**2).sum()) + 4 * blur) + 1
    for k in range(len(centres)):
        u, v = centres[k]
        for i in range(max(int(v) - reach, 0), min(int(v) + reach + 1, canvas.shape[0])):
            for j in range(max(int(u) - reach, 0), min(int(u) + reach + 1, canvas.shape[1])):
                x, y = a * (j - u) + b * (i - v), c * (j - u) + d * (i - v)
                rho = np.sqrt(x * x + y * y)
                slope = np.hypot(a * x + c * y, b * x + d * y) / max(rho, 1e-9)
                # distance to the rim in px over the blur: a step seen through a Gaussian
                s = (1.0 - rho) / max(slope * blur, 1e-9)
                canvas[i, j] += contrast / (1.0 + np.exp(-1.702 * s))
