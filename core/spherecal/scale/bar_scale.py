"""Millimetres from the certified lengths of bars whose role is `scale`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.problem import LengthRows
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.data.findings import Finding, Findings
from spherecal.data.session import Bar, BarLength, Mark, Recording
from spherecal.geometry.transform import fit_similarity
from spherecal.scale.bar_temperature import reference_length, temperature_part
from spherecal.scale.spacing import FoundScale, Located
from spherecal.targets.centre import centre_by_point, target_centre

# What keeps the lengths of one bar in different poses from being exactly proportional: the thermometer's last digit,
# and how well a mark sits on the bar's line (1e-6 of the length: 0.5 um on 500 mm).
TEMPERATURE_RESOLUTION_K = 0.1
LEAST_OWN = 1e-6
# Poses of a bar disagree where the longest and the shortest ratio are so many of their standard uncertainties apart: of
# 6 right poses once in 3000 times, of 20 once in 300.
ODD = 4.0


@dataclass(frozen=True)
class _Mark:
    """A mark in network units: dots it rests on (k,), their layout (k,2) mm, or None where it is a point itself."""

    dots: IntArray
    layout_mm: FloatArray | None

    def place(self, points: FloatArray, factor: float) -> FloatArray:
        if self.layout_mm is None:
            return points[self.dots[0]]
        centre = target_centre(self.layout_mm, points[self.dots] * factor)
        return np.full(3, np.nan) if centre is None else centre / factor

    def weights(self) -> FloatArray:
        """Coefficients (k,) of the dots whose sum is the mark: the origin under the affine fit of the flat layout."""
        if self.layout_mm is None:
            return np.ones(1)
        return np.linalg.pinv(np.column_stack([np.ones(len(self.dots)), self.layout_mm]))[0]

    def pulled(self, along: FloatArray, points: FloatArray, factor: float) -> FloatArray:
        """Derivatives (k,3) of the place in a direction (3,) by the dots."""
        flat = self.layout_mm
        by_point = np.eye(3)[None] if flat is None else centre_by_point(flat, points[self.dots] * factor)
        return np.einsum("i,kij->kj", along, by_point)


@dataclass(frozen=True)
class _Sample:
    """One certified length in one pose: its two marks, its reference at the pose's temperature, certificate."""

    first: _Mark
    second: _Mark
    reference_mm: float
    certified: BarLength
    pose: str
    temperature_mm: float

    @property
    def standard_mm(self) -> float:
        """The standard uncertainty of its certificate."""
        return self.certified.expanded_uncertainty_mm / self.certified.coverage_factor

    def length(self, points: FloatArray, factor: float) -> tuple[float, FloatArray]:
        """The length in network units, and the unit vector from the first mark to the second."""
        difference = self.second.place(points, factor) - self.first.place(points, factor)
        along = difference / np.linalg.norm(difference)
        return float(difference @ along), along

    def gradient(self, points: FloatArray, along: FloatArray, factor: float) -> FloatArray:
        """How the length in network units follows the features' places, (f,3)."""
        gradient = np.zeros_like(points)
        for mark, sign in ((self.first, -1.0), (self.second, 1.0)):
            np.add.at(gradient, mark.dots, sign * mark.pulled(along, points, factor))
        return gradient


@dataclass(frozen=True)
class OddPoses:
    """Poses of a bar whose lengths differ from the others', the largest difference, and how many poses agree."""

    poses: tuple[str, ...]
    worst_mm: float
    times: float
    rest: int
    majority: bool

    @property
    def finding(self) -> Finding:
        """What a calibration says of them."""
        values = {"worst_mm": self.worst_mm, "times": self.times}
        if not self.majority:
            return Finding("bar-poses-disagree", "error", values, self.poses, kind="no-majority")
        return Finding("bar-poses-disagree", "warning", values | {"rest": self.rest}, self.poses, kind="left-out")


def within_growth(findings: Sequence[Finding], growth: float) -> Findings:
    """The findings; where lengths are so many times as uncertain as the adjustment says, poses within that are right.

    With lenses off by 0.13 px that 1400 points cannot show, bars were up to 4.8 standard deviations off, and parts of
    the recording disagreed by 2.05 times what noise does.
    """
    return tuple(
        replace(f, severity="info") if f.code == "bar-poses-disagree" and f.values["times"] <= ODD * growth else f
        for f in findings
    )


