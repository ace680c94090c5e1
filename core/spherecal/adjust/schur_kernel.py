"""Elimination of the points, compiled: the Schur complement of their blocks.

A block has some columns of the expanded system: a camera with its lens, a placement, a point that is kept, or a lens
that several cameras share. The dots of a deformable ball are eliminated in `deformable_kernel`.
"""

import numpy as np

from spherecal.adjust.kernel import INNER, KERNEL
from spherecal.adjust.parameter_layout import POSE
from spherecal.base.kernels import njit

# Points that are eliminated by one matrix product; more than 64 gain nothing.
RUN = 64
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


@njit(**INNER)
def _flush(matrix, weighted, coupling, n_rows, size, blocks, n_blocks, offset, width):
    """Subtract W V^-1 W' of all points of a run, which meet the same blocks, from the reduced matrix."""
    if n_rows == 0:
        return
    if n_rows == 3:
        subtract_point(matrix, weighted, coupling, size, blocks, n_blocks, offset, width)
        return
    product = np.dot(weighted[: n_rows * size].reshape(n_rows, size).T, coupling[: n_rows * size].reshape(n_rows, size))
    left = 0
    for s in range(n_blocks):
        a = blocks[s]
        right = left
        for t in range(s, n_blocks):
            b = blocks[t]
            for i in range(width[a]):
                if offset[a] <= offset[b]:  # only the upper block triangle is filled
                    for j in range(width[b]):
                        matrix[offset[a] + i, offset[b] + j] -= product[left + i, right + j]
                else:
                    for j in range(width[b]):
                        matrix[offset[b] + j, offset[a] + i] -= product[left + i, right + j]
            right += width[b]
        left += width[a]


@njit(**INNER)
def subtract_point(matrix, weighted, coupling, size, blocks, n_blocks, offset, width):
    """Subtract W V^-1 W' of a single point, for which a matrix product costs more than it saves.

    `weighted`, `coupling`, `size`: V^-1 W' and W' (3, size), flat, and their number of columns; `offset`, `width`:
    first column and number of columns of each block, (b,).
    """
    left = 0
    for s in range(n_blocks):
        a = blocks[s]
        right = left
        for t in range(s, n_blocks):
            b = blocks[t]
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
def _block(kind, k, camera, placement, n_cameras, lens):
    """The block of observation k that is of a kind: its camera, the lens that it shares, its placement; -1 for none."""
    if kind == 0:
        return camera[k]
    if kind == 1:
        return lens[camera[k]]
    return n_cameras + placement[k] if len(placement) > 0 else -1


@njit(**INNER)
def meet(begin, end, camera, placement, n_cameras, lens, width, place, blocks):
    """The number of blocks that are coupled to a point, and of their columns together.

    `camera`, `placement`, `n_cameras` (k,); `lens`, `width` (c,).
    """
    size, n_blocks = 0, 0
    for k in range(begin, end):
        for kind in range(_KINDS):
            b = _block(kind, k, camera, placement, n_cameras, lens)
            if b >= 0 and place[b] < 0:
                place[b] = size
                blocks[n_blocks] = b
                n_blocks += 1
                size += width[b]
    return n_blocks, size


@njit(**INNER)
def _equal(blocks, n_blocks, run, n_run):
    if n_blocks != n_run:
        return False
    for s in range(n_blocks):  # noqa: SIM110 - generators cannot be compiled
        if blocks[s] != run[s]:
            return False
    return True


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
def _add_point(v, g, by_point, r0, r1):
    """One observation's share in its point's own normal equations."""
    for i in range(3):
        g[i] += by_point[0, i] * r0 + by_point[1, i] * r1
        for j in range(3):
            v[i, j] += by_point[0, i] * by_point[0, j] + by_point[1, i] * by_point[1, j]


@njit(**INNER)
def add_observations(
    begin,
    end,
    camera,
    placement,
    n_cameras,
    residual,
    by_camera,
    by_point,
    by_placement,
    offset,
    width,
    lens,
    place,
    coupling,
    at,
    size,
    v,
    g,
    matrix,
    gradient,
    square,
):
    """Add rows begin to end of a point: the blocks' own equations, and what its coupling W', V and g get.

    `camera`, `placement`, `n_cameras` (k,); `residual`, `by_camera`, `by_point`, `by_placement` (k,2); `offset`,
    `width`, `lens` (b,); `place`: first column in the coupling of each block that meets the point, (b,); `coupling`,
    `at`, `size`: W' (3, size), flat, from place `at` on; `v`, `g`: the point's own normal equations, (3,3) and (3,).
    """
    for k in range(begin, end):
        c, jp, r0, r1 = camera[k], by_point[k], residual[k, 0], residual[k, 1]
        rows = by_camera[k]
        _add_square(square[c], rows)
        split, shared = width[c], lens[c]  # from column `split` on, a lens that cameras share
        _add_block(rows, 0, split, r0, r1, jp, coupling, at + place[c], size, gradient, offset[c])
        if shared >= 0:
            _add_block(
                rows, split, rows.shape[1], r0, r1, jp, coupling, at + place[shared], size, gradient, offset[shared]
            )
        if len(placement) > 0:
            t, pose = n_cameras + placement[k], by_placement[k]
            _add_square(square[t], pose)
            _add_block(pose, 0, POSE, r0, r1, jp, coupling, at + place[t], size, gradient, offset[t])
            _add_rows(matrix, rows, 0, split, pose, offset[c], offset[t])
            if shared >= 0:
                _add_rows(matrix, rows, split, rows.shape[1], pose, offset[shared], offset[t])
        _add_point(v, g, jp, r0, r1)


