"""Points in space from where a rig's cameras see them: python load_and_triangulate.py RESULT seen.npz."""

import sys

import numpy as np

import spherecal

result, points = sys.argv[1:] if len(sys.argv) == 3 else sys.exit(print(__doc__, file=sys.stderr) or 2)
seen = dict(np.load(points))  # for each camera an array (points, 2) px, NaN where it does not see a point
measured = spherecal.triangulate_points(spherecal.load_rig(result), seen, sigma_px=0.05)
sigma = np.sqrt(np.trace(measured.covariance_mm2, axis1=-2, axis2=-1))
for (x, y, z), u, views in zip(measured.points_mm, sigma, measured.views, strict=True):
    print(f"{x:.4f} {y:.4f} {z:.4f} mm, standard uncertainty {u:.4f} mm, {views} cameras")
