"""The truth about dots: where they are in the world and in an image of a station."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.kernels import njit
from spherecal.geometry.camera import project, reach_of
from spherecal_sim.simulated_ball import Ball, wrap
from spherecal_sim.tracing import TracedScene, trace
from spherecal_sim.unowned import unowned


@dataclass(frozen=True)
class Station:
    """A simulated camera at the moment of an image: world-to-camera pose, 16 intrinsics, image (width, height) px."""

    id: str
    rotation: FloatArray
    translation_mm: FloatArray
    intrinsics: FloatArray
    size: tuple[int, int]

    @property
    def centre_mm(self) -> FloatArray:
        """The projection centre in the world, (3,) mm."""
        return -self.rotation.T @ self.translation_mm


RIM_POINTS = 32
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@dataclass(frozen=True)
class TrueDots:
    """Dots in the world, mm: places, outward normals (n, 3), rims (n, RIM_POINTS, 3); stickers' corners (s, 4, 3)."""

    target: IntArray
    point: IntArray
    places: FloatArray
    normals: FloatArray
    rims: FloatArray
    sheets: FloatArray

    def moved(self, rotation: FloatArray, place: FloatArray) -> "TrueDots":
        """The dots after `x' = rotation (3, 3) @ x + place (3,) mm`."""
        return TrueDots(
            self.target, self.point, self.places @ rotation.T + place, self.normals @ rotation.T,
            self.rims @ rotation.T + place, self.sheets @ rotation.T + place,
        )  # fmt: skip


@dataclass(frozen=True)
class DotTruth:
    """What an image shows of its dots, row by row; image points in px."""

    target: IntArray
    point: IntArray
    uv: FloatArray  # (n, 2) the surface point at the dot's centre
    uv_rim: FloatArray  # (n, 2) the centre of the rim's plane, which on a ball is r^2 / 2R deeper
    uv_cen: FloatArray  # (n, 2) the centroid of the dot's outline in the image
    moments_px2: FloatArray  # (n, 2, 2) the outline's central moments per area
    view_deg: FloatArray  # (n,) between the surface normal and the line of sight
    fully_visible: BoolArray  # (n,) the whole rim shows
    gap_px: FloatArray  # (n,) to the nearest other outline
    axes_px: FloatArray  # (n, 2) the outline's long and short diameter
    bound_px: FloatArray  # (n,) Cramer-Rao bound, 2-D, NaN where it is not computed

    def __len__(self) -> int:
        return len(self.target)


def ball_dots(ball: Ball, dot_radius_mm: float, half_sticker_mm: float) -> TrueDots:
    """All dots of a ball, in the ball frame, mm."""
    n = len(ball.dots_mm)
    circle = _circle(dot_radius_mm)
    flat = ball.layouts_mm.reshape(-1, 1, 2) + circle
    frames = np.repeat(ball.frames, len(ball.points) * RIM_POINTS, axis=0)
    rims = wrap(ball.radius_mm, ball.bumps, frames, flat.reshape(-1, 2))[1]
    corners = np.tile(half_sticker_mm * _CORNERS, (len(ball.frames), 1))
    sheets = wrap(ball.radius_mm, ball.bumps, np.repeat(ball.frames, 4, axis=0), corners)[1]
    return TrueDots(
        ball.dot_target, ball.dot_point, ball.dots_mm, ball.normals, rims.reshape(n, RIM_POINTS, 3),
        sheets.reshape(-1, 4, 3),
    )  # fmt: skip


def bar_dots(scene: TracedScene, targets: tuple[int, ...]) -> TrueDots:
    """All dots on the marks of a scene's bar, in the world, mm."""
    marks, dots = scene.mark_dots.shape[:2]
    flat = np.zeros((marks, dots, 1 + RIM_POINTS, 3))
    flat[..., :2] = scene.mark_dots[:, :, None] + np.concatenate([np.zeros((1, 2)), _circle(scene.dot_radius)])
    flat[..., 0] += scene.mark_x[:, None, None]
    rotation, place = scene.bar_rotations[0], scene.bar_places[0]
    world = (flat @ rotation.T + place).reshape(marks * dots, 1 + RIM_POINTS, 3)
    sheets = np.zeros((marks, 4, 3))
    sheets[..., :2] = scene.half_sticker * _CORNERS
    sheets[..., 0] += scene.mark_x[:, None]
    return TrueDots(
        np.repeat(np.array(targets), dots), np.tile(np.arange(dots), marks), world[:, 0],
        np.tile(-rotation[:, 2], (marks * dots, 1)), world[:, 1:], sheets @ rotation.T + place,
    )  # fmt: skip


def _circle(radius: float) -> FloatArray:
    angle = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


_STEEPEST_DEG = 88.0  # beyond, a dot is a line


@dataclass(frozen=True)
class Outlines:
    """Outlines of dots in an image: dot index (n,) and polygons (n, RIM_POINTS, 2) px, whether hidden or not."""

    dot: IntArray
    uv: FloatArray


