"""Undistortion maps for `cv2.remap`: a file a camera that holds all that its lens does, its field too."""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.json_file import read_bytes
from spherecal.geometry.camera import N_INTRINSICS, camera_matrix, distort
from spherecal.geometry.field_table import FieldTable
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose
from spherecal_documents.export.format import Format

_MOST_BYTES = 1 << 30
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


def _maps(camera: FileCamera) -> NDArray[np.float32]:
    """Recorded pixels (h, w, 2) of those of the camera without distortion and with the same K, float32."""
    width, height = camera.size
    fu, fv, u0, v0 = camera.intrinsics[:4]
    out = np.empty((height, width, 2), dtype=np.float32)
    x = (np.arange(width) - u0) / fu
    for row in range(height):
        xy = np.column_stack([x, np.full(width, (row - v0) / fv)])
        uv = distort(xy, camera.intrinsics) * camera.intrinsics[:2] + camera.intrinsics[2:4]
        out[row] = uv if camera.field is None else camera.field.measured(uv)
    return out


def _write(rig: FileRig) -> Mapping[str, bytes]:
    files = {}
    for camera, name in zip(rig.cameras, rig.safe_names(), strict=True):
        maps, file = _maps(camera), io.BytesIO()
        pose = camera.placed
        np.savez_compressed(
            file,
            map_u=maps[:, :, 0],
            map_v=maps[:, :, 1],
            K=camera_matrix(camera.intrinsics),
            R=pose.rotation,
            t=pose.translation,
        )
        files[f"{name}.npz"] = file.getvalue()
    return files


def _read_camera(path: Path) -> MappedCamera:
    try:
        with np.load(io.BytesIO(read_bytes(path, _MOST_BYTES)), allow_pickle=False) as file:
            u, v, matrix, rotation, translation = (np.asarray(file[key], dtype=float) for key in _KEYS)
        lens = np.zeros(N_INTRINSICS)
        lens[:4] = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
        maps = np.stack([u, v], axis=-1)
    except (KeyError, ValueError, IndexError, OSError) as error:
        raise InputError(Phrase("error-not-maps", {"file": path, "why": str(error)})) from None
    return MappedCamera(path.stem, (maps.shape[1], maps.shape[0]), lens, Pose(rotation, translation), maps=maps)


FORMAT = Format(
    "maps",
    "undistortion maps",
    12,
    ("mm", "m"),
    _write,
    lambda folder: [_read_camera(path) for path in sorted(folder.glob("*.npz"))],
    folder=True,
    ids=FileRig.safe_names,
    fisheye=True,
    fields=True,
)
