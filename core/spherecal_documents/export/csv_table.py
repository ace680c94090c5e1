"""A flat table, one row a camera, for spreadsheets: poses world to camera, and the camera's centre in the world."""

import csv
from collections.abc import Mapping
from io import StringIO
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.files.cells import cell, from_cell
from spherecal.files.json_file import check_lines, decode, read_bytes
from spherecal.geometry.camera import FISHEYE_MARK, FISHEYE_NAMES, INTRINSIC_NAMES
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, number
from spherecal_documents.export.format import Format

_ROTATION = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
_SHIFT, _CENTRE = ("tx_mm", "ty_mm", "tz_mm"), ("centre_x_mm", "centre_y_mm", "centre_z_mm")
_SIZE = ("width_px", "height_px")
_MODEL, _FISHEYE = "lens_model", "opencv-fisheye"  # the column is there where any lens is fisheye
_MOST_BYTES = 8 << 20


def _write(rig: FileRig) -> Mapping[str, str]:
    text = StringIO()
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
        rows = list(csv.DictReader(StringIO(decode(path, data))))
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


FORMAT = Format("csv", "table for spreadsheets", 12, ("mm",), _write, _read, fisheye=True)
