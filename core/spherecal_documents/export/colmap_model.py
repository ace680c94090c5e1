"""A COLMAP model's tables, text (colmap.github.io/format.html) or binary (little endian, counts 64 bits, ids 32)."""

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal_documents.export.file_cameras import Pose
from spherecal_files.json_file import MOST_CAMERAS, decode, read_bytes

# 100,000 images' lines; points2D, which are not needed here, make the file of a large reconstruction longer.
_MOST_BYTES = 256 << 20
# By COLMAP's number of the model.
_MODELS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION",
    "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM", "EQUIRECTANGULAR",
)  # fmt: skip


@dataclass(frozen=True)
class ModelCamera:
    """A row of cameras: where it stands, model, image size, parameters (n,)."""

    where: str
    number: int
    model: str
    size: tuple[int, int]
    parameters: FloatArray


@dataclass(frozen=True)
class ModelImage:
    """A row of images: pose world to camera."""

    camera: int
    pose: Pose
    name: str


@dataclass(frozen=True)
class ModelRig:
    """A row of rigs: the reference camera, and the others' poses from it (None where not known)."""

    reference: int
    others: Mapping[int, Pose | None]


def read_model_cameras(folder: Path, counts: Mapping[str, int]) -> list[ModelCamera]:
    """The cameras; `counts` has how many parameters each model has that can be used."""
    path = _table(folder, "cameras")
    cameras = list((_text_cameras if path.suffix == ".txt" else _binary_cameras)(path, counts))
    if len(cameras) > MOST_CAMERAS:  # 200,000 took over a minute
        raise InputError(f"{path}: has more than {MOST_CAMERAS} cameras.")
    return cameras


def read_model_images(folder: Path) -> Iterator[ModelImage]:
    """The images; none where there is no such file."""
    path = _table(folder, "images")
    if path.is_file():
        yield from (_text_images if path.suffix == ".txt" else _binary_images)(path)


def read_model_rigs(folder: Path) -> list[ModelRig]:
    """The rigs of more than one camera."""
    path = _table(folder, "rigs")
    if not path.is_file():
        return []
    rigs = _text_rigs(path) if path.suffix == ".txt" else _binary_rigs(path)
    return [rig for rig in rigs if rig.others]


def _table(folder: Path, name: str) -> Path:
    binary = folder / f"{name}.bin"
    return binary if binary.is_file() and not (folder / f"{name}.txt").is_file() else folder / f"{name}.txt"


def _pose(where: str, seven: Sequence[float] | FloatArray) -> Pose:
    values = np.array(seven, dtype=float)
    if not np.isfinite(values).all() or not np.linalg.norm(values[:4]) > 0:
        raise InputError(f"{where}: the quaternion is zero, or not finite.")
    return Pose(Rotation.from_quat(values[[1, 2, 3, 0]]).as_matrix(), values[4:])


def _lines(path: Path) -> list[tuple[int, str]]:
    return list(enumerate(decode(path, read_bytes(path, _MOST_BYTES)).splitlines(), 1))


def _numbers(where: str, texts: Sequence[str], count: int) -> FloatArray:
    try:
        values = np.array([float(text) for text in texts])
    except ValueError:
        raise InputError(f"{where}: a number was expected, but it says otherwise.") from None
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(f"{where} must have {count} finite numbers here, but has {len(values)}.")
    return values


def _refuse_model(where: str, model: str, counts: Mapping[str, int]) -> None:
    if model not in counts:
        raise InputError(f'{where}: the camera model "{model}" cannot be used.', f"Usable: {', '.join(counts)}.")


def _text_cameras(path: Path, counts: Mapping[str, int]) -> Iterator[ModelCamera]:
    for line, text in _lines(path):
        row = text.split()
        if not row or row[0].startswith("#"):
            continue
        where, model = f"{path}: line {line}", row[1] if len(row) > 1 else ""
        _refuse_model(where, model, counts)
        number, width, height, *parameters = _numbers(where, [row[0], *row[2:]], 3 + counts[model])
        yield ModelCamera(where, int(number), model, (int(width), int(height)), np.array(parameters))


