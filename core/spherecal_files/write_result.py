"""The result folder of a calibration: rig.json, findings.json, covariance.npy, points.csv, residuals.csv, ..."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.errors import InputError, OutputError
from spherecal.base.file_reading import read_file
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.rig import BallProfile, Calibration, ImageMotion, PlacedSphere
from spherecal_files.atomic import RESULT, check_folder, write_folder_whole
from spherecal_files.ball_file import BALL, BALL_FILE
from spherecal_files.filesystem import create, new_file, read_below
from spherecal_files.findings_file import FINDINGS_FILE, findings_document, read_findings
from spherecal_files.json_file import json_bytes
from spherecal_files.rig_file import COVARIANCE_FILE, covariance_bytes, rig_bytes
from spherecal_files.table_file import write_observations
from spherecal_files.verification_file import VERIFICATION
from spherecal_verify.verification import MeasuredLength, Verification


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


BAR_COLUMNS = "bar,pose,from,to,length_mm,reference_mm,error_mm,u_mm,views"
_OURS = ("bars.csv", "verification.json", FINDINGS_FILE)
_MOST_BYTES = 1 << 30


def write_verification(verification: Verification, folder: Path, rig_path: Path) -> None:
    """Write a result folder whole: rig's file, verification, findings of both; this very rig's other files stay."""
    older = check_folder(folder, RESULT)
    rig = _read(rig_path)
    findings = (*_findings_beside(rig_path), *verification.findings)
    same_rig = (older / RESULT.file).is_file() and _read(older / RESULT.file) == rig

    def build(new: Path) -> None:
        for name in sorted(RESULT.names - {*_OURS, RESULT.file}) if same_rig else ():
            if (older / name).exists():
                create(new / name, read_below(older, name, _MOST_BYTES))
        create(new / RESULT.file, rig)
        write_table(new / "bars.csv", BAR_COLUMNS, map(_bar_row, verification.measured))
        create(new / "verification.json", VERIFICATION.bytes(verification))
        if (values := findings_document(findings)) is not None:
            create(new / FINDINGS_FILE, json_bytes(values))

    write_folder_whole(folder, build, RESULT)


def _read(path: Path) -> bytes:
    try:
        return read_file(path, _MOST_BYTES)
    except InputError as error:
        raise OutputError(Phrase("error-not-copied", {"file": path, "why": error.parts[0]})) from error


def _findings_beside(rig_path: Path) -> tuple[Finding, ...]:
    try:
        return read_findings(rig_path.parent)
    except InputError as error:
        raise OutputError(Phrase("error-not-copied", {"file": rig_path.parent, "why": error.parts[0]})) from error


def _bar_row(m: MeasuredLength) -> tuple[object, ...]:
    names = (m.bar, m.pose, m.from_mark, m.to_mark)
    lengths = map(place_cell, (m.length_mm, m.reference_mm))
    return (*names, *lengths, small_cell(m.error_mm), small_cell(m.budget.combined_mm), m.views)
