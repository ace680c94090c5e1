"""The document session.json of a session, as it is written."""

from pathlib import Path
from typing import Any

from spherecal.data.session import Bar, CameraSpec, Session
from spherecal.geometry.camera import camera_matrix, is_fisheye
from spherecal_files.bar_registry import LENGTHS, MARKS
from spherecal_files.json_file import plain_fields
from spherecal_files.session_file import SCALE

# A lens of 45 degrees across: what COLMAP begins with too. Phones and webcams have 0.7 to 0.9, machine vision 1 to 4.
ASSUMED_FOCAL = 1.2


def session_json(session: Session, folder: Path) -> dict[str, Any]:
    """The document session.json of a session."""
    document: dict[str, Any] = {
        "format": "spherecal/session",
        "version": 1,
        "cameras": [_camera(c) for c in session.cameras],
        "placements": [_with_images({"id": p.id}, p.images, folder) for p in session.placements],
        "bars": [_bar(b) for b in session.bars],
        "bar_poses": [
            _with_images({"id": p.id, "bar": p.bar, "temperature_c": p.temperature_c}, p.images, folder)
            for p in session.bar_poses
        ],
    }
    if session.target_set is not None:
        document["target_set"] = "targets.json"
    if session.sphere_diameter_mm is not None:
        document["sphere"] = {"nominal_diameter_mm": session.sphere_diameter_mm}
        if session.sphere_sd_mm is not None:
            document["sphere"]["expanded_uncertainty_mm"] = 2 * session.sphere_sd_mm
    if session.wanted_uncertainty_mm is not None:
        document["wanted_uncertainty_mm"] = session.wanted_uncertainty_mm
    if session.scale is not None:
        document["scale"] = SCALE.entry(session.scale)
    return document


def _camera(camera: CameraSpec) -> dict[str, Any]:
    entry: dict[str, Any] = {
        **plain_fields(camera, "id serial model image_size pixel_pitch_um focal_length_mm"),
        "prior": {
            "matrix": camera_matrix(camera.prior).tolist(),
            "distortion": camera.prior[4 : 8 if is_fisheye(camera.prior) else 16].tolist(),
        },
        "lens_model": None if camera.lens_model == "brown" else camera.lens_model,
        "intrinsics_group": camera.intrinsics_group,
        "ignore": [list(one) for one in camera.ignore] or None,
    }
    return {key: value for key, value in entry.items() if value is not None}


def _with_images(entry: dict[str, Any], images: dict[str, Path], folder: Path) -> dict[str, Any]:
    if images:
        entry["images"] = {camera: path.relative_to(folder).as_posix() for camera, path in images.items()}
    return entry


def _bar(bar: Bar) -> dict[str, Any]:
    marks, lengths = MARKS.entry(bar.marks), LENGTHS.entry(bar.lengths)
    material = plain_fields(bar, "expansion_per_kelvin reference_temperature_c")
    return {"id": bar.id, "role": bar.role, "marks": marks, "lengths": lengths, **material}


def assumed_prior(size: tuple[int, int]) -> dict[str, Any]:
    """The entry `prior` of a camera whose lens nobody knows; a calibration by a ball starts from what it sees."""
    return {"matrix": centred_matrix(ASSUMED_FOCAL * max(size), size), "assumed": ["focal_length"]}


def centred_matrix(focal_px: float, size: tuple[int, int]) -> list[list[float]]:
    """The camera matrix whose principal point is the image's middle."""
    return [[focal_px, 0.0, (size[0] - 1) / 2], [0.0, focal_px, (size[1] - 1) / 2], [0.0, 0.0, 1.0]]
