"""The camera models (docs/conventions.md): OpenCV's full lens model and its fisheye model, derivatives and inverses."""

from typing import Literal

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray, blocks
from spherecal.geometry import fisheye

INTRINSIC_NAMES = (
    "fu", "fv", "u0", "v0",
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4",
)  # fmt: skip
N_INTRINSICS = len(INTRINSIC_NAMES)

# A fisheye lens has k1..k4 in the four places after v0 and this in the last place (s4), which no lens of the other
# model can have: at 1 degree off the axis it would be 1e12 px. It is copied, never estimated, never computed with.
FISHEYE_MARK = 2.0**64
FISHEYE_NAMES = ("fu", "fv", "u0", "v0", "k1", "k2", "k3", "k4")

LensModel = Literal["brown", "rational", "fisheye"]
LENS_MODELS: tuple[LensModel, ...] = ("brown", "rational", "fisheye")

PRESETS: dict[str, tuple[str, ...]] = {
    "brown": ("fu", "fv", "u0", "v0", "k1", "k2", "p1", "p2", "k3"),
    "rational": ("fu", "fv", "u0", "v0", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": FISHEYE_NAMES,
    "tao2021": ("fu", "fv", "u0", "v0", "k1", "k2", "k3", "s1", "s3"),
}


def estimated_mask(preset: str) -> BoolArray:
    """Which of the 16 intrinsics a preset estimates, shape (16,)."""
    if preset == "fisheye":
        return np.arange(N_INTRINSICS) < len(FISHEYE_NAMES)
    return np.isin(INTRINSIC_NAMES, PRESETS[preset])


def is_fisheye(intrinsics: FloatArray) -> BoolArray:
    """Which lenses follow the fisheye model: intrinsics (..., 16) to (...,) bool."""
    return np.asarray(intrinsics[..., 15] == FISHEYE_MARK)


def lens_names(intrinsics: FloatArray) -> tuple[str, ...]:
    """What the numbers of a lens (16,) are called, in their order: 16, or 8 of a fisheye lens."""
    return FISHEYE_NAMES if is_fisheye(intrinsics) else INTRINSIC_NAMES


def lens_model(intrinsics: FloatArray) -> LensModel:
    """The smallest model that describes a lens (16,)."""
    if is_fisheye(intrinsics):
        return "fisheye"
    return "rational" if intrinsics[9:12].any() else "brown"


def fisheye_vector(matrix: FloatArray, distortion: FloatArray | list[float]) -> FloatArray:
    """The 16 intrinsics (16,) of a fisheye lens, of a camera matrix (3, 3) px and its coefficients."""
    vector = intrinsics_vector(matrix, distortion)
    vector[15] = FISHEYE_MARK
    return vector


def intrinsics_vector(matrix: FloatArray, distortion: FloatArray | list[float]) -> FloatArray:
    """The 16 intrinsics (16,) of a lens of OpenCV's full model, of a camera matrix (3, 3) px and its coefficients."""
    k = np.asarray(matrix, dtype=float)
    vector = np.zeros(N_INTRINSICS)
    vector[:4] = k[0, 0], k[1, 1], k[0, 2], k[1, 2]
    vector[4 : 4 + len(distortion)] = distortion
    return vector


def camera_matrix(intrinsics: FloatArray) -> FloatArray:
    """The 3x3 camera matrix K of a vector of 16 intrinsics."""
    fu, fv, u0, v0 = intrinsics[:4]
    return np.array([[fu, 0.0, u0], [0.0, fv, v0], [0.0, 0.0, 1.0]])


# Beyond 1.3 times the corner's distance no point can be in the frame (ordinary lenses distort by some percent there),
# but the lens polynomial may fold and bring it back. A fisheye lens's image radius is an angle.
_REACH, _WIDEST_REACH = 1.3, np.deg2rad(85.0)


def image_reach(intrinsics: FloatArray, sizes: FloatArray) -> FloatArray:
    """The largest tan (n,) of the angle off the axis that images of sizes (n, 2) px hold, by lenses (n, 16)."""
    return reach_of(np.hypot(sizes[:, 0], sizes[:, 1]) / 2, intrinsics)


def reach_of(radius_px: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """The largest tan (n,) of the angle off the axis within a distance of the principal point, by lenses (n, 16)."""
    reach = _REACH * radius_px / intrinsics[:, 0]
    return np.where(is_fisheye(intrinsics), np.tan(np.minimum(reach, _WIDEST_REACH)), reach)


def is_unfolded(x_camera: FloatArray, intrinsics: FloatArray) -> BoolArray:
    """Whether the image radius rises all the way from the axis to each point (n, 3), (n,), by lenses (n, 16).

    Elsewhere the lens model has folded: `project` may bring the point into the image, but no lens shows it there.
    """
    r2, wide = (x_camera[:, 0] ** 2 + x_camera[:, 1] ** 2) / x_camera[:, 2] ** 2, is_fisheye(intrinsics)
    rises = np.empty(len(r2), dtype=bool)
    rises[~wide] = _rises(r2[~wide], intrinsics[~wide])
    rises[wide] = fisheye.rises(r2[wide], intrinsics[wide, 4:8])
    return rises


def distort(xy: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """Normalised ideal image points (n, 2) to distorted ones (n, 2), by one lens (16,) or one a point (n, 16)."""
    wide = is_fisheye(intrinsics)
    if wide.any():
        bent = fisheye.distort(xy, np.moveaxis(intrinsics[..., 4:8], -1, 0))
        return bent if wide.all() else np.where(wide[..., None], bent, _distort_opencv(xy, intrinsics))
    return _distort_opencv(xy, intrinsics)


def _distort_opencv(xy: FloatArray, intrinsics: FloatArray) -> FloatArray:
    x, y = xy[..., 0], xy[..., 1]
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = np.moveaxis(intrinsics[..., 4:], -1, 0)
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
    return np.stack([xd, yd], axis=-1)


def project(x_camera: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """Image points (n, 2) px of points (n, 3) in the camera frame, behind it too; a lens (16,) or (n, 16)."""
    xd = distort(x_camera[..., :2] / x_camera[..., 2:3], intrinsics)
    return xd * intrinsics[..., 0:2] + intrinsics[..., 2:4]


def distort_with_jacobian(xy: FloatArray, intrinsics: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distorted normalised points (n, 2) of ideal ones (n, 2), derivatives (n, 2, 2); a lens (16,) or (n, 16)."""
    wide = is_fisheye(intrinsics)
    if not wide.any():
        return _distort_opencv_with_jacobian(xy, intrinsics)
    bent, by_xy = fisheye.distort_with_jacobian(xy, _columns(intrinsics, len(xy))[4:8])
    if wide.all():
        return bent, by_xy
    distorted, jacobian = _distort_opencv_with_jacobian(xy, intrinsics)
    return np.where(wide[:, None], bent, distorted), np.where(wide[:, None, None], by_xy, jacobian)


def _distort_opencv_with_jacobian(xy: FloatArray, intrinsics: FloatArray) -> tuple[FloatArray, FloatArray]:
    _, _, _, _, k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = _columns(intrinsics, len(xy))
    x, y = np.ascontiguousarray(xy.T)
    r2 = x * x + y * y
    iden = 1 / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) * iden
    slope = (k1 + r2 * (2 * k2 + 3 * k3 * r2) - radial * (k4 + r2 * (2 * k5 + 3 * k6 * r2))) * iden  # radial by r2
    distorted, jacobian = np.empty((len(xy), 2)), np.empty((len(xy), 2, 2))
    distorted[:, 0] = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
    distorted[:, 1] = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
    prism_x, prism_y = 2 * (s1 + 2 * s2 * r2), 2 * (s3 + 2 * s4 * r2)
    across = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    jacobian[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x + x * prism_x
    jacobian[:, 0, 1] = across + y * prism_x
    jacobian[:, 1, 0] = across + x * prism_y
    jacobian[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x + y * prism_y
    return distorted, jacobian


def project_with_point_derivatives(x_camera: FloatArray, intrinsics: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Image points (n, 2) px and derivatives (n, 2, 3) by the points (n, 3); a lens (16,) or one a point (n, 16)."""
    iz = 1.0 / x_camera[:, 2:3]
    xy = x_camera[:, :2] * iz
    distorted, jacobian = distort_with_jacobian(xy, intrinsics)
    focal, centre = intrinsics[..., 0:2], intrinsics[..., 2:4]
    d_point = np.empty((len(x_camera), 2, 3))
    d_point[:, :, :2] = jacobian * (focal * iz)[:, :, None]
    d_point[:, :, 2] = -(d_point[:, :, 0] * xy[:, 0:1] + d_point[:, :, 1] * xy[:, 1:2])
    return distorted * focal + centre, d_point


def project_with_derivatives(x_camera: FloatArray, intrinsics: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Image points (n, 2) px, derivatives by points (n, 2, 3) and intrinsics (n, 2, 16); a lens (16,) or (n, 16)."""
    uv, d_point = project_with_point_derivatives(x_camera, intrinsics)
    n = len(x_camera)
    fu, fv, u0, v0, k1, k2, _, _, k3, k4, k5, k6, _, _, _, _ = _columns(intrinsics, n)
    x, y = np.ascontiguousarray((x_camera[:, :2] / x_camera[:, 2:3]).T)
    r2 = x * x + y * y
    iden = 1 / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) * iden
    d_intr = np.zeros((n, 2, N_INTRINSICS))
    d_intr[:, 0, 0], d_intr[:, 1, 1] = (uv[:, 0] - u0) / fu, (uv[:, 1] - v0) / fv
    d_intr[:, 0, 2] = d_intr[:, 1, 3] = 1.0
    by_radial = np.stack([x * fu, y * fv], axis=1) * iden[:, None]
    factor = r2
    for by_numerator, by_denominator in ((4, 9), (5, 10), (8, 11)):
        d_intr[:, :, by_numerator] = by_radial * factor[:, None]
        d_intr[:, :, by_denominator] = by_radial * (-radial * factor)[:, None]
        factor = factor * r2
    d_intr[:, 0, 6], d_intr[:, 1, 6] = fu * 2 * x * y, fv * (r2 + 2 * y * y)
    d_intr[:, 0, 7], d_intr[:, 1, 7] = fu * (r2 + 2 * x * x), fv * 2 * x * y
    d_intr[:, 0, 12], d_intr[:, 0, 13] = fu * r2, fu * r2 * r2
    d_intr[:, 1, 14], d_intr[:, 1, 15] = fv * r2, fv * r2 * r2
    wide = np.broadcast_to(is_fisheye(intrinsics), n)
    if wide.any():
        focal = np.broadcast_to(intrinsics[..., :2], (n, 2))[wide]
        d_intr[wide, :, 4:] = 0.0
        d_intr[wide, :, 4:8] = fisheye.coefficient_derivatives(np.column_stack([x, y])[wide]) * focal[:, :, None]
    return uv, d_point, d_intr


def _columns(intrinsics: FloatArray, n: int) -> FloatArray:
    """The 16 intrinsics as contiguous columns (16, n), or (16, 1) where all points share them."""
    if intrinsics.ndim == 1:
        return intrinsics[:, None]
    return np.ascontiguousarray(np.broadcast_to(intrinsics, (n, N_INTRINSICS)).T)


# Newton's steps on the 2x2 system converge quadratically; beyond 20 the lens model has folded over itself there.
_UNDISTORT_STEPS = 20
_UNDISTORT_TOLERANCE = 1e-12  # in normalised units: 3e-9 px at f = 3000 px


def undistort(uv: FloatArray, intrinsics: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Normalised ideal points (n,2) of image points (n,2) px by lenses (16,) or (n,16), and where they have inverses.

    Newton's method with halved steps, from the pinhole's answer; of a fisheye lens up to 89 degrees off the axis.
    """
    c = np.broadcast_to(intrinsics, (len(uv), N_INTRINSICS))
    goal = (uv - c[:, 2:4]) / c[:, :2]
    wide = is_fisheye(c)
    if not wide.any():
        return _undistort_opencv(goal, c)
    ideal, good = np.empty((len(uv), 2)), np.empty(len(uv), dtype=bool)
    ideal[wide], good[wide] = fisheye.undistort(goal[wide], c[wide, 4:8])
    ideal[~wide], good[~wide] = _undistort_opencv(goal[~wide], c[~wide])
    return ideal, good


def undistort_views(uv: FloatArray, camera: IntArray, intrinsics: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Normalised points (n, 2) of cameras' image points (n, 2) px, by lenses (c, 16), and where that succeeded."""
    ideal, good = np.empty((len(uv), 2)), np.empty(len(uv), dtype=bool)
    for rows in blocks(len(uv)):
        ideal[rows], good[rows] = undistort(uv[rows], intrinsics[camera[rows]])
    return ideal, good


def _undistort_opencv(goal: FloatArray, c: FloatArray) -> tuple[FloatArray, BoolArray]:
    xy = goal.copy()
    error = _distort_opencv(xy, c) - goal
    size = np.abs(error).max(axis=1)
    for _ in range(_UNDISTORT_STEPS):
        active = ~(size <= _UNDISTORT_TOLERANCE)
        if not active.any():
            break
        jacobian = _distort_opencv_with_jacobian(xy[active], c[active])[1]
        det = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
        e = error[active]
        with np.errstate(divide="ignore", invalid="ignore"):
            step_x = (jacobian[:, 1, 1] * e[:, 0] - jacobian[:, 0, 1] * e[:, 1]) / det
            step_y = (jacobian[:, 0, 0] * e[:, 1] - jacobian[:, 1, 0] * e[:, 0]) / det
        step = np.stack([step_x, step_y], axis=1)
        xy[active], error[active], size[active] = _halved_step(xy[active], step, e, goal[active], c[active])
    # a root on the far side of a fold is no image of a visible point
    jacobian = _distort_opencv_with_jacobian(xy, c)[1]
    det = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
    converged = (size <= 1e3 * _UNDISTORT_TOLERANCE) & (det > 0) & _rises((xy * xy).sum(axis=1), c)
    return np.where(converged[:, None], xy, np.nan), converged


def _rises(r2: FloatArray, intrinsics: FloatArray) -> BoolArray:
    """Whether the radial curve rises all the way from the centre to each point at r^2, (n,)."""
    k1, k2, k3, k4, k5, k6 = intrinsics[:, [4, 5, 8, 9, 10, 11]].T
    s = r2 * (np.arange(1, 9)[:, None] / 8) ** 2
    num, den = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
    slope = num * den + 2 * s * ((k1 + s * (2 * k2 + s * 3 * k3)) * den - num * (k4 + s * (2 * k5 + s * 3 * k6)))
    return ((slope > 0) & (den > 0)).all(axis=0)  # `slope` is that of r radial, times den^2


def _halved_step(
    xy: FloatArray, step: FloatArray, error: FloatArray, goal: FloatArray, intrinsics: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One Newton step, halved for the points where it would not reduce the error; returns (xy, error, size)."""
    size = np.abs(error).max(axis=1)
    step = np.where(np.isfinite(step), step, 0.0)
    best_xy, best_error, best_size = xy.copy(), error.copy(), size.copy()
    factor = np.ones(len(xy))
    for _ in range(6):
        trial = xy - factor[:, None] * step
        trial_error = _distort_opencv(trial, intrinsics) - goal
        trial_size = np.abs(trial_error).max(axis=1)
        better = trial_size < best_size
        best_xy[better], best_error[better], best_size[better] = trial[better], trial_error[better], trial_size[better]
        if (best_size < size).all():
            break
        factor = np.where(best_size < size, factor, factor / 2)
    return best_xy, best_error, best_size
