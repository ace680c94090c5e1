"""Rotations: exponential map, logarithm and the nearest rotation; vector products."""

import numpy as np
from scipy.spatial.transform import Rotation

from spherecal.base.arrays import FloatArray


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vector products (..., 3): numpy's, to the bit, without what `np.cross` takes to allow for other axes."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(a[..., j], b[..., k], out=out[..., i])
        out[..., i] -= a[..., k] * b[..., j]
    return out


def cross_matrix(v: FloatArray) -> FloatArray:
    """The matrices [v] with [v] a = v x a; (..., 3) to (..., 3, 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        out[..., j, k], out[..., k, j] = -v[..., i], v[..., i]
    return out


def exp_rotation(w: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians."""
    flat = np.asarray(w, dtype=float).reshape(-1, 3)
    return Rotation.from_rotvec(flat).as_matrix().reshape(*np.shape(w)[:-1], 3, 3)


def log_rotation(r: FloatArray) -> FloatArray:
    """Rotation vectors (..., 3) in radians, at most pi long, of rotation matrices (..., 3, 3)."""
    flat = np.asarray(r, dtype=float).reshape(-1, 3, 3)
    return Rotation.from_matrix(flat).as_rotvec().reshape(*np.shape(r)[:-2], 3)


def nearest_rotation(m: FloatArray) -> FloatArray:
    """The rotation nearest to a 3x3 matrix in the Frobenius norm (its polar factor with determinant +1)."""
    u, _, vt = np.linalg.svd(m)
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
