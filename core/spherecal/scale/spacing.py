"""Millimetres from the known spacing of two dots of every target, [Tao21] (18)-(19), with two departures.

metric = reconstructed / ratio, where the paper prints the product. And a flat sticker bent onto a ball turns the
printed distance d, an arc, into the chord 2 R sin(d / 2R). That is 3e-4 shorter at d = 22 mm, R = 250 mm, 0.13 mm on a
400 mm bar.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from spherecal.adjust.covariance_factors import Covariance
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.observations import Features

if TYPE_CHECKING:
    from spherecal.scale.bar_scale import OddPoses

# A pattern needs as many dots as a target's centre does.
LEAST_DOTS = 4
# A print counts as stretched from this chi-square on (2 degrees of freedom: one of 270,000 by chance), of as many
# targets.
SURE_STRETCH, LEAST_TARGETS = 25.0, 10
# Sizes are those of two sheets where in the two groups that fit best less than a share of their variance is left. Of n
# normal ones 0.36 are left, and by chance no less than so much below it over the root of n (Monte Carlo, one of 50,000:
# 0.145 of 40, 0.20 of 80). A group is this share at least. Half of the stickers 1 % larger: lengths 5 U off, and VALID.
OF_NORMAL, BY_CHANCE, LEAST_GROUP = 0.36, 1.35, 0.1
OF_ONE_PRINTER = 0.03  # larger ones are no prints of one sheet


@dataclass(frozen=True)
class FoundScale:
    """metric length = factor * network length; its relative standard uncertainty; stickers (or bar lengths) used.

    `scatter` is the relative standard deviation between stickers that measurement noise does not explain: the print.
    `gradient` (f,3): how the measured size follows the features' places, relatively. `stretch`: by how much longer the
    stickers are in one direction of the print than across it, relatively; 0 where that is not certain. `source`:
    what it comes from, where that is not what the session asks for. `odd`: poses of the bar that disagree. `sheets`:
    by how much the stickers of one sheet are larger than those of another, relatively; 0 where all are alike.
    """

    factor: float
    relative_uncertainty: float
    count: int
    gradient: FloatArray
    scatter: float = 0.0
    stretch: float = 0.0
    source: str = ""
    odd: "OddPoses | None" = None
    sheets: float = 0.0


@dataclass(frozen=True)
class Located:
    """An adjusted network's places of features (f,3) in its own unit, their covariance, and sigma0 squared."""

    points: FloatArray
    covariance: Covariance
    variance: float


@dataclass(frozen=True)
class Spacing:
    """The known distance between two named dots (their point indices); on a sphere it is an arc, else straight.

    `patterns` gives, by target, the places (names, 2) in mm of all its dots on the flat sticker, NaN where it has no
    such dot. Scaled so that the two dots are at their distance, they measure it 1.56 times better than the two alone.
    """

    from_point: int
    to_point: int
    distance_mm: float
    on_sphere: bool
    patterns: Mapping[int, FloatArray] | None = None


@dataclass(frozen=True)
class _Stickers:
    """Reconstructed stickers: features (n,k) of their dots, `there` (n,k), flat places (n,k,2), placement, target."""

    feature: IntArray
    there: BoolArray
    flat_mm: FloatArray
    placement: IntArray
    target: IntArray

    def select(self, keep: BoolArray) -> "_Stickers":
        placement, target = self.placement[keep], self.target[keep]
        return _Stickers(self.feature[keep], self.there[keep], self.flat_mm[keep], placement, target)


