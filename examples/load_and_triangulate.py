"""Points in space from where a rig's cameras see them: python load_and_triangulate.py RESULT seen.npz."""

import sys

import numpy as np

import spherecal

rig = spherecal.load_rig(sys.argv[1])
seen = dict(np.load(sys.argv[2]))  # for each camera an array (points, 2) px, NaN where it does not see a point
measured = spherecal.triangulate_points(rig, seen, sigma_px=0.05)
sigma = np.sqrt(np.trace(measured.covariance_mm2, axis1=-2, axis2=-1))
for (x, y, z), u, views in zip(measured.points_mm, sigma, measured.views, strict=True):
    print(f"{x:.4f} {y:.4f} {z:.4f} mm, standard uncertainty {u:.4f} mm, {views} cameras")
