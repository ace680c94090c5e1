"""Which of a session's cameras are the rig's, and their image points without what lenses do beyond the model."""

from collections.abc import Sequence

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.errors import InputError, Words
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Observations
from spherecal.data.rig import Rig
from spherecal.data.rig_camera import RigCamera
from spherecal.data.session import Session


def cameras_in_rig(session: Session, observations: Observations, rig: Rig, advice: Words) -> IntArray:
    """Index in the rig of each camera (c,) that the observations name, -1 where the rig has none of that id."""
    for spec in session.cameras:
        placed = rig.camera(spec.id)
        if placed is not None and placed.image_size != spec.image_size:
            values = {"folder": session.where, "camera": spec.id, "width": spec.image_size[0]}
            values |= {"height": spec.image_size[1], "rig_width": placed.image_size[0]}
            values |= {"rig_height": placed.image_size[1]}
            raise InputError(Phrase("error-other-image-size", values), advice)
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    in_rig = np.array([index.get(camera, -1) for camera in observations.cameras], dtype=np.int64)
    if (in_rig < 0).all():
        raise InputError(Phrase("error-cameras-not-in-rig", {"folder": session.where}))
    return in_rig


def lens_corrected(
    cameras: Sequence[RigCamera], camera: IntArray, uv: FloatArray, sigma: FloatArray, noise: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Pixels (n,2) as the lens models predict them, and sigmas (n,2), in units of `noise` px, with the fields'."""
    if all(one.field is None for one in cameras):
        return uv, sigma
    uv, sigma = uv.copy(), np.array(np.broadcast_to(sigma, uv.shape))
    for c, one in enumerate(cameras):
        rows = np.flatnonzero(camera == c)
        if one.field is not None and len(rows):
            sigma[rows] = np.hypot(sigma[rows], one.field.sd_at(uv[rows])[:, None] / noise)
            uv[rows] -= one.field.at(uv[rows])
    return uv, sigma
