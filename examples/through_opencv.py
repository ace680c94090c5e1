"""OpenCV with a calibrated camera: python through_opencv.py RESULT CAMERA image.png undistorted.png."""

import sys

import cv2
import numpy as np

import spherecal

camera = spherecal.load_rig(sys.argv[1])[sys.argv[2]]
point = camera.centre_mm + 1000 * camera.rotation[2]  # 1 m along its axis
theirs, _ = cv2.projectPoints(point[None], camera.rvec, camera.tvec, camera.K, camera.dist)
print(f"{camera.id}: OpenCV and SphereCal agree to {np.abs(theirs - camera.project(point)).max():.1e} px")
cv2.imwrite(sys.argv[4], camera.undistort(cv2.imread(sys.argv[3])))
