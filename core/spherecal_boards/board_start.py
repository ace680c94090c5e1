"""Each camera alone before the board: intrinsics and the board's possible poses in its frame, by OpenCV."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.threads import SharedLimit
from spherecal.data.observations import Observations
from spherecal.data.session import CameraSpec
from spherecal.geometry.camera import N_INTRINSICS, camera_matrix, project, undistort
from spherecal.geometry.rotation import cross_matrix, exp_rotation
from spherecal_boards.frame_network import FrameModel
from spherecal_boards.frames_adjustment import PointRows


@dataclass(frozen=True)
class BoardViews:
    """What cameras see of a board: observation i shows point `point[i]` at `placement[i]` in `camera[i]`.

    `points_mm` (p,3) in the board's frame, uv (n,2) px, sigma (n,2) px or None; names of cameras and placements.
    """

    points_mm: FloatArray
    placement: IntArray
    camera: IntArray
    point: IntArray
    uv: FloatArray
    sigma: FloatArray | None
    n_placements: int
    n_cameras: int

    def __len__(self) -> int:
        return len(self.uv)

    def of(self, camera: int, placement: int) -> IntArray:
        """Rows of one view, (k,); none where it has no observations."""
        return self._rows.get((camera, placement), np.zeros(0, dtype=np.int64))

    @cached_property
    def _rows(self) -> dict[tuple[int, int], IntArray]:
        order = np.lexsort((self.placement, self.camera))
        key = self.camera[order] * self.n_placements + self.placement[order]
        starts = np.flatnonzero(np.diff(key, prepend=-1))
        return {
            (int(key[rows[0]] // self.n_placements), int(key[rows[0]] % self.n_placements)): order[rows]
            for rows in np.split(np.arange(len(key)), starts[1:])
            if len(rows)
        }

    @property
    def views(self) -> list[tuple[int, int]]:
        """All (camera, placement) that have observations."""
        return list(self._rows)


def board_views(observations: Observations, points_mm: FloatArray, point: IntArray) -> BoardViews:
    """What the cameras see of a board's points (p,3) mm: which of them each observation shows, (n,)."""
    o = observations
    return BoardViews(points_mm, o.placement, o.camera, point, o.uv, o.sigma, len(o.placements), len(o.cameras))


@dataclass(frozen=True)
class BoardModel(FrameModel):
    """The frames of a board; `rigid` has the placements, `problem` only the cameras."""

    rigid: Problem

    @property
    def observed(self) -> Problem:
        """The problem with the placements."""
        return self.rigid

    def moved_frames(self, state: State, step: FloatArray) -> State:
        """The state with its placements turned (rad) about the board's origin, and shifted (mm), by steps (f,6)."""
        return replace(
            state,
            placement_rotation=exp_rotation(step[:, :3]) @ state.placement_rotation,
            placement_translation=state.placement_translation + step[:, 3:],
        )

    def point_rows(self, state: State, placement: IntArray, point: IntArray, in_datum: BoolArray) -> PointRows:
        """Points (p,) of the board at placements in the world, and how they follow the placements."""
        turned = np.einsum("pij,pj->pi", state.placement_rotation[placement], state.points[point])
        by_frame = np.concatenate([-cross_matrix(turned), np.tile(np.eye(3), (len(point), 1, 1))], axis=2)
        return PointRows(placement, turned + state.placement_translation[placement], by_frame, in_datum)


# Six unknowns of a pose and a few to check it; fewer dots of a board cut off by the border only mislead.
LEAST_POINTS = 6
_LEAST_VIEWS = 3
# Views for a camera's start: Zhang's method gains nothing beyond, and its time grows with the square.
_ENOUGH_VIEWS = 30
# Off the plane by less than this of its size a board is plane.
_PLANE = 1e-6
# A focal length of this many times the nominal one is no start from which to go on.
_WILD_FOCAL = 3.0
# Where nobody knew the nominal one it says little: 1.2 times the image's width is assumed, and lenses have
# 0.5 to 10 times it (those of the shared recording 5).
_WILD_ASSUMED = 12.0
# Two poses of a plane board explain a view alike while the worse fits no worse than this: over 14 boards nearly
# parallel to the image the wrong one was 1.0 to 1.4 times as bad.
_AMBIGUOUS = 5.0


@contextmanager
def _opencv_limited() -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


# `calibrateCamera` adds up its normal equations in the order in which its threads end: other last digits in each run.
ONE_OPENCV_THREAD = SharedLimit(_opencv_limited)


@dataclass(frozen=True)
class BoardPose:
    """A board's pose in a camera's frame: `x_camera = rotation @ x_board + translation`, and its rms in px."""

    rotation: FloatArray
    translation: FloatArray
    rms_px: float


def usable_views(views: BoardViews, used: BoolArray) -> list[tuple[int, int]]:
    """The (camera, placement) with at least `LEAST_POINTS` points, not on a line."""
    good = []
    for camera, placement in views.views:
        rows = views.of(camera, placement)
        rows = rows[used[rows]]
        if len(rows) < LEAST_POINTS:
            continue
        points = views.points_mm[views.point[rows]]
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[1] > 0.05 * spread[0]:
            good.append((camera, placement))
    return good


