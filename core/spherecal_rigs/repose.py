"""New poses for cameras that moved, all others unchanged, with uncertainties that cover both."""

from dataclasses import replace

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import find_features
from spherecal.data.rig import Calibration, CameraCovariance, CameraSigma, Quality, Rig, RigCamera
from spherecal.data.session import Session
from spherecal.detect.session_images import observed
from spherecal.geometry.length_uncertainty import Cameras
from spherecal.geometry.volume_map import LengthMap, Volume, length_map
from spherecal.verify.consistency import camera_normal
from spherecal.verify.outlying_views import triangulate_checked
from spherecal.verify.pose_plan import volume_box
from spherecal.verify.verify_bars import views_of
from spherecal_rigs.recalibrate import Selection, recalibrate


def repose(session: Session, rig: Rig, cameras: tuple[str, ...], context: Context | None = None) -> Calibration:
    """The rig with the poses of some cameras calibrated again from the session's placements.

    The others stay exactly as they were (they are turned as one where the reference camera itself has moved). The
    mended cameras' uncertainty holds that of the cameras they were hung on.
    """
    if not session.placements:
        raise InputError(Phrase("error-repair-needs-ball"))
    session = observed(session, context or Context())
    done = recalibrate(session, rig, Selection(cameras, "pose"), None, context)
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
        quality=_without_map(done.rig.quality),
    )
    covariance = None if rig.covariance is None else _covariance(session, mended, rig.covariance, cameras)
    mended = replace(mended, covariance=covariance)
    mended = replace(mended, cameras=tuple(_with_sigma(mended, i, cameras) for i in range(len(merged))))
    return replace(done, rig=replace(mended, length_map=_map(mended, rig)))


def _merged(before: RigCamera, done: Rig, all_turned: bool, mended: bool) -> RigCamera:
    after = done.camera(before.id)
    if after is None or not (all_turned or mended):
        return before
    kept = replace(before, rotation=after.rotation, translation_mm=after.translation_mm)
    return replace(kept, rms_px=after.rms_px, observations=after.observations) if mended else kept


def _covariance(
    session: Session, rig: Rig, before: CameraCovariance, cameras: tuple[str, ...]
) -> CameraCovariance | None:
    """The covariance of all cameras: a new pose has its own image noise, and the errors of the locked cameras."""
    o = session.observations
    assert o is not None
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    in_rig = np.array([index.get(name, -1) for name in o.cameras], dtype=np.int64)
    own = o.select((o.placement < len(session.placements)) & (in_rig[o.camera] >= 0))
    features = find_features(own)
    views, expected = views_of(own, features, in_rig[own.camera], rig)
    checked = triangulate_checked(views, expected)
    normal = camera_normal(views, checked.kept, replace(rig, covariance=before))
    w = 6 + len(before.intrinsics)
    free = np.concatenate([index[name] * w + np.arange(6) for name in cameras])
    rest = np.setdiff1d(np.arange(len(normal)), free)
    inverse = np.linalg.pinv(normal[np.ix_(free, free)], rcond=1e-12, hermitian=True)
    follow = np.zeros((len(normal), len(normal)))
    follow[rest, rest] = 1.0
    follow[np.ix_(free, rest)] = -inverse @ normal[np.ix_(free, rest)]
    matrix = follow @ before.matrix @ follow.T
    matrix[np.ix_(free, free)] += checked.noise**2 * inverse
    return CameraCovariance((matrix + matrix.T) / 2, before.intrinsics)


def _with_sigma(rig: Rig, i: int, cameras: tuple[str, ...]) -> RigCamera:
    """A camera with a new pose and the standard uncertainties from the covariance."""
    camera, covariance = rig.cameras[i], rig.covariance
    if covariance is None or camera.id not in cameras:
        return camera
    w = 6 + len(covariance.intrinsics)
    own = covariance.matrix[i * w : (i + 1) * w, i * w : (i + 1) * w]
    centre = camera.rotation.T @ own[3:6, 3:6] @ camera.rotation
    intrinsics = np.zeros(16)
    intrinsics[covariance.intrinsics] = _root(own)[6:]
    sigma = CameraSigma(np.degrees(_root(own)[:3]), _root(centre), intrinsics)
    return replace(camera, sigma=sigma)


def _root(matrix: FloatArray) -> FloatArray:
    return np.sqrt(np.maximum(np.diag(matrix), 0.0))


def _map(rig: Rig, before: Rig) -> LengthMap | None:
    """The map of a length's uncertainty in the volume of the former map, if there was one."""
    if before.length_map is None or rig.covariance is None or rig.reference_camera != before.reference_camera:
        return None
    box = volume_box(before, (np.zeros(3), np.ones(3)))
    cameras = Cameras(
        np.array([c.intrinsics for c in rig.cameras]),
        np.array([c.rotation for c in rig.cameras]),
        np.array([c.translation_mm for c in rig.cameras]),
        np.array([c.image_size for c in rig.cameras], dtype=float),
        rig.covariance.matrix,
        rig.covariance.intrinsics,
        tuple(c.field for c in rig.cameras),
    )
    return length_map(cameras, Volume(box.middle, box.axes, box.half), before.length_map.sigma_px)


def _without_map(quality: Quality) -> Quality:
    """The findings without the one on lengths, which does not include the locked cameras' uncertainty."""
    return replace(quality, findings=tuple(f for f in quality.findings if f.code != "length-uncertainty"))
