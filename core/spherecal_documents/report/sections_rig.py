"""The calibration as sections: cameras, lenses, coverage, exclusions, balls, uncertainty, software and hashes."""

import hashlib

import numpy as np

from spherecal.geometry.camera import INTRINSIC_NAMES
from spherecal_documents.report.language import label
from spherecal_documents.report.lens_columns import lens_columns, lens_model_words, lens_number
from spherecal_documents.report.style import NONE, count, number, significant
from spherecal_documents.report.tables import ReportTable, Section, calibrated_with, images_taken
from spherecal_rigs.result_folder import Result

# Cells along an image's longer side: a dot field of a hundred targets fills what it crosses.
_CELLS = 10
_FILES = (
    "rig.json", "findings.json", "covariance.npy", "points.csv", "residuals.csv", "spheres.csv", "bars.csv",
    "verification.json",
)  # fmt: skip


def rig_sections(result: Result) -> tuple[Section, ...]:
    """All sections about the calibration."""
    found = [_cameras(result), _lenses(result), _coverage(result), _excluded(result), _balls(result), _lengths(result)]
    return (*(section for section in found if section is not None), _origin(result))


def _cameras(result: Result) -> Section | None:
    if not result.rig.cameras:
        return None
    unit, rows = result.unit, []
    for c in result.rig.cameras:
        s = c.sigma
        sds = (
            (NONE,) * 4
            if s is None
            else (
                significant(float(s.intrinsics[0])),
                *(
                    significant(float(v))
                    for v in (np.linalg.norm(s.centre_mm), np.linalg.norm(s.rotation_deg), s.intrinsics[2])
                ),
            )
        )
        centre = (number(float(x), 3) for x in c.centre_mm)
        name = f"{c.id} *" if c.id == result.rig.reference_camera else c.id
        rows.append(
            (
                name,
                c.serial or NONE,
                count(c.observations),
                number(c.rms_px, 4),
                number(float(c.intrinsics[0]), 2),
                *centre,
                *sds,
            )
        )
    columns = (
        label("report-camera"),
        label("report-serial"),
        label("report-observations"),
        label("report-rms-px"),
        label("report-focal-length-px"),
        label("report-centre-x", unit=unit),
        label("report-centre-y", unit=unit),
        label("report-centre-z", unit=unit),
        label("report-sd-focal-px"),
        label("report-sd-centre-wide", unit=unit),
        label("report-sd-rotation-wide"),
        label("report-sd-of-px", name="u0"),
    )
    text = label("report-sd-standard-uncertainty-k-1")
    return Section(
        "cameras", label("report-cameras"), (text,), (ReportTable("", columns, (15.0,) * len(columns), tuple(rows), 2),)
    )


def _lenses(result: Result) -> Section | None:
    cameras = result.rig.cameras
    if not cameras:
        return None
    which = dict(enumerate(INTRINSIC_NAMES[:4])) | lens_columns(cameras)
    rows = tuple((c.id, *(number(lens_number(c, i), 3 if i < 4 else 6) for i in which)) for c in cameras)
    columns = (label("report-camera"), *which.values())
    text = label("report-lens-note", model=lens_model_words(cameras))
    return Section("lenses", label("report-lenses"), (text,), (ReportTable("", columns, (15.0,) * len(columns), rows),))


def image_cells(result: Result, name: str) -> np.ndarray | None:
    """How many used observations each cell of a camera's image holds (rows, columns); None where it has none."""
    camera = result.rig.camera(name)
    own = result.residuals.rows_of.get(name)
    if camera is None or own is None:
        return None
    own = own[result.residuals.used[own] & np.isfinite(result.residuals.predicted[own, 0])]
    width, height = camera.image_size
    size = max(width, height) / _CELLS
    edges = [np.linspace(-0.5, side - 0.5, max(round(side / size), 1) + 1) for side in (height, width)]
    uv = result.residuals.predicted[own]
    return np.histogram2d(uv[:, 1], uv[:, 0], bins=edges)[0]


def _coverage(result: Result) -> Section | None:
    rows = []
    for camera in result.rig.cameras:
        cells = image_cells(result, camera.id)
        if cells is None:
            continue
        corners = sum(cells[r, c] > 0 for r in (0, -1) for c in (0, -1))
        own = result.residuals.rows_of[camera.id]
        used = own[result.residuals.used[own]]
        by_placement = len({result.residuals.placement[i] for i in used.tolist()})
        rows.append(
            (
                camera.id,
                count(len(used)),
                str(by_placement),
                f"{100 * (cells > 0).mean():.0f} %",
                label("report-of-4-corners", corners=corners),
            )
        )
    if not rows:
        return None
    columns = (
        label("report-camera"),
        label("report-observations"),
        label("report-placements"),
        label("report-image-covered"),
        label("report-corners-reached"),
    )
    text = label("report-image-covered-cells-that-hold", cells=_CELLS)
    return Section(
        "coverage",
        label("report-coverage"),
        (text,),
        (ReportTable("", columns, (30.0, 24.0, 24.0, 26.0, 26.0), tuple(rows)),),
    )


