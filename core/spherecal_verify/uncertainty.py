"""The uncertainty of measured lengths after the GUM: parts of one length, and statistics over poses."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.data.rig import Rig
from spherecal.data.session import Bar, BarLength
from spherecal.geometry.camera import project_with_derivatives
from spherecal.geometry.rotation import cross_matrix
from spherecal.scale.bar_temperature import temperature_part
from spherecal_verify.marks import MarkPlace
from spherecal_verify.outlying_views import CheckedPoints
from spherecal_verify.verification import LengthBudget, LengthStatistics, MeasuredLength, Overall

# k = 2 for a normal distribution, as certificates are stated.
COVERAGE = 0.9545


@dataclass(frozen=True)
class PointErrors:
    """The errors of `checked` points: by noise with `covariance` (m, 3, 3) mm^2, and by the cameras that see them.

    `by_camera` (n, 3, w) is the shift of the point of row i in mm by the w parameters of its camera, whose covariance
    is `cameras` (c*w, c*w). `with_scale` says that it holds the scale's share too. Where points share more, `by_shared`
    (m, 3, q) is their shift by q more parameters, the last of `cameras` then.
    """

    checked: CheckedPoints
    covariance: FloatArray
    by_camera: FloatArray
    cameras: FloatArray
    with_scale: bool
    by_shared: FloatArray | None = None


def point_errors(checked: CheckedPoints, rig: Rig) -> PointErrors:
    """The errors of triangulated points to first order.

    Without the cameras' covariance only the standard uncertainties of the focal lengths count: 1.03 to 1.9 times the
    full covariance's for bars of 100 to 500 mm on rigs A and B. All of them as independent overstate a length's by 2 to
    8, since turns, principal point and distortion make up for each other.
    """
    views, points, covariance = checked.views, checked.points, rig.covariance
    rotation, k = views.rotation[views.camera], views.intrinsics[views.camera]
    x_camera = np.einsum("nij,nj->ni", rotation, points.points[views.feature]) + views.translation[views.camera]
    _, by_camera_point, by_intrinsics = project_with_derivatives(x_camera, k)
    if covariance is None:
        columns, matrix = np.arange(2), np.diag(np.square(focal_sigmas(rig)).ravel())
        by_parameters = by_intrinsics[:, :, columns]
    else:
        columns, matrix = covariance.intrinsics, covariance.matrix
        by_turn = -by_camera_point @ cross_matrix(x_camera)
        by_parameters = np.concatenate([by_turn, by_camera_point, by_intrinsics[:, :, columns]], axis=2)
    weighted = (by_camera_point @ rotation) * (checked.kept[:, None] / views.sigma**2)[:, :, None]
    cofactor = points.covariance
    by_camera = -cofactor[views.feature] @ np.swapaxes(weighted, 1, 2) @ by_parameters
    return PointErrors(checked, checked.noise**2 * cofactor, by_camera, matrix, covariance is not None)


def focal_sigmas(rig: Rig) -> FloatArray:
    """Standard uncertainties (c, 2) of fu and fv in px; 0 where they are not known."""
    sigma = [np.zeros(2) if camera.sigma is None else camera.sigma.intrinsics[:2] for camera in rig.cameras]
    return np.nan_to_num(np.array(sigma))


def length_budget(
    ends: tuple[MarkPlace, MarkPlace],
    errors: PointErrors,
    scale_relative: float,
    certified: BarLength,
    bar: Bar,
    temperature_c: float | None,
) -> LengthBudget:
    """Standard uncertainties (mm) of one measured length's error, the scale's share apart from the calibration's."""
    length = float(np.linalg.norm(ends[1].place_mm - ends[0].place_mm))
    features, by_point = length_by_points(ends)
    noise = np.einsum("ki,kij,kj->", by_point, errors.covariance[features], by_point)
    calibration, scale = calibration_variance(features, by_point, errors), scale_relative * length
    if errors.with_scale:
        calibration = max(calibration - scale**2, 0.0)
    return LengthBudget(
        noise_mm=math.sqrt(noise),
        calibration_mm=math.sqrt(calibration),
        scale_mm=scale,
        certificate_mm=certified.expanded_uncertainty_mm / certified.coverage_factor,
        temperature_mm=temperature_part(certified.length_mm, bar, temperature_c),
    )


def calibration_variance(features: np.ndarray, by_point: FloatArray, errors: PointErrors) -> float:
    """The cameras' share in the variance of a function of points, by its derivatives (k, 3); they err for all alike."""
    gradient = camera_gradient(features, by_point, errors)
    return float(gradient @ errors.cameras @ gradient)


