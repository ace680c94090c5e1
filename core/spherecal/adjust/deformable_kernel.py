"""Elimination of the dots of a deformable ball, compiled.

The dot of a place (one dot at one placement) is off the shape by e ~ N(0, tau^2) per coordinate, which its observations
have in common. J are their derivatives by the dot, V = J'J. By the matrix inversion lemma their weight matrix is

    (I + tau^2 J J')^-1 = I - J Q J',  Q = tau^2 (I + tau^2 V)^-1.

So e is eliminated before the dot itself. The dot then meets the other unknowns by P J' with P = I - Q V. tau = 0 is a
place of a rigid ball. The pieces are those of `schur_kernel`; the loops are separate kernels, as these take 15
seconds to compile and few balls need them.
"""

import numpy as np

from spherecal.adjust.kernel import INNER, KERNEL
from spherecal.adjust.schur_kernel import (
    add_observations,
    inverse_damped,
    keep_point,
    meet,
    subtract_gradient,
    subtract_point,
    weigh,
)
from spherecal.base.kernels import njit


@njit(**INNER)
def _weigh_deformation(v, variance, q, p):
    """Q = tau^2 (I + tau^2 V)^-1 and P = I - Q V = (I + tau^2 V)^-1 of a place."""
    for i in range(3):
        for j in range(3):
            q[i, j] = variance * v[i, j] + (1.0 if i == j else 0.0)
    inverse_damped(q, 0.0, p)
    for i in range(3):
        for j in range(3):
            q[i, j] = variance * p[i, j]


@njit(**INNER)
def _add_coupling(coupling, size, place, own, own_size, met, n_met, width):
    """coupling += own (3, own_size), whose columns are those of some blocks only."""
    first = 0
    for s in range(n_met):
        b = met[s]
        for j in range(3):
            for i in range(width[b]):
                coupling[j * size + place[b] + i] += own[j * own_size + first + i]
        first += width[b]


@njit(**KERNEL)
def eliminate_places(part, kept_block, shape_sd, blocks, damping, reduced, square):
    """Add the dots of a deformable ball, in their order, to the reduced system; as `eliminate_points`.

    `shape_sd`: tau of each place that `part.place` names.
    """
    n_all = len(blocks.offset)
    place, place_in_own = np.full(n_all, -1), np.full(n_all, -1)
    met, own_met = np.empty(n_all, dtype=np.int64), np.empty(n_all, dtype=np.int64)
    most = blocks.width.sum()  # memory that is never touched costs nothing
    coupling, weighted = np.empty(3 * most), np.empty(3 * most)
    own, own_weighted = np.empty(3 * most), np.empty(3 * most)  # W' of a place by the blocks that it meets
    v, q, p = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    v_place, g_place = np.empty((3, 3)), np.empty(3)
    matrix, gradient = reduced.matrix, reduced.gradient
    for n in range(len(part.points)):
        point, first, end = part.points[n], part.begin[n], part.end[n]
        n_met, size = meet(first, end, part, blocks, place, met, 0, 0)
        coupling[: 3 * size] = 0.0
        inverse = reduced.point_inverse[point]
        v[:] = inverse
        g = reduced.point_gradient[point]
        while first < end:
            last = first + 1
            while last < end and part.place[last] == part.place[first]:
                last += 1
            n_own, own_size = meet(first, last, part, blocks, place_in_own, own_met, 0, 0)
            own[: 3 * own_size] = 0.0
            v_place[:] = 0.0
            g_place[:] = 0.0
            add_observations(
                first, last, part, blocks, place_in_own, own, 0, own_size, v_place, g_place, reduced, square
            )
            _weigh_deformation(v_place, shape_sd[part.place[first]] ** 2, q, p)
            weigh(own_weighted, own, 0, q, own_size)
            subtract_point(matrix, own_weighted, own, own_size, own_met, n_own, blocks)
            subtract_gradient(gradient, own_weighted, 0, own_size, g_place, own_met, n_own, blocks)
            weigh(own_weighted, own, 0, p, own_size)
            _add_coupling(coupling, size, place, own_weighted, own_size, own_met, n_own, blocks.width)
            for i in range(3):  # what the shape noise leaves of the place's own equations
                for j in range(3):
                    g[i] += p[i, j] * g_place[j]
                    for k in range(3):
                        v[i, k] += p[i, j] * v_place[j, k]
            for s in range(n_own):
                place_in_own[own_met[s]] = -1
            first = last
        if kept_block[point] >= 0:
            keep_point(reduced, blocks, kept_block[point], v, g, met, n_met, coupling, size)
            inverse[:] = 0.0
        else:
            inverse_damped(v, damping, inverse)
            weigh(weighted, coupling, 0, inverse, size)
            subtract_gradient(gradient, weighted, 0, size, g, met, n_met, blocks)
            subtract_point(matrix, weighted, coupling, size, met, n_met, blocks)
        for s in range(n_met):
            place[met[s]] = -1