def odd_poses(recording: Recording, bar_id: str, at: Located) -> OddPoses | None:
    """Poses of a bar that are no part of the largest group that agrees; None where all agree.

    Each certified length is compared with itself in the other poses: its certificate errs alike in all of them. Against
    the mean of the others the network's own warp counts, with all correlations.
    """
    samples = _samples(recording, bar_id, at.covariance.is_located)
    by_length: dict[tuple[str, str], list[_Sample]] = {}
    for sample in samples:
        by_length.setdefault((sample.certified.from_mark, sample.certified.to_mark), []).append(sample)
    found: dict[str, tuple[float, float]] = {}
    for group in by_length.values():
        found |= _odd_ones(group, at)
    if not found:
        return None
    every = dict.fromkeys(sample.pose for sample in samples)
    worst = max(found.values(), key=lambda one: abs(one[1]))
    rest = len(every) - len(found)
    names = tuple(pose for pose in every if pose in found)
    return OddPoses(names, worst[0], abs(worst[1]), rest, rest > len(every) / 2 and rest > 1)


def _odd_ones(group: list[_Sample], at: Located) -> dict[str, tuple[float, float]]:
    """Poses of one length off the largest group that agrees: their difference in mm, and in standard deviations.

    What bends the rig bends its lengths together, with correlations up to 0.99: a right pose was 13.6 of the standard
    deviations of its difference from the mean off the others, 4.8 of those of the difference from these.
    """
    n, factor = len(group), _first_factor(group, at.points)
    if n < 2:
        return {}
    gradients, ratio = [], np.empty(n)
    for i, sample in enumerate(group):
        length, along = sample.length(at.points, factor)
        gradients.append(sample.gradient(at.points, along, factor) / sample.reference_mm)
        ratio[i] = length / sample.reference_mm
    matrix = at.variance * at.covariance.functionals(gradients) / ratio.mean() ** 2 + LEAST_OWN**2 * np.eye(n)
    ratio = ratio / ratio.mean()
    order = np.argsort(ratio)
    own = np.diag(matrix)
    apart = np.abs(ratio[:, None] - ratio)
    agree = (apart <= ODD * np.sqrt(np.maximum(own[:, None] + own - 2 * matrix, 0.0)))[np.ix_(order, order)]
    together = [order[a:b] for a in range(n) for b in range(a + 1, n + 1) if agree[a:b, a:b].all()]
    most = max(together, key=len)
    found = {}
    for k in np.setdiff1d(order, most).tolist():
        contrast = np.where(np.isin(np.arange(n), most), -1.0 / len(most), 0.0)
        contrast[k] += 1.0
        off, sd = float(contrast @ ratio), float(np.sqrt(contrast @ matrix @ contrast))
        if abs(off) > ODD * sd:
            found[group[k].pose] = (off * group[k].reference_mm, off / sd)
    return found


def scale_from_bars(recording: Recording, bar_id: str, at: Located, odd: OddPoses | None = None) -> FoundScale | None:
    """The scale from all poses of a bar, weighted by measurement noise; None where no length could be measured.

    The relative uncertainty holds noise and calibration with all correlations, and the certificate and the bar's
    temperature, which more poses do not average. See docs/formulation.md, Scale.
    """
    samples = _samples(recording, bar_id, at.covariance.is_located, odd)
    if not samples:
        return None
    mean, weight = _mean_ratio(samples, _first_factor(samples, at.points), at)
    for _ in range(4):  # a centre laid over its dots depends on the scale, but hardly: 1 % of scale moves it by um
        mean, weight = _mean_ratio(samples, 1.0 / mean, at)
    factor = 1.0 / mean
    gradient = np.zeros_like(at.points)
    certificate = temperature = 0.0
    for sample, w in zip(samples, weight, strict=True):
        along = sample.length(at.points, factor)[1] * (w / (sample.reference_mm * mean))
        gradient += sample.gradient(at.points, along, factor)
        certificate += w * sample.standard_mm / sample.certified.length_mm
        temperature += w * sample.temperature_mm / sample.certified.length_mm
    uncertainty = np.sqrt(at.variance * at.covariance.functional(gradient) + certificate**2 + temperature**2)
    return FoundScale(factor, float(uncertainty), len(samples), gradient, odd=odd)


