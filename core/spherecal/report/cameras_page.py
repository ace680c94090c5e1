"""The table of the cameras, worst first."""

import math

import numpy as np

from spherecal.report.document import Cell, Column, Document
from spherecal.report.result_folder import Result
from spherecal.report.style import BAD, count, number, significant, some_of
from spherecal.rig import RigCamera

# A camera whose residuals are this much above the rig's is worth a look.
_CONSPICUOUS = 1.5


def add_cameras_page(document: Document, result: Result) -> None:
    """Every placed camera with its fit, focal length and place, and their uncertainties."""
    document.begin_section("Cameras, worst fit first")
    rig, unit = result.rig, result.unit
    missing = [camera for camera in result.camera_ids if rig.camera(camera) is None]
    if missing:
        document.paragraph(f"Not placed: {some_of(missing, 40)}.", colour=BAD)
    if not rig.cameras:
        document.paragraph("No camera could be placed, so there is nothing to tabulate.")
        return
    columns = [
        Column("camera", 19.0, "left"), Column("serial\nnumber", 22.0, "left"), Column("obser-\nvations", 13.0),
        Column("rms\npx", 14.0), Column("focal length\npx", 17.0), Column("sd\npx", 12.0),
        *(Column(f"centre {axis}\n{unit}", 17.0) for axis in "XYZ"),
        Column(f"sd centre\n{unit}", 14.0), Column("sd rotation\ndeg", 13.0),
    ]  # fmt: skip
    cameras = sorted(rig.cameras, key=lambda camera: (-_badness(camera), camera.id))
    document.table(columns, [_row(camera, result) for camera in cameras])
    document.caption(
        "rms: root mean square length of the residuals of the observations used. Focal length: fu of the camera "
        "matrix. Centre: the projection centre in the world frame. sd: standard uncertainty (k = 1); for centre and "
        "rotation the root of the sum of squares over three axes. "
        f"Bold: rms above {_CONSPICUOUS:g} times the rig's. * reference camera: its frame is the world's, its sd are "
        "those of a free network."
    )


def _badness(camera: RigCamera) -> float:
    return math.inf if camera.rms_px is None else camera.rms_px


def _row(camera: RigCamera, result: Result) -> list[Cell]:
    sigma, overall = camera.sigma, result.rig.quality.rms_px
    rms = number(camera.rms_px, 4)
    conspicuous = camera.rms_px is not None and overall is not None and camera.rms_px > _CONSPICUOUS * overall
    norms = ("–", "–", "–")
    if sigma is not None:
        values = float(sigma.intrinsics[0]), *(float(np.linalg.norm(v)) for v in (sigma.centre_mm, sigma.rotation_deg))
        norms = "fixed" if values[0] == 0 else significant(values[0], 3), number(values[1], 3), number(values[2], 4)
    return [
        camera.id + (" *" if camera.id == result.rig.reference_camera else ""),
        camera.serial or "–",
        count(camera.observations),
        (rms, BAD) if conspicuous else rms,
        number(float(camera.intrinsics[0]), 2),
        norms[0],
        *(number(float(x), 2) for x in camera.centre_mm),
        *norms[1:],
    ]
