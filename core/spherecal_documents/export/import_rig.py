"""`import_rig`: a rig with poses from the file of another program, by the readers that check our exports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.distance import pdist

from spherecal.base.errors import InputError
from spherecal.base.file_reading import id_problem
from spherecal.base.messages.values import Phrase
from spherecal.base.plugins import EXPORTERS, IMPORTERS, names
from spherecal.data.rig import Rig, rig_of_unknown_quality
from spherecal.data.rig_camera import RigCamera
from spherecal.geometry.camera import is_fisheye
from spherecal.geometry.opencv import pose_rotation
from spherecal_documents.export.file_cameras import MM_PER, FileCamera, Reading, Unit
from spherecal_documents.export.format import importer
from spherecal_documents.export.matlab import MATLAB
from spherecal_documents.export.mrcal_splined import MRCAL_SPLINED
from spherecal_documents.export.write_export import FORMATS

# MATLAB's is not written; a rig's lenses are none of splines.
READABLE = {name: form for name, form in FORMATS.items() if form is not MRCAL_SPLINED} | {MATLAB.name: MATLAB}


# Rigs whose cameras are at most 20 mm apart (two lenses side by side) or more than 50 m (a hall) are hardly any. One in
# mm that was read as m is beyond the second from 50 mm on.
_LEAST_MM, _MOST_MM = 20.0, 50_000.0


@dataclass(frozen=True)
class Imported:
    """A rig, and what was taken for it: the unit with where it is from, lens models, distances, what was left out."""

    rig: Rig
    unit: Unit
    unit_from: Literal["given", "the file", "the format"]
    lenses: Mapping[str, tuple[str, ...]]  # camera ids by lens model in words
    nearest_mm: float | None  # of two cameras' centres, None of one camera
    farthest_mm: float | None
    left_out: Mapping[str, str]  # cameras by name with the reason
    warnings: tuple[str, ...]  # what is hardly right


def import_rig(path: Path, name: str, unit: Unit | None = None, ids: Sequence[str] | None = None) -> Imported:
    """The rig of unknown accuracy in a file or folder, lengths in mm; refused where a rig cannot represent it."""
    form = READABLE.get(name) or importer(name)
    if form is None:
        others = sorted({*names(IMPORTERS), *names(EXPORTERS)} - set(FORMATS))
        known = [*READABLE, *others]
        raise InputError(Phrase("error-no-import-format", {"name": name, "formats": known}))
    if not path.exists():
        raise InputError(Phrase("error-no-file-or-folder", {"path": path}))
    # whatever the format says, the unit is that of the board or bar that its user typed in
    chosen = unit or form.units[0]
    read = form.read(path)
    reading = read if isinstance(read, Reading) else Reading(tuple(read))
    source: Literal["given", "the file", "the format"] = "the format" if unit is None else "given"
    if unit is None and reading.unit is not None:
        chosen, source = reading.unit, "the file"
    placed = [camera for camera in reading if camera.pose is not None]
    left_out = {**reading.left_out, **{camera.id: "has no pose" for camera in reading if camera.pose is None}}
    if not placed:
        lost = "; ".join(f"{camera} {why}" for camera, why in left_out.items())
        raise InputError(
            f"{path}: has no camera that can be used{f' ({lost})' if lost else ''}.",
            "Is it the file of a finished calibration with poses?",
        )
    if ids is not None and len(ids) != len(placed):
        counts = {"cameras": len(placed), "count": len(ids)}
        raise InputError(Phrase("error-other-id-count", {"path": path, **counts}))
    own_ids = [camera.id for camera in placed] if ids is None else list(ids)
    cameras = tuple(_camera(path, camera, own, MM_PER[chosen]) for camera, own in zip(placed, own_ids, strict=True))
    if len(set(own_ids)) < len(own_ids):
        raise InputError(Phrase("error-one-name-twice", {"path": path}))
    apart = pdist(np.array([camera.centre_mm for camera in cameras]))
    nearest, farthest = (float(apart.min()), float(apart.max())) if len(apart) else (None, None)
    warnings = (*reading.notes, *_doubts(cameras, nearest, farthest, chosen))
    lenses: dict[str, tuple[str, ...]] = {}
    for camera in cameras:
        words = _lens_words(camera)
        lenses[words] = (*lenses.get(words, ()), camera.id)
    return Imported(rig_of_unknown_quality(cameras), chosen, source, lenses, nearest, farthest, left_out, warnings)


def _doubts(cameras: Sequence[RigCamera], nearest: float | None, farthest: float | None, unit: Unit) -> list[str]:
    if nearest is None or farthest is None:
        return []
    found = []
    if not _LEAST_MM <= farthest <= _MOST_MM:
        apart = f"{farthest:.4g} mm" if farthest < _LEAST_MM else f"{farthest / 1000:.4g} m"
        other = next(one for one in MM_PER if one != unit)
        found.append(
            f"the cameras are up to {apart} apart, hardly a rig; lengths were taken as {unit}: if that is not the "
            f"file's unit, import it with --unit {other}"
        )
    if nearest < 1e-6 * max(farthest, 1.0):
        pairs = combinations(cameras, 2)
        same = [f"{a.id} and {b.id}" for a, b in pairs if np.linalg.norm(a.centre_mm - b.centre_mm) <= nearest]
        found.append(f"{', '.join(same[:4])} are at one place: their poses may not be calibrated")
    return found


def _lens_words(camera: RigCamera) -> str:
    terms = np.flatnonzero(camera.intrinsics[4:8] if is_fisheye(camera.intrinsics) else camera.intrinsics[4:])
    last = int(terms[-1]) + 1 if len(terms) else 0
    if is_fisheye(camera.intrinsics):
        return "fisheye (k1 to k4)"
    models = {0: "pinhole without distortion", 5: "Brown (k1 k2 p1 p2 k3)", 8: "rational (k1 to k6, p1 p2)"}
    return next((words for most, words in models.items() if last <= most), "rational with thin prism (12 numbers)")


def _camera(path: Path, camera: FileCamera, name: str, mm: float) -> RigCamera:
    if problem := id_problem(name):
        raise InputError(Phrase("error-bad-camera-name", {"path": path, "name": repr(name), "problem": problem}))
    if camera.image_size is None:
        raise InputError(
            Phrase("error-no-image-size", {"path": path, "camera": name}),
            "Add the lines image_width: and image_height: (px) to the file.",
        )
    assert camera.pose is not None
    lens, size = camera.intrinsics, camera.image_size
    if not (np.isfinite(lens).all() and min(lens[0], lens[1], *size) > 0):
        raise InputError(f'{path}: camera "{name}": its image size and focal lengths are not all above 0.')
    if not np.isfinite(camera.pose.translation).all():
        raise InputError(f'{path}: camera "{name}": its position is not finite.')
    rotation = pose_rotation(camera.pose.rotation, f'camera "{name}" in {path}')
    if np.abs(rotation - camera.pose.rotation).max() < 1e-12:
        rotation = camera.pose.rotation  # as the file has it
    return RigCamera(name, camera.serial, size, lens, rotation, mm * camera.pose.translation, None, 0, None)
