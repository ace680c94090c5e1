"""Millimetres from the known spacing of two dots of every target, [Tao21] (18)-(19), with two departures.

metric = reconstructed / ratio (the paper prints the product), and a flat sticker bent onto a ball turns the printed
distance d, an arc, into the chord 2 R sin(d / 2R): 3e-4 shorter at d = 22 mm, R = 250 mm, 0.13 mm on a 400 mm bar.
"""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust.covariance import Covariance
from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.network.observations import Features


@dataclass(frozen=True)
class FoundScale:
    """metric length = factor * network length; its relative standard uncertainty; stickers (or bar lengths) used.

    `scatter` is the relative standard deviation between stickers that measurement noise does not explain: the print.
    `gradient` (f,3): how the measured size follows the features' places, relatively.
    """

    factor: float
    relative_uncertainty: float
    count: int
    gradient: FloatArray
    scatter: float = 0.0


@dataclass(frozen=True)
class Spacing:
    """The known distance between two named dots (their point indices); on a sphere it is an arc, else straight."""

    from_point: int
    to_point: int
    distance_mm: float
    on_sphere: bool


def scale_from_spacing(
    spacing: Spacing, features: Features, points: FloatArray, radius: FloatArray, covariance: Covariance,
    variance: float,
) -> FoundScale | None:  # fmt: skip
    """The scale from all targets with both dots reconstructed; None where there is none.

    points (p,3) in network units, radius (placements,) of the fitted spheres in network units (NaN: none),
    variance: square of sigma0. Targets are weighted by their measurement noise and by the scatter of the print, which
    is estimated too (R. DerSimonian, N. Laird, Meta-analysis in clinical trials, 1986): the same sticker at several
    placements averages its noise, not its print error.
    """
    first, second = _pairs(spacing, features, covariance)
    if not len(first):
        return None
    length, _, relative_variance = _lengths(points, first, second, covariance, variance)
    plausible = _plausible(length, relative_variance)
    first, second = first[plausible], second[plausible]
    length, along, relative_variance = _lengths(points, first, second, covariance, variance)
    reference = np.full(len(length), spacing.distance_mm)
    weight, scatter = _weights(length / reference, relative_variance, features.target[first])
    mean = float(weight @ (length / reference))
    for _ in range(5 if spacing.on_sphere else 0):  # the chord depends on the radius in millimetres
        reference = chord(spacing.distance_mm, radius[features.placement[first]] / mean)
        weight, scatter = _weights(length / reference, relative_variance, features.target[first])
        mean = float(weight @ (length / reference))
    gradient = np.zeros_like(points)
    share = (weight / reference / mean)[:, None] * along
    np.add.at(gradient, second, share)
    np.add.at(gradient, first, -share)
    per_target = np.bincount(np.unique(features.target[first], return_inverse=True)[1].reshape(-1), weight)
    by_print = scatter**2 * float((per_target**2).sum())
    uncertainty = np.sqrt(variance * covariance.functional(gradient) + by_print)
    return FoundScale(1.0 / mean, float(uncertainty), len(per_target), gradient, scatter)


def _lengths(
    points: FloatArray, first: IntArray, second: IntArray, covariance: Covariance, variance: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distances (n,), their directions (n,3) and relative variances by image noise (n,)."""
    difference = points[second] - points[first]
    length = np.linalg.norm(difference, axis=1)
    along = difference / length[:, None]
    noise = covariance.point_noise[first] + covariance.point_noise[second]
    return length, along, variance * np.einsum("ni,nij,nj->n", along, noise, along) / length**2


def _plausible(length: FloatArray, relative_variance: FloatArray) -> BoolArray:
    """Distances that are no blunders, (n,): within 6 standard deviations, as observed and as computed, of the median.

    A wrong code along the epipolar line of a two-view point puts that point metres away, unseen by the adjustment.
    """
    off = np.abs(length / np.median(length) - 1)
    spread = 1.4826 * float(np.median(off))
    return off <= 6 * np.maximum(np.sqrt(np.minimum(relative_variance, 1e-4)), max(spread, 1e-9))


def chord(arc_mm: float, radius_mm: FloatArray) -> FloatArray:
    """The straight distance between two points `arc_mm` apart on a sphere; the arc itself where no radius is known."""
    with np.errstate(divide="ignore", invalid="ignore"):
        length = 2 * radius_mm * np.sin(arc_mm / (2 * radius_mm))
    return np.where(np.isfinite(length) & (radius_mm > arc_mm), length, arc_mm)


def _pairs(spacing: Spacing, features: Features, covariance: Covariance) -> tuple[IntArray, IntArray]:
    """Features of the two dots of every target at every placement, where both have points."""
    known = np.isfinite(covariance.points[:, 0, 0])
    ends = []
    for point in (spacing.from_point, spacing.to_point):
        rows = np.flatnonzero((features.point == point) & known)
        ends.append({(features.placement[r], features.target[r]): r for r in rows})
    both = [key for key in ends[0] if key in ends[1]]
    first, second = (np.array([end[key] for key in both], dtype=np.int64) for end in ends)
    # a sticker of the rigid ball is one, however many placements show it
    unknowns = np.stack([covariance.point_of_feature[first], covariance.point_of_feature[second]])
    once = np.sort(np.unique(unknowns, axis=1, return_index=True)[1])
    return first[once], second[once]


def _weights(ratio: FloatArray, variance: FloatArray, target: IntArray) -> tuple[FloatArray, float]:
    """Weights (n,) that sum to 1, and the scatter between targets beyond the noise, from relative variances (n,)."""
    ratio = ratio / np.median(ratio)
    _, index = np.unique(target, return_inverse=True)
    index = index.reshape(-1)
    precision = 1.0 / variance
    total = np.bincount(index, precision)
    within = precision / total[index]
    mean, noise = np.bincount(index, within * ratio), 1.0 / total
    weight = total / total.sum()
    overall = weight @ mean
    q = (total * (mean - overall) ** 2).sum()
    excess = q - (len(mean) - 1)
    between = max(0.0, excess / (total.sum() - (total**2).sum() / total.sum())) if len(mean) > 1 else 0.0
    final = 1.0 / (noise + between)
    final /= final.sum()
    return within * final[index], float(np.sqrt(between) / overall)
