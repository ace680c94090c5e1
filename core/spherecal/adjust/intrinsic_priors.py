"""Cameras whose intrinsics the data do not determine: each gets a prior, and a finding says so."""

from dataclasses import replace

import numpy as np

from spherecal.adjust.covariance import Covariance
from spherecal.adjust.network import Network
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.rows import Priors
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.geometry.camera import INTRINSIC_NAMES, is_fisheye

# Fewer image points in at least two views than this hold no nine intrinsics beside the six of the pose, whatever their
# distribution; a healthy camera has some 500.
LEAST_OBSERVATIONS = 40
# A focal length worse than this says less than the data sheet does (nominal values are good to 1 to 2 %).
WORST_RELATIVE_FOCAL_SD = 0.01
# Perfect observations leave no noise to weigh a prior against; real dots never come below 0.01 px.
LEAST_NOISE = 1e-3
# Numerator and denominator of a rational lens may share a factor, which changes no image point: on dome15 k1 came out
# as 1875 +- 2453 and, with a lens for each camera, the equations were singular. So k4..k6 are kept near what was known,
# with the weight of one image point of 1 px; where the data do determine them, that weighs nothing.
RATIONAL_SD = 1.0
_DENOMINATOR = slice(9, 12)


def prior_sigmas(intrinsics: FloatArray) -> FloatArray:
    """Standard uncertainties (c,16) of intrinsics, typical of nominal values and ordinary lenses.

    Focal length 1 %, principal point 10 px at f = 2000 px, radial terms 0.1, tangential and prism terms 0.002.
    """
    sigma = np.full_like(intrinsics, 0.1)
    sigma[:, :2] = 0.01 * intrinsics[:, :2]
    sigma[:, 2:4] = 0.005 * intrinsics[:, :2]
    small = np.isin(INTRINSIC_NAMES, ("p1", "p2", "s1", "s2", "s3", "s4"))
    sigma[:, small] = 0.002
    sigma[is_fisheye(intrinsics), 4:8] = 0.1  # all four are radial
    return sigma


def with_intrinsic_priors(network: Network, known: FloatArray, has_prior: BoolArray, noise: float) -> Network:
    """The network with a prior on the intrinsics (c,16) of the groups of these cameras, and on rational denominators.

    Priors are to weigh against image points as both really scatter.

    `has_prior`: cameras whose intrinsics the data cannot carry, (c,).
    """
    rational = network.free[:, _DENOMINATOR].any(axis=1)
    if not (has_prior | rational).any():
        return network
    members = np.isin(network.group, network.group[has_prior])
    noise = noise if noise > LEAST_NOISE else LEAST_NOISE
    sigma = np.where(members[:, None], prior_sigmas(known) / noise, np.inf)
    sigma[rational & ~members, _DENOMINATOR] = RATIONAL_SD
    return replace(network, priors=Priors(known, sigma))


def poorly_observed(network: Network, candidates: BoolArray) -> BoolArray:
    """Cameras (c,) whose intrinsics group has too few image points to estimate them.

    `candidates`: observations that may be used, (n,).
    """
    matched = candidates & (network.views(candidates) >= 2)[network.feature]
    by_group = np.bincount(network.group[network.camera[matched]], minlength=network.group.max() + 1)
    return network.free.any(axis=1) & (by_group[network.group] < LEAST_OBSERVATIONS)


def poorly_determined(problem: Problem, state: State, covariance: Covariance, variance: float) -> BoolArray:
    """Cameras (c,) whose estimated focal length is less certain than a data sheet's."""
    out = np.zeros(problem.n_cameras, dtype=bool)
    columns = problem.intrinsic_columns
    if not len(columns) or columns[0] != 0:
        return out
    sd = np.sqrt(np.maximum(variance * covariance.cameras[:, POSE, POSE], 0.0))
    return problem.free_intrinsics[:, 0] & (sd > WORST_RELATIVE_FOCAL_SD * state.intrinsics[:, 0])