def _excluded(result: Result) -> Section:
    residuals = result.residuals
    rows = []
    for camera in result.camera_ids:
        own = residuals.rows_of.get(camera, np.empty(0, dtype=np.int64))
        left = own[~residuals.used[own]]
        if len(left):
            size = np.linalg.norm(residuals.du_dv[left], axis=1)
            largest = float(np.nanmax(size)) if np.isfinite(size).any() else None
            rows.append((camera, count(len(left)), f"{100 * len(left) / len(own):.1f} %", number(largest, 1)))
    texts = [
        label(
            "report-of-observations-were-left-out",
            left_out=count(int((~residuals.used).sum())),
            all=count(len(residuals.used)),
        )
    ]
    texts += [label("report-asked-for", option=repair.option, value=repair.value) for repair in result.rig.repairs]
    missing = [camera for camera in result.camera_ids if result.rig.camera(camera) is None]
    texts += [label("report-cameras-not-placed", names=", ".join(missing))] if missing else []
    columns = (
        label("report-camera"),
        label("report-observations-left-out"),
        label("report-of-its-own"),
        label("report-largest-residual-px"),
    )
    tables = (ReportTable("", columns, (30.0, 34.0, 24.0, 28.0), tuple(rows)),) if rows else ()
    return Section("exclusions", label("report-what-was-left-out"), tuple(texts), tables)


def _balls(result: Result) -> Section | None:
    if not result.spheres:
        return None
    unit = result.unit
    rows = tuple(
        (s.placement, *(number(float(x), 2) for x in s.centre_mm), number(s.radius_mm, 3), number(s.radial_sd_mm, 3))
        for s in result.spheres
    )
    columns = (
        label("report-placement"),
        label("report-centre-x", unit=unit),
        label("report-centre-y", unit=unit),
        label("report-centre-z", unit=unit),
        label("report-radius", unit=unit),
        label("report-out-of-round-sd", unit=unit),
    )
    text = label("report-the-sphere-that-fits-each")
    return Section(
        "balls", label("report-ball-at-each-placement"), (text,), (ReportTable("", columns, (24.0,) * 6, rows),)
    )


def _lengths(result: Result) -> Section | None:
    found = result.rig.length_map
    if found is None or found.typical_mm is None or found.worst is None:
        return None
    finite = found.expanded_mm[np.isfinite(found.expanded_mm)]
    rows = []
    for name, row in zip(
        ("X", "Y", "Z", *(label("report-diagonal", number=i) for i in (1, 2, 3, 4))), found.expanded_mm.T, strict=False
    ):
        own = row[np.isfinite(row)]
        if len(own):
            rows.append(
                (
                    name,
                    number(float(np.median(own)), 4),
                    number(float(own.max()), 4),
                    f"{100 * len(own) / len(row):.0f} %",
                )
            )
    text = label(
        "report-expanded-uncertainty-k-of-a",
        coverage_factor=found.coverage_factor,
        length_mm=found.length_mm,
        sigma_px=found.sigma_px,
        places_mm=len(found.places_mm),
        finite=number(float(np.median(finite)), 4),
        worst=number(found.worst[0], 4),
    )
    columns = (label("report-direction"), label("report-median-mm"), label("report-worst-mm"), label("report-seen-at"))
    return Section(
        "uncertainty",
        label("report-uncertainty-in-the-volume"),
        (text,),
        (ReportTable("", columns, (30.0, 24.0, 24.0, 20.0), tuple(rows)),),
    )


def _origin(result: Result) -> Section:
    rows = [
        (label("report-calibrated-with"), calibrated_with(result)),
        (label("report-images-taken"), images_taken(result)),
        (label("report-input-sha-256"), result.rig.input_sha256 or label("report-not-given")),
    ]
    for name in _FILES:
        path = result.folder / name
        if path.is_file():
            with path.open("rb") as file:
                rows.append((name, hashlib.file_digest(file, "sha256").hexdigest()))
    table = ReportTable("", ("", label("report-sha-256-of-the-file")), (34.0, 140.0), tuple(rows), 2)
    return Section("origin", label("report-software-and-hashes"), (), (table,))
