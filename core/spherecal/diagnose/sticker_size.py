"""Whether the stickers that give the scale keep their size: over the recording, and near as far.

Where stickers shrink, or blur moves their dots outward, residuals lie along the lines from the middle of a sticker to
its dots. The shape of the ball takes the mean of it and hands it to the scale; what is left differs from
placement to placement, or is the same in px near and far.
"""

from collections.abc import Iterable

import numpy as np
from scipy.special import chdtri

from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence

# A sticker's size in an image is known from so many dots. By chance dots that lie outward are named once in a million
# recordings, a change of size once in a thousand: it adds 0.01 % to the scale then. Stickers that shrank by 0.03 % were
# found at 1e-6 on one rig A of two, and lengths 3.5 U off on the other.
LEAST_DOTS, FALSE_ALARM, FALSE_CHANGE = 4, 1e-6, 1e-3
# Ball and cameras take up most of an outward shift: of 0.1 px, 0.017 to 0.038 px are left (eight recordings, rigs A, B
# and random; the least on A).
TAKEN_UP = 6.0
# What prints err by anyway asks for no care once it is in the scale's uncertainty.
HARMFUL = 0.001


def sticker_doubt(findings: Iterable[Finding]) -> float:
    """The relative standard uncertainty that stickers which change add to the scale, by what was found."""
    return sum(f.values["doubt_percent"] / 100 for f in findings if f.code == "stickers-change")


def sticker_findings(e: Evidence) -> list[Finding]:
    """The finding where stickers that give the scale do not keep their size, beyond chance."""
    o, count = e.observations, len(e.session.placements)
    use = e.used & np.isfinite(e.residual_px[:, 0]) & (o.placement < count)
    if e.solution.scale.source != "target_spacing" or use.sum() < 10 * count:
        return []
    rows = np.flatnonzero(use)
    key = np.stack([o.placement[rows], o.camera[rows], o.target[rows]], axis=1)
    sticker, dots = np.unique(key, axis=0, return_inverse=True, return_counts=True)[1:]
    sticker = sticker.reshape(-1)
    residual = e.residual_px[rows]
    predicted = o.uv[rows] + residual
    middle, shift = (
        np.stack([np.bincount(sticker, x[:, i]) / dots for i in (0, 1)], axis=1)[sticker] for x in (predicted, residual)
    )
    out = predicted - middle
    size = np.linalg.norm(out, axis=1)
    keep = (dots[sticker] >= LEAST_DOTS) & (size > 0)
    out, size, place = out[keep], size[keep], o.placement[rows][keep]
    along = -((residual - shift)[keep] * out).sum(axis=1) / size  # observed farther out than predicted
    if not len(size):
        return []
    own = np.unique(place, return_inverse=True)[1].reshape(-1)
    matrix = np.diag(np.append(np.bincount(own, size**2), len(size)))  # sizes by placement, and outward
    matrix[-1, :-1] = matrix[:-1, -1] = np.bincount(own, size)
    normal = np.linalg.inv(matrix)
    found = normal @ np.append(np.bincount(own, size * along), along.sum())
    variance = float(((along - size * found[own] - found[-1]) ** 2).sum() / max(len(along) - len(found), 1))
    sizes, outward = found[:-1], float(found[-1])
    contrast = np.eye(len(sizes)) - 1 / len(sizes)
    drift = contrast @ sizes
    spread = variance * contrast @ normal[:-1, :-1] @ contrast
    statistic = float(drift @ np.linalg.pinv(spread) @ drift) if len(sizes) > 1 else 0.0
    drifts = statistic > chdtri(max(len(sizes) - 1, 1), FALSE_CHANGE)
    # where every dot is a point of its own, it takes up what all cameras see: 0.09 px are left of real corners (dome15)
    is_rigid = e.choice.form == "rigid"
    moves = is_rigid and outward**2 > variance * normal[-1, -1] * chdtri(1, FALSE_ALARM)
    if not (drifts or moves):
        return []
    relative = float(np.ptp(sizes)) if drifts else 0.0
    outward = TAKEN_UP * outward if moves else 0.0
    doubt = float(np.hypot(relative, outward / np.median(size)))
    values = {"percent": 100 * relative, "outward_px": outward, "doubt_percent": 100 * doubt}
    return [Finding("stickers-change", "warning" if doubt > HARMFUL else "info", values)]
