"""Which of a session's cameras are the rig's."""

import numpy as np

from spherecal.base.arrays import IntArray
from spherecal.base.errors import InputError
from spherecal.data.observations import Observations
from spherecal.data.rig import Rig
from spherecal.data.session import Session


def cameras_in_rig(session: Session, observations: Observations, rig: Rig, advice: str) -> IntArray:
    """Index in the rig of each camera (c,) that the observations name, -1 where the rig has none of that id.

    InputError, with the advice, where a camera's images have another size than in the rig, and where none is the rig's.
    """
    for spec in session.cameras:
        placed = rig.camera(spec.id)
        if placed is not None and placed.image_size != spec.image_size:
            raise InputError(
                f"{session.where}: camera {spec.id} has images of {spec.image_size[0]} x {spec.image_size[1]} pixels, "
                f"in the rig {placed.image_size[0]} x {placed.image_size[1]}.",
                advice,
            )
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    in_rig = np.array([index.get(camera, -1) for camera in observations.cameras], dtype=np.int64)
    if (in_rig < 0).all():
        raise InputError(f"{session.where}: none of its cameras is in the rig.", "Is it the rig of this session?")
    return in_rig
