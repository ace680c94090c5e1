"""Amplitudes of random effects by restricted maximum likelihood (H. Patterson and R. Thompson, 1971).

All other unknowns are eliminated: what is left is a quadratic form in the effects' coefficients b, of which each class
has a variance of its own. A class that the data do not ask for gets the variance 0.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs, dtrtri, dtrtrs  # pyright: ignore[reportAttributeAccessIssue]

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

    def of_columns(self, columns: IntArray) -> "Effects":
        """The same with some of the coefficients alone, (k,)."""
        own = np.ix_(columns, columns)
        return replace(self, matrix=self.matrix[own], gradient=self.gradient[columns], part=self.part[columns])


@dataclass(frozen=True)
class Estimate:
    """The effects' coefficients (m,), the variances (parts,) of each part's relative to sigma0 squared, and sigma0^2.

    `deviance`: -2 log of the restricted likelihood, but for a constant of the data; `freedom` (parts,): how many
    coefficients' worth the data determine, 0 where nobody asked.
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
    used = np.flatnonzero(variances[effects.part] > 0)
    if len(used) < len(effects.part):  # those that have a variance keep one
        best = _iterated(effects.of_columns(used), variances, limit)
        coefficients = np.zeros(len(effects.part))
        coefficients[used] = best.coefficients
        return replace(best, coefficients=coefficients)
    count = np.bincount(effects.part, minlength=len(effects.kind)).astype(float)
    best = solved(effects, variances, True)
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
        best = solved(effects, variances, True)
        if before.deviance - best.deviance < SETTLED:
            break
    return best


def _by_own_equations(effects: Effects, start: FloatArray) -> FloatArray:
    """The variances (parts,) of greatest restricted likelihood of each part by itself, as if there were no others."""
    variances = start.copy()
    for part in np.flatnonzero(start > 0):
        mine = np.flatnonzero(effects.part == part)
        if len(mine):
            own = replace(effects.of_columns(mine), part=np.zeros_like(mine), kind=effects.kind[:1])
            variances[part] = max(_iterated(own, start[part : part + 1]).variances[0], LEAST * start[part])
    return variances


def effect_cofactors(effects: Effects, variances: FloatArray) -> FloatArray:
    """Cofactors (m,m) of the coefficients for given variances (parts,); 0 where there is none."""
    cofactors = np.zeros_like(effects.matrix)
    used = np.flatnonzero(variances[effects.part] > 0)
    if len(used):
        factor, root = _factor(effects, variances, used)
        lower = dpotri(factor, lower=1, overwrite_c=1)[0]  # its upper triangle is 0 since dpotrf
        lower += np.tril(lower, -1).T
        lower *= root[:, None]
        cofactors[np.ix_(used, used)] = lower * root
    return cofactors


def others_eliminated(effects: Effects, variances: FloatArray, kept: BoolArray) -> Effects:
    """The effects of the kept parts (parts,) alone, as one part, all others eliminated with variances (parts,)."""
    own, others = (np.flatnonzero(some[effects.part]) for some in (kept, variances > 0))
    alone = replace(effects.of_columns(own), part=np.zeros_like(own), kind=effects.kind[:1])
    if len(others):
        factor, root = _factor(effects, variances, others)
        columns = np.column_stack([effects.matrix[np.ix_(others, own)], effects.gradient[others]]) * root[:, None]
        across = dtrtrs(factor, columns, lower=1)[0]
        across, pull = across[:, :-1], across[:, -1]
        matrix, gradient = alone.matrix - across.T @ across, alone.gradient - across.T @ pull
        alone = replace(alone, matrix=matrix, gradient=gradient, squares=effects.squares - float(pull @ pull))
    return alone


def _factor(effects: Effects, variances: FloatArray, used: IntArray) -> tuple[FloatArray, FloatArray]:
    """Cholesky's factor (u,u), lower, of 1 + R M R of some columns (u,) with the roots R (u,) of their variances."""
    root = np.sqrt(variances[effects.part[used]])
    own = effects.matrix if len(used) == len(effects.part) else effects.matrix[np.ix_(used, used)]
    scaled = own * root[:, None]
    scaled *= root
    scaled[np.diag_indices(len(root))] += 1.0
    factor, info = dpotrf(scaled.T, lower=1, overwrite_a=1)
    if info:
        raise np.linalg.LinAlgError
    return factor, root


def least_cost(effects: Effects, variances: FloatArray, fixed: FloatArray) -> float:
    """The least sum of squares, but for a constant, with some coefficients fixed (m,) and others of given variances."""
    gradient = effects.gradient + effects.matrix @ fixed
    free = solved(replace(effects, gradient=gradient), variances).coefficients
    return float(fixed @ (effects.gradient + gradient) + free @ gradient)


def solved(effects: Effects, variances: FloatArray, with_freedom: bool = False) -> Estimate:
    """The coefficients for given variances (parts,); `with_freedom`: and what the data determine, in twice the time."""
    used = np.flatnonzero(variances[effects.part] > 0)
    b = np.zeros(len(effects.part))
    freedom = np.zeros(len(effects.kind))
    squares, log_det = effects.squares, 0.0
    if len(used):
        factor, root = _factor(effects, variances, used)
        log_det = 2 * float(np.log(np.diag(factor)).sum())
        pull = root * effects.gradient[used]
        taken = -dpotrs(factor, pull, lower=1)[0]
        b[used] = root * taken
        squares += float(pull @ taken)
        if with_freedom:
            inverse = dtrtri(factor, lower=1, overwrite_c=1)[0]  # its upper triangle is 0 since dpotrf
            left = 1.0 - np.einsum("ij,ij->j", inverse, inverse)
            freedom += np.bincount(effects.part[used], left, len(effects.kind))
    sigma2 = max(squares, 1e-30) / effects.redundancy
    return Estimate(b, variances, sigma2, effects.redundancy * float(np.log(sigma2)) + log_det, freedom)
