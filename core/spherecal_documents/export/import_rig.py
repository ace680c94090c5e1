"""`import_rig`: a rig with poses from the file of another program, by the readers that check our exports."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.base.filesystem import id_problem
from spherecal.base.messages.values import Phrase
from spherecal.base.plugins import EXPORTERS, IMPORTERS, names
from spherecal.data.rig import Rig, rig_of_unknown_quality
from spherecal.data.rig_camera import RigCamera
from spherecal.geometry.opencv import pose_rotation
from spherecal_documents.export import matlab
from spherecal_documents.export.file_cameras import MM_PER, FileCamera, Unit
from spherecal_documents.export.format import Format
from spherecal_documents.export.other_formats import ImportFormat, importer
from spherecal_documents.export.write_export import FORMATS, chosen_unit

# Formats that are read and not written.
READ_ONLY = {one.FORMAT.name: one.FORMAT for one in (matlab,)}


def import_rig(path: Path, name: str, unit: Unit | None = None, ids: Sequence[str] | None = None) -> Rig:
    """The rig in a file or folder of a format that is read, lengths in mm.

    Nothing is known of its accuracy, which its one finding says.

    `unit` None: the format's own; `ids` None: their names there.
    """
    form = _format(name)
    if not path.exists():
        raise InputError(Phrase("error-no-file-or-folder", {"path": path}))
    mm = MM_PER[chosen_unit(form, unit)]
    found = form.read(path)
    if ids is not None and len(ids) != len(found):
        counts = {"cameras": len(found), "count": len(ids)}
        raise InputError(Phrase("error-other-id-count", {"path": path, **counts}))
    own_ids = [camera.id for camera in found] if ids is None else list(ids)
    cameras = tuple(_camera(path, camera, own, mm) for camera, own in zip(found, own_ids, strict=True))
    if len(set(own_ids)) < len(own_ids):
        raise InputError(Phrase("error-one-name-twice", {"path": path}))
    return rig_of_unknown_quality(cameras)


def _format(name: str) -> Format | ImportFormat:
    found = FORMATS.get(name) or READ_ONLY.get(name) or importer(name)
    if found is None:
        others = sorted({*names(IMPORTERS), *names(EXPORTERS)} - set(FORMATS))
        known = [*FORMATS, *READ_ONLY, *others]
        raise InputError(Phrase("error-no-import-format", {"name": name, "formats": known}))
    return found


def _camera(path: Path, camera: FileCamera, name: str, mm: float) -> RigCamera:
    if problem := id_problem(name):
        raise InputError(Phrase("error-bad-camera-name", {"path": path, "name": repr(name), "problem": problem}))
    if camera.pose is None or camera.image_size is None:
        missing = "error-no-pose" if camera.pose is None else "error-no-image-size"
        raise InputError(Phrase(missing, {"path": path, "camera": name}))
    rotation = pose_rotation(camera.pose.rotation, f'camera "{name}"')
    if np.abs(rotation - camera.pose.rotation).max() < 1e-12:
        rotation = camera.pose.rotation  # as the file has it
    return RigCamera(
        name, camera.serial, camera.image_size, camera.intrinsics, rotation, mm * camera.pose.translation, None, 0, None
    )