def length_rows(
    recording: Recording, bar_id: str, points_mm: FloatArray, odd: OddPoses | None = None
) -> LengthRows | None:
    """The certified lengths of a bar in all its poses as rows of an adjustment; None where none could be measured.

    A certificate errs alike in all poses, and so do the thermometer and the coefficient of expansion; between poses
    only the resolution of the temperature is free.
    """
    bar = _bar(recording, bar_id)
    samples = _samples(recording, bar_id, np.isfinite(points_mm[:, 0]), odd)
    if not samples:
        return None
    widest = max(len(s.first.dots) + len(s.second.dots) for s in samples)
    points = np.zeros((len(samples), widest), dtype=np.int64)
    coefficient = np.zeros((len(samples), widest))
    for row, sample in enumerate(samples):
        dots = np.concatenate([sample.first.dots, sample.second.dots])
        points[row, : len(dots)] = dots
        coefficient[row, : len(dots)] = np.concatenate([-sample.first.weights(), sample.second.weights()])
    reference = np.array([s.reference_mm for s in samples])
    certificate = np.array([s.standard_mm for s in samples])
    of = np.array([f"{s.certified.from_mark} {s.certified.to_mark}" for s in samples])
    same = of[:, None] == of
    own = bar.expansion_per_kelvin * reference * TEMPERATURE_RESOLUTION_K
    warm = np.array([s.temperature_mm for s in samples])
    covariance = (
        np.outer(certificate, certificate) * same
        + np.outer(warm, warm)
        + np.diag(np.maximum(own, LEAST_OWN * reference) ** 2)
    )
    return LengthRows(points, coefficient, reference, covariance)


def _bar(recording: Recording, bar_id: str) -> Bar:
    return next(b for b in recording.session.bars if b.id == bar_id)


def _samples(recording: Recording, bar_id: str, known: np.ndarray, odd: OddPoses | None = None) -> list[_Sample]:
    """All lengths that are reconstructed, but in poses that a majority contradicts."""
    session, bar, samples = recording.session, _bar(recording, bar_id), []
    without = odd.poses if odd is not None and odd.majority else ()
    for pose in (p for p in session.bar_poses if p.bar == bar.id and p.id not in without):
        index = recording.observations.placements.index(pose.id)
        marks = {name: _mark(recording, mark, index, known) for name, mark in bar.marks.items()}
        for certified in bar.lengths:
            first, second = marks[certified.from_mark], marks[certified.to_mark]
            if first is not None and second is not None:
                reference = reference_length(certified, bar, pose.temperature_c)
                warm = temperature_part(certified.length_mm, bar, pose.temperature_c)
                samples.append(_Sample(first, second, reference, certified, pose.id, warm))
    return samples


def _mark(recording: Recording, mark: Mark, placement: int, known: np.ndarray) -> _Mark | None:
    session, observations, features = recording.session, recording.observations, recording.features
    rows = np.flatnonzero((features.placement == placement) & (features.target == mark.target) & known)
    names = [observations.points[p] for p in features.point[rows]]
    if mark.point in names:
        return _Mark(rows[[names.index(mark.point)]], None)
    layout = session.target_set.layouts.get(mark.target) if session.target_set is not None else None
    if mark.point != "centre" or layout is None:
        return None
    take = [i for i, name in enumerate(names) if name in layout]
    found = _Mark(rows[take], np.array([layout[names[i]] for i in take]).reshape(-1, 2))
    return found if len(take) >= 4 else None


def _first_factor(samples: list[_Sample], points: FloatArray) -> float:
    """A factor good to a percent: from the spread of a mark's dots, or from the lengths where marks are points."""
    mark = samples[0].first
    if mark.layout_mm is not None:
        flat = np.column_stack([mark.layout_mm, np.zeros(len(mark.dots))])
        return 1.0 / fit_similarity(flat, points[mark.dots]).scale
    second = samples[0].second
    return samples[0].reference_mm / float(np.linalg.norm(points[second.dots].mean(axis=0) - points[mark.dots[0]]))


def _mean_ratio(samples: list[_Sample], factor: float, at: Located) -> tuple[float, FloatArray]:
    """The mean ratio of measured to reference lengths and the weights (n,) behind it, by the marks' own noise."""
    ratio, precision = np.empty(len(samples)), np.empty(len(samples))
    for i, sample in enumerate(samples):
        length, along = sample.length(at.points, factor)
        ratio[i] = length / sample.reference_mm
        noise = 0.0
        for mark in (sample.first, sample.second):
            by_dot = mark.pulled(along, at.points, factor)
            noise += float(np.einsum("ki,kij,kj->", by_dot, at.covariance.own_noise[mark.dots], by_dot))
        precision[i] = sample.reference_mm**2 / noise
    weight = precision / precision.sum()
    return float(weight @ ratio), weight
