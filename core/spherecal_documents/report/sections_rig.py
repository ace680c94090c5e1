"""The calibration as sections: cameras, lenses, balls, rig, residuals, coverage, uncertainty, exclusions, files."""

import hashlib
import math
from collections.abc import Sequence
from datetime import UTC

import numpy as np

from spherecal.data.rig import RigCamera
from spherecal.geometry.camera import FISHEYE_NAMES, INTRINSIC_NAMES, is_fisheye
from spherecal_documents.report.language import columns, label, word
from spherecal_documents.report.model import Cell, KeyValues, Paragraph, Section, Strong, Table
from spherecal_documents.report.residual_drawings import length_map_figure, residual_blocks
from spherecal_documents.report.rig_drawing import ScenePicture, rig_blocks
from spherecal_documents.report.style import BAD, NONE, count, number, significant, some_of
from spherecal_rigs.result_folder import RESULT_FILES, Result

_CELLS = 10  # along an image's longer side: a dot field of a hundred targets fills what it crosses
_CONSPICUOUS = 1.5  # a camera whose residuals are this much above the rig's is worth a look
_IN_A_TABLE = 5  # distortion coefficients beside the other numbers
_DETAILS = {"method": "report-method", "seed": "report-seed"}


def source_section(result: Result) -> Section:
    """Where the result comes from, in short."""
    reference = result.rig.reference_camera
    rows = (
        (label("report-head-calibrated-with"), _calibrated_with(result)),
        (label("report-head-images-taken"), _images_taken(result)),
        (label("report-head-input"), result.rig.input_sha256 or label("report-not-given")),
        (
            label("report-world-frame"),
            label("report-frame-of-camera-x-right", reference_camera=reference)
            if reference
            else label("report-none-no-camera-is-placed"),
        ),
        (label("report-uncertainties"), label("report-standard-uncertainties-k-1-unless")),
    )
    return Section("source", label("report-where-this-result-comes-from"), (KeyValues(rows),))


def rig_sections(result: Result, picture: ScenePicture | None = None) -> tuple[Section, ...]:
    """All sections about the calibration; `picture`: the rig in space in place of its oblique view."""
    if not result.rig.cameras:
        return _cameras(result), _excluded(result), *_balls(result)
    title = label("report-rig-and-placements")
    rig = Section("rig", title, rig_blocks(result, picture), new_page=True)
    residuals = Section("residuals", label("report-residuals"), residual_blocks(result), new_page=True)
    parts = (_lenses(result), *_balls(result), rig, residuals, *_coverage(result), *_lengths(result))
    return (_cameras(result), *parts, _excluded(result))


def _images_taken(result: Result) -> str:
    at = result.rig.recorded_at
    return label("report-not-noted-with-the-recording") if at is None else f"{at.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def _calibrated_with(result: Result) -> str:
    """The program that made the result, its version, and the method and seed where they were noted."""
    software = result.software
    paper = f" ({label('report-method-of-the-paper')})"
    details = [f"{word(_DETAILS, k)} {v}{paper if v == 'tao2021' else ''}" for k, v in software.details]
    return "; ".join((f"{software.name} {software.version}", *details))


def _cameras(result: Result) -> Section:
    """Every placed camera with its fit, focal length and place, and their uncertainties; worst fit first."""
    rig, unit = result.rig, result.unit
    missing = [camera for camera in result.camera_ids if rig.camera(camera) is None]
    alarm = [Paragraph(label("report-not-placed", names=some_of(missing, 40)), "alarm")] if missing else []
    if not rig.cameras:
        none = Paragraph(label("report-no-camera-placed"))
        return Section("cameras", label("report-cameras"), (*alarm, none))
    serials = any(camera.serial for camera in rig.cameras)
    numbers = columns(
        "observations rms-px focal-length-px sd-focal-px centre-x centre-y centre-z sd-centre sd-rotation-deg",
        unit=unit,
    )
    heads = (*columns("camera"), *(columns("serial-number") if serials else ()), *numbers)
    worst_first = sorted(rig.cameras, key=lambda c: (-math.inf if c.rms_px is None else -c.rms_px, c.id))
    table = Table(heads, tuple(_camera(c, result, serials) for c in worst_first), 1 + serials)
    note = Paragraph(label("report-rms-root-mean-square-length", conspicuous=_CONSPICUOUS), "note")
    return Section("cameras", label("report-cameras-worst-fit-first"), (*alarm, note, table), new_page=True)


