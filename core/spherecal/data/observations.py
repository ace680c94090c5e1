"""Observations as flat arrays, and the features they observe."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray
from spherecal.base.messages.values import Phrase

SIGMA_COLUMNS = ("sigma_u", "sigma_v")
# A dot's centre lies in the image, give or take noise and the eccentricity correction of a few pixels. Beyond a tenth
# of the larger side it belongs to another image: a wrong image_size, or u and v exchanged (their sides differ by more
# on usual sensors).
MARGIN = 0.1
LEAST_SIGMA_PX = 1e-4  # a hundredth of the best centres there are; less would only be a division by nearly zero
# Names become file names and table cells: no longer than common file systems allow with a suffix.
LONGEST_NAME = 100
_NOT_IN_NAMES = '/\\,"'


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
        rows = {name: getattr(self, name)[keep] for name in ("placement", "camera", "target", "point", "uv")}
        return replace(self, **rows, sigma=None if self.sigma is None else self.sigma[keep])


@dataclass(frozen=True, eq=False, repr=False)
class Features(ByValue):
    """The distinct features (placement, target, point) of observations, sorted; and that of each observation (n,)."""

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
    """Which camera sees which feature, (cameras, features), by the observations (n,) that count."""
    seen = np.zeros((len(observations.cameras), len(features)), dtype=bool)
    seen[observations.camera[keep], features.of_observation[keep]] = True
    return seen


def name_problem(text: str) -> Phrase | None:
    """Why a text cannot be the name of a camera, placement, bar, mark or point; None if it can."""
    if not text:
        return Phrase("problem-name-empty")
    if len(text) > LONGEST_NAME:
        return Phrase("problem-name-long", {"most": LONGEST_NAME})
    if not text.isprintable() or any(c in text for c in _NOT_IN_NAMES):
        return Phrase("problem-name-characters")
    if text != text.strip() or text in (".", ".."):
        return Phrase("problem-name-spaces")
    return None