def scale_from_spacing(spacing: Spacing, features: Features, radii: FloatArray, at: Located) -> FoundScale | None:
    """The scale from all targets with enough dots reconstructed; None where there is none.

    Targets are weighted by their measurement noise and by the scatter of the print, which is estimated too (R.
    DerSimonian, N. Laird, Meta-analysis in clinical trials, 1986): the same sticker at several placements averages its
    noise, not its print error. See docs/formulation.md, Scale.
    """
    stickers = _stickers(spacing, features, at)
    if not len(stickers.target):
        return None
    flat = np.full(len(stickers.target), np.inf)
    ratio, gradient, noise = _ratios(stickers, flat, at)
    # without gross errors: a wrong code along the epipolar line of a two-view point puts that point metres away, unseen
    # by the adjustment; within 6 standard deviations, as observed and as computed, of the median
    off = np.abs(ratio / np.median(ratio) - 1)
    spread = max(1.4826 * float(np.median(off)), 1e-9)
    near = off < OF_ONE_PRINTER  # those of the other sheet may be left out below
    sheets = _sheets(ratio[near] / np.median(ratio), noise[near], stickers.target[near])
    stickers = stickers.select(off <= 6 * np.maximum(np.sqrt(np.minimum(noise, 1e-4)), spread))
    bend = flat[: len(stickers.target)]
    ratio, gradient, noise = _ratios(stickers, bend, at)
    weight, scatter = _weights(ratio, noise, stickers.target)
    for _ in range(4 if spacing.on_sphere else 0):  # how a sticker bends depends on the radius in millimetres
        bend = radii[stickers.placement] / float(weight @ ratio)
        ratio, gradient, noise = _ratios(stickers, bend, at)
        weight, scatter = _weights(ratio, noise, stickers.target)
    mean = float(weight @ ratio)
    stretch = _stretch(stickers, at.points, bend, weight)
    per_target = np.bincount(np.unique(stickers.target, return_inverse=True)[1], weight)
    # which of the two directions, or sheets, has the length that was asked for is not known
    further = (stretch**2 + sheets**2) / 4
    found = _found(stickers, at, mean, gradient * (weight / mean)[:, None, None], per_target, scatter, further)
    return replace(found, stretch=stretch, sheets=sheets)


def scale_from_mean_distance(spacing: Spacing, features: Features, radii: FloatArray, at: Located) -> FoundScale | None:
    """The scale exactly as in [Tao21] (18)-(19): mean distance of the two dots of all targets over the known one.

    No weights, no other dots, no arc: on a ball lengths come out too long by d^2 / (24 R^2) relatively, which counts as
    uncertainty. None where no target has both dots.
    """
    stickers = _stickers(replace(spacing, patterns=None), features, at)
    n = len(stickers.target)
    if not n:
        return None
    ratio, gradient, noise = _ratios(stickers, np.full(n, np.inf), at)
    mean = float(ratio.mean())
    scatter = _weights(ratio, noise, stickers.target)[1]
    per_target = np.bincount(np.unique(stickers.target, return_inverse=True)[1]).astype(float) / n
    known = radii[np.isfinite(radii)] / mean
    arc = spacing.distance_mm**2 / (24 * float(np.median(known)) ** 2) if spacing.on_sphere and len(known) else 0.0
    return _found(stickers, at, mean, gradient / (n * mean), per_target, scatter, arc**2)


def _found(
    of: _Stickers, at: Located, mean: float, by_dot: FloatArray, per_target: np.ndarray, scatter: float, more: float
) -> FoundScale:
    """The scale by the mean size, as it follows dots (n,k,3); weights of the targets (t,), `more` relative variance."""
    total = np.zeros_like(at.points)
    np.add.at(total, of.feature[of.there], by_dot[of.there])
    by_print = scatter**2 * float((per_target**2).sum())
    uncertainty = np.sqrt(at.variance * at.covariance.functional(total) + by_print + more)
    return FoundScale(1.0 / mean, float(uncertainty), len(per_target), total, scatter)