def start_intrinsics(
    views: BoardViews, usable: list[tuple[int, int]], cameras: Sequence[CameraSpec], free: BoolArray, context: Context
) -> FloatArray:
    """Intrinsics (c,16) of each camera alone: OpenCV's (Zhang 2000) where views and `free` allow, else its prior."""
    out = np.array([camera.prior for camera in cameras])
    plane = _plane_frame(views.points_mm)
    for camera, spec in enumerate(cameras):
        context.report("each camera alone", camera / views.n_cameras)
        own = [views.of(c, t) for c, t in usable if c == camera]
        # OpenCV's start knows five terms of distortion; a prior with more is a calibrated one
        if len(own) < _LEAST_VIEWS or not free[camera].any() or spec.prior[9:].any():
            continue
        own = [own[i] for i in np.unique(np.linspace(0, len(own) - 1, _ENOUGH_VIEWS).round().astype(int))]
        wild = _WILD_ASSUMED if "focal_length" in spec.assumed else _WILD_FOCAL
        # the better of Zhang's start and the prior as a start
        points = views.points_mm if plane is None else (views.points_mm - plane[1]) @ plane[0].T
        if plane is not None:
            points = points * (1, 1, 0)
        objects = [points[views.point[rows]].astype(np.float32) for rows in own]
        images = [views.uv[rows].astype(np.float32) for rows in own]
        best: tuple[float, FloatArray] | None = None
        # k3 stays out of a start: it takes over where views do not reach the corners
        for flags in (cv2.CALIB_USE_INTRINSIC_GUESS, 0) if plane is not None else (cv2.CALIB_USE_INTRINSIC_GUESS,):
            matrix, distortion = camera_matrix(spec.prior), spec.prior[4:9].copy()
            try:
                with ONE_OPENCV_THREAD.block():
                    rms, matrix, distortion, _, _ = cv2.calibrateCamera(
                        objects, images, spec.image_size, matrix, distortion, flags=flags | cv2.CALIB_FIX_K3
                    )
            except cv2.error:
                continue
            found = np.zeros(N_INTRINSICS)
            found[:4] = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
            found[4:9] = np.asarray(distortion).ravel()[:5]
            ratio = found[:2] / spec.prior[:2]
            if not np.isfinite(found).all() or (ratio > wild).any() or (ratio < 1 / wild).any():
                continue
            if best is None or rms < 0.99 * best[0]:
                best = float(rms), found
        found = best[1] if best else None
        if found is not None:
            out[camera] = found
    return out


def poses(views: BoardViews, rows: IntArray, intrinsics: FloatArray) -> list[BoardPose]:
    """The board's pose in a camera's frame, best first; two where a plane board's view (rows) allows two."""
    xy, good = undistort(views.uv[rows], intrinsics)
    rows, xy = rows[good], xy[good]
    if len(rows) < LEAST_POINTS:
        return []
    points = views.points_mm[views.point[rows]]
    frame = _plane_frame(points)
    if frame is None:
        candidates = _solve(points, xy, cv2.SOLVEPNP_SQPNP)
    else:
        axes, origin = frame
        flat = _solve(((points - origin) @ axes.T) * (1, 1, 0), xy, cv2.SOLVEPNP_IPPE)
        candidates = [(r @ axes, t - r @ axes @ origin) for r, t in flat]
    found = []
    for rotation, translation in candidates:
        x = points @ rotation.T + translation
        if (x[:, 2] <= 0).any():
            continue
        residual = project(x, intrinsics) - views.uv[rows]
        found.append(BoardPose(rotation, translation, float(np.sqrt((residual**2).sum(axis=1).mean()))))
    found.sort(key=lambda pose: pose.rms_px)
    return [pose for pose in found if pose.rms_px <= _AMBIGUOUS * found[0].rms_px]


def _solve(points: FloatArray, xy: FloatArray, method: int) -> list[tuple[FloatArray, FloatArray]]:
    """Poses from points (n,3) and normalised image points (n,2), each refined to the least squares near it."""
    try:
        count, rotations, shifts, _ = cv2.solvePnPGeneric(points, xy, np.eye(3), None, flags=method)
    except cv2.error:
        return []
    out = []
    for i in range(count):
        rotation, translation = cv2.solvePnPRefineLM(points, xy, np.eye(3), None, rotations[i], shifts[i])
        if np.isfinite(rotation).all() and np.isfinite(translation).all():
            turn, shift = (np.asarray(part, dtype=float).ravel() for part in (rotation, translation))
            out.append((exp_rotation(turn), shift))
    return out


def _plane_frame(points: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Axes (3,3) (rows, the third the normal) and origin (3,) of the plane of points (n,3), None without one."""
    origin = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - origin)
    if spread[2] > _PLANE * spread[0]:
        return None
    return np.stack([axes[0], axes[1], np.cross(axes[0], axes[1])]), origin
