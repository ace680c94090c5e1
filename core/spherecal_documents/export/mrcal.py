"""mrcal's .cameramodel: one file a camera, poses world to camera, metres."""

import ast
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.files.json_file import JsonValue, decode, read_bytes
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal_documents.export.file_cameras import (
    FileCamera,
    FileRig,
    Pose,
    distortion,
    lens_vector,
    numbers,
)
from spherecal_documents.export.format import Format

_ENDING = ".cameramodel"
_LENSMODEL = "LENSMODEL_OPENCV"
_MOST_BYTES = 64 << 20  # a model may hold all observations that it was made of


def _write(rig: FileRig) -> Mapping[str, str]:
    return {f"{name}{_ENDING}": _model(c, rig) for name, c in zip(rig.safe_names(), rig.cameras, strict=True)}


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


def _read(path: Path) -> list[FileCamera]:
    if path.is_file():
        return [_read_model(path)]
    return [_read_model(file) for file in sorted(path.glob(f"*{_ENDING}"))]


def _read_model(path: Path) -> FileCamera:
    try:
        value = JsonValue(ast.literal_eval(decode(path, read_bytes(path, _MOST_BYTES))), path)
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        raise InputError(f"{path}: is not a camera model.") from None
    given = value.as_object()
    # before 2.5 the pose was called otherwise, in older files the lens model too
    named = {key: value.at(key, given[key]) for key in ("lensmodel", "lens_model", "distortion_model") if key in given}
    posed = [value.at(key, given[key]) for key in ("rt_cam_ref", "extrinsics") if key in given]
    f = value.fields(("intrinsics", "imagersize"))
    if not named:
        raise value.error("names no lensmodel")
    count = _coefficients(next(iter(named.values())))
    found = f["intrinsics"].numbers(4 + count)
    fu, fv, u0, v0 = found[:4]
    where = f"{path}: the camera"
    lens = lens_vector([[fu, 0, u0], [0, fv, v0], [0, 0, 1]], found[4:], False, where)
    width, height = (side.integer(1) for side in f["imagersize"].items(2))
    pose = np.array(posed[0].numbers(6)) if posed else None
    placed = None if pose is None else Pose(exp_rotation(pose[:3]), pose[3:])
    return FileCamera(path.name.removesuffix(_ENDING), (width, height), lens, placed)


def _coefficients(named: JsonValue) -> int:
    """How many distortion coefficients a lens model has; InputError for those that are none of OpenCV's."""
    name = named.text().removeprefix("LENSMODEL_").removeprefix("DISTORTION_")
    known = {"PINHOLE": 0, "NONE": 0, **{f"OPENCV{n}": n for n in (4, 5, 8, 12)}}
    if name not in known:
        raise InputError(
            f"{named.file}: the lens model {name} cannot be used.",
            "Usable: PINHOLE and OPENCV4, 5, 8, 12. Convert it: mrcal-convert-lensmodel LENSMODEL_OPENCV8.",
        )
    return known[name]


FORMAT = Format("mrcal", "mrcal cameramodel", 12, ("m", "mm"), _write, _read, folder=True, ids=FileRig.safe_names)
