"""The dots of every set that was taken, kept beside the project."""

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.errors import SpherecalError
from spherecal_files.filesystem import read_below, write_below
from spherecal_gui.coverage import Dots

# Ten thousand dots in each of a hundred cameras are 36 MB.
_MOST_BYTES = 64 << 20


class DotStore:
    """The dots of each set that was taken, on disk beside the project, so that counters survive a crash."""

    def __init__(self, folder: Path) -> None:
        self._root = folder

    def save(self, set_id: str, taken: str, dots: Mapping[str, Dots]) -> None:
        """Keep the dots of a set; where the disk refuses they are found again in the images."""
        arrays: dict[str, Any] = {"taken": np.array(taken)}  # Any: savez has a keyword that is no array
        for camera, one in dots.items():
            arrays |= {f"{camera}/{key}": getattr(one, key) for key in ("target", "point", "uv")}
            arrays[f"{camera}/size"] = np.array(one.image_size)
        try:
            data = io.BytesIO()
            np.savez(data, **arrays)
            write_below(self._root, f"wizard/{set_id}.npz", data.getvalue())
        except SpherecalError:
            return

    def load(self, set_id: str, taken: str) -> dict[str, Dots] | None:
        """The dots of this taking of a set; None where there are none."""
        try:
            data = read_below(self._root, f"wizard/{set_id}.npz", _MOST_BYTES)
            with zipfile.ZipFile(io.BytesIO(data)) as packed:
                if sum(one.file_size for one in packed.infolist()) > _MOST_BYTES:
                    return None
            with np.load(io.BytesIO(data), allow_pickle=False) as kept:
                if str(kept["taken"]) != taken:
                    return None
                cameras = {key.rsplit("/", 1)[0] for key in kept.files if "/" in key}
                return {camera: _kept(kept, camera) for camera in sorted(cameras)}
        except (SpherecalError, OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
            return None  # not ours, or damaged: the dots are found again in the images


def _kept(kept: Mapping[str, np.ndarray], camera: str) -> Dots:
    width, height = kept[f"{camera}/size"]
    target, point, uv = (kept[f"{camera}/{key}"] for key in ("target", "point", "uv"))
    return Dots(target, point, uv, (int(width), int(height)))
