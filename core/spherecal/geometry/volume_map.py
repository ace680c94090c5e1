"""The map of a rig's uncertainty: a length of 500 mm at places all over the volume, in seven directions each."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray, ReadOnly
from spherecal.geometry.length_uncertainty import Cameras, predict_lengths

LENGTH_MM = 500.0
COVERAGE_FACTOR = 2.0
GRID = 5
# VDI/VDE 2634 measures along the edges and the space diagonals of the volume.
_DIAGONALS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]]) / np.sqrt(3)
DIRECTIONS = np.vstack([np.eye(3), _DIAGONALS])


@dataclass(frozen=True, eq=False, repr=False)
class Volume(ByValue):
    """A box: its middle (3,), its axes as rows (3,3) and half its sides (3,), mm."""

    middle: FloatArray
    axes: FloatArray
    half: FloatArray

    def grid(self, count: int) -> FloatArray:
        """count^3 places (n,3) mm from corner to corner."""
        steps = np.linspace(-1, 1, count)
        box = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
        return self.middle + box * self.half @ self.axes


@dataclass(frozen=True, eq=False, repr=False)
class LengthMap(ReadOnly):
    """Expanded uncertainties (places, directions) in mm of a length centred at places (n,3), NaN where it is not seen.

    `sigma_px` is the noise of one dot's image that was assumed.
    """

    length_mm: float
    coverage_factor: float
    sigma_px: float
    places_mm: FloatArray
    directions: FloatArray
    expanded_mm: FloatArray

    @property
    def typical_mm(self) -> float | None:
        """The median over all places and directions where the length is seen."""
        seen = self.expanded_mm[np.isfinite(self.expanded_mm)]
        return float(np.median(seen)) if len(seen) else None

    @property
    def worst(self) -> tuple[float, FloatArray] | None:
        """The largest uncertainty and its place (3,)."""
        if not np.isfinite(self.expanded_mm).any():
            return None
        at = int(np.nanargmax(np.nanmax(np.where(np.isfinite(self.expanded_mm), self.expanded_mm, -1.0), axis=1)))
        return float(np.nanmax(self.expanded_mm[at])), self.places_mm[at]


def measured_volume(points: FloatArray, camera_centres: FloatArray) -> Volume:
    """A box about points (n,3) mm, nine tenths of their extent, its axes those of the cameras' centres (c,3) mm."""
    centred = camera_centres - camera_centres.mean(axis=0)
    axes = np.linalg.svd(centred)[2]
    axes *= np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])[:, None]  # the sign of an axis is no accident
    along = (points - points.mean(axis=0)) @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    return Volume(points.mean(axis=0) + (low + high) / 2 @ axes, axes, 0.9 * (high - low) / 2)


def length_map(cameras: Cameras, volume: Volume, sigma_px: float) -> LengthMap:
    """The map over a volume in mm."""
    places = volume.grid(GRID)
    directions = DIRECTIONS @ volume.axes
    half = LENGTH_MM / 2 * directions
    ends = np.stack([places[:, None] - half, places[:, None] + half], axis=2).reshape(-1, 2, 3)
    found = predict_lengths(cameras, ends, sigma_px)
    expanded = (COVERAGE_FACTOR * np.sqrt(found.calibration + found.own)).reshape(len(places), len(directions))
    return LengthMap(LENGTH_MM, COVERAGE_FACTOR, sigma_px, places, directions, expanded)
