"""The rig as a scene: cameras, points coloured by their residuals, the volume they fill."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray

# From small to large residuals, told apart by colour-blind readers and in grey; on light and on dark ground.
_LIGHT = ((0x5B, 0x8D, 0xB8), (0xC9, 0x8A, 0x2B), (0xA6, 0x1E, 0x12))
_DARK = ((0x4F, 0x9F, 0xD8), (0xFF, 0xC0, 0x55), (0xFF, 0x6A, 0x5E))

AXIS_TINTS = ("#d0443a", "#2f9e5f", "#2b7fd0")  # x red, y green, z blue, as everywhere


@dataclass(frozen=True, eq=False)
class SceneData:
    """`scene` (report.rig_view), `points` (n, 3) in its frame, `sizes` (n,) of their residuals, 1 = the largest.

    `map_places` (m, 3) and `map_mm` (m,): what a length there is measured to in its worst direction, `map_k` the
    coverage factor and `map_length_mm` the length; `links`: steps of the paths by which the cameras were joined.
    """

    scene: Any
    points: FloatArray
    sizes: FloatArray
    map_places: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    map_mm: FloatArray = field(default_factory=lambda: np.empty(0))
    map_length_mm: float = 0.0
    map_k: float = 0.0
    links: tuple[tuple[str, str], ...] = ()

    @property
    def link_ends(self) -> list[tuple[FloatArray, FloatArray]]:
        """The centres of the two cameras of each link."""
        centres = {camera.id: camera.centre for camera in self.scene.cameras}
        return [(centres[a], centres[b]) for a, b in self.links if a in centres and b in centres]

    @property
    def reference_axes(self) -> list[tuple[tuple[FloatArray, FloatArray], str]]:
        """The axes x, y, z of the reference camera, which are those of the world: both ends, and the colour."""
        camera = next((one for one in self.scene.cameras if one.id == getattr(self.scene, "reference", None)), None)
        if camera is None:
            return []
        tips = zip(self.scene.axis_tips(camera), AXIS_TINTS, strict=True)
        return [((camera.centre, np.asarray(tip)), tint) for tip, tint in tips]

    @property
    def map_range(self) -> tuple[float, float]:
        """The least and the largest uncertainty, mm."""
        return (float(self.map_mm.min()), float(self.map_mm.max())) if len(self.map_mm) else (0.0, 1.0)

    def map_tints(self, dark: bool) -> list[tuple[int, int, int]]:
        """The colours of the map's places."""
        low, high = self.map_range
        return _mixed((self.map_mm - low) / ((high - low) or 1.0), dark)

    def tints(self, dark: bool) -> list[tuple[int, int, int]]:
        """The colours of the points."""
        return _mixed(self.sizes, dark)

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


def _mixed(sizes: FloatArray, dark: bool) -> list[tuple[int, int, int]]:
    """Colours for sizes from 0 to 1."""
    table = np.array(_DARK if dark else _LIGHT, dtype=float)
    where = np.clip(sizes, 0, 1) * 2
    low = np.minimum(where.astype(int), 1)
    mixed = table[low] + (where - low)[:, None] * (table[low + 1] - table[low])
    return [(int(r), int(g), int(b)) for r, g, b in mixed]


def scene_data(result: Any, links: tuple[tuple[str, str], ...] = (), most: int = 6000) -> SceneData | None:
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
    shown = SceneData(scene, (xyz[keep] - middle) @ scene.axes.T, sizes[keep] / (usual or 1.0), links=links)
    lengths = result.rig.length_map
    if lengths is None:
        return shown
    worst = np.where(np.isfinite(lengths.expanded_mm), lengths.expanded_mm, -1.0).max(axis=1)
    seen = worst >= 0
    return replace(
        shown, map_places=(lengths.places_mm[seen] - middle) @ scene.axes.T, map_mm=worst[seen],
        map_length_mm=lengths.length_mm, map_k=lengths.coverage_factor,
    )  # fmt: skip


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
