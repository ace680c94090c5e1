"""Covariance over cameras and frames in the free-network datum of the points (decision 0004): an S-transformation."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spherecal.adjust.datum import moved_cameras, moved_points
from spherecal.adjust.parameter_layout import symmetric
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.threads import one_blas_thread
from spherecal_boards.frame_network import FrameModel, ReducedFrames, dense_couplings, reduce, sum_by

# Numbers of a dense block of points' derivatives: 16 MB.
_BLOCK = 2_000_000


@dataclass(frozen=True)
class PointRows:
    """Points as functions of their frames: frame (p,), place (p,3), derivatives (p,3,q), who defines the datum (p,)."""

    frame: IntArray
    place: FloatArray
    by_frame: FloatArray
    in_datum: np.ndarray


@dataclass(frozen=True)
class FrameCovariance:
    """Cofactors of cameras (c,w,w), points (p,3,3) and all cameras (c*w,c*w), each without the scale's share.

    `relative_scale`: root of its cofactor; `stretch` (c*w,): change of the parameters when the whole grows by 1.
    """

    cameras: FloatArray
    points: FloatArray
    relative_scale: float
    all_cameras: FloatArray
    stretch: FloatArray


def frame_covariance(model: FrameModel, state: State, points: PointRows) -> FrameCovariance | None:
    """Cofactors at the minimum, for a standard deviation of unit weight of 1; None where the network is singular."""
    with one_blas_thread():
        found = frame_factors(model, state)
        return None if found is None else _transformed(model, state, points, *found)


def frame_factors(model: FrameModel, state: State) -> tuple[ReducedFrames, FloatArray] | None:
    """The reduced equations and cofactors (e,e) of the cameras' columns, the reference's pose fixed; or None."""
    try:
        normal = reduce(model, state, model.linearise(state, None), 0.0)
        inverse = _inverse(symmetric(normal.matrix))
    except (LinAlgError, np.linalg.LinAlgError):
        return None
    layout = model.problem.layout
    return normal, layout.expanded_rows(layout.expanded_rows(inverse).T)


def _inverse(matrix: FloatArray) -> FloatArray:
    if not len(matrix):
        return matrix
    diagonal = matrix.diagonal()
    if not (np.isfinite(matrix).all() and (diagonal > 0).all()):
        raise LinAlgError
    scale = 1.0 / np.sqrt(diagonal)
    factor = cho_factor(matrix * scale[:, None] * scale)
    # below this the reduced system's digits are all lost to cancellation
    if np.abs(np.diag(factor[0])).min() < 1e-9:
        raise LinAlgError
    return cho_solve(factor, np.eye(len(matrix))) * scale[:, None] * scale


def _transformed(
    model: FrameModel, state: State, points: PointRows, normal: ReducedFrames, inverse: FloatArray
) -> FrameCovariance:
    motions, camera_motions, spread = _motions(model, state, points)
    moments = np.linalg.inv(np.einsum("pig,pih->gh", motions[points.in_datum], motions[points.in_datum]))
    within = np.where(points.in_datum[:, None, None], motions.transpose(0, 2, 1) @ points.by_frame, 0.0)
    pull_frames = sum_by(points.frame, within, model.n_frames)  # (f,7,q)
    noise = np.einsum("fgq,fqr,fhr->gh", pull_frames, normal.inverse, pull_frames)
    gauge_rows = np.zeros((7, len(inverse)))
    order = np.argsort(points.frame, kind="stable")
    bounds = points.frame[order]
    covariance = np.zeros((len(points.place), 3, 3))
    moved = motions @ moments  # G M (p,3,7)
    for first, dense in dense_couplings(normal, model.problem.n_cameras):
        block = slice(first, first + len(dense))
        shift = -normal.inverse[block] @ dense  # K (b,q,e)
        gauge_rows += np.einsum("bgq,bqe->ge", pull_frames[block], shift)
    at_once = max(1, _BLOCK // (normal.inverse.shape[1] * max(len(inverse), 1)))
    for first, dense in dense_couplings(normal, model.problem.n_cameras):
        begin, end = np.searchsorted(bounds, [first, first + len(dense)])
        for start in range(begin, end, at_once):
            own = order[start : min(start + at_once, end)]
            frame = points.frame[own]
            through = points.by_frame[own] @ normal.inverse[frame]
            by_camera = -through @ dense[frame - first] - moved[own] @ gauge_rows
            mixed = through @ pull_frames[frame].transpose(0, 2, 1) @ moved[own].transpose(0, 2, 1)
            covariance[own] = (by_camera @ inverse) @ by_camera.transpose(0, 2, 1)
            covariance[own] += through @ points.by_frame[own].transpose(0, 2, 1) - mixed - mixed.transpose(0, 2, 1)
    covariance += moved @ noise @ moved.transpose(0, 2, 1)
    similarity = moments @ (gauge_rows @ inverse @ gauge_rows.T + noise) @ moments
    gauge_weights = camera_motions @ moments  # B C B' + G M N M G', B = 1 - G M A, (e,e)
    mixed = inverse @ gauge_rows.T @ gauge_weights.T
    noisy = gauge_rows @ inverse @ gauge_rows.T + noise
    cameras = inverse - mixed - mixed.T + gauge_weights @ noisy @ gauge_weights.T
    width = len(cameras) // model.problem.n_cameras
    own = np.array([cameras[c : c + width, c : c + width] for c in range(0, len(cameras), width)])
    relative = float(np.sqrt(similarity[6, 6])) / spread
    return FrameCovariance(own, covariance, relative, cameras, camera_motions[:, 6] * spread)


def _motions(model: FrameModel, state: State, points: PointRows) -> tuple[FloatArray, FloatArray, float]:
    """Shifts, turns and stretch of points (p,3,7) and cameras (e,7) about the points' centroid, and their spread."""
    centroid = points.place[points.in_datum].mean(axis=0)
    offset = points.place - centroid
    spread = float(np.sqrt((offset[points.in_datum] ** 2).sum(axis=1).mean()))
    of_points = moved_points(points.place, centroid, spread)
    return of_points, moved_cameras(model.problem, state, centroid, spread), spread
