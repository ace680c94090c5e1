"""The results of the other methods put together: cameras with uncertainties, points, residuals and findings."""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.findings import Finding
from spherecal.data.observations import Features, Observations
from spherecal.data.rig import Calibration, CameraCovariance, CameraSigma, Quality, Rig, RigCamera, RigScale
from spherecal.data.session import Session
from spherecal.data.verdict import affected, is_valid, ruled
from spherecal.geometry.camera import N_INTRINSICS
from spherecal.geometry.length_uncertainty import Cameras
from spherecal.geometry.volume_map import LengthMap, length_map, measured_volume
from spherecal_boards.frames_covariance import FrameCovariance


@dataclass(frozen=True)
class Fit:
    """What an adjustment over frames found, in millimetres and the reference camera's frame.

    `placed` (c,), `problem` that of the cameras; points (m,3) and cofactors (m,3,3), NaN where unknown, belong to
    `features`; residual (n,2) px and used (n,) to `observations`. `variance` is the square of sigma0.
    """

    observations: Observations
    features: Features
    reference: int
    placed: BoolArray
    state: State
    problem: Problem
    covariance: FrameCovariance | None
    points: FloatArray
    points_cofactor: FloatArray
    residual: FloatArray
    used: BoolArray
    variance: float
    converged: bool
    has_prior: BoolArray
    joint: bool = True


def assemble_fit(
    session: Session, fit: Fit, scale: RigScale, findings: list[Finding], method: str, seconds: dict[str, float]
) -> Calibration:
    """The calibration of a session from its fit."""
    ordered = ruled(findings)
    size = np.linalg.norm(fit.residual[fit.used], axis=1)
    quality = Quality(
        valid=is_valid(ordered),
        rms_px=float(np.sqrt((size**2).mean())) if len(size) else None,
        mean_px=float(size.mean()) if len(size) else None,
        sigma0=float(np.sqrt(fit.variance)) if np.isfinite(fit.variance) else None,
        findings=ordered,
        affected=affected(ordered, [session.cameras[c].id for c in np.flatnonzero(fit.placed)]),
    )
    cameras = tuple(_camera(session, fit, int(c)) for c in np.flatnonzero(fit.placed))
    covariance = _covariance(fit, scale)
    rig = Rig(
        session.cameras[fit.reference].id,
        cameras,
        scale,
        quality,
        session.input_sha256,
        covariance,
        _length_map(cameras, covariance, fit),
        recorded_at=session.recorded_at,
    )
    variance = fit.variance * np.einsum("pii->pi", fit.points_cofactor)
    return Calibration(
        rig,
        fit.observations,
        fit.features,
        fit.points,
        np.sqrt(np.maximum(variance, 0.0)),
        np.bincount(fit.features.of_observation[fit.used], minlength=len(fit.features)),
        fit.residual,
        fit.used,
        (),
        method,
        seconds,
    )


def assemble_nothing(
    session: Session,
    observations: Observations,
    features: Features,
    findings: list[Finding],
    method: str,
    seconds: dict[str, float],
) -> Calibration:
    """The result where no camera could be placed."""
    unknown = np.full((len(features), 3), np.nan)
    return Calibration(
        Rig(None, (), RigScale("none", None), Quality(False, None, None, None, tuple(findings)), session.input_sha256),
        observations,
        features,
        unknown,
        unknown,
        np.zeros(len(features), dtype=np.int64),
        np.full((len(observations), 2), np.nan),
        np.zeros(len(observations), dtype=bool),
        (),
        method,
        seconds,
    )


def _camera(session: Session, fit: Fit, c: int) -> RigCamera:
    spec, state = session.cameras[c], fit.state
    own = fit.used & (fit.observations.camera == c)
    return RigCamera(
        spec.id,
        spec.serial,
        spec.image_size,
        state.intrinsics[c],
        state.rotation[c],
        state.translation[c],
        rms_px=float(np.sqrt((fit.residual[own] ** 2).sum(axis=1).mean())) if own.any() else None,
        observations=int(own.sum()),
        sigma=_sigma(fit, c),
    )


def _sigma(fit: Fit, c: int) -> CameraSigma | None:
    if fit.covariance is None or not np.isfinite(fit.variance):
        return None
    cofactors = fit.covariance.cameras[c] * fit.variance
    rotation = fit.state.rotation[c]
    centre = rotation.T @ cofactors[3:POSE, 3:POSE] @ rotation
    diagonal = np.sqrt(np.maximum(np.diag(cofactors), 0.0))
    columns = fit.problem.intrinsic_columns
    intrinsics = np.zeros(N_INTRINSICS)
    intrinsics[columns] = np.where(fit.problem.free_intrinsics[c, columns], diagonal[POSE:], 0.0)
    return CameraSigma(np.rad2deg(diagonal[:3]), np.sqrt(np.maximum(np.diag(centre), 0.0)), intrinsics)


def _covariance(fit: Fit, scale: RigScale) -> CameraCovariance | None:
    """The covariance of all placed cameras together, including the scale's share; None without one."""
    if fit.covariance is None or not np.isfinite(fit.variance) or scale.relative_uncertainty is None:
        return None
    stretch = fit.covariance.stretch * scale.relative_uncertainty
    matrix = fit.variance * fit.covariance.all_cameras + np.outer(stretch, stretch)
    keep = np.repeat(fit.placed, POSE + len(fit.problem.intrinsic_columns))
    return CameraCovariance(matrix[np.ix_(keep, keep)], fit.problem.intrinsic_columns)


def _length_map(cameras: tuple[RigCamera, ...], covariance: CameraCovariance | None, fit: Fit) -> LengthMap | None:
    """The map of a length's uncertainty over what was shown; None where no length can be measured."""
    known = np.isfinite(fit.points[:, 0])
    if covariance is None or len(cameras) < 2 or known.sum() < 2:
        return None
    looking = Cameras(
        np.array([c.intrinsics for c in cameras]),
        np.array([c.rotation for c in cameras]),
        np.array([c.translation_mm for c in cameras]),
        np.array([c.image_size for c in cameras], dtype=float),
        covariance.matrix,
        covariance.intrinsics,
    )
    sigma = 1.0 if fit.observations.sigma is None else float(np.median(fit.observations.sigma[fit.used]))
    volume = measured_volume(fit.points[known], np.array([c.centre_mm for c in cameras]))
    return length_map(looking, volume, max(float(np.sqrt(fit.variance)) * sigma, 1e-4))


def groups_of(linked: IntArray, placed: BoolArray) -> list[IntArray]:
    """Connected groups of cameras: the placed ones first, then the largest.

    `linked`: above 0 for cameras that are linked directly, (c,c); `placed`: cameras that have a pose, (c,).
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    label = connected_components(csr_array(linked > 0), directed=False)[1]
    groups = [np.flatnonzero(label == value) for value in dict.fromkeys(label.tolist())]
    return sorted(groups, key=lambda group: (-int(placed[group].any()), -len(group), int(group[0])))
