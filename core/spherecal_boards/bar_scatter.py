"""How much a waved bar's length varies at random from frame to frame: a variance component beside the images' noise."""

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from spherecal.adjust.bundle import GATE_SIGMAS
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal_boards.bar_model import BarModel
from spherecal_boards.frame_network import sum_by

# Twice the logarithm of the likelihoods' ratio from which a bar counts as unsteady: 3.3 standard deviations.
LEAST_EVIDENCE = 11.0
# Lengths for each number of the smooth change: with fewer it takes the scatter that is looked for.
LEAST_SHARE = 3


def length_scatter(model: BarModel, state: State, noise: float) -> float:
    """The standard deviation in mm of the bar's length between frames, 0 where the images' noise explains its spread.

    `state` has points by the images alone, `noise` is the standard deviation of unit weight. Restricted maximum
    likelihood beside what changes smoothly with place and direction, which is the lenses' and not the bar's; lengths
    that even the scatter does not explain are left out.
    """
    lengths, difference = model.lengths, model.differences(state)
    size = np.linalg.norm(difference, axis=1)
    along = difference / size[:, None]
    off, variance = size - lengths.length, noise**2 * _variances(model, state, along)
    middle = np.nanmean(state.points.reshape(-1, model.parts, 3)[lengths.frame], axis=1)
    known = np.isfinite(off) & np.isfinite(variance) & (variance > 0)
    off, variance = off[known], variance[known]
    smooth = _smooth(along[known], middle[known]) * lengths.length[known, None]
    other = lengths.certificate[known, None] == np.unique(lengths.certificate)[1:]  # each certificate's own error
    smooth = np.hstack([smooth, other])
    if len(off) < LEAST_SHARE * smooth.shape[1]:
        return 0.0
    weight = 1 / np.sqrt(variance)[:, None]
    rest = off - smooth @ np.linalg.lstsq(weight * smooth, weight[:, 0] * off, rcond=None)[0]
    robust = max(float(np.median(rest**2 / chi2.median(1) - variance)), 0.0)
    kept = rest**2 <= GATE_SIGMAS**2 * (variance + robust)
    off, variance, smooth = off[kept], variance[kept], smooth[kept]

    def deviance(log_sd: float) -> float:
        return _deviance(off, variance + np.exp(2 * log_sd), smooth)

    usual = float(np.sqrt(np.median(variance)))
    bounds = np.log(1e-2 * usual), np.log(10 * (usual + float(np.std(off))))
    best = minimize_scalar(deviance, bounds=bounds, method="bounded")
    clear = _deviance(off, variance, smooth) - float(best.fun) >= LEAST_EVIDENCE
    return float(np.exp(best.x)) if clear else 0.0


def _deviance(off: FloatArray, variance: FloatArray, smooth: FloatArray) -> float:
    """Twice the negative logarithm of the restricted likelihood of lengths, but for a constant."""
    weight = 1 / np.sqrt(variance)
    q, r = np.linalg.qr(weight[:, None] * smooth)
    scaled = weight * off
    rest = scaled - q @ (q.T @ scaled)
    return float(np.log(variance).sum() + 2 * np.log(np.abs(np.diag(r))).sum() + rest @ rest)


def _smooth(along: FloatArray, middle: FloatArray) -> FloatArray:
    """Strains (m,24) of lengths along (m,3) at places (m,3): by direction, and linear in place."""
    i, j = np.triu_indices(3)
    place = (middle - middle.mean(axis=0)) / middle.std(axis=0).max()
    by_place = np.column_stack([np.ones(len(place)), place])
    return ((along[:, i] * along[:, j])[:, :, None] * by_place[:, None]).reshape(len(along), -1)


def _variances(model: BarModel, state: State, along: FloatArray) -> FloatArray:
    """Variances (m,) of lengths along (m,3) by the images alone, for unit weight of 1 and given cameras."""
    by_point = model.linearise(state, None)[2]
    normal = sum_by(model.part, by_point.transpose(0, 2, 1) @ by_point, model.n_frames * model.parts)
    good = np.isfinite(normal).all(axis=(1, 2)) & (np.linalg.cond(np.nan_to_num(normal)) < 1e12)
    cofactor = np.full_like(normal, np.inf)
    cofactor[good] = np.linalg.inv(normal[good])
    cofactor = cofactor.reshape(-1, model.parts, 3, 3)[model.lengths.frame]
    used = model.lengths.coefficient != 0
    each = np.einsum("mi,msij,mj->ms", along, np.where(used[:, :, None, None], cofactor, 0.0), along)
    return np.asarray((model.lengths.coefficient**2 * each).sum(axis=1), dtype=np.float64)