def _ratios(stickers: _Stickers, radius_mm: FloatArray, at: Located) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Size (n,) of each sticker in network units per mm, its derivative by the dots (n,k,3), its relative variance.

    The size is that of the similarity which lays the bent pattern over the dots with equal weights (S. Umeyama, 1991).
    """
    bent, place, rotation = _laid_over(stickers, at.points, radius_mm)
    turned = bent @ rotation.transpose(0, 2, 1)
    gradient = turned / (bent**2).sum(axis=(1, 2))[:, None, None]
    ratio = (gradient * place).sum(axis=(1, 2))
    noise = np.where(stickers.there[:, :, None, None], at.covariance.own_noise[stickers.feature], 0.0)
    spread = np.einsum("nki,nkij,nkj->n", gradient, noise, gradient)
    return ratio, gradient, at.variance * spread / ratio**2


def _laid_over(
    stickers: _Stickers, points: FloatArray, radius_mm: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bent patterns and reconstructed dots (n,k,3) about their middles, 0 where there is none, and the rotations."""
    w = stickers.there[:, :, None]
    count = w.sum(axis=1, keepdims=True)
    bent = np.where(w, bend(stickers.flat_mm, radius_mm), 0.0)
    place = np.where(w, points[stickers.feature], 0.0)
    bent = np.where(w, bent - bent.sum(axis=1, keepdims=True) / count, 0.0)
    place = np.where(w, place - place.sum(axis=1, keepdims=True) / count, 0.0)
    u, _, vt = np.linalg.svd(place.transpose(0, 2, 1) @ bent)
    sign = np.ones((len(u), 3))
    sign[:, 2] = np.sign(np.linalg.det(u @ vt))
    return bent, place, (u * sign[:, None, :]) @ vt


def _stretch(stickers: _Stickers, points: FloatArray, radius_mm: FloatArray, weight: FloatArray) -> float:
    """By how much stickers are longer in one direction of the print than across it; 0 if that is not certain.

    The part x -> (a x + b y, b x - a y) is taken of what each sticker's dots are off from their pattern. Its scatter
    from target to target has the print's own errors in it.
    """
    whole = stickers.there.sum(axis=1) >= LEAST_DOTS
    stickers, weight = stickers.select(whole), weight[whole]
    if not len(weight):
        return 0.0
    bent, place, rotation = _laid_over(stickers, points, radius_mm[whole])
    squares = (bent**2).sum(axis=(1, 2))
    seen = place @ rotation
    off = seen / ((seen * bent).sum(axis=(1, 2)) / squares)[:, None, None] - bent
    x, y, dx, dy = bent[..., 0], bent[..., 1], off[..., 0], off[..., 1]
    flat = (x**2 + y**2).sum(axis=1)
    parts = np.stack([(x * dx - y * dy).sum(axis=1), (x * dy + y * dx).sum(axis=1)], axis=1) / flat[:, None]
    index = np.unique(stickers.target, return_inverse=True)[1]
    total = np.bincount(index, weight)
    if len(total) < LEAST_TARGETS:
        return 0.0
    of_target = np.stack([np.bincount(index, weight * part) / total for part in parts.T], axis=1)
    share = total / total.sum()
    mean = share @ of_target
    variance = (share**2) @ (of_target - mean) ** 2 * len(total) / (len(total) - 1)
    if ((mean**2) / np.maximum(variance, 1e-300)).sum() < SURE_STRETCH:
        return 0.0
    return 2 * float(np.hypot(*mean))


def _sheets(ratio: FloatArray, variance: FloatArray, target: IntArray) -> float:
    """By how much the stickers (n,) of one sheet are larger than those of another; 0 where they are no two groups.

    By the surer half of them: noise fills the gap between the groups.
    """
    index = np.unique(target, return_inverse=True)[1]
    precision = np.bincount(index, 1 / variance)
    size = np.bincount(index, ratio / variance) / precision
    size = np.sort(size[precision >= np.median(precision)]) if len(size) else size
    n, least = len(size), max(int(LEAST_GROUP * len(size)), 2)
    if n < LEAST_TARGETS:
        return 0.0
    split = np.arange(least, n - least + 1)
    apart = (size.sum() - size.cumsum()[split - 1]) / (n - split) - size.cumsum()[split - 1] / split
    between = apart**2 * split * (n - split) / n
    best = int(np.argmax(between))
    left = 1 - between[best] / ((size - size.mean()) ** 2).sum()
    return float(apart[best]) if left < OF_NORMAL - BY_CHANCE / np.sqrt(n) else 0.0


