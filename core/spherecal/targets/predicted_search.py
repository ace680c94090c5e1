"""Targets that detection missed, looked for at places predicted by a first adjustment."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.targets import sticker_view as sv
from spherecal.targets.blobs import GreyImage
from spherecal.targets.code_table import CodeTable
from spherecal.targets.refinement import refine

# Predictions of an adjusted network are good to hundredths of a pixel; what is fitted farther off is something else.
MOST_OFF_PX = 0.5
# The fit must describe the pixels and leave no doubt about the place: blank or covered stickers give 3 and more, or
# uncertainties of whole pixels.
MOST_MISFIT, MOST_SIGMA_PX = 2.0, 0.15
LEAST_DOTS = 5
_FOCAL_ERROR = 0.01  # relative, of a camera's focal length in a first adjustment


@dataclass(frozen=True)
class ExpectedTargets:
    """Where targets should be in one image: ids (n,), dots (n, 8, 2) px in the order of DOTS, NaN where not known.

    `known` (k,) and `known_uv` (k, 8, 2) are targets found before: they give the noise and the blur of the image.
    """

    targets: IntArray
    uv: FloatArray
    known: IntArray
    known_uv: FloatArray


@dataclass(frozen=True)
class Found:
    """Targets found again: ids (m,), dots (m, 8, 2) px and their standard uncertainties, NaN where not used."""

    targets: IntArray
    uv: FloatArray
    sigma_uv: FloatArray


def detect_predicted(image: GreyImage, expected: ExpectedTargets, table: CodeTable, camera: Sequence[float]) -> Found:
    """The expected targets that the grey image (h, w) really shows, with all dots that were expected of each."""
    image = np.require(image, requirements=["C", "W"])  # as in detection.py: one type of image
    ids = np.concatenate([expected.known, expected.targets])
    uv = np.concatenate([expected.known_uv, expected.uv])
    layouts = table.layouts[np.searchsorted(table.ids, ids)]
    views = np.zeros((len(ids), sv.VIEW_SIZE))
    seen = np.isfinite(uv[..., 0])
    usable = seen.sum(axis=1) >= LEAST_DOTS
    for i in np.flatnonzero(usable):
        usable[i] = sv.fit_view(layouts[i][seen[i]], uv[i][seen[i]], np.array(camera), True, views[i])
    new = np.arange(len(ids)) >= len(expected.known)
    if not (usable & new).any():
        return Found(np.zeros(0, dtype=np.int64), np.zeros((0, 8, 2)), np.zeros((0, 8, 2)))
    rows = np.flatnonzero(usable)
    looked_for = np.flatnonzero(new[rows])
    dots = refine(image, uv[rows], layouts[rows], table.dot_radius, views[rows], _FOCAL_ERROR, looked_for)
    with np.errstate(invalid="ignore"):
        near = (np.linalg.norm(dots.uv - uv[rows], axis=2) <= MOST_OFF_PX) & (dots.sigma <= MOST_SIGMA_PX).all(axis=2)
    # all dots that were expected must be there: a target half covered is left alone
    there = new[rows] & (near == seen[rows]).all(axis=1) & (dots.misfit <= MOST_MISFIT)
    return Found(ids[rows[there]], dots.uv[there], dots.sigma[there])
