"""The dots of every set that was taken, kept beside the project."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spherecal_gui.presenters.coverage import Dots


class DotStore:
    """The dots of each set that was taken, on disk beside the project, so that counters survive a crash."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "wizard"

    def save(self, set_id: str, taken: str, dots: Mapping[str, Dots]) -> None:
        """Keep the dots of a set; where the disk refuses they are found again in the images."""
        arrays: dict[str, Any] = {"taken": np.array(taken)}
        for camera, one in dots.items():
            arrays |= {f"{camera}/{key}": getattr(one, key) for key in ("target", "point", "uv")}
            arrays[f"{camera}/size"] = np.array(one.image_size)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with (self._folder / f"{set_id}.npz").open("wb") as file:
                np.savez(file, **arrays)
        except OSError:
            return

    def load(self, set_id: str, taken: str) -> dict[str, Dots] | None:
        """The dots of this taking of a set; None where there are none."""
        path = self._folder / f"{set_id}.npz"
        try:
            with np.load(path, allow_pickle=False) as kept:
                if str(kept["taken"]) != taken:
                    return None
                cameras = {key.rsplit("/", 1)[0] for key in kept.files if "/" in key}
                return {camera: _kept(kept, camera) for camera in sorted(cameras)}
        except (OSError, ValueError, KeyError):
            return None


def _kept(kept: Any, camera: str) -> Dots:
    width, height = kept[f"{camera}/size"]
    target, point, uv = (kept[f"{camera}/{key}"] for key in ("target", "point", "uv"))
    return Dots(target, point, uv, (int(width), int(height)))
