"""Cameras with their lenses and poses, as arrays."""

from dataclasses import dataclass

from spherecal.base.arrays import FloatArray


@dataclass(frozen=True)
class PosedCameras:
    """Cameras: `intrinsics` (c, 16) and poses x_camera = `rotation` (c, 3, 3) @ x + `translation` (c, 3).

    Or a single one: (16,), (3, 3), (3,).
    """

    intrinsics: FloatArray
    rotation: FloatArray
    translation: FloatArray
