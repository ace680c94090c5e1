"""Covariance of an adjusted network in the free-network datum (see `covariance_factors`).

Where length rows give the scale, the datum removes it as well; `stretch` says how well it is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable, Free
from spherecal.adjust.covariance_factors import CovarianceFactors, Inverted, generalised_inverse
from spherecal.adjust.datum import Places, datum_motions
from spherecal.adjust.deformable_factors import deformable_factors
from spherecal.adjust.least_squares import normal_equations
from spherecal.adjust.parameter_layout import symmetric
from spherecal.adjust.point_factors import PointFactors, point_factors, widened
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.base.threads import one_blas_thread


@dataclass(frozen=True)
class Covariance:
    """Cofactors (covariances for a standard deviation of unit weight of 1) of an adjusted network.

    - `cameras` (c,w,w): pose and intrinsics of each camera in the problem's columns.
    - `stretch` is the cofactor of the whole network's relative size, None where no length row fixes it.
    - `condition` is the condition number of the reduced matrix.

    `functional` gives the cofactor of a linear function of all places.
    """

    cameras: FloatArray
    stretch: float | None
    condition: float
    factors: CovarianceFactors
    _given_effects: "Covariance | None" = None

    @cached_property
    def points(self) -> FloatArray:
        """Cofactors (f,3,3) of the features' places, NaN where one takes no part; not asked of forms not taken."""
        with one_blas_thread():
            return self.factors.place_cofactors()

    @property
    def given_effects(self) -> "Covariance":
        """The same with the fields of lenses and the motions of images taken as known."""
        return self._given_effects or self

    @property
    def of_effects(self) -> FloatArray | None:
        """Cofactors (m,m) of the effects that the data ask for; None without any."""
        if self._given_effects is None:
            return None
        first = len(self._given_effects.factors.inverse)
        return self.factors.inverse[first:, first:]

    def functional(self, gradient: FloatArray) -> float:
        """Cofactor of sum(gradient_f . x_f), gradient (f,3), with all correlations."""
        return float(self.functionals([gradient])[0, 0])

    def functionals(self, gradients: Sequence[FloatArray]) -> FloatArray:
        """Cofactors (m,m) of the functions sum(gradient_f . x_f) with each other, gradients (f,3)."""
        by_columns, by_noise = (np.array(part) for part in zip(*map(self.factors.transformed, gradients), strict=True))
        noise = np.einsum("api,pij,bpj->ab", by_noise, self.factors.point_inverse, by_noise, optimize=True)
        return by_columns @ self.factors.inverse @ by_columns.T + noise

    def all_cameras(self) -> FloatArray:
        """Cofactors of all cameras' parameters with each other, (c*w, c*w)."""
        parts = self.factors
        n = parts.n_camera_columns
        gauge_weights, gauge_cross, gauge_inner = parts.gauge_weights[:n], parts.gauge_cross[:n], parts.gauge_inner
        mixed = gauge_cross @ gauge_weights.T
        return parts.inverse[:n, :n] - mixed - mixed.T + gauge_weights @ gauge_inner @ gauge_weights.T

    def with_size(self) -> "Covariance":
        """The same including the uncertainty of the size, where length rows give it: cameras only."""
        parts = self.factors
        if self.stretch is None:
            return self
        kept = slice(0, parts.moments.shape[0] - 1)
        turned = replace(
            parts,
            gauge_columns=parts.gauge_columns[:, kept],
            gauge_places=parts.gauge_places[:, :, kept],
            datum_points=parts.datum_points[:, :, kept],
            datum_columns=parts.datum_columns[:, kept],
        )
        return replace(self, factors=turned)

    def cameras_with(self, gradient: FloatArray) -> FloatArray:
        """Cofactors (c*w,) of all cameras' parameters with sum(gradient_f . x_f), gradient (f,3)."""
        parts = self.factors
        by_column, by_noise = parts.transformed(gradient)
        moved = parts.inverse @ by_column
        datum = parts.gauge_rows @ moved + np.einsum("pig,pij,pj->g", parts.datum_points, parts.point_inverse, by_noise)
        return (moved - parts.gauge_weights @ datum)[: parts.n_camera_columns]

    def by_scores(self, functional: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Linear functions of all cameras' parameters as functions of the scores of columns and points.

        Returns by_column Factors (e,m) of the columns' scores, each of which must hold what the points add to it as
        they follow. points, factors (3p,g) and (g,m), whose product multiplies the points' scores.
        """
        parts = self.factors
        taken = (
            functional @ parts.gauge_weights[: parts.n_camera_columns]
        )  # how much of the functions the datum takes back
        by_column = parts.inverse[:, : parts.n_camera_columns] @ functional.T - parts.gauge_cross @ taken.T
        return by_column, parts.own_gauge_rows, -taken.T


def covariance(problem: Problem, state: State, places: Places | None = None) -> Covariance | None:
    """Cofactors of cameras and features at the minimum; None where the network is singular or observes nothing.

    `places` None in the free form.
    """
    if isinstance(problem.ball, Free) != (places is None):
        raise ValueError("the rigid form, and only it, needs the features' places")
    if not len(problem.uv):
        return None
    with one_blas_thread():
        found = _factors(problem, state, places)
        if found is None:
            return None
        return _covariance_of(*found)


def _covariance_of(parts: CovarianceFactors, condition: float, given: Covariance | None = None) -> Covariance:
    cameras = Covariance(np.zeros(0), None, condition, parts).all_cameras()
    width, own = parts.linear.width, np.arange(parts.problem.n_cameras)
    diagonal = cameras.reshape(len(own), width, len(own), width)[own, :, own, :]
    return Covariance(diagonal, _stretch(parts), condition, parts, given)


def with_effects(given: Covariance, by_columns: FloatArray, shifts: sparse.csr_array, own: FloatArray) -> Covariance:
    """The covariance where effects are unknown too.

    `by_columns` (e,m): equations of the columns by the effects, points eliminated; `shifts` (3p,m): of the points by
    the effects; `own` (m,m): cofactors of the effects.
    """
    parts = given.factors
    assert isinstance(parts, PointFactors)
    taken = parts.inverse @ by_columns
    cross = -taken @ own
    inverse = np.block([[parts.inverse - cross @ taken.T, cross], [cross.T, own]])
    return _covariance_of(widened(parts, inverse, shifts), given.condition, given)


def camera_cofactors(problem: Problem, state: State, places: Places | None) -> FloatArray | None:
    """Cofactors of all cameras' parameters alone (c*w, c*w), for planning; None where the network is singular."""
    with one_blas_thread():
        found = _factors(problem, state, places)
        return None if found is None else Covariance(np.zeros(0), None, found[1], found[0]).all_cameras()


def inverted(problem: Problem, state: State, places: Places | None) -> Inverted | None:
    """The network before the S-transformation; None where it is singular."""
    try:
        return _inverted(problem, state, places)
    except (LinAlgError, np.linalg.LinAlgError):
        return None


def _factors(problem: Problem, state: State, places: Places | None) -> tuple[CovarianceFactors, float] | None:
    """The factors and the condition number; None where the network is singular."""
    try:
        inverted = _inverted(problem, state, places)
        if isinstance(problem.ball, Deformable) and places is not None:
            return deformable_factors(inverted, state, places), inverted.condition
        return point_factors(inverted, state, places), inverted.condition
    except (LinAlgError, np.linalg.LinAlgError):
        return None


def _inverted(problem: Problem, state: State, places: Places | None) -> Inverted:
    linear = engine.linear_model(problem, state, None)
    normal = normal_equations(problem, state, linear, 0.0)
    if not (np.isfinite(normal.gradient).all() and (normal.matrix.diagonal() > 0).all()):
        raise LinAlgError  # as with a point whose rays are parallel to the last bit
    motions = datum_motions(problem, state, places)
    layout = problem.layout
    gauge = np.zeros((layout.size, int(motions.unseen.sum())))
    used = layout.column >= 0
    gauge[layout.column[used]] = motions.columns[:, motions.unseen][used]
    point_inverse, matrix = normal.reduced.point_inverse, symmetric(normal.matrix)
    del normal  # each of these matrices takes 24 MB with 100 cameras
    inverse, condition = generalised_inverse(matrix, gauge)
    del matrix
    expanded = layout.expand_rows(layout.expand_rows(inverse).T)
    return Inverted(problem, linear, expanded, point_inverse, motions, condition)


def _stretch(parts: CovarianceFactors) -> float | None:
    """Cofactor of the relative size of the whole where length rows give it: the datum's last parameter, M B' du."""
    if not parts.problem.has_lengths or not parts.moments.size:
        return None
    last = parts.moments[-1]
    return float(last @ parts.gauge_inner @ last) / parts.spread**2