def _text_images(path: Path) -> Iterator[ModelImage]:
    lines = iter(_lines(path))
    for line, text in lines:
        if not text.strip() or text.startswith("#"):
            continue
        row, where = text.split(maxsplit=9), f"{path}: line {line}"
        if len(row) < 10:
            raise InputError(f"{where} has too few values for an image.")
        values = _numbers(where, row[1:9], 8)
        yield ModelImage(int(values[7]), _pose(where, values[:7]), row[9].strip())
        next(lines, None)  # the image's points: a line that may be empty


def _text_rigs(path: Path) -> list[ModelRig]:
    rigs = []
    for line, text in _lines(path):
        row, where = text.split(), f"{path}: line {line}"
        if not row or row[0].startswith("#"):
            continue
        try:
            reference, rest, others = (int(row[3]) if row[2] == "CAMERA" else -1), row[4:], {}
            while rest:
                known = rest[2] == "1"
                if rest[0] == "CAMERA":
                    others[int(rest[1])] = _pose(where, _numbers(where, rest[3:10], 7)) if known else None
                rest = rest[10 if known else 3 :]
        except (IndexError, ValueError):
            raise InputError(f"{where} is not a rig of COLMAP's.") from None
        rigs.append(ModelRig(reference, others))
    return rigs


class _Bytes:
    """A binary file, read from front to back."""

    def __init__(self, path: Path) -> None:
        self._path, self._data, self._at = path, read_bytes(path, _MOST_BYTES), 0

    def take(self, form: str) -> tuple:
        """The next values, as `struct` describes them."""
        form = f"<{form}"
        size = struct.calcsize(form)
        if self._at + size > len(self._data):
            raise InputError(f"{self._path}: ends too early for a model of COLMAP's.")
        self._at += size
        return struct.unpack_from(form, self._data, self._at - size)

    def text(self) -> str:
        """The next text, up to its zero."""
        end = self._data.find(b"\0", self._at)
        if end < 0:
            raise InputError(f"{self._path}: ends too early for a model of COLMAP's.")
        self._at, begin = end + 1, self._at
        return self._data[begin:end].decode("utf-8", errors="replace")

    def skip(self, count: int) -> None:
        """Leave out bytes."""
        self.take(f"{count}x") if count < len(self._data) else self.take(f"{len(self._data) + 1}x")

    def rows(self, read: Callable[["_Bytes"], object]) -> Iterator:
        """What `read` makes of each of the rows whose count comes first."""
        for _ in range(self.take("Q")[0]):
            yield read(self)


def _binary_cameras(path: Path, counts: Mapping[str, int]) -> Iterator[ModelCamera]:
    def read(data: _Bytes) -> ModelCamera:
        number, model, width, height = data.take("IiQQ")
        where = f"{path}: camera {number}"
        name = _MODELS[model] if 0 <= model < len(_MODELS) else f"number {model}"
        _refuse_model(where, name, counts)
        parameters = _numbers(where, data.take(f"{counts[name]}d"), counts[name])
        return ModelCamera(where, number, name, (width, height), parameters)

    return _Bytes(path).rows(read)


def _binary_images(path: Path) -> Iterator[ModelImage]:
    def read(data: _Bytes) -> ModelImage:
        image, *seven, camera = data.take("I7dI")
        name = data.text()
        data.skip(24 * data.take("Q")[0])
        return ModelImage(camera, _pose(f"{path}: image {image}", seven), name)

    return _Bytes(path).rows(read)


def _binary_rigs(path: Path) -> list[ModelRig]:
    camera_kind = 0

    def read(data: _Bytes) -> ModelRig:
        number, sensors = data.take("II")
        if sensors == 0:
            return ModelRig(-1, {})
        kind, reference = data.take("iI")
        others: dict[int, Pose | None] = {}
        for _ in range(sensors - 1):
            own, sensor, known = data.take("iIB")
            pose = _pose(f"{path}: rig {number}", data.take("7d")) if known else None
            if own == camera_kind:
                others[sensor] = pose
        return ModelRig(reference if kind == camera_kind else -1, others)

    return list(_Bytes(path).rows(read))
