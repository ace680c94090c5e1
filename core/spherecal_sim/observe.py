"""Observations of a simulated rig, and what goes wrong in a recording."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.observations import Observations
from spherecal.geometry.camera import image_reach, project
from spherecal_sim.rigs import TrueCamera
from spherecal_sim.simulated_ball import Ball, random_bumps
from spherecal_sim.truth import CameraMove, camera_pose


def lens_misfit(uv: FloatArray, size: FloatArray, phases: FloatArray, amplitude_px: float) -> FloatArray:
    """A smooth field of a period per image, (n, 2) px, of rms `amplitude_px`; phases (n, 4) rad of each camera."""
    turns = 2 * np.pi * uv / size
    du = np.sin(turns[:, 0] + phases[:, 0]) * np.cos(turns[:, 1] + phases[:, 1])
    dv = np.sin(turns[:, 1] + phases[:, 2]) * np.cos(turns[:, 0] + phases[:, 3])
    return 2 * amplitude_px * np.stack([du, dv], axis=1)  # sin cos has an rms of 1/2


def shape_changes(ball: Ball, count: int, rms_mm: float, kind: str, rng: np.random.Generator) -> FloatArray:
    """Displacements of the ball's dots in `count` placements, (count, dots, 3) mm."""
    if kind == "per-dot":
        return rng.normal(0.0, rms_mm / np.sqrt(3.0), (count, len(ball.dots_mm), 3))
    n = ball.dots_mm / np.linalg.norm(ball.dots_mm, axis=1, keepdims=True)
    change = np.array([[random_bumps(1.0, rng).height(n) for _ in range(3)] for _ in range(count)]).transpose(0, 2, 1)
    return change * (rms_mm / np.sqrt((change**2).sum(axis=2).mean(axis=1)))[:, None, None]


# Kinds of outliers: half are exchanged ids, three in ten are poor centres, the rest lie anywhere.
_EXCHANGED, _POOR = 0.5, 0.3
_POOR_PX = (0.5, 3.0)


def spoil(
    observations: Observations, sizes: FloatArray, fraction: float, rng: np.random.Generator
) -> tuple[Observations, BoolArray]:
    """Observations of which a fraction is wrong, and which (n,): exchanged ids, 0.5 to 3 px off, anywhere."""
    n = len(observations)
    uv = observations.uv.copy()
    wrong = np.zeros(n, dtype=bool)
    _exchange_ids(observations, uv, wrong, round(_EXCHANGED * fraction * n), rng)
    left = rng.permutation(np.flatnonzero(~wrong))
    poor = left[: round(_POOR * fraction * n)]
    angle = rng.uniform(0.0, 2 * np.pi, len(poor))
    uv[poor] += rng.uniform(*_POOR_PX, (len(poor), 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    anywhere = left[len(poor) : len(poor) + round((1 - _EXCHANGED - _POOR) * fraction * n)]
    uv[anywhere] = rng.uniform(-0.5, sizes[observations.camera[anywhere]] - 0.5)
    wrong[poor] = wrong[anywhere] = True
    o = observations
    spoilt = Observations(o.placements, o.cameras, o.points, o.placement, o.camera, o.target, o.point, uv, o.sigma)
    return spoilt, wrong


def _exchange_ids(o: Observations, uv: FloatArray, wrong: BoolArray, goal: int, rng: np.random.Generator) -> None:
    """Exchange ids of pairs of targets within images until about `goal` observations are wrong (in place)."""
    image = o.placement * len(o.cameras) + o.camera
    for i in rng.permutation(len(o)):
        if wrong.sum() + 8 > goal:  # a pair of whole targets spoils 16
            return
        rows = np.flatnonzero((image == image[i]) & ~wrong)
        others = np.unique(o.target[rows[o.target[rows] != o.target[i]]])
        if wrong[i] or not len(others):
            continue
        other = rng.choice(others)
        a, b = rows[o.target[rows] == o.target[i]], rows[o.target[rows] == other]
        _, in_a, in_b = np.intersect1d(o.point[a], o.point[b], return_indices=True)
        a, b = a[in_a], b[in_b]
        uv[a], uv[b] = uv[b], uv[a]
        wrong[a] = wrong[b] = True


@dataclass(frozen=True)
class ObservingCameras:
    """Cameras: poses (n, 3, 3), (n, 3) mm, intrinsics (n, 16), sizes (n, 2) px, tan of the largest angle (n,)."""

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
    """The simulated cameras as they are at a placement index, after their move if there was one."""
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
    """Which points (m, 3) mm each simulated camera sees, and where: in the frame, normals towards it."""
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
    # any of the points may be in a camera's field of view, by their enclosing sphere
    middle = points.mean(axis=0)
    radius = np.sqrt(((points - middle) ** 2).sum(axis=1).max())
    x = view.rotations @ middle + view.translations
    distance = np.linalg.norm(x, axis=1)
    axis_angle = np.arctan2(np.hypot(x[:, 0], x[:, 1]), x[:, 2])
    widening = np.arcsin(np.minimum(radius / np.maximum(distance, 1e-9), 1.0))
    near = (distance <= radius) | (axis_angle < np.arctan(view.reach) + widening)
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
