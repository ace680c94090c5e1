"""Rows of an adjustment that are not image points: known lengths and known intrinsics."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class LengthRows:
    """Known distances: |sum of coefficient (m,k) * points (m,k)| = length (m,), with a covariance (m,m).

    Each end is a point, or a mark that its dots give: a sum of them whose coefficients add up to 1 (the first end's
    to -1). A coefficient of 0 pads the row. One bar in many poses errs alike: its certificate correlates its rows.
    """

    points: IntArray
    coefficient: FloatArray
    length: FloatArray
    covariance: FloatArray

    @cached_property
    def whitening(self) -> FloatArray:
        """The matrix (m,m) that makes the rows' errors independent and of unit size."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)), dtype=np.float64)

    def select(self, keep: BoolArray) -> "LengthRows":
        """Some of the rows, (m,) bool."""
        covariance = self.covariance[np.ix_(keep, keep)]
        return LengthRows(self.points[keep], self.coefficient[keep], self.length[keep], covariance)


NO_LENGTHS = LengthRows(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 0)))


@dataclass(frozen=True)
class Priors:
    """Known values of intrinsics: value (c,16) and sigma (c,16), infinite where nothing is known."""

    value: FloatArray
    sigma: FloatArray

    def is_known(self, camera: int, intrinsic: int) -> bool:
        """Whether anything is known about an intrinsic of a camera."""
        return len(self.sigma) > 0 and bool(np.isfinite(self.sigma[camera, intrinsic]))


NO_PRIORS = Priors(np.zeros((0, 16)), np.zeros((0, 16)))
