"""mrcal's .cameramodel: one file a camera, poses world to camera, metres."""

import ast
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.files.json_file import JsonValue, decode, read_bytes
from spherecal.geometry.camera import N_INTRINSICS
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, distortion, numbers, safe_names
from spherecal_documents.export.format import Format

_ENDING = ".cameramodel"
_LENSMODEL = "LENSMODEL_OPENCV"
_MOST_BYTES = 1 << 20


def _names(rig: FileRig) -> list[str]:
    return safe_names([camera.id for camera in rig.cameras])


def _write(rig: FileRig) -> Mapping[str, str]:
    return {f"{name}{_ENDING}": _model(c, rig) for name, c in zip(_names(rig), rig.cameras, strict=True)}


def _model(camera: FileCamera, rig: FileRig) -> str:
    coefficients = distortion(camera, (4, 5, 8, 12))
    pose = f"{numbers(log_rotation(camera.placed.rotation))}, {numbers(camera.placed.translation)}"
    return (
        f"# {rig.source}\n# {camera.id}; lengths in {rig.unit}\n{{\n"
        f"    'lensmodel': '{_LENSMODEL}{len(coefficients)}',\n"
        f"    'intrinsics': [{numbers(camera.intrinsics[:4])}, {numbers(coefficients)}],\n"
        f"    'rt_cam_ref': [{pose}],\n"
        f"    'extrinsics': [{pose}],  # the same for mrcal before 2.5\n"
        f"    'imagersize': [{camera.size[0]}, {camera.size[1]}],\n}}\n"
    )


def _read(folder: Path) -> list[FileCamera]:
    return [_read_model(path) for path in sorted(folder.glob(f"*{_ENDING}"))]


def _read_model(path: Path) -> FileCamera:
    try:
        value = JsonValue(ast.literal_eval(decode(path, read_bytes(path, _MOST_BYTES))), path)
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        raise InputError(f"{path}: is not a camera model.") from None
    f = value.fields(("intrinsics", "rt_cam_ref", "imagersize"))
    found = [item.number() for item in f["intrinsics"].items(least=8)]
    lens = np.zeros(N_INTRINSICS)
    lens[: len(found)] = found
    width, height = (side.integer(1) for side in f["imagersize"].items(2))
    pose = np.array(f["rt_cam_ref"].numbers(6))
    return FileCamera(path.name.removesuffix(_ENDING), (width, height), lens, Pose(exp_rotation(pose[:3]), pose[3:]))


FORMAT = Format("mrcal", "mrcal cameramodel", 12, ("m", "mm"), _write, _read, folder=True, ids=_names)