def length_by_points(ends: tuple[MarkPlace, MarkPlace]) -> tuple[IntArray, FloatArray]:
    """The points (k,) that the length between two marks rests on, and its derivatives by them, (k, 3)."""
    between = ends[1].place_mm - ends[0].place_mm
    direction = between / float(np.linalg.norm(between))
    features = np.concatenate([ends[0].features, ends[1].features])
    return features, np.concatenate([-direction @ ends[0].by_point, direction @ ends[1].by_point])


def camera_gradient(features: np.ndarray, by_point: FloatArray, errors: PointErrors) -> FloatArray:
    """How a function of points (derivatives (k, 3)) follows cameras' and, if any, q shared parameters: (c*w + q,)."""
    views = errors.checked.views
    by_feature = np.zeros((views.n_features, 3))
    np.add.at(by_feature, features, by_point)
    rows = np.flatnonzero(np.isin(views.feature, features))
    by_row = np.einsum("ni,niw->nw", by_feature[views.feature[rows]], errors.by_camera[rows])
    by_camera = np.zeros((len(views.rotation), errors.by_camera.shape[2]))
    np.add.at(by_camera, views.camera[rows], by_row)
    if errors.by_shared is None:
        return by_camera.ravel()
    return np.concatenate([by_camera.ravel(), np.einsum("mi,miq->q", by_feature, errors.by_shared)])


def length_statistics(measured: Sequence[MeasuredLength], errors_of: PointErrors | None = None) -> LengthStatistics:
    """One certified length over its poses, with the expanded uncertainty of its mean error (Welch-Satterthwaite).

    The scatter of the mean (type A) averages, and the cameras' share where it differs from pose to pose (`errors_of`);
    all else errs alike in every pose.
    """
    first, n = measured[0], len(measured)
    errors = np.array([m.error_mm for m in measured])
    parts = ("noise_mm", "calibration_mm", "scale_mm", "certificate_mm", "temperature_mm")
    mean_square = {part: float(np.mean([getattr(m.budget, part) ** 2 for m in measured])) for part in parts}
    if errors_of is not None:
        mean_square["calibration_mm"] = _calibration_of_mean(measured, errors_of, mean_square)
    sd = float(errors.std(ddof=1)) if n > 1 else None
    # a single pose has no scatter of its own: the noise of its image points is used, as type B
    repeatability = math.sqrt(mean_square["noise_mm"]) if sd is None else sd / math.sqrt(n)
    budget = LengthBudget(**{**{part: math.sqrt(value) for part, value in mean_square.items()}, "noise_mm": 0.0})
    combined = math.hypot(repeatability, budget.combined_mm)
    factor = _coverage_factor(combined, repeatability if sd is not None else 0.0, n - 1)
    return LengthStatistics(
        first.bar,
        first.from_mark,
        first.to_mark,
        n,
        mean_error_mm=float(errors.mean()),
        sd_mm=sd,
        max_abs_error_mm=float(np.abs(errors).max()),
        repeatability_mm=repeatability,
        budget=budget,
        expanded_uncertainty_mm=factor * combined,
        coverage_factor=factor,
    )


def _calibration_of_mean(
    measured: Sequence[MeasuredLength], errors: PointErrors, mean_square: dict[str, float]
) -> float:
    """The cameras' share in the variance of the mean over poses: where it differs from pose to pose it averages."""
    gradients = [m.by_cameras for m in measured if m.by_cameras is not None]
    if len(gradients) < len(measured):
        return mean_square["calibration_mm"]
    mean = np.mean(gradients, axis=0)
    variance = float(mean @ errors.cameras @ mean)
    return max(variance - mean_square["scale_mm"], 0.0) if errors.with_scale else variance


def _coverage_factor(combined: float, type_a: float, type_a_freedom: int) -> float:
    """Student's factor for the effective degrees of freedom, all type B parts being known exactly."""
    if type_a_freedom < 1 or type_a <= 0:
        return float(ndtri((1 + COVERAGE) / 2))
    freedom = type_a_freedom * (combined / type_a) ** 4
    return float(stdtrit(freedom, (1 + COVERAGE) / 2))


def overall_statistics(measured: Sequence[MeasuredLength]) -> Overall:
    """Number, mean, standard deviation, rms and largest of all errors together, in mm."""
    errors = np.array([m.error_mm for m in measured])
    if not len(errors):
        return Overall(0, None, None, None, None)
    sd = float(errors.std(ddof=1)) if len(errors) > 1 else None
    rms = float(np.sqrt((errors**2).mean()))
    return Overall(len(errors), float(errors.mean()), sd, rms, float(np.abs(errors).max()))
