"""Covariance of an adjusted network in the free-network datum (see `covariance_factors`).

Where length rows give the scale, the datum removes it as well; `stretch` says how well it is known.
"""

import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable, Free
from spherecal.adjust.covariance_factors import Covariance, Inverted, generalised_inverse
from spherecal.adjust.datum import Places, datum_motions
from spherecal.adjust.deformable import deformable_factors
from spherecal.adjust.least_squares import normal_equations
from spherecal.adjust.parameter_layout import symmetric
from spherecal.adjust.point_factors import PointFactors, point_factors, widened
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.base.threads import one_blas_thread


def covariance(problem: Problem, state: State, places: Places | None = None) -> Covariance | None:
    """Cofactors of cameras and features at the minimum; None where the network is singular or observes nothing.

    `places` None in the free form.
    """
    if isinstance(problem.ball, Free) != (places is None):
        raise ValueError("the rigid form, and only it, needs the features' places")
    if not len(problem.uv):
        return None
    with one_blas_thread():
        found = _covariance(problem, state, places)
        return None if found is None else found.prepared()


def with_effects(given: Covariance, by_columns: FloatArray, shifts: sparse.csr_array, own: FloatArray) -> Covariance:
    """The covariance where effects are unknown too.

    `by_columns` (e,m): equations of the columns by the effects, points eliminated; `shifts` (3p,m): of the points by
    the effects; `own` (m,m): cofactors of the effects.
    """
    assert isinstance(given, PointFactors)
    taken = given.inverse @ by_columns
    cross = -taken @ own
    inverse = np.block([[given.inverse - cross @ taken.T, cross], [cross.T, own]])
    return widened(given, inverse, shifts).prepared()


def camera_cofactors(problem: Problem, state: State, places: Places | None) -> FloatArray | None:
    """Cofactors of all cameras' parameters alone (c*w, c*w), for planning; None where the network is singular."""
    with one_blas_thread():
        found = _covariance(problem, state, places)
        return None if found is None else found.all_cameras()


def inverted(problem: Problem, state: State, places: Places | None) -> Inverted | None:
    """The network before the S-transformation; None where it is singular."""
    try:
        return _inverted(problem, state, places)
    except (LinAlgError, np.linalg.LinAlgError):
        return None


def _covariance(problem: Problem, state: State, places: Places | None) -> Covariance | None:
    try:
        inverted = _inverted(problem, state, places)
        if isinstance(problem.ball, Deformable) and places is not None:
            return deformable_factors(inverted, state, places)
        return point_factors(inverted, state, places)
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
    inverse = generalised_inverse(matrix, gauge)
    del matrix
    expanded = layout.expanded_rows(layout.expanded_rows(inverse).T)
    return Inverted(problem, linear, expanded, point_inverse, motions)
