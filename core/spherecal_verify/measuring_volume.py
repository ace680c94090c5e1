"""The box of the measuring volume and its seven lines, those of VDI/VDE 2634 part 1: three edges, four diagonals."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.data.rig import Rig

LINES = 7
LEAST_LENGTHS = 5  # test lengths on a line (VDI/VDE 2634-1)
_DIAGONALS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]], dtype=float)


@dataclass(frozen=True)
class MeasuringVolume:
    """The volume: its middle (3,), its axes as rows (3, 3), half its sides (3,), mm in the rig's world."""

    middle: FloatArray
    axes: FloatArray
    half: FloatArray

    @property
    def diagonal_mm(self) -> float:
        """The length of the space diagonal."""
        return 2 * float(np.linalg.norm(self.half))

    @property
    def sides_mm(self) -> FloatArray:
        """The three sides (3,), shortest first."""
        return np.sort(2 * self.half)

    def point(self, unit: FloatArray) -> FloatArray:
        """A place (3,) in mm in the world, given in half sides from the middle."""
        return self.middle + (unit * self.half) @ self.axes

    def unit(self, place_mm: FloatArray) -> FloatArray:
        """Half sides from the middle to places (..., 3)."""
        return (place_mm - self.middle) @ self.axes.T / self.half

    def directions(self) -> FloatArray:
        """The seven lines' directions (7, 3) in the world, of length 1: three edges, then four space diagonals."""
        along = np.vstack([np.eye(3), _DIAGONALS * self.half])
        return (along / np.linalg.norm(along, axis=1, keepdims=True)) @ self.axes


def volume_box(rig: Rig, corners_mm: tuple[FloatArray, FloatArray]) -> MeasuringVolume:
    """The box to verify: that of the rig's map of lengths, with its axes, else the box between two corners (3,)."""
    found = rig.length_map
    if found is not None and len(found.places_mm) > 1 and len(found.directions) >= 3:
        middle, axes = found.places_mm.mean(axis=0), found.directions[:3]
        half = np.abs((found.places_mm - middle) @ axes.T).max(axis=0)
        if np.abs(axes @ axes.T - np.eye(3)).max() < 1e-3 and half.min() > 0:
            return MeasuringVolume(middle, axes, half)
    low, high = corners_mm
    return MeasuringVolume((low + high) / 2, np.eye(3), np.maximum((high - low) / 2, 1e-6))
