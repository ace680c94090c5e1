"""Elimination of the points, compiled: the Schur complement of their blocks.

A block has some columns of the expanded system: a camera with its lens, a placement, a point that is kept, or a lens
that several cameras share. The dots of a deformable ball are eliminated in `deformable_kernel`.
"""

import numpy as np

from spherecal.adjust.kernel import BARE, INNER, INNER_WITH_ARRAYS, KERNEL
from spherecal.adjust.parameter_layout import POSE
from spherecal.base.kernels import njit

_STRIP = 48  # columns of a product at a time: hall50's rigid form 3.7 us an observation in one piece, 2.7 in strips
_KINDS = 3  # of blocks that an observation may meet, see `_block`


@njit(**INNER)
def inverse_damped(v, damping, out):
    """Inverse (3,3) of a symmetric matrix whose diagonal is multiplied by 1 + damping."""
    f = 1.0 + damping
    a, b, c, d, e, g = v[0, 0] * f, v[0, 1], v[0, 2], v[1, 1] * f, v[1, 2], v[2, 2] * f
    m00, m01, m02 = d * g - e * e, c * e - b * g, b * e - c * d
    det = a * m00 + b * m01 + c * m02
    inv = 1.0 / det
    out[0, 0], out[0, 1], out[0, 2] = m00 * inv, m01 * inv, m02 * inv
    out[1, 0], out[1, 1], out[1, 2] = m01 * inv, (a * g - c * c) * inv, (b * c - a * e) * inv
    out[2, 0], out[2, 1], out[2, 2] = m02 * inv, (b * c - a * e) * inv, (a * d - b * b) * inv


@njit(**INNER)
def _add_square(square, rows):
    """square += rows' rows of an observation's two; all of it, as loops of even length vectorise, triangles do not."""
    for i in range(rows.shape[1]):
        a0, a1 = rows[0, i], rows[1, i]
        for j in range(rows.shape[1]):
            square[i, j] += a0 * rows[0, j] + a1 * rows[1, j]


@njit(**INNER)
def weigh(weighted, coupling, at, inverse, size):
    """weighted = V^-1 W' (3, size).

    `inverse`: V^-1, (3,3).
    """
    one, two = at + size, at + 2 * size
    for j in range(3):
        v0, v1, v2 = inverse[j, 0], inverse[j, 1], inverse[j, 2]
        own = at + j * size
        for i in range(size):
            weighted[own + i] = v0 * coupling[at + i] + v1 * coupling[one + i] + v2 * coupling[two + i]


@njit(**INNER_WITH_ARRAYS)
def _flush(matrix, weighted, coupling, n_rows, size, run, n_run, blocks):
    """Subtract W V^-1 W' of all points of a run, over the blocks that any of them meets, from the reduced matrix."""
    if n_rows == 0:
        return
    if n_rows == 3:
        subtract_point(matrix, weighted, coupling, size, run, n_run, blocks)
        return
    offset, width = blocks.offset, blocks.width
    left_side = weighted[: n_rows * size].reshape(n_rows, size)
    right_side = coupling[: n_rows * size].reshape(n_rows, size)
    first, begin = 0, 0
    while first < n_run:  # strip by strip, of which only what is right of its diagonal is needed
        last, end = first, begin
        while last < n_run and end - begin < _STRIP:
            end += width[run[last]]
            last += 1
        strip = np.ascontiguousarray(left_side[:, begin:end]).T
        product = np.dot(strip, np.ascontiguousarray(right_side[:, begin:]))
        left = 0
        for s in range(first, last):
            a = run[s]
            right = left
            for t in range(s, n_run):
                b = run[t]
                for i in range(width[a]):
                    if offset[a] <= offset[b]:  # only the upper block triangle is filled
                        for j in range(width[b]):
                            matrix[offset[a] + i, offset[b] + j] -= product[left + i, right + j]
                    else:
                        for j in range(width[b]):
                            matrix[offset[b] + j, offset[a] + i] -= product[left + i, right + j]
                right += width[b]
            left += width[a]
        first, begin = last, end


@njit(**INNER)
def subtract_point(matrix, weighted, coupling, size, met, n_met, blocks):
    """Subtract W V^-1 W' of a single point, for which a matrix product costs more than it saves.

    `weighted`, `coupling`, `size`: V^-1 W' and W' (3, size), flat, and their number of columns; `met`, `n_met`: the
    blocks that the point meets.
    """
    offset, width = blocks.offset, blocks.width
    left = 0
    for s in range(n_met):
        a = met[s]
        right = left
        for t in range(s, n_met):
            b = met[t]
            # V^-1 is symmetric, so either side may be the weighted one
            row, column, i0, j0 = (a, b, left, right) if offset[a] <= offset[b] else (b, a, right, left)
            for i in range(width[row]):
                w0, w1, w2 = weighted[i0 + i], weighted[size + i0 + i], weighted[2 * size + i0 + i]
                target = matrix[offset[row] + i]
                for j in range(width[column]):
                    k = j0 + j
                    target[offset[column] + j] -= (
                        w0 * coupling[k] + w1 * coupling[size + k] + w2 * coupling[2 * size + k]
                    )
            right += width[b]
        left += width[a]


