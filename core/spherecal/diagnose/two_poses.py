"""Cameras that were bumped far: which of their images belong to which of two poses.

A move of a pixel and more lets the gate take what it likes, and one of many pixels bends the camera's intrinsics, so
that linear tests mislead. Here every way to part the camera's images in two is tried. Both parts are resected on the
points that the other cameras gave, with the intrinsics found and, as these may be bent, with the prior's.
"""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.image_findings import LEAST_POINTS
from spherecal.diagnose.moves import alike
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.resection import resect
from spherecal.geometry.rotation import log_rotation

# Points beyond this count as wrong. Nominal intrinsics leave residuals of 1 to 5 px.
GATE_PX = 12.0
# Two poses must fit this many times better than one (mean size of the residuals).
BETTER = 1.5


@dataclass(frozen=True)
class TwoPoseFit:
    """A camera's images in `placements` are from elsewhere, by a motion (mm); `fit_px` with one pose and with two."""

    camera: int
    placements: tuple[int, ...]
    rotation_rad: float
    translation: float
    fit_px: tuple[float, float]


def resect_two_poses(e: Evidence, camera: int) -> TwoPoseFit | None:
    """The best partition of a camera's images in two, None where one pose fits them as well."""
    both = (e.solution.state.intrinsics[camera], e.session.cameras[camera].prior)
    found = [fit for intrinsics in both if (fit := _best_partition(e, camera, intrinsics)) is not None]
    return min(found, key=lambda fit: fit.fit_px[1], default=None)


def _best_partition(e: Evidence, camera: int, intrinsics: FloatArray) -> TwoPoseFit | None:
    o, state = e.observations, e.solution.state
    points = state.points[e.features.of_observation]
    rows = np.flatnonzero((o.camera == camera) & np.isfinite(points[:, 0]))
    seen, count = np.unique(o.placement[rows], return_counts=True)
    seen = seen[count >= LEAST_POINTS]
    rows = rows[np.isin(o.placement[rows], seen)]
    if len(seen) < 2:
        return None
    xy, usable = undistort(o.uv[rows], intrinsics)
    rows, xy = rows[usable], xy[usable]
    one = _fit(points[rows], xy, o.uv[rows], intrinsics)
    best: tuple[float, tuple[int, ...], FloatArray, FloatArray] | None = None
    for some in alike(seen):
        there = np.isin(o.placement[rows], some)
        parts = [_fit(points[rows[p]], xy[p], o.uv[rows[p]], intrinsics) for p in (~there, there)]
        if parts[0] is None or parts[1] is None:
            continue
        error = float(np.average([parts[0][0], parts[1][0]], weights=[(~there).sum(), there.sum()]))
        if best is None or error < best[0]:
            rotation_change = log_rotation(parts[1][1] @ parts[0][1].T)
            centres = [-part[1].T @ part[2] for part in parts if part is not None]
            best = (error, some, rotation_change, centres[1] - centres[0])
    whole = GATE_PX if one is None else one[0]
    if best is None or whole < BETTER * best[0]:
        return None
    rotation_rad, shift = float(np.linalg.norm(best[2])), float(np.linalg.norm(best[3]))
    return TwoPoseFit(camera, best[1], rotation_rad, shift, (whole, best[0]))


def _fit(
    points: FloatArray, xy: FloatArray, uv: FloatArray, intrinsics: FloatArray
) -> tuple[float, FloatArray, FloatArray] | None:
    """Mean residual (px, wrong ones as the gate) and pose of a resection; None where there is none."""
    pose = resect(points, xy, GATE_PX / intrinsics[0])
    if pose is None:
        return None
    rotation, translation, _ = pose
    x = points @ rotation.T + translation
    with np.errstate(all="ignore"):
        size = np.linalg.norm(project(x, np.broadcast_to(intrinsics, (len(x), 16))) - uv, axis=1)
    return float(np.where(size < GATE_PX, size, GATE_PX).mean()), rotation, translation
