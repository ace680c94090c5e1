"""Lenses that deviate from the model: structure that is left in a camera's residuals over its image."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander2d
from scipy.special import chdtri

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.diagnose.score import ScoreTest, change_of, conditional

# Smooth fields of u and v that are tried: polynomials over the image up to this degree together. A field of one period
# over the image is met to a tenth of its size.
DEGREE = 5
TERMS = (DEGREE + 1) * (DEGREE + 2) // 2
# A camera with fewer points says nothing about its lens beyond the model (42 numbers on top of its 15).
LEAST_POINTS = 100
# In 2 of 1000 faultless rigs noise makes one camera's statistic exceed the limit.
FALSE_ALARM = 0.002


@dataclass(frozen=True)
class Misfit:
    """Structure in one camera's residuals: chi-square `statistic` on `dof`; `rms_px` of the part that is visible."""

    camera: int
    statistic: float
    dof: int
    rms_px: float


def field_values(probe: ScoreTest, rows: IntArray, size: FloatArray) -> FloatArray:
    """Derivatives (k,2,2*TERMS) of one camera's rows (k,) by its fields: Legendre polynomials over its image (2,)."""
    terms = field_terms(probe.problem.uv[rows], size)
    weight = probe.problem.weight[rows]
    values = np.zeros((len(rows), 2, 2 * TERMS))
    values[:, 0, :TERMS] = terms * weight[:, :1]
    values[:, 1, TERMS:] = terms * weight[:, 1:]
    return values


def field_terms(uv: FloatArray, size: FloatArray) -> FloatArray:
    """Legendre polynomials (k,TERMS) at pixels (k,2) of an image (2,)."""
    at = (2 * uv + 1) / size - 1
    powers = np.add.outer(np.arange(DEGREE + 1), np.arange(DEGREE + 1)).ravel()
    return np.asarray(legvander2d(at[:, 0], at[:, 1], [DEGREE, DEGREE])[:, powers <= DEGREE], dtype=np.float64)


def misfits(
    probe: ScoreTest,
    sizes: FloatArray,
    noise_px: FloatArray,
    moved: dict[int, FloatArray],
    context: Context | None = None,
) -> list[Misfit]:
    """Cameras whose residuals have structure over images (c,2) px: Rao's test of smooth fields beside known moves."""
    problem = probe.problem
    tested = np.flatnonzero(np.bincount(problem.camera, minlength=problem.n_cameras) >= LEAST_POINTS)
    found = []
    for camera in tested:
        if context is not None:
            context.check()
        rows = np.flatnonzero(problem.camera == camera)
        values = field_values(probe, rows, sizes[camera])
        before = moved.get(int(camera), np.zeros((len(rows), 2, 0)))
        g, a, own = probe.block(rows, np.concatenate([before, values], axis=2))
        change = change_of(*conditional(g, a, own, np.arange(before.shape[2])), probe.variance)
        if change.dof and change.statistic > chdtri(change.dof, FALSE_ALARM / len(tested)):
            visible = np.sqrt((change.statistic - change.dof) / (2 * len(rows)))
            found.append(Misfit(int(camera), change.statistic, change.dof, float(visible * noise_px[camera])))
    return found
