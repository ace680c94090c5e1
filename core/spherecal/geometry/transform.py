"""Rigid and similarity transforms: between point sets, and from one pose to another."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.geometry.rotation import log_rotation

Pose = tuple[FloatArray, FloatArray]  # rotation (..., 3, 3) and translation (..., 3): x_camera = R x + t


@dataclass(frozen=True)
class PosedCameras:
    """Intrinsics (c, 16) and poses x_camera = R (c, 3, 3) @ x + t (c, 3); or of one: (16,), (3, 3), (3,)."""

    intrinsics: FloatArray
    rotation: FloatArray
    translation: FloatArray

    @property
    def centres(self) -> FloatArray:
        """Projection centres (c, 3)."""
        return -np.einsum("cji,cj->ci", self.rotation, self.translation)


@dataclass(frozen=True)
class Similarity:
    """`x' = scale * rotation @ x + translation`."""

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def apply(self, points: FloatArray) -> FloatArray:
        """Transformed points, (n, 3)."""
        return self.scale * points @ self.rotation.T + self.translation

    def after(self, first: "Similarity") -> "Similarity":
        """The similarity of `first` followed by this one."""
        moved = self.apply(first.translation[None])[0]
        return Similarity(self.scale * first.scale, self.rotation @ first.rotation, moved)

    @property
    def inverse(self) -> "Similarity":
        """The similarity that undoes this one."""
        back = self.rotation.T / self.scale
        return Similarity(1.0 / self.scale, self.rotation.T, -back @ self.translation)


IDENTITY = Similarity(1.0, np.eye(3), np.zeros(3))


def pose_change(before: Pose, after: Pose) -> FloatArray:
    """Turn (rotation vector, rad) of the whole pose and then shift (..., 6) that lead from poses to new ones."""
    rotation_change = after[0] @ np.swapaxes(before[0], -1, -2)
    translation_change = after[1] - np.einsum("...ij,...j->...i", rotation_change, before[1])
    return np.concatenate([log_rotation(rotation_change), translation_change], axis=-1)


def fit_similarity(source: FloatArray, target: FloatArray, with_scale: bool = True) -> Similarity:
    """Least-squares similarity (or rigid motion) that takes points (n,3) to others, n >= 3; never a reflection.

    S. Umeyama, Least-squares estimation of transformation parameters between two point patterns, 1991.
    """
    rotation, scale = _turned(source, target)
    scale = float(scale) if with_scale else 1.0
    return Similarity(scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0))


def rigid_origins(source: FloatArray, targets: FloatArray) -> FloatArray:
    """Where rigid motions that take points (n,3) to each of some others (m,n,3) bring the origin, (m,3)."""
    return targets.mean(axis=1) - _turned(source, targets)[0] @ source.mean(axis=0)


def _turned(source: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (...,3,3) and scales (...) of the similarities from points (n,3) to others (...,n,3)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=-2, keepdims=True)
    u, s, vt = np.linalg.svd(np.swapaxes(b, -1, -2) @ a)
    sign = np.ones_like(s)
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    return (u * sign[..., None, :]) @ vt, (s * sign).sum(axis=-1) / (a * a).sum()
