"""The S-transformation of an adjusted network: from any generalised inverse to the datum of its features' places.

The observations leave position, orientation and size of the whole open. The datum is the inner constraint on the
features' places: no shift, turn or stretch of them as a whole, so their covariance has the least trace (W. Baarda,
S-transformations and criterion matrices, 1973). Let G be the motions of the unknowns, B those of the places as
conditions and M = (sum G'G)^-1 over the places. Then a quantity x becomes x - G M B'du.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from spherecal.adjust.datum import Motions, Places
from spherecal.adjust.linear import Linear
from spherecal.adjust.problem import Problem
from spherecal.base.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Inverted:
    """An adjusted network before the S-transformation.

    `problem, linear`: the problem and its linearisation at the solution; `inverse`: a generalised inverse of the
    reduced matrix by the expanded columns, (e,e); `point_inverse`: V^-1 of the points, (p,3,3); `motions`: what the
    datum takes back; `condition`: condition number of the reduced matrix.
    """

    problem: Problem
    linear: Linear
    inverse: FloatArray
    point_inverse: FloatArray
    motions: Motions
    condition: float


@dataclass(frozen=True)
class CovarianceFactors(ABC):
    """Pieces of the S-transformation; e expanded columns, g datum parameters, p noise sources, f features.

    `problem, linear, inverse`: see Inverted; `places`: of which point each feature is on a ball that keeps its shape;
    None in the free form; `rotation, lever_arm`: how placements carry the features' points, (f,3,3) and (f,3), see
    `carried_dots`; `point_inverse`: cofactors of the sources of noise beside the columns, (p,3,3): the points' V^-1,
    and on a deformable ball Q; `gauge_columns, gauge_places`: the datum's motions of the columns (e,g) and of the
    features' places (f,3,g); `datum_points, datum_columns`: the same as conditions on the sources of noise (p,3,g) and
    on the columns (e,g); `spread`: distance from the centroid at which turns and
    stretch move a point by 1.
    """

    problem: Problem
    places: Places | None
    rotation: FloatArray
    lever_arm: FloatArray
    inverse: FloatArray
    linear: Linear
    point_inverse: FloatArray
    gauge_columns: FloatArray
    gauge_places: FloatArray
    datum_points: FloatArray
    datum_columns: FloatArray
    spread: float

    @property
    @abstractmethod
    def own_noise(self) -> FloatArray:
        """The features' own image noise (f,3,3), without the cameras' share."""

    @property
    @abstractmethod
    def point_of_feature(self) -> IntArray:
        """The unknown point (f,) behind each feature."""

    @property
    def is_located(self) -> BoolArray:
        """Features (f,) that some observation locates."""
        located = np.diff(self.problem.point_start) > 0
        return located if self.places is None else located[self.places.point]

    @cached_property
    @abstractmethod
    def gauge_rows(self) -> FloatArray:
        """The datum's conditions by columns, points eliminated, (g,e)."""

    @abstractmethod
    def transformed(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A gradient by places (f,3) in the datum, by columns (e,) and by the sources of noise (p,3)."""

    @abstractmethod
    def place_cofactors(self) -> FloatArray:
        """Cofactors (f,3,3) of the features' places in the datum; NaN where one is not used."""

    @property
    def n_camera_columns(self) -> int:
        """Expanded columns of cameras, the first ones."""
        return self.problem.n_cameras * self.linear.width

    @cached_property
    def own_gauge_rows(self) -> FloatArray:
        """The datum's conditions by scores of the points, (3p,g)."""
        pulled = self.point_inverse @ self.datum_points
        return pulled.reshape(3 * len(pulled), pulled.shape[2])

    @cached_property
    def moments(self) -> FloatArray:
        """(sum G'G)^-1 (g,g) of the places' motions."""
        places = self.gauge_places
        return np.linalg.inv(np.einsum("fig,fih->gh", places, places)) if places.size else np.zeros((0, 0))

    @cached_property
    def gauge_weights(self) -> FloatArray:
        """G M of the columns, (e,g)."""
        return self.gauge_columns @ self.moments

    @cached_property
    def gauge_cross(self) -> FloatArray:
        """C A' (e,g) with A the rows."""
        return self.inverse @ self.gauge_rows.T

    @cached_property
    def gauge_inner(self) -> FloatArray:
        """A C A' + sum B' V^-1 B (g,g)."""
        noise = np.einsum("pig,pij,pjh->gh", self.datum_points, self.point_inverse, self.datum_points)
        return self.gauge_rows @ self.gauge_cross + noise

    def take_back(self, cofactors: FloatArray, gauge_cross: FloatArray) -> None:
        """Transform cofactors (f,3,3) of places, with the datum's conditions (f,3,g), to the datum, in place."""
        if self.moments.size:
            gauge_weights = self.gauge_places @ self.moments
            cross = gauge_cross @ gauge_weights.transpose(0, 2, 1)
            cofactors += (
                gauge_weights @ self.gauge_inner @ gauge_weights.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1)
            )


def generalised_inverse(matrix: FloatArray, gauge: FloatArray) -> tuple[FloatArray, float]:
    """A generalised inverse (d,d) of a matrix whose null space `gauge` (d,g) spans, and its condition number."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    scaled = matrix * scale[:, None]
    scaled *= scale
    size = np.linalg.norm(scaled, 1)
    null = np.linalg.qr(gauge / scale[:, None])[0]
    square = null @ null.T
    scaled += square
    factor = cho_factor(np.asfortranarray(scaled), overwrite_a=True)
    del scaled
    inverse = cho_solve(factor, np.eye(len(matrix)), overwrite_b=True) - square
    condition = size * np.linalg.norm(inverse, 1)
    inverse *= scale[:, None]
    inverse *= scale
    return inverse, float(condition)
