"""OpenCV with a calibrated camera: python through_opencv.py RESULT CAMERA image.png undistorted.png."""

import sys

import cv2

import spherecal

result, name, image, output = sys.argv[1:] if len(sys.argv) == 5 else sys.exit(print(__doc__, file=sys.stderr) or 2)
camera = spherecal.load_rig(result)[name]
point = camera.centre_mm + 1000 * camera.rotation[2]  # 1 m along its axis
theirs, _ = cv2.projectPoints(point[None], camera.rvec, camera.tvec, camera.K, camera.dist)
print(f"{camera.id}: OpenCV and SphereCal agree to {abs(theirs - camera.project(point)).max():.1e} px")
cv2.imwrite(output, camera.undistort(cv2.imread(image)))
