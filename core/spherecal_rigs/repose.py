"""New poses for cameras that moved, all others unchanged, with uncertainties that cover both."""

from dataclasses import replace

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.rig import Calibration, CameraCovariance, Rig, RigCamera
from spherecal.data.session import Session
from spherecal.data.verdict import with_findings
from spherecal.detect.session_images import observed
from spherecal_rigs.followed_covariance import followed_covariance, map_as_before, with_sigma, without_map
from spherecal_rigs.pose_alone import refuse_unless_moved
from spherecal_rigs.recalibrate import Selection, recalibrate

# Lengths were 1.8 U off where a focus changed by 0.03 % was repaired as a move.
OR_FOCUS = 3.0


def repose(session: Session, rig: Rig, cameras: tuple[str, ...], context: Context | None = None) -> Calibration:
    """The rig with the poses of some cameras calibrated again from the session's placements.

    What a pose does not explain (a lens, a region of interest, binning, exchanged cameras) is refused with its name.
    The others stay exactly as they were (they are turned as one where the reference camera itself has moved). The
    mended cameras' uncertainty holds that of the cameras they were hung on.
    """
    if not session.placements:
        raise InputError(Phrase("error-repair-needs-ball"))
    session = observed(session, context or Context())
    done = recalibrate(session, rig, Selection(cameras, "pose"), None, context)
    either = refuse_unless_moved(session, rig, cameras, done, context)
    if not done.rig.quality.valid or any(done.rig.camera(name) is None for name in cameras):
        return done
    missing = [c.id for c in rig.cameras if done.rig.camera(c.id) is None]
    if rig.reference_camera in cameras and missing:
        raise InputError(Phrase("error-reference-moved", {"camera": rig.reference_camera, "missing": missing}))
    merged = tuple(
        _merged(camera, done.rig, rig.reference_camera in cameras, camera.id in cameras) for camera in rig.cameras
    )
    mended = replace(
        done.rig,
        cameras=merged,
        scale=rig.scale,
        covariance=None,
        length_map=None,
        earlier_poses=rig.earlier_poses,
        quality=without_map(done.rig.quality),
    )
    before = rig.covariance
    covariance = None if before is None else followed_covariance(session, mended, before, cameras, "pose")
    mended = replace(mended, covariance=None if covariance is None else _widened(covariance, rig, either))
    mended = replace(mended, cameras=tuple(with_sigma(mended, i, cameras) for i in range(len(merged))))
    done = replace(done, rig=replace(mended, length_map=map_as_before(mended, rig)))
    doubt = Finding("pose-unconfirmed", "warning", where=either, kind="or-focus")
    return with_findings(done, (doubt,) if either else ())


def _widened(covariance: CameraCovariance, rig: Rig, cameras: tuple[str, ...]) -> CameraCovariance:
    """The covariance with all that concerns some cameras so many times as uncertain."""
    by = np.array([OR_FOCUS if camera.id in cameras else 1.0 for camera in rig.cameras])
    times = np.repeat(by, len(covariance.matrix) // len(by))
    return replace(covariance, matrix=times[:, None] * covariance.matrix * times)


def _merged(before: RigCamera, done: Rig, all_turned: bool, mended: bool) -> RigCamera:
    after = done.camera(before.id)
    if after is None or not (all_turned or mended):
        return before
    kept = replace(before, rotation=after.rotation, translation_mm=after.translation_mm)
    return replace(kept, rms_px=after.rms_px, observations=after.observations) if mended else kept
