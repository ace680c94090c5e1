"""Cameras whose intrinsics an adjustment over frames does not determine: they get a prior, as in `adjust`."""

import numpy as np

from spherecal.adjust.intrinsic_priors import LEAST_NOISE, LEAST_OBSERVATIONS, WORST_RELATIVE_FOCAL_SD, prior_sigmas
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.rows import NO_PRIORS, Priors
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal_boards.frames_covariance import FrameCovariance

# One view of a plane board leaves the focal length open.
_LEAST_FRAMES = 2


def priors_of(group: IntArray, known: FloatArray, has_prior: BoolArray, noise: float) -> Priors:
    """Priors (c,16) of the groups of cameras that need one, weighed as both scatter; or NO_PRIORS."""
    if not has_prior.any():
        return NO_PRIORS
    members = np.isin(group, group[has_prior])
    sigma = prior_sigmas(known) / max(noise, LEAST_NOISE)
    return Priors(known, np.where(members[:, None], sigma, np.inf))


def poorly_observed(group: IntArray, free: BoolArray, camera: IntArray, frame: IntArray) -> BoolArray:
    """Cameras (c,) whose group has too few observations, or frames, to estimate intrinsics."""
    count = int(group.max()) + 1
    observations = np.bincount(group[camera], minlength=count)
    seen = np.unique(np.stack([group[camera], frame]), axis=1)
    frames = np.bincount(seen[0], minlength=count)
    few = (observations < LEAST_OBSERVATIONS) | (frames < _LEAST_FRAMES)
    return free.any(axis=1) & few[group]


def poorly_determined(problem: Problem, state: State, covariance: FrameCovariance | None, variance: float) -> BoolArray:
    """Cameras (c,) whose focal length is less certain than a data sheet's; all free ones where all is singular."""
    columns = problem.intrinsic_columns
    if not len(columns) or columns[0] != 0:
        return np.zeros(problem.n_cameras, dtype=bool)
    if covariance is None:
        return problem.free_intrinsics[:, 0]
    sd = np.sqrt(np.maximum(variance * covariance.cameras[:, POSE, POSE], 0.0))
    return problem.free_intrinsics[:, 0] & (sd > WORST_RELATIVE_FOCAL_SD * state.intrinsics[:, 0])
