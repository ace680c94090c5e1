"""The reduced system of large rigs in the rigid form: points that half of all cameras see, one rank update for many.

If a ball is moved through a hall, or stays in a dome, each dot is seen by most cameras at most placements, and each by
different ones. Runs of points with the same cameras and placements, as in `schur_kernel`, are then single points. Here
the whitened couplings L^-1 W' of hundreds of points are put side by side over all columns and subtracted by one
symmetric product (hall50: 0.17 s instead of 0.88).
"""

import numpy as np
from scipy.linalg.blas import dsyrk  # pyright: ignore[reportAttributeAccessIssue]

from spherecal.adjust.ball_model import Rigid, Stored
from spherecal.adjust.kernel import INNER, KERNEL
from spherecal.adjust.linear import Linear, Reduced, point_blocks
from spherecal.adjust.problem import Problem
from spherecal.base.arrays import IntArray
from spherecal.base.kernels import njit

# Fewer columns than these (hall24: 510) are as fast by runs.
LEAST_COLUMNS = 1000
# Points whose couplings are in memory at a time: 1,200 rows of 2,000 columns are 19 MB.
_CHUNK = 400


def is_dense(problem: Problem) -> bool:
    """Whether this way pays: a large rig and a rigid ball."""
    return isinstance(problem.ball, Rigid | Stored) and problem.layout.expanded >= LEAST_COLUMNS


def eliminate(problem: Problem, linear: Linear, damping: float, points: IntArray, reduced: Reduced) -> None:
    """Add the observations of some points (m,), which are eliminated, to the reduced system's upper triangle."""
    layout = problem.layout
    for first in range(0, len(points), _CHUNK):
        some = points[first : first + _CHUNK]
        rows = np.zeros((3 * len(some), layout.expanded))
        done = 0
        for part in point_blocks(problem, linear, some):
            _couple(part, problem.n_cameras, layout.block_offset, damping, reduced, rows[3 * done :])
            done += len(part.points)
        # in Fortran's eyes our upper triangle is the lower one
        dsyrk(-1.0, rows.T, beta=1.0, c=reduced.matrix.T, lower=1, overwrite_c=1)


@njit(**KERNEL)
def _couple(part, n_cameras, offset, damping, reduced, rows):
    """Own normal equations of cameras and placements, and the points' whitened couplings (3m,e)."""
    matrix, gradient, diagonal = reduced.matrix, reduced.gradient, reduced.diagonal
    residual, by_camera, by_point, by_placement = part.linear
    v = np.empty((3, 3))
    for i in range(len(part.points)):
        p = part.points[i]
        w = rows[3 * i : 3 * i + 3]
        inverse = reduced.point_inverse[p]
        v[:] = inverse
        g = reduced.point_gradient[p]
        for k in range(part.begin[i], part.end[i]):
            jp, r0, r1 = by_point[k], residual[k, 0], residual[k, 1]
            c, t = offset[part.camera[k]], offset[n_cameras + part.placement[k]]
            row0, row1, pose0, pose1 = by_camera[k, 0], by_camera[k, 1], by_placement[k, 0], by_placement[k, 1]
            _add_rows(matrix, gradient, diagonal, c, row0, row1, r0, r1)
            _add_rows(matrix, gradient, diagonal, t, pose0, pose1, r0, r1)
            for a in range(len(row0)):
                for b in range(len(pose0)):
                    matrix[c + a, t + b] += row0[a] * pose0[b] + row1[a] * pose1[b]
            for j in range(3):
                p0, p1 = jp[0, j], jp[1, j]
                g[j] += p0 * r0 + p1 * r1
                for a in range(len(row0)):
                    w[j, c + a] += p0 * row0[a] + p1 * row1[a]
                for a in range(len(pose0)):
                    w[j, t + a] += p0 * pose0[a] + p1 * pose1[a]
                for b in range(3):
                    v[j, b] += p0 * jp[0, b] + p1 * jp[1, b]
        _whiten(v, damping, w, g, inverse, gradient)


@njit(**INNER)
def _add_rows(matrix, gradient, diagonal, first, row0, row1, r0, r1):
    for a in range(len(row0)):
        x0, x1 = row0[a], row1[a]
        gradient[first + a] += x0 * r0 + x1 * r1
        diagonal[first + a] += x0 * x0 + x1 * x1
        for b in range(len(row0)):
            matrix[first + a, first + b] += x0 * row0[b] + x1 * row1[b]


@njit(**INNER)
def _whiten(v, damping, w, g, inverse, gradient):
    """w = L^-1 w with V (damped) = L L', its inverse, and gradient -= W V^-1 g."""
    f = 1.0 + damping
    l00 = np.sqrt(v[0, 0] * f)
    l10, l20 = v[1, 0] / l00, v[2, 0] / l00
    l11 = np.sqrt(v[1, 1] * f - l10 * l10)
    l21 = (v[2, 1] - l20 * l10) / l11
    l22 = np.sqrt(v[2, 2] * f - l20 * l20 - l21 * l21)
    i00, i11, i22 = 1.0 / l00, 1.0 / l11, 1.0 / l22
    i10 = -l10 * i00 * i11
    i21 = -l21 * i11 * i22
    i20 = -(l20 * i00 + l21 * i10) * i22
    g0, g1 = i00 * g[0], i10 * g[0] + i11 * g[1]
    g2 = i20 * g[0] + i21 * g[1] + i22 * g[2]
    for s in range(w.shape[1]):
        w0, w1, w2 = w[0, s], w[1, s], w[2, s]
        z0, z1, z2 = i00 * w0, i10 * w0 + i11 * w1, i20 * w0 + i21 * w1 + i22 * w2
        w[0, s], w[1, s], w[2, s] = z0, z1, z2
        gradient[s] -= z0 * g0 + z1 * g1 + z2 * g2
    inverse[0, 0] = i00 * i00 + i10 * i10 + i20 * i20
    inverse[1, 1] = i11 * i11 + i21 * i21
    inverse[2, 2] = i22 * i22
    inverse[0, 1] = inverse[1, 0] = i10 * i11 + i20 * i21
    inverse[0, 2] = inverse[2, 0] = i20 * i22
    inverse[1, 2] = inverse[2, 1] = i21 * i22