@njit(**INNER)
def _block(kind, k, part, blocks):
    """The block of observation k that is of a kind: its camera, the lens that it shares, its placement; -1 for none."""
    if kind == 0:
        return part.camera[k]
    if kind == 1:
        return blocks.lens[part.camera[k]]
    return len(blocks.lens) + part.placement[k] if len(part.placement) > 0 else -1


@njit(**INNER)
def meet(begin, end, part, blocks, place, met, n_met, size):
    """The number of blocks that are coupled to the point of rows begin to end, and of their columns together.

    Fills `met` (b,) with them and `place` (b,), where it is -1, with the first column of each, after `n_met` blocks of
    `size` columns.
    """
    for k in range(begin, end):
        for kind in range(_KINDS):
            b = _block(kind, k, part, blocks)
            if b >= 0 and place[b] < 0:
                place[b] = size
                met[n_met] = b
                n_met += 1
                size += blocks.width[b]
    return n_met, size


@njit(**INNER)
def _add_block(rows, begin, end, r0, r1, by_point, coupling, first, size, gradient, column):
    """Columns begin to end of an observation's rows: their share in the gradient and in the point's coupling W'."""
    p00, p01, p02 = by_point[0, 0], by_point[0, 1], by_point[0, 2]
    p10, p11, p12 = by_point[1, 0], by_point[1, 1], by_point[1, 2]
    for i in range(end - begin):
        x0, x1 = rows[0, begin + i], rows[1, begin + i]
        gradient[column + i] += x0 * r0 + x1 * r1
        coupling[first + i] += p00 * x0 + p10 * x1
        coupling[first + size + i] += p01 * x0 + p11 * x1
        coupling[first + 2 * size + i] += p02 * x0 + p12 * x1


@njit(**INNER)
def _add_rows(matrix, rows, begin, end, pose, first, column):
    """matrix[first.., column..] += columns begin to end of an observation's rows, times its rows by the placement."""
    for i in range(end - begin):
        for j in range(POSE):
            matrix[first + i, column + j] += rows[0, begin + i] * pose[0, j] + rows[1, begin + i] * pose[1, j]


@njit(**INNER)
def add_point(v, g, by_point, r0, r1):
    """One observation's share in its point's own normal equations."""
    for i in range(3):
        g[i] += by_point[0, i] * r0 + by_point[1, i] * r1
        for j in range(3):
            v[i, j] += by_point[0, i] * by_point[0, j] + by_point[1, i] * by_point[1, j]


@njit(**INNER)
def add_observations(begin, end, part, blocks, place, coupling, at, size, v, g, reduced, square):
    """Add rows begin to end of a point: the blocks' own equations, and what its coupling W', V and g get.

    `place`: first column in the coupling of each block that meets the point, (b,); `coupling`, `at`, `size`: W'
    (3, size), flat, from place `at` on; `v`, `g`: the point's own normal equations, (3,3) and (3,).
    """
    linear, offset, gradient = part.linear, blocks.offset, reduced.gradient
    for k in range(begin, end):
        c, jp, r0, r1 = part.camera[k], linear.by_point[k], linear.residual[k, 0], linear.residual[k, 1]
        rows = linear.by_camera[k]
        _add_square(square[c], rows)
        split, shared = blocks.width[c], blocks.lens[c]  # from column `split` on, a lens that cameras share
        _add_block(rows, 0, split, r0, r1, jp, coupling, at + place[c], size, gradient, offset[c])
        if shared >= 0:
            _add_block(
                rows, split, rows.shape[1], r0, r1, jp, coupling, at + place[shared], size, gradient, offset[shared]
            )
        if len(part.placement) > 0:
            t, pose = len(blocks.lens) + part.placement[k], linear.by_placement[k]
            _add_square(square[t], pose)
            _add_block(pose, 0, POSE, r0, r1, jp, coupling, at + place[t], size, gradient, offset[t])
            _add_rows(reduced.matrix, rows, 0, split, pose, offset[c], offset[t])
            if shared >= 0:
                _add_rows(reduced.matrix, rows, split, rows.shape[1], pose, offset[shared], offset[t])
        add_point(v, g, jp, r0, r1)