def _camera(camera: RigCamera, result: Result, serials: bool) -> tuple[Cell, ...]:
    sigma, overall = camera.sigma, result.rig.quality.rms_px
    rms = number(camera.rms_px, 4)
    conspicuous = camera.rms_px is not None and overall is not None and camera.rms_px > _CONSPICUOUS * overall
    focal, centre, turn = NONE, NONE, NONE
    if sigma is not None:
        sd = float(sigma.intrinsics[0])
        focal = significant(sd) if sd else label("report-fixed")
        centre, turn = (significant(float(np.linalg.norm(sd))) for sd in (sigma.centre_mm, sigma.rotation_deg))
    return (
        camera.id + (" *" if camera.id == result.rig.reference_camera else ""),
        *([camera.serial or NONE] if serials else []),
        count(camera.observations),
        Strong(rms, BAD) if conspicuous else rms,
        number(float(camera.intrinsics[0]), 2),
        focal,
        *(number(float(x), 3) for x in camera.centre_mm),
        centre,
        turn,
    )


def _lenses(result: Result) -> Section:
    """Focal lengths, principal points and distortions as far as there are any; cameras of one lens together."""
    cameras = result.rig.cameras
    # distortion numbers that any camera uses; both names where models differ
    wide = [bool(is_fisheye(camera.intrinsics)) for camera in cameras]
    terms: dict[int, str] = {}
    for i in range(4, len(INTRINSIC_NAMES)):
        if any(_lens_number(camera, i) != 0 for camera in cameras):
            plain = [INTRINSIC_NAMES[i]] if not all(wide) else []
            other = [FISHEYE_NAMES[i]] if any(wide) and i < len(FISHEYE_NAMES) else []
            terms[i] = " / ".join(dict.fromkeys(plain + other))
    first, rest = list(terms)[:_IN_A_TABLE], list(terms)[_IN_A_TABLE:]
    groups: dict[bytes, list[RigCamera]] = {}
    for camera in cameras:
        groups.setdefault(camera.intrinsics.tobytes(), []).append(camera)
    names = [
        group[0].id if len(group) == 1 else label("and-more", names=group[0].id, more=len(group) - 1)
        for group in groups.values()
    ]
    lenses = [group[0] for group in groups.values()]
    rows = []
    for name, c in zip(names, lenses, strict=True):
        sds = (NONE, NONE) if c.sigma is None else (significant(float(s)) for s in c.sigma.intrinsics[2:4])
        rows.append((name, *(number(float(x), 3) for x in c.intrinsics[:4]), *sds, *_numbers(c, first)))
    heads = (*columns("camera"), *(f"{name}\npx" for name in INTRINSIC_NAMES[:4]))
    sds = tuple(label("report-sd-of-px", name=name) for name in INTRINSIC_NAMES[2:4])
    tables = [Table((*heads, *sds, *(terms[i] for i in first)), tuple(rows))]
    if rest:
        own = tuple((name, *_numbers(c, rest)) for name, c in zip(names, lenses, strict=True))
        tables.append(Table((*columns("camera"), *(terms[i] for i in rest)), own))
    note = Paragraph(label("report-lens-caption", model=_lens_models(cameras)), "note")
    return Section("lenses", label("report-lenses"), (note, *tables))


def _numbers(camera: RigCamera, terms: Sequence[int]) -> tuple[str, ...]:
    return tuple(number(_lens_number(camera, i), 6) for i in terms)


def _lens_number(camera: RigCamera, i: int) -> float:
    """The number in place `i` of the 16; 0 in places that a fisheye lens does not have."""
    if i >= len(FISHEYE_NAMES) and is_fisheye(camera.intrinsics):
        return 0.0
    return float(camera.intrinsics[i])


def _lens_models(cameras: Sequence[RigCamera]) -> str:
    """The model or models that the numbers belong to."""
    wide = [camera.id for camera in cameras if is_fisheye(camera.intrinsics)]
    if not wide:
        return label("report-opencv")
    if len(wide) == len(cameras):
        return label("report-opencv-fisheye")
    return label("report-opencv-both", cameras=tuple(wide))


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


