"""The field of each lens, and how each camera turned over the placements, as a result folder has them."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray

if TYPE_CHECKING:
    from spherecal.data.rig import Rig

MOTIONS = "image_motions.csv"


@dataclass(frozen=True, eq=False)
class CameraEffect:
    """What one lens and mount do that no model has."""

    camera: str
    field_px: FloatArray | None  # size of its lens's field (rows, columns); None without one
    drift_px: FloatArray  # its turn at each placement (n,), half-way between axis and corners

    @property
    def field_rms_px(self) -> float:
        """Root mean square of the field, of one coordinate."""
        return 0.0 if self.field_px is None else float(np.sqrt((self.field_px**2).mean() / 2))


def effects_of(rig: "Rig", folder: Path) -> tuple[CameraEffect, ...]:
    """Those of a result in a folder; () where neither fields nor motions were estimated."""
    turns: dict[str, list[FloatArray]] = {}
    if (folder / MOTIONS).is_file():
        with (folder / MOTIONS).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                turns.setdefault(row["camera"], []).append(np.array([float(row[f"r{axis}_deg"]) for axis in "xyz"]))
    found = []
    for camera in rig.cameras:
        field = camera.field
        size = None if field is None or not (field.du.any() or field.dv.any()) else np.hypot(field.du, field.dv)
        own = np.array(turns.get(camera.id, [])).reshape(-1, 3)
        across = np.array([camera.intrinsics[1], camera.intrinsics[0], np.hypot(*camera.image_size) / 4])
        found.append(CameraEffect(camera.id, size, np.linalg.norm(np.deg2rad(own) * across, axis=1)))
    return tuple(found) if any(one.field_px is not None or len(one.drift_px) for one in found) else ()
