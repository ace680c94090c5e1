"""A rig as the files of other programs have it: cameras, poses and names that every format can hold."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from spherecal.base.arrays import ByValue, FloatArray
from spherecal.base.errors import InputError
from spherecal.geometry import opencv
from spherecal.geometry.camera import is_fisheye, project
from spherecal.geometry.field_table import FieldTable
from spherecal_files.json_file import JsonValue

Unit = Literal["mm", "m"]
# What Windows takes for devices, whatever the ending.
_RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{i}" for port in ("com", "lpt") for i in range(1, 10))}
_LONGEST_NAME = 40
MM_PER: dict[str, float] = {"mm": 1.0, "m": 1000.0}


@dataclass(frozen=True, eq=False, repr=False)
class Pose(ByValue):
    """`x_camera = rotation @ x_world + translation`, lengths in the file's unit."""

    rotation: FloatArray
    translation: FloatArray

    def matrix(self) -> FloatArray:
        """The pose as 4x4 matrix: world to camera."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.translation
        return matrix

    def inverse(self) -> "Pose":
        """Camera to world."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)


@dataclass(frozen=True, eq=False, repr=False)
class FileCamera(ByValue):
    """A camera of a file; intrinsics (16,) in our order and pixel convention, `None` for what the file does not say."""

    id: str
    image_size: tuple[int, int] | None
    intrinsics: FloatArray
    pose: Pose | None
    serial: str | None = None
    field: FieldTable | None = None

    @property
    def fisheye(self) -> bool:
        """Whether the lens follows the fisheye model."""
        return bool(is_fisheye(self.intrinsics))

    @property
    def size(self) -> tuple[int, int]:
        """The image size of a camera that is known to have one."""
        assert self.image_size is not None
        return self.image_size

    @property
    def placed(self) -> Pose:
        """The pose of a camera that is known to have one."""
        assert self.pose is not None
        return self.pose

    def project(self, world: FloatArray) -> FloatArray:
        """Image points (n, 2) of points (n, 3) in the world, in the file's unit."""
        pose = self.placed
        return project(world @ pose.rotation.T + pose.translation, self.intrinsics)


@dataclass(frozen=True)
class Reading(Sequence[FileCamera]):
    """The cameras of a file, and what else it says."""

    cameras: tuple[FileCamera, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)  # by name with why they are no part of the rig
    unit: Unit | None = None  # of lengths, where the file itself shows it
    notes: tuple[str, ...] = ()

    @overload
    def __getitem__(self, index: int) -> FileCamera: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[FileCamera]: ...
    def __getitem__(self, index: int | slice) -> FileCamera | Sequence[FileCamera]:
        return self.cameras[index]

    def __len__(self) -> int:
        return len(self.cameras)


@dataclass(frozen=True)
class FileRig:
    """What a format writes: cameras, whose frame is the world, unit, where it comes from, whom it counts from."""

    cameras: tuple[FileCamera, ...]
    reference: str | None
    unit: Unit
    source: str
    first: str | None = None

    def reference_first(self) -> tuple[FileCamera, ...]:
        """The cameras with the reference first: for formats whose world is the frame of camera 0."""
        return tuple(sorted(self.cameras, key=lambda camera: camera.id != (self.reference or self.first)))

    def ids(self) -> list[str]:
        """The cameras' ids."""
        return [camera.id for camera in self.cameras]

    def safe_names(self, letter_first: bool = False) -> list[str]:
        """Names for the cameras that are fit for files, ROS frames and images."""
        return safe_names(self.ids(), letter_first)


def distortion(camera: FileCamera, lengths: Sequence[int]) -> list[float]:
    """The distortion numbers in OpenCV's order, cut to the shortest of `lengths` that loses nothing; fisheye: four."""
    if camera.fisheye:
        return camera.intrinsics[4:8].tolist()
    numbers = camera.intrinsics[4:]
    used = 0 if not numbers.any() else int(np.flatnonzero(numbers)[-1]) + 1
    return numbers[: min(length for length in lengths if length >= used)].tolist()


def lens_vector(matrix: ArrayLike, coefficients: ArrayLike, fisheye: bool, where: str = "the file") -> FloatArray:
    """The 16 intrinsics of K (3, 3) px and OpenCV's coefficients; InputError for what no lens of ours can be."""
    given, numbers = np.asarray(matrix, dtype=float), np.asarray(coefficients, dtype=float).ravel()
    if given.shape == (3, 3) and given[0, 1] != 0:
        raise InputError(f"{where}: its pixels are skewed by {given[0, 1]:g} px, which no lens model here has.")
    if not (given.shape == (3, 3) and min(given[0, 0], given[1, 1]) > 0):
        raise InputError(f"{where}: its focal lengths are not both above 0, so it is not calibrated.")
    if len(numbers) == opencv.TILTED_LENGTH:
        if numbers[12:].any():
            raise InputError(f"{where}: its 14 coefficients describe a tilted sensor, which no lens model here has.")
        numbers = numbers[:12]  # a sensor that could be tilted and is not
    if len(numbers) and opencv.distortion_problem(len(numbers), fisheye) is not None:
        counts = "a fisheye lens has 4" if fisheye else "OpenCV's lenses have 4, 5, 8, 12 or 14"
        raise InputError(f"{where}: has {len(numbers)} distortion coefficients, but {counts}.")
    return opencv.lens_vector(given, numbers, fisheye, where)


def flat(value: JsonValue) -> list[float]:
    """Numbers given as a list, a row or a column: OpenCV's functions return all three."""
    return [n for item in value.items() for n in (flat(item) if isinstance(item.value, list) else [item.number()])]


def safe_names(ids: Sequence[str], letter_first: bool = False) -> list[str]:
    """Different names of letters, digits and "_" for camera ids: fit for file names, ROS frames and image names."""
    names: list[str] = []
    taken: set[str] = set()
    for text in ids:
        name = re.sub(r"[^A-Za-z0-9_]", "_", text)[:_LONGEST_NAME]
        if name.lower() in _RESERVED or (letter_first and not name[0].isalpha()):
            name = f"cam_{name}"
        base, count = name, 2
        while name.lower() in taken:  # lower: file names differ by more than capitals on every system
            name, count = f"{base}_{count}", count + 1
        taken.add(name.lower())
        names.append(name)
    return names


def number(value: float) -> str:
    """A number that is read back unchanged, with a point: YAML 1.1 takes "1e-05" for a text."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def numbers(values: FloatArray | Sequence[float], separator: str = ", ") -> str:
    """Numbers on one line, each read back unchanged."""
    return separator.join(number(value) for value in np.asarray(values, dtype=float).ravel())


def rows(matrix: FloatArray) -> str:
    """A matrix as nested lists on one line, as JSON, TOML, YAML and Python read it."""
    return "[" + ", ".join(f"[{numbers(row)}]" for row in matrix) + "]"
