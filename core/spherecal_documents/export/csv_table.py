"""A flat table for spreadsheets, and undistortion maps for `cv2.remap`."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.geometry.camera import FISHEYE_MARK, FISHEYE_NAMES, INTRINSIC_NAMES, N_INTRINSICS, camera_matrix, distort
from spherecal.geometry.field_table import FieldTable
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, number
from spherecal_documents.export.format import Format
from spherecal_files.cells import cell, from_cell
from spherecal_files.json_file import check_lines, decode, read_bytes

_ROTATION = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
_SHIFT, _CENTRE = ("tx_mm", "ty_mm", "tz_mm"), ("centre_x_mm", "centre_y_mm", "centre_z_mm")
_SIZE = ("width_px", "height_px")
_MODEL, _FISHEYE = "lens_model", "opencv-fisheye"  # the column is there where any lens is fisheye
_MOST_BYTES = 8 << 20


def _write(rig: FileRig) -> Mapping[str, str]:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    wide = any(camera.fisheye for camera in rig.cameras)
    head = ("camera", "serial", *_SIZE, *INTRINSIC_NAMES, *_ROTATION, *_SHIFT, *_CENTRE)
    table.writerow((*head, _MODEL) if wide else head)
    for camera in rig.cameras:
        pose = camera.placed
        values = (_by_name(camera), pose.rotation.ravel(), pose.translation, pose.inverse().translation)
        model = [_FISHEYE if camera.fisheye else "opencv"] if wide else []
        names = (cell(camera.id), cell(camera.serial or ""))
        table.writerow((*names, *camera.size, *map(number, np.concatenate(values)), *model))
    return {"": text.getvalue()}


def _by_name(camera: FileCamera) -> np.ndarray:
    """The lens (16,) with each number under its own name: those of a fisheye lens have other places."""
    if not camera.fisheye:
        return camera.intrinsics
    named: dict[str, float] = dict(zip(FISHEYE_NAMES, camera.intrinsics, strict=False))
    return np.array([named.get(name, 0.0) for name in INTRINSIC_NAMES])


def _fisheye_lens(by_name: np.ndarray) -> np.ndarray:
    lens = np.zeros(len(INTRINSIC_NAMES))
    lens[: len(FISHEYE_NAMES)] = [by_name[INTRINSIC_NAMES.index(name)] for name in FISHEYE_NAMES]
    lens[15] = FISHEYE_MARK
    return lens


def _read(path: Path) -> list[FileCamera]:
    cameras = []
    try:
        data = read_bytes(path, _MOST_BYTES)
        check_lines(path, data)
        rows = list(csv.DictReader(io.StringIO(decode(path, data))))
    except csv.Error as error:
        raise InputError(f"{path}: is not a table of cameras as this program writes it ({error}).") from None
    for row in rows:
        try:
            lens, rotation, translation = (
                np.array([float(row[key]) for key in keys]) for keys in (INTRINSIC_NAMES, _ROTATION, _SHIFT)
            )
            lens = _fisheye_lens(lens) if row.get(_MODEL) == _FISHEYE else lens
            size = int(row[_SIZE[0]]), int(row[_SIZE[1]])
            name, serial = from_cell(row["camera"]), from_cell(row["serial"]) or None
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{path}: is not a table of cameras as this program writes it.") from None
        cameras.append(FileCamera(name, size, lens, Pose(rotation.reshape(3, 3), translation), serial))
    return cameras


CSV = Format("csv", "table for spreadsheets", 12, ("mm",), _write, _read, fisheye=True)


_MOST_BYTES_MAPS = 1 << 30
_KEYS = ("map_u", "map_v", "K", "R", "t")


@dataclass(frozen=True)
class MappedCamera(FileCamera):
    """A camera without distortion whose `maps` (h, w, 2) give the recorded pixel of each of its own."""

    maps: FloatArray | None = None

    def project(self, world: FloatArray) -> FloatArray:
        """Recorded image points (n, 2) px of world points (n, 3); NaN beyond the maps."""
        ideal = super().project(world)
        assert self.maps is not None
        inside = np.all((ideal >= 0) & (ideal <= np.array(self.size) - 1), axis=1)
        read = FieldTable(1.0, np.zeros(2), self.maps[:, :, 0], self.maps[:, :, 1]).at(ideal)
        return np.where(inside[:, None], read, np.nan)


def _write_maps(rig: FileRig) -> Mapping[str, bytes]:
    files = {}
    for camera, name in zip(rig.cameras, rig.safe_names(), strict=True):
        width, height = camera.size
        fu, fv, u0, v0 = camera.intrinsics[:4]
        # recorded pixels of those of the camera without distortion and with the same K
        maps = np.empty((height, width, 2), dtype=np.float32)
        x = (np.arange(width) - u0) / fu
        for row in range(height):
            xy = np.column_stack([x, np.full(width, (row - v0) / fv)])
            uv = distort(xy, camera.intrinsics) * camera.intrinsics[:2] + camera.intrinsics[2:4]
            maps[row] = uv if camera.field is None else camera.field.measured(uv)
        file = io.BytesIO()
        pose = camera.placed
        np.savez_compressed(
            file, map_u=maps[:, :, 0], map_v=maps[:, :, 1], K=camera_matrix(camera.intrinsics), R=pose.rotation,
            t=pose.translation,
        )  # fmt: skip
        files[f"{name}.npz"] = file.getvalue()
    return files


def _read_camera(path: Path) -> MappedCamera:
    try:
        with np.load(io.BytesIO(read_bytes(path, _MOST_BYTES_MAPS)), allow_pickle=False) as file:
            u, v, matrix, rotation, translation = (np.asarray(file[key], dtype=float) for key in _KEYS)
        lens = np.zeros(N_INTRINSICS)
        lens[:4] = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
        maps = np.stack([u, v], axis=-1)
    except (KeyError, ValueError, IndexError, OSError) as error:
        raise InputError(Phrase("error-not-maps", {"file": path, "why": str(error)})) from None
    return MappedCamera(path.stem, (maps.shape[1], maps.shape[0]), lens, Pose(rotation, translation), maps=maps)


MAPS = Format(
    "maps",
    "undistortion maps",
    12,
    ("mm", "m"),
    _write_maps,
    lambda folder: [_read_camera(path) for path in sorted(folder.glob("*.npz"))],
    folder=True,
    ids=FileRig.safe_names,
    fisheye=True,
    fields=True,
)
