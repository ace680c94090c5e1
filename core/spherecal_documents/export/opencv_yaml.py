"""OpenCV FileStorage YAML: one file a camera, poses world to camera."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.json_file import JsonValue
from spherecal.geometry.camera import camera_matrix
from spherecal.geometry.rotation import exp_rotation
from spherecal_documents.export.file_cameras import (
    FileCamera,
    FileRig,
    Pose,
    distortion,
    lens_vector,
    numbers,
    safe_names,
)
from spherecal_documents.export.format import Format
from spherecal_documents.export.yaml_file import opencv_matrix, read_yaml

# As OpenCV's own samples, ROS users and others call them.
_MATRIX_KEYS = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M", "mtx")
_DISTORTION_KEYS = (
    "distortion_coefficients", "dist_coeffs", "distCoeffs", "distortionCoefficients", "Distortion_Coefficients",
    "D", "dist",
)  # fmt: skip
_LENGTHS = (4, 5, 8, 12, 14)
_FISHEYE = "fisheye_model"  # as OpenCV's calibration sample calls it: 1 for cv::fisheye


def opencv_node(name: str, matrix: FloatArray, indent: str = "") -> str:
    """A matrix (rows, columns) as FileStorage writes it."""
    shape = "".join(
        f"{indent}   {key}: {value}\n" for key, value in (("rows", matrix.shape[0]), ("cols", matrix.shape[1]))
    )
    return f"{indent}{name}: !!opencv-matrix\n{shape}{indent}   dt: d\n{indent}   data: [ {numbers(matrix)} ]\n"


def _write(rig: FileRig) -> Mapping[str, str]:
    names = safe_names([camera.id for camera in rig.cameras])
    return {f"{name}.yml": _camera(camera, rig) for name, camera in zip(names, rig.cameras, strict=True)}


def _camera(camera: FileCamera, rig: FileRig) -> str:
    width, height = camera.size
    return (
        f"%YAML:1.0\n---\n# {rig.source}\n# x_camera = R x_world + T; (0, 0) is the centre of the first pixel\n"
        f'camera_name: "{camera.id}"\nlength_unit: "{rig.unit}"\nimage_width: {width}\nimage_height: {height}\n'
        + opencv_node("camera_matrix", camera_matrix(camera.intrinsics))
        + (f"{_FISHEYE}: 1\n" if camera.fisheye else "")
        + opencv_node("distortion_coefficients", np.array([distortion(camera, _LENGTHS)]))
        + opencv_node("R", camera.placed.rotation)
        + opencv_node("T", camera.placed.translation[:, None])
    )


def read_opencv_file(path: Path) -> FileCamera:
    """The camera of one YAML file."""
    value = read_yaml(path)
    matrix_key, distortion_key = (_first_key(value, keys) for keys in (_MATRIX_KEYS, _DISTORTION_KEYS))
    if matrix_key is None:
        raise InputError(Phrase("error-no-camera-matrix", {"path": path}))
    f = value.fields(
        (), ("image_width", "image_height", "camera_name", "R", "T", _FISHEYE, matrix_key, distortion_key or "D")
    )
    matrix = opencv_matrix(f[matrix_key])
    if matrix.shape != (3, 3) or matrix[0, 1] != 0 or matrix[0, 0] <= 0 or matrix[1, 1] <= 0 or matrix[2, 2] != 1:
        raise f[matrix_key].error("must have the form [[fu, 0, u0], [0, fv, v0], [0, 0, 1]] with fu, fv above 0")
    wide = _FISHEYE in f and f[_FISHEYE].value not in (0, False)
    size = None
    if "image_width" in f and "image_height" in f:
        size = f["image_width"].integer(1), f["image_height"].integer(1)
    return FileCamera(
        id=f["camera_name"].name() if "camera_name" in f else path.stem,
        image_size=size,
        intrinsics=lens_vector(matrix, _coefficients(f[distortion_key], wide) if distortion_key else [], wide),
        pose=_pose(f["R"], f["T"]) if "R" in f and "T" in f else None,
    )


def _first_key(value: JsonValue, keys: tuple[str, ...]) -> str | None:
    present = value.value if isinstance(value.value, dict) else {}
    return next((key for key in keys if present.get(key) is not None), None)


def _coefficients(value: JsonValue, fisheye: bool) -> list[float]:
    found = opencv_matrix(value).ravel().tolist()
    if fisheye and len(found) != 4:
        raise value.error(f"must have 4 numbers in the fisheye model, but has {len(found)}")
    if len(found) not in _LENGTHS:
        raise value.error(f"must have 4, 5, 8, 12 or 14 numbers, but has {len(found)}")
    if any(found[12:]):
        raise value.error("describes a tilted sensor, which this program's lens model does not have")
    return found[:12]


def _pose(rotation: JsonValue, translation: JsonValue) -> Pose:
    r, t = opencv_matrix(rotation), opencv_matrix(translation)
    if t.size != 3 or r.size not in (3, 9):
        raise rotation.error("and T must be a rotation matrix or vector and three numbers")
    return Pose(exp_rotation(r.ravel()) if r.size == 3 else r.reshape(3, 3), t.ravel())


def read_opencv(path: Path) -> list[FileCamera]:
    """The cameras of a folder with one YAML file each, or of one such file."""
    if not path.is_dir():
        return [read_opencv_file(path)]
    files = sorted(file for ending in ("*.yml", "*.yaml") for file in path.glob(ending))
    if not files:
        raise InputError(Phrase("error-no-yaml-file", {"path": path}))
    return [read_opencv_file(file) for file in files]


FORMAT = Format("opencv", "OpenCV YAML", 12, ("mm", "m"), _write, read_opencv, folder=True, fisheye=True)
