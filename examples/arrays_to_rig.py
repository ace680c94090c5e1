"""A rig from the image points of your own detector: python arrays_to_rig.py points.npz RESULT."""

import sys

import numpy as np

import spherecal

# K (3, 3), image_size (2,), and for each camera an array (placements, points, 2) px, NaN where it does not see a point
data = dict(np.load(sys.argv[1]))
K, image_size = data.pop("K"), data.pop("image_size")
calibration = spherecal.calibrate_points(data, dict.fromkeys(data, K), image_size)
spherecal.save_calibration(calibration, sys.argv[2])
print(calibration.rig)
