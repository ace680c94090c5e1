"""The results of the other methods put together: cameras with uncertainties, points, residuals and findings."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.findings import Finding
from spherecal.data.observations import Features, Observations
from spherecal.data.rig import Calibration, CameraCovariance, CameraSigma, Rig, RigCamera, RigScale
from spherecal.data.session import Session
from spherecal.data.verdict import ruled, widening
from spherecal.diagnose.influence import bent_by_lenses
from spherecal.diagnose.run_checks import STATED_LENGTH_MM
from spherecal.diagnose.soundness import MOST_CAMERAS
from spherecal.geometry.field_table import FieldTable
from spherecal.result.build_result import camera_sigma, dot_noise_px, map_of_lengths, placed_camera, quality_of
from spherecal_boards.frames_adjustment import Adjusted
from spherecal_boards.frames_evidence import FrameEvidence, Tested


@dataclass(frozen=True)
class Fit:
    """What an adjustment over frames found, in millimetres and the reference camera's frame.

    `placed` (c,); points (m,3) and cofactors (m,3,3), NaN where unknown, of `features`; residual (n,2) px; intrinsics
    `free` (c,16) are estimated, cameras of one `group` (c,) share them.
    """

    observations: Observations
    features: Features
    reference: int
    placed: BoolArray
    adjusted: Adjusted
    points: FloatArray
    points_cofactor: FloatArray
    residual: FloatArray
    tested: Tested | None
    free: BoolArray
    group: IntArray


def assemble_fit(
    e: FrameEvidence | None,
    session: Session,
    fit: Fit,
    scale: RigScale,
    findings: list[Finding],
    method: str,
    seconds: dict[str, float],
) -> Calibration:
    """The calibration of a session from its fit and what its diagnosis rests on."""
    names = [session.cameras[c].id for c in np.flatnonzero(fit.placed)]
    lengths, poses = widening(ruled(findings), names, "free" if method == "bar" else "rigid")
    most = float(lengths.max(initial=1.0))
    scale = _wider_scale(fit, scale, most)
    of_length = {} if scale.relative_uncertainty is None else {"mm": scale.relative_uncertainty * STATED_LENGTH_MM}
    of_scale = ("scale-uncertainty", "print-unmeasured")
    ordered = ruled([replace(f, values={**f.values, **of_length}) if f.code in of_scale else f for f in findings])
    used, of_unit = fit.adjusted.used, fit.adjusted.variance
    sigma0 = float(np.sqrt(of_unit)) if np.isfinite(of_unit) else None
    quality = quality_of(fit.residual[used], sigma0, ordered, names)
    placed, (bent, fields) = zip(np.flatnonzero(fit.placed), poses, strict=True), _by_lenses(e, findings)
    cameras = tuple(_camera(session, fit, int(c), factor, fields) for c, factor in placed)
    covariance, noise_px = _covariance(fit, scale, lengths, bent), dot_noise_px(fit.observations, used, of_unit)
    reference, shown = session.cameras[fit.reference].id, map_of_lengths(cameras, covariance, fit.points, noise_px)
    rig = Rig(
        reference, cameras, scale, quality, session.input_sha256, covariance, shown, recorded_at=session.recorded_at
    )
    sigma = np.sqrt(np.maximum(most**2 * of_unit * np.einsum("pii->pi", fit.points_cofactor), 0.0))
    points = fit.points, sigma, np.bincount(fit.features.of_observation[used], minlength=len(fit.features))
    return Calibration(rig, fit.observations, fit.features, *points, fit.residual, used, (), method, seconds)


def _wider_scale(fit: Fit, scale: RigScale, factor: float) -> RigScale:
    """The scale with the share of noise in its uncertainty times a factor."""
    if scale.relative_uncertainty is None or fit.adjusted.covariance is None:
        return scale
    more = np.sqrt((factor**2 - 1) * fit.adjusted.variance) * fit.adjusted.covariance.relative_scale
    return replace(scale, relative_uncertainty=float(np.hypot(scale.relative_uncertainty, more)))


def _camera(session: Session, fit: Fit, c: int, wider: float, fields: dict[int, FieldTable]) -> RigCamera:
    own = fit.residual[fit.adjusted.used & (fit.observations.camera == c)]
    return placed_camera(session.cameras[c], fit.adjusted.state, c, own, _sigma(fit, c, wider), fields.get(c))


def _sigma(fit: Fit, c: int, wider: float) -> CameraSigma | None:
    adjusted = fit.adjusted
    covariance, variance = adjusted.covariance, adjusted.variance
    if covariance is None or not np.isfinite(variance):
        return None
    cofactors = covariance.cameras[c] * variance * wider**2
    return camera_sigma(cofactors, adjusted.state.rotation[c], adjusted.model.problem, c)


def _by_lenses(e: FrameEvidence | None, findings: list[Finding]) -> tuple[FloatArray | None, dict[int, FieldTable]]:
    """What lenses beyond their model may have done, those that are named, or all where most are; and their fields."""
    named = {name for f in findings if f.code == "lens-misfit" for name in f.where}
    if e is None or not named:
        return None, {}
    own = np.isin(e.camera_ids, list(named))
    return bent_by_lenses(e, np.flatnonzero(e.placed if own.sum() >= MOST_CAMERAS * e.placed.sum() else own)) or (
        None,
        {},
    )


def _covariance(fit: Fit, scale: RigScale, wider: FloatArray, bent: FloatArray | None) -> CameraCovariance | None:
    """The covariance of all placed cameras, noise `wider` (k,), with the scale's and the lenses' share."""
    covariance, variance = fit.adjusted.covariance, fit.adjusted.variance
    if covariance is None or not np.isfinite(variance) or scale.relative_uncertainty is None:
        return None
    stretch = covariance.stretch * scale.relative_uncertainty
    columns = fit.adjusted.model.problem.intrinsic_columns
    keep, each = np.repeat(fit.placed, POSE + len(columns)), np.repeat(wider, POSE + len(columns))
    noise = variance * covariance.all_cameras[np.ix_(keep, keep)] * np.outer(each, each)
    further = np.array([stretch, np.zeros_like(stretch) if bent is None else bent])[:, keep]
    return CameraCovariance(noise + further.T @ further, columns)
