"""Uncertainties of a rig of which some cameras are new and hang on the others, whose errors they inherit."""

from dataclasses import replace
from typing import Literal

import numpy as np

from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import FloatArray
from spherecal.data.observations import find_features
from spherecal.data.rig import CameraCovariance, CameraSigma, Quality, Rig, RigCamera
from spherecal.data.session import Session
from spherecal.geometry.length_uncertainty import Cameras
from spherecal.geometry.volume_map import LengthMap, Volume, length_map
from spherecal.verify.consistency import camera_normal
from spherecal.verify.outlying_views import triangulate_checked
from spherecal.verify.pose_plan import volume_box
from spherecal.verify.verify_bars import views_of

What = Literal["all", "pose", "intrinsics"]


def followed_covariance(
    session: Session, rig: Rig, before: CameraCovariance, cameras: tuple[str, ...], what: What
) -> CameraCovariance:
    """The covariance of all cameras: what is new has its own image noise, and the errors of the locked cameras.

    `rig` with what is new of `cameras`; `what` of them was estimated.
    """
    o = session.observations
    assert o is not None
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    in_rig = np.array([index.get(name, -1) for name in o.cameras], dtype=np.int64)
    own = o.select((o.placement < len(session.placements)) & (in_rig[o.camera] >= 0))
    features = find_features(own)
    views, expected = views_of(own, features, in_rig[own.camera], rig)
    checked = triangulate_checked(views, expected)
    normal = camera_normal(views, checked.kept, replace(rig, covariance=before))
    w = POSE + len(before.intrinsics)
    own_columns = {"pose": np.arange(POSE), "intrinsics": np.arange(POSE, w), "all": np.arange(w)}[what]
    free = np.concatenate([index[name] * w + own_columns for name in cameras])
    rest = np.setdiff1d(np.arange(len(normal)), free)
    inverse = np.linalg.pinv(normal[np.ix_(free, free)], rcond=1e-12, hermitian=True)
    follow = np.zeros((len(normal), len(normal)))
    follow[rest, rest] = 1.0
    follow[np.ix_(free, rest)] = -inverse @ normal[np.ix_(free, rest)]
    matrix = follow @ before.matrix @ follow.T
    matrix[np.ix_(free, free)] += checked.noise**2 * inverse
    return CameraCovariance((matrix + matrix.T) / 2, before.intrinsics)


def with_sigma(rig: Rig, i: int, cameras: tuple[str, ...]) -> RigCamera:
    """A camera with what is new of it and the standard uncertainties from the covariance."""
    camera, covariance = rig.cameras[i], rig.covariance
    if covariance is None or camera.id not in cameras:
        return camera
    w = POSE + len(covariance.intrinsics)
    own = covariance.matrix[i * w : (i + 1) * w, i * w : (i + 1) * w]
    centre = camera.rotation.T @ own[3:POSE, 3:POSE] @ camera.rotation
    intrinsics = np.zeros(16)
    intrinsics[covariance.intrinsics] = _root(own)[POSE:]
    sigma = CameraSigma(np.degrees(_root(own)[:3]), _root(centre), intrinsics)
    return replace(camera, sigma=sigma)


def _root(matrix: FloatArray) -> FloatArray:
    return np.sqrt(np.maximum(np.diag(matrix), 0.0))


def map_as_before(rig: Rig, before: Rig) -> LengthMap | None:
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


def without_map(quality: Quality) -> Quality:
    """The findings without the one on lengths, which does not include the locked cameras' uncertainty."""
    return replace(quality, findings=tuple(f for f in quality.findings if f.code != "length-uncertainty"))
