"""The correction field of a lens as a table: what its images are off the lens model."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray

# Bilinear interpolation on this pitch errs by 0.003 px (fields of 0.1 px, half a period per image); wide images have
# proportionally longer waves, so that the table has at most so many columns.
PITCH_PX, MOST_COLUMNS = 32.0, 80
# Two steps invert a field of 0.3 px to 1e-7 px; three those of several pixels.
_STEPS = 3


@dataclass(frozen=True, eq=False, repr=False)
class FieldTable(ByValue):
    """A field F (docs/conventions.md): the lens model predicts `uv - F(uv)` of the measured pixel `uv`.

    `du, dv` (rows, columns) px at the pixels `origin_px + pitch_px * (column, row)`, bilinear between them; `sd_px`
    (rows, columns): its standard uncertainty, None where unknown.
    """

    pitch_px: float
    origin_px: FloatArray
    du: FloatArray
    dv: FloatArray
    sd_px: FloatArray | None = None

    def at(self, uv: FloatArray) -> FloatArray:
        """F (n,2) px at measured pixels (n,2)."""
        return np.stack([self._read(self.du, uv), self._read(self.dv, uv)], axis=1)

    def sd_at(self, uv: FloatArray) -> FloatArray:
        """The standard uncertainty (n,) px of a coordinate at measured pixels (n,2)."""
        return np.zeros(len(uv)) if self.sd_px is None else self._read(self.sd_px, uv)

    def measured(self, predicted: FloatArray) -> FloatArray:
        """The measured pixels (n,2) that the lens model predicts at (n,2)."""
        uv = predicted
        for _ in range(_STEPS):
            uv = predicted + self.at(uv)
        return uv

    def _read(self, table: FloatArray, uv: FloatArray) -> FloatArray:
        """Bilinear values (n,) of a table; beyond its edge those of the edge, NaN at NaN."""
        at = (uv - self.origin_px) / self.pitch_px
        last = np.array([table.shape[1] - 1, table.shape[0] - 1])
        inside = np.where(np.isfinite(at), at, 0.0).clip(0, last)
        corner = np.minimum(inside.astype(np.int64), np.maximum(last - 1, 0))
        (u, v), (a, b) = corner.T, (inside - corner).T
        right, below = np.minimum(u + 1, last[0]), np.minimum(v + 1, last[1])
        upper = table[v, u] * (1 - a) + table[v, right] * a
        lower = table[below, u] * (1 - a) + table[below, right] * a
        return np.where(np.isfinite(at).all(axis=1), upper * (1 - b) + lower * b, np.nan)


def table_nodes(size: tuple[int, int]) -> tuple[float, FloatArray, tuple[int, int]]:
    """Pitch px, pixels (rows * columns, 2), and (rows, columns) of the table of an image of (width, height) px."""
    pitch = max(PITCH_PX, float(np.ceil(max(size) / MOST_COLUMNS)))
    columns, rows = (int(np.ceil((side - 1) / pitch)) + 1 for side in size)
    u, v = np.meshgrid(pitch * np.arange(columns), pitch * np.arange(rows))
    return pitch, np.column_stack([u.ravel(), v.ravel()]).astype(np.float64), (rows, columns)
