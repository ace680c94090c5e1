"""A simulated camera at the moment of an image."""

from dataclasses import dataclass

from spherecal.base.arrays import FloatArray


@dataclass(frozen=True)
class Station:
    """A simulated camera at the moment of an image: world-to-camera pose, 16 intrinsics, image (width, height) px."""

    id: str
    rotation: FloatArray
    translation_mm: FloatArray
    intrinsics: FloatArray
    size: tuple[int, int]

    @property
    def centre_mm(self) -> FloatArray:
        """The projection centre in the world, (3,) mm."""
        return -self.rotation.T @ self.translation_mm