def outline_dots(dots: TrueDots, station: Station) -> Outlines:
    """The outlines of all dots that may touch the image: turned to the camera and near its field of view."""
    rotation, translation, intrinsics = station.rotation, station.translation_mm, station.intrinsics
    x = dots.places @ rotation.T + translation
    corner = np.maximum(intrinsics[2:4], np.array(station.size) - intrinsics[2:4])
    reach = reach_of(np.hypot(*corner)[None], intrinsics[None])  # as in observe: beyond, the lens polynomial may fold
    towards = _view_angles(dots, station.centre_mm) < 92.0  # half of a dot on the limb may still show
    near = np.flatnonzero(towards & (x[:, 2] > 0) & (np.hypot(x[:, 0], x[:, 1]) < reach * x[:, 2]))
    rims = dots.rims[near].reshape(-1, 3) @ rotation.T + translation
    return Outlines(near, project(rims, intrinsics).reshape(-1, RIM_POINTS, 2))


def see_dots(dots: TrueDots, outlines: Outlines, scene: TracedScene, station: Station) -> DotTruth:
    """The truth about the dots whose centres are in the image and seen below 88 degrees, hidden or not."""
    rotation, translation, intrinsics = station.rotation, station.translation_mm, station.intrinsics
    uv = project(dots.places[outlines.dot] @ rotation.T + translation, intrinsics)
    view_deg = _view_angles(dots, station.centre_mm)[outlines.dot]
    last = np.array(station.size) - 0.5
    keep = (view_deg < _STEEPEST_DEG) & ((uv > -0.5) & (uv < last)).all(axis=1)
    dot, uv, outline = outlines.dot[keep], uv[keep], outlines.uv[keep]
    rims = dots.rims[dot]
    # centroids and central moments per area of the polygons
    middle = outline.mean(axis=1, keepdims=True)
    p = outline - middle
    q = np.roll(p, -1, axis=1)
    cross = p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]
    area = cross.sum(axis=1) / 2
    centroid = ((p + q) * cross[..., None]).sum(axis=1) / (6 * area[:, None])
    products = p[..., :, None] * p[..., None, :] + q[..., :, None] * q[..., None, :]
    products += (p[..., :, None] * q[..., None, :] + q[..., :, None] * p[..., None, :]) / 2
    moments = (products * cross[..., None, None]).sum(axis=1) / (12 * area[:, None, None])
    uv_cen, moments = middle[:, 0] + centroid, moments - centroid[:, :, None] * centroid[:, None, :]
    spread = np.clip(np.linalg.eigvalsh(moments)[:, ::-1], 0.0, None)
    return DotTruth(
        dots.target[dot],
        dots.point[dot],
        uv,
        uv_rim=project(rims.mean(axis=1) @ rotation.T + translation, intrinsics),
        uv_cen=uv_cen,
        moments_px2=moments,
        view_deg=view_deg[keep],
        fully_visible=_rims_show(scene, station.centre_mm, rims)
        & ((outline > -0.5) & (outline < last)).all(axis=(1, 2)),
        gap_px=_gaps(uv, outline),
        axes_px=4 * np.sqrt(spread),  # an ellipse of semi-axis a has the moment a^2 / 4
        bound_px=np.full(len(dot), np.nan),
    )


def _view_angles(dots: TrueDots, centre: FloatArray) -> FloatArray:
    """Angle between each dot's normal and the line of sight, degrees."""
    ray = centre - dots.places
    cosine = (ray * dots.normals).sum(axis=1) / np.linalg.norm(ray, axis=1)
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _gaps(uv: FloatArray, outlines: FloatArray) -> FloatArray:
    """Distance in px from each outline to the nearest other one, infinite for a single dot."""
    if len(uv) < 2:
        return np.full(len(uv), np.inf)
    k = min(4, len(uv) - 1)
    _, nearest = KDTree(uv).query(uv, k + 1)
    neighbours = np.asarray(nearest)[:, 1:]
    gaps = np.full(len(uv), np.inf)
    for column in neighbours.T:
        between = np.linalg.norm(outlines[:, :, None] - outlines[column][:, None], axis=3)
        gaps = np.minimum(gaps, between.min(axis=(1, 2)))
    return gaps


_ON_SURFACE_MM = 0.05


@njit(nogil=True, cache=True)
def _rims_show(scene, centre, rims):
    """Whether the ray to every rim point ends there, (n,)."""
    scene, centre, rims = unowned((scene, centre, rims))
    show = np.empty(len(rims), np.bool_)
    for i in range(len(rims)):
        show[i] = True
        for k in range(rims.shape[1]):
            dx, dy, dz = rims[i, k, 0] - centre[0], rims[i, k, 1] - centre[1], rims[i, k, 2] - centre[2]
            q = np.sqrt(dx * dx + dy * dy + dz * dz)
            px, py, pz = trace(scene, (centre[0], centre[1], centre[2], dx / q, dy / q, dz / q))[3]
            gap = abs(px - rims[i, k, 0]) + abs(py - rims[i, k, 1]) + abs(pz - rims[i, k, 2])
            # at a grazing angle the ray may slip past the last 0.01 mm of the surface and land far behind
            if gap > _ON_SURFACE_MM:
                show[i] = False
                break
    return show
