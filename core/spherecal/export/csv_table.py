"""A flat table, one row a camera, for spreadsheets: poses world to camera, and the camera's centre in the world."""

import csv
from collections.abc import Mapping
from io import StringIO
from pathlib import Path

import numpy as np

from spherecal.errors import InputError
from spherecal.export.cameras import FileCamera, FileRig, Pose, number
from spherecal.export.format import Format
from spherecal.geometry.camera import INTRINSIC_NAMES
from spherecal.session.json_file import decode, read_bytes

_ROTATION = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
_SHIFT, _CENTRE = ("tx_mm", "ty_mm", "tz_mm"), ("centre_x_mm", "centre_y_mm", "centre_z_mm")
_SIZE = ("width_px", "height_px")
_MOST_BYTES = 8 << 20


def _write(rig: FileRig) -> Mapping[str, str]:
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("camera", "serial", *_SIZE, *INTRINSIC_NAMES, *_ROTATION, *_SHIFT, *_CENTRE))
    for camera in rig.cameras:
        pose = camera.placed
        values = (camera.intrinsics, pose.rotation.ravel(), pose.translation, pose.inverse().translation)
        table.writerow((camera.id, camera.serial or "", *camera.size, *map(number, np.concatenate(values))))
    return {"": text.getvalue()}


def _read(path: Path) -> list[FileCamera]:
    cameras = []
    try:
        rows = list(csv.DictReader(StringIO(decode(path, read_bytes(path, _MOST_BYTES)))))
    except csv.Error as error:
        raise InputError(f"{path}: is not a table of cameras as this program writes it ({error}).") from None
    for row in rows:
        try:
            lens, rotation, shift = (
                np.array([float(row[key]) for key in keys]) for keys in (INTRINSIC_NAMES, _ROTATION, _SHIFT)
            )
            size = int(row[_SIZE[0]]), int(row[_SIZE[1]])
            name, serial = row["camera"], row["serial"] or None
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{path}: is not a table of cameras as this program writes it.") from None
        cameras.append(FileCamera(name, size, lens, Pose(rotation.reshape(3, 3), shift), serial))
    return cameras


FORMAT = Format("csv", "table for spreadsheets", 12, ("mm",), _write, _read)
