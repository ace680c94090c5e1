"""Least-squares spheres through points."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from spherecal.base.arrays import FloatArray

# Where points scatter by more than their cap is deep, the nearest sphere may be a plane, of radius without end (chained
# points of rig A, nominal intrinsics, 100 targets). A ball's caps have radii of 1 to 2 times their extent.
MOST_RADII = 10.0


@dataclass(frozen=True)
class Sphere:
    """A fitted sphere; `radial_sd` is the standard deviation of the points' distances from its surface."""

    centre: FloatArray
    radius: float
    radial_sd: float


def fit_sphere(points: FloatArray) -> Sphere | None:
    """The sphere through points (n, 3) by linear least squares; None where they do not define one.

    Minimises the sum of (distance^2 - radius^2)^2 (I. D. Coope, Circle fitting by linear and nonlinear least squares,
    JOTA 76, 1993). On a ball 0.4 % out of round it agrees with the geometric fit to 1e-5; it has one solution and needs
    no start (docs/decisions/0005-sphere-by-linear-least-squares.md).
    """
    if len(points) < 4:
        return None
    mean = points.mean(axis=0)
    p = points - mean
    design = np.column_stack([2 * p, np.ones(len(p))])
    size = np.linalg.norm(design, axis=0)
    singular = np.linalg.svd(design / np.maximum(size, 1e-300), compute_uv=False)
    if singular[-1] < 1e-9 * singular[0]:  # a plane, or fewer dimensions
        return None
    solution = np.linalg.lstsq(design / size, (p * p).sum(axis=1), rcond=None)[0] / size
    centre = solution[:3]
    radius_squared = solution[3] + centre @ centre
    if not radius_squared > 0:
        return None
    radius = float(np.sqrt(radius_squared))
    misfit = np.linalg.norm(p - centre, axis=1) - radius
    return Sphere(centre + mean, radius, float(np.sqrt((misfit**2).sum() / max(len(p) - 4, 1))))


def fit_sphere_geometrically(points: FloatArray) -> Sphere | None:
    """The sphere (n, 3) with the least sum of squared distances, from the linear one; None where that is a plane.

    Where points cover a cap and scatter, the linear fit is small: on caps of 60 degrees with 25 % noise its centre is
    0.3 radii off, this one's 0.04 (docs/decisions/0005-sphere-by-linear-least-squares.md).
    """
    start = fit_sphere(points)
    if start is None:
        return None

    def distances(x: FloatArray) -> FloatArray:
        return np.linalg.norm(points - x[:3], axis=1) - x[3]

    def derivatives(x: FloatArray) -> FloatArray:
        ray = points - x[:3]
        return np.column_stack([-ray / np.linalg.norm(ray, axis=1)[:, None], -np.ones(len(ray))])

    exact = {"ftol": 1e-14, "xtol": 1e-14, "gtol": 1e-14}
    fit = least_squares(distances, [*start.centre, start.radius], derivatives, method="lm", **exact)  # type: ignore[arg-type]
    centre, radius = fit.x[:3], float(fit.x[3])
    extent = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    if not 0 < radius <= MOST_RADII * extent:
        return None
    return Sphere(centre, radius, float(np.sqrt((fit.fun**2).sum() / max(len(points) - 4, 1))))
