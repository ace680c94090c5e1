"""What the simulated cameras see: visibility by angle, frame and depth, and exact image points."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.camera import image_reach, project
from spherecal_sim.rigs import TrueCamera
from spherecal_sim.truth import CameraMove, camera_pose


@dataclass(frozen=True)
class ObservingCameras:
    """Simulated cameras ready to look: poses (n, 3, 3), (n, 3) mm, intrinsics (n, 16), image sizes (n, 2) px.

    `reach` (n,) is the largest tan of the angle from the axis that can be in a frame, with a margin for distortion.
    """

    rotations: FloatArray
    translations: FloatArray
    intrinsics: FloatArray
    sizes: FloatArray
    reach: FloatArray

    @property
    def centres(self) -> FloatArray:
        """Projection centres in the world, (n, 3) mm."""
        return -np.einsum("nji,nj->ni", self.rotations, self.translations)


def look(cameras: tuple[TrueCamera, ...], move: CameraMove | None = None, placement: int = 0) -> ObservingCameras:
    """The simulated cameras as they are at a placement index.

    `move` None: none was.
    """
    poses = [camera_pose(c, move, placement) for c in cameras]
    sizes = np.array([c.kind.image_size for c in cameras], dtype=float)
    intrinsics = np.array([c.intrinsics for c in cameras])
    rotations, translations = np.array([r for r, _ in poses]), np.array([t for _, t in poses])
    return ObservingCameras(rotations, translations, intrinsics, sizes, image_reach(intrinsics, sizes))


@dataclass(frozen=True)
class Seen:
    """Image points uv (n, 2) px of points `point[i]` in cameras `camera[i]`, sorted by camera, then point."""

    camera: IntArray
    point: IntArray
    uv: FloatArray


def observe(
    view: ObservingCameras, points: FloatArray, normals: FloatArray | None, view_limit_deg: float = 60.0
) -> Seen:
    """Which of the points each simulated camera sees, and where.

    A point is seen where it is in front of the camera and its image in the frame. On a convex body the angle's limit
    implies that nothing hides it.

    `points`: points in the world, (m, 3) mm; `normals`: outward normals of the surface there, (m, 3); None: points are
    seen from all around.
    """
    camera, point = np.nonzero(_facing(view, points, normals, view_limit_deg))
    x = np.einsum("nij,nj->ni", view.rotations[camera], points[point]) + view.translations[camera]
    ahead = (x[:, 2] > 0) & (np.hypot(x[:, 0], x[:, 1]) < view.reach[camera] * x[:, 2])
    camera, point, x = camera[ahead], point[ahead], x[ahead]
    uv = project(x, view.intrinsics[camera])
    inside = ((uv > -0.5) & (uv < view.sizes[camera] - 0.5)).all(axis=1)
    return Seen(camera[inside], point[inside], uv[inside])


def _facing(
    view: ObservingCameras, points: FloatArray, normals: FloatArray | None, view_limit_deg: float
) -> np.ndarray:
    """Whether the view angle is below the limit, (cameras, points); cameras that cannot see the body are skipped."""
    centres = view.centres
    near = _may_see(view, points)
    facing = np.zeros((len(centres), len(points)), dtype=bool)
    if normals is None:
        facing[near] = True
        return facing
    offset = (normals * points).sum(axis=1)
    along_normal = centres[near] @ normals.T - offset
    distance2 = ((centres[near] ** 2).sum(axis=1)[:, None] + (points**2).sum(axis=1)) - 2 * centres[near] @ points.T
    cosine = np.cos(np.deg2rad(view_limit_deg))
    facing[near] = (along_normal > 0) & (along_normal**2 > cosine**2 * distance2)
    return facing


def _may_see(view: ObservingCameras, points: FloatArray) -> np.ndarray:
    """Whether any of the points may be in each camera's field of view, (cameras,), by their enclosing sphere."""
    middle = points.mean(axis=0)
    radius = np.sqrt(((points - middle) ** 2).sum(axis=1).max())
    x = view.rotations @ middle + view.translations
    distance = np.linalg.norm(x, axis=1)
    axis_angle = np.arctan2(np.hypot(x[:, 0], x[:, 1]), x[:, 2])
    widening = np.arcsin(np.minimum(radius / np.maximum(distance, 1e-9), 1.0))
    return (distance <= radius) | (axis_angle < np.arctan(view.reach) + widening)
