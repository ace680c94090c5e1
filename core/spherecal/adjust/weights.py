"""Weights by camera (variance components): a blurred camera neither spoils the rest nor is left out.

Only noise is weighted: what differs between neighbouring dots of an image (J. von Neumann, Distribution of the ratio of
the mean square successive difference to the variance, 1941). What neighbours share must not be hidden by a low weight:
a lens that does not follow the model, or a pose in the wrong minimum. The mean square of all residuals did that to five
views of 113, which then had 20 to 70 times the noise of the others and poses 22 mm off. See docs/formulation.md, The
rigid ball, and docs/decisions/0008-wrong-minima.md.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable, Stored
from spherecal.adjust.bundle import Adjustment, refine, residual_size
from spherecal.adjust.deformable import left_over
from spherecal.adjust.network import Network
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, blocks_of_groups, sum_by
from spherecal.base.context import Context

# A camera 10 to 25 times noisier than the rest is found in two rounds, its neighbours are clean again after eight (1.03
# and 1.02; 1.13 and 1.20 after three); clean data settle in one or two.
ROUNDS = 8
SETTLED = 0.03
# A camera with fewer rows left over than this says nothing of its own noise (its estimate would scatter by 25 %).
LEAST_REDUNDANCY = 8.0
# Median residuals of equally good cameras differ by less than 1.3 (rig A: by their shares of two-view points).
STICKS_OUT = 1.5
# One neighbour alone makes the estimate scatter by a quarter more; of many the farthest share less of the lens' misfit.
NEIGHBOURS = 4
# Bounds against perfect observations and absurd ones.
LEAST_NOISE, MOST_NOISE = 0.1, 100.0


def camera_noise(problem: Problem, state: State) -> FloatArray:
    """Noise (c,) of each camera against its weights, 1 on average over the observations.

    Its square is that between neighbouring dots plus what residuals of the whole network share: lenses that do not
    follow the model, in the median over the cameras.
    """
    residual, by_points = (left_over if isinstance(problem.ball, Deformable) else left_over_by_points)(problem, state)
    rest, scale = 2.0 - by_points, 1.0 / problem.weight.mean(axis=1)
    n = problem.n_cameras
    count, size = (np.bincount(problem.camera, values, n) for values in (np.ones(len(rest)), scale**2))
    freedom = np.bincount(problem.camera, rest, n) - _own_unknowns(problem)
    known = (freedom >= LEAST_REDUNDANCY) & (count > NEIGHBOURS)
    if not known.any():
        return np.ones(n)
    total, own = np.zeros(n), np.zeros(n)
    for c in np.flatnonzero(known):
        rows = np.flatnonzero(problem.camera == c)
        nearest = np.asarray(KDTree(problem.uv[rows]).query(problem.uv[rows], k=NEIGHBOURS + 1)[1])
        near = rows[nearest[:, 1:]]
        difference = ((residual[rows] - residual[near].mean(axis=1)) ** 2).sum()
        own[c] = difference / (rest[rows] + rest[near].mean(axis=1) / NEIGHBOURS).sum()
        total[c] = (residual[rows] ** 2).sum() / freedom[c]
    unit = size[known] / count[known]  # square of the scale, px
    shared = max(float(np.median((total[known] - own[known]) * unit)), 0.0)
    square = own[known] + shared / unit
    mean = float((square * freedom[known]).sum() / freedom[known].sum())
    noise = np.ones(n)
    if mean > 0:
        noise[known] = np.sqrt(square / mean)
    return noise.clip(LEAST_NOISE, MOST_NOISE)


def left_over_by_points(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """Residuals (n,2), and of each observation's two rows how much its point is fitted to them (n,)."""
    residual, by_points = np.empty_like(problem.uv), np.empty(len(problem.uv))
    for first, last in blocks_of_groups(problem.point_start):
        own = slice(int(problem.point_start[first]), int(problem.point_start[last]))
        linear, point = engine.linearise(problem.select(own), state, None), problem.point[own] - first
        normal = sum_by(point, np.einsum("nki,nkj->nij", linear.by_point, linear.by_point), last - first)
        if isinstance(problem.ball, Stored):
            normal += problem.ball.shape.information[first:last]
        inverse = np.linalg.pinv(normal, hermitian=True)
        residual[own] = linear.residual
        by_points[own] = np.einsum("nki,nij,nkj->n", linear.by_point, inverse[point], linear.by_point)
    return residual, by_points


def _own_unknowns(problem: Problem) -> FloatArray:
    """How many unknowns (c,) each camera's observations determine: its own, and its share of the placements'."""
    count = np.bincount(problem.camera, minlength=problem.n_cameras)
    members = np.bincount(problem.group, count > 0)[problem.group].clip(min=1)
    own = POSE * problem.free_pose + problem.free_intrinsics.sum(axis=1) / members
    rest = problem.layout.size - (own * (count > 0)).sum()  # placements and kept points
    return own + max(rest, 0.0) * count / max(count.sum(), 1)


def rough_noise(network: Network, state: State, used: BoolArray) -> FloatArray:
    """Noise (c,) of cameras for a start, from typical residuals of some rows (n,): only conspicuous cameras differ.

    Without it a blurred camera pulls the points it shares, and good observations of its partners fail the gate.
    """
    size = residual_size(network, state)
    typical = float(np.median(size[used])) if used.any() else 0.0
    noise = np.ones(len(network.group))
    for c in np.unique(network.camera[used]):
        own = float(np.median(size[used & (network.camera == c)]))
        if own > STICKS_OUT * typical > 0:
            noise[c] = min(own / typical, MOST_NOISE)
    return noise


def weighted(network: Network, adjusted: Adjustment, placed: BoolArray, context: Context) -> tuple[Network, Adjustment]:
    """The adjustment again with every camera weighted by its own noise, and the network with these weights."""
    for _ in range(ROUNDS):
        factor = camera_noise(adjusted.problem, adjusted.state)
        network = replace(network, noise=network.noise * factor)
        before, adjusted = adjusted, refine(network, adjusted.state, adjusted.used, placed, context)
        # twice without convergence: more rounds did not converge either (hall, nine wrong points of one camera: 60 s)
        is_stuck = not (before.minimum.converged or adjusted.minimum.converged)
        if is_stuck or (np.abs(factor - 1) < SETTLED).all():
            break
    return network, adjusted
