"""Amplitudes of random effects by restricted maximum likelihood (H. Patterson and R. Thompson, 1971).

All other unknowns are eliminated: what is left is a quadratic form in the effects' coefficients b, of which each class
has a variance of its own. A class that the data do not ask for gets the variance 0.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs  # pyright: ignore[reportAttributeAccessIssue]

from spherecal.base.arrays import BoolArray, FloatArray, IntArray

ROUNDS = 30
SETTLED = 0.5  # change of the deviance in a round; effects are taken from 30 on
MOST_GROWTH = 4.0  # of an amplitude in a round
OWN_WEIGHT = 4.0  # coefficients' worth of the common amplitude in a class's own
# From so many coefficients on, which take 0.1 s a round, each part's own equations say where to begin (and no lower).
LARGE, LEAST = 1500, 0.01


@dataclass(frozen=True)
class Effects:
    """The quadratic form of random effects: b'Mb/2 + b'g and the squares of all residuals without them.

    `matrix` (m,m), `gradient` (m,), `squares` and their `redundancy`; `part` (m,): what may differ in amplitude from
    what else (a camera's field, its turns), `kind` (parts,): which of these share a typical amplitude.
    """

    matrix: FloatArray
    gradient: FloatArray
    squares: float
    redundancy: int
    part: IntArray
    kind: IntArray


@dataclass(frozen=True)
class Estimate:
    """The effects' coefficients (m,), the variances (parts,) of each part's relative to sigma0 squared, and sigma0^2.

    `deviance`: -2 log of the restricted likelihood, but for a constant of the data; `freedom` (parts,): how many
    coefficients' worth the data determine.
    """

    coefficients: FloatArray
    variances: FloatArray
    sigma0_squared: float
    deviance: float
    freedom: FloatArray


def estimated(effects: Effects, start: FloatArray, limit: FloatArray | None = None) -> Estimate:
    """Coefficients, and amplitudes of greatest restricted likelihood from variances (parts,), at most `limit`."""
    if np.count_nonzero(start[effects.part]) > LARGE:
        start = _by_own_equations(effects, start)
    return _iterated(effects, start, limit)


def _iterated(effects: Effects, variances: FloatArray, limit: FloatArray | None = None) -> Estimate:
    count = np.bincount(effects.part, minlength=len(effects.kind)).astype(float)
    best = solved(effects, variances)
    for _ in range(ROUNDS):
        b, freedom, sigma2 = best.coefficients, best.freedom, best.sigma0_squared
        squares = np.bincount(effects.part, b**2, len(effects.kind)) / sigma2
        new = np.zeros_like(variances)
        for kind in np.unique(effects.kind):
            own = (effects.kind == kind) & (count > 0) & (variances > 0)
            if not own.any():
                continue
            common = squares[own].sum() / max(freedom[own].sum(), 1e-12)
            new[own] = (squares[own] + OWN_WEIGHT * common) / (freedom[own] + OWN_WEIGHT)
        most = variances * MOST_GROWTH**2 if limit is None else np.minimum(variances * MOST_GROWTH**2, limit)
        new = np.clip(new, variances / MOST_GROWTH**2, most)
        variances, before = new, best
        best = solved(effects, variances)
        if before.deviance - best.deviance < SETTLED:
            break
    return best


def _by_own_equations(effects: Effects, start: FloatArray) -> FloatArray:
    """The variances (parts,) of greatest restricted likelihood of each part by itself, as if there were no others."""
    variances = start.copy()
    for part in np.flatnonzero(start > 0):
        mine = np.flatnonzero(effects.part == part)
        if len(mine):
            matrix, gradient = effects.matrix[np.ix_(mine, mine)], effects.gradient[mine]
            own = replace(effects, matrix=matrix, gradient=gradient, part=np.zeros_like(mine), kind=effects.kind[:1])
            variances[part] = max(_iterated(own, start[part : part + 1]).variances[0], LEAST * start[part])
    return variances


def effect_cofactors(effects: Effects, variances: FloatArray) -> FloatArray:
    """Cofactors (m,m) of the coefficients for given variances (parts,); 0 where there is none."""
    root = np.sqrt(variances[effects.part])
    scaled = effects.matrix * root[:, None] * root
    scaled[np.diag_indices(len(root))] += 1.0
    return np.asarray(np.linalg.inv(scaled) * root[:, None] * root, dtype=np.float64)


def others_eliminated(effects: Effects, variances: FloatArray, kept: BoolArray) -> Effects:
    """The effects of the kept parts (parts,) alone, as one part, all others eliminated with variances (parts,)."""
    others, own = effect_cofactors(effects, variances), kept[effects.part]
    across = others @ effects.matrix[:, own]
    matrix = effects.matrix[np.ix_(own, own)] - effects.matrix[own] @ across
    gradient = effects.gradient[own] - across.T @ effects.gradient
    squares = effects.squares - float(effects.gradient @ others @ effects.gradient)
    return replace(
        effects,
        matrix=matrix,
        gradient=gradient,
        squares=squares,
        part=np.zeros(own.sum(), dtype=int),
        kind=effects.kind[:1],
    )


def least_cost(effects: Effects, variances: FloatArray, fixed: FloatArray) -> float:
    """The least sum of squares, but for a constant, with some coefficients fixed (m,) and others of given variances."""
    gradient = effects.gradient + effects.matrix @ fixed
    free = solved(replace(effects, gradient=gradient), variances).coefficients
    return float(fixed @ (effects.gradient + gradient) + free @ gradient)


def solved(effects: Effects, variances: FloatArray) -> Estimate:
    """The coefficients for given variances (parts,)."""
    used = variances[effects.part] > 0
    b = np.zeros(len(effects.part))
    freedom = np.zeros(len(effects.kind))
    squares, log_det = effects.squares, 0.0
    if used.any():
        root = np.sqrt(variances[effects.part[used]])
        scaled = effects.matrix[np.ix_(used, used)] * root[:, None] * root
        scaled[np.diag_indices(len(root))] += 1.0
        factor, info = dpotrf(scaled.T, lower=1, overwrite_a=1)
        if info:
            raise np.linalg.LinAlgError
        log_det = 2 * float(np.log(np.diag(factor)).sum())
        pull = root * effects.gradient[used]
        taken = -dpotrs(factor, pull, lower=1)[0]
        inverse = dpotri(factor, lower=1, overwrite_c=1)[0]  # its lower triangle
        b[used] = root * taken
        squares += float(pull @ taken)
        freedom += np.bincount(effects.part[used], 1.0 - np.diag(inverse), len(effects.kind))
    sigma2 = max(squares, 1e-30) / effects.redundancy
    return Estimate(b, variances, sigma2, effects.redundancy * float(np.log(sigma2)) + log_det, freedom)
