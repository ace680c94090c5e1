"""A rig.json from a stereo calibration of OpenCV: python rig_from_opencv.py stereo.yml WIDTH HEIGHT rig.json."""

import sys

import cv2
import numpy as np

import spherecal

file = cv2.FileStorage(sys.argv[1], cv2.FILE_STORAGE_READ)
K1, D1, K2, D2, R, T = (file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T"))
cameras = {"left": (K1, D1, np.eye(3), np.zeros(3)), "right": (K2, D2, R, T)}
spherecal.save_rig(spherecal.Rig.from_opencv(cameras, (int(sys.argv[2]), int(sys.argv[3]))), sys.argv[4])
