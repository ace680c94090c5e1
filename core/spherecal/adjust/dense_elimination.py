"""The reduced system of large rigs whose points many cameras see: one rank update for many points.

If a rigid ball is moved through a hall, or stays in a dome, each dot is seen by most cameras at most placements, and
each by different ones. Runs of points with the same cameras and placements, as in `schur_kernel`, are then single
points. Here the whitened couplings L^-1 W' of hundreds of points are put side by side over all columns and subtracted
by one symmetric product (hall50: 0.17 s instead of 0.88). Free points of a dome are taken with those that nearly the
same cameras see, over the columns of these cameras (a million observations: in two thirds of the time).
"""

from collections.abc import Iterator

import numpy as np
from scipy.linalg.blas import dsyrk  # pyright: ignore[reportAttributeAccessIssue]

from spherecal.adjust.ball_model import Free, Rigid, Stored
from spherecal.adjust.kernel import BARE, INNER
from spherecal.adjust.linear import Blocks, Linear, Reduced, point_blocks
from spherecal.adjust.problem import Problem
from spherecal.adjust.schur_kernel import add_observations
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.kernels import njit

# Fewer columns than these (hall24: 510) are as fast by runs; so are free points that fewer cameras see (hall100: 3).
LEAST_COLUMNS, LEAST_VIEWS = 1000, 10
# Points whose couplings are in memory at a time: 1,200 rows of 2,000 columns are 19 MB. Of free points: more have more
# columns that are 0, fewer make less of a product.
_CHUNK, _CHUNK_FREE = 400, 96
# Directions in which the sets of cameras that see free points differ most, by which they are grouped.
_AXES = 3


def is_dense(problem: Problem) -> bool:
    """Whether this way pays: a large rig, and a rigid ball or free points that many cameras with own lenses see."""
    if problem.layout.expanded < LEAST_COLUMNS or not isinstance(problem.ball, Free):
        return problem.layout.expanded >= LEAST_COLUMNS and isinstance(problem.ball, Rigid | Stored)
    seen = int(np.count_nonzero(np.diff(problem.point_start)))
    own = problem.layout.lens_owner == np.arange(problem.n_cameras)
    return len(problem.uv) >= LEAST_VIEWS * seen and bool(own.all())


def eliminate(
    problem: Problem,
    linear: Linear,
    damping: float,
    points: IntArray,
    blocks: Blocks,
    reduced: Reduced,
    square: FloatArray,
) -> None:
    """Add the observations of some points (m,), which are eliminated, to the reduced system's upper triangle.

    `square`: as in `eliminate_points`.
    """
    everything = np.arange(problem.layout.expanded)
    is_free = isinstance(problem.ball, Free)
    chunks = (points[i : i + _CHUNK] for i in range(0, len(points), _CHUNK))
    for some in alike(points, views_apart(problem)) if is_free else chunks:
        first, columns = blocks.offset, everything  # where the blocks' columns are among those of the couplings
        if is_free:
            first, columns = _met(problem, some)
        rows, pull, done = np.zeros((3 * len(some), len(columns))), np.zeros(len(columns)), 0
        for part in point_blocks(problem, linear, some):
            own = rows[3 * done :]
            _couple(part, blocks, first, damping, reduced, square, own, own.ravel(), pull)
            done += len(part.points)
        reduced.gradient[columns] -= pull
        # in Fortran's eyes our upper triangle is the lower one
        if is_free:
            _subtract(reduced.matrix, dsyrk(1.0, rows.T, lower=1).T, columns, linear.width)
        else:
            dsyrk(-1.0, rows.T, beta=1.0, c=reduced.matrix.T, lower=1, overwrite_c=1)


def views_apart(problem: Problem) -> FloatArray:
    """Places (p,3) of the points, the farther apart the more the sets of cameras that see them differ."""
    sees = np.zeros((problem.n_points, problem.n_cameras))
    sees[problem.point, problem.camera] = 1.0
    return sees @ np.linalg.eigh(sees.T @ sees)[1][:, -_AXES:]


def alike(points: IntArray, apart: FloatArray) -> Iterator[IntArray]:
    """The points (m,), some `_CHUNK_FREE` at a time, halved where they are farthest `apart`, (p,3)."""
    waiting = [points]
    while waiting:
        some = waiting.pop()
        if len(some) <= _CHUNK_FREE:
            yield some
            continue
        along = apart[some, np.argmax(apart[some].var(axis=0))]
        some = some[np.argsort(along, kind="stable")]
        waiting += [some[len(some) // 2 :], some[: len(some) // 2]]


def _met(problem: Problem, points: IntArray) -> tuple[IntArray, IntArray]:
    """The first of the columns of each camera (c,) among those of the cameras that see some free points, and these."""
    start, width = problem.point_start, int(problem.layout.block_width[0])
    seen = np.zeros(problem.n_cameras, dtype=bool)
    for p in points.tolist():
        seen[problem.camera[start[p] : start[p + 1]]] = True
    columns = (problem.layout.block_offset[: len(seen)][seen][:, None] + np.arange(width)).ravel()
    return np.where(seen, width * (np.cumsum(seen) - 1), -1), columns


@njit(**BARE)
def _subtract(matrix, product, columns, width):
    """Subtract a product's upper triangle (k,k), 0 below, from a matrix's columns (k,): blocks of a width, in order."""
    for i in range(len(columns)):
        row, own = matrix[columns[i]], product[i]
        for j in range(i - i % width, len(columns), width):
            first = columns[j]
            for a in range(width):
                row[first + a] -= own[j + a]


@njit(**BARE)
def _couple(part, blocks, place, damping, reduced, square, rows, coupling, pull):
    """The points' whitened couplings (3m,k) and their pull (k,), and what `add_observations` adds.

    `place` (b,): first column of each block in the couplings, which are `rows` and, flat, `coupling`.
    """
    size = rows.shape[1]
    for i in range(len(part.points)):
        p = part.points[i]
        v, g = reduced.point_inverse[p], reduced.point_gradient[p]  # V is known beforehand, 0 for most
        add_observations(
            part.begin[i], part.end[i], part, blocks, place, coupling, 3 * i * size, size, v, g, reduced, square
        )
        _whiten(v, damping, rows[3 * i : 3 * i + 3], g, pull)


@njit(**INNER)
def _whiten(v, damping, w, g, pull):
    """w = L^-1 w with V (damped) = L L', pull += W V^-1 g, and V becomes its inverse."""
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
        pull[s] += z0 * g0 + z1 * g1 + z2 * g2
    v[0, 0] = i00 * i00 + i10 * i10 + i20 * i20
    v[1, 1] = i11 * i11 + i21 * i21
    v[2, 2] = i22 * i22
    v[0, 1] = v[1, 0] = i10 * i11 + i20 * i21
    v[0, 2] = v[2, 0] = i20 * i22
    v[1, 2] = v[2, 1] = i21 * i22
