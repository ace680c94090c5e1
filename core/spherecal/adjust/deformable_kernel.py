"""The soft form's normal equations, compiled: points of the ball that have some play at every placement.

Seen as observations of the rigid shape, the image points of one dot at one placement have an error in common, the
dot's play. With V the dot's normal matrix there, J its image derivatives and tau the play, their weight matrix is
(I + tau^2 J J')^-1 = I - J Q J' with Q = tau^2 (I + tau^2 V)^-1 (matrix inversion lemma).
"""

import numpy as np

from spherecal.adjust.kernel import INNER, KERNEL
from spherecal.base.kernels import njit


@njit(**KERNEL)
def reduce_soft(
    order, group_start, dot_start, camera, group_placement, n_cameras, kept_block,
    residual, by_camera, by_placement, turn, arm, q, p, information, pull, offset, width, damping,
    matrix, gradient, diagonal, inverse, dot_gradient,
):  # fmt: skip
    """Fill the upper triangle of the expanded system with dots eliminated; places g of dot i are dot_start[i]..

    Observation order[k] with k from group_start[g] shows place g; turn (g,3,3) carries the dot to the place, arm (g,3)
    is the dot turned; q, p (g,3,3): Q and I - Q V. information, pull: what is known of the dots before.
    """
    n_dots = len(dot_start) - 1
    local = np.full(len(offset), -1)  # a block's first column among those that meet the present dot
    blocks = np.empty(len(offset), dtype=np.int64)
    column = np.empty(len(gradient), dtype=np.int64)
    w, y = np.empty((3, len(gradient))), np.empty((3, len(gradient)))
    e, qe = np.empty((3, len(gradient))), np.empty((3, len(gradient)))
    own = np.empty(len(gradient), dtype=np.int64)
    v, g, b, vr, pr = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for i in range(n_dots):
        size, n_blocks = _meet(
            dot_start[i], dot_start[i + 1], order, group_start, camera, group_placement, n_cameras, offset, width,
            local, blocks, column,
        )  # fmt: skip
        if size == 0:
            continue
        w[:, :size] = 0.0
        v[:] = information[i]
        g[:] = pull[i]
        for place in range(dot_start[i], dot_start[i + 1]):
            count = _group(
                place, order, group_start, camera, group_placement, n_cameras, residual, by_camera, by_placement,
                arm, q, offset, width, matrix, gradient, diagonal, e, qe, own, b, vr,
            )  # fmt: skip
            for a in range(3):  # pr = (I - V Q) R, by which the dot meets what the place meets
                for c in range(3):
                    pr[a, c] = p[place, a, 0] * turn[place, 0, c] + p[place, a, 1] * turn[place, 1, c] + (
                        p[place, a, 2] * turn[place, 2, c])  # fmt: skip
            _add_place(w, v, g, e, own, count, local, offset, pr, turn[place], vr, b)
        if kept_block[i] >= 0:
            _keep(matrix, gradient, diagonal, offset[kept_block[i]], v, g, w, column, size)
        else:
            _invert(v, damping, inverse[i])
            dot_gradient[i] = g
            _weigh(y, inverse[i], w, size)
            _subtract(matrix, y, w, column, size)
            for s in range(size):
                gradient[column[s]] -= y[0, s] * g[0] + y[1, s] * g[1] + y[2, s] * g[2]
        for s in range(n_blocks):
            local[blocks[s]] = -1


@njit(**INNER)
def _meet(
    first, last, order, group_start, camera, group_placement, n_cameras, offset, width, local, blocks, column
):  # fmt: skip
    """Blocks that meet a dot, in order, the first local column of each, and the global column of every local one."""
    n_blocks = 0
    for place in range(first, last):
        if group_start[place] == group_start[place + 1]:
            continue
        block = n_cameras + group_placement[place]
        if local[block] < 0:
            local[block] = 0
            blocks[n_blocks] = block
            n_blocks += 1
        for k in range(group_start[place], group_start[place + 1]):
            block = camera[order[k]]
            if local[block] < 0:
                local[block] = 0
                blocks[n_blocks] = block
                n_blocks += 1
    blocks[:n_blocks].sort()
    size = 0
    for s in range(n_blocks):
        block = blocks[s]
        local[block] = size
        for j in range(width[block]):
            column[size + j] = offset[block] + j
        size += width[block]
    return size, n_blocks


