"""Cameras whose intrinsics the data do not determine: each gets a prior, and a finding says so."""

from dataclasses import replace

import numpy as np

from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.network import Network
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Priors, Problem
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
# So many estimated lenses say how good nominal values are; lenses are alike whose focal lengths differ by less.
LEAST_SHOWN, ALIKE = 3, 0.05
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


def shown_lenses(free: BoolArray, placed: BoolArray, has_prior: BoolArray) -> BoolArray:
    """Cameras (c,) whose estimated lenses say how good nominal values are in this rig; none where they are too few."""
    shown = free[:, 0] & placed & ~has_prior
    return shown & (shown.sum() >= LEAST_SHOWN)


def like_the_others(known: FloatArray, estimated: FloatArray, shown: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Nominal intrinsics (c,16) and their standard uncertainties, by what the lenses that are shown (c,) have.

    Focal lengths are off by what those of the rig are off, distortion is that of lenses of equal focal length. Entered
    30 % wrong for all cameras, one of few points was 277 mm off, 3.3 times its U.
    """
    known, sigma = known.copy(), prior_sigmas(known)
    if not shown.any():
        return known, sigma
    ratio = estimated[shown, 0] / known[shown, 0]
    typical = float(np.median(ratio))
    scatter = np.sqrt(np.mean((ratio / typical - 1) ** 2))
    alike_of = np.abs(known[:, None, :1] / known[None, :, :1] - 1)[..., 0] < ALIKE
    alike_of &= shown & (is_fisheye(known)[:, None] == is_fisheye(known))
    for c, alike in enumerate(alike_of):
        if alike.sum() >= LEAST_SHOWN:
            own = estimated[alike, 4:]
            known[c, 4:] = np.median(own, axis=0)
            sigma[c, 4:] = np.maximum(sigma[c, 4:], np.sqrt(np.mean((own - known[c, 4:]) ** 2, axis=0)))
    known[:, :2] *= typical
    sigma[:, :4] = prior_sigmas(known)[:, :4]
    sigma[:, :2] = np.maximum(sigma[:, :2], scatter * known[:, :2])
    return known, sigma


def with_intrinsic_priors(
    network: Network, known: FloatArray, has_prior: BoolArray, noise: float, sigma: FloatArray | None = None
) -> Network:
    """The network with a prior on the intrinsics (c,16) of these cameras' groups, and on rational denominators.

    Priors are to weigh against image points as both really scatter; `sigma` (c,16) None: that of nominal values.
    """
    rational = network.free[:, _DENOMINATOR].any(axis=1)
    if not (has_prior | rational).any():
        return network
    members = np.isin(network.group, network.group[has_prior])
    noise = noise if noise > LEAST_NOISE else LEAST_NOISE
    stated = prior_sigmas(known) if sigma is None else sigma
    sigma = np.where(members[:, None], stated / noise, np.inf)
    sigma[rational & ~members, _DENOMINATOR] = RATIONAL_SD
    return replace(network, priors=Priors(known, sigma))


def poorly_observed(network: Network, candidates: BoolArray) -> BoolArray:
    """Cameras (c,) whose intrinsics group has too few image points among `candidates` (n,) to estimate them."""
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
