"""COLMAP text model with its rig; (0.5, 0.5) is the centre of the first pixel, poses world to camera."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.files.json_file import MOST_CAMERAS, decode, read_bytes
from spherecal.geometry.camera import FISHEYE_MARK, N_INTRINSICS
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, distortion, numbers, safe_names
from spherecal_documents.export.format import Format

# Ours (the centre of the first pixel is 0) to COLMAP's (it is 0.5).
_PIXEL_CENTRE = 0.5
_MODELS = {4: "OPENCV", 8: "FULL_OPENCV"}
_FISHEYE = "OPENCV_FISHEYE"
# Where a COLMAP model's parameters are in our 16: a tuple where one of theirs serves two of ours.
_PARAMETERS: dict[str, tuple[tuple[int, ...], ...]] = {
    "SIMPLE_PINHOLE": ((0, 1), (2,), (3,)),
    "PINHOLE": ((0,), (1,), (2,), (3,)),
    "SIMPLE_RADIAL": ((0, 1), (2,), (3,), (4,)),
    "RADIAL": ((0, 1), (2,), (3,), (4,), (5,)),
    "OPENCV": tuple((i,) for i in range(8)),
    "FULL_OPENCV": tuple((i,) for i in range(12)),
    _FISHEYE: tuple((i,) for i in range(8)),
    "SIMPLE_FISHEYE": ((0, 1), (2,), (3,)),
    "FISHEYE": ((0,), (1,), (2,), (3,)),
    "SIMPLE_RADIAL_FISHEYE": ((0, 1), (2,), (3,), (4,)),
    "RADIAL_FISHEYE": ((0, 1), (2,), (3,), (4,), (5,)),
}
# 100,000 images' lines; points2D, which are not needed here, make the file of a large reconstruction longer.
_MOST_BYTES = 256 << 20


def _names(rig: FileRig) -> list[str]:
    return safe_names([camera.id for camera in rig.cameras])


def _model(camera: FileCamera) -> tuple[str, FloatArray]:
    coefficients = distortion(camera, tuple(_MODELS))
    centre = camera.intrinsics[2:4] + _PIXEL_CENTRE
    return _FISHEYE if camera.fisheye else _MODELS[len(coefficients)], np.concatenate(
        [camera.intrinsics[:2], centre, coefficients]
    )


def _seven(pose: Pose) -> list[float]:
    """Quaternion w x y z and translation."""
    x, y, z, w = Rotation.from_matrix(pose.rotation).as_quat(canonical=True).tolist()
    return [w, x, y, z, *pose.translation.tolist()]


def _from_reference(camera: FileCamera, reference: FileCamera) -> Pose:
    matrix = camera.placed.matrix() @ np.linalg.inv(reference.placed.matrix())
    return Pose(matrix[:3, :3], matrix[:3, 3])


def _write(rig: FileRig) -> Mapping[str, str]:
    cameras = rig.cameras
    names, reference = _names(rig), rig.reference_first()[0]
    place = {camera.id: i + 1 for i, camera in enumerate(cameras)}
    first = place[reference.id]
    head = f"# {rig.source}\n# lengths in {rig.unit}\n"
    lenses, images, sensors = "", "", ""
    for camera, name in zip(cameras, names, strict=True):
        number = place[camera.id]
        model, parameters = _model(camera)
        lenses += f"{number} {model} {camera.size[0]} {camera.size[1]} {numbers(parameters, ' ')}\n"
        images += f"{number} {numbers(_seven(camera.placed), ' ')} {number} {name}/rig.png\n\n"
        if camera is not reference:
            sensors += f" CAMERA {number} 1 {numbers(_seven(_from_reference(camera, reference)), ' ')}"
    data = " ".join(f"CAMERA {number} {number}" for number in place.values())
    frame = f"1 1 {numbers(_seven(reference.placed), ' ')} {len(cameras)} {data}\n"
    return {
        "cameras.txt": f"{head}# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n{lenses}",
        "images.txt": f"{head}# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and an empty line\n{images}",
        "points3D.txt": f"{head}# no points\n",
        "rigs.txt": f"{head}# RIG_ID NUM_SENSORS REF_TYPE REF_ID (TYPE ID HAS_POSE QW QX QY QZ TX TY TZ)\n"
        f"1 {len(cameras)} CAMERA {first}{sensors}\n",
        "frames.txt": f"{head}# FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA (TYPE SENSOR_ID DATA_ID)\n{frame}",
        "rig_config.json": json.dumps([{"cameras": _rig_config(rig, names, reference)}], indent=1) + "\n",
    }


def _rig_config(rig: FileRig, names: Sequence[str], reference: FileCamera) -> list[dict[str, object]]:
    """For `colmap rig_configurator`: images of a camera are in the folder of its name."""
    entries: list[dict[str, object]] = []
    for camera, name in zip(rig.cameras, names, strict=True):
        model, parameters = _model(camera)
        entry: dict[str, object] = {"image_prefix": f"{name}/", "camera_model_name": model}
        entry["camera_params"] = parameters.tolist()
        if camera is reference:
            entry["ref_sensor"] = True
        else:
            seven = _seven(_from_reference(camera, reference))
            entry["cam_from_rig_rotation"], entry["cam_from_rig_translation"] = seven[:4], seven[4:]
        entries.append(entry)
    return entries


def read_colmap(folder: Path) -> list[FileCamera]:
    """The cameras of a text model, named after the folder of their images where that is one name a camera.

    The pose is that of the camera's first image.
    """
    lenses = _read_cameras(folder / "cameras.txt")
    poses: dict[int, Pose] = {}
    folders: dict[int, set[str]] = {}
    for camera, seven, name in _read_images(folder / "images.txt"):
        if camera not in poses:  # the images of a reconstruction are many, its cameras are not
            poses[camera] = Pose(Rotation.from_quat(seven[[1, 2, 3, 0]]).as_matrix(), seven[4:])
        folders.setdefault(camera, set()).add(name.rpartition("/")[0])
    cameras = []
    for number, (size, lens) in lenses.items():
        own = folders.get(number, set())
        name = next(iter(own)).replace("/", "_") if len(own) == 1 else ""
        cameras.append(FileCamera(name or f"camera{number}", size, lens, poses.get(number)))
    return cameras


def _read_cameras(path: Path) -> dict[int, tuple[tuple[int, int], FloatArray]]:
    cameras = {}
    for line, text in _lines(path):
        row = text.split()
        if not row or row[0].startswith("#"):
            continue
        model = row[1] if len(row) > 1 else ""
        if model not in _PARAMETERS:
            known = ", ".join(_PARAMETERS)
            raise InputError(f'{path}: line {line}: the camera model "{model}" cannot be used.', f"Usable: {known}.")
        places = _PARAMETERS[model]
        number, width, height, *parameters = _numbers(path, line, [row[0], *row[2:]], 3 + len(places))
        lens = np.zeros(N_INTRINSICS)
        for value, targets in zip(parameters, places, strict=True):
            lens[list(targets)] = value
        if model.endswith("FISHEYE"):
            lens[15] = FISHEYE_MARK
        if min(lens[0], lens[1], width, height) <= 0:
            raise InputError(f"{path}: line {line}: the image size and the focal length must be above 0.")
        lens[2:4] -= _PIXEL_CENTRE
        cameras[int(number)] = ((int(width), int(height)), lens)
        if len(cameras) > MOST_CAMERAS:  # 200,000 took over a minute
            raise InputError(f"{path}: has more than {MOST_CAMERAS} cameras.")
    return cameras


def _read_images(path: Path) -> Iterator[tuple[int, FloatArray, str]]:
    """Camera number, quaternion and translation, name of each image; none where there is no such file."""
    lines = iter(_lines(path) if path.is_file() else [])
    for line, text in lines:
        if not text.strip() or text.startswith("#"):
            continue
        row = text.split(maxsplit=9)
        if len(row) < 10:
            raise InputError(f"{path}: line {line} has too few values for an image.")
        values = _numbers(path, line, row[1:9], 8)
        if not np.linalg.norm(values[:4]) > 0:
            raise InputError(f"{path}: line {line}: the quaternion is zero.")
        yield int(values[7]), values[:7], row[9].strip()
        next(lines, None)  # the image's points: a line that may be empty


def _lines(path: Path) -> list[tuple[int, str]]:
    return list(enumerate(decode(path, read_bytes(path, _MOST_BYTES)).splitlines(), 1))


def _numbers(path: Path, line: int, texts: Sequence[str], count: int) -> FloatArray:
    try:
        values = np.array([float(text) for text in texts])
    except ValueError:
        raise InputError(f"{path}: line {line}: a number was expected, but it says otherwise.") from None
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(f"{path}: line {line} must have {count} finite numbers here, but has {len(values)}.")
    return values


FORMAT = Format(
    "colmap", "COLMAP text model with rig", 8, ("mm", "m"), _write, read_colmap, folder=True, ids=_names, fisheye=True
)
