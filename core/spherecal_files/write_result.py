"""The result folder of a calibration: rig.json, findings.json, covariance.npy, points.csv, residuals.csv, ..."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.data.rig import BallProfile, Calibration, ImageMotion, PlacedSphere
from spherecal_files.atomic import RESULT, write_folder_whole
from spherecal_files.ball_file import BALL, BALL_FILE
from spherecal_files.filesystem import create, new_file
from spherecal_files.findings_file import FINDINGS_FILE, findings_document
from spherecal_files.json_file import json_bytes
from spherecal_files.rig_file import COVARIANCE_FILE, covariance_bytes, rig_bytes
from spherecal_files.table_file import write_observations


def write_result(calibration: Calibration, folder: Path, software: Mapping[str, Any] | None = None) -> None:
    """Write a calibration's result folder whole (see atomic.write_folder_whole)."""
    details = {"method": calibration.method, **(software or {})}

    def build(new: Path) -> None:
        create(new / RESULT.file, rig_bytes(calibration.rig, details))
        if (values := findings_document(calibration.rig.quality.findings)) is not None:
            create(new / FINDINGS_FILE, json_bytes(values))
        if calibration.rig.covariance is not None:
            create(new / COVARIANCE_FILE, covariance_bytes(calibration.rig.covariance))
        if calibration.ball is not None:
            stored = BallProfile(calibration.ball, input_sha256=calibration.rig.input_sha256)
            create(new / BALL_FILE, BALL.bytes(stored))
        write_table(new / "points.csv", POINT_COLUMNS, _point_rows(calibration))
        write_table(new / "residuals.csv", RESIDUAL_COLUMNS, _residual_rows(calibration))
        write_table(new / "spheres.csv", SPHERE_COLUMNS, map(_sphere_row, calibration.spheres))
        if calibration.motions:
            write_table(new / MOTIONS_FILE, MOTION_COLUMNS, map(_motion_row, calibration.motions))
        write_observations(new / "observations.csv", calibration.observations)

    write_folder_whole(folder, build, RESULT)


POINT_COLUMNS = "placement,target,point,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm,views"
RESIDUAL_COLUMNS = "placement,camera,target,point,du,dv,used"
MOTIONS_FILE = "image_motions.csv"
MOTION_COLUMNS = "placement,camera,rx_deg,ry_deg,rz_deg,tx_mm,ty_mm,tz_mm"
SPHERE_COLUMNS = "placement,x_mm,y_mm,z_mm,radius_mm,radial_sd_mm"


def write_table(path: Path, columns: str, rows: Iterable[tuple[object, ...]]) -> None:
    """Write a new CSV table; names never hold commas or quotation marks (json_file.name_problem)."""
    lines = (",".join(map(str, row)) + "\n" for row in rows)
    with new_file(path.parent, path.name) as file:
        file.write(f"{columns}\n".encode())
        file.writelines(line.encode() for line in lines)


def place_cell(value: float | None) -> str:
    """A coordinate or length: 12 digits, a nanometre in a kilometre; empty where there is none."""
    return "" if value is None or not math.isfinite(value) else f"{value:.12g}"


def small_cell(value: float | None) -> str:
    """An uncertainty or residual: 7 digits; empty where there is none."""
    return "" if value is None or not math.isfinite(value) else f"{value:.7g}"


def _point_rows(calibration: Calibration) -> Iterable[tuple[object, ...]]:
    """One row for every point that was found, by placement, target and point."""
    features, names = calibration.features, calibration.observations
    for i in np.flatnonzero(np.isfinite(calibration.points_mm).all(axis=1)):
        yield (
            names.placements[features.placement[i]],
            features.target[i],
            names.points[features.point[i]],
            *map(place_cell, calibration.points_mm[i]),
            *map(small_cell, calibration.points_sigma_mm[i]),
            int(calibration.views[i]),
        )


def _residual_rows(calibration: Calibration) -> Iterable[tuple[object, ...]]:
    """One row for every observation, in order; du, dv stay empty where there is no prediction."""
    o = calibration.observations
    return zip(
        (o.placements[i] for i in o.placement.tolist()),
        (o.cameras[i] for i in o.camera.tolist()),
        o.target.tolist(),
        (o.points[i] for i in o.point.tolist()),
        *(map(small_cell, column.tolist()) for column in calibration.residuals_px.T),
        map(int, calibration.used.tolist()),
        strict=True,
    )


def _motion_row(motion: ImageMotion) -> tuple[object, ...]:
    values = (*motion.rotation_deg, *motion.translation_mm)
    return (motion.placement, motion.camera, *map(small_cell, values))


def _sphere_row(sphere: PlacedSphere) -> tuple[object, ...]:
    lengths = (*sphere.centre_mm, sphere.radius_mm)
    return (sphere.placement, *map(place_cell, lengths), small_cell(sphere.radial_sd_mm))
