"""The rig as a scene: cameras, points coloured by their residuals, the volume they fill."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from spherecal.arrays import FloatArray

# From small to large residuals, told apart by colour-blind readers and in grey; on light and on dark ground.
_LIGHT = ((0x5B, 0x8D, 0xB8), (0xC9, 0x8A, 0x2B), (0xA6, 0x1E, 0x12))
_DARK = ((0x4F, 0x9F, 0xD8), (0xFF, 0xC0, 0x55), (0xFF, 0x6A, 0x5E))


@dataclass(frozen=True, eq=False)
class SceneData:
    """`scene` (report.rig_view), `points` (n, 3) in its frame, `sizes` (n,) of their residuals, 1 = the largest."""

    scene: Any
    points: FloatArray
    sizes: FloatArray

    def tints(self, dark: bool) -> list[tuple[int, int, int]]:
        """The colours of the points."""
        table = np.array(_DARK if dark else _LIGHT, dtype=float)
        where = np.clip(self.sizes, 0, 1) * 2
        low = np.minimum(where.astype(int), 1)
        mixed = table[low] + (where - low)[:, None] * (table[low + 1] - table[low])
        return [(int(r), int(g), int(b)) for r, g, b in mixed]

    def box(self) -> tuple[float, float, float, float, float, float]:
        """The box that holds 98 % of the points along each axis: x0 x1 y0 y1 z0 z1."""
        low, high = np.percentile(self.points, (1, 99), axis=0) if len(self.points) else (np.zeros(3), np.ones(3))
        return (low[0], high[0], low[1], high[1], low[2], high[2])

    def flat(self, side: str, places: FloatArray) -> FloatArray:
        """Places in the plane of a view."""
        from spherecal.report.rig_view import FRONT, OBLIQUE, SIDE, TOP

        view = {"oblique": OBLIQUE, "top": TOP, "front": FRONT, "side": SIDE}[side]
        return view.flat(np.asarray(places))

    def extent(self, side: str) -> tuple[FloatArray, FloatArray]:
        """Least and largest place of all that is shown, in the plane of a view."""
        parts = [np.vstack([camera.centre, camera.corners]) for camera in self.scene.cameras] + [self.points]
        flat = np.vstack([self.flat(side, part) for part in parts if len(part)])
        return flat.min(axis=0), flat.max(axis=0)


def scene_data(result: Any, most: int = 6000) -> SceneData | None:
    """The scene of a result (report.result_folder); None without cameras."""
    from spherecal.report.rig_view import make_scene

    if not result.rig.cameras:
        return None
    scene = make_scene(result)
    xyz = result.points.xyz_mm
    middle = xyz.mean(axis=0) if len(xyz) else np.array([c.centre_mm for c in result.rig.cameras]).mean(axis=0)
    sizes = point_residuals(result)
    keep = np.arange(0, len(xyz), max(1, -(-len(xyz) // most)))
    usual = float(np.percentile(sizes, 98)) if len(sizes) else 1.0
    return SceneData(scene, (xyz[keep] - middle) @ scene.axes.T, sizes[keep] / (usual or 1.0))


def point_residuals(result: Any) -> FloatArray:
    """The rms residual (n,) px of every point over the images that were used, 0 where there are none."""
    points, table = result.points, result.residuals
    row = {key: i for i, key in enumerate(zip(points.placement, points.target.tolist(), points.point, strict=True))}
    keys = zip(table.placement, table.target.tolist(), table.point, strict=True)
    at = np.array([row.get(key, -1) for key in keys], dtype=np.int64)
    take = (at >= 0) & table.used
    square = np.bincount(at[take], (table.du_dv[take] ** 2).sum(axis=1), len(row))
    count = np.bincount(at[take], minlength=len(row))
    return np.sqrt(square / np.maximum(count, 1))
