"""The imperfect ball, mm about its nominal centre: a sphere with bumps, stickers bent onto it by arc length."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.targets.target_set import TargetSet


@dataclass(frozen=True)
class Bumps:
    """Smooth departures b(n) = sum of polynomials (k, 6), mm, in n . axes[k], (k, 3) unit: zonal harmonics."""

    axes: FloatArray
    coefficients: FloatArray

    def height(self, n: FloatArray) -> FloatArray:
        """Height over the sphere in mm at unit directions (..., 3)."""
        t = n @ self.axes.T
        value = np.zeros_like(t)
        for c in self.coefficients.T[::-1]:
            value = value * t + c
        return value.sum(axis=-1)

    def slope(self, n: FloatArray) -> FloatArray:
        """Gradient of the height along the unit sphere, mm per radian, (..., 3), perpendicular to n (..., 3)."""
        t = n @ self.axes.T
        value = np.zeros_like(t)
        for power in range(self.coefficients.shape[1] - 1, 0, -1):
            value = value * t + power * self.coefficients[:, power]
        gradient = value @ self.axes
        return gradient - (gradient * n).sum(axis=-1, keepdims=True) * n


# Ascending coefficients of the Legendre polynomials of degree 2 to 5: ovality, pear shape and two finer waves.
# Degree 1 would be a shift of the ball.
_LEGENDRE = np.array(
    [
        [-1 / 2, 0, 3 / 2, 0, 0, 0],
        [0, -3 / 2, 0, 5 / 2, 0, 0],
        [3 / 8, 0, -30 / 8, 0, 35 / 8, 0],
        [0, 15 / 8, 0, -70 / 8, 0, 63 / 8],
    ]
)
_LOBES = 12


def random_bumps(amplitude_mm: float, rng: np.random.Generator) -> Bumps:
    """Bumps whose largest height or depth is `amplitude_mm`."""
    axes = rng.normal(size=(_LOBES, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    bumps = Bumps(axes, _LEGENDRE[np.arange(_LOBES) % 4] * rng.normal(size=(_LOBES, 1)))
    largest = np.abs(bumps.height(_even_directions(500))).max()
    return Bumps(axes, bumps.coefficients * (amplitude_mm / largest))


@dataclass(frozen=True)
class Ball:
    """A ball with its stickers.

    Sticker s: target id `targets[s]`, axes `frames[s]` (3, 3) with rows x right, y down, z into the ball, so that its
    centre is in direction `-frames[s, 2]`. Dot i: target id `dot_target[i]`, name `points[dot_point[i]]`, place
    `dots_mm[i]` and outward normal `normals[i]`. Dots are sorted by target, then point. `layouts_mm` (targets, dots, 2)
    are the stickers as printed.
    """

    radius_mm: float
    bumps: Bumps
    points: tuple[str, ...]
    targets: IntArray
    frames: FloatArray
    layouts_mm: FloatArray
    dot_target: IntArray
    dot_point: IntArray
    dots_mm: FloatArray
    normals: FloatArray

    def radius_at(self, n: FloatArray) -> FloatArray:
        """Distance of the surface from the ball's centre in unit directions (..., 3), mm."""
        return self.radius_mm + self.bumps.height(n)


def make_ball(
    target_set: TargetSet,
    targets: tuple[int, ...],
    rng: np.random.Generator,
    radius_mm: float = 250.0,
    bump_mm: float = 1.0,
    print_sd_mm: float = 0.0,
) -> Ball:
    """A ball with the given targets of a set, spread evenly and turned at random in their planes."""
    points = tuple(sorted(target_set.layouts[targets[0]]))
    layouts = np.array([[target_set.layouts[t][p] for p in points] for t in targets], dtype=float)
    if print_sd_mm:
        layouts = layouts + rng.normal(0.0, print_sd_mm, layouts.shape)
    bumps = random_bumps(bump_mm, rng)
    # centres on a jittered Fibonacci lattice, in-plane rotation at random
    count = len(targets)
    n = _even_directions(count) + rng.normal(0.0, _JITTER_MM / radius_mm, (count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    seed = rng.normal(size=(count, 3))
    x = np.cross(seed, n)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    frames = np.stack([x, np.cross(-n, x), -n], axis=1)
    directions, dots = wrap(radius_mm, bumps, np.repeat(frames, len(points), axis=0), layouts.reshape(-1, 2))
    normal = directions - bumps.slope(directions) / (radius_mm + bumps.height(directions))[:, None]
    return Ball(
        radius_mm, bumps, points, np.array(targets), frames, layouts,
        dot_target=np.repeat(np.array(targets), len(points)), dot_point=np.tile(np.arange(len(points)), len(targets)),
        dots_mm=dots, normals=normal / np.linalg.norm(normal, axis=1, keepdims=True),
    )  # fmt: skip


_JITTER_MM = 3.0  # stickers are put on by hand; 200 of 28 mm are 60 mm apart on a 500 mm ball


def _even_directions(count: int) -> FloatArray:
    """Unit vectors spread evenly over the sphere (Fibonacci lattice), (count, 3)."""
    i = np.arange(count)
    z = 1 - (2 * i + 1) / count
    azimuth = i * np.pi * (3.0 - np.sqrt(5.0))
    rim = np.sqrt(1 - z * z)
    return np.column_stack([rim * np.cos(azimuth), rim * np.sin(azimuth), z])


# Two Gauss-Legendre nodes on [0, 1], weights 1/2: exact to 1e-6 mm over a sticker's 20 mm on bumps of degree 5
_NODES = 0.5 + 0.5 * np.array([-1.0, 1.0]) / np.sqrt(3.0)


def wrap(radius_mm: float, bumps: Bumps, frames: FloatArray, flat_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions (n, 3) and places (n, 3) mm of flat places (n, 2) on stickers (n, 3, 3) bent onto the ball by arc."""
    length = np.hypot(flat_mm[:, 0], flat_mm[:, 1])
    along = flat_mm / np.where(length > 0, length, 1.0)[:, None]
    tangent = along[:, :1] * frames[:, 0] + along[:, 1:] * frames[:, 1]
    angle = length / radius_mm
    for _ in range(3):  # Newton from an error of 1 mm in 250 mm: 1e-3, 1e-6, 1e-12 relative
        rates = [_arc_rate(radius_mm, bumps, frames, tangent, node * angle) for node in _NODES]
        arc = angle * np.mean(rates, axis=0)
        angle = angle - (arc - length) / _arc_rate(radius_mm, bumps, frames, tangent, angle)
    n = _section(frames, tangent, angle)[0]
    return n, (radius_mm + bumps.height(n))[:, None] * n


def _section(frames: FloatArray, tangent: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit direction and its derivative by the angle, at `angle` (n,) from the sticker's centre along `tangent`."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return -c * frames[:, 2] + s * tangent, s * frames[:, 2] + c * tangent


def _arc_rate(radius_mm: float, bumps: Bumps, frames: FloatArray, tangent: FloatArray, angle: FloatArray) -> FloatArray:
    """Arc length per radian on the normal section, sqrt(r^2 + r'^2) in mm, (n,)."""
    n, dn = _section(frames, tangent, angle)
    r = radius_mm + bumps.height(n)
    return np.hypot(r, (bumps.slope(n) * dn).sum(axis=1))