@njit(**INNER)
def _group(
    place, order, group_start, camera, group_placement, n_cameras, residual, by_camera, by_placement,
    arm, q, offset, width, matrix, gradient, diagonal, e, qe, own, b, vr,
):  # fmt: skip
    """One dot at one placement: its rows' squares less E'QE with E = J' times rows; returns the columns of E.

    e: E, own: global column of each of its columns, b: J' times residuals, vr: V of the place.
    """
    vr[:] = 0.0
    b[:] = 0.0
    if group_start[place] == group_start[place + 1]:
        return 0
    count = 0
    t = offset[n_cameras + group_placement[place]]
    for k in range(group_start[place], group_start[place + 1]):  # cameras in order, as observations of a point are
        n = order[k]
        c = camera[n]
        row0, row1, pose0, pose1 = by_camera[n, 0], by_camera[n, 1], by_placement[n, 0], by_placement[n, 1]
        _add_rows(matrix, gradient, diagonal, offset[c], row0, row1, residual[n])
        _add_rows(matrix, gradient, diagonal, t, pose0, pose1, residual[n])
        if k == group_start[place] or c != camera[order[k - 1]]:  # a camera may show the place twice
            _open_columns(e, own, count, offset[c], width[c])
            count += width[c]
        _couple(matrix, e, count - width[c], offset[c], t, row0, row1, pose0, pose1)
        for a in range(3):
            b[a] += pose0[3 + a] * residual[n, 0] + pose1[3 + a] * residual[n, 1]
            for d in range(3):
                vr[a, d] += pose0[3 + a] * pose0[3 + d] + pose1[3 + a] * pose1[3 + d]
    x, y, z = arm[place, 0], arm[place, 1], arm[place, 2]
    for a in range(3):  # V [-[arm]x, I]
        e[a, count] = vr[a, 2] * y - vr[a, 1] * z
        e[a, count + 1] = vr[a, 0] * z - vr[a, 2] * x
        e[a, count + 2] = vr[a, 1] * x - vr[a, 0] * y
        e[a, count + 3], e[a, count + 4], e[a, count + 5] = vr[a, 0], vr[a, 1], vr[a, 2]
    for d in range(6):
        own[count + d] = t + d
    count += 6
    if q[place, 0, 0] > 0:
        _weigh(qe, q[place], e, count)
        _subtract(matrix, qe, e, own, count)
        for s in range(count):
            gradient[own[s]] -= qe[0, s] * b[0] + qe[1, s] * b[1] + qe[2, s] * b[2]
    return count


@njit(**INNER)
def _open_columns(e, own, first, column, width):
    """Columns of E for another camera, empty."""
    for a in range(width):
        own[first + a] = column + a
        e[0, first + a] = e[1, first + a] = e[2, first + a] = 0.0


@njit(**INNER)
def _couple(matrix, e, first, column, pose, row0, row1, pose0, pose1):
    """One observation's share in what couples its camera to the placement and, in E, to the place."""
    for a in range(len(row0)):
        for d in range(6):
            matrix[column + a, pose + d] += row0[a] * pose0[d] + row1[a] * pose1[d]
        for d in range(3):
            e[d, first + a] += pose0[3 + d] * row0[a] + pose1[3 + d] * row1[a]


@njit(**INNER)
def _add_rows(matrix, gradient, diagonal, first, row0, row1, residual):
    """One observation's two rows by the columns of one block."""
    for a in range(len(row0)):
        gradient[first + a] += row0[a] * residual[0] + row1[a] * residual[1]
        diagonal[first + a] += row0[a] * row0[a] + row1[a] * row1[a]
        for d in range(a, len(row0)):
            matrix[first + a, first + d] += row0[a] * row0[d] + row1[a] * row1[d]


@njit(**INNER)
def _weigh(out, square, rows, size):
    """out = square rows, (3,size)."""
    for a in range(3):
        for s in range(size):
            out[a, s] = square[a, 0] * rows[0, s] + square[a, 1] * rows[1, s] + square[a, 2] * rows[2, s]


@njit(**INNER)
def _add_place(w, v, g, e, own, count, local, offset, pr, turn, vr, b):
    """A place's share in its dot's coupling W' = sum R'(I - V Q) E, normal matrix and gradient."""
    block = 0
    for s in range(count):
        if s == 0 or own[s] != own[s - 1] + 1 or (block + 1 < len(offset) and own[s] >= offset[block + 1]):
            block = np.searchsorted(offset, own[s], side="right") - 1
        at = local[block] + own[s] - offset[block]
        for a in range(3):
            w[a, at] += pr[0, a] * e[0, s] + pr[1, a] * e[1, s] + pr[2, a] * e[2, s]
    for a in range(3):
        g[a] += pr[0, a] * b[0] + pr[1, a] * b[1] + pr[2, a] * b[2]
        for c in range(3):
            for d in range(3):
                v[a, c] += pr[d, a] * (vr[d, 0] * turn[0, c] + vr[d, 1] * turn[1, c] + vr[d, 2] * turn[2, c])


@njit(**INNER)
def _subtract(matrix, left, right, column, size):
    """matrix -= left' right in the upper triangle; columns ascend."""
    for i in range(size):
        l0, l1, l2 = left[0, i], left[1, i], left[2, i]
        row = matrix[column[i]]
        for j in range(i, size):
            row[column[j]] -= l0 * right[0, j] + l1 * right[1, j] + l2 * right[2, j]


@njit(**INNER)
def _keep(matrix, gradient, diagonal, first, v, g, w, column, size):
    """A dot of a length row stays in the system."""
    for a in range(3):
        gradient[first + a] += g[a]
        diagonal[first + a] += v[a, a]
        for c in range(3):
            matrix[first + a, first + c] += v[a, c]
        for s in range(size):
            matrix[column[s], first + a] += w[a, s]


@njit(**INNER)
def _invert(v, damping, out):
    """Inverse of a symmetric 3x3 matrix whose diagonal is multiplied by 1 + damping."""
    f = 1.0 + damping
    a, b, c, d, e, g = v[0, 0] * f, v[0, 1], v[0, 2], v[1, 1] * f, v[1, 2], v[2, 2] * f
    m00, m01, m02 = d * g - e * e, c * e - b * g, b * e - c * d
    inv = 1.0 / (a * m00 + b * m01 + c * m02)
    out[0, 0], out[0, 1], out[0, 2] = m00 * inv, m01 * inv, m02 * inv
    out[1, 0], out[1, 1], out[1, 2] = m01 * inv, (a * g - c * c) * inv, (b * c - a * e) * inv
    out[2, 0], out[2, 1], out[2, 2] = m02 * inv, (b * c - a * e) * inv, (a * d - b * b) * inv
