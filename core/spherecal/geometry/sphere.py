"""Least-squares sphere through points."""

from dataclasses import dataclass

import numpy as np

from spherecal.arrays import FloatArray


@dataclass(frozen=True)
class Sphere:
    """A fitted sphere; `radial_sd` is the standard deviation of the points' distances from its surface."""

    centre: FloatArray
    radius: float
    radial_sd: float


def fit_sphere(points: FloatArray, steps: int = 20) -> Sphere | None:
    """The sphere with the least squared radial distances to points (n, 3); None where they do not define one.

    Algebraic start, then Gauss-Newton on the distances.
    """
    if len(points) < 4:
        return None
    mean = points.mean(axis=0)
    p = points - mean
    design = np.column_stack([2 * p, np.ones(len(p))])
    singular = np.linalg.svd(design / np.linalg.norm(design, axis=0).clip(1e-300), compute_uv=False)
    if singular[-1] < 1e-9 * singular[0]:  # a plane, or fewer: the algebraic system loses rank
        return None
    solution = np.linalg.lstsq(design, (p * p).sum(axis=1), rcond=None)[0]
    centre = solution[:3]
    radius_squared = solution[3] + centre @ centre
    if not radius_squared > 0:
        return None
    radius = float(np.sqrt(radius_squared))
    for _ in range(steps):
        ray = p - centre
        distance = np.linalg.norm(ray, axis=1)
        jacobian = np.column_stack([-ray / distance[:, None], -np.ones(len(p))])
        step = np.linalg.lstsq(jacobian, -(distance - radius), rcond=None)[0]
        centre, radius = centre + step[:3], radius + float(step[3])
        if np.abs(step).max() < 1e-13 * radius:
            break
    misfit = np.linalg.norm(p - centre, axis=1) - radius
    return Sphere(centre + mean, radius, float(np.sqrt((misfit**2).sum() / max(len(p) - 4, 1))))
