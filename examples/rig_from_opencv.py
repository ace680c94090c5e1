"""A rig.json from a stereo calibration of OpenCV: python rig_from_opencv.py stereo.yml WIDTH HEIGHT rig.json."""

import sys

import cv2
import numpy as np

import spherecal

stereo, width, height, rig = sys.argv[1:] if len(sys.argv) == 5 else sys.exit(print(__doc__, file=sys.stderr) or 2)
file = cv2.FileStorage(stereo, cv2.FILE_STORAGE_READ)
K1, D1, K2, D2, R, T = (file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T"))
cameras = {"left": (K1, D1, np.eye(3), np.zeros(3)), "right": (K2, D2, R, T)}
spherecal.save_rig(spherecal.Rig.from_opencv(cameras, (int(width), int(height))), rig)
