"""What lenses and mounts do that no model has: the field of each lens, and how each camera turned over the placements.

As the result has them (rig.json, image_motions.csv), for pictures with one sentence each.
"""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QCoreApplication

from spherecal.base.arrays import FloatArray

if TYPE_CHECKING:
    from spherecal.data.rig import Rig

translate = QCoreApplication.translate
MOTIONS = "image_motions.csv"


@dataclass(frozen=True, eq=False)
class CameraEffect:
    """One camera: size (rows, columns) px of its lens's field, None without one, and how far each image is turned.

    `drift_px` (n,): of the placements, half-way between the axis and the corners.
    """

    camera: str
    field_px: FloatArray | None
    drift_px: FloatArray

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
        size = None if field is None else np.hypot(field.du, field.dv)
        own = np.array(turns.get(camera.id, [])).reshape(-1, 3)
        across = np.array([camera.intrinsics[1], camera.intrinsics[0], np.hypot(*camera.image_size) / 4])
        found.append(CameraEffect(camera.id, size, np.linalg.norm(np.deg2rad(own) * across, axis=1)))
    return tuple(found) if any(one.field_px is not None or len(one.drift_px) for one in found) else ()


def field_text(effects: tuple[CameraEffect, ...]) -> str:
    """What the maps show."""
    worst = max(effects, key=lambda one: one.field_rms_px)
    if worst.field_px is None:
        return translate("Effects", "Every lens does what its model says.")
    text = translate("Effects", "The lens of {camera} is farthest from its model: {px:.3f} px. It is corrected.")
    return text.format(camera=worst.camera, px=worst.field_rms_px)


def drift_text(effects: tuple[CameraEffect, ...]) -> str:
    """What the lines show."""
    moving = [one for one in effects if len(one.drift_px) and one.drift_px.any()]
    if not moving:
        return translate("Effects", "No camera turned over the placements.")
    worst = max(moving, key=lambda one: float(one.drift_px.max()))
    text = translate("Effects", "{camera} turned most over the placements: {px:.2f} px. Look at its mount and cable.")
    return text.format(camera=worst.camera, px=float(worst.drift_px.max()))
