"""Write a rig for other programs, and check a number of it: a point of ours, seen by OpenCV's own function.

python export_for_others.py rig.json FOLDER
"""

import sys
from pathlib import Path

import cv2
import numpy as np

import spherecal


def main(rig_file: str, folder: str) -> float:
    """The largest difference in px between our projection and OpenCV's of what was written."""
    rig = spherecal.load_rig(rig_file)
    for name in ("opencv", "ros", "csv"):
        written = spherecal.export_rig(rig, name, Path(folder) / name)
        print(f"{name}: {len(written.ids)} cameras, read back to {written.largest_difference_px:.2g} px")

    corner = np.array([[0.0, 0.0, 2000.0], [100.0, -50.0, 2100.0]])  # mm, before the reference camera
    ours, largest = spherecal.project_points(rig, corner), 0.0
    for file in sorted((Path(folder) / "opencv").glob("*.yml")):
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
        matrix, distortion = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
        rotation, translation = storage.getNode("R").mat(), storage.getNode("T").mat()
        name = storage.getNode("camera_name").string()
        theirs, _ = cv2.projectPoints(corner, cv2.Rodrigues(rotation)[0], translation, matrix, distortion)
        seen = np.isfinite(ours[name]).all(axis=1)
        if seen.any():
            largest = max(largest, float(np.abs(theirs[seen, 0] - ours[name][seen]).max()))
    print(f"OpenCV sees the same points within {largest:.2g} px.")
    return largest


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(print(__doc__, file=sys.stderr) or 2)
    main(*sys.argv[1:])
