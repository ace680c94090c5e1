"""SPO: spherical projection optimisation, [Tao21] Algorithm 2.

Only an initial value: a real ball is off by about a millimetre, and the adjustment must be free to leave the sphere.
"""

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.sphere import fit_sphere_geometrically


def project_to_spheres(points: FloatArray, placement: IntArray) -> FloatArray:
    """Each placement's points (m,3) moved radially onto the sphere fitted to them; NaN points stay NaN.

    `placement`: placement of each, (m,).
    """
    moved = points.copy()
    for p in np.unique(placement):
        own = np.flatnonzero((placement == p) & np.isfinite(points[:, 0]))
        sphere = fit_sphere_geometrically(points[own])
        if sphere is None:
            continue
        ray = points[own] - sphere.centre
        moved[own] = sphere.centre + ray * (sphere.radius / np.linalg.norm(ray, axis=1))[:, None]
    return moved
