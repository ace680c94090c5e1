"""Cameras that may have converged to a wrong pose, resected against the points that the others agree on.

A weakly observed camera that starts wrong finds a local minimum and stays there; least squares cannot leave it, and a
low weight hides it. So after an adjustment a camera is doubtful if its residuals are conspicuous, if it has few points,
or if most of its points were left out. It is resected from points that it did not help to find, as incremental
pipelines do (J. Schoenberger, J.-M. Frahm, Structure-from-motion revisited, 2016). See
docs/decisions/0008-wrong-minima.md.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.bundle import RobustStep, residual_size, robust_adjustment, triangulated
from spherecal.adjust.network import Network
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.geometry.camera import undistort
from spherecal.geometry.resection import MIN_AGREEING, ResectedPose, pose_cost, resected_poses

# Cameras in the right minimum have medians within 1.5 of each other (rig A and B, clean); those of the twins of real
# networks in a wrong one 5 to 70 times that of the others.
STANDS_OUT = 2.0
# Of its observations a camera in the right minimum loses the wrong ones, up to a tenth.
MOST_LEFT_OUT = 0.25
# Cameras with fewer points than this were those that went astray (10 to 20 points).
FEW_POINTS = 40
# Scale of the resection's loss: three standard deviations, and not below what a lens that is still settling leaves.
SCALE_SIGMAS, LEAST_SCALE_PX = 3.0, 0.5
# Log-likelihoods: another pose must be better by so much to be taken, and the second best worse by so much for the best
# to be the only one (20 is a factor of 5e8).
BETTER_BY, ONLY_BY = 3.0, 20.0
# Noise for the latter; real dots never come below 0.01 px, and what a lens misfits is no more than this in most views.
LEAST_NOISE_PX = 0.02
# Five standard deviations, squared; and the share of its points that a pose must fit, and another with it.
OUTLIER, SAME_POINTS = 25.0, 0.5
ROUNDS = 4
ITERATIONS = 30


@dataclass(frozen=True)
class Resections:
    """A network after re-resection: its state, the observations (n,) that may be used, cameras (c,) left out."""

    state: State
    used: BoolArray
    ambiguous: BoolArray


def with_right_poses(
    network: Network, state: State, used: BoolArray, candidates: BoolArray, placed: BoolArray, context: Context
) -> Resections:
    """The network with every doubtful camera at its best pose, adjusted again (equal weights) if one changed.

    A camera whose second-best pose fits nearly as well keeps none: `ambiguous`.
    """
    for number in range(ROUNDS):
        context.report("resection", number / ROUNDS)
        doubtful = doubtful_cameras(network, state, used, candidates, placed)
        doubtful &= ~network.locked
        if not doubtful.any():
            break
        better = _better_poses(network, state, used, candidates, doubtful)
        if not better:
            break
        rotation, translation = state.rotation.copy(), state.translation.copy()
        for camera, pose in better.items():
            rotation[camera], translation[camera] = pose.rotation, pose.translation
        state = replace(state, rotation=rotation, translation=translation)
        mine = candidates & placed[network.camera]
        state = triangulated(network, state, mine)
        state = robust_adjustment(network, state, mine, placed, RobustStep(None, ITERATIONS), context)
        state = triangulated(network, state, mine)
        used = mine & np.isfinite(state.points[network.feature, 0])
    return Resections(state, used, _ambiguous(network, state, used, candidates, placed))


def doubtful_cameras(
    network: Network, state: State, used: BoolArray, candidates: BoolArray, placed: BoolArray
) -> BoolArray:
    """Cameras (c,) that may be in a wrong minimum: conspicuous residuals, few points, many candidates left out."""
    size = residual_size(network, state)
    n = len(placed)
    known = candidates & np.isfinite(state.points[network.feature, 0])
    median = np.array([_median(size[known & (network.camera == c)]) for c in range(n)])
    typical = _median(median[placed & np.isfinite(median)])
    close = used & (size <= 3 * SCALE_SIGMAS * max(typical, LEAST_NOISE_PX))
    matched = candidates & (network.views(candidates) >= 2)[network.feature]
    count, kept = (np.bincount(network.camera[rows], minlength=n) for rows in (matched, close))
    with np.errstate(invalid="ignore"):
        stands_out = (median > STANDS_OUT * typical) & (median > LEAST_NOISE_PX)
    return placed & (count > 0) & (stands_out | (kept < FEW_POINTS) | (kept < (1 - MOST_LEFT_OUT) * count))


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def _better_poses(
    network: Network, state: State, used: BoolArray, candidates: BoolArray, doubtful: BoolArray
) -> dict[int, ResectedPose]:
    """Poses of doubtful cameras that fit the others' points better than the ones they have."""
    better = {}
    for camera, view in _views(network, state, used, candidates, doubtful):
        now = pose_cost(state.rotation[camera], state.translation[camera], view.points, view.xy, view.scale)
        poses = resected_poses(view.points, view.xy, view.scale)
        if poses and poses[0].cost < now - BETTER_BY and poses[0].cost < 0.9 * now:
            better[camera] = poses[0]
    return better