def _coverage(result: Result) -> list[Section]:
    rows = []
    for camera in result.rig.cameras:
        cells = image_cells(result, camera.id)
        if cells is None:
            continue
        corners = label("report-of-4-corners", corners=sum(cells[r, c] > 0 for r in (0, -1) for c in (0, -1)))
        own = result.residuals.rows_of[camera.id]
        used = own[result.residuals.used[own]]
        placements = len({result.residuals.placement[i] for i in used.tolist()})
        covered = f"{100 * (cells > 0).mean():.0f} %"
        rows.append((camera.id, count(len(used)), str(placements), covered, corners))
    if not rows:
        return []
    text = Paragraph(label("report-image-covered-cells-that-hold", cells=_CELLS), "note")
    table = Table(columns("camera observations placements image-covered corners-reached"), tuple(rows))
    return [Section("coverage", label("report-coverage"), (text, table))]


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
    left_out, every = count(int((~residuals.used).sum())), count(len(residuals.used))
    texts = [label("report-of-observations-were-left-out", left_out=left_out, all=every)]
    texts += [label("report-asked-for", option=repair.option, value=repair.value) for repair in result.rig.repairs]
    missing = [camera for camera in result.camera_ids if result.rig.camera(camera) is None]
    texts += [label("report-cameras-not-placed", names=", ".join(missing))] if missing else []
    heads = columns("camera observations-left-out of-its-own largest-residual-px")
    tables = [Table(heads, tuple(rows))] if rows else []
    notes = [Paragraph(text, "note") for text in texts]
    return Section("exclusions", label("report-what-was-left-out"), (*notes, *tables))


def _balls(result: Result) -> list[Section]:
    if not result.spheres:
        return []
    rows = tuple(
        (s.placement, *(number(float(x), 2) for x in s.centre_mm), number(s.radius_mm, 3), number(s.radial_sd_mm, 3))
        for s in result.spheres
    )
    heads = columns("placement centre-x centre-y centre-z radius out-of-round-sd", unit=result.unit)
    text = Paragraph(label("report-the-sphere-that-fits-the"), "note")
    return [Section("balls", label("report-ball-at-each-placement"), (text, Table(heads, rows)))]


def _lengths(result: Result) -> list[Section]:
    found = result.rig.length_map
    if found is None or found.typical_mm is None or found.worst is None:
        return []
    finite = found.expanded_mm[np.isfinite(found.expanded_mm)]
    names = ("X", "Y", "Z", *(label("report-diagonal", number=i) for i in (1, 2, 3, 4)))
    rows = []
    for name, row in zip(names, found.expanded_mm.T, strict=False):
        own = row[np.isfinite(row)]
        if len(own):
            seen = f"{100 * len(own) / len(row):.0f} %"
            rows.append((name, number(float(np.median(own)), 4), number(float(own.max()), 4), seen))
    text = label(
        "report-expanded-uncertainty-k-of-a", coverage_factor=found.coverage_factor, length_mm=found.length_mm,
        sigma_px=found.sigma_px, places_mm=len(found.places_mm), finite=number(float(np.median(finite)), 4),
        worst=number(found.worst[0], 4),
    )  # fmt: skip
    blocks = [Paragraph(text, "note"), Table(columns("direction median-mm worst-mm seen-at"), tuple(rows))]
    if (figure := length_map_figure(found)) is not None:
        caption = label("report-each-square-the-largest-expanded", length_mm=found.length_mm)
        blocks += [Paragraph(caption, "note"), figure]
    return [Section("uncertainty", label("report-uncertainty-in-the-volume"), tuple(blocks))]


def origin_section(result: Result) -> Section:
    """The program and the SHA-256 of every file of the result."""
    rows = [
        (label("report-calibrated-with"), _calibrated_with(result)),
        (label("report-images-taken"), _images_taken(result)),
        (label("report-input-sha-256"), result.rig.input_sha256 or label("report-not-given")),
    ]
    for name in RESULT_FILES:
        path = result.folder / name
        if path.is_file():
            with path.open("rb") as file:
                rows.append((name, hashlib.file_digest(file, "sha256").hexdigest()))
    table = Table(("", label("report-sha-256-of-the-file")), tuple(rows), 2)
    return Section("origin", label("report-software-and-hashes"), (table,))
