"""MATLAB's .mat files, read only: Bouguet's toolbox and the structs that the Computer Vision Toolbox makes.

Of parameters as objects only MATLAB knows the contents: `toStruct` makes structs of them. Bouguet's pixels are counted
from 0, the toolbox's from 1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.files.json_file import printable
from spherecal.geometry.rotation import exp_rotation
from spherecal_documents.export.file_cameras import FileCamera, Pose, lens_vector
from spherecal_documents.export.mat_file import MatValue, read_mat
from spherecal_documents.export.other_formats import ImportFormat

Values: TypeAlias = Mapping[str, MatValue]
_SINGLE = ("fc", "cc", "kc")
_STEREO = tuple(f"{name}_{side}" for side in ("left", "right") for name in _SINGLE)
_LENS = ("RadialDistortion", "TangentialDistortion")
_PAIR = ("CameraParameters1", "CameraParameters2", "RotationOfCamera2", "TranslationOfCamera2")
_SAVE = "In MATLAB: s = toStruct(parameters); save('rig.mat', '-struct', 's', '-v7')."


def read_matlab(path: Path) -> Sequence[FileCamera]:
    """The cameras of a .mat file."""
    file = read_mat(path)
    if file.objects:
        raise InputError(f"{path}: holds objects whose contents only MATLAB knows.", _SAVE)
    values = file.values
    if set(_STEREO) <= set(values):
        left, right = (_bouguet(path, values, f"_{side}", side) for side in ("left", "right"))
        matrix = _numbers(path, values, "R", 9).reshape(3, 3) if "R" in values else None
        rotation = exp_rotation(_numbers(path, values, "om", 3)) if matrix is None else matrix
        return [_placed(left), _placed(right, rotation, _numbers(path, values, "T", 3))]
    if set(_SINGLE) <= set(values):
        return [_placed(_bouguet(path, values, "", path.stem))]
    if set(_PAIR) <= set(values):
        one, other = (_toolbox(path, _fields(path, values, name), name[-1]) for name in _PAIR[:2])
        # rows times matrices: x2 = x1 R + T
        rotation = _numbers(path, values, "RotationOfCamera2", 9).reshape(3, 3).T
        return [_placed(one), _placed(other, rotation, _numbers(path, values, "TranslationOfCamera2", 3))]
    if set(_LENS) <= set(values):
        return [_placed(_toolbox(path, values, path.stem))]
    found = ", ".join(printable(name) for name in list(values)[:8]) or "nothing"
    raise InputError(
        f"{path}: holds no camera calibration that is known here, but {found}.",
        f"Read are Calib_Results.mat and Calib_Results_stereo.mat, and structs of camera parameters. {_SAVE}",
    )


def _bouguet(path: Path, values: Values, ending: str, name: str) -> FileCamera:
    """A camera of Bouguet's toolbox: OpenCV's lens model, the centre of the first pixel at (0, 0)."""
    alpha = f"alpha_c{ending}"
    skew = float(_numbers(path, values, alpha, 1)[0]) if alpha in values else 0.0
    (fu, fv), (u0, v0) = (_numbers(path, values, f"{key}{ending}", 2) for key in ("fc", "cc"))
    matrix = np.array([[fu, skew * fu, u0], [0, fv, v0], [0, 0, 1]])
    lens = lens_vector(matrix, _numbers(path, values, f"kc{ending}", 5), False, f"{path}: camera {name}")
    size = _numbers(path, values, ("nx", "ny"), 1) if {"nx", "ny"} <= set(values) else np.empty(0)
    return FileCamera(name, _size(size), lens, None)


def _toolbox(path: Path, values: Values, name: str) -> FileCamera:
    """A camera of the Computer Vision Toolbox: the centre of the first pixel at (1, 1), image sizes rows first."""
    radial, tangential = _numbers(path, values, "RadialDistortion", None), _numbers(path, values, _LENS[1], 2)
    if len(radial) not in (2, 3):
        raise InputError(f"{path}: RadialDistortion must have 2 or 3 numbers, but has {len(radial)}.")
    if "K" in values:
        matrix = _numbers(path, values, "K", 9).reshape(3, 3)
    else:  # until R2022a, transposed
        matrix = _numbers(path, values, "IntrinsicMatrix", 9).reshape(3, 3).T
    matrix = matrix - [[0, 0, 1], [0, 0, 1], [0, 0, 0]]
    lens = lens_vector(matrix, np.array([*radial[:2], *tangential, *radial[2:]]), False, f"{path}: camera {name}")
    size = _numbers(path, values, "ImageSize", None) if "ImageSize" in values else np.empty(0)
    return FileCamera(name, _size(size[::-1]), lens, None)


def _size(sides: FloatArray) -> tuple[int, int] | None:
    """Width and height, where they can be."""
    good = len(sides) == 2 and (sides >= 1).all() and (sides < 1e6).all()
    return (int(sides[0]), int(sides[1])) if good else None


def _placed(
    camera: FileCamera, rotation: FloatArray | None = None, translation: FloatArray | None = None
) -> FileCamera:
    pose = Pose(np.eye(3) if rotation is None else rotation, np.zeros(3) if translation is None else translation)
    return replace(camera, pose=pose)


def _fields(path: Path, values: Values, name: str) -> Values:
    value = values[name]
    if not isinstance(value, list) or len(value) != 1:
        raise InputError(f"{path}: {name} must be one struct.", _SAVE)
    return value[0]


def _numbers(path: Path, values: Values, name: str | tuple[str, ...], count: int | None) -> FloatArray:
    """The finite numbers of a variable, or one each of several, row by row."""
    if isinstance(name, tuple):
        return np.concatenate([_numbers(path, values, one, count) for one in name])
    value = values.get(name)
    if not isinstance(value, np.ndarray) or (count is not None and value.size != count) or not np.isfinite(value).all():
        expected = "finite numbers" if count is None else f"{count} finite numbers"
        raise InputError(f"{path}: {name} must be {expected}.")
    return value.ravel()


FORMAT = ImportFormat("matlab", "MATLAB .mat", ("mm", "m"), read_matlab)