@njit(**KERNEL)
def eliminate_points(
    order,
    begins,
    ends,
    camera,
    placement,
    n_cameras,
    kept_block,
    residual,
    by_camera,
    by_point,
    by_placement,
    offset,
    width,
    lens,
    damping,
    matrix,
    gradient,
    diagonal,
    square,
    inverse,
    point_gradient,
):
    """Adds points, in the given order, to the reduced system; runs that meet the same blocks are eliminated together.

    `order`, `begins`, `ends`: the points (m,), and the first row of each and its end, (m,); `camera`, `placement`,
    `n_cameras` (k,); `kept_block` (p,); `residual`, `by_camera`, `by_point`, `by_placement` (k,2); `offset`, `width`,
    `lens` (b,); `matrix`, `gradient`, `diagonal` (e,e); `square` (b,w,w).
    """
    n_all = len(offset)
    place = np.full(n_all, -1)  # a block's first column among those that meet the present point
    blocks, run = np.empty(n_all, dtype=np.int64), np.empty(n_all, dtype=np.int64)
    n_run, run_size, run_rows = 0, 0, 0
    most = most_columns(camera, placement, n_cameras, begins, ends, lens, width, place)
    coupling, weighted = np.empty(3 * RUN * most), np.empty(3 * RUN * most)
    v = np.empty((3, 3))
    for n in range(len(order)):
        p, begin, end = order[n], begins[n], ends[n]
        n_blocks, size = meet(begin, end, camera, placement, n_cameras, lens, width, place, blocks)
        if run_rows == 3 * RUN or not _equal(blocks, n_blocks, run, n_run):
            _flush(matrix, weighted, coupling, run_rows, run_size, run, n_run, offset, width)
            for s in range(n_blocks):
                run[s] = blocks[s]
            n_run, run_size, run_rows = n_blocks, size, 0
        at = run_rows * size  # where the point's W' begins
        for i in range(at, at + 3 * size):
            coupling[i] = 0.0
        v[:] = inverse[p]
        g = point_gradient[p]
        add_observations(
            begin,
            end,
            camera,
            placement,
            n_cameras,
            residual,
            by_camera,
            by_point,
            by_placement,
            offset,
            width,
            lens,
            place,
            coupling,
            at,
            size,
            v,
            g,
            matrix,
            gradient,
            square,
        )
        if kept_block[p] >= 0:
            keep_point(
                matrix, gradient, diagonal, offset, width, kept_block[p], v, g, blocks, n_blocks, coupling[at:], size
            )
            inverse[p] = 0.0
        else:
            inverse_damped(v, damping, inverse[p])
            weigh(weighted, coupling, at, inverse[p], size)
            subtract_gradient(gradient, weighted, at, size, g, blocks, n_blocks, offset, width)
            run_rows += 3
        for s in range(n_blocks):
            place[blocks[s]] = -1
    _flush(matrix, weighted, coupling, run_rows, run_size, run, n_run, offset, width)


@njit(**INNER)
def subtract_gradient(gradient, weighted, at, size, g, blocks, n_blocks, offset, width):
    """gradient -= W V^-1 g of one point.

    `gradient`: the reduced gradient, (e,); `weighted`, `at`, `size`: V^-1 W' (3, size), flat, from place `at` on; `g`:
    the point's gradient, (3,); `offset`, `width`: first column and number of columns of each block, (b,).
    """
    first, g0, g1, g2 = at, g[0], g[1], g[2]
    for s in range(n_blocks):
        b = blocks[s]
        for i in range(width[b]):
            j = first + i
            gradient[offset[b] + i] -= weighted[j] * g0 + weighted[size + j] * g1 + weighted[2 * size + j] * g2
        first += width[b]


@njit(**KERNEL)
def add_squares(matrix, diagonal, square, offset, width, lens):
    """Add the blocks' own normal equations to the matrix; their diagonal is what damping multiplies.

    `matrix`, `diagonal`: the reduced system and its diagonal, added to, (e,e) and (e,); `square`: the blocks' own
    normal equations from the elimination, (b,w,w); `offset`, `width`, `lens` (b,).
    """
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
def most_columns(camera, placement, n_cameras, begins, ends, lens, width, place):
    """The largest number of columns that are coupled to one point.

    `camera`, `placement`, `n_cameras` (k,); `begins`, `ends`: first row of each point and its end, (m,); `lens`,
    `width` (c,); `place`: working space (b,), -1 on entry and on return.
    """
    most = 0
    for p in range(len(begins)):
        columns = 0
        for k in range(begins[p], ends[p]):
            for kind in range(_KINDS):
                b = _block(kind, k, camera, placement, n_cameras, lens)
                if b >= 0 and place[b] != p:
                    place[b] = p
                    columns += width[b]
        most = max(most, columns)
    place[:] = -1
    return most


@njit(**INNER)
def keep_point(matrix, gradient, diagonal, offset, width, kept, v, g, blocks, n_blocks, coupling, size):
    """Keep a point of a length row: its own block and its coupling go into the reduced system.

    `offset`, `width`: first column and number of columns of each block, (b,); `v`, `g`: its own normal equations, (3,3)
    and (3,); `coupling`, `size`: W' (3, size), flat, and its number of columns.
    """
    column = offset[kept]
    for j in range(3):
        gradient[column + j] += g[j]
        diagonal[column + j] += v[j, j]
        for i in range(3):
            matrix[column + i, column + j] += v[i, j]
    first = 0
    for s in range(n_blocks):
        b = blocks[s]
        for i in range(width[b]):
            for j in range(3):
                matrix[offset[b] + i, column + j] += coupling[j * size + first + i]
        first += width[b]
