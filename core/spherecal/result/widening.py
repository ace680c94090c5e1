"""Uncertainties of cameras beyond those of the adjustment: of poses, lenses and all together, a function a reason."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.camera_effects import TURN
from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import FloatArray
from spherecal.data.findings import Findings
from spherecal.data.rig import CameraCovariance, CameraSigma, RigCamera, RigScale
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.left_out import rejected_edges
from spherecal.diagnose.unconfirmed_poses import unconfirmed_poses


@dataclass(frozen=True)
class Uncertain:
    """The rig's cameras with their standard uncertainties, and the covariance of all of them together, if known."""

    cameras: tuple[RigCamera, ...]
    covariance: CameraCovariance | None

    @property
    def known(self) -> list[tuple[int, RigCamera, CameraSigma]]:
        """Index, camera and uncertainties of all that have any."""
        return [(i, c, c.sigma) for i, c in enumerate(self.cameras) if c.sigma is not None]

    def with_sigmas(self, changed: Mapping[int, CameraSigma]) -> "Uncertain":
        """The same with other uncertainties of some cameras, by their indices."""
        cameras = (replace(c, sigma=changed.get(i, c.sigma)) for i, c in enumerate(self.cameras))
        return replace(self, cameras=tuple(cameras))

    def with_matrix(self, matrix: FloatArray) -> "Uncertain":
        """The same with another covariance, which there was before."""
        assert self.covariance is not None
        return replace(self, covariance=CameraCovariance(matrix, self.covariance.intrinsics))


def by_findings(
    rig: Uncertain, of_poses: FloatArray, of_lengths: FloatArray, before: RigScale, after: RigScale
) -> Uncertain:
    """Cameras times factors (c,), the covariance times those of lengths, with the scale's present uncertainty."""
    wider = rig.with_sigmas(
        {
            i: CameraSigma(s.rotation_deg * of_poses[i], s.centre_mm * of_poses[i], s.intrinsics * of_poses[i])
            for i, _, s in rig.known
        }
    )
    if rig.covariance is None or ((of_lengths == 1.0).all() and before == after):
        return wider
    each = np.repeat(of_lengths, rig.covariance.width)
    matrix = rig.covariance.matrix * np.outer(each, each)
    if before.relative_uncertainty is not None and after.relative_uncertainty is not None:
        along = np.zeros((len(rig.cameras), rig.covariance.width))
        along[:, 3:POSE] = [camera.translation_mm for camera in rig.cameras]
        more = after.relative_uncertainty**2 - before.relative_uncertainty**2
        matrix += more * np.outer(along, along)
    return wider.with_matrix(matrix)


def either_pose(rig: Uncertain, evidence: Evidence, findings: Findings) -> Uncertain:
    """Cameras with unconfirmed poses, with uncertainties such that each other pose is one standard uncertainty off."""
    names = [camera.id for camera in rig.cameras]
    for pose in unconfirmed_poses(evidence, findings):
        index = names.index(evidence.camera_ids[pose.camera])
        sigma = rig.cameras[index].sigma
        if sigma is not None:
            rig = rig.with_sigmas({index: _or_changed(sigma, pose.changes[:, :3], pose.centre_shifts)})
        if rig.covariance is not None:
            off = np.zeros((len(pose.changes), len(rig.cameras), rig.covariance.width))
            off[:, index, :POSE] = pose.changes
            rig = rig.with_matrix(rig.covariance.matrix + _products(off))
    return rig


def either_size(rig: Uncertain, changes: FloatArray, growth_mm: FloatArray) -> Uncertain:
    """Cameras with the uncertainty of changes (k,c,w), and of their places by a rig that grew, (c,3) about its middle.

    The covariance has the latter already, by the scale.
    """
    if rig.covariance is not None:
        rig = rig.with_matrix(rig.covariance.matrix + _products(changes))
    return rig.with_sigmas(
        {
            i: _or_changed(s, changes[:, i, :3], [growth_mm[i], *(changes[:, i, 3:POSE] @ camera.rotation)])
            for i, camera, s in rig.known
        }
    )


def _or_changed(sigma: CameraSigma, turns: FloatArray, shifts_mm: Sequence[FloatArray] | FloatArray) -> CameraSigma:
    """Uncertainties such that each of some turns (k,3) rad and shifts of the centre (l,3) is a standard one too."""
    return replace(
        sigma,
        rotation_deg=np.linalg.norm([sigma.rotation_deg, *np.rad2deg(turns)], axis=0),
        centre_mm=np.linalg.norm([sigma.centre_mm, *shifts_mm], axis=0),
    )


def _products(changes: FloatArray) -> FloatArray:
    """The covariance (c*w, c*w) of changes (k,c,w) of all cameras that are a standard uncertainty each."""
    off = changes.reshape(len(changes), changes.shape[1] * changes.shape[2])
    return off.T @ off


def either_lens(rig: Uncertain, evidence: Evidence, findings: Findings) -> Uncertain:
    """Cameras with rejected edges, with uncertainties such that a lens closer to these is one sigma off."""
    named = {name for f in findings if f.code == "lens-misfit" and f.kind == "edge" for name in f.where}
    columns, group = evidence.adjusted.problem.intrinsic_columns, evidence.solved.network.group
    for edge in rejected_edges(evidence) if named else ():
        if evidence.camera_ids[edge.camera] not in named:
            continue
        alike = {evidence.camera_ids[c] for c in np.flatnonzero(group == group[edge.camera])}
        changed: dict[int, CameraSigma] = {}
        for i, camera, sigma in rig.known:
            if camera.id in alike:
                intrinsics = sigma.intrinsics.copy()
                intrinsics[columns] = np.hypot(intrinsics[columns], edge.change)
                changed[i] = replace(sigma, intrinsics=intrinsics)
        rig = rig.with_sigmas(changed)
        if rig.covariance is not None:
            off = np.zeros((len(rig.cameras), rig.covariance.width))
            off[[camera.id in alike for camera in rig.cameras], POSE:] = edge.change
            rig = rig.with_matrix(rig.covariance.matrix + np.outer(off, off))
    return rig


def drifting(rig: Uncertain, turns_rad: FloatArray, middle_mm: FloatArray) -> Uncertain:
    """Cameras with the uncertainty of a pose at any one time, whose images turn with standard deviations (c,) rad.

    What looks like a turn about the ball's middle (3,) may be a shift across the view as well: 12 cameras that drifted
    by 0.2 mm passed for turning by 2 millidegrees, and three were 2.5 to 3.4 times their U off. To lengths both do
    the same.
    """
    if not turns_rad.any():
        return rig
    changed = {}
    for i, camera, s in rig.known:
        away = np.cross(np.eye(3), middle_mm - camera.centre_mm)  # how far each axis is across the view
        centre = np.hypot(s.centre_mm, turns_rad[i] * np.linalg.norm(away, axis=1))
        changed[i] = replace(s, rotation_deg=np.hypot(s.rotation_deg, np.rad2deg(turns_rad[i])), centre_mm=centre)
    rig = rig.with_sigmas(changed)
    if rig.covariance is None:
        return rig
    matrix = rig.covariance.matrix.copy()
    at = (np.arange(len(rig.cameras))[:, None] * rig.covariance.width + np.arange(TURN)).ravel()
    matrix[at, at] += np.repeat(turns_rad**2, TURN)
    return rig.with_matrix(matrix)
