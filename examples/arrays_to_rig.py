"""A rig from the image points of your own detector: python arrays_to_rig.py points.npz RESULT."""

import sys

import numpy as np

import spherecal

points, result = sys.argv[1:] if len(sys.argv) == 3 else sys.exit(print(__doc__, file=sys.stderr) or 2)
data = dict(np.load(points))  # K (3, 3), image_size (2,), for each camera (placements, points, 2) px, NaN: not seen
K, image_size = data.pop("K"), data.pop("image_size")
calibration = spherecal.calibrate_points(data, dict.fromkeys(data, K), image_size)
spherecal.save_calibration(calibration, result)
print(calibration.rig)
