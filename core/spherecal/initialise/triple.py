"""Local reconstruction of a triple of cameras: projective factorisation and Euclidean upgrade, [Tao21] (3)-(9)."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.rotation import cross, nearest_rotation

# Fewest points of an eight-point estimate with some redundancy left.
MIN_POINTS = 12
# What an eight-point estimate needs at least.
MIN_EIGHT_POINT = 8
# A triple whose reconstruction has fewer of its points before all three cameras is no reconstruction: right ones had
# at least 97 % on rigs A and B with nominal intrinsics, wrong ones 40 to 70 %.
MIN_IN_FRONT = 0.9
# Points whose error is this many times the triple's median are mismatches: good ones stay below 4 (nominal intrinsics,
# no distortion known).
OUTLIER_FACTOR = 5.0


@dataclass(frozen=True)
class Triple:
    """A reconstructed triple in a frame and scale of its own.

    `cameras` (3,) indices, `rotation` (3,3,3), `translation` (3,3), `features` (n,) indices, `points` (n,3), `error_px`
    (3,) the mean reprojection error of each camera, E_R of (10).
    """

    cameras: tuple[int, int, int]
    rotation: FloatArray
    translation: FloatArray
    features: IntArray
    points: FloatArray
    error_px: FloatArray

    def baseline(self, i: int, j: int) -> float:
        """Distance between the centres of two of its cameras."""
        centre = -np.einsum("cji,cj->ci", self.rotation, self.translation)
        return float(np.linalg.norm(centre[i] - centre[j]))


def reconstruct_triple(
    cameras: tuple[int, int, int], features: IntArray, xy: FloatArray, focal_px: FloatArray
) -> Triple | None:
    """The Euclidean reconstruction of three cameras from common features at `xy` (3,n,2), None where it fails.

    Points far worse than the rest are left out in a second attempt: the two-view gate before this lets through what is
    along the epipolar lines by chance.
    """
    attempt = _attempt(xy)
    if attempt is None:
        return None
    size = (attempt.error * focal_px[:, None]).max(axis=0)
    good = attempt.in_front & (size <= OUTLIER_FACTOR * np.median(size))
    if not good.all():
        features = features[good]
        attempt = _attempt(xy[:, good])
    if attempt is None or attempt.in_front.mean() < MIN_IN_FRONT:
        return None
    front = attempt.in_front
    error_px = attempt.error[:, front].mean(axis=1) * focal_px
    return Triple(cameras, attempt.rotation, attempt.translation, features[front], attempt.points[front], error_px)


@dataclass(frozen=True)
class _Attempt:
    """Poses (3,3,3), (3,3), points (n,3), errors in normalised units (3,n), which are in front of all cameras (n,)."""

    rotation: FloatArray
    translation: FloatArray
    points: FloatArray
    error: FloatArray
    in_front: BoolArray


def _attempt(xy: FloatArray) -> _Attempt | None:
    found = factorised(xy) if xy.shape[1] >= MIN_POINTS else None
    return None if found is None else _intersect(found[0], found[1], _rays(xy))


def factorised(xy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Rotations (3,3,3), translations (3,3) and points (n,3) of normalised image points (3,n,2), (3)-(9)."""
    measurement = _scaled_measurements(_rays(xy))
    return None if measurement is None else _euclidean_upgrade(*_factorise(measurement))


def _rays(xy: FloatArray) -> FloatArray:
    return np.concatenate([xy, np.ones((*xy.shape[:2], 1))], axis=2)


