"""Motions of the network that the observations leave open: shifts, turns and the size of the whole.

They are the datum defect of a free network, as columns of the adjustment's unknowns and as motions of the places of its
features (W. Baarda, S-transformations and criterion matrices, 1973; docs/decisions/0004-free-network-datum.md).
"""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust.ball_model import Stored
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.rotation import cross_matrix


@dataclass(frozen=True)
class Places:
    """Features of the rigid form: feature i is the ball's point `point[i]`, moved by placement `placement[i]`."""

    point: IntArray
    placement: IntArray


def carried_dots(state: State, places: Places | None) -> tuple[FloatArray, FloatArray]:
    """Rotation (f,3,3) of each feature's point, and the rotated point (f,3); empty in the free form."""
    if places is None:
        return np.zeros((0, 3, 3)), np.zeros((0, 3))
    rotation = state.placement_rotation[places.placement]
    lever_arm = np.einsum("fij,fj->fi", rotation, state.points[places.point])
    return rotation, np.where(np.isfinite(lever_arm), lever_arm, 0.0)  # unknown points take no part


@dataclass(frozen=True)
class Motions:
    """Motions of the whole: of the unknowns' columns (e,g), of the features' places (f,3,g).

    `unseen` (g,): those that no observation sees; turns and stretch move a point at a distance of `spread` by 1.
    """

    columns: FloatArray
    places: FloatArray
    unseen: BoolArray
    spread: float


def datum_motions(problem: Problem, state: State, places: Places | None = None) -> Motions:
    """Three shifts, three turns about the centroid and one stretch, as far as the datum removes them.

    One locked camera leaves the stretch about its centre, two or more leave nothing. A known length makes it seen.
    """
    locked = np.flatnonzero((np.bincount(problem.camera, minlength=problem.n_cameras) > 0) & ~problem.free_pose)
    seen = np.diff(problem.point_start) > 0
    at, takes_part = state.points, seen
    if places is not None:
        _, lever_arm = carried_dots(state, places)
        at, takes_part = lever_arm + state.placement_translation[places.placement], seen[places.point]
    centroid = at[takes_part].mean(axis=0)
    if len(locked):
        centroid = -state.rotation[locked[0]].T @ state.translation[locked[0]]
    spread = np.sqrt(((at[takes_part] - centroid) ** 2).sum(axis=1).mean())
    moved = moved_points(at, centroid, spread)
    moved[~takes_part] = 0.0
    pieces = [moved_cameras(problem, state, centroid, spread)]
    if places is not None:
        pieces.append(_moved_placements(state, centroid, spread))
    pieces.append(moved_points(state.points[problem.kept_points], centroid, spread).reshape(-1, 7))
    first = 6 if len(locked) else 0
    last = 7 if len(locked) < 2 else 6
    unseen = np.arange(7) < (6 if problem.has_lengths or isinstance(problem.ball, Stored) else 7)
    return Motions(np.vstack(pieces)[:, first:last], moved[:, :, first:last], unseen[first:last], float(spread))


def moved_points(at: FloatArray, centroid: FloatArray, spread: float) -> FloatArray:
    """How points (m,3) move, (m,3,7), about `centroid` (3,)."""
    out = np.zeros((len(at), 3, 7))
    out[:, :, :3] = np.eye(3)
    out[:, :, 3:6] = -cross_matrix(at - centroid) / spread
    out[:, :, 6] = (at - centroid) / spread
    return out


def moved_cameras(problem: Problem, state: State, centroid: FloatArray, spread: float) -> FloatArray:
    """How cameras move with the whole, (c*w,7): each keeps its view, x_camera stays or is stretched with the points.

    Those without a pose do not: one NaN would spread to every function of all cameras.
    """
    cameras = np.zeros((problem.n_cameras, POSE + len(problem.intrinsic_columns), 7))
    rotation = state.rotation
    to_centroid = np.einsum("cij,j->ci", rotation, centroid) + state.translation
    cameras[:, 3:6, :3] = -rotation
    cameras[:, :3, 3:6] = -rotation / spread
    cameras[:, 3:6, 3:6] = -np.einsum("cij,cjk->cik", cross_matrix(to_centroid), rotation) / spread
    cameras[:, 3:6, 6] = to_centroid / spread
    cameras[~np.isfinite(to_centroid).all(axis=1)] = 0.0
    return cameras.reshape(-1, 7)


def _moved_placements(state: State, centroid: FloatArray, spread: float) -> FloatArray:
    """How placements move when the ball's points move as the world does, (t*6,7); nothing where R = I, T = 0.

    Points that a stored shape fixes in their frame do not move with the world; the first placement is the world.
    """
    translation = state.placement_translation
    rotation = state.placement_rotation * (not state.is_anchored)
    out = np.zeros((len(rotation), POSE, 7))
    carried = np.einsum("tij,j->ti", rotation, centroid)
    out[:, 3:, :3] = np.eye(3) - rotation
    out[:, :3, 3:6] = (np.eye(3) - rotation) / spread
    # w x (T - c) + R (w x c), linear in w
    out[:, 3:, 3:6] = -(cross_matrix(translation - centroid) + rotation @ cross_matrix(centroid)) / spread
    out[:, 3:, 6] = (translation - centroid + carried) / spread
    if state.is_anchored:
        out[0] = 0.0
    return out.reshape(-1, 7)
