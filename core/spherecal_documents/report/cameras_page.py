"""The table of the cameras, worst first."""

import math

import numpy as np

from spherecal.data.rig import RigCamera
from spherecal.geometry.camera import INTRINSIC_NAMES
from spherecal_documents.report.document import Cell, Column, Document
from spherecal_documents.report.language import label
from spherecal_documents.report.lens_columns import lens_columns, lens_model_words, lens_number
from spherecal_documents.report.sheet import text_width
from spherecal_documents.report.style import BAD, NONE, SMALL_PT, count, number, significant, some_of
from spherecal_rigs.result_folder import Result

# A camera whose residuals are this much above the rig's is worth a look.
_CONSPICUOUS = 1.5
_IN_A_TABLE = 5  # distortion coefficients beside the other numbers


def add_cameras_page(document: Document, result: Result) -> None:
    """Every placed camera with its fit, focal length and place, and their uncertainties."""
    rig, unit = result.rig, result.unit
    document.begin_section(
        label("report-cameras-worst-fit-first") if rig.cameras else label("report-cameras"),
        20.0,
        new_page=bool(rig.cameras),
    )
    missing = [camera for camera in result.camera_ids if rig.camera(camera) is None]
    if missing:
        document.paragraph(label("report-not-placed", names=some_of(missing, 40)), colour=BAD)
    if not rig.cameras:
        document.paragraph(label("report-no-camera-placed"))
        return
    serials = any(camera.serial for camera in rig.cameras)
    columns = [
        Column(label("report-camera"), _name_width(result), "left"),
        *([Column(label("report-serial-number"), 22.0, "left")] if serials else []),
        Column(label("report-obser-vations"), 13.0),
        Column(label("report-rms-px"), 14.0),
        Column(label("report-focal-length-px"), 18.0),
        Column(label("report-sd-px"), 12.0),
        *(Column(f"{label('report-centre-axis', axis=axis)}\n{unit}", 17.0) for axis in "XYZ"),
        Column(label("report-sd-centre", unit=unit), 14.0),
        Column(label("report-sd-rotation-deg"), 14.0),
    ]
    cameras = sorted(rig.cameras, key=lambda camera: (-_badness(camera), camera.id))
    document.caption(label("report-rms-root-mean-square-length", conspicuous=_CONSPICUOUS))
    document.table(columns, [_row(camera, result, serials) for camera in cameras])
    _lenses(document, result)
    _spheres(document, result)


def _lenses(document: Document, result: Result) -> None:
    """Focal lengths, principal points and distortions as far as there are any; in the order of the rig file."""
    cameras = result.rig.cameras
    distorted = lens_columns(cameras)
    document.begin_section(label("report-lenses"), 40.0, new_page=False)
    document.caption(label("report-lens-caption", model=lens_model_words(cameras)))
    head = [
        Column(label("report-camera"), max(24.0, _name_width(result)), "left"),
        *(Column(f"{name}\npx", 15.5) for name in INTRINSIC_NAMES[:4]),
    ]
    sds = [Column(label("report-sd-of-px", name=name), 12.0) for name in INTRINSIC_NAMES[2:4]]
    first, rest = list(distorted)[:_IN_A_TABLE], list(distorted)[_IN_A_TABLE:]
    rows: list[list[Cell]] = []
    groups = _same_lens(cameras)
    for name, c in groups:
        sigmas = (NONE, NONE) if c.sigma is None else (significant(float(s), 2) for s in c.sigma.intrinsics[2:4])
        rows.append([name, *(number(float(x), 2) for x in c.intrinsics[:4]), *sigmas, *_distortion(c, first)])
    document.table([*head, *sds, *(Column(distorted[i], 18.0) for i in first)], rows)
    if rest:
        columns = [
            Column(label("report-camera"), max(24.0, _name_width(result)), "left"),
            *(Column(distorted[i], 18.0) for i in rest),
        ]
        document.table(columns, [[name, *_distortion(c, rest)] for name, c in groups])


def _same_lens(cameras: tuple[RigCamera, ...]) -> list[tuple[str, RigCamera]]:
    """Cameras that share their intrinsics taken together: what to call them, and the first of them."""
    groups: dict[bytes, list[RigCamera]] = {}
    for camera in cameras:
        groups.setdefault(camera.intrinsics.tobytes(), []).append(camera)
    return [
        (
            group[0].id if len(group) == 1 else label("and-more", names=group[0].id, more=len(group) - 1),
            group[0],
        )
        for group in groups.values()
    ]


def _distortion(camera: RigCamera, which: list[int]) -> list[Cell]:
    return [number(lens_number(camera, i), 5) for i in which]


def _spheres(document: Document, result: Result) -> None:
    if not result.spheres:
        return
    document.begin_section(label("report-ball-at-each-placement"), 35.0, new_page=False)
    document.caption(label("report-the-sphere-that-fits-the"))
    unit = result.unit
    columns = [
        Column(label("report-placement"), 30.0, "left"),
        *(Column(f"{label('report-centre-axis', axis=axis)}\n{unit}", 24.0) for axis in "XYZ"),
        Column(label("report-radius", unit=unit), 24.0),
        Column(label("report-out-of-round-sd", unit=unit), 28.0),
    ]
    rows = [
        (s.placement, *(number(float(x), 2) for x in s.centre_mm), number(s.radius_mm, 3), number(s.radial_sd_mm, 3))
        for s in result.spheres
    ]
    document.table(columns, rows)


def _name_width(result: Result) -> float:
    """The width of a column of the cameras' names, within reason."""
    widest = max(text_width(camera.id, SMALL_PT) for camera in result.rig.cameras)
    return min(max(19.0, widest + 6.0), 40.0)


def _badness(camera: RigCamera) -> float:
    return math.inf if camera.rms_px is None else camera.rms_px


def _row(camera: RigCamera, result: Result, serials: bool) -> list[Cell]:
    sigma, overall = camera.sigma, result.rig.quality.rms_px
    rms = number(camera.rms_px, 4)
    conspicuous = camera.rms_px is not None and overall is not None and camera.rms_px > _CONSPICUOUS * overall
    norms = (NONE, NONE, NONE)
    if sigma is not None:
        values = float(sigma.intrinsics[0]), *(float(np.linalg.norm(v)) for v in (sigma.centre_mm, sigma.rotation_deg))
        focal = label("report-fixed") if values[0] == 0 else significant(values[0], 3)
        norms = focal, number(values[1], 3), number(values[2], 4)
    return [
        camera.id + (" *" if camera.id == result.rig.reference_camera else ""),
        *([camera.serial or NONE] if serials else []),
        count(camera.observations),
        (rms, BAD) if conspicuous else rms,
        number(float(camera.intrinsics[0]), 2),
        norms[0],
        *(number(float(x), 2) for x in camera.centre_mm),
        *norms[1:],
    ]
