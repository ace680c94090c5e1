"""Measure points in space with a calibrated rig, from where the cameras see them; lengths with their uncertainty.

python measure_points.py rig.json seen.csv

seen.csv has the columns point,camera,u,v; all points that two or more cameras see are measured.
"""

import csv
import sys

import numpy as np

import spherecal


def read_image_points(path: str) -> tuple[list[str], dict[str, np.ndarray]]:
    """The points' names, and for each camera an array (n, 2), NaN where it does not see a point."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    names = list(dict.fromkeys(row["point"] for row in rows))
    seen = {row["camera"]: np.full((len(names), 2), np.nan) for row in rows}
    for row in rows:
        seen[row["camera"]][names.index(row["point"])] = float(row["u"]), float(row["v"])
    return names, seen


def main(rig_file: str, seen_file: str) -> None:
    """Print the points and the distance of each to the one before."""
    rig = spherecal.load_rig(rig_file)
    names, seen = read_image_points(seen_file)
    measured = spherecal.triangulate_points(rig, seen, sigma_px=0.05)
    for i, name in enumerate(names):
        x, y, z = measured.points_mm[i]
        sigma = np.sqrt(np.trace(measured.covariance_mm2[i]))
        print(f"{name}: {x:.4f} {y:.4f} {z:.4f} mm, standard uncertainty {sigma:.4f} mm, {measured.views[i]} cameras")
    for i in range(1, len(names)):
        distance = np.linalg.norm(measured.points_mm[i] - measured.points_mm[i - 1])
        print(f"{names[i - 1]} - {names[i]}: {distance:.4f} mm")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(print(__doc__, file=sys.stderr) or 2)
    main(*sys.argv[1:])
