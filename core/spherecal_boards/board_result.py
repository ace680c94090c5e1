"""The results of the other methods put together: cameras with uncertainties, points, residuals and findings."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.findings import Finding
from spherecal.data.observations import Features, Observations
from spherecal.data.rig import Calibration, CameraCovariance, CameraSigma, Quality, Rig, RigCamera, RigScale
from spherecal.data.session import Session
from spherecal.data.verdict import affected, is_valid, ruled, widening
from spherecal.diagnose.run_checks import STATED_LENGTH_MM
from spherecal.geometry.camera import N_INTRINSICS
from spherecal.geometry.length_uncertainty import Cameras
from spherecal.geometry.volume_map import LengthMap, length_map, measured_volume
from spherecal_boards.frames_covariance import FrameCovariance
from spherecal_boards.frames_evidence import FrameAdjustment


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
    adjustment: FrameAdjustment | None = None


def assemble_fit(
    session: Session, fit: Fit, scale: RigScale, findings: list[Finding], method: str, seconds: dict[str, float]
) -> Calibration:
    """The calibration of a session from its fit."""
    names = [session.cameras[c].id for c in np.flatnonzero(fit.placed)]
    lengths, poses = widening(ruled(findings), names, "free" if method == "bar" else "rigid")
    most = float(lengths.max(initial=1.0))
    scale = _wider_scale(fit, scale, most)
    of_scale = ("scale-uncertainty", "print-unmeasured")
    ordered = ruled(
        [replace(f, values={**f.values, **_on_a_length(scale)}) if f.code in of_scale else f for f in findings]
    )
    size = np.linalg.norm(fit.residual[fit.used], axis=1)
    quality = Quality(
        valid=is_valid(ordered),
        rms_px=float(np.sqrt((size**2).mean())) if len(size) else None,
        mean_px=float(size.mean()) if len(size) else None,
        sigma0=float(np.sqrt(fit.variance)) if np.isfinite(fit.variance) else None,
        findings=ordered,
        affected=affected(ordered, names),
    )
    cameras = tuple(
        _camera(session, fit, int(c), factor) for c, factor in zip(np.flatnonzero(fit.placed), poses, strict=True)
    )
    covariance = _covariance(fit, scale, lengths)
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
    variance = most**2 * fit.variance * np.einsum("pii->pi", fit.points_cofactor)
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


def _wider_scale(fit: Fit, scale: RigScale, factor: float) -> RigScale:
    """The scale with the share of noise in its uncertainty times a factor."""
    if scale.relative_uncertainty is None or fit.covariance is None:
        return scale
    more = np.sqrt((factor**2 - 1) * fit.variance) * fit.covariance.relative_scale
    return replace(scale, relative_uncertainty=float(np.hypot(scale.relative_uncertainty, more)))


def _on_a_length(scale: RigScale) -> dict[str, float]:
    return {} if scale.relative_uncertainty is None else {"mm": scale.relative_uncertainty * STATED_LENGTH_MM}


def _camera(session: Session, fit: Fit, c: int, wider: float) -> RigCamera:
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
        sigma=_sigma(fit, c, wider),
    )


def _sigma(fit: Fit, c: int, wider: float) -> CameraSigma | None:
    if fit.covariance is None or not np.isfinite(fit.variance):
        return None
    cofactors = fit.covariance.cameras[c] * fit.variance * wider**2
    rotation = fit.state.rotation[c]
    centre = rotation.T @ cofactors[3:POSE, 3:POSE] @ rotation
    diagonal = np.sqrt(np.maximum(np.diag(cofactors), 0.0))
    columns = fit.problem.intrinsic_columns
    intrinsics = np.zeros(N_INTRINSICS)
    intrinsics[columns] = np.where(fit.problem.free_intrinsics[c, columns], diagonal[POSE:], 0.0)
    return CameraSigma(np.rad2deg(diagonal[:3]), np.sqrt(np.maximum(np.diag(centre), 0.0)), intrinsics)


def _covariance(fit: Fit, scale: RigScale, wider: FloatArray) -> CameraCovariance | None:
    """The covariance of all placed cameras, the noise `wider` (k,), with the scale's share; None without one."""
    if fit.covariance is None or not np.isfinite(fit.variance) or scale.relative_uncertainty is None:
        return None
    stretch = fit.covariance.stretch * scale.relative_uncertainty
    width = POSE + len(fit.problem.intrinsic_columns)
    keep, each = np.repeat(fit.placed, width), np.repeat(wider, width)
    noise = fit.variance * fit.covariance.all_cameras[np.ix_(keep, keep)] * np.outer(each, each)
    return CameraCovariance(noise + np.outer(stretch[keep], stretch[keep]), fit.problem.intrinsic_columns)


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
    """Connected groups of cameras by their links (c,c): the placed ones first, then the largest."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    label = connected_components(csr_array(linked > 0), directed=False)[1]
    groups = [np.flatnonzero(label == value) for value in dict.fromkeys(label.tolist())]
    return sorted(groups, key=lambda group: (-int(placed[group].any()), -len(group), int(group[0])))