def _intersect(rotation: FloatArray, translation: FloatArray, rays: FloatArray) -> _Attempt:
    """The points nearest to their rays."""
    direction = np.einsum("cji,cnj->cni", rotation, rays)
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    centre = -np.einsum("cji,cj->ci", rotation, translation)
    across = np.eye(3) - direction[..., :, None] * direction[..., None, :]
    normal = across.sum(axis=0)
    right = np.einsum("cnij,cj->ni", across, centre)
    points = np.linalg.solve(normal + 1e-12 * np.eye(3), right[:, :, None])[:, :, 0]
    x = np.einsum("cij,nj->cni", rotation, points) + translation[:, None]
    front = (x[:, :, 2] > 0).all(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.linalg.norm(x[:, :, :2] / x[:, :, 2:] - rays[:, :, :2], axis=2)
    return _Attempt(rotation, translation, points, error, front)


def _scaled_measurements(rays: FloatArray) -> FloatArray | None:
    """The measurement matrix (9, n): rays times their projective depths, chained from the first camera, (3)-(5)."""
    depths = [np.ones(rays.shape[1])]
    for j in (1, 2):
        fundamental = _eight_point(rays[0], rays[j])
        epipole = np.linalg.svd(fundamental)[0][:, 2]  # e_jg: e' F = 0
        across = cross(epipole, rays[j])
        norm = (across * across).sum(axis=1)
        if (norm < 1e-12).any():
            return None
        depths.append((across * (rays[0] @ fundamental.T)).sum(axis=1) / norm)
    measurement = (rays * np.array(depths)[:, :, None]).transpose(0, 2, 1).reshape(9, -1)
    return measurement if np.isfinite(measurement).all() else None


def _eight_point(a: FloatArray, b: FloatArray) -> FloatArray:
    """F with b' F a = 0 from rays (n, 3), rank 2; R. Hartley, In defense of the eight-point algorithm (1997)."""
    ta, tb = _centring(a), _centring(b)
    an, bn = a @ ta.T, b @ tb.T
    design = (bn[:, :, None] * an[:, None, :]).reshape(-1, 9)
    f = np.linalg.eigh(design.T @ design)[1][:, 0].reshape(3, 3)
    u, s, vt = np.linalg.svd(f)
    return tb.T @ (u * [s[0], s[1], 0.0]) @ vt @ ta


def _centring(rays: FloatArray) -> FloatArray:
    """The similarity of image points that centres them at a mean distance of sqrt 2, 3x3."""
    xy = rays[:, :2]
    mean = xy.mean(axis=0)
    s = np.sqrt(2.0) / max(np.linalg.norm(xy - mean, axis=1).mean(), 1e-12)
    return np.array([[s, 0, -s * mean[0]], [0, s, -s * mean[1]], [0, 0, 1]])


def _factorise(measurement: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Projective cameras (3, 3, 4) and points (4, n) of the balanced measurement matrix by a rank-4 SVD, (6)."""
    balanced = measurement.copy()
    for _ in range(3):  # rows of a camera and columns to equal size, so that no point or camera dominates
        balanced /= np.linalg.norm(balanced, axis=0)
        by_camera = balanced.reshape(3, -1)
        balanced = (by_camera / np.linalg.norm(by_camera, axis=1, keepdims=True)).reshape(9, -1)
    u, s, vt = np.linalg.svd(balanced, full_matrices=False)
    root = np.sqrt(s[:4])
    return (u[:, :4] * root).reshape(3, 3, 4), root[:, None] * vt[:4]


def _euclidean_upgrade(cameras: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Rotations (3,3,3), translations (3,3) and points (n,3): P_i H = alpha_i [R_i t_i], (7)-(9).

    With normalised image points P_i W P_i' is a multiple of I for the dual absolute quadric W = A A': linear in its ten
    numbers, five equations a camera.
    """
    quadric = _dual_quadric(cameras)
    values, vectors = np.linalg.eigh(quadric)
    if np.abs(values).max() <= 0:
        return None
    if -values[0] > values[3]:  # the linear system leaves the sign open
        values, vectors = -values[::-1], vectors[:, ::-1]
    if values[1] <= 0:  # not positive semidefinite of rank 3: no real cameras explain it
        values = np.abs(values)
    a = vectors[:, 1:] * np.sqrt(np.abs(values[1:]))
    origin = np.linalg.svd(cameras[0])[2][3]  # the first camera's centre becomes the origin
    h = np.column_stack([a, origin])
    if abs(np.linalg.det(h)) < 1e-12 * np.linalg.norm(a) ** 3:
        return None
    best = None
    for sign in (1.0, -1.0):
        candidate = _metric(cameras, points, h * [1, 1, 1, sign])
        if candidate is not None and (best is None or candidate[0] > best[0]):
            best = candidate
    return None if best is None else best[1:]


def _dual_quadric(cameras: FloatArray) -> FloatArray:
    """The dual absolute quadric (4, 4) from P W P' ~ I, by least squares."""
    index = [(i, j) for i in range(4) for j in range(i, 4)]

    def entry(p: FloatArray, r: int, s: int) -> list[float]:
        """Coefficients of (P W P')_rs in the ten numbers of W."""
        return [p[r, i] * p[s, j] + (p[r, j] * p[s, i] if i != j else 0.0) for i, j in index]

    rows = []
    for camera in cameras:
        p = camera / np.linalg.norm(camera[2])
        xx, yy, zz = (np.array(entry(p, k, k)) for k in range(3))
        rows += [xx - yy, yy - zz, np.array(entry(p, 0, 1)), np.array(entry(p, 0, 2)), np.array(entry(p, 1, 2))]
    w = np.linalg.svd(np.array(rows))[2][-1]
    quadric = np.zeros((4, 4))
    for value, (i, j) in zip(w, index, strict=True):
        quadric[i, j] = quadric[j, i] = value
    return quadric


def _metric(
    cameras: FloatArray, points: FloatArray, h: FloatArray
) -> tuple[float, FloatArray, FloatArray, FloatArray] | None:
    """Share of points in front of all cameras, rotations, translations and points (n,3) of one choice of signs."""
    x = np.linalg.solve(h, points)
    rotation, translation = np.empty((3, 3, 3)), np.empty((3, 3))
    for i, q in enumerate(cameras @ h):
        alpha = np.cbrt(np.linalg.det(q[:, :3]))
        if alpha == 0:
            return None
        rotation[i] = nearest_rotation(q[:, :3] / alpha)
        translation[i] = q[:, 3] / alpha
    # multiplied by the homogeneous coordinate's square instead of divided by it: only the sign matters
    depth = (np.einsum("cj,jn->cn", rotation[:, 2], x[:3]) + translation[:, 2:3] * x[3]) * x[3]
    with np.errstate(divide="ignore", invalid="ignore"):
        places = (x[:3] / x[3]).T
    return float((depth > 0).all(axis=0).mean()), rotation, translation, places
