"""Cameras with their lenses and poses, as arrays."""

from dataclasses import dataclass

from spherecal.base.arrays import FloatArray

Pose = tuple[FloatArray, FloatArray]  # rotation (..., 3, 3) and translation (..., 3): x_camera = R x + t


@dataclass(frozen=True)
class PosedCameras:
    """Intrinsics (c, 16) and poses x_camera = R (c, 3, 3) @ x + t (c, 3); or of one: (16,), (3, 3), (3,)."""

    intrinsics: FloatArray
    rotation: FloatArray
    translation: FloatArray
