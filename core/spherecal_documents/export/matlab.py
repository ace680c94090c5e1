"""MATLAB's .mat files, read only: Bouguet's toolbox and the structs that the Computer Vision Toolbox makes."""

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from struct import Struct, unpack_from
from typing import TypeAlias

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.geometry.rotation import exp_rotation
from spherecal_documents.export.file_cameras import FileCamera, Pose, lens_vector
from spherecal_documents.export.format import ImportFormat
from spherecal_files.json_file import printable, read_bytes

# A stereo calibration with the poses of all its images has some 100 kB.
_MOST_BYTES, _MOST_UNPACKED = 16 << 20, 64 << 20
_HEADER, _MATRIX, _COMPRESSED = 128, 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_STRUCT, _OBJECTS, _NUMERIC = 2, (3, 16, 17), range(6, 16)
_DEEPEST, _MOST_ENTRIES, _MOST_FIELDS, _MOST_INTEGERS = 8, 20_000, 4096, 64

MatValue = FloatArray | list[dict[str, "MatValue | None"]] | None


@dataclass(frozen=True)
class MatFile:
    """Variables by name: numbers, elements of a struct array, else None; `objects`: those only MATLAB can read."""

    values: dict[str, MatValue]
    objects: tuple[str, ...]


class _DamagedError(Exception):
    pass


@dataclass(frozen=True)
class _Reader:
    """Elements in one byte order."""

    order: str

    def elements(self, data: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Type and contents of the elements in some bytes."""
        tag, at = Struct(f"{self.order}II"), 0
        while at + 8 <= len(data):
            kind, size = tag.unpack_from(data, at)
            if kind >> 16:  # a small one: type and size share four bytes
                kind, size, begin, end = kind & 0xFFFF, kind >> 16, at + 4, at + 8
                if size > 4:
                    raise _DamagedError("a small element is longer than four bytes")
            else:
                begin = at + 8
                end = begin + size + (-size % 8 if kind != _COMPRESSED else 0)
            if begin + size > len(data):
                raise _DamagedError("it ends in the middle of an element")
            yield kind, data[begin : begin + size]
            at = end

    def integers(self, element: tuple[int, memoryview]) -> list[int]:
        """The few integers of an element: flags, a shape, a length."""
        kind, data = element
        if kind not in _NUMBERS or _NUMBERS[kind].startswith("f") or len(data) > _MOST_INTEGERS:
            raise _DamagedError("a matrix has no shape")
        return [int(value) for value in np.frombuffer(data, np.dtype(self.order + _NUMBERS[kind]))]

    def numbers(self, element: tuple[int, memoryview]) -> FloatArray:
        """The numbers of an element in memory order."""
        kind, data = element
        if kind not in _NUMBERS:
            raise _DamagedError("an element of numbers has another type")
        form = np.dtype(self.order + _NUMBERS[kind])
        return np.frombuffer(data[: len(data) // form.itemsize * form.itemsize], form).astype(float)

    def matrix(self, data: memoryview, depth: int = 0) -> tuple[str, int, MatValue]:
        """Name, class and value of a matrix."""
        if depth > _DEEPEST:
            raise _DamagedError("structs are nested too deeply")
        parts = self.elements(data)
        try:
            flags = self.integers(next(parts))
            kind = flags[0] & 0xFF
            if kind in _OBJECTS:
                return _text(next(parts)[1]), kind, None
            shape = self.integers(next(parts))
            name = _text(next(parts)[1])
            if not 2 <= len(shape) <= 8 or any(side < 0 for side in shape):
                raise _DamagedError("a matrix has no shape")
            if kind == _STRUCT:
                return name, kind, self._struct(parts, shape, depth)
            if kind not in _NUMERIC:
                return name, kind, None
            values = self.numbers(next(parts))
        except (StopIteration, IndexError, ValueError):
            raise _DamagedError("a matrix is incomplete") from None
        if prod(shape) != len(values) or not len(values):
            raise _DamagedError("a matrix has another size than it says, or none")
        return name, kind, values.reshape(shape, order="F")

    def _struct(
        self, parts: Iterator[tuple[int, memoryview]], shape: list[int], depth: int
    ) -> list[dict[str, MatValue]]:
        width = self.integers(next(parts))[0]
        packed = bytes(next(parts)[1])
        if not 1 <= width <= 1024 or not 0 < len(packed) <= width * _MOST_FIELDS:
            raise _DamagedError("a struct has no fields, or too many")
        names = [_text(memoryview(packed[k : k + width])) for k in range(0, len(packed) // width * width, width)]
        count = prod(shape)
        if not names or count * len(names) > _MOST_ENTRIES:
            raise _DamagedError("a struct array is too large")
        out = []
        for _ in range(count):
            out.append({name: self._field(next(parts), depth) for name in names})
        return out

    def _field(self, element: tuple[int, memoryview], depth: int) -> MatValue:
        kind, data = element
        if kind != _MATRIX:
            raise _DamagedError("a field of a struct is no matrix")
        return self.matrix(data, depth + 1)[2] if len(data) else None


def read_mat(path: Path) -> MatFile:
    """The variables of a file."""
    data = read_bytes(path, _MOST_BYTES)
    if data[:8] == b"\x89HDF\r\n\x1a\n" or b"MATLAB 7.3" in data[:_HEADER]:
        raise InputError(f"{path}: is of MATLAB's version 7.3 (HDF5), which is not read.", "Save it with '-v7'.")
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None or unpack_from(f"{order}H", data, 124)[0] >> 8 != 1:
        raise InputError(f"{path}: is no .mat file of version 5 to 7.", "Save it with '-v7'.")
    reader, left = _Reader(order), _MOST_UNPACKED
    values: dict[str, MatValue] = {}
    objects: list[str] = []
    try:
        for element in reader.elements(memoryview(data)[_HEADER:]):
            kind, content = element
            if kind == _COMPRESSED:
                unpacked = _unpacked(content, left)
                left -= len(unpacked)
                kind, content = next(reader.elements(memoryview(unpacked)), (0, content))
            if kind != _MATRIX:
                continue
            name, own, value = reader.matrix(content)
            values[name] = value
            objects += [name] if own in _OBJECTS else []
    except _DamagedError as error:
        raise InputError(f"{path}: is damaged: {error}.") from None
    return MatFile(values, tuple(objects))


def _unpacked(body: memoryview, most: int) -> bytes:
    """A compressed element, so that a small file cannot take much memory."""
    unpacker = zlib.decompressobj()
    try:
        out = unpacker.decompress(body, max(most, 1))
    except zlib.error as error:
        raise _DamagedError(str(error)) from None
    if unpacker.unconsumed_tail:
        raise _DamagedError(f"it holds more than {_MOST_UNPACKED >> 20} MB, as no calibration does")
    return out


def _text(data: memoryview) -> str:
    return bytes(data).split(b"\0", 1)[0].decode("latin-1")


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


MATLAB = ImportFormat("matlab", "MATLAB .mat", ("mm", "m"), read_matlab)
