"""The S-transformation of an adjusted network: from any generalised inverse to the datum of its features' places.

The observations leave position, orientation and size of the whole open. The datum is the inner constraint on the
features' places: no shift, turn or stretch of them as a whole, so their covariance has the least trace (W. Baarda,
S-transformations and criterion matrices, 1973). Let G be the motions of the unknowns, B those of the places as
conditions and M = (sum G'G)^-1 over the places. Then a quantity x becomes x - G M B'du.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from spherecal.adjust.datum import Motions, Places
from spherecal.adjust.linear import Linear
from spherecal.adjust.problem import Problem
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.threads import one_blas_thread


@dataclass(frozen=True)
class Inverted:
    """An adjusted network before the S-transformation.

    `problem, linear`: the problem and its linearisation at the solution; `inverse`: a generalised inverse of the
    reduced matrix by the expanded columns, (e,e); `point_inverse`: V^-1 of the points, (p,3,3); `motions`: what the
    datum takes back.
    """

    problem: Problem
    linear: Linear
    inverse: FloatArray
    point_inverse: FloatArray
    motions: Motions


@dataclass(frozen=True)
class Covariance(Inverted, ABC):
    """Cofactors (covariances for a standard deviation of unit weight of 1) of an adjusted network.

    There are e expanded columns, g datum parameters, p noise sources, f features. `point_inverse`: cofactors of the
    sources of noise beside the columns, (p,3,3): the points' V^-1, and on a deformable ball Q; `places`: of which point
    each feature is on a ball that keeps its shape; None in the free form; `rotation, lever_arm`: how placements carry
    the features' points, (f,3,3) and (f,3), see `carried_dots`; `datum_points, datum_columns`: the datum's motions as
    conditions on the sources of noise (p,3,g) and on the columns (e,g); `moments`: (sum G'G)^-1, (g,g); `given`: the
    covariance where effects, whose columns are the last ones, are known; None without effects.
    """

    places: Places | None
    rotation: FloatArray
    lever_arm: FloatArray
    datum_points: FloatArray
    datum_columns: FloatArray
    moments: FloatArray
    given: "Covariance | None" = field(default=None, kw_only=True)

    def prepared(self) -> Self:
        """Itself, with what is asked first computed here: on one thread of BLAS."""
        _ = self.cameras, self.stretch
        return self

    @cached_property
    def cameras(self) -> FloatArray:
        """Cofactors (c,w,w) of pose and intrinsics of each camera in the problem's columns."""
        width, own = self.linear.width, np.arange(self.problem.n_cameras)
        return self.all_cameras().reshape(len(own), width, len(own), width)[own, :, own, :]

    @cached_property
    def stretch(self) -> float | None:
        """Cofactor of the whole network's relative size where length rows give it: the datum's last, M B' du."""
        if not self.problem.has_lengths or not self.moments.size:
            return None
        last = self.moments[-1]
        return float(last @ self.gauge_inner @ last) / self.motions.spread**2

    @cached_property
    def points(self) -> FloatArray:
        """Cofactors (f,3,3) of the features' places, NaN where one takes no part; not asked of forms not taken."""
        with one_blas_thread():
            return self.place_cofactors()

    @property
    def given_effects(self) -> "Covariance":
        """The same with the fields of lenses and the motions of images taken as known."""
        return self.given or self

    @property
    def of_effects(self) -> FloatArray | None:
        """Cofactors (m,m) of the effects that the data ask for; None without any."""
        return None if self.given is None else self.inverse[len(self.given.inverse) :, len(self.given.inverse) :]

    def functional(self, gradient: FloatArray) -> float:
        """Cofactor of sum(gradient_f . x_f), gradient (f,3), with all correlations."""
        return float(self.functionals([gradient])[0, 0])

    def functionals(self, gradients: Sequence[FloatArray]) -> FloatArray:
        """Cofactors (m,m) of the functions sum(gradient_f . x_f) with each other, gradients (f,3)."""
        by_columns, by_noise = (np.array(part) for part in zip(*map(self.transformed, gradients), strict=True))
        noise = np.einsum("api,pij,bpj->ab", by_noise, self.point_inverse, by_noise, optimize=True)
        return by_columns @ self.inverse @ by_columns.T + noise

    def all_cameras(self) -> FloatArray:
        """Cofactors of all cameras' parameters with each other, (c*w, c*w)."""
        n = self.n_camera_columns
        gauge_weights, gauge_cross, gauge_inner = self.gauge_weights[:n], self.gauge_cross[:n], self.gauge_inner
        mixed = gauge_cross @ gauge_weights.T
        return self.inverse[:n, :n] - mixed - mixed.T + gauge_weights @ gauge_inner @ gauge_weights.T

    def with_size(self) -> Self:
        """The same including the uncertainty of the size, where length rows give it: cameras only."""
        if self.stretch is None:
            return self
        kept, motions = slice(0, len(self.moments) - 1), self.motions
        return replace(
            self,
            motions=replace(motions, columns=motions.columns[:, kept], places=motions.places[:, :, kept]),
            datum_points=self.datum_points[:, :, kept],
            datum_columns=self.datum_columns[:, kept],
            moments=moments_of(motions.places[:, :, kept]),
        )

    def cameras_with(self, gradient: FloatArray) -> FloatArray:
        """Cofactors (c*w,) of all cameras' parameters with sum(gradient_f . x_f), gradient (f,3)."""
        by_column, by_noise = self.transformed(gradient)
        moved = self.inverse @ by_column
        datum = self.gauge_rows @ moved + np.einsum("pig,pij,pj->g", self.datum_points, self.point_inverse, by_noise)
        return (moved - self.gauge_weights @ datum)[: self.n_camera_columns]

    def by_scores(self, functional: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Linear functions of all cameras' parameters as functions of the scores of columns and points.

        Returns by_column Factors (e,m) of the columns' scores, each of which must hold what the points add to it as
        they follow. points, factors (3p,g) and (g,m), whose product multiplies the points' scores.
        """
        taken = functional @ self.gauge_weights[: self.n_camera_columns]  # how much the datum takes back
        by_column = self.inverse[:, : self.n_camera_columns] @ functional.T - self.gauge_cross @ taken.T
        own_gauge_rows = self.point_inverse @ self.datum_points  # the datum's conditions by scores of the points
        return by_column, own_gauge_rows.reshape(3 * len(own_gauge_rows), own_gauge_rows.shape[2]), -taken.T

    @cached_property
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
    def gauge_weights(self) -> FloatArray:
        """G M of the columns, (e,g)."""
        return self.motions.columns @ self.moments

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
            gauge_weights = self.motions.places @ self.moments
            cross = gauge_cross @ gauge_weights.transpose(0, 2, 1)
            cofactors += (
                gauge_weights @ self.gauge_inner @ gauge_weights.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1)
            )


def moments_of(places: FloatArray) -> FloatArray:
    """(sum G'G)^-1 (g,g) of the places' motions (f,3,g)."""
    return np.linalg.inv(np.einsum("fig,fih->gh", places, places)) if places.size else np.zeros((0, 0))


def add_products(out: FloatArray, rows: sparse.csr_array, inverse: FloatArray, at_once: int) -> None:
    """Add K C K' of every three rows of K (3n,e) to out (n,3,3), so many at once."""
    for first in range(0, len(out), at_once):
        some = rows[3 * first : 3 * (first + at_once)].toarray()
        product = (some @ inverse).reshape(-1, 3, some.shape[1])
        out[first : first + at_once] += product @ some.reshape(product.shape).transpose(0, 2, 1)


def generalised_inverse(matrix: FloatArray, gauge: FloatArray) -> FloatArray:
    """A generalised inverse (d,d) of a matrix whose null space `gauge` (d,g) spans."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    scaled = matrix * scale[:, None]
    scaled *= scale
    null = np.linalg.qr(gauge / scale[:, None])[0]
    square = null @ null.T
    scaled += square
    factor = cho_factor(np.asfortranarray(scaled), overwrite_a=True)
    del scaled
    inverse = cho_solve(factor, np.eye(len(matrix)), overwrite_b=True) - square
    inverse *= scale[:, None]
    inverse *= scale
    return inverse
