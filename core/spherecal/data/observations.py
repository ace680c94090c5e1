"""Observations as flat arrays, and the features they observe."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray


@dataclass(frozen=True, eq=False, repr=False)
class Observations(ByValue):
    """Image points of dots; row i says: `uv[i]` px is dot `point[i]` of target `target[i]` seen by camera `camera[i]`.

    `placement`, `camera` and `point` are indices into the three tuples of names; `placements` holds the ids of
    placements and of bar poses alike. `sigma` (n, 2) px is None where the file gives no standard uncertainties.
    """

    placements: tuple[str, ...]
    cameras: tuple[str, ...]
    points: tuple[str, ...]
    placement: IntArray
    camera: IntArray
    target: IntArray
    point: IntArray
    uv: FloatArray
    sigma: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.uv)

    def select(self, keep: BoolArray | IntArray) -> "Observations":
        """The rows that `keep` selects, with the same names."""
        return Observations(
            self.placements,
            self.cameras,
            self.points,
            self.placement[keep],
            self.camera[keep],
            self.target[keep],
            self.point[keep],
            self.uv[keep],
            None if self.sigma is None else self.sigma[keep],
        )


@dataclass(frozen=True, eq=False, repr=False)
class Features(ByValue):
    """The distinct features (placement, target, point) of some observations, sorted by these three.

    `of_observation` (n,) gives each observation's feature.
    """

    placement: IntArray
    target: IntArray
    point: IntArray
    of_observation: IntArray

    def __len__(self) -> int:
        return len(self.placement)


def find_features(observations: Observations) -> Features:
    """The features behind the observations; the same dot at another placement is another feature [Tao21]."""
    keys = np.stack([observations.placement, observations.target, observations.point], axis=1)
    unique, inverse = np.unique(keys, axis=0, return_inverse=True)
    return Features(unique[:, 0], unique[:, 1], unique[:, 2], inverse.reshape(-1))


def seen_matrix(features: Features, observations: Observations, keep: BoolArray) -> BoolArray:
    """Which camera sees which feature, (cameras, features).

    `keep`: which observations count, (n,).
    """
    seen = np.zeros((len(observations.cameras), len(features)), dtype=bool)
    seen[observations.camera[keep], features.of_observation[keep]] = True
    return seen
