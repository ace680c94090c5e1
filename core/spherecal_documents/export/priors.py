"""Lenses out of the files of OpenCV, COLMAP and Kalibr, as priors of a session."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.file_reading import read_file
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Session
from spherecal.geometry.camera import camera_matrix
from spherecal_documents.export.colmap import read_colmap_lenses
from spherecal_documents.export.file_cameras import FileCamera, distortion
from spherecal_documents.export.kalibr import read_kalibr
from spherecal_documents.export.opencv_yaml import read_opencv, read_yaml
from spherecal_files.atomic import SESSION, WRITTEN_FILE, write_folder_whole, written_bytes
from spherecal_files.filesystem import write_new
from spherecal_files.json_file import json_bytes
from spherecal_files.read_session import OBSERVATIONS_FILE, SESSION_FILE, read_session

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
