"""`import_rig`: a rig with poses from the file of another program, by the readers that check our exports."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.distance import pdist

from spherecal.base.errors import InputError
from spherecal.base.file_reading import id_problem, read_file
from spherecal.base.messages.values import Phrase
from spherecal.base.plugins import EXPORTERS, IMPORTERS, names
from spherecal.data.rig import Rig, rig_of_unknown_quality
from spherecal.data.rig_camera import RigCamera
from spherecal.data.session import Session
from spherecal.geometry.camera import camera_matrix, is_fisheye
from spherecal.geometry.opencv import pose_rotation
from spherecal_documents.export.colmap import read_colmap_lenses
from spherecal_documents.export.file_cameras import MM_PER, FileCamera, Reading, Unit, distortion
from spherecal_documents.export.format import importer
from spherecal_documents.export.kalibr import read_kalibr
from spherecal_documents.export.matlab import MATLAB
from spherecal_documents.export.mrcal import MRCAL_SPLINED
from spherecal_documents.export.opencv_yaml import read_opencv, read_yaml
from spherecal_documents.export.write_export import FORMATS
from spherecal_files.atomic import SESSION, WRITTEN_FILE, write_folder_whole, written_bytes
from spherecal_files.filesystem import write_new
from spherecal_files.json_file import json_bytes
from spherecal_files.read_session import OBSERVATIONS_FILE, SESSION_FILE, read_session

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


_MOST_BYTES = 1 << 30


def read_cameras(path: Path) -> tuple[str, list[FileCamera]]:
    """The name of the format and the cameras of a COLMAP model, a Kalibr camchain or OpenCV's files."""
    if not path.exists():
        raise InputError(Phrase("error-no-file-or-folder", {"path": path}))
    if path.is_dir() and any((path / name).is_file() for name in ("cameras.txt", "cameras.bin")):
        return "COLMAP", read_colmap_lenses(path)
    if path.is_dir():
        return "OpenCV", read_opencv(path)
    if path.name in ("cameras.txt", "cameras.bin"):
        return "COLMAP", read_colmap_lenses(path.parent)
    if path.suffix.lower() not in (".yml", ".yaml", ".xml"):
        raise InputError(Phrase("error-no-lens-file", {"path": path}))
    document = read_yaml(path).value if path.suffix.lower() != ".xml" else None
    if isinstance(document, dict) and "cam0" in document:
        return "Kalibr", read_kalibr(path)
    return "OpenCV", read_opencv(path)


def matched(session: Session, found: Sequence[FileCamera], by_order: bool) -> dict[str, FileCamera]:
    """The file's camera for each of the session's, by id (or by order); cameras that the file lacks are left out."""
    if by_order:
        if len(found) != len(session.cameras):
            counts = {"count": len(found), "cameras": len(session.cameras)}
            raise InputError(Phrase("error-other-camera-count", counts))
        pairs = {spec.id: camera for spec, camera in zip(session.cameras, found, strict=True)}
    else:
        names = [camera.id for camera in found]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(Phrase("error-two-of-a-name", {"name": twice[0]}))
        by_name = dict(zip(names, found, strict=True))
        pairs = {spec.id: by_name[spec.id] for spec in session.cameras if spec.id in by_name}
        if not pairs:
            own = _listed([spec.id for spec in session.cameras])
            raise InputError(Phrase("error-no-common-camera", {"names": _listed(names), "own": own}))
    for spec in session.cameras:
        size = pairs[spec.id].image_size if spec.id in pairs else None
        if size is not None and size != spec.image_size:
            sizes = dict(zip(("width", "height", "own_width", "own_height"), (*size, *spec.image_size), strict=True))
            raise InputError(Phrase("error-lens-of-other-size", {"camera": spec.id, **sizes}))
    return pairs


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")


def write_with_priors(session_folder: Path, priors: Mapping[str, FileCamera], output: Path) -> None:
    """Write a copy of the session whole, in which these cameras have these lenses as priors; the rest as it was."""
    session = read_session(session_folder)
    document = json.loads((session_folder / SESSION_FILE).read_bytes().decode("utf-8-sig"))
    for entry in document["cameras"]:
        if entry["id"] in priors:
            camera = priors[entry["id"]]
            matrix = camera_matrix(camera.intrinsics).tolist()
            entry["prior"] = {"matrix": matrix, "distortion": distortion(camera, (5, 8, 12))}
            if camera.fisheye:
                entry["lens_model"] = "fisheye"
            elif entry.get("lens_model") == "fisheye":  # of a lens that is replaced by one of the other model
                del entry["lens_model"]

    def build(new: Path) -> None:
        write_new(new, SESSION_FILE, json_bytes(document))
        names = [source.relative_to(session_folder.absolute()).as_posix() for source in _files(session, document)]
        for name in names:
            write_new(new, name, read_file(session_folder / name, _MOST_BYTES))
        write_new(new, WRITTEN_FILE, written_bytes([SESSION_FILE, *names]))

    write_folder_whole(output, build, SESSION)


def _files(session: Session, document: Mapping[str, object]) -> list[Path]:
    """All files that session.json names and that are there, and the observations."""
    folder = session.folder.absolute()
    files = {path for place in (*session.placements, *session.bar_poses) for path in place.images.values()}
    names = [document.get("target_set"), OBSERVATIONS_FILE]
    files |= {folder / name for name in names if isinstance(name, str) and (folder / name).is_file()}
    return sorted(files)
