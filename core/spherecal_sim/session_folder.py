"""A simulated session as a folder: session.json, targets.json, observations.csv and truth.json."""

import json
from pathlib import Path
from typing import Any

from spherecal.base.filesystem import create
from spherecal.data.session import Bar, CameraSpec, Scale, Session
from spherecal.files.atomic import SESSION, write_folder_whole
from spherecal.files.bar_registry import LENGTHS
from spherecal.files.observations_file import write_observations
from spherecal.files.target_set_file import write_target_set
from spherecal.geometry.camera import camera_matrix, is_fisheye
from spherecal_sim.truth import Truth, write_truth


def write_session(session: Session, truth: Truth, folder: Path) -> None:
    """Write a session folder, whole or not at all; an older session there is replaced."""
    write_folder_whole(folder, lambda partial: fill_session_folder(session, truth, partial), SESSION)


def fill_session_folder(session: Session, truth: Truth, folder: Path) -> None:
    """Write the files of a session into an existing folder."""
    _write_json(session_json(session, folder), folder / "session.json")
    if session.target_set is not None:
        write_target_set(folder / "targets.json", session.target_set)
    if session.observations is not None:
        write_observations(folder / "observations.csv", session.observations)
    write_truth(truth, folder / "truth.json")


def _write_json(document: dict[str, Any], path: Path) -> None:
    create(path, (json.dumps(document, indent=1) + "\n").encode())


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
    if session.scale is not None:
        document["scale"] = _scale(session.scale)
    return document


def _camera(camera: CameraSpec) -> dict[str, Any]:
    entry = {
        "id": camera.id,
        "serial": camera.serial,
        "model": camera.model,
        "image_size": list(camera.image_size),
        "pixel_pitch_um": camera.pixel_pitch_um,
        "focal_length_mm": camera.focal_length_mm,
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
    return {
        "id": bar.id,
        "role": bar.role,
        "marks": {name: {"target": mark.target, "point": mark.point} for name, mark in bar.marks.items()},
        "lengths": LENGTHS.entry(bar.lengths),
        "expansion_per_kelvin": bar.expansion_per_kelvin,
        "reference_temperature_c": bar.reference_temperature_c,
    }


def _scale(scale: Scale) -> dict[str, Any]:
    if scale.kind == "bar":
        return {"kind": "bar", "bar": scale.bar}
    return {
        "kind": scale.kind,
        "from": scale.from_point,
        "to": scale.to_point,
        "distance_mm": scale.distance_mm,
        "surface": scale.surface,
    }