@njit(**KERNEL)
def eliminate_points(part, begins_run, kept_block, blocks, damping, reduced, square):
    """Adds points, in their order, to the reduced system, run by run in the columns that any point of it meets.

    `part`: a `PointBlock`; `begins_run` (p,): which points begin a run; `kept_block`: block of each point that is kept
    (p,), else -1; `blocks`: the `Blocks`; `reduced`: the `Reduced` that is added to; `square`: the blocks' own normal
    equations, added to (b,w,w).
    """
    n_all = len(blocks.offset)
    place = np.full(n_all, -1)  # a block's first column among those that the present run meets
    run = np.empty(n_all, dtype=np.int64)
    coupling, weighted = np.empty(0), np.empty(0)
    v = np.empty((3, 3))
    first = 0
    while first < len(part.points):
        last = first + 1
        while last < len(part.points) and not begins_run[part.points[last]]:
            last += 1
        n_run, size, rows = 0, 0, 0
        for n in range(first, last):
            n_run, size = meet(part.begin[n], part.end[n], part, blocks, place, run, n_run, size)
        if len(coupling) < 3 * (last - first) * size:
            coupling, weighted = np.empty(3 * (last - first) * size), np.empty(3 * (last - first) * size)
        for n in range(first, last):
            p = part.points[n]
            at = rows * size  # where the point's W' begins
            coupling[at : at + 3 * size] = 0.0
            inverse = reduced.point_inverse[p]
            v[:] = inverse
            g = reduced.point_gradient[p]
            add_observations(part.begin[n], part.end[n], part, blocks, place, coupling, at, size, v, g, reduced, square)
            if kept_block[p] >= 0:
                keep_point(reduced, blocks, kept_block[p], v, g, run, n_run, coupling[at:], size)
                inverse[:] = 0.0
            else:
                inverse_damped(v, damping, inverse)
                weigh(weighted, coupling, at, inverse, size)
                subtract_gradient(reduced.gradient, weighted, at, size, g, run, n_run, blocks)
                rows += 3
        _flush(reduced.matrix, weighted, coupling, rows, size, run, n_run, blocks)
        for s in range(n_run):
            place[run[s]] = -1
        first = last


@njit(**INNER)
def subtract_gradient(gradient, weighted, at, size, g, met, n_met, blocks):
    """gradient -= W V^-1 g of one point.

    `gradient`: the reduced gradient, (e,); `weighted`, `at`, `size`: V^-1 W' (3, size), flat, from place `at` on; `g`:
    the point's gradient, (3,); `met`, `n_met`: the blocks that the point meets.
    """
    first, g0, g1, g2 = at, g[0], g[1], g[2]
    for s in range(n_met):
        b = met[s]
        for i in range(blocks.width[b]):
            j = first + i
            gradient[blocks.offset[b] + i] -= weighted[j] * g0 + weighted[size + j] * g1 + weighted[2 * size + j] * g2
        first += blocks.width[b]


@njit(**BARE)
def add_squares(reduced, square, blocks):
    """Add the blocks' own normal equations to the matrix; their diagonal is what damping multiplies.

    `square`: the blocks' own normal equations from the elimination, (b,w,w).
    """
    matrix, diagonal, (offset, width, lens) = reduced.matrix, reduced.diagonal, blocks
    for b in range(len(offset)):
        for i in range(width[b]):
            diagonal[offset[b] + i] += square[b, i, i]
            for j in range(width[b]):
                matrix[offset[b] + i, offset[b] + j] += square[b, i, j]
    for c in range(len(lens)):
        if lens[c] < 0:
            continue
        first, split = offset[lens[c]], width[c]
        for i in range(width[lens[c]]):
            diagonal[first + i] += square[c, split + i, split + i]
            for j in range(width[lens[c]]):
                matrix[first + i, first + j] += square[c, split + i, split + j]
            for j in range(split):
                if offset[c] <= first:
                    matrix[offset[c] + j, first + i] += square[c, j, split + i]
                else:
                    matrix[first + i, offset[c] + j] += square[c, split + i, j]


@njit(**INNER)
def keep_point(reduced, blocks, kept, v, g, met, n_met, coupling, size):
    """Keep a point of a length row: its own block and its coupling go into the reduced system.

    `kept`: its block; `v`, `g`: its own normal equations, (3,3) and (3,); `coupling`, `size`: W' (3, size), flat, and
    its number of columns.
    """
    matrix, offset, width = reduced.matrix, blocks.offset, blocks.width
    column = offset[kept]
    for j in range(3):
        reduced.gradient[column + j] += g[j]
        reduced.diagonal[column + j] += v[j, j]
        for i in range(3):
            matrix[column + i, column + j] += v[i, j]
    first = 0
    for s in range(n_met):
        b = met[s]
        for i in range(width[b]):
            for j in range(3):
                matrix[offset[b] + i, column + j] += coupling[j * size + first + i]
        first += width[b]