def bend(flat_mm: FloatArray, radius_mm: FloatArray) -> FloatArray:
    """Dots (n,k,3) mm of flat stickers (n,k,2) laid on balls of radii (n,), z into the ball (exponential map)."""
    distance = np.linalg.norm(flat_mm, axis=2)
    radius = np.where(np.isfinite(radius_mm) & (radius_mm > 0), radius_mm, np.inf)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(radius > distance, radius, np.inf)
        angle = distance / radius
        shrink = np.where(angle > 0, np.sin(angle) / angle, 1.0)
        depth = np.where(angle > 0, distance * np.tan(angle / 2), 0.0)
    depth = np.where(angle > 0, depth * np.sinc(angle / np.pi), 0.0)  # R (1 - cos) = d sin(a) / a tan(a / 2)
    return np.asarray(np.concatenate([flat_mm * shrink[:, :, None], depth[:, :, None]], axis=2), dtype=np.float64)


def _stickers(spacing: Spacing, features: Features, at: Located) -> _Stickers:
    """All stickers of all placements with both dots, or with enough of their pattern, reconstructed."""
    known = np.flatnonzero(at.covariance.is_located & np.isfinite(at.points[:, 0]))
    names = int(features.point.max(initial=0)) + 1
    both = np.stack([features.placement[known], features.target[known]], axis=1)
    keys, row = np.unique(both, axis=0, return_inverse=True)
    feature = np.full((len(keys), max(names, spacing.from_point + 1, spacing.to_point + 1)), -1)
    feature[row, features.point[known]] = known
    flat = np.array([_pattern(spacing, int(target), feature.shape[1]) for target in keys[:, 1]])
    flat = flat.reshape(len(keys), feature.shape[1], 2)
    there = (feature >= 0) & np.isfinite(flat[:, :, 0])
    ends = there[:, spacing.from_point] & there[:, spacing.to_point]
    enough = ends | (there.sum(axis=1) >= LEAST_DOTS)
    found = _Stickers(
        np.where(there, feature, 0), there, np.where(there[:, :, None], flat, 0.0), keys[:, 0], keys[:, 1]
    )
    return found.select(enough & _once(found, at.covariance))


def _pattern(spacing: Spacing, target: int, names: int) -> FloatArray:
    """Places (names, 2) in mm of a target's dots, scaled to the known distance; the two dots alone without a layout."""
    ends = [spacing.from_point, spacing.to_point]
    flat = None if spacing.patterns is None else spacing.patterns.get(target)
    out = np.full((names, 2), np.nan)
    if flat is not None and np.isfinite(flat[ends]).all():
        out[: len(flat)] = flat[:names]
        return out * (spacing.distance_mm / float(np.linalg.norm(flat[ends[1]] - flat[ends[0]])))
    out[ends] = [[-spacing.distance_mm / 2, 0.0], [spacing.distance_mm / 2, 0.0]]
    return out


def _once(stickers: _Stickers, covariance: Covariance) -> BoolArray:
    """Stickers (n,) to use: of the rigid ball's, each one only at the placement where most of its dots are seen."""
    unknown = np.where(stickers.there, covariance.point_of_feature[stickers.feature], -1)
    keep, seen = np.zeros(len(unknown), dtype=bool), set[int]()
    for row in np.argsort(-stickers.there.sum(axis=1), kind="stable"):
        own = set(unknown[row][stickers.there[row]].tolist())
        keep[row] = not own & seen
        seen |= own
    return keep


def _weights(ratio: FloatArray, variance: FloatArray, target: IntArray) -> tuple[FloatArray, float]:
    """Weights (n,) that sum to 1, and the scatter between targets beyond the noise, from relative variances (n,)."""
    ratio = ratio / np.median(ratio)
    index = np.unique(target, return_inverse=True)[1]
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