def _ambiguous(network: Network, state: State, used: BoolArray, candidates: BoolArray, placed: BoolArray) -> BoolArray:
    """Doubtful cameras (c,) whose second-best pose fits nearly as well as the best, or which no points can confirm."""
    out = np.zeros(len(placed), dtype=bool)
    doubtful = doubtful_cameras(network, state, used, candidates, placed) & ~network.locked
    if not doubtful.any() or doubtful.sum() > placed.sum() / 2:
        return out
    for camera, view in _views(network, state, used, candidates, doubtful):
        poses = resected_poses(view.points, view.xy, view.scale)
        if len(poses) > 1:
            best, second = (_misfit(pose, view) for pose in poses[:2])
            fits = best < OUTLIER, second < OUTLIER
            # two poses that fit different points, or none, are those of a camera that moved
            alike = (fits[0] & fits[1]).sum() >= SAME_POINTS * max(fits[0].sum(), SAME_POINTS * len(best))
            out[camera] = alike and 0.5 * float((second - best).sum()) < ONLY_BY
    return out


def _misfit(pose: ResectedPose, view: "_View") -> FloatArray:
    """Twice minus the log-likelihood of each point (k,) in a pose; beyond five standard deviations it is an outlier."""
    scale = view.scale * view.noise_px / view.scale_px
    x = view.points @ pose.rotation.T + pose.translation
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        size = ((x[:, :2] / x[:, 2:] - view.xy) ** 2).sum(axis=1) / scale**2
    return np.minimum(np.where(x[:, 2] > 0, size, OUTLIER), OUTLIER)


@dataclass(frozen=True)
class _View:
    """A camera's observations of points (k,3) that others located: xy (k,2) and the loss' scale in normalised units."""

    points: FloatArray
    xy: FloatArray
    scale: float
    scale_px: float
    noise_px: float


def _views(
    network: Network, state: State, used: BoolArray, candidates: BoolArray, doubtful: BoolArray
) -> Iterator[tuple[int, _View]]:
    """The doubtful cameras (c,) that see enough points which the others have located."""
    by_others = used & ~doubtful[network.camera]
    noise_px = _noise_px(network, state, by_others)
    located = triangulated(network, state, by_others)
    scale_px = max(SCALE_SIGMAS * noise_px, LEAST_SCALE_PX)
    known = candidates & np.isfinite(located.points[network.feature, 0])
    for camera in np.flatnonzero(doubtful).tolist():
        rows: IntArray = np.flatnonzero(known & (network.camera == camera))
        xy, usable = undistort(network.uv[rows], state.intrinsics[camera])
        rows, xy = rows[usable], xy[usable]
        if len(rows) >= MIN_AGREEING:
            points = network.only(rows).world_points(located)
            yield camera, _View(points, xy, scale_px / float(state.intrinsics[camera, 0]), scale_px, noise_px)


def _noise_px(network: Network, state: State, rows: BoolArray) -> float:
    """Standard deviation of one coordinate, by the median of the residuals."""
    size = residual_size(network, state)[rows]
    return max(float(np.median(size)) / 1.1774 if len(size) else 0.0, LEAST_NOISE_PX)
